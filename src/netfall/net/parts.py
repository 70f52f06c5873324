"""Which things hang together, and which points lie close to one another."""

import numpy as np

from netfall.net.net import pair_key
from netfall.numerics.sets import among


def parts_of(pairs: np.ndarray, count: int) -> np.ndarray:
    """For each of `count` things the lowest of the part that it belongs to; pairs (k, 2) join two of them."""
    from scipy.sparse import coo_array  # here: it takes 0.2 s to load
    from scipy.sparse.csgraph import connected_components

    joined = coo_array((np.ones(len(pairs)), tuple(pairs.T)), (count, count))
    _, part = connected_components(joined, directed=False)
    return np.unique(part, return_index=True)[1][part]


def part_has(label: np.ndarray, some: np.ndarray) -> np.ndarray:
    """Whether the part of each thing, by its label (n,) of `parts_of`, has one of some (n,) bool."""
    found = np.zeros(len(label), bool)
    found[label[some]] = True
    return found[label]


def unjoined_pairs(x: np.ndarray, elements: np.ndarray, distance: float) -> np.ndarray:
    """The pairs of `close_pairs` that no element of elements (m, 2) joins."""
    pairs = close_pairs(x, distance)
    return pairs[~among(pair_key(pairs, len(x)), pair_key(elements, len(x)))]


def close_pairs(x: np.ndarray, distance: float) -> np.ndarray:
    """(k, 2) pairs of points x (n, 3) no farther apart than `distance`, the lower number first."""
    from scipy.spatial import cKDTree  # here: it takes 0.2 s to load

    pairs = cKDTree(x).query_pairs(distance, output_type="ndarray")
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
