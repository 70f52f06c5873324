"""Which things hang together."""

import numpy as np

from netfall.ground.compile import kernel


def parts_of(pairs: np.ndarray, count: int) -> np.ndarray:
    """For each of `count` things the lowest of the part that it belongs to; pairs (k, 2) join two of them."""
    label = np.empty(count, np.int64)
    label_parts(np.ascontiguousarray(pairs), label)
    return label


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
