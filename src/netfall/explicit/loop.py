"""The compiled time loop: central difference in half-step velocities, including the halo exchange.

Step n starts from x(n) and v(n-1/2). If a history row is due, it is computed first (`rows.py`). Then the
velocities of sliding cables are updated. The particles follow in chunks that fit the cache:
    1. internal forces f_int(x(n)) of a chunk
    2. external force, velocity update to v(n+1/2), work; x(n+1) goes to a second array, so that the order of
       chunks does not matter; then an exact check of elements near yield or fracture
    3. after the chunks with boundary particles, which come first: their total forces are sent
    4. the halo's total forces arrive; halo particles get the same velocity and position update; then the
       positions of slips and the unstressed lengths are updated
    5. elements that reached their fracture strain break at x(n+1) (`fracture.py`); the loop returns if there
       is no room for the fragments

One compilation of the loop serves all problems: array presence decides at run time, a few times per chunk,
which features apply. What only some problems need is in routines, which are compiled only if a problem needs
them. The forces and the motion of a chunk are routines too: each has a simple and a general form.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from netfall.core.arrays import FloatArray
from netfall.core.kernels import call, copied_kernel, inner_kernel, kernel, part_of_kernel, routine
from netfall.core.records import Record, f8, f8_2, i8, is_present, real, u1, whole
from netfall.core.threads import each, leads, meet
from netfall.core.vectors import LANES
from netfall.explicit import forces
from netfall.explicit.fracture import any_exceeds_fracture_strain, break_elements, check_limits
from netfall.explicit.incidence import collect_elements, update_slip_lengths
from netfall.explicit.motion import advance_halo, move_vector, store_totals, total_forces, update_velocities
from netfall.explicit.sampling import Rows, is_due, record_new_extreme
from netfall.parallel import halo
from netfall.parallel.mpi_calls import add_lap
from netfall.physics.air import RelativeWind
from netfall.physics.bending import Joints, add_bending_forces
from netfall.physics.events import FractureStep
from netfall.physics.fields import Elements, Particles, Slots
from netfall.physics.fracture import Fractures
from netfall.physics.law.branches import set_branches
from netfall.physics.law.law import LawParameters
from netfall.physics.slip.motion import SlipPoints, update_slips
from netfall.physics.supports import Ground, move_ground

# Timed phases; the velocity update counts with the forces. No literals: one compilation serves all.
NOTHING, FORCES, EXCHANGE, INTEGRATION, ROWS = np.arange(-1, 4)


class Interval(NamedTuple):
    """Steps between two samples of the time-dependent loads, or fewer.

    first : number of the first step, at time first * dt; steps : number of steps; dt : [s] their length
    stride : number of counted steps that each of them covers
    before_dt : [s] length of the step before the first, 0 at the start
    zeta : [1/s] damping; sample_time : [s] of the sample before; sample_dt : [s] from it to the one after
    trial : whether nothing breaks yet: the steps are reverted if an element reaches its fracture strain
    pending : elements still to break in the step before the first, if there are no steps
    row : whether only the envelope is updated at the first step, and its row made if it is due
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
    """Spans of particles, each small enough for the cache, in the order in which they are stepped.

    Chunks of owned particles come first; the first `boundary` of them hold the boundary particles. From chunk
    `owned` on follow chunks of the particles that split off, `size` in each, some still empty.
    low, high : (chunks,) particles of each; width : (chunks,) largest number of elements at one of them
    first_support : (chunks + 1,) of `Rows.supports` in each; all equal if forces of steps are not recorded
    has_yielded : (chunks,) whether any of its elements may have plastic strain
    in_line : (n,) whether the far ends of the LANES particles from one on are consecutive in each slot
    """

    n_owned: whole
    n_halo: whole
    boundary: whole
    owned: whole
    size: whole
    low: i8
    high: i8
    width: i8
    first_support: i8
    has_yielded: u1
    in_line: u1


