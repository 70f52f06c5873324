"""The levels of `cycle`: aggregates of particles, and how these move.

Particles are joined to blocks, with those at the corners: nine in a net of squares. The five of a particle
and its neighbours leave gaps between them, so that levels are larger, and answer worse.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from netfall.core.kernels import kernel, part_of_kernel
from netfall.multigrid.distributed import DistributedMatrix, dot_rows, first_step
from netfall.multigrid.products import Product, Transposed
from netfall.multigrid.rows import BlockRows, Everywhere, Owners, Pattern, entries_of, starts_of
from netfall.parallel.agree import on_root
from netfall.parallel.sums import exact_sums

COARSEST = 100  # aggregates at which the levels end
EVERYWHERE = 4000  # at most: to work on all of them costs a rank less than an exchange with others
MOST_LEVELS = 20
MERGED = 0.7  # of a level's particles, in aggregates, at most: else it is the last one
POWERS = 30  # iterations for the largest eigenvalue of a coarse level; after 15 a cycle was not positive once
SAFE = 1.1  # on that
TOP_OF_NET = 2.0  # bounds the first level: an element's stiffness is at most twice its share of the diagonal
TOP_OF_JOINTS = 3.0  # the same, of three particles
UPPER = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])  # entries of symmetric blocks that are kept
FREE, ALONE, JOINS = -1, -2, -3  # nodes on the way to an aggregate
TINY = 1e-9  # of a block's trace, added to it: what nothing holds would make it singular


@dataclass
class Level:
    """One level: `matrix`; `inverse` (rows, 3, 3) of the diagonal blocks of this rank's rows.

    single, product : both in single precision, `inverse` as of `distributed.add_step`
    top : bound of the eigenvalues of inverse times matrix
    down, up : to the next level and from there, if there is one
    """

    matrix: BlockRows
    inverse: np.ndarray
    top: float = 0.0
    down: BlockRows | None = None
    up: BlockRows | None = None

    @cached_property
    def single(self) -> np.ndarray:
        return np.ascontiguousarray(self.inverse[:, *UPPER], np.float32)

    @cached_property
    def product(self) -> DistributedMatrix:
        return DistributedMatrix(self.matrix)


class Coarsening:
    """How rows go over to those of the next level, by the places of blocks alone: of all tangents of a net.

    number : (n,) of each row's aggregate; own : the same of this rank's; up : pattern of the prolongation
    transposed, moved, coarser, everywhere : make its transposed, the matrix times it, the next matrix, all of
    that on each rank if it is small
    """

    def __init__(self, matrix: Pattern, number: np.ndarray, count: int):
        """number, count : of `aggregates`. Collective."""
        self.number, self.own = number, number[matrix.rows.mine]
        start, aggregate = np.empty(len(matrix.start), np.int64), np.empty(len(matrix.column), np.int32)
        meet_aggregates(matrix.start, matrix.column, number, start, aggregate)
        owners = _owners(matrix, number, count)
        self.up = Pattern(matrix.comm, start, aggregate[: start[-1]].copy(), matrix.rows, owners)
        self.transposed = Transposed(self.up)
        self.moved = Product(matrix, self.up)
        self.coarser = Product(self.transposed.pattern, self.moved.pattern)
        few = matrix.comm.size > 1 and owners.n <= EVERYWHERE
        self.everywhere = Everywhere(self.coarser.pattern) if few else None

    def matrix(self, down: BlockRows, matrix: BlockRows, up: BlockRows) -> BlockRows:
        """The next one. Collective."""
        coarser = self.coarser.of(down, self.moved.of(matrix, up))
        return self.everywhere.of(coarser) if self.everywhere else coarser


def levels_of(
    matrix: BlockRows, kept: list[Coarsening | None], top: float = TOP_OF_NET, coarsest: int = COARSEST
) -> Iterator[Level]:
    """The levels of a tangent stiffness, one after the other. Collective.

    All axes of the matrix can move: held ones have a row and column of zeros but for the diagonal. Small
    levels each rank makes for itself. top : bounds the first level; coarsest : rows at which the levels end
    kept : of each level of the net's tangents, the last one has None; empty before the first
    """
    for k in range(MOST_LEVELS):
        level = Level(matrix, inverse_diagonal(matrix))
        level.top = largest_eigenvalue(level.product, matrix.rows.mine, level.single) if k else top
        if k == len(kept):
            goes_on = coarsest < matrix.rows.n and k < MOST_LEVELS - 1
            kept.append(_coarsening(matrix.pattern, k == 0) if goes_on else None)
        over = kept[k]
        if over is None:
            yield level
            return
        level.up = prolongation(level, over)
        level.down = over.transposed.of(level.up)
        matrix = over.matrix(level.down, matrix, level.up)
        yield level


def _coarsening(matrix: Pattern, corners: bool) -> Coarsening | None:
    number, count = aggregates(matrix, corners)
    return Coarsening(matrix, number, count) if 0 < count < MERGED * matrix.rows.n else None


def _owners(matrix: Pattern, number: np.ndarray, count: int) -> Owners:
    """An aggregate goes to the owner of its first particle. Collective. number, count : of `aggregates`"""
    rank, comm = np.empty(count, np.int32), matrix.comm
    member = np.flatnonzero(number >= 0)[::-1]
    rank[number[member]] = matrix.rows.rank[member]  # the last one stays
    return Owners(comm, np.flatnonzero(rank == comm.rank))


def prolongation(level: Level, over: Coarsening) -> BlockRows:
    """How rows move when each aggregate moves as a whole, smoothed by one step of Jacobi's iteration."""
    matrix, up, factor = level.matrix.pattern, over.up, 4.0 / (3.0 * level.top)
    block, of_matrix = np.zeros((len(up.column), 3, 3)), (matrix.start, matrix.column, level.matrix.block)
    smooth_rows(*of_matrix, over.number, over.own, level.inverse, factor, up.start, up.column, block)
    return BlockRows(up, block)


