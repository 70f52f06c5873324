"""Direct solver for sparse symmetric systems, in one order of operations: the same bits on any processor.

It factorises L D L^T row by row without pivoting (Davis, Direct Methods for Sparse Linear Systems, 2006, ch.
4), in the order of nested dissection by METIS. scipy's solver calls BLAS, whose order of summation depends on
the processor.
"""

from typing import Any

import numpy as np

from netfall.core.kernels import kernel

PIVOT_TOLERANCE = 1e-10  # relative to the terms of a pivot; less is rounding, or has at most six digits
MOVING_SHARE = 1e-3  # relative to the largest displacement; rows that move less count as fixed
FORCE_TOLERANCE = 1e-8  # relative to the terms of a force; less counts as no force
MAX_DELAYED_ROWS = 20  # number of rows moved to the end, each at the cost of a new factorisation


class Singular(ValueError):
    """The matrix is singular; rows : those that move in a displacement without force."""

    def __init__(self, rows: np.ndarray):
        super().__init__(f"singular in {len(rows)} rows")
        self.rows = rows


@kernel
def count_columns(start: Any, column: Any, parent: Any, count: Any, seen: Any) -> None:
    """Compute the elimination tree (n,), and the entries (n,) below the diagonal of each column of L.

    start, column : rows of the matrix, only entries left of the diagonal; seen : (n,), overwritten
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
def factorise(matrix: Any, parent: Any, lower: Any, d: Any, work: Any, drops: bool) -> Any:
    """Write L, by columns, and D (n,); return the first row whose pivot is zero or nan, otherwise n.

    A pivot counts as zero if it is within rounding error.
    matrix : start, column, value, left of the diagonal, the diagonal (n,) and its size (n,)
    drops : whether to drop the rows whose pivot is not positive, and continue
    lower : start, row, value of L
    work : row of sums (n,) of zeros, and stack, path, filled, seen (n,)
    """
    start, column, value, diagonal, size = matrix
    begin, row, factor = lower
    sums, stack, path, filled, seen = work
    n = d.shape[0]
    for k in range(n):
        seen[k], filled[k], top = k, 0, n
        for entry in range(start[k], start[k + 1]):
            i, length = column[entry], 0
            sums[i] = value[entry]
            while seen[i] != k:  # up the tree to a visited node: all columns that reach row k
                path[length], seen[i] = i, k
                length += 1
                i = parent[i]
            while length > 0:
                top, length = top - 1, length - 1
                stack[top] = path[length]
        d[k], size_sum = diagonal[k], size[k]
        for position in range(top, n):  # topological order: each column precedes those that it changes
            i = stack[position]
            row_sum, sums[i] = sums[i], 0.0
            end = begin[i] + filled[i]
            for entry in range(begin[i], end):
                sums[row[entry]] -= factor[entry] * row_sum
            row[end], factor[end] = k, row_sum / d[i]
            d[k] -= factor[end] * row_sum
            size_sum += abs(factor[end] * row_sum)
            filled[i] += 1
        if drops:
            if not d[k] > 0.0:
                d[k] = np.inf
        elif not abs(d[k]) > PIVOT_TOLERANCE * size_sum or not abs(d[k]) < np.inf:
            return k
    return n


@kernel
def substitute(lower: Any, d: Any, b: Any) -> None:
    """Solve L D L^T x = b in place, b (n,)."""
    begin, row, factor = lower
    for k in range(b.shape[0]):
        value = b[k]
        for entry in range(begin[k], begin[k + 1]):
            b[row[entry]] -= factor[entry] * value
    for k in range(b.shape[0] - 1, -1, -1):
        value = b[k] / d[k]
        for entry in range(begin[k], begin[k + 1]):
            value -= factor[entry] * b[row[entry]]
        b[k] = value


@kernel
def null_displacement(lower: Any, filled: Any, v: Any) -> None:
    """Write the displacement v (k + 1,) without force in which the last row moves by 1.

    filled : (n,) number of computed entries of each column of L
    """
    begin, row, factor = lower
    v[-1] = 1.0
    for j in range(v.shape[0] - 2, -1, -1):
        v[j] = 0.0
        for entry in range(begin[j], begin[j] + filled[j]):
            v[j] -= factor[entry] * v[row[entry]]


def solve_sparse(
    ends: np.ndarray, q: np.ndarray, diagonal: np.ndarray, b: np.ndarray, size: np.ndarray | None = None
) -> np.ndarray:
    """Solve a symmetric matrix times x = b for x (n, m), b (n, m). Rank 0. Raises Singular.

    ends : (k, 2) pairs of different rows, repetitions allowed; q : (k,) added at both positions of a pair
    diagonal : (n,); size : (n,) sums of the absolute values of its terms, None: the diagonal itself

    A zero pivot does not imply that an indefinite matrix is singular: its row is then eliminated last.
    """
    size = np.abs(diagonal) if size is None else size
    order = nested_dissection_order(ends, len(diagonal))
    for _ in range(MAX_DELAYED_ROWS):
        number = np.argsort(order)
        lower, d, last, filled = _factors(number[ends], q, diagonal[order], size[order])
        if last == len(order):
            x = np.array(b[order].T, float, order="C")
            for column in x:
                substitute(lower, d, column)
            return np.ascontiguousarray(x.T)[number]
        v, rows = np.empty(last + 1), order[: last + 1]
        null_displacement(lower, filled, v)
        displacement = np.zeros(len(order))
        displacement[rows] = v
        if last + 1 == len(order) or _is_forceless(ends, q, diagonal, size, displacement):
            break
        order = np.append(np.delete(order, last), order[last])
    raise Singular(np.sort(rows[np.abs(v) > MOVING_SHARE * np.abs(v).max()]))


def _factors(ends: Any, q: Any, diagonal: Any, size: Any) -> Any:
    """Factorise a matrix given by pairs as in `solve_sparse`; return the values of `sparse_factors`."""
    n = len(diagonal)
    high, low = np.sort(ends, axis=1).T[::-1]
    places, pair_place = np.unique(high * n + low, return_inverse=True)
    start = np.searchsorted(places, n * np.arange(n + 1))
    value = np.bincount(pair_place, q, len(places)).astype(float)  # without pairs the sums are integers
    column = places % n
    return sparse_factors((start, column, value, diagonal, size), elimination_tree(start, column))


def sparse_factors(matrix: tuple[Any, ...], tree: tuple[Any, ...], drops: bool = False) -> Any:
    """Return L by columns, D, the row at which the factorisation ended, and the entries per column of L.

    matrix, drops : as in `factorise`; tree : of `elimination_tree`
    """
    (parent, count), n = tree, len(matrix[3])
    begin = np.concatenate([[0], np.cumsum(count)])
    lower = (begin, np.empty(begin[-1], np.int64), np.empty(begin[-1]))
    d, work = np.empty(n), (np.zeros(n), *np.empty((4, n), np.int64))
    last = factorise(matrix, parent, lower, d, work, drops)
    return lower, d, last, work[3]


def elimination_tree(start: np.ndarray, column: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the elimination tree (n,), and the number (n,) of entries below the diagonal of L's columns."""
    parent, count, seen = np.empty((3, len(start) - 1), np.int64)
    count_columns(start, column, parent, count, seen)
    return parent, count


def _is_forceless(ends: Any, q: Any, diagonal: Any, size: Any, v: Any) -> bool:
    """Return whether the matrix times v (n,) is zero to rounding."""
    force = diagonal * v
    np.add.at(force, ends[:, 0], q * v[ends[:, 1]])
    np.add.at(force, ends[:, 1], q * v[ends[:, 0]])
    return np.abs(force).max() <= FORCE_TOLERANCE * (size * np.abs(v)).max()


def nested_dissection_order(ends: np.ndarray, n: int) -> np.ndarray:
    """Return an order (n,) of the rows for which L has few entries."""
    import pymetis

    both = np.unique(np.concatenate([ends, ends[:, ::-1]]), axis=0)
    if not len(both):
        return np.arange(n)
    start = np.searchsorted(both[:, 0], np.arange(n + 1))
    order, _ = pymetis.nested_dissection(adjacency=pymetis.CSRAdjacency(start, both[:, 1]))
    return np.asarray(order, np.int64)
