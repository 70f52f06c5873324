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
from netfall.mechanics.kernels import (
    add_tensions,
    element_energies,
    element_state,
    external_force,
    inverse_mass,
    kick,
    kick_factors,
)
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
def particle_energies(
    rows,
    part,
    kick_dt,
    zeta,
    share,
    v,
    f_int,
    free,
    mass,
    load,
    work,
    wind,
    speed_before,
    speed_after,
    velocity,
    terms,
):
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


@kernel
def look(
    rows,
    part,
    kick_dt,
    zeta,
    share,
    x,
    v,
    f_int,
    free,
    mass,
    load,
    work,
    wind,
    speed_before,
    speed_after,
    ends,
    L0,
    EA,
    logarithmic,
    bar,
    yield_force,
    eps_p,
    dissipated,
    broken,
    owned,
    velocity,
    terms,
    N,
    eps,
    eps_p_now,
    L,
    stored,
    heat,
):
    """All of a snapshot at once, for a call takes as long as any of its parts; the number of owned cables that are whole and slack."""
    element_state(x, ends, L0, EA, logarithmic, bar, yield_force, eps_p, N, eps, eps_p_now, L)
    add_tensions(x, ends, N, L, f_int)
    particle_energies(
        rows,
        part,
        kick_dt,
        zeta,
        share,
        v,
        f_int,
        free,
        mass,
        load,
        work,
        wind,
        speed_before,
        speed_after,
        velocity,
        terms,
    )
    element_energies(N, eps_p_now, L0, EA, logarithmic, yield_force, eps_p, dissipated, stored, heat)
    slack = 0
    for e in range(N.shape[0]):
        slack += N[e] == 0.0 and bar[e] == 0 and broken[e] == 0 and owned[e] == 1
    return slack


@dataclass
class Snapshot:
    """The state at a step n as it is reported: owned particles (rows) and all elements of a rank; slack : cables of this rank that are whole and slack."""

    rows: np.ndarray
    velocity: np.ndarray
    N: np.ndarray
    eps: np.ndarray
    eps_p: np.ndarray
    terms: np.ndarray
    stored: np.ndarray
    heat: np.ndarray
    slack: int


def take_snapshot(state: State, before_dt: float, dt: float, zeta: float, share: float) -> Snapshot:
    """Forces, velocities and energies at the present step. before_dt, dt : [s] the steps before and after it."""
    s, rows = state, state.owned_rows()
    f_int = np.zeros_like(s.x)
    velocity, terms = np.empty((len(rows), 3)), np.empty((4, len(rows)))
    N, eps, eps_p, L, stored, heat = np.empty((6, s.m))
    part = before_dt / (before_dt + dt)
    slack = look(
        rows,
        part,
        0.5 * (before_dt + dt),
        zeta,
        share,
        s.x,
        s.v,
        f_int,
        s.free,
        s.mass,
        s.load,
        s.work,
        s.wind,
        s.speed_before,
        s.speed_after,
        s.ends,
        s.L0,
        s.EA,
        s.scene.logarithmic,
        s.bar,
        s.yield_force,
        s.eps_p,
        s.dissipated,
        s.broken,
        s.owned,
        velocity,
        terms,
        N,
        eps,
        eps_p,
        L,
        stored,
        heat,
    )
    return Snapshot(rows, velocity, N, eps, eps_p, terms, stored, heat, slack)


def total_energies(comm: MPI.Comm, state: State, snapshot: Snapshot) -> Energies:
    """Energies of the whole net, the same to the bit on any number of ranks. Collective."""
    mine = state.owned.astype(bool)
    kinetic, damping, external, internal, stored, heat = exact_sums(
        comm, *snapshot.terms, snapshot.stored[mine], snapshot.heat[mine]
    )
    return Energies(kinetic, stored, heat, damping, external, internal)
