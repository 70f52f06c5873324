"""The time loop: central difference in half-step velocities, compiled, the exchange included.

A step n takes x(n) and v(n-1/2). Particles go through it in chunks that stay in the cache:
    1. internal forces f_int(x(n)) of a chunk; where elements come near their limits, plastic flow and fracture strains
    2. external force, kick to v(n+1/2), work
    3. after the chunks with boundary particles, which come first: their total forces are sent
    4. drift to x(n+1) of the chunks whose x(n) no later chunk needs; at the end, of all
    5. the halo's total forces arrive; halo particles: the same kick and drift
    6. if elements reached their fracture strain, the loop returns; they part at x(n+1) (`fracture.py`)
"""

import numpy as np

from netfall.mechanics.compile import kernel, vector_kernel
from netfall.mechanics.arithmetic import like
from netfall.mechanics.kernels import (
    FEWEST,
    SLOTS,
    Runs,
    count_near,
    find_runs,
    flow,
    inverse_mass,
    kick,
    kick_factors,
    kick_rows,
)
from netfall.mechanics.state import STEPPED, State
from netfall.parallel.halo import Halo, lap, open_box, send_box, wait_for_boxes

FORCES, EXCHANGE, INTEGRATION = (
    0,
    1,
    2,
)  # what the time of a step goes into; the kick counts with the forces, whose loop it shares
CHUNK = 2048  # particles, 300 KB; fewer end the runs too often, more leave the second cache


@vector_kernel
def drift_rows(first, last, dt, x, x_rounded, v):
    """x to n + 1 of particles first to last; where held, v = 0. x, v : three of (n,); x_rounded : x in the precision of v, None: it is"""
    first, last = np.uint64(first), np.uint64(last)  # unsigned: no index then counts from the end
    dt = like(x[0], dt)
    for p in range(first, last):
        x[0][p] += dt * v[0][p]
        x[1][p] += dt * v[1][p]
        x[2][p] += dt * v[2][p]
        if x_rounded is not None:
            x_rounded[0][p], x_rounded[1][p], x_rounded[2][p] = x[0][p], x[1][p], x[2][p]


@vector_kernel
def keep_forces(low, high, f_chunk, f):
    """Total forces of a chunk, particles low to high, from its scratch to f. f_chunk, f : three of (n,)"""
    low, high = np.uint64(low), np.uint64(high)
    for p in range(low, high):
        f[0][p] = f_chunk[0][p - low]
        f[1][p] = f_chunk[1][p - low]
        f[2][p] = f_chunk[2][p - low]


@vector_kernel
def move_halo(first, last, kick_dt, dt, zeta, x, x_rounded, v, f, per_mass, free):
    """Kick and drift of halo particles, whose total force f the owner has sent."""
    first, last = np.uint64(first), np.uint64(last)
    c_v, c_a = kick_factors(zeta, kick_dt)
    c_v, c_a, dt = like(v, c_v), like(v, c_a), like(x, dt)
    for k in range(3):
        for p in range(first, last):
            new = kick(v[p, k], f[p, k] * per_mass[p], c_v, c_a)
            if free is not None:
                new = new if free[p, k] else v[p, k]
            v[p, k] = new
            x[p, k] += dt * new
            if x_rounded is not None:
                x_rounded[p, k] = x[p, k]


