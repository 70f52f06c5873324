"""The state at a step n as it is reported: forces, velocities, and both energy audits (paper Eq. 8 to 11).

Nothing of the state is changed. With v at the very time n, part of the way through the kick, works are those
until then. All of it is one compiled call, for a call takes as long as any of its parts.
"""

import math

import numpy as np

from netfall.core.kernels import inner_kernel, kernel, part_of_kernel
from netfall.core.records import Record, f8, f8_2, has, i8, i8_2, u1, whole
from netfall.core.vectors import LANES, load, load_truths, put, where, zeros
from netfall.mechanics.air import RelativeWind, set_air, set_drag
from netfall.mechanics.bending import Joints, add_bending_forces, joint_energy
from netfall.mechanics.elements import ElementState, add_tensions, element_energies, element_state
from netfall.mechanics.fields import Elements, Particles
from netfall.mechanics.law.branches import add_branches, set_branches
from netfall.mechanics.law.law import Law
from netfall.mechanics.slip.motion import Places, slip_energies
from netfall.mechanics.supports import add_springs
from netfall.parallel.sums import add_exactly, add_term
from netfall.physics.targets import CPU, particle
from netfall.step.forces import (
    air_work,
    damped_mass,
    external_forces,
    held_velocity,
    with_air,
    with_ground,
    works_of_motion,
)

madd, kicked, off_guide = CPU.madd, particle.kicked, particle.off_guide


class Subject(Record):
    """What is looked at, on one rank; absent is what the scene does not have.

    n_owned, first_split : particles; rows : (1,) of them in use; traits : of `step.forces`
    joints : of chains that bend; places : at which cables slip; relative : wind at detached particles
    """

    n_owned: whole
    first_split: whole
    rows: i8
    traits: whole
    particles: Particles
    elements: Elements
    law: Law
    joints: Joints
    places: Places
    relative: RelativeWind


class Room(Record):
    """What is filled; owned particles stand in order, those that split off after the others.

    f_int : (3, n) [N]; velocity : (3, n) [m/s]; now : `ElementState`; heat : (m,) dissipated [J]
    terms : (4 or 7, n) [J] kinetic, damping, external, internal, and OTHER_WORKS; stored : (m,) [J]
    sprung : (n,) [J] in elastic supports; absent: there are none
    attached, attached_elements : (n,), (m,) 1 for what hangs on a support; absent: nothing can be cut free
    sums : (k, LIMBS), exact, of this rank: terms, stored, heat, sprung, kinetic and stored energy of what is
        attached, friction of slips
    slack : (1,) cables of this rank that are whole and slack
    f_band : (3, n) [N] of the branches alone; absent: there are none
    """

    f_int: f8_2
    velocity: f8_2
    now: ElementState
    heat: f8
    terms: f8_2
    stored: f8
    sprung: f8
    attached: u1
    attached_elements: u1
    sums: i8_2
    slack: i8
    f_band: f8_2


@part_of_kernel
def energies_along(p, k, internal, external, total, part, c_v, c_a, kick_dt, zeta, particles):
    """Velocities [m/s] of LANES particles from p on along axis k at the very time n; works [J] on the way.

    part : share of the kick that comes before n; internal, external, total : forces [N]
    Works: external, internal, damping, of the ground
    """
    old, mass, free = load(particles.v, k, p), load(particles.mass, 0, p), load_truths(particles.free, k, p)
    inverse = where(mass > 0.0, 1.0 / mass, zeros())
    new = held_velocity(p, k, old, kicked(old, total * inverse, c_v, c_a), particles)
    now = madd(part, new - old, old)
    duration = part * kick_dt
    way, mean, ground = duration * (0.5 * (old + now)), 0.5 * (old + new), zeros()
    if has(particles.ground):
        damping, ground = works_of_motion(
            p, k, old, now, duration, way, external + internal, mean, zeta, particles
        )
        return now, way * external, way * internal, damping, ground
    damping = way * (zeta * damped_mass(p, particles) * mean)
    return (
        now,
        where(free, way * external, zeros()),
        where(free, way * internal, zeros()),
        where(free, damping, zeros()),
        ground,
    )


