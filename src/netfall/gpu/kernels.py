"""The steps of an interval on a GPU, by the kernels of `netfall.explicit` (see `gpu.target`).

A net has all threads, or the threads of one block if several nets advance simultaneously. Of T threads, each
advances every T-th particle. All threads of a net meet at a barrier in each step, because the forces of step
n + 1 need the positions of all particles. If elements break, one thread breaks them in the order of their
numbers, as on the CPU. History rows are in `gpu.rows`.

This module is not executed directly: `gpu.target` translates it, and replaces `cuda` by `numba.cuda` and
`meet` by the barrier.
"""

from collections import namedtuple
from typing import Any

import numpy as np

from netfall.core.records import is_present
from netfall.explicit.forces import Scratch, add_forces, general_density_of
from netfall.explicit.fracture import break_elements, breaks_at, exceeds_strain_at
from netfall.explicit.incidence import collect_element
from netfall.explicit.loop import has_room
from netfall.explicit.motion import store_totals, total_forces, update_velocities
from netfall.explicit.sampling import is_due
from netfall.gpu.rows import LARGEST, make_row
from netfall.physics.air import set_air_damping_at, set_drag_at
from netfall.physics.events import FractureStep
from netfall.physics.fracture import remove_broken_element, split_particles

# defined by the translation
cuda: Any = None
meet: Any = None  # barrier of the threads of a net
IN_BLOCKS = False  # whether a net has the threads of one block; otherwise one net has all threads
net_at: Any = None  # returns the `NetMemory` at an address
atomic_add: Any = None  # (array, index, value): adds; returns the former value
ScratchOfThread = namedtuple("ScratchOfThread", list(Scratch.kind.fields))  # type: ignore[misc]
split: Any = split_particles
remove: Any = remove_broken_element

# Columns of an order: the task of a net in a launch, and then the work done.
# FIRST to ROW : of an `Interval`; BEGIN : of the inputs of the net
# MADE, TABLE_ROWS, EVENT_COUNT : out, counters of `Rows` and `Events`
# DONE, PENDING : out, what `time_loop` returns first and second
# COUNTS : three numbers of elements that break in this step, the last, and the next
FIRST, STEPS, STRIDE, TRIAL, ROW, BEGIN, MADE, TABLE_ROWS, EVENT_COUNT, DONE, PENDING, COUNTS = range(12)
COLUMNS = 18  # with those from `rows.LARGEST` on


def break_element(e: Any, time: Any, step: Any, dt: Any, elements: Any, law: Any, fractures: Any) -> Any:
    """Break an element with or without fragments; replaces `Fractures.break_element`."""
    if fractures.rules.stable_dt > 0.0:
        return split(e, time, step, dt, elements, law, fractures)
    return remove(e, time, step, dt, elements, law, fractures)


def step_particle(
    p: Any, width: Any, moment: Any, count: Any, x: Any, y: Any, work: Any, scratch: Any
) -> None:
    """Advance particle p from x to y, and list its elements that reach their fracture strain.

    width : largest number of its elements; moment : dt_v [s], share, dt [s], zeta [1/s] of the step
    count : (1,) number of listed elements
    """
    dt_v, share, dt, zeta = moment
    particles, slots, law = work.particles, work.slots, work.law
    at_limit = add_forces(
        p, p + 1, width, work.chunks.in_line, False, True, general_density_of, x, slots, law, scratch
    )
    total_forces(p, p + 1, 1, dt_v, zeta, share, work.traits, x, particles, scratch)
    if at_limit:
        store_totals(p, p + 1, particles, scratch)
    update_velocities(p, p + 1, work.traits, dt_v, zeta, dt, x, y, particles, scratch)
    if at_limit:
        n_owned, elements = work.chunks.n_owned, work.elements
        for s in range(width):
            if breaks_at(s, p, x, n_owned, n_owned + work.chunks.n_halo, elements, slots, law):
                k = atomic_add(count, 0, 1)
                elements.pending[k] = slots.element[s, p]


def set_air_forces(thread: Any, threads: Any, moment: Any, changed: Any, work: Any) -> None:
    """Compute `physics.air.set_air_forces` with all threads; moment : as in `step_particle`"""
    dt_v, share, _, zeta = moment
    particles, relative = work.particles, work.relative
    if is_present(particles.air) and changed:
        for p in range(thread, particles.per_mass.shape[0], threads):
            set_air_damping_at(p, dt_v, zeta, particles)
    if is_present(particles.drag):
        for i in range(thread, relative.rows.shape[0], threads):
            set_drag_at(i, dt_v, share, relative, particles)
    if is_present(particles.air) or is_present(particles.drag):
        meet()


def collect_slots(thread: Any, threads: Any, work: Any) -> None:
    """Update the elements from the quantities that are only in their slots, with all threads."""
    n_owned, elements, slots = work.chunks.n_owned, work.elements, work.slots
    if is_present(slots.eps_p) or is_present(slots.highest):
        for e in range(thread, elements.ends.shape[0], threads):
            if elements.EA[e] != 0.0:
                collect_element(e, n_owned, n_owned + work.chunks.n_halo, elements, slots, work.law)
    meet()


