"""Cables as pieces: which elements were drawn in several but are delivered as one.

The column `cable` of elements.csv names the piece of each element. Where it is empty, or not there, a piece
is a chain of elements of one group that run straight through: at a node two of them belong together if each
is the straightest continuation of the other, and they bend by at most `LARGEST_BEND` in the geometry given.
A chain ends at a node that is held rigidly on all axes, where a cable is anchored. Elements of one segment
that was subdivided always belong together.
"""

import numpy as np

from netfall.net.net import Net
from netfall.net.parts import parts_of

LARGEST_BEND = 30.0  # degrees; a ring of 12 sides and more is one piece
DIGITS = 9  # of the cosine of a bend; what differs less is equally straight, and the earlier rows are taken


def cables_of(net: Net, in_plan: bool = False) -> tuple[np.ndarray, list[str]]:
    """The piece of cable (m,) of each element, and the names of the pieces by these numbers.

    in_plan : bends are measured in plan, for nets whose heights are but a start of form finding

    Pieces are numbered in the order in which they first appear in the rows of the net. One that has no name
    in the table is called by the least id of its elements, "e17". A name of the table is one piece, whatever
    its elements are.
    """
    names = np.array(net.cable_given) if net.cable_given else np.zeros(net.m // net.parts, "U1")
    label = _chains(net, np.array([1.0, 1.0, 0.0 if in_plan else 1.0]), names != "")
    if net.cable_given:
        _, of_name, row = np.unique(names, return_index=True, return_inverse=True)
        label = np.where(names != "", len(label) + of_name[row], label)
    _, first, piece = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    number = rank[piece]
    least = np.full(len(first), np.iinfo(np.int64).max)
    np.minimum.at(least, number, net.element_id[:: net.parts])
    called = [names[row] or f"e{least[k]}" for k, row in enumerate(np.sort(first))]
    return np.repeat(number, net.parts), [str(name) for name in called]


def same_names(names: list[str]) -> list[str]:
    """Names that two pieces have: one of the table, and one that a piece without a name is called by."""
    values, times = np.unique(names, return_counts=True) if names else ([], np.zeros(0))
    return [str(name) for name, count in zip(values, times) if count > 1]


def _chains(net: Net, axes: np.ndarray, named: np.ndarray) -> np.ndarray:
    """For each element as it was given the same number (m / parts,) along a chain; as `_bends`."""
    pairs = _matched(_bends(net, axes, named), 2 * net.m // net.parts) // 2
    return parts_of(pairs, net.m // net.parts)


def _bends(net: Net, axes: np.ndarray, named: np.ndarray) -> np.ndarray:
    """Pairs (k, 2) of ends that may continue each other, the straightest first.

    axes : (3,) 1 where the axis counts; named : (m / parts,) bool, elements that do not

    The ends of element e are 2 e (its start) and 2 e + 1.
    """
    ends = net.undivided()
    along = axes * (net.x[ends[:, 1]] - net.x[ends[:, 0]])
    length = np.sqrt(along[:, 0] ** 2 + along[:, 1] ** 2 + along[:, 2] ** 2)
    unit = along / np.where(length > 0, length, 1.0)[:, None]
    out = np.stack([unit, -unit], axis=1).reshape(-1, 3)  # from the node of each end into its element
    node, group = ends.ravel(), np.repeat(net.group[:: net.parts], 2)
    free = np.flatnonzero(~net.fixed[node].all(1) & ~np.repeat(named, 2))
    order = free[np.argsort(node[free] * len(net.group_names) + group[free], kind="stable")]
    found, cosines, apart = [np.zeros((0, 2), np.int64)], [np.zeros(0)], 1
    while apart < len(order):
        a, b = order[:-apart], order[apart:]
        same = (node[a] == node[b]) & (group[a] == group[b])
        if not same.any():
            break
        a, b = a[same], b[same]
        u, v = out[a], out[b]
        cosine = np.round(-(u[:, 0] * v[:, 0] + u[:, 1] * v[:, 1] + u[:, 2] * v[:, 2]), DIGITS)
        straight = cosine >= np.round(np.cos(np.radians(LARGEST_BEND)), DIGITS)
        found.append(np.column_stack([a, b])[straight])
        cosines.append(cosine[straight])
        apart += 1
    pairs, cosine = np.concatenate(found), np.concatenate(cosines)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0], -cosine))]


def _matched(pairs: np.ndarray, ends: int) -> np.ndarray:
    """Of pairs (k, 2) of so many ends, the best first, those whose ends have no better one left."""
    found = [np.zeros((0, 2), np.int64)]
    taken = np.zeros(ends, bool)
    while len(pairs):
        place = np.arange(len(pairs))
        first = np.full(ends, len(pairs))
        np.minimum.at(first, pairs.ravel(), np.repeat(place, 2))
        best = (first[pairs] == place[:, None]).all(1)
        found.append(pairs[best])
        taken[pairs[best]] = True
        pairs = pairs[~taken[pairs].any(1)]
    return np.concatenate(found)