@inner_kernel
def particle_energies(first, last, before, part, kick_dt, zeta, share, subject, room):
    """Velocity and energy terms of particles first to last, which are owned, in rows less by `before`.

    part : share of the kick that comes before n, 1/2 between equal steps
    """
    particles, traits, velocity, terms = subject.particles, subject.traits, room.velocity, room.terms
    h = 0.5 * zeta * kick_dt
    c_v, c_a = (1.0 - h) / (1.0 + h), kick_dt / (1.0 + h)
    end = last - before
    for p in range(first, last, LANES):
        i = p - before
        nx, ny, nz = load(room.f_int, 0, p), load(room.f_int, 1, p), load(room.f_int, 2, p)
        ex, ey, ez = external_forces(p, share, True, traits, particles)
        tx, ty, tz, pull = nx + ex, ny + ey, nz + ez, zeros()
        if has(particles.ground):
            tx, ty, tz = (
                with_ground(p, 0, tx, zeta, particles),
                with_ground(p, 1, ty, zeta, particles),
                with_ground(p, 2, tz, zeta, particles),
            )
        if has(particles.air) or has(particles.air_mass):
            tx, ty, tz, pull = with_air(p, tx, ty, tz, kick_dt, zeta, share, particles)
        if has(particles.turned):
            tx, ty = off_guide(load(particles.turned, 0, p), load(particles.turned, 1, p), tx, ty)
        vx, ax, bx, cx, dx = energies_along(
            p, 0, nx, ex, tx, part, c_v, c_a, kick_dt, zeta, particles
        )
        vy, ay, by, cy, dy = energies_along(
            p, 1, ny, ey, ty, part, c_v, c_a, kick_dt, zeta, particles
        )
        vz, az, bz, cz, dz = energies_along(
            p, 2, nz, ez, tz, part, c_v, c_a, kick_dt, zeta, particles
        )
        put(i, end, velocity, 0, vx)
        put(i, end, velocity, 1, vy)
        put(i, end, velocity, 2, vz)
        half = 0.5 * load(particles.mass, 0, p)
        put(i, end, terms, 0, madd(half, vz * vz, madd(half, vy * vy, half * (vx * vx))))
        if has(particles.work):
            put(i, end, terms, 1, load(particles.work, 2, p) + cx + cy + cz)
            put(i, end, terms, 2, load(particles.work, 0, p) + ax + ay + az)
            put(i, end, terms, 3, -(load(particles.work, 1, p) + bx + by + bz))
        else:
            for k in range(1, 4):
                put(i, end, terms, k, zeros() + math.nan)
        if has(particles.other_work):
            v, along, air = particles.v, zeros(), load(particles.other_work, 0, p)
            tx, ty, tz = load(v, 0, p) + vx, load(v, 1, p) + vy, load(v, 2, p) + vz  # twice the mean
            if has(room.f_band):
                fx, fy, fz = load(room.f_band, 0, p), load(room.f_band, 1, p), load(room.f_band, 2, p)
                along = madd(tx, fx, madd(ty, fy, tz * fz))
            if has(particles.air):
                air = air + air_work(p, part * kick_dt, pull, tx, ty, tz, particles)
            put(i, end, terms, 4, air)
            put(i, end, terms, 5, load(particles.other_work, 1, p) - 0.5 * part * kick_dt * along)
            put(i, end, terms, 6, load(particles.other_work, 2, p) + dx + dy + dz)


@inner_kernel
def spring_energies(first, last, before, particles, energy):
    """Energy [J] in elastic supports of particles first to last, in rows less by `before`, out."""
    x, start, spring, rest = particles.x, particles.x_start, particles.spring, particles.spring_rest
    for p in range(first, last):
        total = 0.0
        for k in range(3):
            off = (x[k, p] - start[k, p]) - rest[k, p]
            total += spring[k, p] * off * off
        energy[p - before] = 0.5 * total
        if has(particles.turned):
            off, across = (x[0, p] - start[0, p]) - rest[0, p], (x[1, p] - start[1, p]) - rest[1, p]
            energy[p - before] += particles.turned[2, p] * off * across


@inner_kernel
def add_joint_energies(x, joints, limbs):
    """Add the energies [J] of the joints that this rank counts to the fixed-point number in limbs."""
    for k in range(joints.stiffness.shape[0]):
        if joints.owned[k]:
            add_term(joint_energy(x, joints, k), limbs)


@inner_kernel
def find_attached(owned, subject, room):
    """Mark what is attached: the first `owned` rows of particles, and the elements of this rank."""
    detached, elements = subject.particles.detached, subject.elements
    for i in range(owned):
        p = i if i < subject.n_owned else subject.first_split + i - subject.n_owned
        room.attached[i] = 1 - detached[p]
    for e in range(room.attached_elements.shape[0]):
        loose = detached[elements.ends[e, 0]] & detached[elements.ends[e, 1]]
        room.attached_elements[e] = elements.owned[e] & (1 - loose)


@inner_kernel
def add_attached(owned, subject, room, limbs):
    """Add the kinetic and stored energies [J] of what is attached to the fixed-point number in limbs.

    What slips has its share from `add_slip_energies`.
    """
    find_attached(owned, subject, room)
    add_exactly(room.terms[0, :owned], room.attached, limbs)
    add_exactly(room.stored, room.attached_elements, limbs)
    joints = subject.joints
    for k in range(joints.stiffness.shape[0]):
        if joints.owned[k] and not subject.particles.detached[joints.particles[k, 1]]:
            add_term(joint_energy(subject.particles.x.T, joints, k), limbs)
    if has(room.sprung):  # at supports
        add_exactly(room.sprung[:owned], room.attached[:0], limbs)


