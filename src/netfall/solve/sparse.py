"""A sparse symmetric system solved directly, in one order of operations: the same bits on any processor.

The factors L D L^T row by row, without pivots (Davis, Direct Methods for Sparse Linear Systems, 2006, ch. 4),
in the order of nested dissection by METIS. scipy's solver calls BLAS, which sums as the processor likes.
"""

import numpy as np

from netfall.compile import kernel


@kernel
def count_columns(start, column, parent, count, seen):
    """The elimination tree (n,) and the entries (n,) below the diagonal of each column of L.

    start, column : rows of the matrix, entries left of the diagonal alone; seen : (n,), overwritten
    """
    for k in range(parent.shape[0]):
        parent[k], seen[k], count[k] = -1, k, 0
        for entry in range(start[k], start[k + 1]):
            i = column[entry]
            while seen[i] != k:
                if parent[i] == -1:
                    parent[i] = k
                count[i] += 1
                seen[i] = k
                i = parent[i]


@kernel
def factorise(matrix, parent, lower, d, work):
    """Write L, by columns, and D (n,); the first row whose pivot is zero or no number, n if there is none.

    matrix : start, column, value, left of the diagonal, and the diagonal (n,); lower : start, row, value of L
    work : row of sums (n,) of zeros, and stack, path, filled, seen (n,)
    """
    start, column, value, diagonal = matrix
    begin, row, factor = lower
    sums, stack, path, filled, seen = work
    n = d.shape[0]
    for k in range(n):
        seen[k], filled[k], top = k, 0, n
        for entry in range(start[k], start[k + 1]):
            i, length = column[entry], 0
            sums[i] = value[entry]
            while seen[i] != k:  # up the tree to what was met before: all columns that reach row k
                path[length], seen[i] = i, k
                length += 1
                i = parent[i]
            while length > 0:
                top, length = top - 1, length - 1
                stack[top] = path[length]
        d[k] = diagonal[k]
        for place in range(top, n):  # in this order each column comes before those that it changes
            i = stack[place]
            sum, sums[i] = sums[i], 0.0
            end = begin[i] + filled[i]
            for entry in range(begin[i], end):
                sums[row[entry]] -= factor[entry] * sum
            row[end], factor[end] = k, sum / d[i]
            d[k] -= factor[end] * sum
            filled[i] += 1
        if not abs(d[k]) > 0.0 or not abs(d[k]) < np.inf:
            return k
    return n


@kernel
def substitute(lower, d, b):
    """Solve L D L^T x = b in place, b (n, m)."""
    begin, row, factor = lower
    n, m = b.shape
    for k in range(n):
        for entry in range(begin[k], begin[k + 1]):
            for c in range(m):
                b[row[entry], c] -= factor[entry] * b[k, c]
    for k in range(n - 1, -1, -1):
        for c in range(m):
            b[k, c] /= d[k]
        for entry in range(begin[k], begin[k + 1]):
            for c in range(m):
                b[k, c] -= factor[entry] * b[row[entry], c]


def solve_sparse(ends: np.ndarray, q: np.ndarray, diagonal: np.ndarray, b: np.ndarray) -> np.ndarray | None:
    """x (n, m) of a symmetric matrix times x = b (n, m); None where a pivot is zero. Rank 0.

    ends : (k, 2) pairs of different rows, a pair as often as it likes; q : (k,) added at both their places
    diagonal : (n,)
    """
    n = len(diagonal)
    order, number = _dissected(ends, n)
    high, low = np.sort(number[ends], axis=1).T[::-1]
    places, of_pair = np.unique(high * n + low, return_inverse=True)
    start = np.searchsorted(places, n * np.arange(n + 1))
    matrix = (start, places % n, np.bincount(of_pair, q, len(places)), diagonal[order])
    parent, count, seen = np.empty((3, n), np.int64)
    count_columns(start, matrix[1], parent, count, seen)
    begin = np.concatenate([[0], np.cumsum(count)])
    lower = (begin, np.empty(begin[-1], np.int64), np.empty(begin[-1]))
    d, work = np.empty(n), (np.zeros(n), *np.empty((4, n), np.int64))
    if factorise(matrix, parent, lower, d, work) < n:
        return None
    x = np.ascontiguousarray(b[order], float)
    substitute(lower, d, x)
    return x[number]


def _dissected(ends: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """An order (n,) of the rows in which L has few entries, and the place (n,) of each in it."""
    import pymetis

    both = np.unique(np.concatenate([ends, ends[:, ::-1]]), axis=0)
    if not len(both):
        return np.arange(n), np.arange(n)
    start = np.searchsorted(both[:, 0], np.arange(n + 1))
    order, number = pymetis.nested_dissection(adjacency=pymetis.CSRAdjacency(start, both[:, 1]))
    return np.asarray(order, np.int64), np.asarray(number, np.int64)
