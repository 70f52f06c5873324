"""The time loop: central difference in half-step velocities, compiled, the exchange included.

A step n takes x(n) and v(n-1/2); first the row of the history is made of them where one is due (`rows.py`).
Cables that slip over nodes get their kick. Particles go through it in chunks that stay in the cache:
    1. internal forces f_int(x(n)) of a chunk; where elements come near their limits, yield and fracture
       strain
    2. external force, kick to v(n+1/2), work
    3. after the chunks with boundary particles, which come first: their total forces are sent
    4. drift to x(n+1) of the chunks whose x(n) no later chunk needs; at the end, of all
    5. the halo's total forces arrive; halo particles: the same kick and drift; drift of slips, and unstressed
       lengths that follow
    6. elements that reached their fracture strain break at x(n+1) (`tear.py`); the loop returns if there is
       no room for what they leave
"""

from typing import NamedTuple

import numpy as np

from netfall.ground.apart import Entry, call
from netfall.ground.compile import inner_kernel, kernel, part_of_kernel, vector_kernel
from netfall.mechanics.air import set_air
from netfall.mechanics.bending import Bends, find_bending_forces
from netfall.mechanics.events import StepDone
from netfall.mechanics.ground import Ground, move_ground, velocity_after
from netfall.mechanics.law.branches import set_branches
from netfall.mechanics.motion import along_x, along_y, along_z, kicked, make_kick
from netfall.mechanics.slip.motion import Places, drift_slips, kick_slips
from netfall.mechanics.supports import on_guide
from netfall.parallel.halo import receive_forces, send_forces, wait_for_neighbours
from netfall.parallel.mpi_symbols import lap
from netfall.step.limits import anything_over, count_near, yield_and_break
from netfall.step.rows import Rows, is_due, make_row
from netfall.step.slots import collect_branches, collect_extremes, collect_yields, follow_slips
from netfall.step.tear import has_room

FORCES, EXCHANGE, INTEGRATION, ROWS = range(4)  # what time goes into; the kick counts with the forces


