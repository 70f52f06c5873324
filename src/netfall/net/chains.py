"""Chains of bars that resist bending: at which nodes they go on, from one bar to the next.

At a node two bars with bending are joined if they are the only two of one piece that the column `cable`
names, or else the only two of their group that meet there. Held or free, at any angle. A chain has no moment
at its ends.
"""

from typing import NamedTuple

import numpy as np

from netfall.net.net import Net
from netfall.net.parts import parts_of

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
