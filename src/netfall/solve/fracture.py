"""Fracture by splitting particles (paper 2.4).

An element whose strain passes eps_u at step n parts, at x(n+1), from the end with the larger resultant force;
from both if they are equal. A new particle takes the place and velocity of the end, half of the element's mass and, if
the step is too long for that alone, some of what the end carried, with its weight (`stability.fragment_mass`); so mass,
momentum and energy stay as they are. It belongs to the rank that owns the element's other end, so a fracture never adds to the halo.

Without fragments the element is taken out of the net at x(n+1): its mass stays with its ends, and what is stored in it counts as dissipated.

Every rank that holds the element decides alike: strain, resultant forces, masses and valences are equal to the bit on
all of them. Mass and valence are those before the step, whatever else parts in it.
"""

import numpy as np

from netfall.mechanics.material import dissipated_by_flow, elastic_force, plastic_force, stored_energy, strain
from netfall.mechanics.stability import ROUNDING, fragment_mass
from netfall.mechanics.state import State
from netfall.net.net import GRAVITY
from netfall.output.result import Event

EQUAL_FORCES = 1e-6  # relative: a symmetric net breaks symmetrically in spite of rounding


def split_number(n: int, element: int, end: int) -> int:
    """Global number of the particle that splits off at an end (0, 1) of an element; n : particles of the net."""
    return n + 2 * element + end


def parting_ends(state: State, e: int) -> tuple[int, ...]:
    """The ends (0, 1) from which element e parts: that with the larger resultant force, or both."""
    force = [float(np.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])) for f in state.f[state.ends[e]]]
    if abs(force[0] - force[1]) <= EQUAL_FORCES * max(force):
        return (0, 1)
    return (0,) if force[0] > force[1] else (1,)


def is_loose(state: State, p: int, e: int) -> bool:
    """Whether the particle is but the end of element e, on no other element and no support, and carries nothing: then there is nothing left to split.

    What it carries (cladding, a weight) falls off with the element that held it, or it would hang on a broken one for ever.
    """
    return (
        state.valence[p] == 1
        and bool(state.free[p].all())
        and bool(state.mass[p] - state.half_mass[e] <= ROUNDING * state.mass[p])
    )


def split_particles(
    state: State,
    count: int,
    step: int,
    n: int,
    element_gid: np.ndarray,
    self_weight: bool,
    carried_weight: bool,
    wind_stays: bool,
    dt: float,
    stable_dt: float,
) -> list[Event]:
    """Part the `count` elements in state.pending; the events at particles that this rank owns.

    n : particles of the net; self_weight, carried_weight : whether the elements' own mass and what the particles carry have weight
    dt : [s] length of the step that was taken since x(n), for the strain that is reported; stable_dt : [s] for which fragments are stable
    """
    elements = sorted(state.pending[:count].tolist())
    decisions = [
        (e, [(end, is_loose(state, state.ends[e, end], e)) for end in parting_ends(state, e)])
        for e in elements
    ]
    state.reserve(2 * count)
    events = []
    for e, parting in decisions:
        ends = state.ends[e].copy()
        strain = _strain_before(state, e, dt)
        state.broken[e] = 1
        state.eps_u[e] = np.inf
        split = [end for end, loose in parting if not loose]
        mass = fragment_mass(state.EA[e], state.L0[e], state.half_mass[e], stable_dt)
        weight = GRAVITY * (state.half_mass[e] * self_weight + (mass - state.half_mass[e]) * carried_weight)
        # the rank that keeps the element: the owner of the end that holds on; of its start if none does
        keeper = ends[1 - split[0]] if len(split) == 1 else ends[0]
        kept = state.own(keeper)
        for end, loose in parting:
            p = int(ends[end])
            number = -1 if loose else split_number(n, int(element_gid[e]), end)
            if not loose:
                if state.own(p):
                    _take_off(state, p, mass, weight)
                if kept:
                    state.ends[e, end] = _new_particle(state, p, number, mass, weight)
            if state.own(p):
                if state.wind is not None and not wind_stays:
                    state.wind[p] = 0.0
                events.append(
                    Event(
                        step,
                        int(element_gid[e]),
                        int(state.gid[p]),
                        number,
                        strain,
                        0.0 if loose else float(mass),
                    )
                )
        if split:
            state.owned[e] = kept
            if not kept:
                state.EA[e] = 0.0  # it lives on the keeper's rank alone from here on
    return events


