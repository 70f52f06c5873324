"""Evaluation of the state at a step n: forces, velocities and both energy checks (paper Eq. 8 to 11).

Nothing here changes the state. The velocity at time n lies within the velocity update of the step; the works
count up to n. All of this is one compiled call, because a call costs about as much as any of its parts. Parts
that only some problems need are separate routines, compiled only if a problem needs them.
"""

import math

import numpy as np

from netfall.core.arrays import FloatArray, IntArray, Integer
from netfall.core.kernels import call, copied_kernel, inner_kernel, kernel, part_of_kernel, routine
from netfall.core.records import Record, f8, f8_2, i8, i8_2, is_present, real, u1, whole
from netfall.core.threads import each, meet, total
from netfall.core.vectors import LANES, fma, load, load_mask, store_below, where, zeros
from netfall.explicit.forces import Scratch
from netfall.explicit.motion import damped_mass, force_along_guides, free_force, total_forces
from netfall.parallel.sums import LIMBS, add_exactly, add_term
from netfall.physics.air import RelativeWind
from netfall.physics.bending import Joints, add_bending_forces, joint_energy
from netfall.physics.elements import (
    ElementState,
    add_axial_forces,
    compute_element_state,
    element_energies_at,
)
from netfall.physics.fields import Elements, Particles, Slots
from netfall.physics.law.branches import add_branches, set_branches
from netfall.physics.law.law import LawParameters
from netfall.physics.particle_step import next_v, works_of_motion
from netfall.physics.slip.motion import SlipPoints, slip_energies
from netfall.physics.supports import add_spring_forces


class ObservedState(Record):
    """Input of `observe` on one rank; fields that the problem lacks are absent.

    n_owned, first_split : particle rows; rows : (1,) number of rows in use; traits : bits of
        `explicit.motion`
    joints : of bending chains; slip_points : of this rank; relative : wind at detached particles
    observe and following : addresses of these routines, 0 for what the problem lacks
    """

    n_owned: whole
    first_split: whole
    rows: i8
    traits: whole
    particles: Particles
    elements: Elements
    slots: Slots
    law: LawParameters
    joints: Joints
    slip_points: SlipPoints
    relative: RelativeWind
    observe: whole
    set_air_forces: whole
    add_rare_forces: whole
    add_rare_energies: whole
    add_slip_energies: whole


