"""Least squares with a possibly rank-deficient matrix, with the same bits on any processor.

Householder triangularisation with column pivoting (Golub and Van Loan, Matrix Computations, 5.5.7) separates
the unknowns that the equations determine from the free ones. Each free one spans a direction of the null
space.
"""

from typing import Any, NamedTuple

import numpy as np

from netfall.core.kernels import kernel
from netfall.core.linear import product


class LeastSquaresSolution(NamedTuple):
    """Solution of the equations A x = b.

    x : (c,) the smallest x that minimises |A x - b|; null : (c, k) orthonormal, A null = 0
    least : the smallest nonzero pivot relative to the largest
    """

    x: np.ndarray
    null: np.ndarray
    least: float


@kernel
def triangularise(a: Any, b: Any, share: Any, order: Any, pivot: Any, work: Any) -> Any:
    """Make a (r, c) upper triangular in place, and transform b (r,) likewise; return the rank.

    The rank is the number of pivots above `share` times the largest.
    order : (c,), out, the columns in the order of the pivots; pivot : (c,), out, their sizes; work : (c,)
    """
    rows, columns = a.shape
    for j in range(columns):
        order[j], pivot[j] = j, 0.0
    for k in range(min(rows, columns)):
        for j in range(k, columns):
            work[j] = 0.0
        for i in range(k, rows):
            for j in range(k, columns):
                work[j] += a[i, j] * a[i, j]
        best = k
        for j in range(k + 1, columns):
            if work[j] > work[best]:
                best = j
        size = np.sqrt(work[best])
        pivot[k] = size
        if not size > share * pivot[0] or size == 0.0:
            return k
        order[k], order[best] = order[best], order[k]
        for i in range(rows):
            a[i, k], a[i, best] = a[i, best], a[i, k]
        sign = 1.0 if a[k, k] >= 0.0 else -1.0
        scale = 1.0 / (size * (size + abs(a[k, k])))
        a[k, k] += sign * size  # the column now holds the vector of the reflection
        along = 0.0
        for j in range(k + 1, columns):
            work[j] = 0.0
        for i in range(k, rows):
            along += a[i, k] * b[i]
            for j in range(k + 1, columns):
                work[j] += a[i, k] * a[i, j]
        for i in range(k, rows):
            b[i] -= scale * along * a[i, k]
            for j in range(k + 1, columns):
                a[i, j] -= scale * work[j] * a[i, k]
        a[k, k] = -sign * size
    return min(rows, columns)


@kernel
def substitute_back(a: Any, rank: Any, x: Any) -> None:
    """Solve R x = b in place; R (rank, rank) is the upper triangle of a, x (rank, m)."""
    for i in range(rank - 1, -1, -1):
        for k in range(i + 1, rank):
            for c in range(x.shape[1]):
                x[i, c] -= a[i, k] * x[k, c]
        for c in range(x.shape[1]):
            x[i, c] /= a[i, i]


@kernel
def orthonormalise(z: Any) -> None:
    """Make the columns of z (n, k) orthonormal in place, by the Gram-Schmidt method, twice."""
    n, k = z.shape
    for _turn in range(2):
        for c in range(k):
            for before in range(c):
                dot = 0.0
                for i in range(n):
                    dot += z[i, before] * z[i, c]
                for i in range(n):
                    z[i, c] -= dot * z[i, before]
            square = 0.0
            for i in range(n):
                square += z[i, c] * z[i, c]
            for i in range(n):
                z[i, c] /= np.sqrt(square)


def least_squares(A: np.ndarray, b: np.ndarray, share: float = 1e-12) -> LeastSquaresSolution:
    """Return the smallest x (c,) that minimises |A x - b|, and the null space; A (r, c), b (r,).

    share : relative to the largest pivot; smaller pivots count as zero
    """
    a, b, c = np.array(A, float, order="C"), np.array(b, float), A.shape[1]
    order, pivot, work = np.empty(c, np.int64), np.empty(c), np.empty(c)
    rank = triangularise(a, b, share, order, pivot, work)
    fixed, free = order[:rank], order[rank:]
    solved = np.column_stack([b[:rank], -a[:rank, rank:]])
    substitute_back(a, rank, solved)
    x, null = np.zeros(c), np.zeros((c, len(free)))
    x[fixed], null[fixed], null[free] = solved[:, 0], solved[:, 1:], np.eye(len(free))
    orthonormalise(null)
    pivot_ratio = pivot[rank - 1] / pivot[0] if rank else 0.0
    return LeastSquaresSolution(x - times(null, times(null.T, x)), null, pivot_ratio)


def times(A: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return A (n, k) times x (k,); each entry is a sum in ascending order."""
    return product(A, x[:, None])[:, 0]
