"""Lines to nodes and elements: ends within a tolerance are one node; joints where elements cross or touch."""

from dataclasses import dataclass

import numpy as np

from netfall.net.parts import close_pairs, parts_of


@dataclass
class Joined:
    """n nodes and m elements of a drawing of k lines.

    x : (n, 3) [m]; ends : (m, 2) rows of nodes; line : (m,) row of the line that each comes from
    moved : (k, 2) [m], how far each end of a line was from its node
    short : (s,) lines without length; twice : (d, 2) lines left out, each with the one that it repeats
    """

    x: np.ndarray
    ends: np.ndarray
    line: np.ndarray
    moved: np.ndarray
    short: np.ndarray
    twice: np.ndarray


def join(lines: np.ndarray, tolerance: float) -> Joined:
    """Nodes and elements of lines (k, 2, 3) [m]. A node is where the first of its ends is."""
    x, node = merge(lines.reshape(-1, 3), tolerance)
    ends = node.reshape(-1, 2)
    moved = np.linalg.norm(lines - x[ends], axis=2)
    short = ends[:, 0] == ends[:, 1]
    line = np.flatnonzero(~short)
    key = np.sort(ends[line], axis=1)
    _, first, which = np.unique(key[:, 0] * len(x) + key[:, 1], return_index=True, return_inverse=True)
    again = np.ones(len(line), bool)
    again[first] = False
    twice = np.column_stack([line[again], line[first[which[again]]]])
    line = line[~again]
    return _used(Joined(x, ends[line], line, moved, np.flatnonzero(short), twice))


def merge(points: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Places (n, 3) of points (p, 3) of which those within the tolerance are one; (p,) the place of each."""
    lowest = parts_of(close_pairs(points, tolerance), len(points))
    first, place = np.unique(lowest, return_inverse=True)  # in the order of the drawing
    return points[first], place


def _used(joined: Joined) -> Joined:
    """Without nodes that no element is left at."""
    used = np.zeros(len(joined.x), bool)
    used[joined.ends] = True
    row = np.cumsum(used) - 1
    joined.x, joined.ends = joined.x[used], row[joined.ends]
    return joined


def split(joined: Joined, element: np.ndarray, x: np.ndarray, tolerance: float) -> Joined:
    """The net with joints at places x (j, 3) [m] on elements (j,); places within the tolerance are one."""
    start, along = joined.x[joined.ends[:, 0]], np.diff(joined.x[joined.ends], axis=1)[:, 0]
    share = np.einsum("ij,ij->i", x - start[element], along[element])
    share /= np.einsum("ij,ij->i", along[element], along[element])
    of = np.argsort(element, kind="stable")
    element, x, share = element[of], x[of], share[of]
    whole = np.setdiff1d(np.arange(len(joined.ends)), element)
    lines, line = [joined.x[joined.ends[whole]]], [joined.line[whole]]
    for e in np.unique(element).tolist():
        here = slice(*np.searchsorted(element, [e, e + 1]))
        a, b = joined.x[joined.ends[e]]
        corners = np.vstack([a, x[here][np.argsort(share[here], kind="stable")], b])
        lines.append(np.stack([corners[:-1], corners[1:]], axis=1))
        line.append(np.full(len(corners) - 1, joined.line[e]))
    # nodes that there were come first, so that they stay where they are
    known = np.repeat(joined.x[:, None], 2, axis=1)
    again = join(np.concatenate([known, *lines]), tolerance)
    kept = again.line - len(known)
    return Joined(again.x, again.ends, np.concatenate(line)[kept], joined.moved, joined.short, joined.twice)


def parts_by_size(ends: np.ndarray, count: int) -> np.ndarray:
    """For each of so many nodes the number of its part of the net, 0: the one with the most elements."""
    _, label = np.unique(parts_of(ends, count), return_inverse=True)
    order = np.argsort(-np.bincount(label[ends[:, 0]], minlength=label.max() + 1), kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return rank[label]
