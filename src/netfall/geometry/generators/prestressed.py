"""Net in equilibrium under its prestress, from the force densities of its groups."""

from typing import Any

import numpy as np

from netfall.geometry.net import Net


def prestressed_net(x: Any, fixed: Any, kinds: Any, group_names: list[str], ring_groups: bool) -> Net:
    """Build the net of groups of elements, in the order of their nodes.

    x : (n, 3) [m]; fixed : (n, 3) bool
    kinds : for each group the nodes (..., 2) of its elements and their force density [N/m], a number or (...)
        (with more than two axes the first counts rings, from the middle)
    ring_groups : whether each ring of a group is a separate group, hoop1, hoop2, ... from the middle
    """
    elements = np.concatenate([pairs.reshape(-1, 2) for pairs, _ in kinds])
    density = np.concatenate([np.broadcast_to(value, pairs.shape[:-1]).ravel() for pairs, value in kinds])
    ring_counts = [len(pairs) if pairs.ndim > 2 else 1 for pairs, _ in kinds]
    sizes = [pairs.size // 2 for pairs, _ in kinds]
    tiers = [np.repeat(np.arange(n), size // max(n, 1)) for n, size in zip(ring_counts, sizes)]
    tier, group = np.concatenate(tiers), np.repeat(np.arange(len(kinds)), sizes)
    order = np.lexsort((elements.max(1), elements.min(1)))
    net = Net(x, fixed, elements[order], group[order], group_names, tier=tier[order])
    if ring_groups:
        rings = max(ring_counts)
        numbers, group = np.unique(net.group * rings + net.tier, return_inverse=True)
        several = np.bincount(numbers // rings) > 1
        net.group_names = [
            group_names[number // rings] + str(number % rings + 1) * bool(several[number // rings])
            for number in numbers
        ]
        net.group, net.tier = group, np.zeros_like(group)
    net.prestress = density[order] * net.lengths()
    return net


def closed_rings(nodes: np.ndarray) -> np.ndarray:
    """Return the elements (..., k, 2) of the rings through nodes (..., k)."""
    return np.stack([nodes, np.roll(nodes, -1, -1)], -1)