@inner_kernel
def add_slip_energies(part, kick_dt, share, subject, sums):
    """Add the energies of the slips of this rank to sums, their heat to the last of these."""
    places, particles, before = subject.places, subject.particles, np.int64(-1)
    for i in range(places.node.shape[0]):
        kinetic, external, internal, heat = slip_energies(
            i, part, kick_dt, share, places, particles, subject.elements, subject.law
        )
        add_term(kinetic, sums[0])
        if has(particles.detached) and not particles.detached[places.node[i]]:
            add_term(kinetic, sums[-2])
        if has(particles.slip_work):
            p = places.node[i]
            if p != before:  # of all cables there
                add_term(particles.slip_work[0, p], sums[2])
                add_term(-particles.slip_work[1, p], sums[3])
                add_term(particles.slip_work[2, p], sums[-1])
            before = p
            add_term(external, sums[2])
            add_term(-internal, sums[3])
            add_term(heat, sums[-1])


@inner_kernel
def count_slack(now, elements):
    """Cables of this rank that are whole and slack."""
    slack = 0
    for e in range(np.uint64(now.N.shape[0])):
        whole = (elements.bar[e] == 0) & (elements.broken[e] == 0) & (elements.owned[e] == 1)
        slack += np.int64((now.N[e] == 0.0) & whole)
    return slack


@inner_kernel
def observe_particles(part, kick_dt, zeta, share, subject, room):
    """Velocities and energy terms of the particles; arguments as of `particle_energies`."""
    n_owned, first_split, particles = subject.n_owned, subject.first_split, subject.particles
    if has(particles.air):
        set_air(kick_dt, zeta, particles)
    if has(particles.drag):
        set_drag(kick_dt, share, subject.relative, particles)
    halo = first_split - n_owned
    particle_energies(halo - halo, n_owned, halo - halo, part, kick_dt, zeta, share, subject, room)
    particle_energies(first_split, subject.rows[0], halo, part, kick_dt, zeta, share, subject, room)


@inner_kernel
def internal_forces(before_dt, dt, subject, room):
    """Forces f_int and f_band of the room, for the state of its elements; energy of elastic supports."""
    particles, elements, law, now = subject.particles, subject.elements, subject.law, room.now
    n_owned, first_split, x, f_int = subject.n_owned, subject.first_split, particles.x.T, room.f_int.T
    f_int[:] = 0.0
    add_tensions(x, elements.ends, now.N, now.L, f_int)
    if has(law.branches):
        set_branches(before_dt, dt, law)
        add_branches(x, elements, now, law, f_int, room.f_band.T)
    if has(subject.joints.stiffness):
        add_bending_forces(x, subject.joints, f_int)
    if has(particles.spring):
        halo, supports = first_split - n_owned, (particles.spring.T, particles.spring_rest.T)
        add_springs(x, particles.x_start.T, *supports, particles.turned.T, f_int)
        spring_energies(0, n_owned, 0, particles, room.sprung)
        spring_energies(first_split, subject.rows[0], halo, particles, room.sprung)


@kernel
def observe(before_dt, dt, zeta, share, whole, subject, room):
    """Fill the room; unless it is to be the whole, of elements the state alone.

    before_dt, dt : [s] the steps before and after; zeta [1/s]; share : place between two samples
    """
    particles, elements, law = subject.particles, subject.elements, subject.law
    element_state(particles.x.T, elements, law, room.now)
    if not whole:
        return
    heat, terms, stored, sums = room.heat, room.terms, room.stored, room.sums
    owned = subject.n_owned + subject.rows[0] - subject.first_split
    part, kick_dt = before_dt / (before_dt + dt), 0.5 * (before_dt + dt)
    internal_forces(before_dt, dt, subject, room)
    observe_particles(part, kick_dt, zeta, share, subject, room)
    element_energies(elements, room.now, law, stored, heat)
    sums[:] = 0
    last, every = terms.shape[0], elements.owned[:0]
    for k in range(last):
        add_exactly(terms[k, :owned], every, sums[k])
    add_exactly(stored, elements.owned, sums[last])
    add_joint_energies(particles.x.T, subject.joints, sums[last])
    add_exactly(heat, elements.owned, sums[last + 1])
    place = last + 2
    if has(room.sprung):
        add_exactly(room.sprung[:owned], every, sums[place])
        place += 1
    if has(particles.detached):
        add_attached(owned, subject, room, sums[place])
    if has(subject.places.node):
        add_slip_energies(part, kick_dt, share, subject, sums)
    room.slack[0] = count_slack(room.now, elements)
