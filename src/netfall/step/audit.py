"""The state at a step n as it is reported: forces, velocities, and both energy audits (paper Eq. 8 to 11).

Nothing of the state is changed. With v at the very time n, part of the way through the kick, works are those
until then. All of it is one compiled call, for a call takes as long as any of its parts.
"""

import math
from typing import NamedTuple

import numpy as np

from netfall.ground.apart import Entry, call
from netfall.ground.compile import inner_kernel, kernel, kernel_apart, part_of_kernel, vector_kernel
from netfall.mechanics.air import RelativeWind, air_work, set_air, set_drag, with_air
from netfall.mechanics.bending import Joints, add_bending_forces, joint_energy
from netfall.mechanics.elements import ElementState, add_tensions, element_energies, element_state
from netfall.mechanics.fields import Elements, Particles
from netfall.mechanics.ground import pull_of_ground, velocity_after, works_of_motion
from netfall.mechanics.law.branches import add_branches, set_branches
from netfall.mechanics.law.law import Law
from netfall.mechanics.loads import external_force, squared_speed, wind_speed
from netfall.mechanics.motion import along_x, along_y, along_z, inverse_mass, kicked, make_kick
from netfall.mechanics.slip.motion import Places, slip_energies
from netfall.mechanics.supports import add_springs, on_guide
from netfall.parallel.sums import add_term


class Subject(NamedTuple):
    """What is looked at, on one rank.

    n_owned, first_split : particles; rows : (1,) of them in use; x : (n, 3) [m]
    springs : x_start, spring, spring_rest, turned; None: no elastic supports; joints : None: no chain bends
    places : at which cables slip, and the particles, for those alone; None: nowhere
    detached : (n,) of the particles; None: nothing can be cut free
    observe_particles : apart, for scenes that differ in what acts on particles share the rest
    """

    n_owned: int
    first_split: int
    rows: np.ndarray
    x: np.ndarray
    springs: tuple | None
    joints: Joints | None
    places: Places | None
    particles: Particles | None
    detached: np.ndarray | None
    elements: Elements
    law: Law
    observe_particles: Entry


class Bodies(NamedTuple):
    """The particles of one rank, as `Subject` has them."""

    n_owned: int
    first_split: int
    rows: np.ndarray
    particles: Particles
    relative: RelativeWind | None


class Attached(NamedTuple):
    """What hangs on a support: 1, else 0. particles : (n,) in the order of `Room`; elements : (m,), owned"""

    particles: np.ndarray
    elements: np.ndarray


class Room(NamedTuple):
    """What is filled; owned particles stand in order, those that split off after the others.

    f_int : (n, 3) [N]; velocity : three of (n,) [m/s]; now : `ElementState`; heat : (m,) dissipated [J]
    terms : (4 or 7, n) [J] kinetic, damping, external, internal, and OTHER_WORKS; stored : (m,) [J]
    sprung : (n,) [J] in elastic supports; None: there are none
    attached : None: nothing can be cut free
    sums : (k, LIMBS), exact, of this rank: terms, stored, heat, sprung, kinetic and stored energy of what is
        attached, friction of slips
    slack : (1,) cables of this rank that are whole and slack
    f_band : (n, 3) [N] of the branches alone; None: there are none
    add_exactly : of `sums`
    """

    f_int: np.ndarray
    velocity: tuple
    now: ElementState
    heat: np.ndarray
    terms: np.ndarray
    stored: np.ndarray
    sprung: np.ndarray | None
    attached: Attached | None
    sums: np.ndarray
    slack: np.ndarray
    f_band: np.ndarray | None
    add_exactly: Entry


@part_of_kernel
def energies_along(p, axis, internal, external, total, part, kick, particles):
    """Velocity [m/s] of particle p along an axis at the very time n, and works [J] on the way there.

    part : share of the kick that comes before n; internal, external, total : forces [N]
    Works: external, internal, damping, of the ground
    """
    old, moves = axis.v[p], True
    if axis.ground is None:
        moves = axis.free[p] != 0
    new = velocity_after(p, old, kicked(old, total * inverse_mass(particles.mass[p]), kick), axis)
    now = old + part * (new - old)
    duration = part * kick.dt
    way = duration * (0.5 * (old + now))
    damping, ground = works_of_motion(
        p, old, now, duration, way, external + internal, 0.5 * (old + new), kick, axis, particles
    )
    return (
        now,
        (way * external if moves else 0.0),
        (way * internal if moves else 0.0),
        (damping if moves else 0.0),
        ground,
    )


