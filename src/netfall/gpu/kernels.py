"""The steps of an interval on a GPU: the time loop of `netfall.explicit`, of which threads share each loop.

A net has all threads, or the threads of one block if several nets advance simultaneously. Of T threads, each
takes every T-th particle or element. All threads of a net meet at a barrier in each step, because the forces
of step n + 1 need the positions of all particles. If elements break, one thread breaks them in the order of
their numbers, as on the CPU. Sums in history rows have the same bits in any order (`parallel.sums`).

This module is not executed directly: `gpu.target` translates it and the loop. Functions in FUNCTIONS replace
those of the CPU that have the same name.
"""

from collections import namedtuple
from typing import Any

import numpy as np

from netfall.core.vectors import number_of
from netfall.explicit import energy_check, sampling
from netfall.explicit.forces import Scratch, add_forces, general_density_of
from netfall.explicit.fracture import breaks_at
from netfall.explicit.loop import Interval, both_positions, time_loop
from netfall.explicit.motion import store_totals, total_forces, update_velocities
from netfall.explicit.sampling import record_new_extreme
from netfall.parallel.sums import pieces_of
from netfall.physics import air
from netfall.physics.fields import EMPTY
from netfall.physics.fracture import remove_broken_element, split_particles

# defined by the translation
thread: Any = None  # returns the number of this thread of the net
threads: Any = None  # returns the number of threads of the net
meet: Any = None  # barrier of the threads of a net
set_air_forces: Any = None
net_number: Any = None  # returns the number of the net of this thread
net_at: Any = None  # returns the `NetMemory` at an address
cuda: Any = None  # `numba.cuda`
ScratchOfThread = namedtuple("ScratchOfThread", list(Scratch.kind.fields))  # type: ignore[misc]
split: Any = split_particles
remove: Any = remove_broken_element

# Columns of an order: the task of a net in a launch, and then the work done.
# FIRST to ROW : of an `Interval`; BEGIN : of the inputs of the net
# MADE, TABLE_ROWS, EVENT_COUNT : out, counters of `Rows` and `Events`
# DONE, PENDING : out, what `time_loop` returns first and second
# LENGTHS : and after, the bits of before_dt to sample_dt of an `Interval`
FIRST, STEPS, STRIDE, TRIAL, ROW, BEGIN, MADE, TABLE_ROWS, EVENT_COUNT, DONE, PENDING, LENGTHS = range(12)
COLUMNS = LENGTHS + 5
NO_NUMBER = 1 << 62  # larger than any number of an element or a particle


def each(first: Any, last: Any, step: Any = 1) -> Any:
    """Return the turns of a loop that this thread takes."""
    return range(np.int64(first) + thread() * step, np.int64(last), threads() * step)


def leads() -> Any:
    """Return whether this is the first thread of the net."""
    return thread() == 0


def total(count: Any, cells: Any) -> Any:
    """Compute `core.threads.total`."""
    meet()
    if leads():
        cells[0] = 0
    meet()
    cuda.atomic.add(cells, 0, count)
    meet()
    return cells[0]


def agree(size: Any, number: Any, cells: Any) -> Any:
    """Compute `core.threads.agree`."""
    meet()
    if leads():
        cells[0], cells[1] = size, NO_NUMBER
    meet()
    cuda.atomic.max(cells, 0, size)
    meet()
    if cells[0] == size:
        cuda.atomic.min(cells, 1, number)
    meet()
    return cells[0], cells[1]


def add_exactly(values: Any, mask: Any, limbs: Any) -> None:
    """Compute `parallel.sums.add_exactly`."""
    for i in each(0, values.shape[0]):
        if mask.shape[0] == 0 or mask[i] != 0:
            k, low, middle, high = pieces_of(values[i])
            cuda.atomic.add(limbs, k, low)
            cuda.atomic.add(limbs, k + 1, middle)
            cuda.atomic.add(limbs, k + 2, high)


def sum_axial_forces(x: Any, observed: Any, observation: Any) -> None:
    """Compute f_int from the axial forces at x (n, 3) [m].

    The slots of a particle have the order of element numbers, in which the CPU adds the forces.
    """
    slots, now, f_int = observed.slots, observation.now, observation.f_int
    for p in each(0, x.shape[0]):
        f_int[0, p], f_int[1, p], f_int[2, p] = 0.0, 0.0, 0.0
        for s in range(slots.element.shape[0]):
            if slots.element[s, p] != EMPTY:
                e, far = int(slots.element[s, p]), int(slots.other[s, p])
                q = now.N[e] / now.L[e] if now.L[e] > 0.0 else 0.0
                for k in range(3):
                    f_int[k, p] += q * (x[far, k] - x[p, k])


