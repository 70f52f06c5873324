"""Cables that slip over nodes in the step: kick and drift of the slip at each place.

With Q of `law`, p the velocity of the slip without friction, and m its inertia:

    p = s'(n-1/2) + dt Q / m,    s'(n+1/2) = sign(p) max(|p| - dt R / m, 0),    s(n+1) = s(n) + dt s'

So what sticks does so exactly: s' = 0. Friction turns m (p - s'(n+1/2)) (s'(n-1/2) + s'(n+1/2)) / 2 into
heat (little may come back in a step in which slip turns). m is the mass of cable at the node, half of either
strand, which also moves with the node; or more where the step needs that: m = INERTIA dt^2 (k_before +
k_after) adds 1/2 to (omega dt)^2 of an element at each of its ends.

The owner of a node decides; s' goes with the forces to the ranks that have the node as halo. All compute
unstressed lengths from the same slips. A broken strand has no tension and keeps its length. A lost one pulls
with what has not faded yet (`varying.FadingLoad`). The weight that goes with slip stays as at the start:
`slip_load` is its pull. Where too little of a strand is left (LEAST) an end on the cable stops it there, and
what was in motion turns to heat; it may run back.
"""

import math
from typing import NamedTuple

import numpy as np

from netfall.ground.compile import kernel, part_of_kernel
from netfall.mechanics.law.element import axial_force, strain
from netfall.mechanics.law.measures import largest_stiffness
from netfall.mechanics.law.slot import TINY
from netfall.mechanics.slip.law import LEAST, angle_between, slip_force, slip_limit
from netfall.numerics.arithmetic import exponential

INERTIA = 2.0
STEP = 0.75**0.5  # of a limit of the step without slip: three quarters of (omega dt)^2 are left to the net


class Places(NamedTuple):
    """Where cables slip over particles of a rank, and the elements that grow longer and shorter by it.

    node, column : (k,) places at particles that it owns, ascending, and which of the cables there
    before, after : (k,) elements on both sides, along the cable
    moving, of : (j,) the same as node, column, with those of the halo; element : (q,) of all of them
    """

    node: np.ndarray
    column: np.ndarray
    before: np.ndarray
    after: np.ndarray
    moving: np.ndarray
    of: np.ndarray
    element: np.ndarray


class Strand(NamedTuple):
    """One side of a place: tension and what is left of that of a lost one [N], a unit vector along the cable.

    whole : whether it has not broken, and so grows longer; there : whether it pulls
    """

    tension: float
    hold: float
    whole: bool
    there: bool
    along: tuple


def places_of(ends, slip_place, slip_along, n_owned: int) -> Places:
    """The places of a rank. ends : (m, 2) particles, owned before halo; the others of `fields.FIELDS`"""
    element, end = np.nonzero(slip_place >= 0)
    node, column = ends[element, end].astype(np.int64), slip_place[element, end].astype(np.int64)
    arrives = (end == 1) == (slip_along[element] > 0)  # the cable runs through it to the node
    order = np.lexsort((~arrives, column, node))
    element, node, column, arrives = (each[order] for each in (element, node, column, arrives))
    moving = np.unique(np.column_stack([node, column]), axis=0)
    own = node < n_owned  # of which all elements are here, in pairs
    before, after = element[own & arrives], element[own & ~arrives]
    return Places(
        node[own & arrives],
        column[own & arrives],
        before,
        after,
        np.ascontiguousarray(moving[:, 0]),
        np.ascontiguousarray(moving[:, 1]),
        np.unique(element),
    )


def slip_inertia(places, EA: np.ndarray, L0: np.ndarray, half: np.ndarray, dt: float) -> np.ndarray:
    """Inertia (k,) [kg] of slips: of the cable at the node, or what steps of up to dt [s] need, if more.

    places : with `before` and `after`, (k,); EA (m,) [N], L0 (m,) [m], half (m,) [kg] of elements
    """
    k = largest_stiffness(EA, L0)
    own, needed = half[places.before] + half[places.after], k[places.before] + k[places.after]
    return np.maximum(own, INERTIA * dt * dt * needed)


