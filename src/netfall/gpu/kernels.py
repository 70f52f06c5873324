"""The steps of an interval on a GPU, by the kernels of `netfall.explicit` (see `gpu.target`).

A net has all threads, or the threads of one block if several nets advance simultaneously. Of T threads, each
advances every T-th particle. All threads of a net meet at a barrier in each step, because the forces of step
n + 1 need the positions of all particles. If elements break, one thread breaks them in the order of their
numbers, as on the CPU. History rows are in `gpu.rows`.

This module is not executed directly: `gpu.target` translates it, and replaces `cuda` by `numba.cuda` and
`meet` by the barrier.
"""

from typing import Any, NamedTuple

import numpy as np

from netfall.core.records import is_present
from netfall.core.vectors import load, store
from netfall.explicit.forces import Scratch, add_forces, general_density_of
from netfall.explicit.fracture import break_elements, breaks_at, exceeds_strain_at
from netfall.explicit.incidence import collect_element
from netfall.explicit.loop import has_room
from netfall.explicit.motion import store_totals, total_forces, update_velocities
from netfall.explicit.sampling import is_due
from netfall.gpu.rows import make_row
from netfall.gpu.target import tuple_of
from netfall.physics.air import set_air_damping_at, set_drag_at
from netfall.physics.events import FractureStep
from netfall.physics.fracture import Fractures, remove_broken_element, split_particles

# defined by the translation
cuda: Any = None
meet: Any = None  # barrier of the threads of a net
IN_BLOCKS = False  # whether a net has the threads of one block; otherwise one net has all threads
work_at: Any = None  # returns the `Work` of a net
atomic_add: Any = None  # (array, index, value): adds; returns the former value
ScratchOfThread: Any = tuple_of(Scratch.kind)
split: Any = split_particles
remove: Any = remove_broken_element
FracturesOfThread: Any = tuple_of(Fractures.kind)


class Work(NamedTuple):
    """Numbers, arrays and records of `explicit.loop.LoopState` of one net, as named tuples.

    width : largest number of elements at a particle
    counts : (3,) numbers of elements that break in this step, the last, and the next
    best, which : (3,) largest values of a history row, and their positions
    saved : arrays that a trial changes, before the trial, see `copy_changes`
    """

    traits: int
    breaks: int
    width: int
    y: Any
    particles: Any
    elements: Any
    slots: Any
    law: Any
    chunks: Any
    spare: Any
    rules: Any
    events: Any
    relative: Any
    rows: Any
    counts: Any
    best: Any
    which: Any
    saved: Any


# Columns of an order: the task of a net in a launch, and then the work done.
# PLACE : of the net among nets on the device; REVERTS : to the start of the last trial, before the steps
# MADE, TABLE_ROWS, EVENTS : counters of `Rows` and `Events`, in and out; FIRST to TRIAL : of an `Interval`
# DONE, PENDING : out, what `time_loop` returns first and second
PLACE, REVERTS, MADE, TABLE_ROWS, EVENTS, FIRST, STEPS, STRIDE, TRIAL, DONE, PENDING = range(11)


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
    count : (1,) number of listed elements; work : `Work`
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


def advance(orders: Any, lengths: Any, reals: Any, wholes: Any, arrays: Any) -> None:
    """Compute `explicit.loop.time_loop` for an interval of each net, or of the single net.

    orders : (nets, PENDING + 1); lengths : (nets, 5) before_dt to sample_dt of an `Interval`
    reals, wholes : (nets, k), arrays : (nets, ...), of all nets on the device, arguments of `work_at`

    `work_at` is called in each phase of a step. Otherwise a thread would keep the addresses of all arrays of
    its net in registers, or in spilled memory, throughout.
    """
    thread, threads, net = cuda.grid(1), cuda.gridsize(1), 0
    if IN_BLOCKS:
        thread, threads, net = cuda.threadIdx.x, cuda.blockDim.x, cuda.blockIdx.x
    order = orders[net]
    first, steps, stride, trial = order[FIRST], order[STEPS], order[STRIDE], order[TRIAL] != 0
    before_dt, dt, zeta = lengths[net, 0], lengths[net, 1], lengths[net, 2]
    sample_time, sample_dt = lengths[net, 3], lengths[net, 4]
    scratch = ScratchOfThread(
        cuda.local.array((3, 1), np.float64),
        cuda.local.array((1, 1), np.float64)[:, :0],
        cuda.local.array((1,), np.float64),
        cuda.local.array((3, 1), np.float64),
        cuda.local.array((3, 1), np.float64),
        cuda.local.array((1,), np.float64),
    )
    in_second = False  # whether x(n) is in the second array
    last_dt_v, done = -1.0, steps
    begin(thread, threads, order, work_at(order[PLACE], reals, wholes, arrays))
    for s in range(steps):
        n = first + s
        share, dt_v = (n * dt - sample_time) / sample_dt, 0.5 * (before_dt + dt)
        moment = dt_v, share, dt, zeta
        work = work_at(order[PLACE], reals, wholes, arrays)
        if is_due(n * stride, work.rows):
            if in_second:
                copy(thread, threads, False, work.particles.x, work.y)
                in_second = False
            collect_slots(thread, threads, work)
            # as in `sampling.make_row`; n * dt may be rounded differently
            of_row = dt_v, (n * stride * work.rows.dt - sample_time) / sample_dt, dt, zeta
            set_air_forces(thread, threads, of_row, True, work)
            make_row(thread, threads, n * stride, before_dt, of_row, work, scratch)
            meet()
        work = work_at(order[PLACE], reals, wholes, arrays)
        set_air_forces(thread, threads, moment, dt_v != last_dt_v, work)
        step_particles(thread, threads, s, in_second, moment, work, scratch)
        before_dt, last_dt_v, in_second = dt, dt_v, not in_second
        breaking = work.counts[s % 3]
        if breaking == 0:
            continue
        if trial:
            if thread == 0 and order[PENDING] == 0:
                order[PENDING] = s + 1
            continue
        work = work_at(order[PLACE], reals, wholes, arrays)
        fits = has_room(breaking, work.spare)
        meet()
        if not fits:
            if thread == 0:
                order[PENDING] = breaking
            done = s + 1
            break
        if thread == 0:
            break_listed(breaking, FractureStep(n * dt, n * stride, dt), in_second, work)
        last_dt_v = -1.0  # masses have changed
        meet()
    end(thread, threads, order, in_second, done, work_at(order[PLACE], reals, wholes, arrays))