def break_element(e: Any, time: Any, step: Any, dt: Any, elements: Any, law: Any, fractures: Any) -> Any:
    """Break an element with or without fragments; replaces `Fractures.break_element`."""
    if fractures.rules.stable_dt > 0.0:
        return split(e, time, step, dt, elements, law, fractures)
    return remove(e, time, step, dt, elements, law, fractures)


def step_particle(
    p: Any, width: Any, moment: Any, count: Any, in_second: Any, work: Any, scratch: Any
) -> None:
    """Advance particle p from x to y, and list its elements that reach their fracture strain.

    width : largest number of its elements
    moment : time [s], dt_v [s], share, dt [s], zeta [1/s] of the step
    count : (1,) number of listed elements
    """
    time, dt_v, share, dt, zeta = moment
    particles, slots, law, rows = work.particles, work.slots, work.law, work.rows
    x, y = both_positions(in_second, work)
    at_limit = add_forces(
        p, p + 1, width, work.chunks.in_line, False, True, general_density_of, x, slots, law, scratch
    )
    if p < rows.support_at.shape[0] and rows.support_at[p] >= 0:
        record_new_extreme(rows.support_at[p], 0, in_second, time, share, scratch.f, rows)
    total_forces(p, p + 1, 1, dt_v, zeta, share, work.traits, x, particles, scratch)
    if at_limit:
        store_totals(p, p + 1, particles, scratch)
    update_velocities(p, p + 1, work.traits, dt_v, zeta, dt, x, y, particles, scratch)
    if at_limit:
        n_owned, elements = work.chunks.n_owned, work.elements
        for s in range(width):
            if breaks_at(s, p, x, n_owned, n_owned + work.chunks.n_halo, elements, slots, law):
                k = cuda.atomic.add(count, 0, 1)
                elements.pending[k] = slots.element[s, p]


def advance_step(
    n: Any, in_second: Any, before_dt: Any, dt: Any, zeta: Any, share: Any, changed: Any, work: Any
) -> Any:
    """Compute `explicit.loop.advance_step`.

    Three counters alternate: that of the next step is set to 0 when no thread reads it any more.
    """
    dt_v, chunks, scratch = 0.5 * (before_dt + dt), work.chunks, work.scratch
    if work.set_air_forces != 0:
        set_air_forces(dt_v, zeta, share, changed, work.relative, work.particles)
    moment, count = (n * dt, dt_v, share, dt, zeta), work.counts[n % 3 :]
    if leads():
        work.counts[(n + 1) % 3] = 0
    for p in each(0, chunks.n_owned):
        step_particle(p, chunks.width[p // chunks.size], moment, count, in_second, work, scratch)
    for p in each(chunks.n_owned + chunks.n_halo, work.spare.rows[0]):
        step_particle(p, 1, moment, count, in_second, work, scratch)
    meet()
    return count[0]


FUNCTIONS: tuple[Any, ...] = (
    *(each, leads, total, agree, add_exactly, sum_axial_forces, break_element),
    *(air.set_air_forces, energy_check.add_rare_forces, energy_check.add_rare_energies, energy_check.observe),
    *(sampling.make_row, advance_step),
)
# of features that no GPU steps, and of the measurement of times
ABSENT = ("set_branches", "add_branches", "add_bending_forces", "add_slip_energies", "update_moments")
ABSENT += ("move_supports", "add_lap")


def advance(orders: Any, inputs: Any, addresses: Any) -> None:
    """Run `explicit.loop.time_loop` for an interval of each net, or of the single net.

    orders : (nets, COLUMNS)
    inputs : words of the arrays that the host has changed; addresses : (nets,) of a `NetMemory` each
    """
    net = net_number()
    order, memory = orders[net], net_at(addresses[net])
    work, first, trial = memory.work, order[FIRST], order[TRIAL] != 0
    for k in each(0, memory.inputs.shape[0]):
        memory.inputs[k] = inputs[order[BEGIN] + k]
    if trial and work.breaks:
        for k in each(0, memory.rest.shape[0]):
            memory.saved[k] = memory.rest[k]
    if leads():
        work.counts[first % 3] = 0
    meet()
    before_dt, dt, zeta = (
        number_of(order[LENGTHS]),
        number_of(order[LENGTHS + 1]),
        number_of(order[LENGTHS + 2]),
    )
    sample_time, sample_dt = number_of(order[LENGTHS + 3]), number_of(order[LENGTHS + 4])
    lengths = before_dt, dt, zeta, sample_time, sample_dt
    interval = Interval(first, order[STEPS], *lengths, order[STRIDE], trial, 0, order[ROW] != 0)
    done, pending, _ = time_loop(interval, work)
    if pending != 0:  # at the end of a trial, some threads have found it
        order[PENDING] = pending
    if leads():
        order[MADE], order[TABLE_ROWS] = work.rows.made[0], work.rows.made[1]
        order[EVENT_COUNT], order[DONE] = work.spare.events[0], done
