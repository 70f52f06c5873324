"""Which things hang together, and which points lie close to one another."""

import numpy as np

from netfall.core.kernels import kernel
from netfall.net.net import pair_key
from netfall.numerics.sets import among


def parts_of(pairs: np.ndarray, count: int) -> np.ndarray:
    """For each of `count` things the lowest of the part that it belongs to; pairs (k, 2) join two of them."""
    label = np.empty(count, np.int64)
    label_parts(np.ascontiguousarray(pairs), label)
    return label


def part_has(label: np.ndarray, some: np.ndarray) -> np.ndarray:
    """Whether the part of each thing, by its label (n,) of `parts_of`, has one of some (n,) bool."""
    found = np.zeros(len(label), bool)
    found[label[some]] = True
    return found[label]


@kernel
def label_parts(elements, label):
    """Write the lowest particle of the part of the net that each belongs to.

    elements : (m, 2); label : (n,), out

    Union by path halving; scipy has the same, but takes a tenth of a second to load, before every run.
    """
    for p in range(label.shape[0]):
        label[p] = p
    for e in range(elements.shape[0]):
        a, b = elements[e, 0], elements[e, 1]
        while label[a] != a:
            label[a] = label[label[a]]
            a = label[a]
        while label[b] != b:
            label[b] = label[label[b]]
            b = label[b]
        label[max(a, b)] = min(a, b)
    for p in range(label.shape[0]):
        label[p] = label[label[p]]


def unjoined_pairs(x: np.ndarray, elements: np.ndarray, distance: float) -> np.ndarray:
    """The pairs of `close_pairs` that no element of elements (m, 2) joins."""
    pairs = close_pairs(x, distance)
    return pairs[~among(pair_key(pairs, len(x)), pair_key(elements, len(x)))]


def close_pairs(x: np.ndarray, distance: float) -> np.ndarray:
    """(k, 2) pairs of points x (n, 3) no farther apart than `distance`, the lower number first.

    Along any line through space they are no farther apart either: only neighbours along one are compared.
    """
    line = np.array([0.57721566, 0.20787958, 0.78970000])  # of length near 1, along no axis or diagonal
    along = x @ line
    order = np.argsort(along, kind="stable")
    along, found = along[order], [np.zeros((0, 2), np.int64)]
    for k in range(1, len(x)):
        near = np.flatnonzero(along[k:] - along[:-k] <= 1.01 * distance)
        if not len(near):
            break
        pairs = np.column_stack([order[near], order[near + k]])
        apart = np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)
        found.append(pairs[apart <= distance])
    return np.unique(np.sort(np.concatenate(found), axis=1), axis=0)