def begin(thread: Any, threads: Any, order: Any, work: Any) -> None:
    """Set the counters, and revert or save the arrays that a trial changes."""
    if thread == 0:
        work.rows.made[0], work.rows.made[1] = order[MADE], order[TABLE_ROWS]
        work.events.count[0], work.counts[0] = order[EVENTS], 0
    if order[REVERTS] != 0:
        copy_changes(thread, threads, True, work)
        meet()
    if order[TRIAL] != 0:
        copy_changes(thread, threads, False, work)
    meet()


def step_particles(
    thread: Any, threads: Any, s: Any, in_second: Any, moment: Any, work: Any, scratch: Any
) -> None:
    """Advance all particles. s : number of the step in this launch; in_second : whether x(n) is in `work.y`

    Three counters alternate: that of the next step is set to 0 when no thread reads it any more.
    """
    x, new_x = (work.y, work.particles.x) if in_second else (work.particles.x, work.y)
    first_split = work.chunks.n_owned + work.chunks.n_halo
    if thread == 0:
        work.counts[(s + 1) % 3] = 0
    count = work.counts[s % 3 :]
    for p in range(thread, work.chunks.n_owned, threads):
        step_particle(p, work.width, moment, count, x, new_x, work, scratch)
    for p in range(first_split + thread, work.spare.rows[0], threads):
        step_particle(p, 1, moment, count, x, new_x, work, scratch)
    meet()


def break_listed(count: Any, when: Any, in_second: Any, work: Any) -> None:
    """Break the `count` listed elements, with one thread. in_second : whether x(n+1) is in `work.y`"""
    fractures: Any = FracturesOfThread(work.rules, work.particles, work.spare.rows, work.events, 0)
    x = work.y if in_second else work.particles.x
    break_elements(count, when, x, work.chunks, work.elements, work.slots, work.law, fractures)


def end(thread: Any, threads: Any, order: Any, in_second: Any, done: Any, work: Any) -> None:
    """Copy the positions back to the first array, check the end of a trial, and write the work done."""
    if in_second:
        copy(thread, threads, False, work.particles.x, work.y)
    meet()
    if order[TRIAL] != 0 and work.breaks:
        for e in range(thread, work.elements.ends.shape[0], threads):
            exceeds = exceeds_strain_at(e, work.particles.x, work.elements, work.law)
            if exceeds and order[PENDING] == 0:
                order[PENDING] = order[STEPS] + 1
    if thread == 0:
        order[MADE], order[TABLE_ROWS] = work.rows.made[0], work.rows.made[1]
        order[EVENTS], order[DONE] = work.events.count[0], done


def copy(thread: Any, threads: Any, back: Any, to: Any, source: Any) -> None:
    """Copy an array (n,) or (k, n), or back, with all threads."""
    if not is_present(source):
        return
    for k in range(source.size // source.shape[-1]):
        for p in range(thread, source.shape[-1], threads):
            if back:
                store(source, k, p, load(to, k, p))
            else:
                store(to, k, p, load(source, k, p))


def copy_changes(thread: Any, threads: Any, back: Any, work: Any) -> None:
    """Copy the arrays that a trial changes to `Work.saved`, or back."""
    particles, elements, slots, rows = work.particles, work.elements, work.slots, work.rows
    saved = work.saved
    copy(thread, threads, back, saved[0], particles.x)
    copy(thread, threads, back, saved[1], particles.v)
    copy(thread, threads, back, saved[2], particles.work)
    copy(thread, threads, back, saved[3], particles.other_work)
    copy(thread, threads, back, saved[4], elements.highest)
    copy(thread, threads, back, saved[5], elements.lowest)
    copy(thread, threads, back, saved[6], elements.eps_p)
    copy(thread, threads, back, saved[7], elements.dissipated)
    copy(thread, threads, back, saved[8], slots.eps_p)
    copy(thread, threads, back, saved[9], slots.highest)
    copy(thread, threads, back, saved[10], slots.lowest)
    copy(thread, threads, back, saved[11], rows.last)
    copy(thread, threads, back, saved[12], rows.tension)
    copy(thread, threads, back, saved[13], rows.displacement)
    copy(thread, threads, back, saved[14], rows.reaction)
