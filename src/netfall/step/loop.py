"""The time loop: central difference in half-step velocities, compiled, the exchange included.

A step n takes x(n) and v(n-1/2); first the row of the history is made of them where one is due (`rows.py`).
Cables that slip over nodes get their kick. Particles go through it in chunks that stay in the cache:
    1. internal forces f_int(x(n)) of a chunk; where elements come near their limits, yield and fracture
       strain
    2. external force, kick to v(n+1/2), work; x(n+1) is written to a second array, so that the order of
       chunks does not matter
    3. after the chunks with boundary particles, which come first: their total forces are sent
    4. the halo's total forces arrive; halo particles: the same kick and drift; drift of slips, and unstressed
       lengths that follow
    5. elements that reached their fracture strain break at x(n+1) (`tear.py`); the loop returns if there is
       no room for what they leave

It is compiled once for all scenes: what a scene has is looked up in its arrays, a few times for each chunk.
"""

from typing import NamedTuple

from netfall.core.kernels import call, inner_kernel, kernel, routine
from netfall.core.records import Record, f8, f8_2, has, i8, real, u1, whole
from netfall.mechanics.air import RelativeWind, set_air, set_drag
from netfall.mechanics.bending import Joints, bend, clear_bending_forces
from netfall.mechanics.events import StepDone
from netfall.mechanics.fields import Elements, Particles, Slots
from netfall.mechanics.fracture import Fractures
from netfall.mechanics.ground import Ground, move_ground
from netfall.mechanics.law.branches import set_branches
from netfall.mechanics.law.law import Law
from netfall.mechanics.slip.motion import Places, drift_slips, kick_slips
from netfall.parallel.halo import (
    HaloBuffers,
    buffer_in_use,
    pack_forces,
    send_buffer,
    unpack_forces,
    wait_for_neighbours,
)
from netfall.parallel.mpi_calls import lap
from netfall.step.forces import Scratch, chunk_forces
from netfall.step.limits import is_any_over, look_closer
from netfall.step.motion import PLAIN_LAW, move_chunk, move_halo
from netfall.step.rows import Rows, is_due
from netfall.step.slots import collect_elements, follow_slips
from netfall.step.tear import break_elements

FORCES, EXCHANGE, INTEGRATION, ROWS = range(4)  # what time goes into; the kick counts with the forces


class Interval(NamedTuple):
    """Steps between two samples of the loads that vary, or fewer.

    first : number of the first step, at time first * dt; steps : how many; dt : [s] their length
    stride : how many of the steps that are counted each of them is
    before_dt : [s] length of the step before the first, 0 at the start
    zeta : [1/s] damping; sample_time : [s] of the sample before; sample_dt : [s] from it to the one after
    trial : whether nothing breaks yet: the steps are taken back if something reaches its fracture strain
    pending : elements that are still to break in the step before the first, where there are no steps
    row : whether the row of the first step is made, if it is due, and nothing else
    """

    first: int
    steps: int
    before_dt: float
    dt: float
    zeta: float
    sample_time: float
    sample_dt: float
    stride: int = 1
    trial: bool = False
    pending: int = 0
    row: bool = False


class Chunks(Record):
    """Stretches of particles, each small enough for the cache, in the order in which they are stepped.

    First those of the owned particles, of which `boundary` chunks hold the boundary particles; then, from
    chunk `owned` on, those of the particles that split off, `size` in each, some empty as yet.
    low, high : (chunks,) particles of each; width : (chunks,) most elements at one of them
    has_yielded : (chunks,) whether any of its elements may have plastic strain
    """

    n_owned: whole
    n_halo: whole
    boundary: whole
    owned: whole
    size: whole
    low: i8
    high: i8
    width: i8
    has_yielded: u1


class Spare(Record):
    """Room for what breaks. rows : (1,) of particles in use, of `most_rows`; events : the same of the log."""

    rows: i8
    most_rows: whole
    events: i8
    most_events: whole


