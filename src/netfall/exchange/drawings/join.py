"""Conversion of lines to nodes and elements: ends within a tolerance are one node; joints split elements."""

from dataclasses import dataclass

import numpy as np

from netfall.geometry.net import close_pairs, connected_parts


@dataclass
class JoinedNet:
    """Net of n nodes and m elements from a drawing of k lines.

    x : (n, 3) [m]; ends : (m, 2) rows of nodes; line : (m,) row of the line that each element comes from
    moved : (k, 2) [m], distance of each end of a line from its node
    short : (s,) lines without length; twice : (d, 2) lines left out, each with the line that it repeats
    """

    x: np.ndarray
    ends: np.ndarray
    line: np.ndarray
    moved: np.ndarray
    short: np.ndarray
    twice: np.ndarray


def join(lines: np.ndarray, tolerance: float) -> JoinedNet:
    """Join lines (k, 2, 3) [m] to nodes and elements; a node lies at the first of its line ends."""
    x, node = merge_points(lines.reshape(-1, 3), tolerance)
    ends = node.reshape(-1, 2)
    distance = np.linalg.norm(lines - x[ends], axis=2)
    short = ends[:, 0] == ends[:, 1]
    line = np.flatnonzero(~short)
    key = np.sort(ends[line], axis=1)
    _, first, group = np.unique(key[:, 0] * len(x) + key[:, 1], return_index=True, return_inverse=True)
    repeats = np.ones(len(line), bool)
    repeats[first] = False
    twice = np.column_stack([line[repeats], line[first[group[repeats]]]])
    line = line[~repeats]
    return _drop_unused_nodes(JoinedNet(x, ends[line], line, distance, np.flatnonzero(short), twice))


def merge_points(points: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Merge points (p, 3) within the tolerance: merged points (n, 3) and the row (p,) of each among them."""
    lowest = connected_parts(close_pairs(points, tolerance), len(points))
    first, row = np.unique(lowest, return_inverse=True)  # in the order of the drawing
    return points[first], row


def _drop_unused_nodes(joined: JoinedNet) -> JoinedNet:
    """Remove the nodes that no element uses."""
    used = np.zeros(len(joined.x), bool)
    used[joined.ends] = True
    row = np.cumsum(used) - 1
    joined.x, joined.ends = joined.x[used], row[joined.ends]
    return joined


def split(joined: JoinedNet, element: np.ndarray, x: np.ndarray, tolerance: float) -> JoinedNet:
    """Split elements (j,) by joints at points x (j, 3) [m]; points within the tolerance are one joint."""
    start, direction = joined.x[joined.ends[:, 0]], np.diff(joined.x[joined.ends], axis=1)[:, 0]
    share = np.einsum("ij,ij->i", x - start[element], direction[element])
    share /= np.einsum("ij,ij->i", direction[element], direction[element])
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
    # the first of merged points counts, so existing nodes come first
    existing = np.repeat(joined.x[:, None], 2, axis=1)
    net = join(np.concatenate([existing, *lines]), tolerance)
    rows = net.line - len(existing)
    return JoinedNet(
        net.x,
        net.ends,
        np.concatenate(line)[rows],
        joined.moved,
        joined.short,
        joined.twice,
    )


def parts_by_size(ends: np.ndarray, count: int) -> np.ndarray:
    """Return the part of the net that each node belongs to; part 0 has the most elements."""
    _, label = np.unique(connected_parts(ends, count), return_inverse=True)
    order = np.argsort(-np.bincount(label[ends[:, 0]], minlength=label.max() + 1), kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return rank[label]
