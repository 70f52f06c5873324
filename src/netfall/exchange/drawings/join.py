"""Net of a drawing: conversion of lines to nodes and elements, and faults.

Ends within a tolerance are one node, and joints split elements. Faults are near misses and crossings without
a joint. The outline encloses the net.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import shapely

from netfall.core.arrays import AnyArray, FloatArray, IntArray
from netfall.geometry.net import close_pairs, connected_parts, unconnected_pairs


@dataclass
class JoinedNet:
    """Net of n nodes and m elements from a drawing of k lines.

    x : (n, 3) [m]; ends : (m, 2) rows of nodes; line : (m,) row of the line that each element comes from
    moved : (k, 2) [m], distance of each end of a line from its node
    short : (s,) lines without length; twice : (d, 2) omitted lines, each with the line that it repeats
    parts : (p, 2) lines of which `split` omitted a part, each with the element that the part repeats
    """

    x: np.ndarray
    ends: np.ndarray
    line: np.ndarray
    moved: np.ndarray
    short: np.ndarray
    twice: np.ndarray
    parts: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))


def join(lines: np.ndarray, tolerance: float) -> JoinedNet:
    """Join lines (k, 2, 3) [m] to nodes and elements; a node lies at the first of its line ends."""
    points = lines.reshape(-1, 3)
    lowest = connected_parts(close_pairs(points, tolerance), len(points))
    first, node = np.unique(lowest, return_inverse=True)  # in the order of the drawing
    x, ends = points[first], node.reshape(-1, 2)
    distance = np.linalg.norm(lines - x[ends], axis=2)
    short = ends[:, 0] == ends[:, 1]
    line = np.flatnonzero(~short)
    key = np.sort(ends[line], axis=1)
    _, first, group = np.unique(key[:, 0] * len(x) + key[:, 1], return_index=True, return_inverse=True)
    repeats = np.ones(len(line), bool)
    repeats[first] = False
    twice = np.column_stack([line[repeats], line[first[group[repeats]]]])
    line = line[~repeats]
    used, row = np.unique(ends[line], return_inverse=True)
    return JoinedNet(x[used], row.reshape(-1, 2), line, distance, np.flatnonzero(short), twice)


def split(joined: JoinedNet, element: np.ndarray, x: np.ndarray, tolerance: float) -> JoinedNet:
    """Split elements (j,) by joints at points x (j, 3) [m]; points within the tolerance are one joint."""
    start, direction = joined.x[joined.ends[:, 0]], np.diff(joined.x[joined.ends], axis=1)[:, 0]
    share = _dot(x - start[element], direction[element]) / _dot(direction[element], direction[element])
    order = np.argsort(element, kind="stable")
    element, x, share = element[order], x[order], share[order]
    unsplit = np.setdiff1d(np.arange(len(joined.ends)), element)
    lines, line = [joined.x[joined.ends[unsplit]]], [joined.line[unsplit]]
    for e in np.unique(element).tolist():
        own = slice(*np.searchsorted(element, [e, e + 1]))
        a, b = joined.x[joined.ends[e]]
        corners = np.vstack([a, x[own][np.argsort(share[own], kind="stable")], b])
        lines.append(np.stack([corners[:-1], corners[1:]], axis=1))
        line.append(np.full(len(corners) - 1, joined.line[e]))
    # the first of merged points remains, so existing nodes come first
    existing = np.repeat(joined.x[:, None], 2, axis=1)
    net = join(np.concatenate([existing, *lines]), tolerance)
    of_part = np.concatenate(line)
    repeated, repeats = net.twice[:, 0] - len(existing), np.searchsorted(net.line, net.twice[:, 1])
    parts = np.column_stack([of_part[repeated], repeats])
    return replace(joined, x=net.x, ends=net.ends, line=of_part[net.line - len(existing)], parts=parts)


def parts_by_size(ends: np.ndarray, count: int) -> np.ndarray:
    """Return the part of the net that each node belongs to; part 0 has the most elements."""
    _, label = np.unique(connected_parts(ends, count), return_inverse=True)
    order = np.argsort(-np.bincount(label[ends[:, 0]], minlength=label.max() + 1), kind="stable")
    return np.argsort(order)[label]


NEAR_SHARE, NEAR_TIMES = 0.01, 10.0  # of the median length, of the tolerance; nearer was meant as joined
SEARCH_BLOCK = 4096  # elements per search for neighbours, which limits its memory
MAX_PARALLEL_SINE2 = 1e-9  # squared sine of the angle, below which elements overlap instead of crossing


def near_miss_distance(x: np.ndarray, ends: np.ndarray, tolerance: float) -> float:
    """Compute the largest distance [m] that counts as a near miss."""
    length = np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1)
    return max(NEAR_TIMES * tolerance, NEAR_SHARE * float(np.median(length)))


def near_nodes(x: np.ndarray, ends: np.ndarray, reach: float) -> tuple[IntArray, FloatArray]:
    """Find pairs of nodes (k, 2) within `reach` that no element joins, and their distances [m]."""
    pairs = unconnected_pairs(x, ends, reach)
    distance = np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)
    order = np.argsort(distance, kind="stable")
    return pairs[order], distance[order]


def find_touches(x: np.ndarray, ends: np.ndarray, reach: float) -> tuple[IntArray, IntArray, FloatArray]:
    """Find nodes (k,) within `reach` of elements (k,), between their ends; and the distances [m]."""
    tree = shapely.STRtree(_in_plan(x, ends))
    node, element = tree.query(shapely.points(x[:, :2]), predicate="dwithin", distance=reach)
    free = (ends[element] != node[:, None]).all(1)
    node, element = node[free], element[free]
    start, direction = x[ends[element, 0]], x[ends[element, 1]] - x[ends[element, 0]]
    share = _dot(x[node] - start, direction) / _dot(direction, direction)
    nearest = start + np.clip(share, 0.0, 1.0)[:, None] * direction
    distance = np.linalg.norm(x[node] - nearest, axis=1)
    to_ends = np.linalg.norm(x[node][:, None] - x[ends[element]], axis=2).min(1)
    is_touch = (distance <= reach) & (share > 0) & (share < 1) & (to_ends > reach)
    return node[is_touch], element[is_touch], distance[is_touch]


def find_crossings(
    x: np.ndarray, ends: np.ndarray, tolerance: float
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Find pairs of elements (k, 2) that cross within the tolerance [m] between their ends.

    Also returns the points (k, 3) on the first element, and the distances (k,) [m].
    Closest points of two segments: Ericson, Real-Time Collision Detection, 2005, section 5.1.9.
    """
    pairs = _near_pairs(x, ends, tolerance)
    a, b = ends[pairs[:, 0]], ends[pairs[:, 1]]
    p, d, q, e = x[a[:, 0]], x[a[:, 1]] - x[a[:, 0]], x[b[:, 0]], x[b[:, 1]] - x[b[:, 0]]
    dd, ee, de = _dot(d, d), _dot(e, e), _dot(d, e)
    sine = dd * ee - de * de
    not_parallel = sine > MAX_PARALLEL_SINE2 * dd * ee
    s, t = np.full((2, len(pairs)), -1.0)
    r, det = q - p, np.where(not_parallel, sine, 1.0)
    s[not_parallel] = ((_dot(r, d) * ee - _dot(r, e) * de) / det)[not_parallel]
    t[not_parallel] = ((_dot(r, d) * de - _dot(r, e) * dd) / det)[not_parallel]
    on_a, on_b = p + s[:, None] * d, q + t[:, None] * e
    inside = _between(s, dd, tolerance) & _between(t, ee, tolerance)
    distance = np.linalg.norm(on_a - on_b, axis=1)
    is_crossing = not_parallel & inside & (distance <= tolerance)
    return pairs[is_crossing], on_a[is_crossing], distance[is_crossing]


