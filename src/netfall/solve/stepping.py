"""The time loop: central difference in half-step velocities, compiled, the exchange included.

A step n takes x(n) and v(n-1/2). Particles go through it in chunks that stay in the cache:
    1. internal forces f_int(x(n)) of a chunk; where elements come near their limits, plastic flow and fracture strains
    2. external force, kick to v(n+1/2), work
    3. after the chunks with boundary particles, which come first: their total forces are sent
    4. drift to x(n+1) of the chunks whose x(n) no later chunk needs; at the end, of all
    5. the halo's total forces arrive; halo particles: the same kick and drift
    6. if elements reached their fracture strain, the loop returns; they part at x(n+1) (`fracture.py`)
"""

from dataclasses import dataclass

import numpy as np

from netfall.mechanics.compile import kernel, vector_kernel
from netfall.mechanics.kernels import SLOTS, external_force, flow, inverse_mass, kick, kick_factors, slot_forces
from netfall.mechanics.state import State
from netfall.parallel.halo import IGNORE_STATUSES, Halo, start_all, wait_all

CHUNK = 256  # particles; some 30 KB


@vector_kernel
def kick_rows(first, last, to, kick_dt, zeta, share, v, f, f_int, per_mass, free, mass, load, work_ext, work_int, work_damp, wind, speed_before, speed_after):
    """Kick and work of particles first to last under f_int (last - first, 3) and external force; total force to rows from `to` on of f.

    per_mass : (last - first,), scratch. An axis at a time: within one the compiler sees that nothing written is read again.
    """
    first, last, to = np.uint64(first), np.uint64(last), np.uint64(to)  # unsigned: no index then counts from the end
    c_v, c_a = kick_factors(zeta, kick_dt)
    for p in range(first, last):
        per_mass[p - first] = inverse_mass(mass[p])
    for k in range(3):
        for p in range(first, last):
            ext = external_force(p, k, load, wind, speed_before, speed_after, share)
            internal = f_int[p - first, k]
            total = internal + ext
            f[to + p - first, k] = total
            old = v[p, k]
            new = kick(old, total * per_mass[p - first], c_v, c_a) if free[p, k] else old  # v to n + 1/2
            v[p, k] = new
            if work_ext is not None:
                way = kick_dt * (0.5 * (old + new)) if free[p, k] else 0.0
                work_ext[p] += way * ext
                work_int[p] += way * internal
                work_damp[p] += way * (zeta * mass[p] * (0.5 * (old + new)))


@vector_kernel
def drift_rows(first, last, dt, x, v, free):
    """x to n + 1 of particles first to last."""
    first, last = np.uint64(first), np.uint64(last)
    for k in range(3):
        for p in range(first, last):
            x[p, k] = x[p, k] + dt * v[p, k] if free[p, k] else x[p, k]


@vector_kernel
def move_halo(first, last, kick_dt, dt, zeta, x, v, f, free, mass):
    """Kick and drift of halo particles, whose total force f the owner has sent."""
    first, last = np.uint64(first), np.uint64(last)
    c_v, c_a = kick_factors(zeta, kick_dt)
    for p in range(first, last):
        per_mass = inverse_mass(mass[p])
        for k in range(3):
            if free[p, k]:
                v[p, k] = kick(v[p, k], f[p, k] * per_mass, c_v, c_a)
                x[p, k] += dt * v[p, k]


