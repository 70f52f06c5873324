"""Fracture by splitting particles (paper 2.4).

An element whose strain passes eps_u at step n breaks, at x(n+1), at the end with the larger resultant force;
at both if they are equal. A new particle takes the place and velocity of the end, half of the element's mass
and, if the step is too long for that alone, some of what the end carried, with its weight
(`stability.fragment_mass`); so mass, momentum and energy stay as they are. It belongs to the rank that owns
the element's other end, so a fracture never adds to the halo.

Without fragments the element is taken out of the net at x(n+1): its mass stays with its ends, and what is
stored in it counts as dissipated.

Every rank that holds the element decides alike: strain, resultant forces, masses and valences are equal to
the bit on all of them. Mass and valence are those before the step, whatever else breaks in it.
"""

from typing import NamedTuple

import numpy as np

from netfall.mechanics.events import Event
from netfall.mechanics.material import energies_at, strains
from netfall.mechanics.stability import ROUNDING, fragment_mass
from netfall.mechanics.state import State

EQUAL_FORCES = 1e-6  # relative: a symmetric net breaks symmetrically in spite of rounding


class FractureRules(NamedTuple):
    """What holds for every fracture of a run.

    particles : of the net; element_gid : (m,) global numbers of the rank's elements
    gravity : [m/s2]; own_weighs, carried_weighs : whether it acts on the elements' own mass, on what is
        carried
    wind_stays : whether a particle keeps its wind when an element leaves it
    dt : [s] length of a step; stable_dt : [s] for which fragments are stable
    """

    particles: int
    element_gid: np.ndarray
    gravity: float
    own_weighs: bool
    carried_weighs: bool
    wind_stays: bool
    dt: float
    stable_dt: float


def break_elements(state: State, count: int, step: int, rules: FractureRules) -> list[Event]:
    """Break the `count` elements in state.pending, after step `step`; the events at particles of this rank.

    The elements' slots are not touched: `plan.Plan` brings them up to date.
    """
    elements = sorted(state.pending[:count].tolist())
    breaking = [(e, ends_that_break(state, e)) for e in elements]
    if not state.features.fragments:
        return [event for e, ends in breaking for event in take_out(state, e, ends, step, rules)]
    decisions = [(e, [(end, is_loose(state, state.ends[e, end], e)) for end in ends]) for e, ends in breaking]
    state.reserve(2 * count)
    return [event for e, ends in decisions for event in split_particles(state, e, ends, step, rules)]


def split_number(particles: int, element: int, end: int) -> int:
    """Global number of the particle that splits off at an end (0, 1) of an element of a net of so many."""
    return particles + 2 * element + end


def ends_that_break(state: State, e: int) -> tuple[int, ...]:
    """The ends (0, 1) at which element e breaks: that with the larger resultant force, or both."""
    force = [float(np.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])) for f in state.f[state.ends[e]]]
    if abs(force[0] - force[1]) <= EQUAL_FORCES * max(force):
        return (0, 1)
    return (0,) if force[0] > force[1] else (1,)


def is_loose(state: State, p: int, e: int) -> bool:
    """Whether the particle is but the end of element e, carries nothing, and so leaves nothing to split.

    It is on no other element and no support. What it carries (cladding, a weight) falls off with the element
    that held it, or it would hang on a broken one for ever.
    """
    sprung = state.features.springs and bool(state.spring[p].any())
    alone = state.valence[p] == 1 and bool(state.free[p].all()) and not sprung
    return alone and bool(state.mass[p] - state.half_mass[e] <= ROUNDING * state.mass[p])


def split_particles(state: State, e: int, ends: list[tuple[int, bool]], step: int, rules: FractureRules):
    """The events at particles of this rank where element e breaks at some ends (end, whether it is loose)."""
    particles, gid = state.ends[e].copy(), int(rules.element_gid[e])
    before = _strain_before(state, e, rules.dt)
    state.broken[e], state.eps_u[e] = 1, np.inf
    split = [end for end, loose in ends if not loose]
    half = state.half_mass[e]
    mass = fragment_mass(state.EA[e], state.L0[e], half, rules.stable_dt)
    weight = rules.gravity * (half * rules.own_weighs + (mass - half) * rules.carried_weighs)
    # the rank that keeps the element: the owner of the end that holds on; of its start if none does
    keeper = particles[1 - split[0]] if len(split) == 1 else particles[0]
    kept = state.own(keeper)
    events = []
    for end, loose in ends:
        p = int(particles[end])
        number = -1 if loose else split_number(rules.particles, gid, end)
        if not loose:
            if state.own(p):
                _take_off(state, p, mass, weight)
            if kept:
                state.ends[e, end] = _new_particle(state, p, number, mass, weight)
        if state.own(p):
            _lose_wind(state, p, rules)
            taken = 0.0 if loose else float(mass)
            events.append(Event(step * rules.dt, step, gid, int(state.gid[p]), number, before, taken))
    if split:
        state.owned[e] = kept
        if not kept:
            state.EA[e] = 0.0  # it lives on the keeper's rank alone from here on
    return events


def take_out(state: State, e: int, ends: tuple[int, ...], step: int, rules: FractureRules) -> list[Event]:
    """The events at particles of this rank where element e, which breaks at some ends, is taken out."""
    before, gid = _strain_before(state, e, rules.dt), int(rules.element_gid[e])
    dissipate(state, e, rules.dt)
    state.broken[e], state.eps_u[e], state.EA[e] = 1, np.inf, 0.0
    events = []
    for end, p in enumerate(state.ends[e].tolist()):
        if not state.own(p):
            continue
        state.valence[p] -= 1
        if end in ends:
            _lose_wind(state, p, rules)
            events.append(Event(step * rules.dt, step, gid, int(state.gid[p]), -1, before, 0.0))
    return events


def _lose_wind(state: State, p: int, rules: FractureRules) -> None:
    if state.wind is not None and not rules.wind_stays:
        state.wind[p] = 0.0


def dissipate(state: State, e: int, dt: float) -> None:
    """Count what is stored in element e as dissipated: up to half a drift ago, where its forces worked."""
    elements, law = state.elements, state.law
    L = _length_before(state, e, 0.5 * dt)
    eps_p = 0.0 if state.eps_p is None else float(state.eps_p[e])
    now, heat, stored = energies_at(elements, e, float(L), eps_p, law)
    if state.eps_p is not None:
        state.dissipated[e] += heat
        state.eps_p[e] = now
    state.dissipated[e] += stored


def _strain_before(state: State, e: int, dt: float) -> float:
    """Strain of element e at x(n), one drift ago."""
    return float(strains(_length_before(state, e, dt), state.L0[e], state.features.strain))


def _length_before(state: State, e: int, time: float) -> float:
    """Length [m] of element e a time [s] ago, on the present velocities."""
    a, b = state.ends[e]
    d = (state.x[b] - time * state.v[b]) - (state.x[a] - time * state.v[a])
    return np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])


def _take_off(state: State, p: int, mass: float, weight: float) -> None:
    """Take a fragment's mass [kg] and weight [N] off particle p."""
    state.valence[p] -= 1
    state.mass[p] -= mass
    state.load[p, 2] += weight
    if state.valence[p] == 0 and state.mass[p] < 1e-9 * mass:
        state.mass[p] = 0.0  # nothing was carried: what is left is rounding


def _new_particle(state: State, p: int, number: int, mass: float, weight: float) -> int:
    """Local row of the particle that takes a fragment's mass [kg] and weight [N] off particle p."""
    row = state.add_particle(p)
    state.gid[row], state.mass[row], state.load[row, 2] = number, mass, -weight
    return row
