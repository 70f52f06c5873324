"""The roof drawn in plan: segments that meet at their ends alone, or what stands in the way of that."""

from dataclasses import dataclass, field

import numpy as np
import shapely

from netfall.job.values import MOST_NAMED, listed, more_of
from netfall.net.net import Net, pair_key
from netfall.numerics.functions import lengths
from netfall.numerics.sets import distinct


@dataclass(frozen=True)
class Plan:
    """Segments between points, each pair of points once.

    points : (N, 2) [m] particles, then corners without one; segment : (s, 2) points
    element : (s,) row of the undivided net that it lies on, -1: outline
    span : (s, 2) from where to where on that element, 0 to 1
    notes : what is odd; errors : why the drawing has no faces
    """

    points: np.ndarray
    segment: np.ndarray
    element: np.ndarray
    span: np.ndarray
    notes: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)


def draw_plan(net: Net, carries: np.ndarray | None = None, checked: bool = True) -> Plan:
    """The plan of the elements that carry the roof and of the outline; upright elements vanish in it.

    carries : (m,) bool of the undivided net, default all; checked : look for nodes within elements, for nodes
    above one another and for crossings, which a generator's net has not
    """
    points = np.concatenate([net.x, net.corners])[:, :2]
    ends = net.undivided()
    element = np.arange(len(ends)) if carries is None else np.flatnonzero(carries)
    segment = np.concatenate([ends[element], net.outline])
    element = np.concatenate([element, np.full(len(net.outline), -1)])
    length = lengths(points[segment[:, 1]] - points[segment[:, 0]])
    lies = length > (net.tolerance if checked else 0.0)
    segment, element = segment[lies], element[lies]
    span = np.tile([0.0, 1.0], (len(segment), 1))
    if not checked or not len(segment):
        return Plan(points, *_once(points, segment, element, span))
    errors, notes = _stacked(net, points, segment, element), []
    if not errors:
        segment, element, span, notes = _cut_at_nodes(net, points, segment, element, span)
        segment, element, span = _once(points, segment, element, span)
        errors = _crossings(net, points, segment, element)
    return Plan(points, segment, element, span, notes, errors)


def _once(points, segment, element, span):
    """Each pair of points once, under the element that was named first."""
    first = np.sort(np.unique(pair_key(segment, len(points)), return_index=True)[1])
    return segment[first], element[first], span[first]


def _near(points, others, distance):
    """Rows (i, k) of all that are no farther apart than `distance`: points i, shapes k."""
    return shapely.STRtree(others).query(points, predicate="dwithin", distance=distance)


def _stacked(net, points, segment, element) -> list[str]:
    """Nodes above one another in plan that both have elements in the roof: which carries it is not known."""
    used = distinct(segment)
    places = shapely.points(points[used])
    pairs = used[_near(places, places, net.tolerance)]
    pairs = pairs[:, pairs[0] < pairs[1]].T
    name = lambda p: f"{_node_name(net, p)} ({_at_node(net, segment, element, p)})"
    named = "; ".join(f"{name(a)} and {name(b)}" for a, b in pairs[:MOST_NAMED])
    return [
        f"{len(pairs)} pairs of nodes lie above one another in plan, or were meant as one, so it is not "
        f"known which carry the roof: {named}{'; ...' * (len(pairs) > MOST_NAMED)}"
    ] * (len(pairs) > 0)


def _cut_at_nodes(net, points, segment, element, span):
    """Segments cut where a node of the roof lies within them, the uncut ones first; a note with the ids."""
    used = distinct(segment)
    near, row = _near(shapely.points(points[used]), shapely.linestrings(points[segment]), net.tolerance)
    node = used[near]
    inner = (node[:, None] != segment[row]).all(1)
    node, row = node[inner], row[inner]
    start, end = points[segment[row, 0]], points[segment[row, 1]]
    t = np.sum((points[node] - start) * (end - start), axis=1) / np.sum((end - start) ** 2, axis=1)
    cut = np.unique(row)
    owner = np.concatenate([cut, row, cut])
    along = np.concatenate([np.zeros(len(cut)), t, np.ones(len(cut))])
    stop = np.concatenate([segment[cut, 0], node, segment[cut, 1]])
    order = np.lexsort((along, owner))
    owner, along, stop = owner[order], along[order], stop[order]
    same = owner[1:] == owner[:-1]
    whole = np.ones(len(segment), bool)
    whole[cut] = False
    chains = lambda values: np.column_stack([values[:-1], values[1:]])[same]
    notes = [
        f"node {_node_name(net, p)} lies within {_member(net, segment[s], element[s])} in plan without being "
        f"an end of it{_height_over(net, p, segment[s], share)}; it counts as a corner of the roof there"
        for p, s, share in list(zip(node, row, t))[:MOST_NAMED]
    ]
    notes += more_of("nodes lie within elements in plan", len(node))
    return (
        np.concatenate([segment[whole], chains(stop)]),
        np.concatenate([element[whole], element[owner[:-1][same]]]),
        np.concatenate([span[whole], chains(along)]),
        notes,
    )


def _height_over(net, p: int, ends, share: float) -> str:
    """How far node p is from an element between `ends` in height, at a share of its length, in words."""
    z = np.append(net.x[:, 2], net.corners[:, 2])
    over = float(z[p] - (1.0 - share) * z[ends[0]] - share * z[ends[1]])
    if abs(over) <= net.tolerance:
        return ""
    word = "above" if over > 0 else "below"
    return f", {abs(over):.3g} m {word} it (of another layer? name the roof's groups in [roof] groups)"


def _crossings(net, points, segment, element) -> list[str]:
    """Pairs of elements, or of edges without one, that cross in plan without a node."""
    lines = shapely.linestrings(points[segment])
    first, second = shapely.STRtree(lines).query(lines, predicate="crosses")
    own = np.where(element >= 0, element, len(net.elements) + np.arange(len(element)))
    pairs, at = np.unique(np.sort(own[np.column_stack([first, second])], axis=1), axis=0, return_index=True)
    name = lambda s: _member(net, segment[s], element[s]).removeprefix("element ")
    both = (sorted(ends, key=own.__getitem__) for ends in zip(first[at], second[at]))
    named = [" and ".join(map(name, ends)) for ends in both]
    return [f"{len(pairs)} pairs of elements cross in plan without a node: {listed(named)}"] * (
        len(pairs) > 0
    )


def _node_name(net, p: int) -> str:
    """A point by the id of its node; of the boundary by its place."""
    if p < net.n:
        return str(net.node_id[p])
    x, y, _ = net.corners[p - net.n]
    return f"at [{x:.4g}, {y:.4g}] of the boundary"


def _member(net, ends, e: int) -> str:
    """An element by its id, an edge without one by its ends."""
    if e >= 0:
        return f"element {net.element_id[net.parts * e]}"
    return "the line " + " to ".join(_node_name(net, p) for p in ends)


def _at_node(net, segment, element, p: int) -> str:
    """What of the roof is at a node, in words."""
    here = element[(segment == p).any(1)]
    if not (here >= 0).any():
        return "lines of [roof] lines"
    return f"elements {listed(net.element_id[net.parts * here[here >= 0]])}"
