"""The levels of `cycle`: aggregates of particles, and how these move."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from netfall.ground.compile import kernel, part_of_kernel
from netfall.multigrid.products import coarser, transposed
from netfall.multigrid.rows import BlockRows, Owners, blocks_of, entries_of
from netfall.parallel.agree import on_root
from netfall.parallel.sums import exact_sums

COARSEST = 100  # aggregates at which the levels end
EVERYWHERE = 4000  # at most: to work on all of them costs a rank less than an exchange with others
MOST_LEVELS = 20
MERGED = 0.7  # of a level's particles, in aggregates, at most: else it is the last one
POWERS = 15  # iterations for the largest eigenvalue of a coarse level
SAFE = 1.1  # on that
TOP_OF_NET = 2.0  # bounds the first level: an element's stiffness is at most twice its share of the diagonal
TOP_OF_JOINTS = 3.0  # the same, of three particles
TINY = 1e-9  # of a block's trace, added to it: what nothing holds would make it singular


@dataclass
class Level:
    """One level: `matrix`; `inverse` (rows, 3, 3) of the diagonal blocks of this rank's rows.

    top : bound of the eigenvalues of inverse times matrix
    down, up : to the next level and from there, if there is one
    """

    matrix: BlockRows
    inverse: np.ndarray
    top: float
    down: BlockRows | None = None
    up: BlockRows | None = None


def levels_of(matrix: BlockRows, top: float = TOP_OF_NET, coarsest: int = COARSEST) -> Iterator[Level]:
    """The levels of a tangent stiffness, one after the other. Collective.

    All axes of the matrix can move: held ones have a row and column of zeros but for the diagonal. Small
    levels each rank makes for itself. top : bounds the first level; coarsest : rows at which the levels end
    """
    for k in range(MOST_LEVELS):
        inverse = inverse_diagonal(matrix)
        level = Level(matrix, inverse, largest_eigenvalue(matrix, inverse) if k else top)
        number, count = (None, 0) if matrix.rows.n <= coarsest or k == MOST_LEVELS - 1 else aggregates(matrix)
        if not 0 < count < MERGED * matrix.rows.n:
            yield level
            return
        level.up = prolongation(level, number, _owners(matrix, number, count))
        level.down = transposed(level.up)
        matrix = coarser(matrix, level.up, level.down)
        if matrix.comm.size > 1 and matrix.rows.n <= EVERYWHERE:
            matrix = matrix.everywhere()
        yield level


def _owners(matrix: BlockRows, number: np.ndarray, count: int) -> Owners:
    """An aggregate goes to the owner of its first particle. Collective. number, count : of `aggregates`"""
    rank, comm = np.empty(count, np.int32), matrix.comm
    member = np.flatnonzero(number >= 0)[::-1]
    rank[number[member]] = matrix.rows.rank[member]  # the last one stays
    return Owners(comm, np.flatnonzero(rank == comm.rank))


def prolongation(level: Level, number: np.ndarray, owners: Owners) -> BlockRows:
    """How rows move when each of the aggregates moves as a whole, smoothed by one step of Jacobi's iteration.

    number : (n,) of each row's aggregate; owners : of the aggregates
    """
    rows, own = level.matrix.rows, level.matrix.own
    of_rows, factor = number[rows.mine], 4.0 / (3.0 * level.top)
    start, aggregate = np.empty(len(own.indptr), np.int64), np.empty(len(own.indices), np.int32)
    block, matrix = np.empty((len(own.indices), 3, 3)), (own.indptr, own.indices, own.data)
    smooth_rows(*matrix, number, of_rows, level.inverse, factor, start, aggregate, block)
    up = blocks_of(block[: start[-1]], aggregate[: start[-1]], start, owners.n)
    return BlockRows(level.matrix.comm, up, rows, owners)


@kernel
def smooth_rows(begin, column, matrix, number, own, inverse, factor, start, aggregate, block):
    """Fill the rows of a prolongation: start (rows + 1,), aggregate (k,), block (k, 3, 3); k at most.

    begin, column, matrix : compressed rows of blocks; number : (n,) of each column's aggregate; own : (rows,)
    of each row's; inverse : (rows, 3, 3); factor : of the step
    """
    end = 0
    for p in range(own.shape[0]):
        start[p], first = end, end
        for entry in range(begin[p], begin[p + 1]):  # the aggregates that it meets, in ascending order
            a, k = number[column[entry]], end
            while k > first and aggregate[k - 1] > a:
                k -= 1
            if a < 0 or (k > first and aggregate[k - 1] == a):
                continue
            for after in range(end, k, -1):
                aggregate[after] = aggregate[after - 1]
            aggregate[k] = a
            end += 1
        kept = first
        for k in range(first, end):
            a, differs = aggregate[k], False
            s = block[kept]
            for i in range(3):
                for j in range(3):
                    s[i, j] = 0.0
            for entry in range(begin[p], begin[p + 1]):
                if number[column[entry]] == a:
                    for i in range(3):
                        for j in range(3):
                            s[i, j] += matrix[entry, i, j]
            for j in range(3):
                u, v, w = s[0, j], s[1, j], s[2, j]
                for i in range(3):
                    moved = inverse[p, i, 0] * u + inverse[p, i, 1] * v + inverse[p, i, 2] * w
                    s[i, j] = (1.0 if a == own[p] and i == j else 0.0) - factor * moved
                    differs |= s[i, j] != 0.0
            aggregate[kept] = a
            kept += differs
        end = kept
    start[-1] = end


def inverse_diagonal(matrix: BlockRows) -> np.ndarray:
    """Inverses (rows, 3, 3) of the symmetric blocks on the diagonal; a little is added, for singular ones."""
    own, inverse = matrix.own, np.empty((len(matrix.rows.mine), 3, 3))
    invert_diagonal(matrix.rows.mine, own.indptr, own.indices, own.data, inverse)
    return inverse


@kernel
def invert_diagonal(number, begin, column, block, inverse):
    """Fill inverse (rows, 3, 3) by cofactors; number : (rows,) of the columns that meet the diagonal."""
    for p in range(inverse.shape[0]):
        a = b = c = d = e = f = 0.0
        for k in range(begin[p], begin[p + 1]):
            if column[k] == number[p]:
                a, b, c = block[k, 0, 0], block[k, 0, 1], block[k, 0, 2]
                d, e, f = block[k, 1, 1], block[k, 1, 2], block[k, 2, 2]
        a, b, c, d, e, f = invert(a, b, c, d, e, f, a + d + f)
        inverse[p, 0, 0], inverse[p, 0, 1], inverse[p, 0, 2] = a, b, c
        inverse[p, 1, 0], inverse[p, 1, 1], inverse[p, 1, 2] = b, d, e
        inverse[p, 2, 0], inverse[p, 2, 1], inverse[p, 2, 2] = c, e, f


@part_of_kernel
def invert(a, b, c, d, e, f, trace):
    """Entries 00, 01, 02, 11, 12, 22 of a symmetric block's inverse; a little of a trace is added."""
    more = TINY * trace
    if not more > 0.0:
        more = 1.0
    a, d, f = a + more, d + more, f + more
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    D, E, F = a * f - c * c, b * c - a * e, a * d - b * b
    whole = a * A + b * B + c * C
    return A / whole, B / whole, C / whole, D / whole, E / whole, F / whole