def take_out(
    state: State, count: int, step: int, element_gid: np.ndarray, wind_stays: bool, dt: float
) -> list[Event]:
    """Take the `count` elements in state.pending out of the net; the events at particles that this rank owns. Arguments as of `split_particles`."""
    elements = sorted(state.pending[:count].tolist())
    decisions = [(e, parting_ends(state, e)) for e in elements]
    events = []
    for e, parting in decisions:
        before = _strain_before(state, e, dt)
        _dissipate(state, e, dt)
        state.broken[e], state.eps_u[e], state.EA[e] = 1, np.inf, 0.0
        state.empty_slots(e)
        for end, p in enumerate(state.ends[e].tolist()):
            if not state.own(p):
                continue
            state.valence[p] -= 1
            if end in parting:
                if state.wind is not None and not wind_stays:
                    state.wind[p] = 0.0
                events.append(Event(step, int(element_gid[e]), int(state.gid[p]), -1, before, 0.0))
    return events


def _dissipate(state: State, e: int, dt: float) -> None:
    """Count the energy that is stored in element e as dissipated: that half a drift ago, up to where its forces have done work."""
    a, b = state.ends[e]
    d = (state.x[b] - 0.5 * dt * state.v[b]) - (state.x[a] - 0.5 * dt * state.v[a])
    EA, L0, logarithmic, bar = (
        float(state.EA[e]),
        float(state.L0[e]),
        state.scene.logarithmic,
        bool(state.bar[e]),
    )
    eps = strain.py_func(float(np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])), L0, logarithmic)
    if state.yield_force is None:
        N, eps_p = elastic_force.py_func(eps, EA, bar), 0.0
    else:
        eps_p, limit = float(state.eps_p[e]), float(state.yield_force[e])
        N, flowed = plastic_force.py_func(eps, eps_p, EA, limit, bar)
        state.dissipated[e] += dissipated_by_flow.py_func(eps_p, flowed, L0, EA, limit, logarithmic)
        state.eps_p[e] = eps_p = flowed
    state.dissipated[e] += stored_energy.py_func(N, eps_p, L0, EA, logarithmic)


def _strain_before(state: State, e: int, dt: float) -> float:
    """Strain of element e at x(n), one drift ago."""
    a, b = state.ends[e]
    d = (state.x[b] - dt * state.v[b]) - (state.x[a] - dt * state.v[a])
    L = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    return float(np.log(L / state.L0[e]) if state.scene.logarithmic else (L - state.L0[e]) / state.L0[e])


def _take_off(state: State, p: int, mass: float, weight: float) -> None:
    """Take a fragment's mass [kg] and weight [N] off particle p."""
    state.valence[p] -= 1
    state.mass[p] -= mass
    state.load[p, 2] += weight
    if state.valence[p] == 0 and state.mass[p] < 1e-9 * mass:
        state.mass[p] = 0.0  # nothing was carried: what is left is rounding


def _new_particle(state: State, p: int, number: int, mass: float, weight: float) -> int:
    """Local row of the particle that takes a fragment's mass [kg] and weight [N] off particle p."""
    j = state.n_local
    state.n_local += 1
    state.x[j], state.v[j], state.x_start[j] = state.x[p], state.v[p], state.x_start[p]
    if state.u is not None:
        state.u[j] = state.u[p]
    state.free[j], state.valence[j], state.gid[j], state.mass[j] = 1, 1, number, mass
    state.load[j] = (0.0, 0.0, -weight)
    if state.work is not None:
        state.work[j] = 0.0
    if state.block_work is not None:
        state.block_work[j] = 0.0
    if state.wind is not None:
        state.wind[j] = state.speed_before[j] = state.speed_after[j] = 0.0
    return j