@vector_kernel
def particle_energies(
    first, last, before, part, kick_dt, zeta, share, particles, f_int, f_band, velocity, terms
):
    """Velocity and energy terms of particles first to last, which are owned, in rows less by `before`.

    part : share of the kick that comes before n, 1/2 between equal steps
    kick_dt, zeta, share : of `motion.Kick`; f_int, f_band : (n, 3) [N]; velocity, terms : of `Room`, out
    """
    kick = make_kick(kick_dt, zeta, share)
    x, y, z = along_x(particles), along_y(particles), along_z(particles)
    first, last, before = np.uint64(first), np.uint64(last), np.uint64(before)
    for p in range(first, last):
        i = p - before
        mass, square = particles.mass[p], 0.0
        if particles.wind is not None:
            square = squared_speed(wind_speed(p, particles, share), particles)
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
        total, pull = with_air(p, total, kick, particles)
        total = on_guide(p, total, particles)
        vx, ax, bx, cx, dx = energies_along(p, x, nx, ex, total[0], part, kick, particles)
        vy, ay, by, cy, dy = energies_along(p, y, ny, ey, total[1], part, kick, particles)
        vz, az, bz, cz, dz = energies_along(p, z, nz, ez, total[2], part, kick, particles)
        velocity[0][i], velocity[1][i], velocity[2][i] = vx, vy, vz
        terms[0, i] = 0.5 * mass * (vx * vx) + 0.5 * mass * (vy * vy) + 0.5 * mass * (vz * vz)
        if particles.work is not None:
            external, internal, damping = particles.work
            terms[1, i] = damping[p] + cx + cy + cz
            terms[2, i] = external[p] + ax + ay + az
            terms[3, i] = -(internal[p] + bx + by + bz)
        else:
            terms[1, i] = terms[2, i] = terms[3, i] = math.nan
        if particles.other_work is not None:
            air, band, support = particles.other_work
            v, along_band = particles.v, 0.0
            twice = (v[0][p] + vx, v[1][p] + vy, v[2][p] + vz)
            if f_band is not None:
                along_band = twice[0] * f_band[p, 0]
                along_band += twice[1] * f_band[p, 1] + twice[2] * f_band[p, 2]
            terms[4, i] = air[p] + air_work(p, part * kick_dt, pull, twice, particles)
            terms[5, i] = band[p] - 0.5 * part * kick_dt * along_band
            terms[6, i] = support[p] + dx + dy + dz


@inner_kernel
def spring_energies(first, last, before, x, start, spring, rest, turned, energy):
    """Energy [J] in elastic supports of particles first to last, in rows less by `before`.

    start, spring, rest, turned : as in `add_springs`; energy : out
    """
    for p in range(first, last):
        total = 0.0
        for k in range(3):
            off = (x[p, k] - start[p, k]) - rest[p, k]
            total += spring[p, k] * off * off
        energy[p - before] = 0.5 * total
        if turned is not None:
            off, across = (x[p, 0] - start[p, 0]) - rest[p, 0], (x[p, 1] - start[p, 1]) - rest[p, 1]
            energy[p - before] += turned[p, 2] * off * across


@inner_kernel
def add_joint_energies(x, joints, limbs):
    """Add the energies [J] of the joints that this rank counts to the fixed-point number in limbs."""
    for k in range(joints.stiffness.shape[0]):
        if joints.owned[k]:
            add_term(joint_energy(x, joints, k), limbs)


@inner_kernel
def find_attached(owned, subject, room):
    """Mark what is attached: the first `owned` rows of particles, and the elements of this rank."""
    detached, elements, attached = subject.detached, subject.elements, room.attached
    for i in range(owned):
        p = i if i < subject.n_owned else subject.first_split + i - subject.n_owned
        attached.particles[i] = 1 - detached[p]
    for e in range(attached.elements.shape[0]):
        loose = detached[elements.ends[e, 0]] & detached[elements.ends[e, 1]]
        attached.elements[e] = elements.owned[e] & (1 - loose)


@inner_kernel
def add_attached(owned, subject, room, limbs):
    """Add the kinetic and stored energies [J] of what is attached to the fixed-point number in limbs.

    What slips has its share from `add_slip_energies`.
    """
    find_attached(owned, subject, room)
    call(room.add_exactly, room.terms[0, :owned], room.attached.particles[:owned], limbs)
    call(room.add_exactly, room.stored, room.attached.elements, limbs)
    if subject.joints is not None:
        joints = subject.joints
        for k in range(joints.stiffness.shape[0]):
            if joints.owned[k] and not subject.detached[joints.particles[k, 1]]:
                add_term(joint_energy(subject.x, joints, k), limbs)
    if room.sprung is not None:  # at supports
        call(room.add_exactly, room.sprung[:owned], subject.elements.owned[:0], limbs)