class SplitCapacity(Record):
    """Capacity for fragments and fracture events.

    rows : (1,) particle rows in use, of `max_rows`; events : (1,) logged events, of `max_events`
    """

    rows: i8
    max_rows: whole
    events: i8
    max_events: whole


class LoopState(Record):
    """Everything that the loop reads and writes, see `plan.StepPlan`; fields of absent features are absent.

    traits : feature bits of the rank, of `motion`
    y : (3, n) [m] second position array, swapped with that of `particles`
    bends : joints of bending chains; breaks : 1 if elements may break
    counts : (3,) breaking elements of this step, the next and the last; only on a GPU
    seconds : (4,) [s] accumulated time of FORCES, EXCHANGE, INTEGRATION, ROWS; absent: not measured
    elastic_forces and following : addresses of routines, 0 for what the problem lacks
    inelastic_forces : `yielding_forces` or `general_forces`; move_chunk : `move_plain` or `move_any`
    """

    traits: whole
    chunks: Chunks
    particles: Particles
    y: f8_2
    elements: Elements
    slots: Slots
    law: LawParameters
    scratch: forces.Scratch
    spare: SplitCapacity
    fractures: Fractures
    breaks: whole
    bends: Joints
    slip_points: SlipPoints
    ground: Ground
    relative: RelativeWind
    rows: Rows
    buffers: halo.HaloBuffers
    counts: i8
    seconds: f8
    elastic_forces: whole
    inelastic_forces: whole
    move_chunk: whole
    make_row: whole
    break_pending: whole
    collect_slots: whole
    set_branch_factors: whole
    set_air_forces: whole
    move_supports: whole
    update_slip_velocities: whole
    shift_slips: whole
    bend_joints: whole
    send_forces: whole
    receive_forces: whole


@inner_kernel
def has_room(count: int, spare: SplitCapacity) -> bool:
    """Return whether `count` fractures fit: each leaves up to two particles and two events."""
    enough = spare.rows[0] + 2 * count <= spare.max_rows
    return enough and spare.events[0] + 2 * count <= spare.max_events


@inner_kernel
def return_positions(in_second: bool, work: LoopState) -> bool:
    """Copy x(n) to the particles if it is in the second array; return False, since it is not any more."""
    x, y = work.particles.x, work.y
    if in_second:
        for k in range(3):
            for p in each(0, work.spare.rows[0]):
                x[k, p] = y[k, p]
    meet()
    return False


@routine(LoopState)
def collect_slots(work: LoopState) -> int:
    """Update the elements from the quantities that only their slots hold."""
    chunks, slots, changed = work.chunks, work.slots, False
    for c in range(chunks.has_yielded.shape[0]):
        changed = changed or (is_present(slots.eps_p) and chunks.has_yielded[c] != 0)
    if changed or is_present(slots.highest) or is_present(slots.branch_a):
        collect_elements(chunks.n_owned, chunks.n_owned + chunks.n_halo, work.elements, slots, work.law)
    return 0


@kernel
def collect_slots_now(work: LoopState) -> None:
    """Call `collect_slots` from Python."""
    call(work.collect_slots, (work,))


@routine(real, real, real, real, Ground, Particles)
def move_supports(
    time: float, before_dt: float, after: float, zeta: float, ground: Ground, particles: Particles
) -> int:
    """Call `move_ground`."""
    move_ground(time, before_dt, after, zeta, ground, particles)
    return 0


@routine(real, LoopState)
def shift_slips(dt: float, work: LoopState) -> int:
    """Update slips and the unstressed lengths that follow from them to n + 1."""
    n_owned = work.chunks.n_owned
    update_slips(dt, work.slip_points, work.particles)
    update_slip_lengths(
        work.slip_points, n_owned, n_owned + work.chunks.n_halo, work.particles, work.elements, work.slots
    )
    return 0


@routine(Joints, Particles)
def bend_joints(joints: Joints, particles: Particles) -> int:
    """Compute the forces of joints on their particles."""
    force = particles.bend.T
    for k in range(joints.stiffness.shape[0]):
        for side in range(3):
            for axis in range(3):
                force[joints.particles[k, side], axis] = 0.0
    add_bending_forces(particles.x.T, joints, force)
    return 0


