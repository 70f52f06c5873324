"""Cables as pieces: which elements were drawn in several but are delivered as one.

The column `cable` of elements.csv names the piece of each element. Where it is empty, or not there, a piece
is a chain of elements of one group that run straight through: at a node two of them belong together if each
is the straightest continuation of the other, and they bend by at most `LARGEST_BEND` in the geometry given.
A chain ends at a node that is held rigidly on all axes, where a cable is anchored. Elements of one segment
that was subdivided always belong together.

Chains of bars resist bending: at a node two bars with bending are joined if they are the only two of one
piece that the column `cable` names, or else the only two of their group that meet there. Held or free, at any
angle. A chain has no moment at its ends.
"""

from typing import NamedTuple

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


CHAIN_END, NO_BENDING = -1, -2


class Chains(NamedTuple):
    """Joints (k,) of a net: particles (k, 3) in a row; elements (k, 2) between them.

    at : (m, 2) the joint at start and end of each element; CHAIN_END: none; NO_BENDING: the element has none
    chain : (k,) number of the chain that each joint is part of, the least of its joints
    """

    particles: np.ndarray
    elements: np.ndarray
    at: np.ndarray
    chain: np.ndarray


def chains_of(net: Net) -> Chains | None:
    """The joints of a net, by their middle particle; None if none of its bars resists bending."""
    if net.bending is None:
        return None
    bars = np.flatnonzero(net.bending)
    ends = 2 * np.repeat(bars, 2) + np.tile([0, 1], len(bars))  # the ends of element e are 2 e and 2 e + 1
    name, node = pieces_named(net), net.elements.ravel()
    pairs = pairs_meeting(ends[name[ends // 2] >= 0], node, name)
    free = ~np.isin(ends, pairs)
    by_group = pairs_meeting(ends, node, net.group)
    pairs = np.concatenate([pairs, by_group[np.isin(by_group, ends[free]).all(1)]])
    pairs = pairs[np.lexsort((pairs[:, 0], node[pairs[:, 0]]))]
    middle, first, second = node[pairs[:, 0]], node[pairs[:, 0] ^ 1], node[pairs[:, 1] ^ 1]
    at = np.full(2 * net.m, NO_BENDING)
    at[ends] = CHAIN_END
    at[pairs.T] = np.arange(len(pairs))
    at = at.reshape(net.m, 2)
    chain = parts_of(at[(at >= 0).all(1)], len(pairs))
    return Chains(np.column_stack([first, middle, second]), pairs // 2, at, chain)


def chain_notes(chains: Chains) -> list[str]:
    """A note where no bar goes on in another."""
    if len(chains.particles):
        return []
    return [
        "bending: no effect: nowhere do exactly two bars with bending of one group, or of one piece of the "
        "column cable, meet; [net] subdivide, or nodes along a bar, make chains"
    ]


def pieces_named(net: Net) -> np.ndarray:
    """Which name (m,) the column `cable` gives each element, as a number; -1: none."""
    if not net.cable_given:
        return np.full(net.m, -1)
    names, number = np.unique(np.array(net.cable_given), return_inverse=True)
    return np.repeat(np.where(names[number] == "", -1, number), net.parts)


def pairs_meeting(ends: np.ndarray, node: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """Pairs (k, 2) of ends of elements that meet at one node where just two of one kind do.

    ends : (e,) ascending, 2 e and 2 e + 1 of element e; node : (2 m,) of each end; kind : (m,) of elements
    """
    key = node[ends] * (int(kind.max(initial=0)) + 1) + kind[ends // 2]
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    two = first[count == 2]
    return np.column_stack([ends[order[two]], ends[order[two + 1]]])