@kernel
def time_loop(
    first,
    steps,
    before_dt,
    dt,
    zeta,
    wind_time,
    wind_dt,
    n_owned,
    n_halo,
    chunk_low,
    chunk_high,
    chunk_width,
    last_use,
    splits,
    boundary,
    has_flowed,
    runs,
    f_rest,
    near_rest,
    x,
    x_start,
    x_rounded,
    v,
    f,
    xs,
    xs_rounded,
    xs_read,
    vs,
    fs,
    f_chunk,
    near_of,
    per_mass,
    free,
    frees,
    mass,
    stepped_mass,
    loads,
    work_ext,
    work_int,
    work_damp,
    winds,
    speed_before,
    speed_after,
    valence,
    ends,
    L0,
    EA,
    logarithmic,
    bar,
    yield_force,
    eps_p,
    dissipated,
    eps_u,
    pending,
    other,
    start,
    inv_L0,
    slot_element,
    the_EA,
    slot_EA,
    measure,
    slot_bar,
    the_yield,
    slot_yield,
    slot_eps_p,
    reach,
    send_index,
    mail,
    seconds,
):
    """Up to `steps` steps of length dt [s]; steps done, elements that reached their fracture strain, MPI error.

    first : number of the first step, at time first * dt; before_dt : length of the step before it, 0 at the start
    wind_time, wind_dt : [s] time of the wind's sample before, and from it to the one after
    chunk_low to near_rest, f_chunk, near_of : of `Plan`; xs, vs, fs, frees, loads, winds : axes of x, v, f, free, load, wind; the others are the fields of `State`
    seconds : (3,) [s], added to, time of FORCES, EXCHANGE, INTEGRATION; None: not measured
    """
    first_split = n_owned + n_halo
    numbers = 3 if eps_u is None else 5  # as `halo_width`
    for s in range(steps):
        kick_dt = 0.5 * (before_dt + dt)
        before_dt = dt
        share = (
            (first + s) * dt - wind_time
        ) / wind_dt  # of the step's number alone, wherever the loop was entered
        count, error, drifted, box = 0, 0, splits, open_box(mail)
        mark = lap(seconds, -1, 0.0)
        for c in range(chunk_low.shape[0]):
            low, high, width = chunk_low[c], chunk_high[c], chunk_width[c]
            if has_flowed[c]:
                kick_rows(
                    c,
                    low,
                    width,
                    runs,
                    f_rest,
                    near_rest,
                    kick_dt,
                    zeta,
                    share,
                    xs_read,
                    vs,
                    f_chunk,
                    near_of,
                    per_mass,
                    frees,
                    stepped_mass,
                    loads,
                    work_ext,
                    work_int,
                    work_damp,
                    winds,
                    speed_before,
                    speed_after,
                    other,
                    start,
                    inv_L0,
                    the_EA,
                    slot_EA,
                    measure,
                    slot_bar,
                    the_yield,
                    slot_yield,
                    slot_eps_p,
                    reach,
                )
            else:  # the same without plastic strains, which would be zero
                kick_rows(
                    c,
                    low,
                    width,
                    runs,
                    f_rest,
                    near_rest,
                    kick_dt,
                    zeta,
                    share,
                    xs_read,
                    vs,
                    f_chunk,
                    near_of,
                    per_mass,
                    frees,
                    stepped_mass,
                    loads,
                    work_ext,
                    work_int,
                    work_damp,
                    winds,
                    speed_before,
                    speed_after,
                    other,
                    start,
                    inv_L0,
                    the_EA,
                    slot_EA,
                    measure,
                    slot_bar,
                    the_yield,
                    slot_yield,
                    None,
                    reach,
                )
            near = 0
            if slot_element is not None:
                near = count_near(near_of, high - low)
                if near > 0:
                    count, flowed = flow(
                        low,
                        high,
                        width,
                        n_owned,
                        first_split,
                        x,
                        x_start,
                        other,
                        inv_L0,
                        slot_element,
                        slot_eps_p,
                        ends,
                        L0,
                        EA,
                        logarithmic,
                        bar,
                        yield_force,
                        eps_p,
                        dissipated,
                        eps_u,
                        pending,
                        count,
                        near_of,
                    )
                    has_flowed[c] |= flowed
            if (
                c < splits + boundary or near > 0
            ):  # forces are kept where they are sent, or where something may break
                keep_forces(low, high, f_chunk, fs)
            mark = lap(seconds, FORCES, mark)
            if c == splits + boundary - 1:
                for i in range(send_index.shape[0]):
                    p, row = send_index[i], mail.send_at + box + i * numbers
                    for k in range(3):
                        mail.boxes[row + k] = f[p, k]
                    if eps_u is not None:  # what the halo cannot know after a fracture elsewhere
                        mail.boxes[row + 3] = mass[p]
                        mail.boxes[row + 4] = valence[p]
                error = send_box(mail)
                if error != 0:
                    return s, 0, error
                mark = lap(seconds, EXCHANGE, mark)
            while drifted <= c and last_use[drifted] <= c:
                drift_rows(chunk_low[drifted], chunk_high[drifted], dt, xs, xs_rounded, vs)
                drifted += 1
            mark = lap(seconds, INTEGRATION, mark)
        for c in range(splits):  # any chunk may need them
            drift_rows(chunk_low[c], chunk_high[c], dt, xs, xs_rounded, vs)
        mark = lap(seconds, INTEGRATION, mark)
        error = wait_for_boxes(mail)
        mark = lap(seconds, EXCHANGE, mark)
        if error != 0:
            return s, 0, error
        for i in range(n_halo):
            row = mail.receive_at[i] + box
            for k in range(3):
                f[n_owned + i, k] = mail.boxes[row + k]
            if eps_u is not None:
                mass[n_owned + i] = mail.boxes[row + 3]
                if per_mass[n_owned + i] != 0.0:
                    per_mass[n_owned + i] = inverse_mass(mass[n_owned + i])
                valence[n_owned + i] = int(mail.boxes[row + 4])
        move_halo(n_owned, n_owned + n_halo, kick_dt, dt, zeta, x, x_rounded, v, f, per_mass, free)
        mark = lap(seconds, INTEGRATION, mark)
        if count > 0:
            return s + 1, count, 0
    return steps, 0, 0