@routine(real, real, LawParameters)
def set_branch_factors(before_dt: float, dt: float, law: LawParameters) -> int:
    """Call `set_branches`."""
    set_branches(before_dt, dt, law)
    return 0


@routine(LoopState)
def send_forces(work: LoopState) -> int:
    """Send the total forces of the boundary particles; return MPI's error code, 0 for success."""
    buffers = work.buffers
    lap_start = add_lap(work.seconds, NOTHING, 0.0, buffers)
    halo.pack_forces(work.particles, halo.current_buffer(buffers), buffers)
    error = halo.send_buffer(buffers)
    add_lap(work.seconds, EXCHANGE, lap_start, buffers)
    return error


@routine(whole, whole, real, real, real, LoopState)
def receive_forces(buffer: int, turned: int, dt_v: float, zeta: float, dt: float, work: LoopState) -> int:
    """Wait for the total forces of the halo particles, and step these; return MPI's error code.

    buffer : place of the buffer, from `halo.current_buffer` before the step; turned : as in `step_particles`
    """
    particles, buffers, n_owned = work.particles, work.buffers, work.chunks.n_owned
    lap_start = add_lap(work.seconds, NOTHING, 0.0, buffers)
    error = halo.wait_for_neighbours(buffers)
    lap_start = add_lap(work.seconds, EXCHANGE, lap_start, buffers)
    if error != 0:
        return error
    x, y = both_positions(turned, work)
    halo.unpack_forces(n_owned, particles, buffer, buffers)
    advance_halo(n_owned, n_owned + work.chunks.n_halo, work.traits, dt_v, zeta, dt, x, y, particles)
    add_lap(work.seconds, INTEGRATION, lap_start, buffers)
    return 0


@part_of_kernel
def both_positions(turned: int, work: LoopState) -> tuple[FloatArray, FloatArray]:
    """Return the arrays of x(n) and x(n+1); turned : as in `step_particles`."""
    x, y = work.particles.x, work.y
    if turned:
        x, y = y, x
    return x, y


@copied_kernel
def sum_chunk_forces(
    elastic: bool, general: bool, density_of: Callable[..., Any], c: int, turned: int, work: LoopState
) -> int:
    """Call `forces.add_forces` for the particles of chunk c."""
    chunks, x, slots, law = work.chunks, both_positions(turned, work)[0], work.slots, work.law
    low, high, width, in_line = chunks.low[c], chunks.high[c], chunks.width[c], chunks.in_line
    scratch = work.scratch
    return int(
        forces.add_forces(low, high, width, in_line, elastic, general, density_of, x, slots, law, scratch)
    )


@routine(whole, whole, LoopState)
def elastic_forces(c: int, turned: int, work: LoopState) -> int:
    """Sum the forces of chunk c without yield; return whether an element is near a limit."""
    return sum_chunk_forces(True, False, forces.elastic_density_of, c, turned, work)


@routine(whole, whole, LoopState)
def yielding_forces(c: int, turned: int, work: LoopState) -> int:
    """Sum the forces of the cables of chunk c, which may yield; return whether one is near fracture."""
    return sum_chunk_forces(False, False, forces.yielding_density_of, c, turned, work)


@routine(whole, whole, LoopState)
def general_forces(c: int, turned: int, work: LoopState) -> int:
    """Sum the forces of cables and bars of chunk c that may yield or buckle, for any strain measure."""
    return sum_chunk_forces(False, True, forces.general_density_of, c, turned, work)


@part_of_kernel
def chunk_forces(c: int, turned: int, work: LoopState) -> int:
    """Sum the element forces on the particles of chunk c; return whether an element is near a limit."""
    chunks, law, elastic = work.chunks, work.law, work.elastic_forces != 0
    if elastic and not chunks.has_yielded[c]:
        at_limit = call(work.elastic_forces, (c, turned, work))
        if not (at_limit and forces.needs_inelastic_pass(work.slots, law)):
            return at_limit
    chunks.has_yielded[c] = 1 if elastic else law.plastic
    return call(work.inelastic_forces, (c, turned, work))


