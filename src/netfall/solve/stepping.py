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
from netfall.mechanics.kernels import SHORTEST_RUN, SLOTS, find_runs, flow, inverse_mass, kick, kick_factors, run_forces, slot_forces, squared_speed
from netfall.mechanics.state import State
from netfall.parallel.halo import IGNORE_STATUSES, Halo, start_all, wait_all

CHUNK = 256  # particles; some 30 KB


@vector_kernel
def kick_rows(first, last, to, kick_dt, zeta, share, v, f, f_int, square, per_mass, free, mass, load, work_ext, work_int, work_damp, wind, speed_before, speed_after):
    """Kick and work of particles first to last under f_int (last - first, 3) and external force; total force to rows from `to` on of f.

    square : (last - first,), scratch; free : (n, 3), None where every particle is free or held on all axes (per_mass = 0)
    An axis at a time: within one the compiler sees that nothing written is read again.
    """
    first, last, to = np.uint64(first), np.uint64(last), np.uint64(to)  # unsigned: no index then counts from the end
    c_v, c_a = kick_factors(zeta, kick_dt)
    if wind is not None:
        for p in range(first, last):
            square[p - first] = squared_speed(p, speed_before, speed_after, share)
    for k in range(3):
        for p in range(first, last):
            ext = load[p, k]
            if wind is not None:
                ext += wind[p, k] * square[p - first]
            internal = f_int[p - first, k]
            total = internal + ext
            f[to + p - first, k] = total
            old = v[p, k]
            new = kick(old, total * per_mass[p], c_v, c_a)  # v to n + 1/2
            if free is not None:
                new = new if free[p, k] else old
            v[p, k] = new
            if work_ext is not None:
                way = kick_dt * (0.5 * (old + new))  # zero where held
                work_ext[p] += way * ext
                work_int[p] += way * internal
                work_damp[p] += way * (zeta * mass[p] * (0.5 * (old + new)))


@vector_kernel
def drift_rows(first, last, dt, x, v):
    """x to n + 1 of particles first to last; where held, v = 0."""
    first, last = np.uint64(first), np.uint64(last)
    for k in range(3):
        for p in range(first, last):
            x[p, k] += dt * v[p, k]


@vector_kernel
def move_halo(first, last, kick_dt, dt, zeta, x, v, f, per_mass, free):
    """Kick and drift of halo particles, whose total force f the owner has sent."""
    first, last = np.uint64(first), np.uint64(last)
    c_v, c_a = kick_factors(zeta, kick_dt)
    for k in range(3):
        for p in range(first, last):
            new = kick(v[p, k], f[p, k] * per_mass[p], c_v, c_a)
            if free is not None:
                new = new if free[p, k] else v[p, k]
            v[p, k] = new
            x[p, k] += dt * new


@kernel
def time_loop(first, steps, before_dt, dt, zeta, wind_time, wind_dt, n_owned, n_halo, n_local, chunk_width, last_use, boundary, run_first, run_last, run_step, chunk_run,
              x, v, f, f_int, square, near_of, per_mass, free, mass, load, work_ext, work_int, work_damp, wind, speed_before, speed_after, valence,
              ends, L0, EA, logarithmic, bar, yield_force, eps_p, dissipated, eps_u, pending,
              other, inv_L0, slot_element, the_EA, slot_EA, measure, slot_bar, the_yield, slot_yield, slot_eps_p, reach,
              send_index, send, receive, requests, ignore_statuses):
    """Up to `steps` steps of length dt [s]; steps done, elements that reached their fracture strain, MPI error.

    first : number of the first step, at time first * dt; before_dt : length of the step before it, 0 at the start
    wind_time, wind_dt : [s] time of the wind's sample before, and from it to the one after
    chunk_width to chunk_run : of `Plan`; the other arrays are the fields of `State`, f_int (CHUNK, 3), square and near_of (CHUNK,) scratch.
    """
    chunks = chunk_width.shape[0]
    first_split = n_owned + n_halo
    for s in range(steps):
        kick_dt = 0.5 * (before_dt + dt)
        before_dt = dt
        share = ((first + s) * dt - wind_time) / wind_dt  # of the step's number alone, wherever the loop was entered
        count, error, drifted = 0, 0, 0
        splits = (n_local - first_split + CHUNK - 1) // CHUNK
        for c in range(-splits, chunks):  # those that split off first: no chunk then waits for them
            if c < 0:
                low, width = first_split + (c + splits) * CHUNK, SLOTS
                high = min(low + CHUNK, n_local)
                near = slot_forces(low, high, low, width, x, other, inv_L0, the_EA, slot_EA, measure, slot_bar, the_yield, slot_yield, slot_eps_p, reach,
                                   f_int, near_of)
            else:
                low, width, near = c * CHUNK, chunk_width[c], 0
                high = min(low + CHUNK, n_owned)
                for r in range(chunk_run[c], chunk_run[c + 1]):
                    if run_step[r, 0] != 0:
                        near += run_forces(run_first[r], run_last[r], low, run_step[r], x, inv_L0, the_EA, slot_EA, measure, slot_bar, the_yield, slot_yield,
                                           slot_eps_p, reach, f_int, near_of)
                    else:
                        near += slot_forces(run_first[r], run_last[r], low, width, x, other, inv_L0, the_EA, slot_EA, measure, slot_bar, the_yield,
                                            slot_yield, slot_eps_p, reach, f_int, near_of)
            if slot_element is not None:
                if near > 0:
                    count = flow(low, high, width, n_owned, first_split, x, other, inv_L0, slot_element, slot_eps_p, ends, L0, EA, logarithmic, bar,
                                 yield_force, eps_p, dissipated, eps_u, pending, count, near_of)
            to = low
            if eps_u is None:
                to = min(low, boundary * CHUNK)  # the forces of the interior are not kept
            kick_rows(low, high, to, kick_dt, zeta, share, v, f, f_int, square, per_mass, free, mass, load, work_ext, work_int, work_damp, wind,
                      speed_before, speed_after)
            if c == boundary - 1:
                for i in range(send_index.shape[0]):
                    p = send_index[i]
                    for k in range(3):
                        send[i, k] = f[p, k]
                    if eps_u is not None:  # what the halo cannot know after a fracture elsewhere
                        send[i, 3] = mass[p]
                        send[i, 4] = valence[p]
                error = start_all(requests)
                if error != 0:
                    return s, 0, error
            while drifted <= c and last_use[drifted] <= c:
                drift_rows(drifted * CHUNK, min((drifted + 1) * CHUNK, n_owned), dt, x, v)
                drifted += 1
        if eps_u is not None:
            drift_rows(first_split, n_local, dt, x, v)
        error = wait_all(requests, ignore_statuses)
        if error != 0:
            return s, 0, error
        for i in range(n_halo):
            for k in range(3):
                f[n_owned + i, k] = receive[i, k]
            if eps_u is not None:
                mass[n_owned + i] = receive[i, 3]
                if per_mass[n_owned + i] != 0.0:
                    per_mass[n_owned + i] = inverse_mass(mass[n_owned + i])
                valence[n_owned + i] = int(receive[i, 4])
        move_halo(n_owned, n_owned + n_halo, kick_dt, dt, zeta, x, v, f, per_mass, free)
        if count > 0:
            return s + 1, count, 0
    return steps, 0, 0


