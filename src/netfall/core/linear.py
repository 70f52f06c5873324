"""Small dense linear algebra in one order of operations, with the same bits on any processor.

BLAS and LAPACK choose blocking and summation order by the processor. Here each entry is a sum in ascending
order, without fused operations. The innermost loops go along rows, so that they use vector registers.
"""

import math

from netfall.core.kernels import inner_kernel, kernel
from netfall.core.types import FloatArray, IntArray

INVERSE_ITERATIONS = 4  # each reduces the other eigenvectors to some 1e-10


@kernel
def product(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Compute out (n, m) = a (n, k) b (k, m)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = 0.0
        for k in range(b.shape[0]):
            for j in range(out.shape[1]):
                out[i, j] += a[i, k] * b[k, j]


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
def solve_cholesky(upper: FloatArray, b: FloatArray) -> None:
    """Solve U^T U x = b in place, b (n,)."""
    n = upper.shape[0]
    for i in range(n):
        b[i] /= upper[i, i]
        value = b[i]
        for j in range(i + 1, n):
            b[j] -= upper[i, j] * value
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= upper[i, k] * b[k]
        b[i] /= upper[i, i]


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


@kernel
def solve_complex(matrix: IntArray, b: IntArray) -> None:
    """Solve matrix x = b in place by Gauss with row pivoting; matrix (n, n) and b (n, m) complex."""
    n, m = b.shape
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            candidate, pivot = matrix[i, k], matrix[best, k]
            if (
                candidate.real * candidate.real + candidate.imag * candidate.imag
                > pivot.real * pivot.real + pivot.imag * pivot.imag
            ):
                best = i
        for j in range(n):
            matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
        for c in range(m):
            b[k, c], b[best, c] = b[best, c], b[k, c]
        for i in range(k + 1, n):
            factor = matrix[i, k] / matrix[k, k]
            for j in range(k + 1, n):
                matrix[i, j] -= factor * matrix[k, j]
            for c in range(m):
                b[i, c] -= factor * b[k, c]
    for i in range(n - 1, -1, -1):
        for c in range(m):
            for k in range(i + 1, n):
                b[i, c] -= matrix[i, k] * b[k, c]
            b[i, c] = b[i, c] / matrix[i, i]


@inner_kernel
def count_eigenvalues_below(diagonal: FloatArray, off_diagonal: FloatArray, value: float) -> int:
    """Count the eigenvalues of a symmetric tridiagonal matrix below a value (Sturm's sequence)."""
    count, pivot = 0, 1.0
    for i in range(diagonal.shape[0]):
        square = off_diagonal[i - 1] * off_diagonal[i - 1] if i > 0 else 0.0
        pivot = diagonal[i] - value - square / pivot
        if pivot == 0.0:
            pivot = 1e-300
        count += pivot < 0.0
    return count


@kernel
def largest_tridiagonal_eigenpair(
    diagonal: FloatArray, off_diagonal: FloatArray, pivot: FloatArray, vector: FloatArray
) -> float:
    """Compute the largest eigenvalue, to its last digits, and unit eigenvector of a tridiagonal matrix.

    The matrix is symmetric.
    diagonal : (n,); off_diagonal : (n - 1,) or more; pivot : (n,), overwritten; vector : (n,), out
    It uses bisection, then inverse iteration from just above the eigenvalue, where the shifted matrix needs
    no pivoting.
    """
    n, low, high = diagonal.shape[0], diagonal[0], diagonal[0]
    for i in range(n):
        radius = (abs(off_diagonal[i - 1]) if i > 0 else 0.0) + (abs(off_diagonal[i]) if i < n - 1 else 0.0)
        low, high = min(low, diagonal[i] - radius), max(high, diagonal[i] + radius)
    size = max(abs(low), abs(high))
    low, high = low - 1e-15 * size, high + 1e-15 * size
    middle = 0.5 * (low + high)
    while low < middle < high:
        if count_eigenvalues_below(diagonal, off_diagonal, middle) == n:
            high = middle
        else:
            low = middle
        middle = 0.5 * (low + high)
    above = high + 1e-14 * size
    pivot[0] = above - diagonal[0]
    for i in range(1, n):
        pivot[i] = above - diagonal[i] - off_diagonal[i - 1] * off_diagonal[i - 1] / pivot[i - 1]
    for i in range(n):
        vector[i] = 1.0
    for _ in range(INVERSE_ITERATIONS):
        for i in range(1, n):
            vector[i] += off_diagonal[i - 1] / pivot[i - 1] * vector[i - 1]
        square = 0.0
        for i in range(n - 1, -1, -1):
            if i < n - 1:
                vector[i] += off_diagonal[i] * vector[i + 1]
            vector[i] /= pivot[i]
            square += vector[i] * vector[i]
        for i in range(n):
            vector[i] /= math.sqrt(square)
    return high
