"""A sparse symmetric system solved directly, in one order of operations: the same bits on any processor.

The factors L D L^T row by row, without pivots (Davis, Direct Methods for Sparse Linear Systems, 2006, ch. 4),
in the order of nested dissection by METIS. scipy's solver calls BLAS, which sums as the processor likes.
"""

import numpy as np

from netfall.core.kernels import kernel

LEFT = 1e-10  # of what a pivot is made of: less is rounding, or leaves the solution six digits at most
SHARE = 1e-3  # of the largest displacement: rows that move less are held
FORCELESS = 1e-8  # of what a displacement is met with: less is none, after the rounding above
MOST_DELAYED = 20  # rows that are eliminated last, each at the cost of all factors


class Singular(ValueError):
    """A matrix that has no inverse; rows : those that it gives a displacement without a force."""

    def __init__(self, rows: np.ndarray):
        super().__init__(f"singular in {len(rows)} rows")
        self.rows = rows


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
    """Write L, by columns, and D (n,); the first row whose pivot is zero to rounding or no number, else n.

    matrix : start, column, value, left of the diagonal, the diagonal (n,) and its size (n,)
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
            while seen[i] != k:  # up the tree to what was met before: all columns that reach row k
                path[length], seen[i] = i, k
                length += 1
                i = parent[i]
            while length > 0:
                top, length = top - 1, length - 1
                stack[top] = path[length]
        d[k], parts = diagonal[k], size[k]
        for place in range(top, n):  # in this order each column comes before those that it changes
            i = stack[place]
            sum, sums[i] = sums[i], 0.0
            end = begin[i] + filled[i]
            for entry in range(begin[i], end):
                sums[row[entry]] -= factor[entry] * sum
            row[end], factor[end] = k, sum / d[i]
            d[k] -= factor[end] * sum
            parts += abs(factor[end] * sum)
            filled[i] += 1
        if not abs(d[k]) > LEFT * parts or not abs(d[k]) < np.inf:
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


@kernel
def unheld(lower, filled, v):
    """Write what the rows before the last one do where that is displaced by 1, v (k + 1,), without a force.

    filled : (n,) entries of each column of L that are there
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
    """x (n, m) of a symmetric matrix times x = b (n, m). Rank 0. Raises Singular.

    ends : (k, 2) pairs of different rows, a pair as often as it likes; q : (k,) added at both their places
    diagonal : (n,); size : (n,) sums of the absolute values that it was summed up from, None: itself

    A pivot of zero does not make a matrix singular that has both signs: its row is then eliminated last.
    """
    size = np.abs(diagonal) if size is None else size
    order = dissected(ends, len(diagonal))
    for _ in range(MOST_DELAYED):
        number = np.argsort(order)
        lower, d, last, filled = _factors(number[ends], q, diagonal[order], size[order])
        if last == len(order):
            x = np.ascontiguousarray(b[order], float)
            substitute(lower, d, x)
            return x[number]
        v, rows = np.empty(last + 1), order[: last + 1]
        unheld(lower, filled, v)
        whole = np.zeros(len(order))
        whole[rows] = v
        if last + 1 == len(order) or _without_force(ends, q, diagonal, size, whole):
            break
        order = np.append(np.delete(order, last), order[last])
    raise Singular(np.sort(rows[np.abs(v) > SHARE * np.abs(v).max()]))


def _factors(ends, q, diagonal, size):
    """As `factors_of`, of pairs as in `solve_sparse`."""
    n = len(diagonal)
    high, low = np.sort(ends, axis=1).T[::-1]
    places, of_pair = np.unique(high * n + low, return_inverse=True)
    start = np.searchsorted(places, n * np.arange(n + 1))
    value = np.bincount(of_pair, q, len(places)).astype(float)  # without pairs it counts in integers
    return factors_of(start, places % n, value, diagonal, size)


def factors_of(start, column, value, diagonal, size):
    """L by columns, D, the row at which it ended, and how many entries of each column of L are there.

    As `matrix` of `factorise`.
    """
    n = len(diagonal)
    parent, count = tree_of(start, column)
    begin = np.concatenate([[0], np.cumsum(count)])
    lower = (begin, np.empty(begin[-1], np.int64), np.empty(begin[-1]))
    d, work = np.empty(n), (np.zeros(n), *np.empty((4, n), np.int64))
    last = factorise((start, column, value, diagonal, size), parent, lower, d, work)
    return lower, d, last, work[3]


def tree_of(start: np.ndarray, column: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The elimination tree (n,), and the entries (n,) below the diagonal of each column of L."""
    parent, count, seen = np.empty((3, len(start) - 1), np.int64)
    count_columns(start, column, parent, count, seen)
    return parent, count


def _without_force(ends, q, diagonal, size, v) -> bool:
    """Whether the matrix times v (n,) is zero but for rounding."""
    force = diagonal * v
    np.add.at(force, ends[:, 0], q * v[ends[:, 1]])
    np.add.at(force, ends[:, 1], q * v[ends[:, 0]])
    return np.abs(force).max() <= FORCELESS * (size * np.abs(v)).max()


def dissected(ends: np.ndarray, n: int) -> np.ndarray:
    """An order (n,) of the rows in which L has few entries."""
    import pymetis

    both = np.unique(np.concatenate([ends, ends[:, ::-1]]), axis=0)
    if not len(both):
        return np.arange(n)
    start = np.searchsorted(both[:, 0], np.arange(n + 1))
    order, _ = pymetis.nested_dissection(adjacency=pymetis.CSRAdjacency(start, both[:, 1]))
    return np.asarray(order, np.int64)
