"""Fracture by splitting particles (paper 2.4).

An element whose strain exceeds eps_u at step n breaks, at x(n+1), at the end with the larger resultant force.
It breaks at both ends if these are equal. A bar that may buckle also breaks if its strain falls below
eps_c < 0. A new particle gets the position and velocity of the end, and half of the element's mass and ice.
If the step is too long for that mass alone, it also takes some of the mass and weight that the end carried
(`stability.fragment_mass`). So mass, momentum and energy do not change. It belongs to the rank that owns the
element's other end, so a fracture never extends the halo.

A fragment that does not yield first has the same strength. If its strain exceeds eps_u again, it grows longer
until its strain is eps_u, like an element that yields; the released energy counts as dissipated. So it
exceeds its strength by the overshoot of one time step at most.

Without fragments the element is removed at x(n+1). Its mass stays with its ends, and its stored energy counts
as dissipated.

Every rank that holds the element decides alike: strain, resultant forces, masses and valences are equal to
the bit on all of them. Mass and valence are those before the step, whatever other elements break in it,
because all decisions (`choose_ends`) precede all splits.

All of this is compiled and called by the time loop (`explicit/fracture.py`), which then updates slots and
chunks.
"""

import math

import numpy as np

from netfall.core.arrays import IntArray, Integer
from netfall.core.kernels import inner_kernel, kernel, routine
from netfall.core.records import Record, i8, is_present, real, whole
from netfall.physics.air import damped_mass, remove_air
from netfall.physics.events import Events, FractureStep, add_event
from netfall.physics.fields import Elements, Particles
from netfall.physics.law.element import energies_at, strain, unstressed_length_at
from netfall.physics.law.law import LawParameters
from netfall.physics.particle_step import inverse_mass
from netfall.physics.slip.law import passed_length
from netfall.physics.stability import CARRIED_TOLERANCE, fragment_mass

STRAIN_MARGIN = 1e-9  # relative to the fracture strain; larger than the rounding error of a strain
EQUAL_FORCES = 1e-6  # relative; a symmetric net breaks symmetrically in spite of rounding
LOOSE_SHIFT = 2  # bit shift in `Elements.breaks`: bits 0, 1: the end breaks; shifted: it is loose


class FractureRules(Record):
    """Parameters common to all fractures of a run.

    particles : number in the net; n_owned, first_split : local rows up to and from which this rank owns
        particles
    element_gid : (m,) global numbers of the rank's elements
    gravity : [m/s2]; own_weighs, carried_weighs : whether it acts on the elements' own mass, on carried mass
    wind_stays : whether a particle keeps its wind when an element leaves it
    stable_dt : [s] for which fragments are stable; nan: without fragments
    zeta : [1/s] mass-proportional damping
    """

    particles: whole
    n_owned: whole
    first_split: whole
    element_gid: i8
    gravity: real
    own_weighs: whole
    carried_weighs: whole
    wind_stays: whole
    stable_dt: real
    zeta: real


class Fractures(Record):
    """Arrays that fractures change in addition to elements: particles, rows in use (1,), the event log.

    break_element : address of `split_particles`, or `remove_broken_element` without fragments
    """

    rules: FractureRules
    particles: Particles
    rows: i8
    events: Events
    break_element: whole


@inner_kernel
def owns(p: Integer, rules: FractureRules) -> bool:
    """Return whether this rank owns the particle in local row p."""
    return p < rules.n_owned or p >= rules.first_split


@inner_kernel
def choose_ends(e: Integer, zeta: float, elements: Elements, particles: Particles) -> None:
    """Write to `elements.breaks` at which ends element e breaks, and which of them are loose.

    It breaks at the end with the larger resultant force, or at both if these are equal. zeta : [1/s]
    """
    start = resultant(elements.ends[e, 0], zeta, particles)
    end = resultant(elements.ends[e, 1], zeta, particles)
    breaks = 1 if start > end else 2
    if abs(start - end) <= EQUAL_FORCES * max(start, end):
        breaks = 3
    for k in range(2):
        if breaks >> k & 1 and is_loose(elements.ends[e, k], e, elements, particles):
            breaks |= 1 << (LOOSE_SHIFT + k)
    elements.breaks[e] = breaks


@inner_kernel
def resultant(p: int, zeta: float, particles: Particles) -> float:
    """Return the magnitude [N] of the total force on particle p, without mass-proportional damping.

    `Particles.f` has parts of it, of moving supports and of the added mass of the air (`explicit.motion`).
    """
    square = 0.0
    for k in range(3):
        f = particles.f[k, p]
        if is_present(particles.air_mass):
            f -= zeta * particles.air_mass[p] * particles.v[k, p]
        if is_present(particles.ground) and particles.free[k, p]:
            f -= zeta * damped_mass(p, particles) * particles.ground[k, p]
        square += f * f
    return math.sqrt(square)


