"""Law of a slip point (clamp, saddle or pulley at a node), and the inertia that the step adds to slips.

The law serves the step and equilibria.

Each node and sliding cable has a coordinate s: the length that has passed, positive in the direction of the
cable. The free segment from slip point a to b has L0 = L0(0) + s_a - s_b, and each of its elements a constant
share w of that (`geometry.slip_points`). The force on s is minus the derivative of the strain energy:

    Q = sum w q(T) after it - sum w q(T) before it,   q = T + T^2 / (2 EA),
    or EA (exp(T / EA) - 1) in logarithmic strain

Without friction, q less the potential of the weight is constant along a cable that hangs freely, so the sums
equal the values at the slip point itself. A slip point sticks while |Q| is within its limit R, and slips at
R. With the larger tension T and the smaller tension t of both sides:

    saddle:  R = q(T) - q(T exp(-mu theta))      theta: angle between both directions (Euler, Eytelwein)
    clamp:   R = q(t + resistance) - q(t)        both: the sum, with T - resistance on the saddle

A segment with a broken or removed element carries nothing, and its unstressed length stays constant.

If cables do not stretch, a slip follows the nodes on one side of its slip point. With the unit vectors t and
t' of the cable before and after a node, and the velocity v of the node:

    s'(i) = t v(i) - sum over the nodes k before i of (t - t')(k) v(k),    likewise from the other side

Hence the added inertia a(i) has at most lambda times the kinetic energy of the net. The rows i of a matrix
are these vectors, times the root of a(i) / m(k). Lambda is the largest sum over a row of its entries times
the sums of their columns (Schur's test for the norm of a matrix). Slip is slower by at most lambda.

All rows use the side before, then all the side after, and the larger lambda counts: a segment may tear, or
stretch between fixed nodes. A row uses s'(i) itself with the inertia of the cable there, if that is less, or
if the cable is closed. Positions are those at the start.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from netfall.core.arithmetic import exponential
from netfall.core.arrays import FloatArray, IntArray
from netfall.core.functions import lengths
from netfall.core.kernels import inner_kernel, kernel
from netfall.physics.fields import Elements
from netfall.physics.law.law import LawParameters
from netfall.physics.state import State

MIN_SEGMENT_SHARE = 0.2  # of the unstressed length before any slip; a shorter segment is locked


@inner_kernel
def slip_force(T: float, EA: float, law: LawParameters) -> float:
    """Return q [N] at tension T [N]: minus the derivative of the strain energy by the unstressed length."""
    if law.logarithmic:
        return EA * (exponential(T / EA) - 1.0)
    return T + T * T / (2.0 * EA)


@inner_kernel
def slip_limit(
    before: float,
    after: float,
    EA_before: float,
    EA_after: float,
    friction: float,
    resistance: float,
    turn: float,
    law: LawParameters,
) -> float:
    """Return R [N], the force up to which a slip point sticks.

    before, after : [N] tensions; turn : exp(-mu theta)
    """
    larger, smaller, EA_larger, EA_smaller = before, after, EA_before, EA_after
    if after > before:
        larger, smaller, EA_larger, EA_smaller = after, before, EA_after, EA_before
    limit = 0.0
    if friction > 0.0:
        larger = max(larger - resistance, smaller)  # so that T = t exp(mu theta) + resistance
        limit += slip_force(larger, EA_larger, law) - slip_force(larger * turn, EA_larger, law)
    if resistance > 0.0:
        limit += slip_force(smaller + resistance, EA_smaller, law) - slip_force(smaller, EA_smaller, law)
    return limit


@inner_kernel
def angle_between(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> float:
    """Return the angle [rad] between two unit vectors, with the same bits on any processor.

    The tangent of half of it is |a - b| / |a + b|. After three more bisections the arc tangent is a short
    series.
    """
    y = math.sqrt((ax - bx) * (ax - bx) + (ay - by) * (ay - by) + (az - bz) * (az - bz))
    x = math.sqrt((ax + bx) * (ax + bx) + (ay + by) * (ay + by) + (az + bz) * (az + bz))
    t = y / (x + math.sqrt(x * x + y * y))
    t = t / (1.0 + math.sqrt(1.0 + t * t))
    t = t / (1.0 + math.sqrt(1.0 + t * t))
    square, arc = t * t, 0.0
    for k in range(10, -1, -1):
        arc = 1.0 / (2 * k + 1) - square * arc
    return 16.0 * t * arc


def set_slipless_lengths(state: State, L0: np.ndarray) -> None:
    """Set the unstressed lengths (m,) [m] of the elements without slip; slips stay as they are."""
    state.L0[:] = L0
    if state.features.slip:
        state.strand[:] = L0
        update_slipped_lengths(state.particles.slip, state.elements)


@inner_kernel
def slipped_length(e: int, slip: FloatArray, elements: Elements) -> float:
    """Return the unstressed length [m] of element e including slip; slip : (3, n) [m]."""
    return elements.strand[e] + elements.slip_share[e] * passed_length(e, slip, elements)


@inner_kernel
def passed_length(e: int, slip: FloatArray, elements: Elements) -> float:
    """Return the length [m] passed into the segment of element e, from slips (3, n) or slip velocities."""
    i, j, passed = elements.slip_place[e, 0], elements.slip_place[e, 1], 0.0
    if i >= 0:
        passed += slip[i, elements.slip_at[e, 0]]
    if j >= 0:
        passed -= slip[j, elements.slip_at[e, 1]]
    return passed


@inner_kernel
def shortest_length(e: int, elements: Elements) -> float:
    """Return the unstressed length [m] of element e at which a stop ends the slip."""
    return MIN_SEGMENT_SHARE * ((1.0 - elements.stage_slip[e]) * elements.strand[e])


@kernel
def update_slipped_lengths(slip: Any, elements: Elements) -> None:
    """Update the unstressed lengths to the slips (3, n) [m]."""
    for e in range(elements.ends.shape[0]):
        moves = elements.slip_place[e, 0] >= 0 or elements.slip_place[e, 1] >= 0
        if moves and elements.broken[e] == 0:
            elements.L0[e] = slipped_length(e, slip, elements)


INERTIA_FACTOR = 2.0
MOST_ADDED = 0.02  # inertia that the automatic step may add, relative to the mass that moves with a slip
HALVINGS = 40  # bisections of the interval that contains the largest step
DOUBLINGS = 60  # of a step without added inertia; beyond that slips set no limit


class SlipFollowers(NamedTuple):
    """Nodes that slips follow, in the order of the chains of slip points.

    own, stiffness : (k,) of `slip_inertia`; slip_node : (k,) node of each slip point
    station : (k,) number of each slip point, along all chains, among slip points and segments
    begin, end : (k,) first and last station of its chain; closed : (k,) whether the chain is closed
    near : (2, k) [kg^-1/2] entry of its own node, from the side before it and after it
    size : (j,) [kg^-1/2] entries of nodes that slips pass; node, at : (j,) their nodes and stations
    """

    own: np.ndarray
    stiffness: np.ndarray
    station: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    closed: np.ndarray
    near: np.ndarray
    size: np.ndarray
    node: np.ndarray
    at: np.ndarray
    slip_node: np.ndarray


def slip_inertia(own: np.ndarray, stiffness: np.ndarray, dt: float) -> np.ndarray:
    """Return the inertia (k,) [kg] of slips: their own, or that required for steps of dt [s], if larger.

    own : (k,) [kg] half of the mass of both segments; stiffness : (k,) [N/m] sum w^2 EA / L0 over both
    """
    return np.maximum(own, INERTIA_FACTOR * dt * dt * stiffness)


def slip_followers(
    slides: Any, elements: IntArray, x: Any, fixed: Any, mass: Any, own: Any, stiffness: Any
) -> SlipFollowers:
    """Return the nodes that slips follow at positions x (n, 3).

    slides : `geometry.slip_points.SlidingCables`; elements : (m, 2); fixed : (n, 3) bool; mass : (n,) [kg]
    """
    before, after = slides.segment[slides.before], slides.segment[slides.after]
    first = np.append(True, before[1:] != after[:-1])  # False: the chain continues
    begin = np.flatnonzero(first)
    chain, last = np.cumsum(first) - 1, np.append(begin[1:], len(before)) - 1
    station = 2 * np.arange(len(before)) + chain + 1  # a chain has one segment more than slip points
    of_segment = np.zeros(int(slides.segment.max()) + 1, np.int64)
    of_segment[before], of_segment[after] = station - 1, station + 1
    key, vector = _segment_gradients(slides, elements, x, len(mass))
    segment, node = key // len(mass), key % len(mass)
    vector *= ~fixed[node] / np.sqrt(mass[node])[:, None]
    adjacent = np.searchsorted(key, np.stack([before, after]) * len(mass) + slides.node)
    inner = np.setdiff1d(np.arange(len(key)), adjacent)
    return SlipFollowers(
        own=own,
        stiffness=stiffness,
        station=station,
        begin=(station[begin] - 1)[chain],
        end=(station[last] + 1)[chain],
        closed=(after[last] == before[begin])[chain],
        near=lengths(vector[adjacent]),
        size=np.append(lengths(vector[inner]), lengths(vector[adjacent].sum(0))),
        node=np.append(node[inner], slides.node),
        at=np.append(of_segment[segment[inner]], station),
        slip_node=slides.node,
    )


def _segment_gradients(slides: Any, elements: IntArray, x: Any, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return vectors (u, 3) by which a node's velocity lengthens a segment; keys (u,): segment n + node."""
    inside = np.flatnonzero(slides.segment >= 0)
    ends = elements[inside]
    along = x[ends[:, 1]] - x[ends[:, 0]]
    along /= lengths(along)[:, None]
    keys = slides.segment[inside].astype(np.int64)[:, None] * n + ends
    key, row = np.unique(keys, return_inverse=True)
    row, vector = row.reshape(keys.shape), np.zeros((len(key), 3))
    np.add.at(vector, row[:, 0], -along)
    np.add.at(vector, row[:, 1], along)
    return key, vector


