"""The steps of an interval on a GPU, by the kernels of `netfall.explicit` (see `gpu.target`).

A thread steps every T-th particle, with T threads in all. All of them meet at a barrier in each step: the
forces of step n + 1 need the positions of all particles. If elements break, one thread breaks them in the
order of their numbers, as on the CPU.

This module is not run as it stands: `gpu.target` translates it, and puts `numba.cuda` in place of `cuda`.
"""

from typing import Any, NamedTuple

import numpy as np

from netfall.core.records import is_present
from netfall.explicit.forces import Scratch, add_forces, general_density_of
from netfall.explicit.fracture import break_elements, breaks_at, exceeds_strain_at
from netfall.explicit.loop import has_room
from netfall.explicit.motion import store_totals, total_forces, update_velocities
from netfall.gpu.target import tuple_of
from netfall.physics.air import set_air_damping_at, set_drag_at
from netfall.physics.events import FractureStep
from netfall.physics.fracture import Fractures, remove_broken_element, split_particles

# defined by the translation: `numba.cuda`, and add(array, index, value), which returns the former value
cuda: Any = None
atomic_add: Any = None
ScratchOfThread: Any = tuple_of(Scratch.kind)
split: Any = split_particles
remove: Any = remove_broken_element
FracturesOfThread: Any = tuple_of(Fractures.kind)
DONE, PENDING = 0, 1  # places in `Work.result`


class Work(NamedTuple):
    """Arguments of `advance`: numbers and records of `explicit.loop.LoopState`, as named tuples.

    width : largest number of elements at a particle of the net; absent : an array (0, 0)
    counts : (2,) zeros; numbers of elements that break in steps of even and of odd place
    result : (2,) zeros; out, at DONE and PENDING what `time_loop` returns first and second
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
    absent: Any
    counts: Any
    result: Any


def break_element(address: Any, arguments: Any) -> Any:
    """Break an element with or without fragments, in place of a call of `Fractures.break_element`."""
    e, time, step, dt, elements, law, fractures = arguments
    if fractures.rules.stable_dt > 0.0:
        return split(e, time, step, dt, elements, law, fractures)
    return remove(e, time, step, dt, elements, law, fractures)


def step_particle(
    p: Any, width: Any, moment: Any, count: Any, x: Any, y: Any, work: Any, scratch: Any
) -> None:
    """Step particle p from x to y, and list its elements that reach their fracture strain.

    width : largest number of its elements; moment : kick_dt [s], share, dt [s], zeta [1/s] of the step
    count : (1,) number of listed elements; work : `Work`
    """
    kick_dt, share, dt, zeta = moment
    particles, slots, law = work.particles, work.slots, work.law
    at_limit = add_forces(p, p + 1, width, True, False, True, general_density_of, x, slots, law, scratch)
    total_forces(p, p + 1, True, kick_dt, zeta, share, work.traits, x, particles, scratch)
    if at_limit:
        store_totals(p, p + 1, particles, scratch)
    update_velocities(p, p + 1, work.traits, kick_dt, zeta, dt, x, y, particles, scratch)
    if at_limit:
        n_owned, elements = work.chunks.n_owned, work.elements
        for s in range(width):
            if breaks_at(s, p, x, n_owned, n_owned + work.chunks.n_halo, elements, slots, law):
                k = atomic_add(count, 0, 1)
                elements.pending[k] = slots.element[s, p]


def set_air_forces(thread: Any, threads: Any, moment: Any, changed: Any, work: Any) -> None:
    """Compute `physics.air.set_air_forces` with all threads; moment : as in `step_particle`"""
    kick_dt, share, _, zeta = moment
    particles, relative = work.particles, work.relative
    if is_present(particles.air) and changed:
        for p in range(thread, particles.per_mass.shape[0], threads):
            set_air_damping_at(p, kick_dt, zeta, particles)
    if is_present(particles.drag):
        for i in range(thread, relative.rows.shape[0], threads):
            set_drag_at(i, kick_dt, share, relative, particles)


def advance(interval: Any, work: Any) -> None:
    """Compute `explicit.loop.time_loop` for an `Interval` without history rows."""
    grid, thread, threads = cuda.cg.this_grid(), cuda.grid(1), cuda.gridsize(1)
    first, steps, before_dt, dt, zeta, sample_time, sample_dt, stride, trial, _, _ = interval
    particles, elements, slots, law = work.particles, work.elements, work.slots, work.law
    chunks, spare, counts, result = work.chunks, work.spare, work.counts, work.result
    scratch = ScratchOfThread(
        cuda.local.array((3, 1), np.float64),
        work.absent,
        cuda.local.array((1,), np.float64),
        cuda.local.array((3, 1), np.float64),
        cuda.local.array((3, 1), np.float64),
        cuda.local.array((1,), np.float64),
    )
    fractures: Any = FracturesOfThread(work.rules, particles, spare.rows, work.events, 0)
    first_split = chunks.n_owned + chunks.n_halo
    in_second = False  # whether x(n) is in the second array
    kicked_dt, done = -1.0, steps
    for s in range(steps):
        n, place = first + s, s & 1
        x, new_x = (work.y, particles.x) if in_second else (particles.x, work.y)
        share, kick_dt = (n * dt - sample_time) / sample_dt, 0.5 * (before_dt + dt)
        moment = kick_dt, share, dt, zeta
        if is_present(particles.air) or is_present(particles.drag):
            set_air_forces(thread, threads, moment, kick_dt != kicked_dt, work)
            grid.sync()
        if thread == 0:
            counts[1 - place] = 0
        count = counts[place:]
        for p in range(thread, chunks.n_owned, threads):
            step_particle(p, work.width, moment, count, x, new_x, work, scratch)
        for p in range(first_split + thread, spare.rows[0], threads):
            step_particle(p, 1, moment, count, x, new_x, work, scratch)
        grid.sync()
        before_dt, kicked_dt, in_second = dt, kick_dt, not in_second
        breaking = count[0]
        if breaking == 0:
            continue
        if trial:
            if thread == 0 and result[PENDING] == 0:
                result[PENDING] = s + 1
            continue
        fits = has_room(breaking, spare)
        if in_second:
            copy_positions(thread, threads, spare.rows[0], particles.x, work.y)
            in_second = False
        grid.sync()
        if not fits:
            if thread == 0:
                result[PENDING] = breaking
            done = s + 1
            break
        if thread == 0:
            when = FractureStep(n * dt, n * stride, dt)
            break_elements(breaking, when, chunks, elements, slots, law, fractures)
        kicked_dt = -1.0  # masses have changed
        grid.sync()
    if in_second:
        copy_positions(thread, threads, spare.rows[0], particles.x, work.y)
    if trial and work.breaks:
        grid.sync()
        for e in range(thread, elements.ends.shape[0], threads):
            if exceeds_strain_at(e, particles.x, elements, law) and result[PENDING] == 0:
                result[PENDING] = steps + 1
    if thread == 0:
        result[DONE] = done


def copy_positions(thread: Any, threads: Any, rows: Any, to: Any, source: Any) -> None:
    """Copy positions (3, n) [m]."""
    for p in range(thread, rows, threads):
        for k in range(3):
            to[k, p] = source[k, p]