@routine(whole, whole, whole, real, real, real, real, LoopState)
def move_plain(
    c: int, keeps: int, turned: int, dt_v: float, zeta: float, share: float, dt: float, work: LoopState
) -> int:
    """Update velocities and positions of chunk c under only element forces, loads and wind.

    keeps : whether the total forces [N] are written to particles.f
    """
    low, high, (x, y) = work.chunks.low[c], work.chunks.high[c], both_positions(turned, work)
    remainder, times = (high - low) % LANES, (dt_v, zeta, share, dt)
    common = keeps != 0, work.traits, times, x, y, work.particles, work.scratch
    for p in range(low, high - remainder, LANES):
        move_vector(p, high, True, p - low, *common)
    if remainder:
        move_vector(high - remainder, high, False, high - remainder - low, *common)
    return 0


@routine(whole, whole, whole, real, real, real, real, LoopState)
def move_any(
    c: int, keeps: int, turned: int, dt_v: float, zeta: float, share: float, dt: float, work: LoopState
) -> int:
    """Compute `move_plain` for any forces and supports."""
    particles, scratch, traits = work.particles, work.scratch, work.traits
    low, high, (x, y) = work.chunks.low[c], work.chunks.high[c], both_positions(turned, work)
    total_forces(low, high, 1, dt_v, zeta, share, traits, x, particles, scratch)
    if keeps:
        store_totals(low, high, particles, scratch)
    update_velocities(low, high, traits, dt_v, zeta, dt, x, y, particles, scratch)
    return 0


@inner_kernel
def step_particles(
    n: int, turned: int, dt_v: float, zeta: float, share: float, dt: float, work: LoopState
) -> int:
    """Step the owned particles and send the boundary forces; return the number of breaking elements.

    A negative result is minus MPI's error code.
    turned : whether x(n) is in the second array, and x(n+1) goes to the first
    """
    chunks, seconds, x = work.chunks, work.seconds, both_positions(turned, work)[0]
    count: Any = np.int64(0)
    lap_start = add_lap(seconds, NOTHING, 0.0, work.buffers)
    for c in range(chunks.low.shape[0]):
        if chunks.high[c] == chunks.low[c]:
            continue
        at_limit = chunk_forces(c, turned, work)
        for i in range(chunks.first_support[c], chunks.first_support[c + 1]):
            column = work.rows.supports[i] - chunks.low[c]
            record_new_extreme(i, column, turned, n * dt, share, work.scratch.f, work.rows)
        keeps_forces = int(at_limit != 0 or c < chunks.boundary)
        call(work.move_chunk, (c, keeps_forces, turned, dt_v, zeta, share, dt, work))
        if at_limit != 0:
            count = check_limits(c, count, x, work)
        if c == chunks.boundary - 1:
            add_lap(seconds, FORCES, lap_start, work.buffers)
            error = call(work.send_forces, (work,))
            if error != 0:
                return -error
            lap_start = add_lap(seconds, NOTHING, 0.0, work.buffers)
    add_lap(seconds, FORCES, lap_start, work.buffers)
    return count


@routine(whole, whole, whole, real, whole, LoopState)
def break_pending(count: Any, in_second: Any, number: Any, dt: Any, stride: Any, work: Any) -> Any:
    """Break `count` of elements.pending in a step. in_second : whether x(n+1) is in the second array"""
    when, x = FractureStep(number * dt, number * stride, dt), both_positions(in_second, work)[0]
    meet()
    if leads():
        break_elements(count, when, x, work.chunks, work.elements, work.slots, work.law, work.fractures)
    meet()
    return 0