class Work(Record):
    """What the loop works on, see `plan.Plan`; absent is what a scene does not have.

    traits : bits of what the rank has, of `motion`
    y : (3, n) [m] positions, in turn with those of `particles`
    bends : joints of chains that bend; breaks : 1 where elements may break
    seconds : (4,) [s], added to, time of FORCES, EXCHANGE, INTEGRATION, ROWS; absent: not measured
    step_chunks, make_row, tear : addresses of these routines
    """

    traits: whole
    chunks: Chunks
    particles: Particles
    y: f8_2
    elements: Elements
    slots: Slots
    law: Law
    scratch: Scratch
    spare: Spare
    fractures: Fractures
    breaks: whole
    bends: Joints
    places: Places
    ground: Ground
    relative: RelativeWind
    rows: Rows
    buffers: HaloBuffers
    seconds: f8
    step_chunks: whole
    make_row: whole
    tear: whole


@inner_kernel
def has_room(count, spare):
    """Whether there is room for what `count` elements can leave: two particles and two events each."""
    enough = spare.rows[0] + 2 * count <= spare.most_rows
    return enough and spare.events[0] + 2 * count <= spare.most_events


@inner_kernel
def copy_positions(particles, x, y):
    """Copy positions x (3, n) to y, of `particles` rows."""
    for k in range(3):
        for p in range(particles):
            y[k, p] = x[k, p]


@inner_kernel
def collect(work):
    """Bring the elements up to date with what their slots have of their own."""
    chunks, slots = work.chunks, work.slots
    changed = has(slots.eps_p) and chunks.has_yielded.any()
    if changed or has(slots.highest) or has(slots.branch_a):
        collect_elements(chunks.n_owned, chunks.n_owned + chunks.n_halo, work.elements, slots, work.law)


@kernel
def collect_now(work):
    """`collect` from Python."""
    collect(work)


@inner_kernel
def begin_step(time, before_dt, dt, kick_dt, zeta, share, anew, work):
    """What forces need at a time [s]: branches, air, chains that bend, drag; kick of slips.

    before_dt, dt : [s] the steps before and after; kick_dt [s], share : of the kick
    anew : whether the kick, or a mass, is another than in the step before
    """
    particles, law = work.particles, work.law
    if has(law.branches):
        set_branches(before_dt, dt, law)
    if has(particles.air) and anew:
        set_air(kick_dt, zeta, particles)
    if has(work.bends.stiffness):
        clear_bending_forces(work.bends, particles.bend.T)
        bend(particles.x.T, work.bends, particles.bend.T)
    if has(work.places.node):
        kick_slips(time, kick_dt, share, work.places, particles, work.elements, law)
    if has(particles.drag):
        set_drag(kick_dt, share, work.relative, particles)


@routine(whole, real, real, real, real, Work.kind)
def step_chunks(turned, kick_dt, zeta, share, dt, work):
    """Step the particles that this rank owns, and send; elements that are to break, or -MPI's error code.

    turned : whether x(n) stands in the second array, and x(n+1) goes to the first
    """
    x, y = work.particles.x, work.y
    if turned:
        x, y = y, x
    chunks, particles, elements, slots, law = work.chunks, work.particles, work.elements, work.slots, work.law
    scratch, traits, seconds = work.scratch, work.traits, work.seconds
    count, mark = 0, lap(seconds, -1, 0.0, work.buffers)
    for c in range(chunks.low.shape[0]):
        low, high = chunks.low[c], chunks.high[c]
        if high == low:
            continue
        near = chunk_forces(c, traits & PLAIN_LAW, x, chunks, slots, law, scratch)
        keeps = near or c < chunks.boundary
        move_chunk(low, high, keeps, traits, kick_dt, zeta, share, dt, x, y, particles, scratch)
        if near:
            count = look_closer(c, count, x, scratch.near, chunks, elements, slots, law)
        if c == chunks.boundary - 1:
            mark = lap(seconds, FORCES, mark, work.buffers)
            pack_forces(particles, buffer_in_use(work.buffers), work.buffers)
            error = send_buffer(work.buffers)
            if error != 0:
                return -error
            mark = lap(seconds, EXCHANGE, mark, work.buffers)
    lap(seconds, FORCES, mark, work.buffers)
    return count