@inner_kernel
def add_slip_energies(part, kick_dt, share, subject, sums):
    """Add the energies of the slips of this rank to sums, their heat to the last of these."""
    places, particles, before = subject.places, subject.particles, np.int64(-1)
    for i in range(places.node.shape[0]):
        kinetic, external, internal, heat = slip_energies(
            i, part, kick_dt, share, places, particles, subject.elements, subject.law
        )
        add_term(kinetic, sums[0])
        if subject.detached is not None:  # noqa: SIM102 (the compiler drops a branch on this alone)
            if not subject.detached[places.node[i]]:
                add_term(kinetic, sums[-2])
        if particles.slip_work is not None:
            p = places.node[i]
            if p != before:  # of all cables there
                add_term(particles.slip_work[0][p], sums[2])
                add_term(-particles.slip_work[1][p], sums[3])
                add_term(particles.slip_work[2][p], sums[-1])
            before = p
            add_term(external, sums[2])
            add_term(-internal, sums[3])
            add_term(heat, sums[-1])


@vector_kernel
def clear(f):
    """Set f (n, 3) to zero."""
    for k in range(3):
        for p in range(np.uint64(f.shape[0])):
            f[p, k] = 0.0


@vector_kernel
def count_slack(now, elements):
    """Cables of this rank that are whole and slack."""
    slack = 0
    for e in range(np.uint64(now.N.shape[0])):
        whole = (elements.bar[e] == 0) & (elements.broken[e] == 0) & (elements.owned[e] == 1)
        slack += np.int64((now.N[e] == 0.0) & whole)
    return slack


@kernel
def observe_once(entry, before_dt, dt, zeta, share):
    """`observe` from Python. entry : the kernel, and what it works on"""
    call(entry, before_dt, dt, zeta, share, True)


@kernel_apart
def observe_particles(part, kick_dt, zeta, share, bodies, room):
    """Velocities and energy terms of the particles; arguments as of `particle_energies`."""
    n_owned, first_split, particles = bodies.n_owned, bodies.first_split, bodies.particles
    if particles.air is not None:
        set_air(kick_dt, zeta, particles)
    if particles.drag is not None:
        set_drag(kick_dt, share, bodies.relative, particles)
    of = particles, room.f_int, room.f_band, room.velocity, room.terms
    particle_energies(0, n_owned, 0, part, kick_dt, zeta, share, *of)
    halo = first_split - n_owned
    particle_energies(first_split, bodies.rows[0], halo, part, kick_dt, zeta, share, *of)


@kernel_apart
def observe(before_dt, dt, zeta, share, whole, subject, room):
    """Fill the room; unless it is to be the whole, of elements the state alone.

    before_dt, dt : [s] the steps before and after; zeta, share : of `motion.Kick`
    """
    element_state(subject.x, subject.elements, subject.law, room.now)
    if not whole:
        return
    f_int, now, heat, f_band = room.f_int, room.now, room.heat, room.f_band
    terms, stored, sums = room.terms, room.stored, room.sums
    n_owned, first_split, n_local = subject.n_owned, subject.first_split, subject.rows[0]
    halo, owned = first_split - n_owned, n_owned + n_local - first_split
    part, kick_dt = before_dt / (before_dt + dt), 0.5 * (before_dt + dt)
    clear(f_int)
    add_tensions(subject.x, subject.elements.ends, now.N, now.L, f_int)
    if subject.law.branches is not None:
        set_branches(before_dt, dt, subject.law)
        add_branches(subject.x, subject.elements, now, subject.law, f_int, f_band)
    if subject.joints is not None:
        add_bending_forces(subject.x, subject.joints, f_int)
    if subject.springs is not None:
        start, spring, rest, turned = subject.springs
        add_springs(subject.x, start, spring, rest, turned, f_int)
        spring_energies(0, n_owned, 0, subject.x, start, spring, rest, turned, room.sprung)
        spring_energies(first_split, n_local, halo, subject.x, start, spring, rest, turned, room.sprung)
    call(subject.observe_particles, part, kick_dt, zeta, share)
    element_energies(subject.elements, now, subject.law, stored, heat)
    sums[:] = 0
    last, all_of_them = terms.shape[0], subject.elements.owned[:0]
    for k in range(last):
        call(room.add_exactly, terms[k, :owned], all_of_them, sums[k])
    call(room.add_exactly, stored, subject.elements.owned, sums[last])
    if subject.joints is not None:
        add_joint_energies(subject.x, subject.joints, sums[last])
    call(room.add_exactly, heat, subject.elements.owned, sums[last + 1])
    if room.sprung is not None:
        call(room.add_exactly, room.sprung[:owned], all_of_them, sums[last + 2])
    if subject.detached is not None:
        place = last + 2
        if room.sprung is not None:
            place += 1
        add_attached(owned, subject, room, sums[place])
    if subject.places is not None:
        add_slip_energies(part, kick_dt, share, subject, sums)
    room.slack[0] = count_slack(now, subject.elements)