@inner_kernel
def is_loose(p: int, e: int, elements: Elements, particles: Particles) -> bool:
    """Return whether particle p is only the end of element e, without attached mass, so that it cannot split.

    It has no other element, no support, no load, and no mass but the element's. If it carries mass (cladding,
    a weight), it is not loose: the element splits off, and the carried mass falls alone. So does a load.
    """
    for k in range(3):
        if not particles.free[k, p]:
            return False
        if is_present(particles.spring) and particles.spring[k, p] != 0.0:
            return False
    if is_present(particles.turned) and (particles.turned[0, p] != 0.0 or particles.turned[1, p] != 0.0):
        return False
    if particles.loaded[p]:
        return False
    mass, half = damped_mass(p, particles), elements.half_mass[e] + ice_at(e, elements)
    return particles.valence[p] == 1 and mass - half <= CARRIED_TOLERANCE * mass


@inner_kernel
def ice_at(e: Integer, elements: Elements) -> float:
    """Return half of the ice [kg] on element e."""
    half = 0.0
    if is_present(elements.half_ice):
        half = elements.half_ice[e]
    return half


@routine(whole, real, whole, real, Elements, LawParameters, Fractures)
def split_particles(
    e: int, time: float, step: int, dt: float, elements: Elements, law: LawParameters, fractures: Fractures
) -> int:
    """Replace the ends at which element e breaks by new particles, except loose ends.

    time, step, dt : of `events.FractureStep`

    The particle that splits off at end 0 or 1 has the global number particles + 2 element + end. Slots are
    not changed here; they follow from the element's new ends and EA (`explicit/fracture.py`).
    """
    when = FractureStep(time, step, dt)
    rules, particles = fractures.rules, fractures.particles
    rows, events = fractures.rows, fractures.events
    breaks, gid = np.int64(elements.breaks[e]), rules.element_gid[e]
    a, b = np.int64(elements.ends[e, 0]), np.int64(elements.ends[e, 1])
    strain_at_fracture = strain_before(e, when.dt, elements, particles, law)
    elements.broken[e] = 1
    if is_present(elements.eps_c):
        elements.eps_c[e] = -np.inf
    if is_present(elements.yield_force):
        keep_first_limit(e, elements)
    half, ice, at_split = elements.half_mass[e], ice_at(e, elements), breaks & 3 & ~(breaks >> LOOSE_SHIFT)
    mass = fragment_mass(elements.EA[e], elements.L0[e], half + ice, rules.stable_dt)
    carried = (mass - half) - ice
    weight = rules.gravity * (half * rules.own_weighs + ice + carried * rules.carried_weighs)
    # the owner of the end that stays attached keeps the element; if none does, that of its start
    keeps_element = owns(b if at_split == 1 else a, rules)
    for end in range(2):
        if not breaks >> end & 1:
            continue
        p, number, taken_mass = a if end == 0 else b, np.int64(-1), 0.0
        if owns(p, rules):
            remove_wind_at(p, rules, particles)
        if at_split >> end & 1:
            number, taken_mass = np.int64(rules.particles + 2 * gid + end), mass
            if keeps_element:
                elements.ends[e, end] = new_particle(p, number, mass, weight, particles, rows)
            if owns(p, rules):
                subtract_fragment(p, mass, weight, particles)
        if owns(p, rules):
            add_event(events, when, gid, particles.gid[p], number, strain_at_fracture, taken_mass)
    if at_split:
        elements.owned[e] = keeps_element
        if not keeps_element:
            elements.EA[e] = 0.0  # only the other rank computes it from now on
    return 0


@inner_kernel
def keep_first_limit(e: int, elements: Elements) -> None:
    """Keep only the limit that the rest of element e reaches first, yield or fracture.

    A bar always yields: it may have yielded in compression.
    """
    limit, strength = elements.yield_force[e], elements.EA[e] * elements.eps_u[e]
    if limit > strength and not elements.bar[e] and is_present(elements.yield_strain):
        elements.yield_force[e] = elements.yield_strain[e] = np.inf
    elif limit < np.inf:
        elements.eps_u[e] = np.inf
        if is_present(elements.check_stretch):
            elements.check_stretch[e] = np.inf


@inner_kernel
def lengthen_fragment(
    e: Integer, dt: float, elements: Elements, particles: Particles, law: LawParameters
) -> None:
    """Lengthen fragment e, strained beyond its strength, until its strain equals the fracture strain.

    The released energy, at the length where its forces did work, counts as dissipated. The strain stays above
    eps_u by the relative STRAIN_MARGIN, so that the next step checks the fragment again however eps_u is
    rounded.
    dt : [s], of the step
    """
    L, eps_u = length_before(e, 0.0, elements, particles), elements.eps_u[e]
    if strain(L, elements.L0[e], law) <= eps_u:
        return
    L_work, eps_p = length_before(e, 0.5 * dt, elements, particles), 0.0
    if is_present(elements.eps_p):
        eps_p = elements.eps_p[e]
    _, _, before = energies_at(elements, e, L_work, eps_p, law)
    elements.L0[e] = max(elements.L0[e], unstressed_length_at(L, eps_u * (1.0 + STRAIN_MARGIN), law))
    _, _, after = energies_at(elements, e, L_work, eps_p, law)
    elements.dissipated[e] += before - after