def added_share(movers: SlipFollowers, dt: float) -> float:
    """Return lambda, an upper bound of the relative added inertia, for steps of dt [s]."""
    root = np.sqrt(slip_inertia(movers.own, movers.stiffness, dt) - movers.own)
    if not root.any():
        return 0.0
    own = 1.0 / np.sqrt(movers.own)
    sides = [np.where(movers.closed, np.inf, side) for side in _sides(movers, movers.size, movers.near)]
    choices = [np.where(side <= own, number, 2) for number, side in enumerate(sides)]
    return max(_share_of_choice(movers, root, own, choice) for choice in choices)


def _share_of_choice(movers: SlipFollowers, root: np.ndarray, own: np.ndarray, choice: np.ndarray) -> float:
    """Return the bound of `added_share` for slips that nodes before them (0), behind (1) or none (2) follow.

    root : (k,) [kg^1/2] of the added inertia; own : (k,) [kg^-1/2] of the inertia of the cable
    """
    column = np.zeros(int(movers.node.max()) + 1)
    np.add.at(column, movers.node, movers.size * _following_roots(movers, root, choice))
    follows_nodes = choice < 2
    own_entry = np.where(follows_nodes, movers.near[np.minimum(choice, 1), np.arange(len(root))], 0.0)
    np.add.at(column, movers.slip_node, own_entry * root)
    sides = _sides(movers, movers.size * column[movers.node], movers.near * column[movers.slip_node])
    total = np.where(choice == 0, sides[0], np.where(choice == 1, sides[1], root * own * own))
    return float((root * total).max())