def halo_width(state: State) -> int:
    """Numbers sent for each boundary particle: the force, and with fracture the mass and the valence."""
    return 5 if state.scene.fracture else 3


class Plan:
    """How the time loop goes through the particles that a rank steps: chunk by chunk, each small enough for the cache.

    First come the chunks of the particles that split off, `splits` of them, then those of the owned ones, of which the first `boundary`
    hold the boundary particles.
    low, high : (chunks,) particles of each chunk; width : (chunks,) most elements at one of them
    last_use : (chunks,) the last chunk that reads positions of the chunk, itself if none comes after it
    has_flowed : (chunks,) whether any of its elements has plastic strain
    runs : `kernels.Runs`, for the slots as they are
    """

    def __init__(self, state: State, halo: Halo):
        boundary = int(halo.send_index.max()) + 1 if len(halo.send_index) else 0
        before, after = np.arange(0, boundary, CHUNK), np.arange(boundary, state.n_owned, CHUNK)
        self.owned_low, self.boundary = np.concatenate([before, after]), len(before)
        self.owned_high = np.append(self.owned_low[1:], state.n_owned)[: len(self.owned_low)]
        number, lanes = state.scene.number, state.scene.lanes
        self.f_chunk, self.near_of = tuple(np.zeros((3, CHUNK), number(STEPPED))), np.zeros(CHUNK, np.int32)
        self.f_rest, self.near_rest = (
            tuple(np.zeros((3, CHUNK + lanes), number(STEPPED))),
            np.zeros(CHUNK + lanes, np.int32),
        )
        valence = np.bincount(state.ends.ravel(), minlength=state.n_local)[: state.n_owned]
        self.owned_width, self.owned_use = (
            np.full(len(self.owned_low), SLOTS, np.int64),
            np.arange(len(self.owned_low)),
        )
        chunk_of = lambda particles: np.searchsorted(self.owned_low, particles, side="right") - 1
        np.maximum.at(self.owned_width, chunk_of(np.arange(state.n_owned)), valence)
        chunk = chunk_of(state.ends[(state.ends < state.n_owned).all(1)])
        np.maximum.at(self.owned_use, chunk[:, 0], chunk[:, 1])
        np.maximum.at(self.owned_use, chunk[:, 1], chunk[:, 0])
        self.attach(state)

    def attach(self, state: State) -> None:
        """Bring chunks, slots, masses and runs up to date with what is attached to what."""
        new = np.arange(state.first_split, state.n_local, CHUNK)
        self.splits = len(new)
        self.low = np.concatenate([new, self.owned_low])
        self.high = np.concatenate([np.minimum(new + CHUNK, state.n_local), self.owned_high])
        self.width = np.concatenate([np.full(len(new), SLOTS), self.owned_width])
        self.last_use = np.concatenate([np.zeros(len(new), np.int64), self.owned_use + len(new)])
        state.fill_slots(zip(self.low.tolist(), self.high.tolist()))
        state.invert_masses()
        state.round_displacements()
        self.has_flowed = np.zeros(len(self.low), np.uint8)
        if state.slot_eps_p is not None:
            self.has_flowed[:] = [
                state.slot_eps_p[:, low:high].any() for low, high in zip(self.low, self.high)
            ]
        chunks, n, lanes = len(self.low), state.n_local, state.scene.lanes
        self.runs = Runs(
            lanes,
            np.zeros((chunks, 8), np.int64),
            np.zeros((n // lanes, 2 + SLOTS), np.int64),
            np.zeros((n // FEWEST, 4 + SLOTS), np.int64),
            np.zeros(n + lanes * chunks, np.uint32),
            np.zeros((n // lanes + chunks, 2), np.int64),
        )
        find_runs(self.low, self.high, self.width, state.other, *self.runs)
        self.arguments = self._arguments(state)

    def _arguments(self, state: State) -> tuple:
        """What `time_loop` gets of the state, from n_owned to reach, which stays the same until something parts."""
        s = state
        axes = lambda array: (None, None, None) if array is None else tuple(array.T)
        the_EA = s.EA.max(initial=0.0) if s.slot_EA is None else 0.0
        the_yield = (
            None
            if s.yield_force is None
            else float(s.yield_force.max(initial=0.0))
            if s.slot_yield is None
            else 0.0
        )
        free = s.free if s.scene.part_held else None
        x, x_start = (s.u, s.x_start) if s.scene.displaced else (s.x, None)
        xs_rounded = None if s.u_rounded is None else axes(s.u_rounded)
        loads = axes(s.load) if s.load[:, :2].any() else (None, None, s.load[:, 2])
        return (
            s.n_owned,
            s.n_halo,
            self.low,
            self.high,
            self.width,
            self.last_use,
            self.splits,
            self.boundary,
            self.has_flowed,
            self.runs,
            self.f_rest,
            self.near_rest,
            x,
            x_start,
            s.u_rounded,
            s.v,
            s.f,
            axes(x),
            xs_rounded,
            xs_rounded or axes(x),
            axes(s.v),
            axes(s.f),
            self.f_chunk,
            self.near_of if s.scene.inelastic else None,
            s.per_mass,
            free,
            axes(free),
            s.mass,
            s.mass if s.stepped_mass is None else s.stepped_mass,
            loads,
            *axes(s.work if s.block_work is None else s.block_work),
            axes(s.wind),
            s.speed_before,
            s.speed_after,
            s.valence,
            s.ends,
            s.L0,
            s.EA,
            s.scene.logarithmic,
            s.bar,
            s.yield_force,
            s.eps_p,
            s.dissipated,
            s.eps_u,
            s.pending,
            s.other,
            s.start,
            s.inv_L0,
            s.slot_element,
            the_EA,
            s.slot_EA,
            s.scene.logarithmic or None,
            s.slot_bar,
            the_yield,
            s.slot_yield,
            s.slot_eps_p,
            s.reach,
        )


def run_steps(
    halo: Halo,
    plan: Plan,
    first: int,
    steps: int,
    before_dt: float,
    dt: float,
    zeta: float,
    wind_time: float,
    wind_dt: float,
    seconds: np.ndarray | None = None,
):
    """Advance the state that the plan is attached to by up to `steps` steps; as `time_loop`. Collective among neighbours."""
    return time_loop(
        first,
        steps,
        before_dt,
        dt,
        zeta,
        wind_time,
        wind_dt,
        *plan.arguments,
        halo.send_index,
        halo.mail,
        seconds,
    )