def halo_width(state: State) -> int:
    """Numbers sent for each boundary particle: the force, and with fracture the mass and the valence."""
    return 5 if state.scene.fracture else 3


class Plan:
    """How the time loop goes through the owned particles; made when the slots are filled, and holding through fractures, but for the runs.

    chunk_width : (chunks,) most elements at a particle of the chunk
    last_use : (chunks,) the last chunk that reads positions of the chunk, itself if none comes after it
    boundary : chunks that hold the boundary particles, which stand first
    runs : of `kernels.find_runs`, for the slots as they are
    """

    def __init__(self, state: State, halo: Halo):
        chunks = (state.n_owned + CHUNK - 1) // CHUNK
        self.chunk_width, self.last_use = np.full(chunks, SLOTS, np.int64), np.arange(chunks)
        valence = np.bincount(state.ends.ravel(), minlength=state.n_local)[: state.n_owned]
        np.maximum.at(self.chunk_width, np.arange(state.n_owned) // CHUNK, valence)
        chunk = state.ends[(state.ends < state.n_owned).all(1)].astype(np.int64) // CHUNK
        np.maximum.at(self.last_use, chunk[:, 0], chunk[:, 1])
        np.maximum.at(self.last_use, chunk[:, 1], chunk[:, 0])
        self.boundary = int(halo.send_index.max()) // CHUNK + 1 if len(halo.send_index) else 0
        self.f_int, self.square, self.near_of = np.zeros((CHUNK, 3), order="F"), np.zeros(CHUNK), np.zeros(CHUNK, np.int64)
        self.attach(state)

    def attach(self, state: State) -> None:
        """Bring slots, masses and runs up to date with what is attached to what."""
        state.fill_slots()
        state.invert_masses()
        most = 2 * (state.n_owned // SHORTEST_RUN + len(self.chunk_width)) + 1
        first, last, step, chunk_run = np.zeros(most, np.int64), np.zeros(most, np.int64), np.zeros((most, SLOTS), np.int64), np.zeros(len(self.chunk_width) + 1, np.int64)
        count = find_runs(state.n_owned, CHUNK, self.chunk_width, state.other, first, last, step, chunk_run)
        self.runs = first[:count], last[:count], step[:count], chunk_run


def run_steps(state: State, halo: Halo, plan: Plan, first: int, steps: int, before_dt: float, dt: float, zeta: float, wind_time: float, wind_dt: float):
    """Advance the state by up to `steps` steps; as `time_loop`. Collective among neighbours."""
    s = state
    the_EA = s.EA.max(initial=0.0) if s.slot_EA is None else 0.0
    the_yield = None if s.yield_force is None else float(s.yield_force.max(initial=0.0)) if s.slot_yield is None else 0.0
    work = (None, None, None) if s.work is None else s.work.T
    return time_loop(first, steps, before_dt, dt, zeta, wind_time, wind_dt, s.n_owned, s.n_halo, s.n_local, plan.chunk_width, plan.last_use, plan.boundary, *plan.runs,
                     s.x, s.v, s.f, plan.f_int, plan.square, plan.near_of if s.scene.inelastic else None, s.per_mass, s.free if s.scene.part_held else None, s.mass, s.load, *work, s.wind, s.speed_before, s.speed_after, s.valence,
                     s.ends, s.L0, s.EA, s.scene.logarithmic, s.bar, s.yield_force, s.eps_p, s.dissipated, s.eps_u, s.pending,
                     s.other, s.inv_L0, s.slot_element, the_EA, s.slot_EA, s.scene.logarithmic or None, s.slot_bar, the_yield, s.slot_yield, s.slot_eps_p, s.reach,
                     halo.send_index, halo.send, halo.receive, halo.requests, IGNORE_STATUSES)
