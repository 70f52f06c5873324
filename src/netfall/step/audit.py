"""The state at a step n as it is reported: forces, velocities, and both energy audits (paper Eq. 8 to 11).

Nothing of the state is changed. With v at the very time n, part of the way through the kick, works are those
until then. All of it is one compiled call, for a call takes as long as any of its parts.
"""

import math

import numpy as np

from netfall.core.kernels import inner_kernel, kernel
from netfall.core.records import Record, f8, f8_2, has, i8, i8_2, u1, whole
from netfall.core.vectors import LANES, fma, load, load_truths, put, where, zeros
from netfall.mechanics.air import RelativeWind, set_air, set_drag
from netfall.mechanics.bending import Joints, bend, joint_energy
from netfall.mechanics.elements import ElementState, element_energies, find_state, pull
from netfall.mechanics.fields import Elements, Particles
from netfall.mechanics.law.branches import add_branches, set_branches
from netfall.mechanics.law.law import Law
from netfall.mechanics.slip.motion import Places, slip_energies
from netfall.mechanics.supports import spring_back
from netfall.parallel.sums import add_exactly, add_term
from netfall.physics.targets import particle
from netfall.step.forces import Scratch
from netfall.step.motion import (
    damped_mass,
    force_along_guides,
    free_force,
    total_forces,
)

kicked, works_of_motion = particle.kicked, particle.works_of_motion


class Subject(Record):
    """What is looked at, on one rank; absent is what the scene does not have.

    n_owned, first_split : particles; rows : (1,) of them in use; traits : of `step.motion`
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
    scratch : for a stretch of particles
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
    scratch: Scratch


@inner_kernel
def particle_energies(first, last, before, part, kick_dt, zeta, share, subject, room):
    """Velocity and energy terms of particles first to last, which are owned, in rows less by `before`.

    part : share of the kick that comes before n, 1/2 between equal steps
    """
    particles, scratch = subject.particles, room.scratch
    length = scratch.near.shape[0] - LANES
    for low in range(first, last, length):
        high = min(low + length, last)
        for k in range(3):
            for p in range(low, high):
                scratch.f[k, p - low] = room.f_int[k, p]
        total_forces(low, high, False, kick_dt, zeta, share, subject.traits, particles.x, particles, scratch)
        energies_of_stretch(low, high, before, part, kick_dt, zeta, subject, room)


@inner_kernel
def energies_of_stretch(low, high, before, part, kick_dt, zeta, subject, room):
    """The same of particles whose forces are in the scratch."""
    particles, velocity, terms = subject.particles, room.velocity, room.terms
    h = 0.5 * zeta * kick_dt
    c_v, c_a, duration, end = (1.0 - h) / (1.0 + h), kick_dt / (1.0 + h), part * kick_dt, high - before
    ground, scratch, other = has(particles.ground), room.scratch, particles.other_work
    for p in range(low, high, LANES):
        i, row, mass = p - low, p - before, load(particles.mass, 0, p)
        per_mass = where(mass > 0.0, 1.0 / mass, zeros())
        kinetic, external, internal, damping, support = zeros(), zeros(), zeros(), zeros(), zeros()
        of_air, of_band = zeros(), zeros()
        along = force_along_guides(p, i, scratch.total, particles)
        if has(particles.work):
            external, internal = load(particles.work, 0, p), load(particles.work, 1, p)
            damping = load(particles.work, 2, p)
        if has(other):
            support = load(other, 2, p)
        for k in range(3):
            n, e, old = load(scratch.f, k, i), load(scratch.external, k, i), load(particles.v, k, p)
            total, free = (
                free_force(k, p, i, scratch.total, along, particles),
                load_truths(particles.free, k, p),
            )
            held = load(particles.ground, k, p) if ground else old
            new = where(free, kicked(old, total * per_mass, c_v, c_a), held)
            now, mean = fma(part, new - old, old), 0.5 * (old + new)
            way, twice = duration * (0.5 * (old + now)), old + now
            damped = damped_mass(p, particles)
            with_e, with_n = fma(way, e, external), fma(way, n, internal)
            if ground:
                at = load(particles.ground, k, p)
                pull, against, gained = works_of_motion(mass, damped, zeta, at, old, now, old + new, duration)
                external, internal = with_e, with_n
                damping = where(free, fma(pull, against, damping), damping)
                held, drawn = fma(-way, e + n, gained) + support, fma(-pull * duration, at, support)
                support = where(free, drawn, held)
            else:
                external, internal = where(free, with_e, external), where(free, with_n, internal)
                damping = where(free, fma(way, zeta * damped * mean, damping), damping)
            if has(room.f_band):
                of_band = fma(twice, load(room.f_band, k, p), of_band)
            if has(particles.air):
                of_air = fma(load(particles.air, k, p), twice, of_air)
            kinetic = fma(0.5 * mass, now * now, kinetic)
            put(row, end, velocity, k, now)
        if not has(particles.work):
            external = internal = damping = zeros() + math.nan
        put(row, end, terms, 0, kinetic)
        put(row, end, terms, 1, damping)
        put(row, end, terms, 2, external)
        put(row, end, terms, 3, -internal)
        if has(other):
            air = load(other, 0, p)
            if has(particles.air):
                air = fma(0.5 * duration * load(scratch.pull, 0, i), of_air, air)
            put(row, end, terms, 4, air)
            put(row, end, terms, 5, fma(-0.5 * duration, of_band, load(other, 1, p)))
            put(row, end, terms, 6, support)


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
    pull(x, elements.ends, now.N, now.L, f_int)
    if has(law.branches):
        set_branches(before_dt, dt, law)
        add_branches(x, elements, now, law, f_int, room.f_band.T)
    if has(subject.joints.stiffness):
        bend(x, subject.joints, f_int)
    if has(particles.spring):
        halo, supports = first_split - n_owned, (particles.spring.T, particles.spring_rest.T)
        spring_back(x, particles.x_start.T, *supports, particles.turned.T, f_int)
        spring_energies(0, n_owned, 0, particles, room.sprung)
        spring_energies(first_split, subject.rows[0], halo, particles, room.sprung)


@kernel
def observe(before_dt, dt, zeta, share, whole, subject, room):
    """Fill the room; unless it is to be the whole, of elements the state alone.

    before_dt, dt : [s] the steps before and after; zeta [1/s]; share : place between two samples
    """
    particles, elements, law = subject.particles, subject.elements, subject.law
    find_state(particles.x.T, elements, law, room.now)
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
