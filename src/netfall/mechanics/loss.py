"""Loss of members: elements that leave the net at a given time, whatever their strain.

An element's stiffness is gone from a step on; its mass stays with its ends. What is stored in it counts as
dissipated, as where one is taken out at a fracture (`fracture.take_out`). Particles that held nothing but
lost elements leave with them: they stand still where they were, without mass and load. Their kinetic energy
counts as negative external work, as that of cladding that tears off.

Those inside a removed cable first give mass, momentum, loads and wind to others (`model.redistribution`).
Mass that joins a particle takes one velocity with it, as in a plastic impact. The kinetic energy that this
costs is in the same work, which is so the difference between the kinetic energies.
"""

from typing import NamedTuple

import numpy as np

from netfall.mechanics.air import rooted, squared
from netfall.mechanics.fracture import dissipate
from netfall.mechanics.state import State
from netfall.mechanics.supports import keep_on_guides

EXTERNAL, INTERNAL = 0, 1  # columns of the works of forces


def lose_elements(state: State, elements: np.ndarray, since: np.ndarray) -> None:
    """Take elements, local rows (k,), out of the net; `plan.Plan.attach` is due after it.

    since : (k,) [s] before now at which each stopped acting
    Every rank that holds one decides alike.
    """
    of_all, law = state.of_a_moment
    for e, time in zip(elements.tolist(), since.tolist()):
        if state.EA[e] > 0.0:  # else another rank has kept it when it broke, or it had been taken out
            dissipate(e, 2.0 * time, of_all, state.particles, law)
            _let_go(state, e)
        state.EA[e], state.lost[e], state.broken[e] = 0.0, 1, 1
        if state.eps_u is not None:
            state.eps_u[e] = np.inf


def push(state: State, particles: np.ndarray, impulse: np.ndarray, work: int) -> None:
    """Give particles, local rows (k,), impulses (k, 3) [N s] in this order. work : EXTERNAL or INTERNAL"""
    for p, given in zip(particles.tolist(), impulse):
        if state.mass[p] > 0.0:
            before = _motion(state, p)
            state.v[p] += np.where(state.free[p], given / state.mass[p], 0.0)
            if state.turned is not None:
                keep_on_guides(state.turned[p : p + 1], state.v[p : p + 1])
            if state.work is not None and state.own(p):
                state.work[p, work] += _motion(state, p) - before


def leave(state: State, particles: np.ndarray) -> None:
    """Particles, local rows (k,), leave the net."""
    for p in particles.tolist():
        if state.work is not None and state.own(p):
            state.work[p, 0] -= _motion(state, p)
        state.mass[p] = 0.0
        state.v[p] = state.load[p] = 0.0
        if state.wind is not None:
            state.wind[p] = 0.0
        if state.air is not None:
            state.air[p] = 0.0
        if state.air_mass is not None:
            state.air_mass[p] = 0.0
        if state.drag is not None:
            state.drag[p] = state.drag_size[p] = 0.0


class Carried(NamedTuple):
    """What particles that leave carry: mass (k,) [kg]; v [m/s], load [N], wind (or None) of (k, 3).

    air, air_mass, drag_size : as in the state, None: there is none
    """

    mass: np.ndarray
    v: np.ndarray
    load: np.ndarray
    wind: np.ndarray | None
    air: np.ndarray | None
    air_mass: np.ndarray | None
    drag_size: np.ndarray | None


def join(state: State, particles: np.ndarray, source: np.ndarray, share: np.ndarray, given: Carried) -> None:
    """Particles, local rows (s,), take shares (s,) of what the rows `source` (s,) of those that leave carry.

    Every rank that holds one of them computes the same, in the order of the rows.
    """
    taken = share * given.mass[source]
    for p in dict.fromkeys(particles.tolist()):
        here = np.flatnonzero(particles == p)
        before, momentum = _motion(state, p), state.mass[p] * state.v[p]
        for k in here.tolist():
            momentum += taken[k] * given.v[source[k]]
            state.mass[p] += taken[k]
            state.load[p] += share[k] * given.load[source[k]]
            if state.wind is not None:
                state.wind[p] += share[k] * given.wind[source[k]]
            if state.air is not None:
                state.air[p] = rooted(squared(state.air[p]) + share[k] * squared(given.air[source[k]]))
            if state.air_mass is not None:
                state.air_mass[p] += share[k] * given.air_mass[source[k]]
            if state.drag_size is not None:
                state.drag_size[p] += share[k] * given.drag_size[source[k]]
        if state.mass[p] > 0.0:
            after = momentum / state.mass[p]
            state.v[p] = np.where(state.free[p], after, state.v[p])  # a support takes the rest
            if state.turned is not None:
                keep_on_guides(state.turned[p : p + 1], state.v[p : p + 1])
        if state.work is not None and state.own(p):
            state.work[p, 0] += _motion(state, p) - before


def _motion(state: State, p: int) -> float:
    """Kinetic energy [J] of a particle."""
    return 0.5 * state.mass[p] * float(np.sum(state.v[p] ** 2))


def _let_go(state: State, e: int) -> None:
    """The ends of element e hold it no more; those that split off from the net with it leave."""
    for p in state.ends[e].tolist():
        if state.valence is not None:
            state.valence[p] -= 1
        if p >= state.first_split:
            leave(state, np.array([p]))