@kernel
def meet_aggregates(begin, column, number, start, aggregate):
    """Fill start (rows + 1,), aggregate (k,), k at most: the aggregates that rows meet, ascending in each.

    begin, column : rows of a matrix; number : (n,) of each column's aggregate
    """
    end = 0
    for p in range(start.shape[0] - 1):
        start[p], first = end, end
        for entry in range(begin[p], begin[p + 1]):
            a, k = number[column[entry]], end
            while k > first and aggregate[k - 1] > a:
                k -= 1
            if a < 0 or (k > first and aggregate[k - 1] == a):
                continue
            for after in range(end, k, -1):
                aggregate[after] = aggregate[after - 1]
            aggregate[k] = a
            end += 1
    start[-1] = end


@kernel
def smooth_rows(begin, column, matrix, number, own, inverse, factor, start, aggregate, block):
    """Fill the blocks (k, 3, 3), zeros, of a prolongation, whose rows are start (rows + 1,), aggregate (k,).

    begin, column, matrix : rows of blocks; number : (n,) of each column's aggregate; own : (rows,) of each
    row's; inverse : (rows, 3, 3); factor : of the step
    """
    for p in range(start.shape[0] - 1):
        for entry in range(begin[p], begin[p + 1]):
            a, k = number[column[entry]], start[p]
            if a < 0:
                continue
            while aggregate[k] != a:
                k += 1
            for i in range(3):
                for j in range(3):
                    block[k, i, j] += matrix[entry, i, j]
        for k in range(start[p], start[p + 1]):
            here = 1.0 if aggregate[k] == own[p] else 0.0
            for j in range(3):
                u, v, w = block[k, 0, j], block[k, 1, j], block[k, 2, j]
                for i in range(3):
                    moved = inverse[p, i, 0] * u + inverse[p, i, 1] * v + inverse[p, i, 2] * w
                    block[k, i, j] = (here if i == j else 0.0) - factor * moved