def advance(orders: Any, lengths: Any, inputs: Any, addresses: Any) -> None:
    """Compute `explicit.loop.time_loop` for an interval of each net, or of the single net.

    orders : (nets, COLUMNS); lengths : (nets, 5) before_dt to sample_dt of an `Interval`
    inputs : words of the arrays that the host has changed; addresses : (nets,) of a `NetMemory` each
    """
    thread, threads, net = cuda.grid(1), cuda.gridsize(1), 0
    if IN_BLOCKS:
        thread, threads, net = cuda.threadIdx.x, cuda.blockDim.x, cuda.blockIdx.x
    order, memory = orders[net], net_at(addresses[net])
    work = memory.work
    first, steps, stride, trial = order[FIRST], order[STEPS], order[STRIDE], order[TRIAL] != 0
    only_row = order[ROW] != 0
    before_dt, dt, zeta = lengths[net, 0], lengths[net, 1], lengths[net, 2]
    sample_time, sample_dt = lengths[net, 3], lengths[net, 4]
    scratch = ScratchOfThread(  # type: ignore[call-arg]
        cuda.local.array((3, 1), np.float64),
        cuda.local.array((1, 1), np.float64)[:, :0],
        cuda.local.array((1,), np.float64),
        cuda.local.array((3, 1), np.float64),
        cuda.local.array((3, 1), np.float64),
        cuda.local.array((1,), np.float64),
    )
    begin(thread, threads, order, inputs, memory)
    in_second = False  # whether x(n) is in the second array
    last_dt_v, done = -1.0, steps
    for s in range(max(steps, order[ROW])):
        n = first + s
        share, dt_v = (n * dt - sample_time) / sample_dt, 0.5 * (before_dt + dt)
        moment = dt_v, share, dt, zeta
        if only_row or is_due(n * stride, work.rows):
            if in_second:
                return_positions(thread, threads, work)
                in_second = False
            collect_slots(thread, threads, work)
            # as in `sampling.make_row`; n * dt may be rounded differently
            of_row = dt_v, (n * stride * work.rows.dt - sample_time) / sample_dt, dt, zeta
            set_air_forces(thread, threads, of_row, True, work)
            make_row(thread, threads, n * stride, before_dt, of_row, order[LARGEST:], work, scratch)
            meet()
        if only_row:
            break
        set_air_forces(thread, threads, moment, dt_v != last_dt_v, work)
        step_particles(thread, threads, s, in_second, moment, order[COUNTS:], work, scratch)
        before_dt, last_dt_v, in_second = dt, dt_v, not in_second
        breaking = order[COUNTS + s % 3]
        if breaking == 0:
            continue
        if trial:
            if thread == 0 and order[PENDING] == 0:
                order[PENDING] = s + 1
            continue
        fits = has_room(breaking, work.spare)
        meet()
        if not fits:
            if thread == 0:
                order[PENDING] = breaking
            done = s + 1
            break
        if thread == 0:  # x(n+1) is in the second array if `in_second`
            x, when = work.y if in_second else work.particles.x, FractureStep(n * dt, n * stride, dt)
            break_elements(
                breaking, when, x, work.chunks, work.elements, work.slots, work.law, work.fractures
            )
        last_dt_v = -1.0  # masses have changed
        meet()
    if in_second:
        return_positions(thread, threads, work)
    meet()
    end(thread, threads, order, done, work)


def begin(thread: Any, threads: Any, order: Any, inputs: Any, memory: Any) -> None:
    """Copy the inputs of a net to its arrays, and before a trial what `GpuNet.revert` restores."""
    for k in range(thread, memory.inputs.shape[0], threads):
        memory.inputs[k] = inputs[order[BEGIN] + k]
    if order[TRIAL] != 0 and memory.work.breaks:
        for k in range(thread, memory.rest.shape[0], threads):
            memory.saved[k] = memory.rest[k]
    meet()


def step_particles(
    thread: Any, threads: Any, s: Any, in_second: Any, moment: Any, counts: Any, work: Any, scratch: Any
) -> None:
    """Advance all particles. s : number of the step in this launch; in_second : whether x(n) is in `work.y`

    Three counters alternate: that of the next step is set to 0 when no thread reads it any more.
    """
    x, new_x = (work.y, work.particles.x) if in_second else (work.particles.x, work.y)
    chunks = work.chunks
    if thread == 0:
        counts[(s + 1) % 3] = 0
    count = counts[s % 3 :]
    for p in range(thread, chunks.n_owned, threads):
        step_particle(p, chunks.width[p // chunks.size], moment, count, x, new_x, work, scratch)
    for p in range(chunks.n_owned + chunks.n_halo + thread, work.spare.rows[0], threads):
        step_particle(p, 1, moment, count, x, new_x, work, scratch)
    meet()


def return_positions(thread: Any, threads: Any, work: Any) -> None:
    """Copy the positions in the second array to the first."""
    for k in range(3):
        for p in range(thread, work.spare.rows[0], threads):
            work.particles.x[k, p] = work.y[k, p]


def end(thread: Any, threads: Any, order: Any, done: Any, work: Any) -> None:
    """Check the end of a trial, and write the work done."""
    if order[TRIAL] != 0 and work.breaks:
        for e in range(thread, work.elements.ends.shape[0], threads):
            exceeds = exceeds_strain_at(e, work.particles.x, work.elements, work.law)
            if exceeds and order[PENDING] == 0:
                order[PENDING] = order[STEPS] + 1
    if thread == 0:
        order[MADE], order[TABLE_ROWS] = work.rows.made[0], work.rows.made[1]
        order[EVENT_COUNT], order[DONE] = work.spare.events[0], done
