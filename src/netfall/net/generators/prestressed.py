"""A net in equilibrium under its prestress, from the force densities of its groups."""

import numpy as np

from netfall.net.net import Net


def prestressed_net(x, fixed, kinds, group_names: list[str]) -> Net:
    """The net of groups of elements, in the order of their nodes.

    x : (n, 3) [m]; fixed : (n, 3) bool
    kinds : for each group the nodes (..., 2) of its elements and their force density [N/m], a number or (...)
    """
    elements = np.concatenate([pairs.reshape(-1, 2) for pairs, _ in kinds])
    density = np.concatenate([np.broadcast_to(value, pairs.shape[:-1]).ravel() for pairs, value in kinds])
    group = np.repeat(np.arange(len(kinds)), [pairs.size // 2 for pairs, _ in kinds])
    order = np.lexsort((elements.max(1), elements.min(1)))
    net = Net(x, fixed, elements[order], group[order], group_names)
    net.prestress = density[order] * net.lengths()
    return net


def closed_rings(nodes: np.ndarray) -> np.ndarray:
    """Elements (..., k, 2) of the rings through nodes (..., k)."""
    return np.stack([nodes, np.roll(nodes, -1, -1)], -1)