def _dot(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Compute the scalar products (k,) of vectors u and v (k, 3)."""
    return np.einsum("ij,ij->i", u, v)


def _near_pairs(x: np.ndarray, ends: np.ndarray, tolerance: float) -> np.ndarray:
    """Return pairs of elements (k, 2) without a common node whose boxes, enlarged by the tolerance, meet."""
    low, high = x[ends].min(1) - tolerance, x[ends].max(1) + tolerance
    boxes = shapely.box(*low[:, :2].T, *high[:, :2].T)
    tree, blocks = shapely.STRtree(boxes), [np.zeros((0, 2), np.int64)]
    for start in range(0, len(ends), SEARCH_BLOCK):
        first, second = tree.query(boxes[start : start + SEARCH_BLOCK])
        pairs = np.column_stack([start + first, second])[start + first < second]
        first_element, second_element = pairs.T
        disjoint = (ends[first_element][:, :, None] != ends[second_element][:, None, :]).all((1, 2))
        overlapping = (low[first_element, 2] <= high[second_element, 2]) & (
            low[second_element, 2] <= high[first_element, 2]
        )
        blocks.append(pairs[disjoint & overlapping])
    return np.concatenate(blocks)


def _between(share: np.ndarray, square: np.ndarray, tolerance: float) -> np.ndarray:
    """Whether points are more than the tolerance from both ends of elements; square : length squared."""
    margin = tolerance / np.sqrt(square)
    return (share > margin) & (share < 1.0 - margin)


def _in_plan(x: np.ndarray, ends: np.ndarray) -> AnyArray:
    """Return the elements as line strings in plan."""
    return shapely.linestrings(x[ends][:, :, :2])


def outline(x: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, bool]:
    """Select the nodes (n,) at the ends of single elements or on the outer boundary of the faces in plan.

    The second value says whether there are faces. If most boundary nodes are joined to ends of single
    elements, as in a net without edge cables, only these ends count.
    """
    single = np.bincount(ends.ravel(), minlength=len(x)) == 1
    faces = shapely.get_parts(shapely.polygonize(_in_plan(x, ends)))
    if not len(faces):
        return single, False
    corners = shapely.get_coordinates(shapely.get_exterior_ring(shapely.get_parts(_union(faces))))
    inner = np.zeros(len(x), bool)
    inner[ends[single[ends].any(1)]] = True
    used = np.bincount(ends.ravel(), minlength=len(x)) > 0
    on_boundary = used & np.isin(_as_complex(x), _as_complex(corners))
    return single | (on_boundary & ~inner if inner[on_boundary].mean() > 0.5 else on_boundary), True


def _as_complex(points: np.ndarray) -> np.ndarray:
    """Encode the plan coordinates of points as complex numbers, so that `np.isin` compares whole points."""
    return points[:, 0] + 1j * points[:, 1]


def _union(faces: AnyArray) -> Any:
    """Return the union of faces.

    The quick method needs faces that do not overlap. They overlap if elements cross without a joint.
    """
    if shapely.coverage_is_valid(faces):
        return shapely.coverage_union_all(faces)
    return shapely.union_all(faces)