def _sides(movers: SlipFollowers, size: np.ndarray, own_entry: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return sums (k,) over the nodes on either side of each slip point."""
    up_to = _running(movers, movers.at, size)
    return (
        up_to[movers.station] - up_to[movers.begin] + own_entry[0],
        up_to[movers.end + 1] - up_to[movers.station + 1] + own_entry[1],
    )


def _following_roots(movers: SlipFollowers, root: np.ndarray, choice: np.ndarray) -> np.ndarray:
    """Return, for each node entry (j,), the sum of the roots of the slips that follow the node."""
    forward = _running(movers, movers.station, np.where(choice == 0, root, 0.0))
    backward = _running(movers, movers.station, np.where(choice == 1, root, 0.0))
    begins, ends = np.unique(movers.begin), np.unique(movers.end)
    chain = np.searchsorted(ends, movers.at)
    begin, end = begins[chain], ends[chain]
    return forward[end + 1] - forward[movers.at + 1] + backward[movers.at] - backward[begin]


def _running(movers: SlipFollowers, stations: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return running sums: the sum of all values at stations before each station."""
    return np.append(0.0, np.cumsum(np.bincount(stations, values, int(movers.end.max()) + 1)))


def slip_step_limit(movers: SlipFollowers) -> float:
    """Return the longest step [s] that adds at most MOST_ADDED; inf if slips set no limit."""
    is_there = movers.stiffness > 0.0
    good = np.sqrt(movers.own[is_there] / (INERTIA_FACTOR * movers.stiffness[is_there])).min(initial=1.0)
    for _ in range(DOUBLINGS):
        if added_share(movers, 2.0 * good) > MOST_ADDED:
            break
        good *= 2.0
    else:
        return np.inf
    bad = 2.0 * good
    for _ in range(HALVINGS):
        middle = 0.5 * (good + bad)
        good, bad = (good, middle) if added_share(movers, middle) > MOST_ADDED else (middle, bad)
    return good
