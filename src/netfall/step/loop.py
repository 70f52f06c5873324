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

It is compiled once for all scenes: all that depends on what a scene has is called by its address.
"""

from typing import NamedTuple

import numpy as np

from netfall.ground.apart import Entry, call
from netfall.ground.compile import inner_kernel, kernel, part_of_kernel, vector_kernel
from netfall.mechanics.events import StepDone
from netfall.parallel.halo import buffer_in_use, send_buffer, wait_for_neighbours
from netfall.parallel.mpi_symbols import lap
from netfall.step.limits import count_near
from netfall.step.rows import Rows, is_due, make_row

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


class Moved(NamedTuple):
    """Of the particles: x [m], v [m/s], total force f [N], three of (n,) each."""

    x: tuple
    v: tuple
    f: tuple


class Found(NamedTuple):
    """What forces leave for the loop: f, near of the chunk in hand, as of `plan.Scratch`, and what breaks.

    near : (0,) where all is elastic; count : (1,) elements that are to break in this step
    """

    f: tuple
    near: np.ndarray
    count: np.ndarray


class Spare(NamedTuple):
    """Room for what breaks. rows : (1,) of particles in use, of `most_rows`; events : the same of the log."""

    rows: np.ndarray
    most_rows: int
    events: np.ndarray
    most_events: int


class Beside(NamedTuple):
    """What the loop calls by its address: what a scene lacks is not there, and the call does nothing.

    kick_unyielded : `kick_chunk` without a look at plastic strains, where there are any
    The others, of `beside` and `limits`, as their kernels; rows : those that are made before the last step
    """

    kick_chunk: Entry
    kick_unyielded: Entry
    look_closer: Entry
    find_over: Entry
    break_elements: Entry
    pack: Entry
    unpack: Entry
    move_ground: Entry
    begin_step: Entry
    find_drag: Entry
    end_step: Entry
    collect: Entry
    rows: Rows


@inner_kernel
def step_done(interval, s):
    """Step number s of an interval."""
    number = interval.first + s
    return StepDone(number * interval.dt, number * interval.stride, interval.dt)


@inner_kernel
def has_room(count, spare):
    """Whether there is room for what `count` elements can leave: two particles and two events each."""
    enough = spare.rows[0] + 2 * count <= spare.most_rows
    return enough and spare.events[0] + 2 * count <= spare.most_events


@vector_kernel
def drift_rows(first, last, dt, x, v):
    """x [m] to n + 1 of particles first to last; x, v : three of (n,), v = 0 where held."""
    first, last = np.uint64(first), np.uint64(last)  # unsigned: no index then counts from the end
    for p in range(first, last):
        x[0][p] += dt * v[0][p]
        x[1][p] += dt * v[1][p]
        x[2][p] += dt * v[2][p]


@part_of_kernel
def kick(c, kick_dt, zeta, share, chunks, beside):
    """`kick_chunk`, without a look at plastic strains where the chunk has none."""
    if chunks.has_yielded[c] or chunks.is_split[c]:
        call(beside.kick_chunk, c, kick_dt, zeta, share)
    else:
        call(beside.kick_unyielded, c, kick_dt, zeta, share)


@vector_kernel
def keep_forces(low, high, f_chunk, f):
    """Total forces of a chunk, particles low to high, from its scratch to f. f_chunk, f : three of (n,)"""
    low, high = np.uint64(low), np.uint64(high)
    for p in range(low, high):
        f[0][p] = f_chunk[0][p - low]
        f[1][p] = f_chunk[1][p - low]
        f[2][p] = f_chunk[2][p - low]


@kernel
def time_loop(interval, chunks, moved, found, spare, beside, buffers, seconds):
    """The steps of an interval; steps done, elements that are still to break, MPI error.

    In a trial the second is the number of steps up to and with the one at whose begin the first element has
    passed its fracture strain, one more than there are where it is at the end of the last; 0 if none has.

    chunks : of `Plan`; moved : `Moved`; found : `Found`; spare : `Spare`; beside : `Beside`
    buffers : `HaloBuffers`
    seconds : (4,) [s], added to, time of FORCES, EXCHANGE, INTEGRATION, ROWS; None: not measured
    """
    before_dt, dt, zeta = interval.before_dt, interval.dt, interval.zeta
    tried, place, kicked_dt = 0, np.int64(0), -1.0  # kicked_dt: of the kick before, if nothing broke
    if interval.pending > 0:
        call(beside.break_elements, interval.pending, step_done(interval, -1))
    for s in range(max(interval.steps, int(interval.row))):
        kick_dt = 0.5 * (before_dt + dt)
        n = interval.first + s
        call(beside.move_ground, n * dt, before_dt, (n + 1) * dt, zeta)
        if is_due(n * interval.stride, beside.rows):
            mark = lap(seconds, -1, 0.0)
            call(beside.collect)
            sample = interval.sample_time, interval.sample_dt
            make_row(n * interval.stride, before_dt, dt, zeta, sample[0], sample[1], beside.rows)
            mark = lap(seconds, ROWS, mark)
        if interval.row:
            break
        # of the step's number alone, wherever the loop was entered
        share = (n * dt - interval.sample_time) / interval.sample_dt
        call(beside.begin_step, n * dt, before_dt, dt, kick_dt, zeta, share, kick_dt != kicked_dt)
        call(beside.find_drag, kick_dt, share)
        before_dt, kicked_dt, found.count[0] = dt, kick_dt, 0
        error, drifted = 0, chunks.front
        mark = lap(seconds, -1, 0.0)
        for c in range(chunks.low.shape[0]):
            low, high = chunks.low[c], chunks.high[c]
            kick(c, kick_dt, zeta, share, chunks, beside)
            if found.near.shape[0] > 0 and count_near(found.near, high - low) > 0:
                call(beside.look_closer, c)
            if c < chunks.own and not chunks.is_split[c]:  # sent; `look_closer` keeps those that count
                keep_forces(low, high, found.f, moved.f)
            mark = lap(seconds, FORCES, mark)
            if c == chunks.own - 1:
                place = buffer_in_use(buffers)
                call(beside.pack, place)
                error = send_buffer(buffers)
                if error != 0:
                    return s, 0, error
                mark = lap(seconds, EXCHANGE, mark)
            while drifted <= c and chunks.last_use[drifted] <= c:
                drift_rows(chunks.low[drifted], chunks.high[drifted], dt, moved.x, moved.v)
                drifted += 1
            mark = lap(seconds, INTEGRATION, mark)
        for c in range(chunks.front):  # any chunk may need them
            drift_rows(chunks.low[c], chunks.high[c], dt, moved.x, moved.v)
        mark = lap(seconds, INTEGRATION, mark)
        error = wait_for_neighbours(buffers)
        mark = lap(seconds, EXCHANGE, mark)
        if error != 0:
            return s, 0, error
        call(beside.unpack, place, kick_dt, dt, zeta)
        call(beside.end_step, dt)
        mark = lap(seconds, INTEGRATION, mark)
        count = found.count[0]
        if count > 0:
            if interval.trial:
                tried = s + 1 if tried == 0 else tried
            elif has_room(count, spare):
                call(beside.break_elements, count, step_done(interval, s))
                kicked_dt = -1.0  # masses have changed
            else:
                return s + 1, count, 0
    if interval.trial and tried == 0:
        found.count[0] = 0
        call(beside.find_over)
        tried = interval.steps + 1 if found.count[0] > 0 else 0
    return interval.steps, tried, 0
