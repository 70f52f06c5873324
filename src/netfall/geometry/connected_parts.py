"""Connected parts of a graph, and pairs of points close to each other."""

import itertools

import numpy as np

from netfall.core.arrays import is_one_of
from netfall.geometry.net import pair_key

HASH_FACTORS = np.array([1, 1_000_003, 998_244_353_011])  # of the cell numbers along x, y and z


def connected_parts(pairs: np.ndarray, count: int) -> np.ndarray:
    """Return the lowest member of the part of each of `count` things; pairs (k, 2) join two of them."""
    from scipy.sparse import coo_array  # here: it takes 0.2 s to load
    from scipy.sparse.csgraph import connected_components

    joined = coo_array((np.ones(len(pairs)), tuple(pairs.T)), (count, count))
    _, part = connected_components(joined, directed=False)
    return np.unique(part, return_index=True)[1][part]


def part_contains(label: np.ndarray, some: np.ndarray) -> np.ndarray:
    """Tell whether the part of each thing, by label (n,) of `connected_parts`, contains one of some (n,)
    bool."""
    has = np.zeros(len(label), bool)
    has[label[some]] = True
    return has[label]


def unconnected_pairs(x: np.ndarray, elements: np.ndarray, distance: float) -> np.ndarray:
    """Return the pairs of `close_pairs` that no element of elements (m, 2) joins."""
    pairs = close_pairs(x, distance)
    return pairs[~is_one_of(pair_key(pairs, len(x)), pair_key(elements, len(x)))]


def close_pairs(x: np.ndarray, distance: float) -> np.ndarray:
    """Return the pairs (k, 2) of points x (n, 3) within `distance` of each other, lower number first."""
    if distance > 0.0 and not _may_be_close(x, distance):
        return np.zeros((0, 2), np.int64)
    from scipy.spatial import cKDTree  # here: it takes 0.3 s to load

    pairs = cKDTree(x).query_pairs(distance, output_type="ndarray")
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def _may_be_close(x: np.ndarray, distance: float) -> bool:
    """Tell whether two of points x (n, 3) share a cell in one of eight grids, as all close pairs do.

    Cells are four times as wide as `distance`. The grids are offset by half of a cell along each axis or not.
    Cells with the same hash count as one.
    """
    for offset in itertools.product((0.0, 0.5), repeat=3):
        cells = np.floor((x - x.min(0, initial=np.inf)) / (4.0 * distance) + offset).astype(np.int64)
        hashes = np.sort(cells @ HASH_FACTORS)
        if (hashes[1:] == hashes[:-1]).any():
            return True
    return False