def inverse_diagonal(matrix: BlockRows) -> np.ndarray:
    """Inverses (rows, 3, 3) of the symmetric blocks on the diagonal; a little is added, for singular ones."""
    inverse = np.empty((len(matrix.rows.mine), 3, 3))
    invert_diagonal(matrix.pattern.diagonal, matrix.block, inverse)
    return inverse


@kernel
def invert_diagonal(diagonal, block, inverse):
    """Fill inverse (rows, 3, 3) by cofactors; diagonal : (rows,) places of the blocks."""
    for p in range(inverse.shape[0]):
        k = diagonal[p]
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


def largest_eigenvalue(product: DistributedMatrix, number: np.ndarray, inverse: np.ndarray) -> float:
    """Of inverse times matrix, by powers, a little more to be safe. The sums are exact. Collective.

    number : (rows,) global ones of this rank's rows; inverse : (rows, 6), as of `distributed.add_step`
    """
    number = 3 * number[:, None] + np.arange(3)
    v = (((number * 2654435761) % 2**32) / 2.0**32 - 0.5).astype(np.float32)
    squares = np.empty((2, len(v)))
    for _ in range(POWERS):  # that grow by 1e12 at most
        before = v.astype(float)
        first_step(inverse, product(v), np.float32(1.0), v)
    for vector, square in zip((before, v.astype(float)), squares):
        dot_rows(vector, vector, square)
    old, new = exact_sums(product.shared.comm, *squares)
    if new == 0.0:  # all is slack, and nothing resists: any bound will do
        return TOP_OF_NET
    return SAFE * math.sqrt(new / old)


@kernel
def aggregates_into(start, column, corners, number, mark, block):
    """Join nodes to aggregates: a node, its neighbours and, with corners, what two of these touch; how many.

    number : (n,) filled with each node's aggregate, -1 or less where it has no neighbour; mark : (n,) of
    zeros, block : (n,), overwritten
    First those that find all of that free; then those that find half of it; then what is left joins a
    neighbour's; what is still left takes what is free.
    """
    n, count = number.shape[0], 0
    for i in range(n):
        number[i] = FREE if start[i + 1] - start[i] > 1 else ALONE
    for least in (1.0, 0.5, 0.0):
        for i in range(n):
            if number[i] != FREE:
                continue
            size = 0
            for k in range(start[i], start[i + 1]):
                mark[column[k]], block[size] = 2, column[k]
                size += 1
            for a in range(size if corners else 0):
                near = block[a]
                for k in range(start[near], start[near + 1]):
                    q = column[k]
                    if near == i or mark[q] == 2:
                        continue
                    if mark[q] == 0:
                        block[size] = q
                        size += 1
                    mark[q] += 1
            whole = free = 0
            for a in range(size):
                if mark[block[a]] == 2:
                    whole += 1
                    free += number[block[a]] == FREE
            taken = free >= least * whole and (free > 1 or least == 0.0)
            for a in range(size):
                q = block[a]
                if taken and mark[q] == 2 and number[q] == FREE:
                    number[q] = count
                mark[q] = 0
            count += taken
        if least == 0.5:
            for i in range(n):
                if number[i] == FREE:
                    for k in range(start[i], start[i + 1]):
                        if number[column[k]] >= 0:
                            number[i] = JOINS - number[column[k]]
                            break
            for i in range(n):
                if number[i] <= JOINS:
                    number[i] = JOINS - number[i]
    return count


def aggregates(matrix: Pattern, corners: bool) -> tuple[np.ndarray, int]:
    """The number (n,) of each row's aggregate, -1 or less: none, and how many there are. Collective.

    In the order of the global numbers, one after the other: rank 0 does it.
    """
    comm = matrix.comm
    parts = comm.gather((matrix.rows.mine, np.diff(matrix.start), matrix.column))

    def joined():
        row, counts, column = (np.concatenate(each) for each in zip(*parts))
        counts, entries = entries_of(counts, np.argsort(row))
        number, block = np.empty((2, len(row)), np.int64)
        of_rows = starts_of(counts), column[entries], corners
        return number, aggregates_into(*of_rows, number, np.zeros(len(row), np.uint8), block)

    return comm.bcast(on_root(comm, joined))