@part_of_kernel
def _strand(e, share, particles, elements, law):
    """`Strand` of element e at the present positions; share : of the time between samples of what fades."""
    whole, hold = elements.broken[e] == 0, 0.0
    if elements.hold_before is not None:
        hold = elements.hold_before[e] + share * (elements.hold_after[e] - elements.hold_before[e])
    if not whole and not hold > 0.0:
        return Strand(0.0, 0.0, False, False, (0.0, 0.0, 0.0))
    a, b, x = elements.ends[e, 0], elements.ends[e, 1], particles.x
    dx, dy, dz = x[0][b] - x[0][a], x[1][b] - x[1][a], x[2][b] - x[2][a]
    L = max(math.sqrt(dx * dx + dy * dy + dz * dz), TINY)
    turned = elements.slip_along[e] / L
    T = 0.0
    if whole:
        T, _ = axial_force(elements, e, strain(L, elements.L0[e], law), 0.0)
    return Strand(T, hold, whole, True, (turned * dx, turned * dy, turned * dz))


@part_of_kernel
def _is_short(e, passed, elements):
    """Whether too little is left of element e, out of which `passed` [m] went at the node in question."""
    if elements.broken[e] != 0:
        return passed >= (1.0 - LEAST) * elements.strand[e]
    return elements.L0[e] <= LEAST * elements.strand[e]


@part_of_kernel
def kicked_slip(i, kick_dt, share, places, particles, elements, law):
    """Velocity of slip i half a step on, the same without friction [m/s]; Q of the strands, and besides [N].

    And whether it is kept from going on.
    """
    p, c, b, a = places.node[i], places.column[i], places.before[i], places.after[i]
    old, inertia = particles.slip_v[c][p], particles.slip_mass[c][p]
    before = _strand(b, share, particles, elements, law)
    after = _strand(a, share, particles, elements, law)
    if not before.whole and not after.whole:
        return 0.0, old, 0.0, 0.0, False
    EA_b = elements.EA[b] if before.whole else elements.EA[a]
    EA_a = elements.EA[a] if after.whole else elements.EA[b]
    strands = slip_force(after.tension, EA_a, law) - slip_force(before.tension, EA_b, law)
    besides = slip_force(after.hold, EA_a, law) - slip_force(before.hold, EA_b, law)
    besides += particles.slip_load[c][p]
    mu, turn = particles.friction[c][p], 1.0
    if mu > 0.0 and before.there and after.there:
        u, w = before.along, after.along
        turn = exponential(-mu * angle_between(u[0], u[1], u[2], w[0], w[1], w[2]))
    T_b, T_a = before.tension + before.hold, after.tension + after.hold
    limit = slip_limit(T_b, T_a, EA_b, EA_a, mu, particles.resistance[c][p], turn, law)
    free = old + kick_dt * (strands + besides) / inertia
    left = abs(free) - kick_dt * limit / inertia
    new, passed = 0.0, particles.slip[c][p]
    if left > 0.0:
        new = left if free > 0.0 else -left
    if (new > 0.0 and _is_short(b, passed, elements)) or (new < 0.0 and _is_short(a, -passed, elements)):
        return 0.0, free, strands, besides, True
    return new, free, strands, besides, False


@kernel
def kick_slips(time, kick_dt, share, places, particles, elements, law):
    """Kick of all slips of a rank at a time [s] to n + 1/2, with work and heat. places : `Places`"""
    for i in range(places.node.shape[0]):
        p, c = places.node[i], places.column[i]
        old = particles.slip_v[c][p]
        new, free, strands, besides, locked = kicked_slip(i, kick_dt, share, places, particles, elements, law)
        particles.slip_v[c][p] = new
        if locked and particles.slip_locked[c][p] == 0.0:
            particles.slip_locked[c][p] = max(time, TINY)
        if particles.slip_work is not None:
            external, internal, heat = particles.slip_work
            mean = 0.5 * (old + new)
            external[p] += kick_dt * mean * besides
            internal[p] += kick_dt * mean * strands
            heat[p] += particles.slip_mass[c][p] * (free - new) * mean


@kernel
def drift_slips(dt, places, particles):
    """Slips of a rank, those of its halo too, to n + 1."""
    for j in range(places.moving.shape[0]):
        p, c = places.moving[j], places.of[j]
        particles.slip[c][p] += dt * particles.slip_v[c][p]


@part_of_kernel
def slip_energies(i, part, kick_dt, share, places, particles, elements, law):
    """Kinetic energy of slip i at the very time n, and works on the way there [J]: external, internal, heat.

    part : share of the kick that comes before n
    """
    p, c = places.node[i], places.column[i]
    old, inertia = particles.slip_v[c][p], particles.slip_mass[c][p]
    new, free, strands, besides, _ = kicked_slip(i, kick_dt, share, places, particles, elements, law)
    now, way = old + part * (new - old), part * kick_dt
    mean = 0.5 * (old + now)
    heat = part * inertia * (free - new) * mean
    return 0.5 * inertia * now * now, way * mean * besides, way * mean * strands, heat
