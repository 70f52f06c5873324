"""Cables and bending chains: sequences of elements of the table.

The column `cable` of elements.csv names the cable of each element. If it is empty or absent, a cable is a
chain of elements of one group and kind that run straight through. At a node two of them belong together if
each is the straightest continuation of the other, and the bend is at most `MAX_BEND` in the given geometry. A
cable ends at a node that is held rigidly along all axes, its anchor. The parts of one subdivided element
always belong together. Two elements of a group of [[slide]] belong together at any bend, and at a held slip
point, if only these two of the group meet there.

Bending chains consist of bars. A node joins two bars with bending if only these two of one cable, named in
the column `cable`, meet there, or otherwise only these two of their group. The node may be held or free, the
angle is arbitrary. A chain has no moment at its ends.
"""

from typing import NamedTuple

import numpy as np

from netfall.core.functions import lengths
from netfall.geometry.net import Net, connected_parts, elements_of_group
from netfall.job.keys.entries import Slide

MAX_BEND = 30.0  # degrees; a ring of 12 or more sides is one cable
BEND_DIGITS = 9  # digits of the cosine of a bend; of equal bends, the earlier rows take precedence


def cables_of(net: Net, slides: list[Slide], in_plan: bool) -> tuple[np.ndarray, list[str]]:
    """Return the cable (m,) of each element, and the names of the cables by these numbers.

    slides : entries of [[slide]]
    in_plan : measure bends in plan, for nets with heights that are only a start for form finding

    Cables are numbered in the order in which they first appear in the rows of the net. A cable without a name
    in the table is named by the lowest id of its elements, "e17". All elements with the same
    name form one cable.
    """
    names = np.array(net.cable_given) if net.cable_given else np.zeros(net.m // net.parts, "U1")
    straight = _continuing_ends(net, np.array([1.0, 1.0, 0.0 if in_plan else 1.0]), names != "")
    label = _chains(net, np.concatenate([_sliding_ends(net, slides, names != ""), straight]))
    if net.cable_given:
        _, first_row, row = np.unique(names, return_index=True, return_inverse=True)
        label = np.where(names != "", len(label) + first_row[row], label)
    _, first, piece = np.unique(label, return_index=True, return_inverse=True)
    number = np.argsort(np.argsort(first))[piece]
    least = np.full(len(first), np.iinfo(np.int64).max)
    np.minimum.at(least, number, net.element_id[:: net.parts])
    cable_names = [names[row] or f"e{least[k]}" for k, row in enumerate(np.sort(first))]
    return np.repeat(number, net.parts), [str(name) for name in cable_names]


def _chains(net: Net, pairs: np.ndarray) -> np.ndarray:
    """Return a number (m / parts,) for each given element, equal along a chain.

    pairs : (k, 2) ends that may continue each other, best first; element e has the ends 2 e and 2 e + 1
    """
    ends = 2 * net.m // net.parts
    matched, used = [np.zeros((0, 2), np.int64)], np.zeros(ends, bool)
    while len(pairs):  # best pairs first, each end in at most one pair
        rank, first = np.arange(len(pairs)), np.full(ends, len(pairs))
        np.minimum.at(first, pairs.ravel(), np.repeat(rank, 2))
        best = (first[pairs] == rank[:, None]).all(1)
        matched.append(pairs[best])
        used[pairs[best]] = True
        pairs = pairs[~used[pairs].any(1)]
    return connected_parts(np.concatenate(matched) // 2, net.m // net.parts)


def _sliding_ends(net: Net, slides: list[Slide], named: np.ndarray) -> np.ndarray:
    """Return pairs (k, 2) of ends that continue each other in the groups of [[slide]].

    named : as in `_continuing_ends`
    """
    pairs, node = [np.zeros((0, 2), np.int64)], net.undivided().ravel()
    for entry in slides:
        if entry.group is None:  # `cables` names whole cables
            continue
        rows = elements_of_group(net, entry.group)[0][:: net.parts] // net.parts
        meeting = meeting_pairs((2 * rows[:, None] + [0, 1]).ravel(), node, np.zeros(len(named), np.int64))
        at = node[meeting[:, 0]]
        slips = entry.nodes is None or np.isin(net.node_id[at], entry.nodes)
        pairs.append(meeting[(slips | ~net.fixed[at].all(1)) & ~named[meeting // 2].any(1)])
    return np.concatenate(pairs)


def _continuing_ends(net: Net, axes: np.ndarray, named: np.ndarray) -> np.ndarray:
    """Return pairs (k, 2) of ends that may continue each other, the straightest first.

    axes : (3,) 1 if the axis counts; named : (m / parts,) bool, elements with a name, which are excluded

    The ends of element e are 2 e (its start) and 2 e + 1.
    """
    ends = net.undivided()
    along = axes * (net.x[ends[:, 1]] - net.x[ends[:, 0]])
    length = lengths(along)
    unit = along / np.where(length > 0, length, 1.0)[:, None]
    direction = np.stack([unit, -unit], axis=1).reshape(-1, 3)  # from the node of each end into its element
    kind = 2 * net.group + net.bar  # a cable contains no bar
    node, group = ends.ravel(), np.repeat(kind[:: net.parts], 2)
    free = np.flatnonzero(~net.fixed[node].all(1) & ~np.repeat(named, 2))
    order = free[np.argsort(node[free] * 2 * len(net.group_names) + group[free], kind="stable")]
    candidates, cosines, offset = [np.zeros((0, 2), np.int64)], [np.zeros(0)], 1
    while offset < len(order):
        a, b = order[:-offset], order[offset:]
        meet = (node[a] == node[b]) & (group[a] == group[b])
        if not meet.any():
            break
        a, b = a[meet], b[meet]
        u, v = direction[a], direction[b]
        cosine = np.round(-(u[:, 0] * v[:, 0] + u[:, 1] * v[:, 1] + u[:, 2] * v[:, 2]), BEND_DIGITS)
        straight = cosine >= np.round(np.cos(np.radians(MAX_BEND)), BEND_DIGITS)
        candidates.append(np.column_stack([a, b])[straight])
        cosines.append(cosine[straight])
        offset += 1
    pairs, cosine = np.concatenate(candidates), np.concatenate(cosines)
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0], -cosine))]


CHAIN_END, NO_BENDING = -1, -2


class BendingChains(NamedTuple):
    """Joints (k,) of a net: three consecutive particles (k, 3), and the elements (k, 2) between them.

    at : (m, 2) joint at start and end of each element; CHAIN_END: no joint; NO_BENDING: does not bend
    chain : (k,) number of the chain that contains each joint, the lowest of its joints
    """

    particles: np.ndarray
    elements: np.ndarray
    at: np.ndarray
    chain: np.ndarray


def find_bending_chains(net: Net) -> BendingChains | None:
    """Return the joints of a net by their middle particle; None if no bar resists bending."""
    if net.bending is None:
        return None
    bars = np.flatnonzero(net.bending)
    ends = 2 * np.repeat(bars, 2) + np.tile([0, 1], len(bars))  # the ends of element e are 2 e and 2 e + 1
    name, node = named_cables(net), net.elements.ravel()
    pairs = meeting_pairs(ends[name[ends // 2] >= 0], node, name)
    free = ~np.isin(ends, pairs)
    by_group = meeting_pairs(ends, node, net.group)
    pairs = np.concatenate([pairs, by_group[np.isin(by_group, ends[free]).all(1)]])
    pairs = pairs[np.lexsort((pairs[:, 0], node[pairs[:, 0]]))]
    middle, first, second = node[pairs[:, 0]], node[pairs[:, 0] ^ 1], node[pairs[:, 1] ^ 1]
    joint_at = np.full(2 * net.m, NO_BENDING)
    joint_at[ends] = CHAIN_END
    joint_at[pairs.T] = np.arange(len(pairs))
    joint_at = joint_at.reshape(net.m, 2)
    joint_at[(joint_at < 0).all(1)] = NO_BENDING  # a bar without a joint is hinged at both ends
    chain = connected_parts(joint_at[(joint_at >= 0).all(1)], len(pairs))
    return BendingChains(np.column_stack([first, middle, second]), pairs // 2, joint_at, chain)


def named_cables(net: Net) -> np.ndarray:
    """Return the number (m,) of each element's name in the column `cable`; -1: no name."""
    if not net.cable_given:
        return np.full(net.m, -1)
    names, number = np.unique(np.array(net.cable_given), return_inverse=True)
    return np.repeat(np.where(names[number] == "", -1, number), net.parts)


def meeting_pairs(ends: np.ndarray, node: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """Return pairs (k, 2) of element ends at nodes where exactly two elements of one kind meet.

    ends : (e,) ascending, 2 e and 2 e + 1 of element e; node : (2 m,) of each end; kind : (m,) of elements
    """
    key = node[ends] * (int(kind.max(initial=0)) + 1) + kind[ends // 2]
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    first_of_two = first[count == 2]
    return np.column_stack([ends[order[first_of_two]], ends[order[first_of_two + 1]]])