@kernel
def time_loop(first, steps, before_dt, dt, zeta, wind_time, wind_dt, n_owned, n_halo, n_local, chunk_width, last_use, boundary,
              x, v, f, f_int, per_mass, near_of, free, mass, load, work_ext, work_int, work_damp, wind, speed_before, speed_after, valence,
              ends, L0, EA, logarithmic, bar, yield_force, eps_p, dissipated, eps_u, pending,
              other, inv_L0, slot_element, the_EA, slot_EA, measure, slot_bar, the_yield, slot_yield, slot_eps_p, reach,
              send_index, send, receive, requests, ignore_statuses):
    """Up to `steps` steps of length dt [s]; steps done, elements that reached their fracture strain, MPI error.

    first : number of the first step, at time first * dt; before_dt : length of the step before it, 0 at the start
    wind_time, wind_dt : [s] time of the wind's sample before, and from it to the one after
    chunk_width, last_use, boundary : of `Plan`; the other arrays are the fields of `State`, f_int (CHUNK, 3), per_mass and near_of (CHUNK,) scratch.
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
                low = first_split + (c + splits) * CHUNK
                high, width = min(low + CHUNK, n_local), SLOTS
            else:
                low = c * CHUNK
                high, width = min(low + CHUNK, n_owned), chunk_width[c]
            near = slot_forces(low, high, width, x, other, inv_L0, the_EA, slot_EA, measure, slot_bar, the_yield, slot_yield, slot_eps_p, reach, f_int,
                               near_of)
            if slot_element is not None:
                if near > 0:
                    count = flow(low, high, width, n_owned, first_split, x, other, inv_L0, slot_element, slot_eps_p, ends, L0, EA, logarithmic, bar,
                                 yield_force, eps_p, dissipated, eps_u, pending, count, near_of)
            to = low
            if eps_u is None:
                to = min(low, boundary * CHUNK)  # the forces of the interior are not kept
            kick_rows(low, high, to, kick_dt, zeta, share, v, f, f_int, per_mass, free, mass, load, work_ext, work_int, work_damp, wind,
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
                drift_rows(drifted * CHUNK, min((drifted + 1) * CHUNK, n_owned), dt, x, v, free)
                drifted += 1
        if eps_u is not None:
            drift_rows(first_split, n_local, dt, x, v, free)
        error = wait_all(requests, ignore_statuses)
        if error != 0:
            return s, 0, error
        for i in range(n_halo):
            for k in range(3):
                f[n_owned + i, k] = receive[i, k]
            if eps_u is not None:
                mass[n_owned + i] = receive[i, 3]
                valence[n_owned + i] = int(receive[i, 4])
        move_halo(n_owned, n_owned + n_halo, kick_dt, dt, zeta, x, v, f, free, mass)
        if count > 0:
            return s + 1, count, 0
    return steps, 0, 0


def halo_width(state: State) -> int:
    """Numbers sent for each boundary particle: the force, and with fracture the mass and the valence."""
    return 5 if state.scene.fracture else 3


@dataclass(frozen=True)
class Plan:
    """How the time loop goes through the owned particles.

    chunk_width : (chunks,) most elements at a particle of the chunk
    last_use : (chunks,) the last chunk that reads positions of the chunk, itself if none comes after it
    boundary : chunks that hold the boundary particles, which stand first
    """

    chunk_width: np.ndarray
    last_use: np.ndarray
    boundary: int
    f_int: np.ndarray
    per_mass: np.ndarray
    near_of: np.ndarray


def make_plan(state: State, halo: Halo) -> Plan:
    """The plan for a state whose slots are filled; it holds through fractures, which only take elements off."""
    chunks = (state.n_owned + CHUNK - 1) // CHUNK
    width, last_use = np.full(chunks, SLOTS, np.int64), np.arange(chunks)
    valence = np.bincount(state.ends.ravel(), minlength=state.n_local)[: state.n_owned]
    np.maximum.at(width, np.arange(state.n_owned) // CHUNK, valence)
    chunk = state.ends[(state.ends < state.n_owned).all(1)].astype(np.int64) // CHUNK
    np.maximum.at(last_use, chunk[:, 0], chunk[:, 1])
    np.maximum.at(last_use, chunk[:, 1], chunk[:, 0])
    boundary = int(halo.send_index.max(initial=0)) // CHUNK + 1 if len(halo.send_index) else 0
    return Plan(width, last_use, boundary, np.zeros((CHUNK, 3), order="F"), np.zeros(CHUNK), np.zeros(CHUNK, np.int64))


def run_steps(state: State, halo: Halo, plan: Plan, first: int, steps: int, before_dt: float, dt: float, zeta: float, wind_time: float, wind_dt: float):
    """Advance the state by up to `steps` steps; as `time_loop`. Collective among neighbours."""
    s = state
    the_EA = s.EA.max(initial=0.0) if s.slot_EA is None else 0.0
    the_yield = None if s.yield_force is None else float(s.yield_force.max(initial=0.0)) if s.slot_yield is None else 0.0
    work = (None, None, None) if s.work is None else s.work.T
    return time_loop(first, steps, before_dt, dt, zeta, wind_time, wind_dt, s.n_owned, s.n_halo, s.n_local, plan.chunk_width, plan.last_use, plan.boundary,
                     s.x, s.v, s.f, plan.f_int, plan.per_mass, plan.near_of if s.scene.inelastic else None, s.free, s.mass, s.load, *work, s.wind, s.speed_before, s.speed_after, s.valence,
                     s.ends, s.L0, s.EA, s.scene.logarithmic, s.bar, s.yield_force, s.eps_p, s.dissipated, s.eps_u, s.pending,
                     s.other, s.inv_L0, s.slot_element, the_EA, s.slot_EA, s.scene.logarithmic or None, s.slot_bar, the_yield, s.slot_yield, s.slot_eps_p, s.reach,
                     halo.send_index, halo.send, halo.receive, halo.requests, IGNORE_STATUSES)