class ObservationArrays(Record):
    """Output arrays of `observe`: owned particles in row order, then the particles that split off.

    f_int : (3, n) [N]; velocity : (3, n) [m/s]; now : `ElementState`; heat : (m,) dissipated [J]
    terms : (4 or 7, n) [J] kinetic, damping, external, internal, and OTHER_WORKS; stored : (m,) [J]
    sprung : (n,) [J] in elastic supports; absent if there are none
    attached, attached_elements : (n,), (m,) 1 if connected to a support; absent if nothing can be cut free
    sums : (k, LIMBS) exact sums of this rank: terms, stored, heat, sprung, kinetic and stored energy of the
        attached part, friction of slips
    slack : (3,) number of unbroken slack cables of this rank; work array of threads
    f_branches : (3, n) [N] of the Maxwell branches alone; absent if there are none
    scratch : for a span of particles
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
    f_branches: f8_2
    scratch: Scratch


@copied_kernel
def particle_energies(
    first: int,
    last: int,
    before: int,
    part: float,
    dt_v: float,
    zeta: float,
    share: float,
    observed: ObservedState,
    observation: ObservationArrays,
) -> None:
    """Compute velocity and energy terms of the owned particles first to last; output row = particle - before.

    part : share of the velocity update that comes before n, 1/2 between equal steps
    """
    particles, scratch = observed.particles, observation.scratch
    length = scratch.margin.shape[0] - LANES
    for low in each(first, last, length):
        high = min(low + length, last)
        for k in range(3):
            for p in range(low, high):
                scratch.f[k, p - low] = observation.f_int[k, p]
        total_forces(low, high, 0, dt_v, zeta, share, observed.traits, particles.x, particles, scratch)
        span_energies(low, high, before, part, dt_v, zeta, observed, observation, scratch)


@copied_kernel
def span_energies(
    low: int,
    high: int,
    before: int,
    part: float,
    dt_v: float,
    zeta: float,
    observed: ObservedState,
    observation: ObservationArrays,
    scratch: Scratch,
) -> None:
    """Compute velocity and energy terms of particles low to high, whose forces are in the scratch."""
    particles, velocity, terms = observed.particles, observation.velocity, observation.terms
    h = 0.5 * zeta * dt_v
    c_v, c_a, duration, end = (1.0 - h) / (1.0 + h), dt_v / (1.0 + h), part * dt_v, high - before
    ground, other = is_present(particles.ground), particles.other_work
    for p in range(low, high, LANES):
        i, row, mass = p - low, p - before, load(particles.mass, 0, p)
        per_mass = where(mass > 0.0, 1.0 / mass, zeros())
        kinetic, external, internal, damping, support = zeros(), zeros(), zeros(), zeros(), zeros()
        air_work, band_work = zeros(), zeros()
        along = force_along_guides(p, i, scratch.total, particles)
        if is_present(particles.work):
            external, internal = load(particles.work, 0, p), load(particles.work, 1, p)
            damping = load(particles.work, 2, p)
        if is_present(other):
            support = load(other, 2, p)
        for k in range(3):
            f_int, f_ext, old = load(scratch.f, k, i), load(scratch.external, k, i), load(particles.v, k, p)
            total = free_force(k, p, i, scratch.total, along, particles)
            free = load_mask(particles.free, k, p)
            fixed = load(particles.ground, k, p) if ground else old
            new = where(free, next_v(old, total * per_mass, c_v, c_a), fixed)
            now, mean = fma(part, new - old, old), 0.5 * (old + new)
            path, v_sum = duration * (0.5 * (old + now)), old + now
            damped, f_held = damped_mass(p, particles), f_ext + f_int
            if is_present(particles.air):
                air_work = fma(load(particles.air, k, p), v_sum, air_work)
                f_held = fma(-load(scratch.pull, 0, i), load(particles.air, k, p), f_held)
            external_sum, internal_sum = fma(path, f_ext, external), fma(path, f_int, internal)
            if ground:
                v_ground = load(particles.ground, k, p)
                f_damp, path_rel, dE_kin = works_of_motion(
                    mass, damped, zeta, v_ground, old, now, old + new, duration
                )
                external, internal = external_sum, internal_sum
                damping = where(free, fma(f_damp, path_rel, damping), damping)
                fixed = fma(-path, f_held, dE_kin) + support
                drawn = fma(-f_damp * duration, v_ground, support)
                support = where(free, drawn, fixed)
            else:
                external, internal = where(free, external_sum, external), where(free, internal_sum, internal)
                damping = where(free, fma(path, zeta * damped * mean, damping), damping)
            if is_present(observation.f_branches):
                band_work = fma(v_sum, load(observation.f_branches, k, p), band_work)
            kinetic = fma(0.5 * mass, now * now, kinetic)
            store_below(row, end, velocity, k, now)
        if not is_present(particles.work):
            external = internal = damping = zeros() + math.nan
        store_below(row, end, terms, 0, kinetic)
        store_below(row, end, terms, 1, damping)
        store_below(row, end, terms, 2, external)
        store_below(row, end, terms, 3, -internal)
        if is_present(other):
            air = load(other, 0, p)
            if is_present(particles.air):
                air = fma(0.5 * duration * load(scratch.pull, 0, i), air_work, air)
            store_below(row, end, terms, 4, air)
            store_below(row, end, terms, 5, fma(-0.5 * duration, band_work, load(other, 1, p)))
            store_below(row, end, terms, 6, support)


@inner_kernel
def spring_energies(first: int, last: int, before: int, particles: Particles, energy: FloatArray) -> None:
    """Write the energy [J] in elastic supports of particles first to last; output row = particle - before."""
    x, start, spring, rest = particles.x, particles.x_start, particles.spring, particles.spring_rest
    for p in each(first, last):
        energies = 0.0
        for k in range(3):
            elongation = (x[k, p] - start[k, p]) - rest[k, p]
            energies += spring[k, p] * elongation * elongation
        energy[p - before] = 0.5 * energies
        if is_present(particles.turned):
            elongation, across = (x[0, p] - start[0, p]) - rest[0, p], (x[1, p] - start[1, p]) - rest[1, p]
            energy[p - before] += particles.turned[2, p] * elongation * across


@copied_kernel
def add_attached_energies(
    owned: int, observed: ObservedState, observation: ObservationArrays, limbs: IntArray
) -> None:
    """Mark attached parts, and add their kinetic and stored energies [J] to the fixed-point number in limbs.

    `add_rare_energies` and `add_slip_energies` add the shares of joints, springs and slips.
    owned : number of owned particle rows, which come first
    """
    detached, elements = observed.particles.detached, observed.elements
    for i in each(0, owned):
        p = i if i < observed.n_owned else observed.first_split + i - observed.n_owned
        observation.attached[i] = 1 - detached[p]
    for e in each(0, observation.attached_elements.shape[0]):
        loose = detached[elements.ends[e, 0]] & detached[elements.ends[e, 1]]
        observation.attached_elements[e] = elements.owned[e] & (1 - loose)
    meet()
    add_exactly(observation.terms[0, :owned], observation.attached, limbs)
    add_exactly(observation.stored, observation.attached_elements, limbs)


@routine(whole, ObservedState, ObservationArrays)
def add_rare_energies(owned: int, observed: ObservedState, observation: ObservationArrays) -> int:
    """Add the energies of joints and springs to the sums; owned : number of owned particle rows."""
    joints, sums, detached = observed.joints, observation.sums, observed.particles.detached
    stored = observation.terms.shape[0]
    attached = stored + 2 + int(is_present(observation.sprung))
    for k in range(joints.stiffness.shape[0]):
        if joints.owned[k]:
            energy = joint_energy(observed.particles.x.T, joints, k)
            add_term(energy, sums[stored])
            if is_present(detached) and not detached[joints.particles[k, 1]]:
                add_term(energy, sums[attached])
    if is_present(observation.sprung):
        unmasked = observation.attached[:0]
        add_exactly(observation.sprung[:owned], unmasked, sums[stored + 2])
        if is_present(detached):  # at supports
            add_exactly(observation.sprung[:owned], unmasked, sums[attached])
    return 0


@routine(real, real, real, ObservedState, ObservationArrays)
def add_slip_energies(
    part: float, dt_v: float, share: float, observed: ObservedState, observation: ObservationArrays
) -> int:
    """Add the slip energies of this rank to the sums, and the heat of friction to the last of them."""
    points, particles, sums = observed.slip_points, observed.particles, observation.sums
    previous = np.int64(-1)
    for i in range(points.node.shape[0]):
        kinetic, external, internal, heat = slip_energies(
            i, part, dt_v, share, points, particles, observed.elements, observed.law
        )
        add_term(kinetic, sums[0])
        if is_present(particles.detached) and not particles.detached[points.node[i]]:
            add_term(kinetic, sums[-2])
        if is_present(particles.slip_work):
            p = points.node[i]
            if p != previous:  # once for all cables at the node
                add_term(particles.slip_work[0, p], sums[2])
                add_term(-particles.slip_work[1, p], sums[3])
                add_term(particles.slip_work[2, p], sums[-1])
            previous = p
            add_term(external, sums[2])
            add_term(-internal, sums[3])
            add_term(heat, sums[-1])
    return 0


@copied_kernel
def count_slack(now: ElementState, elements: Elements) -> Integer:
    """Count the unbroken slack cables of this rank."""
    slack = 0
    for e in each(np.uint64(0), np.uint64(now.N.shape[0])):
        intact = (elements.bar[e] == 0) & (elements.broken[e] == 0) & (elements.owned[e] == 1)
        slack += np.int64((now.N[e] == 0.0) & intact)
    return slack


@routine(real, real, ObservedState, ObservationArrays)
def add_rare_forces(
    before_dt: float, dt: float, observed: ObservedState, observation: ObservationArrays
) -> int:
    """Add the forces of branches, joints and springs to f_int; compute f_band and the energy of springs."""
    particles, law, f_int, x = observed.particles, observed.law, observation.f_int.T, observed.particles.x.T
    if is_present(law.branches):
        set_branches(before_dt, dt, law)
        add_branches(x, observed.elements, observation.now, law, f_int, observation.f_branches.T)
    if is_present(observed.joints.stiffness):
        add_bending_forces(x, observed.joints, f_int)
    if is_present(particles.spring):
        supports = particles.spring.T, particles.spring_rest.T
        add_spring_forces(x, particles.x_start.T, *supports, particles.turned.T, f_int)
        for first, last, before in owned_spans(observed):
            spring_energies(first, last, before, particles, observation.sprung)
    return 0


@part_of_kernel
def owned_spans(observed: ObservedState) -> tuple[tuple[Integer, Integer, Integer], ...]:
    """Return first and last owned particle of both spans of rows, and their distance from the output row."""
    n_owned, first_split, zero = observed.n_owned, observed.first_split, np.int64(0)
    return (zero, n_owned, zero), (first_split, observed.rows[0], first_split - n_owned)


@copied_kernel
def sum_axial_forces(x: FloatArray, observed: ObservedState, observation: ObservationArrays) -> None:
    """Compute f_int from the axial forces at x (n, 3) [m]."""
    observation.f_int[:] = 0.0
    now = observation.now
    add_axial_forces(x, observed.elements.ends, now.N, now.L, observation.f_int.T)


@routine(real, real, real, real, whole, ObservedState, ObservationArrays)
def observe(
    before_dt: float,
    dt: float,
    zeta: float,
    share: float,
    with_energies: int,
    observed: ObservedState,
    observation: ObservationArrays,
) -> int:
    """Fill the output arrays; without `with_energies` only the element state and the internal forces.

    before_dt, dt : [s] the steps before and after n; zeta : [1/s]; share : position between two load samples
    """
    particles, elements, law, now = observed.particles, observed.elements, observed.law, observation.now
    x = particles.x[:, : observed.rows[0]].T  # in the layout that Python passes: one compilation serves both
    compute_element_state(x, elements, law, now)
    meet()
    sum_axial_forces(x, observed, observation)
    if observed.add_rare_forces != 0:
        call(observed.add_rare_forces, (before_dt, dt, observed, observation))
    meet()
    if not with_energies:
        return 0
    heat, terms, stored, sums = observation.heat, observation.terms, observation.stored, observation.sums
    owned = observed.n_owned + observed.rows[0] - observed.first_split
    part, dt_v = before_dt / (before_dt + dt), 0.5 * (before_dt + dt)
    if observed.set_air_forces != 0:
        call(observed.set_air_forces, (dt_v, zeta, share, 1, observed.relative, particles))
    for first, last, before in owned_spans(observed):
        particle_energies(first, last, before, part, dt_v, zeta, share, observed, observation)
    for e in each(0, now.N.shape[0]):
        stored[e], heat[e] = element_energies_at(e, elements, now, law)
    for i in range(sums.shape[0]):
        for j in each(0, LIMBS):
            sums[i, j] = 0
    meet()
    last, unmasked = terms.shape[0], elements.owned[:0]
    for k in range(last):
        add_exactly(terms[k, :owned], unmasked, sums[k])
    add_exactly(stored, elements.owned, sums[last])
    add_exactly(heat, elements.owned, sums[last + 1])
    if is_present(particles.detached):
        attached = last + 2 + int(is_present(observation.sprung))
        add_attached_energies(owned, observed, observation, sums[attached])
    if observed.add_rare_energies != 0:
        call(observed.add_rare_energies, (owned, observed, observation))
    if observed.add_slip_energies != 0:
        call(observed.add_slip_energies, (part, dt_v, share, observed, observation))
    observation.slack[0] = total(count_slack(now, elements), observation.slack[1:])
    meet()
    return 0


@kernel
def observe_now(
    before_dt: float,
    dt: float,
    zeta: float,
    share: float,
    observed: ObservedState,
    observation: ObservationArrays,
) -> None:
    """Call `observe` from Python, with energies."""
    call(observed.observe, (before_dt, dt, zeta, share, 1, observed, observation))
