"""The two energy audits (paper Eq. 8 to 11) at a step n, without changing the state.

Work identity: the kinetic energy is what external work, less the work against internal forces and damping,
leaves; with the half-step velocities this holds to rounding at any step, and so finds bugs. Physical balance:
the same with the elements' own stored and dissipated energy instead of the work against them; it drifts with
the step and is the error that users should see.
"""

import math
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from netfall.mechanics.compile import kernel
from netfall.mechanics.kernels import add_tensions, element_energies, external_force, inverse_mass, kick, kick_factors
from netfall.mechanics.state import State
from netfall.parallel.exact import exact_sums


@dataclass(frozen=True)
class Energies:
    """Energies [J] at one time. `internal` is the work done against the elements' forces."""

    kinetic: float
    strain: float
    plastic: float
    damping: float
    external: float
    internal: float


@kernel
def particle_energies(rows, part, kick_dt, zeta, share, v, f_int, free, mass, load, work, wind, speed_before, speed_after, velocity, terms):
    """Velocity and energy terms of owned particles at the very time n, part of the way through the kick.

    rows : (r,) local numbers; part : share of the kick that comes before n, 1/2 between equal steps
    velocity : (r, 3) [m/s], out; terms : (4, r) [J], out: kinetic, damping, external, internal
    """
    c_v, c_a = kick_factors(zeta, kick_dt)
    for i in range(rows.shape[0]):
        p = rows[i]
        per_mass = inverse_mass(mass[p])
        kinetic = 0.0
        damping, external, internal = math.nan, math.nan, math.nan
        if work is not None:
            damping, external, internal = work[p, 2], work[p, 0], work[p, 1]
        for k in range(3):
            ext = external_force(p, k, load, wind, speed_before, speed_after, share)
            old = v[p, k]
            now = old
            if free[p, k]:
                new = kick(old, (f_int[p, k] + ext) * per_mass, c_v, c_a)
                now = old + part * (new - old)
                way = part * kick_dt * (0.5 * (old + now))
                external += way * ext
                internal += way * f_int[p, k]
                damping += way * (zeta * mass[p] * (0.5 * (old + new)))
            velocity[i, k] = now
            kinetic += 0.5 * mass[p] * (now * now)
        terms[0, i], terms[1, i], terms[2, i], terms[3, i] = kinetic, damping, external, -internal


@dataclass
class Snapshot:
    """The state at a step n as it is reported: owned particles (rows) and all elements of a rank."""

    rows: np.ndarray
    velocity: np.ndarray
    N: np.ndarray
    eps: np.ndarray
    eps_p: np.ndarray
    terms: np.ndarray
    stored: np.ndarray
    heat: np.ndarray


def take_snapshot(state: State, before_dt: float, dt: float, zeta: float, share: float) -> Snapshot:
    """Forces, velocities and energies at the present step. before_dt, dt : [s] the steps before and after it."""
    N, eps, eps_p, L = state.elements_now()
    f_int = np.zeros_like(state.x)
    add_tensions(state.x, state.ends, N, L, f_int)
    rows = state.owned_rows()
    velocity, terms = np.empty((len(rows), 3)), np.empty((4, len(rows)))
    part = before_dt / (before_dt + dt)
    particle_energies(rows, part, 0.5 * (before_dt + dt), zeta, share, state.v, f_int, state.free, state.mass, state.load, state.work,
                      state.wind, state.speed_before, state.speed_after, velocity, terms)
    stored, heat = np.empty(state.m), np.empty(state.m)
    element_energies(N, eps_p, state.L0, state.EA, state.scene.logarithmic, state.yield_force, state.eps_p, state.dissipated, stored, heat)
    return Snapshot(rows, velocity, N, eps, eps_p, terms, stored, heat)


def total_energies(comm: MPI.Comm, state: State, snapshot: Snapshot) -> Energies:
    """Energies of the whole net, the same to the bit on any number of ranks. Collective."""
    mine = state.owned.astype(bool)
    kinetic, damping, external, internal, stored, heat = exact_sums(comm, *snapshot.terms, snapshot.stored[mine], snapshot.heat[mine])
    return Energies(kinetic, stored, heat, damping, external, internal)