@inner_kernel
def advance_step(
    n: int,
    in_second: int,
    before_dt: float,
    dt: float,
    zeta: float,
    share: float,
    changed: int,
    work: LoopState,
) -> int:
    """Advance to x(n+1) in the array that x(n) is not in; return the number of breaking elements.

    First come the forces that all chunks share, of branches, air, bending and drag, and the velocities of
    slips. A negative result is minus MPI's error code.
    in_second : whether x(n) is in the second array
    before_dt, dt : [s] the steps before and after; share : position between two load samples, 0 to 1
    changed : whether the length of the velocity update, or a mass, differs from the step before
    """
    particles, law, dt_v = work.particles, work.law, 0.5 * (before_dt + dt)
    if is_present(law.branches):
        call(work.set_branch_factors, (before_dt, dt, law))
    if work.set_air_forces != 0:
        call(work.set_air_forces, (dt_v, zeta, share, changed, work.relative, particles))
    if is_present(work.bends.stiffness):
        call(work.bend_joints, (work.bends, particles))
    if is_present(work.slip_points.node):
        slip_arguments = n * dt, dt_v, share, work.slip_points, particles, work.elements, law
        call(work.update_slip_velocities, slip_arguments)
    buffer = halo.current_buffer(work.buffers)
    count = step_particles(n, in_second, dt_v, zeta, share, dt, work)
    if count >= 0 and work.receive_forces != 0:
        error = call(work.receive_forces, (buffer, in_second, dt_v, zeta, dt, work))
        if error != 0:
            return -error
    if count >= 0 and is_present(work.slip_points.moving):
        lap_start = add_lap(work.seconds, NOTHING, 0.0, work.buffers)
        call(work.shift_slips, (dt, work))
        add_lap(work.seconds, INTEGRATION, lap_start, work.buffers)
    return count


@kernel
def time_loop(interval: Interval, work: LoopState) -> tuple[int, int, int]:
    """Run the steps of an interval; return steps done, elements still to break, and MPI's error code.

    In a trial the second result is a step count instead. It includes the step at whose start an element first
    exceeds its fracture strain. It is steps + 1 if that happens at the end of the last step, and 0 if none
    does.
    """
    first, steps, before_dt, dt, zeta, sample_time, sample_dt, stride, trial, pending, only_row = interval
    needs_first = is_present(work.bends.stiffness) or is_present(work.slip_points.node)
    in_second = False  # whether x(n) is in the second array
    result, last_dt_v = 0, -1.0  # s, length of the last velocity update; -1: none, or masses changed since
    if pending > 0:
        call(work.break_pending, (pending, 0, first - 1, dt, stride, work))
    for s in range(max(steps, int(only_row))):
        n = first + s
        due = only_row or is_due(n * stride, work.rows)
        if due or needs_first:
            in_second = return_positions(in_second, work)
        if is_present(work.ground.start):
            call(work.move_supports, (n * dt, before_dt, (n + 1) * dt, zeta, work.ground, work.particles))
        if due:
            lap_start = add_lap(work.seconds, NOTHING, 0.0, work.buffers)
            call(work.collect_slots, (work,))
            call(work.make_row, (n * stride, before_dt, dt, zeta, sample_time, sample_dt, work.rows))
            add_lap(work.seconds, ROWS, lap_start, work.buffers)
        if only_row:
            break
        # computed from the step number alone, so that restarts give the same bits
        share, dt_v = (n * dt - sample_time) / sample_dt, 0.5 * (before_dt + dt)
        changed = int(dt_v != last_dt_v)
        count = advance_step(n, int(in_second), before_dt, dt, zeta, share, changed, work)
        if count < 0:
            return s, 0, -count
        before_dt, last_dt_v, in_second = dt, dt_v, not in_second
        if count > 0 and trial:
            result = s + 1 if result == 0 else result
        elif count > 0:
            if not has_room(count, work.spare):
                return_positions(in_second, work)
                return s + 1, count, 0
            call(work.break_pending, (count, int(in_second), n, dt, stride, work))
            last_dt_v = -1.0  # masses have changed
    return_positions(in_second, work)
    exceeds = trial and result == 0 and work.breaks != 0
    if exceeds and any_exceeds_fracture_strain(work.particles.x, work.elements, work.law):
        result = steps + 1
    return steps, result, 0
