"""The time loop: central difference in half-step velocities, compiled, the exchange included.

A step n takes x(n) and v(n-1/2):
    1. internal forces f_int(x(n)); plastic flow; which elements reach their fracture strain
    2. the total forces of the boundary particles are sent
    3. owned particles: external force, kick to v(n+1/2), drift to x(n+1), work
    4. the halo's total forces arrive; halo particles: the same kick and drift
    5. if elements reached their fracture strain, the loop returns; they part at x(n+1) (`fracture.py`)
"""

from netfall.mechanics.compile import kernel
from netfall.mechanics.kernels import element_forces, external_force, inverse_mass, kick, kick_factors
from netfall.mechanics.state import State
from netfall.parallel.halo import IGNORE_STATUSES, Halo, start_all, wait_all


@kernel
def move_owned(first, last, kick_dt, dt, zeta, share, x, v, f, f_int, free, mass, load, work, wind, speed_before, speed_after):
    """Kick, drift and work of the owned particles in rows first to last, under internal and external force."""
    c_v, c_a = kick_factors(zeta, kick_dt)
    for p in range(first, last):
        m = mass[p]
        per_mass = inverse_mass(m)
        done_ext, done_int, done_damp = 0.0, 0.0, 0.0
        for k in range(3):
            ext = external_force(p, k, load, wind, speed_before, speed_after, share)
            f[p, k] = f_int[p, k] + ext
            if free[p, k]:
                new = kick(v[p, k], f[p, k] * per_mass, c_v, c_a)
                mean = 0.5 * (v[p, k] + new)
                done_ext += mean * ext
                done_int += mean * f_int[p, k]
                done_damp += zeta * m * (mean * mean)
                v[p, k] = new  # v to n + 1/2
                x[p, k] += dt * new  # x to n + 1
        work[p, 0] += kick_dt * done_ext
        work[p, 1] += kick_dt * done_int
        work[p, 2] += kick_dt * done_damp


@kernel
def move_halo(first, last, kick_dt, dt, zeta, x, v, f, free, mass):
    """The same kick and drift for halo particles, whose total force the owner has sent."""
    c_v, c_a = kick_factors(zeta, kick_dt)
    for p in range(first, last):
        per_mass = inverse_mass(mass[p])
        for k in range(3):
            if free[p, k]:
                v[p, k] = kick(v[p, k], f[p, k] * per_mass, c_v, c_a)
                x[p, k] += dt * v[p, k]


@kernel
def time_loop(first, steps, before_dt, dt, zeta, wind_time, wind_dt, n_owned, n_halo, n_local,
              x, v, f, f_int, free, mass, load, work, wind, speed_before, speed_after, valence,
              ends, L0, EA, logarithmic, bar, yield_force, eps_p, dissipated, eps_u, pending,
              send_index, send, receive, requests, ignore_statuses):
    """Up to `steps` steps of length dt [s]; steps done, elements that reached their fracture strain, MPI error.

    first : number of the first step, at time first * dt; before_dt : length of the step before it, 0 at the start
    wind_time, wind_dt : [s] time of the wind's sample before, and from it to the one after
    The arrays are the fields of `State`.
    """
    for s in range(steps):
        kick_dt = 0.5 * (before_dt + dt)
        before_dt = dt
        share = ((first + s) * dt - wind_time) / wind_dt  # of the step's number alone, wherever the loop was entered
        f_int[:n_local] = 0.0
        count = element_forces(x, ends, L0, EA, logarithmic, bar, yield_force, eps_p, dissipated, eps_u, pending, f_int)
        for i in range(send_index.shape[0]):
            p = send_index[i]
            for k in range(3):
                send[i, k] = f_int[p, k] + external_force(p, k, load, wind, speed_before, speed_after, share)
            if eps_u is not None:  # what the halo cannot know after a fracture elsewhere
                send[i, 3] = mass[p]
                send[i, 4] = valence[p]
        error = start_all(requests)
        if error != 0:
            return s, 0, error
        move_owned(0, n_owned, kick_dt, dt, zeta, share, x, v, f, f_int, free, mass, load, work, wind, speed_before, speed_after)
        if eps_u is not None:
            move_owned(n_owned + n_halo, n_local, kick_dt, dt, zeta, share, x, v, f, f_int, free, mass, load, work, wind, speed_before, speed_after)
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


def run_steps(state: State, halo: Halo, first: int, steps: int, before_dt: float, dt: float, zeta: float, wind_time: float, wind_dt: float):
    """Advance the state by up to `steps` steps; as `time_loop`. Collective among neighbours."""
    s = state
    return time_loop(first, steps, before_dt, dt, zeta, wind_time, wind_dt, s.n_owned, s.n_halo, s.n_local,
                     s.x, s.v, s.f, s.f_int, s.free, s.mass, s.load, s.work, s.wind, s.speed_before, s.speed_after, s.valence,
                     s.ends, s.L0, s.EA, s.scene.logarithmic, s.bar, s.yield_force, s.eps_p, s.dissipated, s.eps_u, s.pending,
                     halo.send_index, halo.send, halo.receive, halo.requests, IGNORE_STATUSES)
