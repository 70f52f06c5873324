"""Roof in plan: segments that meet only at their ends, or the errors that prevent such a plan."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely

from netfall.core.arrays import AnyArray, FloatArray, IntArray, distinct
from netfall.core.functions import lengths
from netfall.core.messages import count_of
from netfall.geometry import messages
from netfall.geometry.net import Net, pair_key
from netfall.job.values import MOST_NAMED, format_list


@dataclass(frozen=True)
class Plan:
    """Segments between points, each pair of points once.

    points : (N, 2) [m] particles, then corners without one; segment : (s, 2) points
    element : (s,) row of the undivided net that it lies on, -1: outline
    span : (s, 2) start and end on that element, 0 to 1
    notes : warnings about a doubtful plan; error : reason why the plan has no faces, "": it has faces
    """

    points: np.ndarray
    segment: np.ndarray
    element: np.ndarray
    span: np.ndarray
    notes: list[str] = field(default_factory=list)
    error: str = ""


def draw_plan(net: Net, carries: np.ndarray | None = None, checked: bool = True) -> Plan:
    """Draw the elements that carry the roof and the outline in plan, without vertical elements.

    carries : (m,) bool of the undivided net, default all
    checked : whether to check for nodes within elements, nodes above one another and crossings; nets of
    generators have none
    """
    points = net.in_plan(np.concatenate([net.x, net.corners]))[:, :2]
    ends = net.undivided()
    element = np.arange(len(ends)) if carries is None else np.flatnonzero(carries)
    segment = np.concatenate([ends[element], net.outline])
    element = np.concatenate([element, np.full(len(net.outline), -1)])
    length = lengths(points[segment[:, 1]] - points[segment[:, 0]])
    long_enough = length > (net.tolerance if checked else 0.0)
    segment, element = segment[long_enough], element[long_enough]
    span, checked = np.tile([0.0, 1.0], (len(segment), 1)), checked and len(segment) > 0
    error = _stacked_node_error(net, points, segment, element) if checked else ""
    notes: list[str] = []
    if checked and not error:
        segment, element, span, notes = _cut_at_nodes(net, points, segment, element, span)
    first = np.sort(np.unique(pair_key(segment, len(points)), return_index=True)[1])  # of each pair of points
    segment, element, span = segment[first], element[first], span[first]
    if checked and not error:
        error = _crossing_error(net, points, segment, element)
    return Plan(points, segment, element, span, notes, error)


def _near(points: AnyArray, others: AnyArray, distance: float) -> IntArray:
    """Return rows (i, k) of the pairs of points i and shapes k within `distance` of each other."""
    return shapely.STRtree(others).query(points, predicate="dwithin", distance=distance)


def _stacked_node_error(net: Net, points: FloatArray, segment: IntArray, element: IntArray) -> str:
    """Describe nodes at the same point in plan that both have elements in the roof; "": there are none."""
    used = distinct(segment)
    positions = shapely.points(points[used])
    pairs = used[_near(positions, positions, net.tolerance)]
    pairs = pairs[:, pairs[0] < pairs[1]].T

    def describe(p: Any) -> Any:
        at_node = element[(segment == p).any(1)]
        rows = net.parts * at_node[at_node >= 0]
        what = f"elements {format_list(net.element_id[rows])}" if len(rows) else "lines of [roof] lines"
        return f"{_describe_point(net, p)} ({what})"

    names = "; ".join(f"{describe(a)} and {describe(b)}" for a, b in pairs[:MOST_NAMED])
    names += "; ..." * (len(pairs) > MOST_NAMED)
    return messages.STACKED_NODES.format(count=count_of(len(pairs), "pair"), pairs=names) if names else ""


def _cut_at_nodes(
    net: Net, points: FloatArray, segment: IntArray, element: IntArray, span: FloatArray
) -> tuple[IntArray, IntArray, FloatArray, list[Any]]:
    """Cut segments at nodes of the roof within them, uncut ones first; also warn about these nodes."""
    used = distinct(segment)
    rank, row = _near(shapely.points(points[used]), shapely.linestrings(points[segment]), net.tolerance)
    node = used[rank]
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
    same_owner = owner[1:] == owner[:-1]
    uncut = np.ones(len(segment), bool)
    uncut[cut] = False

    def successive(values: Any) -> AnyArray:
        return np.column_stack([values[:-1], values[1:]])[same_owner]

    nodes = [
        f"{_describe_point(net, p)} in {_describe_segment(net, segment[s], element[s])}"
        + _height_over(net, p, segment[s], share)
        for p, s, share in zip(node[: MOST_NAMED + 1], row, t)
    ]
    notes = [messages.NODES_WITHIN_ELEMENTS(count=len(node), nodes=format_list(nodes))] if nodes else []
    return (
        np.concatenate([segment[uncut], successive(stop)]),
        np.concatenate([element[uncut], element[owner[:-1][same_owner]]]),
        np.concatenate([span[uncut], successive(along)]),
        notes,
    )


def _height_over(net: Any, p: int, ends: Any, share: float) -> str:
    """Describe the height of node p above an element between `ends`, at a share of its length."""
    z = net.in_plan(np.concatenate([net.x, net.corners]))[:, 2]
    height = float(z[p] - (1.0 - share) * z[ends[0]] - share * z[ends[1]])
    if abs(height) <= net.tolerance:
        return ""
    return f" ({abs(height):.3g} m {'above' if height > 0 else 'below'})"


def _crossing_error(net: Net, points: FloatArray, segment: IntArray, element: IntArray) -> str:
    """Describe elements, or edges without one, that cross in plan without a node; "": there are none."""
    lines = shapely.linestrings(points[segment])
    neighbours = shapely.STRtree(lines).query(lines)  # (2, k) rows of lines whose boxes meet
    first, second = neighbours[:, neighbours[0] < neighbours[1]]
    ends, others = segment[first], segment[second]
    apart = (ends != others).all(1) & (ends != others[:, ::-1]).all(1)  # lines with a common end cannot cross
    first, second = first[apart], second[apart]
    crosses = shapely.crosses(lines[first], lines[second])
    first, second = first[crosses], second[crosses]
    key = np.where(element >= 0, element, len(net.elements) + np.arange(len(element)))
    pairs, first_row = np.unique(
        np.sort(key[np.column_stack([first, second])], axis=1), axis=0, return_index=True
    )
    names = [
        " and ".join(
            _describe_segment(net, segment[s], element[s]).removeprefix("element ")
            for s in sorted(crossing, key=key.__getitem__)
        )
        for crossing in zip(first[first_row], second[first_row])
    ]
    if not names:
        return ""
    at = shapely.intersection(lines[first[first_row[0]]], lines[second[first_row[0]]])
    count = count_of(len(pairs), "pair")
    return messages.CROSSINGS.format(count=count, pairs=format_list(names), x=at.x, y=at.y)


def _describe_point(net: Any, p: int) -> str:
    """Name a point by the id of its node, or by its position on the boundary."""
    if p < net.n:
        return str(net.node_id[p])
    x, y, _ = net.corners[p - net.n]
    return f"at [{x:.4g}, {y:.4g}] of the boundary"


def _describe_segment(net: Any, ends: Any, e: int) -> str:
    """Name an element by its id, an edge without one by its ends."""
    if e >= 0:
        return f"element {net.element_id[net.parts * e]}"
    return "the line " + " to ".join(_describe_point(net, p) for p in ends)
