"""Small dense linear algebra in one order of operations, with the same bits on any processor.

BLAS and LAPACK choose blocking and summation order by the processor. Here each entry is a sum in ascending
order, without fused operations.
"""

import math

import numpy as np

from netfall.core.kernels import kernel
from netfall.core.types import AnyArray, FloatArray

INVERSE_ITERATIONS = 4  # each reduces the other eigenvectors to some 1e-10


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
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            for c in range(m):
                b[i, c] -= upper[i, k] * b[k, c]
        for c in range(m):
            b[i, c] /= upper[i, i]


def solve_complex(matrix: AnyArray, b: AnyArray) -> None:
    """Solve systems matrix x = b in place by Gauss with row pivoting.

    matrix : (f, n, n) complex, overwritten; b : (f, n, m) complex. numpy's own products and quotients of
    complex numbers depend on the processor, those below do not.
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


def count_eigenvalues_below(diagonal: list[float], off_diagonal: list[float], value: float) -> int:
    """Count the eigenvalues of a symmetric tridiagonal matrix below a value (Sturm's sequence).

    off_diagonal : as long as `diagonal`; its last number does not count
    """
    count, pivot, square = 0, 1.0, 0.0
    for on, off in zip(diagonal, off_diagonal):
        pivot = on - value - square / pivot
        if pivot == 0.0:
            pivot = 1e-300
        count += pivot < 0.0
        square = off * off
    return count


def largest_tridiagonal_eigenpair(
    diagonal: list[float], off_diagonal: list[float]
) -> tuple[float, list[float]]:
    """Compute the largest eigenvalue, to its last digits, and unit eigenvector of a tridiagonal matrix.

    The matrix is symmetric.
    diagonal, off_diagonal : as in `count_eigenvalues_below`
    It uses bisection, then inverse iteration from just above the eigenvalue, where the shifted matrix needs
    no pivoting.
    """
    n, off = len(diagonal), [*off_diagonal[: len(diagonal) - 1], 0.0]
    radius = [abs(off[i - 1]) + abs(off[i]) for i in range(n)]
    low = min(a - r for a, r in zip(diagonal, radius))
    high = max(a + r for a, r in zip(diagonal, radius))
    size = max(abs(low), abs(high))
    low, high = low - 1e-15 * size, high + 1e-15 * size
    middle = 0.5 * (low + high)
    while low < middle < high:
        if count_eigenvalues_below(diagonal, off, middle) == n:
            high = middle
        else:
            low = middle
        middle = 0.5 * (low + high)
    above = high + 1e-14 * size
    pivot = [above - diagonal[0]]
    for i in range(1, n):
        pivot.append(above - diagonal[i] - off[i - 1] * off[i - 1] / pivot[i - 1])
    vector = [1.0] * n
    for _ in range(INVERSE_ITERATIONS):
        for i in range(1, n):
            vector[i] += off[i - 1] / pivot[i - 1] * vector[i - 1]
        square = 0.0
        for i in range(n - 1, -1, -1):
            if i < n - 1:
                vector[i] += off[i] * vector[i + 1]
            vector[i] /= pivot[i]
            square += vector[i] * vector[i]
        vector = [v / math.sqrt(square) for v in vector]
    return high, vector