def largest_eigenvalue(matrix: BlockRows, inverse: np.ndarray) -> float:
    """Of inverse times matrix, by powers, a little more to be safe. The sums are exact. Collective."""
    number = 3 * matrix.rows.mine[:, None] + np.arange(3)
    v = ((number * 2654435761) % 2**32) / 2.0**32 - 0.5
    value = 1.0
    for _ in range(POWERS):
        w = np.add.reduce(inverse * matrix.times_vector(v)[:, None], axis=2)
        new, old = exact_sums(matrix.comm, (w * w).ravel(), (v * v).ravel())
        if new == 0.0:  # all is slack, and nothing resists: any bound will do
            return TOP_OF_NET
        value = math.sqrt(new / old)
        v = w / value
    return SAFE * value


@kernel
def aggregates_into(start, column, number):
    """Give each node the number (n,) of its aggregate, -1 where it has no neighbour; how many there are.

    A node all of whose neighbours are free takes them; then what is left joins a neighbour's aggregate of the
    first pass; what is still left takes its free neighbours.
    """
    n, count = number.shape[0], 0
    for i in range(n):
        number[i] = -1 if start[i + 1] - start[i] > 1 else -2
    for i in range(n):
        if number[i] != -1:
            continue
        alone = True
        for k in range(start[i], start[i + 1]):
            alone &= number[column[k]] < 0
        if alone:
            for k in range(start[i], start[i + 1]):
                if number[column[k]] == -1:
                    number[column[k]] = count
            count += 1
    first = count
    for i in range(n):
        if number[i] == -1:
            for k in range(start[i], start[i + 1]):
                if 0 <= number[column[k]] < first:
                    number[i] = -3 - number[column[k]]
                    break
    for i in range(n):
        if number[i] <= -3:
            number[i] = -3 - number[i]
    for i in range(n):
        if number[i] == -1:
            for k in range(start[i], start[i + 1]):
                if number[column[k]] == -1:
                    number[column[k]] = count
            count += 1
    return count


def aggregates(matrix: BlockRows) -> tuple[np.ndarray, int]:
    """The number (n,) of each row's aggregate, -1 or less: none, and how many there are. Collective.

    In the order of the global numbers, one after the other: rank 0 does it.
    """
    comm, own = matrix.comm, matrix.own
    parts = comm.gather((matrix.rows.mine, np.diff(own.indptr), own.indices))

    def joined():
        row, counts, column = (np.concatenate(each) for each in zip(*parts))
        counts, entries = entries_of(counts, np.argsort(row))
        number = np.empty(len(row), np.int64)
        return number, aggregates_into(np.concatenate([[0], np.cumsum(counts)]), column[entries], number)

    return comm.bcast(on_root(comm, joined))