@routine(whole, whole, real, whole, Work.kind)
def tear(count, number, dt, stride, work):
    """Break elements in the step of a number. count : of those in elements.pending"""
    when = StepDone(number * dt, number * stride, dt)
    break_elements(count, when, work.chunks, work.elements, work.slots, work.law, work.fractures)
    return 0


@kernel
def time_loop(
    first, steps, before_dt, dt, zeta, sample_time, sample_dt, stride, trial, pending, only_row, work
):
    """The steps of an `Interval`; steps done, elements that are still to break, MPI's error code.

    In a trial the second is the number of steps up to and with the one at whose begin the first element has
    passed its fracture strain, one more than there are where it is at the end of the last; 0 if none has.

    only_row : `Interval.row`; work : `Work`
    """
    chunks, particles, buffers, rows = work.chunks, work.particles, work.buffers, work.rows
    seconds, n_owned = work.seconds, work.chunks.n_owned
    x, y, turned = particles.x, work.y, False  # turned: whether x(n) stands in the second array
    in_place = has(work.bends.stiffness) or has(work.places.node)
    tried, kicked_dt = 0, -1.0  # kicked_dt: of the kick before, if nothing broke
    if pending > 0:
        call(work.tear, (pending, first - 1, dt, stride, work))
    done = steps
    for s in range(max(steps, int(only_row))):
        kick_dt = 0.5 * (before_dt + dt)
        n = first + s
        due = is_due(n * stride, rows)
        if turned and (due or in_place):
            copy_positions(work.spare.rows[0], x, y)
            x, y, turned = y, x, False
        if has(work.ground.start):
            move_ground(n * dt, before_dt, (n + 1) * dt, zeta, work.ground, particles)
        if due:
            mark = lap(seconds, -1, 0.0, buffers)
            collect(work)
            call(work.make_row, (n * stride, before_dt, dt, zeta, sample_time, sample_dt, rows))
            lap(seconds, ROWS, mark, buffers)
        if only_row:
            break
        # of the step's number alone, wherever the loop was entered
        share = (n * dt - sample_time) / sample_dt
        begin_step(n * dt, before_dt, dt, kick_dt, zeta, share, kick_dt != kicked_dt, work)
        before_dt, kicked_dt = dt, kick_dt
        place = buffer_in_use(buffers)
        count = call(work.step_chunks, (int(turned), kick_dt, zeta, share, dt, work))
        mark = lap(seconds, -1, 0.0, buffers)
        error = -count if count < 0 else wait_for_neighbours(buffers)
        mark = lap(seconds, EXCHANGE, mark, buffers)
        if error != 0:
            return s, 0, error
        unpack_forces(n_owned, particles, place, buffers)
        move_halo(n_owned, n_owned + chunks.n_halo, work.traits, kick_dt, zeta, dt, x, y, particles)
        x, y, turned = y, x, not turned
        if has(work.places.node):
            drift_slips(dt, work.places, particles)
            follow_slips(work.places, n_owned, n_owned + chunks.n_halo, particles, work.elements, work.slots)
        lap(seconds, INTEGRATION, mark, buffers)
        if count > 0:
            if trial:
                tried = s + 1 if tried == 0 else tried
                continue
            if turned:
                copy_positions(work.spare.rows[0], x, y)
                x, y, turned = y, x, False
            if not has_room(count, work.spare):
                done = s + 1
                tried = count
                break
            call(work.tear, (count, n, dt, stride, work))
            kicked_dt = -1.0  # masses have changed
    if turned:
        copy_positions(work.spare.rows[0], x, y)
    if trial and tried == 0 and work.breaks and is_any_over(particles.x, work.elements, work.law):
        tried = steps + 1
    return done, tried, 0
