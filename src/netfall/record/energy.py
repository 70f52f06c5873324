"""The two energy audits (paper Eq. 8 to 11) at a step n, without changing the state.

Work identity: the kinetic energy is what external work, less the work against internal forces and damping,
leaves; with the half-step velocities this holds to rounding at any step, and so finds bugs. Physical balance:
the same with the elements' own stored and dissipated energy instead of the work against them; it drifts with
the step and is the error that users should see. Both are told as shares of the energy that took part
(`history.energy_in_play`).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from netfall.ground.compile import entry_for, inner_kernel, kernel, part_of_kernel
from netfall.mechanics.air import air_work_before, with_air
from netfall.mechanics.bending import Joints, add_bending_forces, joint_energy
from netfall.mechanics.elements import ElementState, add_tensions, element_energies, element_state
from netfall.mechanics.fields import OTHER_WORKS
from netfall.mechanics.ground import pull_of_ground, velocity_after, works_of_motion
from netfall.mechanics.loads import external_force, squared_speed, wind_speed
from netfall.mechanics.material import add_branches, set_branches
from netfall.mechanics.motion import along_x, along_y, along_z, inverse_mass, kicked, make_kick
from netfall.mechanics.state import State
from netfall.mechanics.supports import add_springs, on_guide, spring_energy
from netfall.parallel.sums import LIMBS, add_exactly, add_term, exact_sums, sums_of_all
from netfall.record.envelope import NO_ENVELOPE, widen


@dataclass(frozen=True)
class Energies:
    """Energies [J] at one time. `internal` is the work done against the elements' forces.

    air, band : work of the air's damping, and against branches; support : of the ground, on what it moves;
    0 where there is none
    """

    kinetic: float
    strain: float
    plastic: float
    damping: float
    external: float
    internal: float
    air: float = 0.0
    band: float = 0.0
    support: float = 0.0


@part_of_kernel
def energies_along(p, axis, internal, external, total, part, kick, particles):
    """Velocity [m/s] of particle p along an axis at the very time n, and works [J] on the way there.

    part : share of the kick that comes before n; internal, external, total : forces [N]
    Works: external, internal, damping, of the ground
    """
    old = axis.v[p]
    if axis.ground is None and not axis.free[p]:
        return old, 0.0, 0.0, 0.0, 0.0
    new = velocity_after(p, old, kicked(old, total * inverse_mass(particles.mass[p]), kick), axis)
    now = old + part * (new - old)
    duration = part * kick.dt
    way = duration * (0.5 * (old + now))
    damping, ground = works_of_motion(
        p, old, now, duration, way, external + internal, 0.5 * (old + new), kick, axis, particles
    )
    return now, way * external, way * internal, damping, ground


@inner_kernel
def particle_energies(rows, part, kick_dt, zeta, share, particles, f_int, f_band, velocity, terms):
    """Velocity and energy terms of owned particles at the very time n, part of the way through the kick.

    rows : (r,) local numbers; part : share of the kick that comes before n, 1/2 between equal steps
    kick_dt, zeta, share : of `motion.Kick`; f_int : (n, 3) [N]
    velocity : (r, 3) [m/s], out
    terms : (4, r) [J], out: kinetic, damping, external, internal; (7, r) with OTHER_WORKS
    """
    kick = make_kick(kick_dt, zeta, share)
    x, y, z = along_x(particles), along_y(particles), along_z(particles)
    for i in range(rows.shape[0]):
        p = rows[i]
        mass, speed, square = particles.mass[p], 0.0, 0.0
        if particles.wind is not None:
            speed = wind_speed(p, particles, share)
            square = squared_speed(speed, particles)
        nx, ny, nz = f_int[p, 0], f_int[p, 1], f_int[p, 2]
        ex = external_force(p, x, square, share)
        ey = external_force(p, y, square, share)
        ez = external_force(p, z, square, share)
        total = (nx + ex, ny + ey, nz + ez)
        if particles.ground is not None:
            gx = pull_of_ground(p, x, kick, particles)
            gy = pull_of_ground(p, y, kick, particles)
            gz = pull_of_ground(p, z, kick, particles)
            total = (total[0] + gx, total[1] + gy, total[2] + gz)
        total, pull, along = with_air(p, total, speed, kick, particles)
        total = on_guide(p, total, particles)
        vx, ax, bx, cx, dx = energies_along(p, x, nx, ex, total[0], part, kick, particles)
        vy, ay, by, cy, dy = energies_along(p, y, ny, ey, total[1], part, kick, particles)
        vz, az, bz, cz, dz = energies_along(p, z, nz, ez, total[2], part, kick, particles)
        velocity[i, 0], velocity[i, 1], velocity[i, 2] = vx, vy, vz
        terms[0, i] = 0.5 * mass * (vx * vx) + 0.5 * mass * (vy * vy) + 0.5 * mass * (vz * vz)
        terms[1, i] = terms[2, i] = terms[3, i] = math.nan
        if particles.work is not None:
            external, internal, damping = particles.work
            terms[1, i] = damping[p] + cx + cy + cz
            terms[2, i] = external[p] + ax + ay + az
            terms[3, i] = -(internal[p] + bx + by + bz)
        if particles.other_work is not None:
            air, band, support = particles.other_work
            along_band = 0.0
            if f_band is not None:
                v = particles.v
                along_band = (v[0][p] + vx) * f_band[p, 0]
                along_band += (v[1][p] + vy) * f_band[p, 1] + (v[2][p] + vz) * f_band[p, 2]
            terms[4, i] = air[p] + air_work_before(p, part, pull, along, kick, particles)
            terms[5, i] = band[p] - 0.5 * part * kick_dt * along_band
            terms[6, i] = support[p] + dx + dy + dz


@kernel
def observe(rows, part, kick_dt, zeta, share, x, besides, particles, elements, law, room, envelope):
    """All of a snapshot at once, for a call takes as long as any of its parts.

    besides : `Besides`; room : `Room`, out
    envelope : of `Envelope.at`, taken in
    The slack cables of this rank, and the largest size of a strain
    """
    f_int, velocity, now, heat, terms, stored, sums, _ = room
    for p in range(f_int.shape[0]):
        f_int[p, 0] = f_int[p, 1] = f_int[p, 2] = 0.0
    element_state(x, elements, law, now)
    add_tensions(x, elements.ends, now.N, now.L, f_int)
    if law.branches is not None:
        set_branches(2.0 * part * kick_dt, kick_dt, law)
        add_branches(x, elements, now, law, f_int, room.f_band)
    if besides.joints is not None:
        add_bending_forces(x, besides.joints, f_int)
    if besides.springs is not None:
        springs = besides.springs
        add_springs(x, springs[0], springs[1], springs[2], springs[3], f_int)
    particle_energies(rows, part, kick_dt, zeta, share, particles, f_int, room.f_band, velocity, terms)
    element_energies(elements, now, law, stored, heat)
    slack, largest = 0, 0.0
    for e in range(now.N.shape[0]):
        whole = elements.bar[e] == 0 and elements.broken[e] == 0 and elements.owned[e] == 1
        slack += now.N[e] == 0.0 and whole
        largest = max(largest, abs(now.eps[e]))
    sums[:] = 0
    last = terms.shape[0]
    for k in range(last):
        add_exactly(terms[k], sums[k])
    in_store, as_heat = sums[last], sums[last + 1]
    for e in range(now.N.shape[0]):
        if elements.owned[e]:
            add_term(stored[e], in_store)
            add_term(heat[e], as_heat)
    if besides.joints is not None:
        for k in range(besides.joints.stiffness.shape[0]):
            if besides.joints.owned[k]:
                add_term(joint_energy(x, besides.joints, k), in_store)
    widen(envelope, now.N, elements, particles)
    return slack, largest


class Besides(NamedTuple):
    """What acts on particles besides elements, None: nothing does.

    springs : x_start, spring, spring_rest, turned of elastic supports; joints : of chains that bend
    """

    springs: tuple | None
    joints: Joints | None


class Room(NamedTuple):
    """What a snapshot fills: f_int (n, 3) [N], velocity (r, 3) [m/s], `ElementState`, heat (m,) [J].

    terms : (4, r) or (7, r) [J], as of `particle_energies`; stored : (m,) [J]
    sums : (terms + 2, LIMBS), exact, of this rank: those, stored and heat
    f_band : (n, 3) [N] of the branches alone, None: there are none
    """

    f_int: np.ndarray
    velocity: np.ndarray
    now: ElementState
    heat: np.ndarray
    terms: np.ndarray
    stored: np.ndarray
    sums: np.ndarray
    f_band: np.ndarray | None


@dataclass
class Snapshot:
    """The state at a step n as it is reported: owned particles (rows) and all elements of a rank.

    slack : cables of this rank that are whole and slack; largest : size of a strain
    sprung : (r,) [J] in elastic supports, None: none; enter : `observe`, once its types are known
    """

    rows: np.ndarray
    room: Room
    slack: int = 0
    largest: float = 0.0
    sprung: np.ndarray | None = None
    enter: Callable | None = None

    @property
    def velocity(self) -> np.ndarray:
        """(r, 3) [m/s]"""
        return self.room.velocity

    @property
    def N(self) -> np.ndarray:
        """Axial force (m,) [N]"""
        return self.room.now.N

    @property
    def eps(self) -> np.ndarray:
        """Strain (m,)"""
        return self.room.now.eps

    @property
    def eps_p(self) -> np.ndarray:
        """Plastic strain (m,)"""
        return self.room.now.eps_p

    @property
    def heat(self) -> np.ndarray:
        """Dissipated (m,) [J]"""
        return self.room.heat


def make_room(state: State) -> Snapshot:
    """A snapshot that is yet to be taken."""
    rows, m = state.owned_rows(), state.m
    count = 4 if state.other_work is None else 4 + len(OTHER_WORKS)
    terms, sums = np.empty((count, len(rows))), np.zeros((count + 2, LIMBS), np.int64)
    N, eps, eps_p, L, stored, heat = np.empty((6, m))
    arrays = np.empty_like(state.x), np.empty((len(rows), 3)), ElementState(N, eps, eps_p, L)
    f_band = np.empty_like(state.x) if state.features.band else None
    return Snapshot(rows, Room(*arrays, heat, terms, stored, sums, f_band))


def take_snapshot(
    state: State,
    before_dt: float,
    dt: float,
    zeta: float,
    share: float,
    before: Snapshot | None = None,
    envelope: tuple = NO_ENVELOPE,
) -> Snapshot:
    """Forces, velocities and energies at the present step.

    before_dt, dt : [s] the steps before and after it
    before : a snapshot that is of no more use, and whose arrays are; envelope : of `Envelope.at`, taken in
    """
    snapshot = before
    if (
        before is None
        or len(before.room.f_int) != len(state.x)
        or len(before.rows) != state.n_local - state.n_halo
    ):
        snapshot = make_room(state)
    part, kick_dt = before_dt / (before_dt + dt), 0.5 * (before_dt + dt)
    springs = (state.x_start, state.spring, state.spring_rest) if state.features.springs else None
    springs = springs and (*springs, state.turned)
    step = snapshot.rows, part, kick_dt, zeta, share
    besides = Besides(springs, state.joints)
    arguments = *step, state.x, besides, state.particles, state.elements, state.law, snapshot.room, envelope
    if snapshot.enter:
        snapshot.slack, snapshot.largest = snapshot.enter(*arguments)
    else:
        snapshot.slack, snapshot.largest = observe(*arguments)
        snapshot.enter = entry_for(observe, *arguments) if snapshot is before else None
    if springs:
        of = lambda array: None if array is None else array[snapshot.rows]
        snapshot.sprung = spring_energy(*map(of, (state.x, *springs)))
    return snapshot


def total_energies(comm: MPI.Comm, state: State, snapshot: Snapshot) -> Energies:
    """Energies of the whole net, the same to the bit on any number of ranks. Collective."""
    *terms, stored, heat = sums_of_all(comm, snapshot.room.sums.copy())
    kinetic, damping, external, internal, *others = terms
    if state.features.springs:
        stored += exact_sums(comm, snapshot.sprung)[0]
    if not others and not state.features.energy:
        others = [math.nan] * len(OTHER_WORKS)
    return Energies(kinetic, stored, heat, damping, external, internal, *others)


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
