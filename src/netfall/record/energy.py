"""The two energy audits (paper Eq. 8 to 11) at a step n, without changing the state.

Work identity: the kinetic energy is what external work, less the work against internal forces and damping,
leaves; with the half-step velocities this holds to rounding at any step, and so finds bugs. Physical balance:
the same with the elements' own stored and dissipated energy instead of the work against them; it drifts with
the step and is the error that users should see. Both are told as shares of the energy that took part
(`history.energy_in_play`).
"""

import math
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from netfall.ground.compile import inner_kernel, kernel, part_of_kernel
from netfall.mechanics.elements import ElementState, add_tensions, element_energies, element_state
from netfall.mechanics.loads import external_force, squared_speed
from netfall.mechanics.motion import along_x, along_y, along_z, inverse_mass, kicked, make_kick
from netfall.mechanics.state import State
from netfall.mechanics.supports import add_springs, spring_energy
from netfall.parallel.sums import exact_sums


@dataclass(frozen=True)
class Energies:
    """Energies [J] at one time. `internal` is the work done against the elements' forces."""

    kinetic: float
    strain: float
    plastic: float
    damping: float
    external: float
    internal: float


@part_of_kernel
def energies_along(p, axis, internal, square, part, kick, mass):
    """Velocity [m/s] of particle p along an axis at the very time n, and works [J] on the way there.

    part : share of the kick that comes before n; internal : force [N]; works: external, internal, damping
    """
    old = axis.v[p]
    if not axis.free[p]:
        return old, 0.0, 0.0, 0.0
    force = external_force(p, axis, square, kick.share)
    new = kicked(old, (internal + force) * inverse_mass(mass), kick)
    now = old + part * (new - old)
    way = part * kick.dt * (0.5 * (old + now))
    return now, way * force, way * internal, way * (kick.zeta * mass * (0.5 * (old + new)))


@inner_kernel
def particle_energies(rows, part, kick_dt, zeta, share, particles, f_int, velocity, terms):
    """Velocity and energy terms of owned particles at the very time n, part of the way through the kick.

    rows : (r,) local numbers; part : share of the kick that comes before n, 1/2 between equal steps
    kick_dt, zeta, share : of `motion.Kick`; f_int : (n, 3) [N]
    velocity : (r, 3) [m/s], out; terms : (4, r) [J], out: kinetic, damping, external, internal
    """
    kick = make_kick(kick_dt, zeta, share)
    x, y, z = along_x(particles), along_y(particles), along_z(particles)
    for i in range(rows.shape[0]):
        p = rows[i]
        mass, square = particles.mass[p], 0.0
        if particles.wind is not None:
            square = squared_speed(p, particles, share)
        vx, ax, bx, cx = energies_along(p, x, f_int[p, 0], square, part, kick, mass)
        vy, ay, by, cy = energies_along(p, y, f_int[p, 1], square, part, kick, mass)
        vz, az, bz, cz = energies_along(p, z, f_int[p, 2], square, part, kick, mass)
        velocity[i, 0], velocity[i, 1], velocity[i, 2] = vx, vy, vz
        terms[0, i] = 0.5 * mass * (vx * vx) + 0.5 * mass * (vy * vy) + 0.5 * mass * (vz * vz)
        terms[1, i] = terms[2, i] = terms[3, i] = math.nan
        if particles.work is not None:
            external, internal, damping = particles.work
            terms[1, i] = damping[p] + cx + cy + cz
            terms[2, i] = external[p] + ax + ay + az
            terms[3, i] = -(internal[p] + bx + by + bz)


@kernel
def observe(rows, part, kick_dt, zeta, share, x, springs, particles, elements, law, f_int, snapshot):
    """All of a snapshot at once, for a call takes as long as any of its parts; the slack cables of this rank.

    springs : x_start, spring, spring_rest, None: no elastic supports
    snapshot : velocity, terms, `ElementState`, stored, heat, as in `Snapshot`, out; f_int : (n, 3) [N], zero
    """
    velocity, terms, now, stored, heat = snapshot
    element_state(x, elements, law, now)
    add_tensions(x, elements.ends, now.N, now.L, f_int)
    if springs is not None:
        add_springs(x, springs[0], springs[1], springs[2], f_int)
    particle_energies(rows, part, kick_dt, zeta, share, particles, f_int, velocity, terms)
    element_energies(elements, now, law, stored, heat)
    slack = 0
    for e in range(now.N.shape[0]):
        whole = elements.bar[e] == 0 and elements.broken[e] == 0 and elements.owned[e] == 1
        slack += now.N[e] == 0.0 and whole
    return slack


@dataclass
class Snapshot:
    """The state at a step n as it is reported: owned particles (rows) and all elements of a rank.

    slack : cables of this rank that are whole and slack; sprung : (r,) [J] in elastic supports, None: none
    """

    rows: np.ndarray
    velocity: np.ndarray
    N: np.ndarray
    eps: np.ndarray
    eps_p: np.ndarray
    terms: np.ndarray
    stored: np.ndarray
    heat: np.ndarray
    slack: int
    sprung: np.ndarray | None = None


def take_snapshot(state: State, before_dt: float, dt: float, zeta: float, share: float) -> Snapshot:
    """Forces, velocities and energies at the present step.

    before_dt, dt : [s] the steps before and after it.
    """
    rows = state.owned_rows()
    velocity, terms = np.empty((len(rows), 3)), np.empty((4, len(rows)))
    N, eps, eps_p, L, stored, heat = np.empty((6, state.m))
    now = ElementState(N, eps, eps_p, L)
    part, kick_dt, f_int = before_dt / (before_dt + dt), 0.5 * (before_dt + dt), np.zeros_like(state.x)
    springs = (state.x_start, state.spring, state.spring_rest) if state.features.springs else None
    slack = observe(
        rows,
        part,
        kick_dt,
        zeta,
        share,
        state.x,
        springs,
        state.particles,
        state.elements,
        state.law,
        f_int,
        (velocity, terms, now, stored, heat),
    )
    sprung = spring_energy(*(array[rows] for array in (state.x, *springs))) if springs else None
    return Snapshot(rows, velocity, N, eps, eps_p, terms, stored, heat, slack, sprung)


def total_energies(comm: MPI.Comm, state: State, snapshot: Snapshot) -> Energies:
    """Energies of the whole net, the same to the bit on any number of ranks. Collective."""
    mine = state.owned.astype(bool)
    kinetic, damping, external, internal, stored, heat = exact_sums(
        comm, *snapshot.terms, snapshot.stored[mine], snapshot.heat[mine]
    )
    if state.features.springs:
        stored += exact_sums(comm, snapshot.sprung)[0]
    return Energies(kinetic, stored, heat, damping, external, internal)


def most_extreme(
    comm: MPI.Comm, state: State, element_gid: np.ndarray, snapshot: Snapshot
) -> tuple[int, int]:
    """Numbers of the fastest particle and of the element with the largest strain. Collective."""
    speed = np.nan_to_num(np.abs(snapshot.velocity).max(1, initial=0.0), nan=np.inf)
    held = ~state.free[snapshot.rows].any(1)
    speed[held] = -1.0  # a support takes over what is no number from its neighbours
    strain = np.nan_to_num(np.abs(snapshot.eps), nan=np.inf)
    here = (
        speed.max(initial=-1.0),
        int(state.gid[snapshot.rows[speed.argmax()]]) if len(speed) else -1,
        strain.max(initial=-1.0),
        int(element_gid[strain.argmax()]) if len(strain) else -1,
    )
    every = comm.allgather(here)
    return max(every, key=lambda h: h[0])[1], max(every, key=lambda h: h[2])[3]