class Interval(NamedTuple):
    """Steps between two samples of the loads that vary, or fewer.

    first : number of the first step, at time first * dt; steps : how many; dt : [s] their length
    stride : how many of the steps that are counted each of them is
    before_dt : [s] length of the step before the first, 0 at the start
    zeta : [1/s] damping; sample_time : [s] of the sample before; sample_dt : [s] from it to the one after
    ground : where supports move
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
    ground: Ground | None = None
    pending: int = 0
    row: bool = False


class Beside(NamedTuple):
    """What is done beside forces, kick and drift; None: it is not.

    rows : of which those are made that are due before the last step; bends : forces of chains that bend
    places : at which cables slip; kick_chunk, kick_unyielded : of `forces`, the latter where something may
        yield; break_elements : of `tear`
    """

    rows: Rows | None
    bends: Bends | None
    places: Places | None
    kick_chunk: Entry
    kick_unyielded: Entry | None
    break_elements: Entry | None


@inner_kernel
def step_done(interval, s):
    """Step number s of an interval."""
    number = interval.first + s
    return StepDone(number * interval.dt, number * interval.stride, interval.dt)


@vector_kernel
def drift_rows(first, last, dt, x, v):
    """x [m] to n + 1 of particles first to last; x, v : three of (n,), v = 0 where held."""
    first, last = np.uint64(first), np.uint64(last)  # unsigned: no index then counts from the end
    for p in range(first, last):
        x[0][p] += dt * v[0][p]
        x[1][p] += dt * v[1][p]
        x[2][p] += dt * v[2][p]


@part_of_kernel
def is_split(c, chunks):
    """Whether the particles of chunk c have split off."""
    if chunks.is_split is None:
        return False
    return chunks.is_split[c] != 0


@inner_kernel
def kick(c, kick_dt, zeta, share, chunks, particles, slots, unyielded, law, scratch, beside):
    """`kick_chunk`, without a look at plastic strains where the chunk has none."""
    if slots.eps_p is not None:  # noqa: SIM102 (the compiler drops a branch on this alone)
        if not chunks.has_yielded[c] and not is_split(c, chunks):
            apart = beside.kick_unyielded
            call(apart, c, kick_dt, zeta, share, chunks, particles, unyielded, law, scratch)
            return
    call(beside.kick_chunk, c, kick_dt, zeta, share, chunks, particles, slots, law, scratch)


@vector_kernel
def keep_forces(low, high, f_chunk, f):
    """Total forces of a chunk, particles low to high, from its scratch to f. f_chunk, f : three of (n,)"""
    low, high = np.uint64(low), np.uint64(high)
    for p in range(low, high):
        f[0][p] = f_chunk[0][p - low]
        f[1][p] = f_chunk[1][p - low]
        f[2][p] = f_chunk[2][p - low]


@part_of_kernel
def move_axis(p, kick, axis, f, per_mass, dt):
    """Kick and drift of particle p along one axis, under the total force f [N]."""
    new = velocity_after(p, axis.v[p], kicked(axis.v[p], f * per_mass[p], kick), axis)
    axis.v[p] = new
    axis.x[p] += dt * new


@vector_kernel
def move_halo(first, last, kick_dt, dt, zeta, particles):
    """Kick and drift of halo particles, whose total force f the owner has sent."""
    first, last = np.uint64(first), np.uint64(last)
    f, per_mass = particles.f, particles.per_mass
    kick = make_kick(kick_dt, zeta, 0.0)
    for p in range(first, last):
        fx, fy, fz = on_guide(p, (f[0][p], f[1][p], f[2][p]), particles)
        move_axis(p, kick, along_x(particles), fx, per_mass, dt)
        move_axis(p, kick, along_y(particles), fy, per_mass, dt)
        move_axis(p, kick, along_z(particles), fz, per_mass, dt)


@inner_kernel
def collect_slots(chunks, elements, slots, law):
    """Bring the elements up to date with what their slots have of their own."""
    n_owned, first_split = chunks.n_owned, chunks.n_owned + chunks.n_halo
    if slots.eps_p is not None and chunks.has_yielded.any():
        collect_yields(n_owned, first_split, elements, slots, law)
    if slots.highest is not None:
        collect_extremes(n_owned, first_split, elements, slots)
    if slots.branch_a is not None:
        collect_branches(n_owned, first_split, elements, slots)


@kernel
def time_loop(
    interval, chunks, particles, elements, slots, unyielded, law, scratch, fractures, beside, buffers, seconds
):
    """The steps of an interval; steps done, elements that are still to break, MPI error.

    In a trial the second is the number of steps up to and with the one at whose begin the first element has
    passed its fracture strain, one more than there are where it is at the end of the last; 0 if none has.

    chunks, scratch : of `Plan`; particles : `Particles` as `plan.stepped_particles` prepares them
    elements, slots, law : of `State`; unyielded : the slots without plastic strains, for chunks that
        have none
    fractures : `Fractures`; None: nothing breaks
    beside : `Beside`; buffers : `HaloBuffers`
    seconds : (4,) [s], added to, time of FORCES, EXCHANGE, INTEGRATION, ROWS; None: not measured
    """
    before_dt, dt, zeta = interval.before_dt, interval.dt, interval.zeta
    n_owned, n_halo = chunks.n_owned, chunks.n_halo
    tried, air_dt = 0, -1.0  # of the kick for which the air is set
    if fractures is not None and interval.pending > 0:
        when = step_done(interval, -1)
        call(beside.break_elements, interval.pending, when, chunks, elements, slots, law, fractures)
    for s in range(max(interval.steps, int(interval.row))):
        kick_dt = 0.5 * (before_dt + dt)
        if interval.ground is not None:
            n = interval.first + s
            move_ground(n * dt, before_dt, (n + 1) * dt, zeta, interval.ground, particles)
        if beside.rows is not None:
            number = (interval.first + s) * interval.stride
            if is_due(number, beside.rows):
                mark = lap(seconds, -1, 0.0)
                collect_slots(chunks, elements, slots, law)
                sample = interval.sample_time, interval.sample_dt
                make_row(number, before_dt, dt, zeta, sample[0], sample[1], beside.rows)
                mark = lap(seconds, ROWS, mark)
        if interval.row:
            break
        if law.branches is not None:
            set_branches(before_dt, dt, law)
        if particles.air is not None and kick_dt != air_dt:
            set_air(kick_dt, zeta, particles)
            air_dt = kick_dt
        if beside.bends is not None:
            find_bending_forces(beside.bends)
        before_dt = dt
        # of the step's number alone, wherever the loop was entered
        share = ((interval.first + s) * dt - interval.sample_time) / interval.sample_dt
        if beside.places is not None:
            time = (interval.first + s) * dt
            kick_slips(time, kick_dt, share, beside.places, particles, elements, law)
        count, place = np.int64(0), np.int64(0)
        error, drifted = 0, chunks.front
        mark = lap(seconds, -1, 0.0)
        for c in range(chunks.low.shape[0]):
            low, high = chunks.low[c], chunks.high[c]
            kick(c, kick_dt, zeta, share, chunks, particles, slots, unyielded, law, scratch, beside)
            near = 0
            if scratch.near is not None:
                near = count_near(scratch.near, high - low)
                if near > 0:
                    count, yielded = yield_and_break(
                        c, count, chunks, particles, elements, slots, law, scratch.near, scratch.f
                    )
                    chunks.has_yielded[c] |= yielded
            if c < chunks.own and not is_split(c, chunks):  # sent; `yield_and_break` keeps those that count
                keep_forces(low, high, scratch.f, particles.f)
            mark = lap(seconds, FORCES, mark)
            if c == chunks.own - 1:
                error, place = send_forces(particles, buffers)
                if error != 0:
                    return s, 0, error
                mark = lap(seconds, EXCHANGE, mark)
            while drifted <= c and chunks.last_use[drifted] <= c:
                drift_rows(chunks.low[drifted], chunks.high[drifted], dt, particles.x, particles.v)
                drifted += 1
            mark = lap(seconds, INTEGRATION, mark)
        for c in range(chunks.front):  # any chunk may need them
            drift_rows(chunks.low[c], chunks.high[c], dt, particles.x, particles.v)
        mark = lap(seconds, INTEGRATION, mark)
        error = wait_for_neighbours(buffers)
        mark = lap(seconds, EXCHANGE, mark)
        if error != 0:
            return s, 0, error
        receive_forces(n_owned, particles, place, buffers)
        if n_halo > 0:
            move_halo(n_owned, n_owned + n_halo, kick_dt, dt, zeta, particles)
        if beside.places is not None:
            drift_slips(dt, beside.places, particles)
            follow_slips(beside.places, n_owned, n_owned + n_halo, particles, elements, slots)
        mark = lap(seconds, INTEGRATION, mark)
        if fractures is not None and count > 0:
            if interval.trial:
                tried = s + 1 if tried == 0 else tried
            elif has_room(count, fractures):
                when = step_done(interval, s)
                call(beside.break_elements, count, when, chunks, elements, slots, law, fractures)
                air_dt = -1.0  # masses have changed
            else:
                return s + 1, count, 0
    if fractures is not None and interval.trial and tried == 0:
        tried = interval.steps + 1 if anything_over(particles, elements, law) else 0
    return interval.steps, tried, 0