@routine(whole, real, whole, real, Elements, LawParameters, Fractures)
def remove_broken_element(
    e: int, time: float, step: int, dt: float, elements: Elements, law: LawParameters, fractures: Fractures
) -> int:
    """Remove element e, which breaks without fragments; its stored energy counts as dissipated."""
    when = FractureStep(time, step, dt)
    rules, particles, events = fractures.rules, fractures.particles, fractures.events
    strain_at_fracture = strain_before(e, when.dt, elements, particles, law)
    dissipate_stored(e, when.dt, elements, particles, law)
    elements.broken[e], elements.eps_u[e], elements.EA[e] = 1, np.inf, 0.0
    if is_present(elements.eps_c):
        elements.eps_c[e] = -np.inf
    for end in range(2):
        p = np.int64(elements.ends[e, end])
        if not owns(p, rules):
            continue
        particles.valence[p] -= 1
        if elements.breaks[e] >> end & 1:
            remove_wind_at(p, rules, particles)
            add_event(
                events, when, rules.element_gid[e], particles.gid[p], np.int64(-1), strain_at_fracture, 0.0
            )
    return 0


@inner_kernel
def remove_wind_at(p: Integer, rules: FractureRules, particles: Particles) -> None:
    """Remove the wind and air effects of particle p after a fracture, unless the wind stays."""
    if is_present(particles.wind) and not rules.wind_stays:
        particles.wind[0, p] = particles.wind[1, p] = particles.wind[2, p] = 0.0
        remove_air(p, particles)


@kernel
def dissipate_stored(e: int, dt: float, elements: Elements, particles: Particles, law: LawParameters) -> None:
    """Count the energy stored in element e as dissipated.

    It is that of half a position update ago, where the forces of the element did work.
    """
    L = length_before(e, 0.5 * dt, elements, particles)
    eps_p = 0.0
    if is_present(elements.eps_p):
        eps_p = elements.eps_p[e]
    L0, elements.L0[e] = elements.L0[e], unstressed_before(e, 0.5 * dt, elements, particles)
    new_eps_p, heat, stored = energies_at(elements, e, L, eps_p, law)
    elements.L0[e] = L0
    if is_present(elements.eps_p):
        elements.dissipated[e] += heat
        elements.eps_p[e] = new_eps_p
    elements.dissipated[e] += stored


@inner_kernel
def length_before(e: int, time: float, elements: Elements, particles: Particles) -> float:
    """Return the length [m] of element e a time [s] ago, extrapolated with the present velocities."""
    a, b, x, v = elements.ends[e, 0], elements.ends[e, 1], particles.x, particles.v
    dx = (x[0, b] - time * v[0, b]) - (x[0, a] - time * v[0, a])
    dy = (x[1, b] - time * v[1, b]) - (x[1, a] - time * v[1, a])
    dz = (x[2, b] - time * v[2, b]) - (x[2, a] - time * v[2, a])
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@inner_kernel
def unstressed_before(e: int, time: float, elements: Elements, particles: Particles) -> float:
    """Return the unstressed length [m] of element e a time [s] ago, from the present slip velocities."""
    L0 = elements.L0[e]
    if is_present(elements.slip_place) and is_present(particles.slip_v):
        L0 -= time * elements.slip_share[e] * passed_length(e, particles.slip_v, elements)
    return L0


@inner_kernel
def strain_before(e: int, time: float, elements: Elements, particles: Particles, law: LawParameters) -> float:
    """Return the strain of element e a time [s] ago, from the present velocities."""
    L = length_before(e, time, elements, particles)
    return strain(L, unstressed_before(e, time, elements, particles), law)


@inner_kernel
def subtract_fragment(p: Integer, mass: float, weight: float, particles: Particles) -> None:
    """Subtract a fragment's mass [kg] and weight [N] from particle p."""
    particles.valence[p] -= 1
    particles.mass[p] -= mass
    particles.load[2, p] += weight
    if particles.valence[p] == 0 and particles.mass[p] < 1e-9 * mass:
        particles.mass[p] = 0.0  # it carried nothing: the remainder is rounding error
        for k in range(3):  # a load on a particle without mass has no effect
            if particles.free[k, p]:
                particles.v[k, p] = 0.0
    if particles.per_mass[p] != 0.0:
        particles.per_mass[p] = inverse_mass(particles.mass[p])


@inner_kernel
def new_particle(
    p: Integer, number: Integer, mass: float, weight: float, particles: Particles, rows: IntArray
) -> int:
    """Create the particle with a fragment's mass [kg] and weight [N] at particle p; return its local row.

    Other fields have the values that `State` sets in unused rows.
    """
    row = rows[0]
    rows[0] += 1
    for k in range(3):
        particles.x[k, row], particles.v[k, row] = particles.x[k, p], particles.v[k, p]
        particles.x_start[k, row] = particles.x_start[k, p]
    if is_present(particles.course):
        particles.course[row] = particles.course[p]
        for k in range(3):
            particles.ground[k, row] = 0.0  # `move_ground` sets it in each step, also in unused rows
    particles.gid[row], particles.mass[row], particles.load[2, row] = number, mass, -weight
    particles.per_mass[row] = inverse_mass(mass)
    return row
