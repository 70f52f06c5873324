"""Small dense linear algebra in one order of operations, with the same bits on any processor.

BLAS and LAPACK choose blocking and summation order by the processor. Here each entry is a sum in ascending
order, without fused operations.

Least squares with a possibly rank-deficient matrix: Householder triangularisation with column pivoting (Golub
and Van Loan, Matrix Computations, 5.5.7) separates the unknowns that the equations determine from the free
ones. Each free one spans a direction of the null space.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from netfall.core.arrays import AnyArray, FloatArray
from netfall.core.kernels import kernel


def product(a: FloatArray, b: FloatArray) -> np.ndarray:
    """Compute a (n, k) b (k, m)."""
    out = np.zeros((len(a), b.shape[1]))
    for column, row in zip(a.T, b):
        out += column[:, None] * row
    return out


@kernel
def factorise_cholesky(matrix: FloatArray) -> int:
    """Compute Cholesky's factor U of a symmetric matrix U^T U (n, n), in place, in the upper half.

    Return the number of singular rows; they become 1 on the diagonal and 0 otherwise.
    """
    n, singular = matrix.shape[0], 0
    for k in range(n):
        root = math.sqrt(matrix[k, k]) if matrix[k, k] > 0.0 else 0.0
        singular += root == 0.0
        for j in range(k, n):
            matrix[k, j] = matrix[k, j] / root if root > 0.0 else (1.0 if j == k else 0.0)
        for i in range(k + 1, n):
            factor = matrix[k, i]
            for j in range(i, n):
                matrix[i, j] -= factor * matrix[k, j]
    return singular


@kernel
def solve_cholesky_columns(upper: FloatArray, b: FloatArray) -> None:
    """Solve U^T U x = b in place, b (n, m), for each column."""
    n, m = b.shape
    for i in range(n):
        for c in range(m):
            b[i, c] /= upper[i, i]
        for k in range(i + 1, n):
            for c in range(m):
                b[k, c] -= upper[i, k] * b[i, c]
    substitute_back(upper, n, b)


def solve_complex(matrix: AnyArray, b: AnyArray) -> None:
    """Solve systems matrix x = b in place by Gauss with row pivoting.

    matrix : (f, n, n) complex, overwritten; b : (f, n, m) complex. numpy's products and quotients of complex
    numbers depend on the processor; those below do not.
    """
    n, each = b.shape[1], np.arange(len(b))
    for k in range(n):
        column, low = matrix[:, k:, k], slice(k + 1, n)
        best = k + np.argmax(column.real * column.real + column.imag * column.imag, axis=1)
        for rows in (matrix, b):
            rows[each, k], rows[each, best] = rows[each, best], rows[each, k]
        factor = _quotient(matrix[:, low, k], matrix[:, k, k, None])[:, :, None]
        matrix[:, low, low] -= _product(factor, matrix[:, k, None, low])
        b[:, low] -= _product(factor, b[:, k, None])
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[:, i] -= _product(matrix[:, i, k, None], b[:, k])
        b[:, i] = _quotient(b[:, i], matrix[:, i, i, None])


def _product(a: AnyArray, b: AnyArray) -> np.ndarray:
    """Compute the product of complex numbers."""
    return _complex(a.real * b.real - a.imag * b.imag, a.real * b.imag + a.imag * b.real)


def _quotient(a: AnyArray, b: AnyArray) -> np.ndarray:
    """Compute the quotient of complex numbers (Smith 1962): by the larger part of b."""
    is_real = np.abs(b.real) >= np.abs(b.imag)
    large, small = np.where(is_real, b.real, b.imag), np.where(is_real, b.imag, b.real)
    ratio = small / large
    divisor = large + small * ratio
    real = np.where(is_real, a.real + a.imag * ratio, a.real * ratio + a.imag) / divisor
    return _complex(real, np.where(is_real, a.imag - a.real * ratio, a.imag * ratio - a.real) / divisor)


def _complex(real: FloatArray, imag: FloatArray) -> np.ndarray:
    """Return complex numbers of two parts."""
    numbers = np.empty(real.shape, complex)
    numbers.real, numbers.imag = real, imag
    return numbers


class LeastSquaresSolution(NamedTuple):
    """Solution of the equations A x = b.

    x : (c,) the smallest x that minimises |A x - b|; null : (c, k) orthonormal, A null = 0
    least : the smallest nonzero pivot relative to the largest
    """

    x: np.ndarray
    null: np.ndarray
    least: float


@kernel
def triangularise(a: Any, b: Any, share: Any, scale: Any, order: Any, pivot: Any, work: Any) -> Any:
    """Make a (r, c) upper triangular in place, and transform b (r,) likewise; return the rank.

    The rank is the number of pivots above `share` times the largest, or times `scale` if that is larger.
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
        if not size > share * max(pivot[0], scale) or size == 0.0:
            return k
        order[k], order[best] = order[best], order[k]
        for i in range(rows):
            a[i, k], a[i, best] = a[i, best], a[i, k]
        sign = 1.0 if a[k, k] >= 0.0 else -1.0
        factor = 1.0 / (size * (size + abs(a[k, k])))
        a[k, k] += sign * size  # the column now holds the vector of the reflection
        along = 0.0
        for j in range(k + 1, columns):
            work[j] = 0.0
        for i in range(k, rows):
            along += a[i, k] * b[i]
            for j in range(k + 1, columns):
                work[j] += a[i, k] * a[i, j]
        for i in range(k, rows):
            b[i] -= factor * along * a[i, k]
            for j in range(k + 1, columns):
                a[i, j] -= factor * work[j] * a[i, k]
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


def least_squares(
    A: np.ndarray, b: np.ndarray, share: float = 1e-12, scale: float = 0.0
) -> LeastSquaresSolution:
    """Return the smallest x (c,) that minimises |A x - b|, and the null space; A (r, c), b (r,).

    share : relative to the largest pivot, or to `scale` if that is larger; smaller pivots count as zero
    scale : size of the terms whose sums are the entries of A, if all of them may cancel
    """
    a, b, c = np.array(A, float, order="C"), np.array(b, float), A.shape[1]
    order, pivot, work = np.empty(c, np.int64), np.empty(c), np.empty(c)
    rank = triangularise(a, b, share, scale, order, pivot, work)
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
