"""Levels of the multigrid cycle: aggregates of particles, and the transfer between levels.

An aggregate is a block of particles that includes the corners: nine in a net of squares. Blocks of a particle
and its four neighbours would leave gaps between them, so levels would be larger and converge more slowly.
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray, IntArray
from netfall.core.kernels import kernel, part_of_kernel
from netfall.parallel.agree import on_root
from netfall.parallel.sums import exact_sums
from netfall.statics.bounds import NEGLIGIBLE
from netfall.statics.multigrid.distributed import DistributedMatrix, dot_rows, step_rows
from netfall.statics.multigrid.rows import (
    BlockRows,
    Owners,
    Pattern,
    Product,
    TransposedMatrix,
    row_entries,
    row_starts,
)

MAX_DIRECT = 1000  # particles of a net or level that a direct solver takes: it is faster there (jobs/bench)
# power iterations for the largest eigenvalue of a coarse level; with 15 a cycle was once not positive
POWER_ITERATIONS = 30
EIGENVALUE_MARGIN = 1.1  # factor on that eigenvalue [-]
UPPER = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])  # entries of symmetric blocks that are stored
FREE, ALONE, JOINS = -1, -2, -3  # marks of nodes without an aggregate


@dataclass
class Level:
    """Level of the multigrid: `matrix`; `inverse` (rows, 3, 3) of the diagonal blocks of this rank's rows.

    single, product : both in single precision, `inverse` as in `distributed.step_rows`
    top : bound of the eigenvalues of inverse times matrix; bound : the same, None: not known
    down, up : transfer to the next level and back, None: there is none
    """

    matrix: BlockRows
    bound: float | None
    down: BlockRows | None = None
    up: BlockRows | None = None

    @cached_property
    def inverse(self) -> np.ndarray:
        inverse = np.empty((len(self.matrix.rows.own_gid), 3, 3))
        invert_diagonal(self.matrix.pattern.diagonal, self.matrix.block, inverse)
        return inverse

    @cached_property
    def top(self) -> float:  # collective at the first call, if there is no bound
        if self.bound is not None:
            return self.bound
        return largest_eigenvalue(self.product, self.matrix.rows.own_gid, self.single)

    @cached_property
    def single(self) -> np.ndarray:
        return np.ascontiguousarray(self.inverse[:, *UPPER], np.float32)

    @cached_property
    def product(self) -> DistributedMatrix:
        return DistributedMatrix(self.matrix)


class Coarsening:
    """Transfer from one level to the next.

    It depends on the pattern alone, so it holds for all tangents of a net.

    own : aggregate of each of this rank's rows; up : pattern of the prolongation
    reached : computes the matrix times `rigid`, the motion with aggregates; transposed, moved, coarser :
        compute the transpose of the prolongation, the matrix times it, and the next matrix
    """

    def __init__(self, matrix: Pattern, number: np.ndarray, count: int):
        """number, count : of `aggregates`. Collective."""
        self.own = number[matrix.rows.own_gid]
        rank, member = np.empty(count, np.int32), np.flatnonzero(number >= 0)
        rank[number[member[::-1]]] = matrix.rows.rank[member[::-1]]  # the owner of the first particle
        owners = Owners(matrix.comm, np.flatnonzero(rank == matrix.comm.rank))
        # each particle moves with its aggregate
        follows = Pattern(
            matrix.comm, row_starts(self.own >= 0), self.own[self.own >= 0], matrix.rows, owners
        )
        self.rigid = BlockRows(follows, np.tile(np.eye(3), (len(follows.column), 1, 1)))
        self.reached = Product(matrix, follows)
        self.up = self.reached.pattern
        self.transposed = TransposedMatrix(self.up)
        self.moved = Product(matrix, self.up)
        self.coarser = Product(self.transposed.pattern, self.moved.pattern)


def build_levels(
    matrix: BlockRows,
    coarsenings: list[Coarsening | None],
    top: float,
) -> Iterator[Level]:
    """Yield the levels of a tangent stiffness. Collective.

    top : bound of the eigenvalues of the first level
    coarsenings : transfers of the net's levels, the last one None; empty before the first call, which fills
        it

    All axes of the matrix can move: rows and columns of held ones are zero except for the diagonal.
    """
    for k in itertools.count():
        level = Level(matrix, None if k else top)
        if k == len(coarsenings):
            coarsenings.append(None)
            if MAX_DIRECT < matrix.rows.n:
                number, count = aggregates(matrix.pattern, k == 0)
                if 0 < count < matrix.rows.n:
                    coarsenings[k] = Coarsening(matrix.pattern, number, count)
        coarsening = coarsenings[k]
        if coarsening is None:
            yield level
            return
        level.up = prolongation(level, coarsening)
        level.down = coarsening.transposed.of(level.up)
        matrix = coarsening.coarser.of(level.down, coarsening.moved.of(matrix, level.up))
        yield level


def prolongation(level: Level, coarsening: Coarsening) -> BlockRows:
    """Compute the prolongation: each aggregate moves as a whole, smoothed by one Jacobi step. Collective."""
    up, factor = coarsening.up, 4.0 / (3.0 * level.top)
    force = coarsening.reached.of(level.matrix, coarsening.rigid).block
    row = np.repeat(np.arange(len(level.inverse)), np.diff(up.start))
    is_own, block = up.column == coarsening.own[row], np.empty_like(force)
    for i, j in np.ndindex(3, 3):
        a, b, c = level.inverse[:, i].T
        change = a[row] * force[:, 0, j] + b[row] * force[:, 1, j] + c[row] * force[:, 2, j]
        block[:, i, j] = (is_own if i == j else 0.0) - factor * change
    return BlockRows(up, block)


@kernel
def invert_diagonal(diagonal: IntArray, block: FloatArray, inverse: FloatArray) -> None:
    """Fill inverse (rows, 3, 3) of the diagonal blocks, at the places diagonal (rows,), by cofactors."""
    for p in range(inverse.shape[0]):
        k = diagonal[p]
        a, b, c = block[k, 0, 0], block[k, 0, 1], block[k, 0, 2]
        d, e, f = block[k, 1, 1], block[k, 1, 2], block[k, 2, 2]
        a, b, c, d, e, f = invert(a, b, c, d, e, f, a + d + f)
        inverse[p, 0, 0], inverse[p, 0, 1], inverse[p, 0, 2] = a, b, c
        inverse[p, 1, 0], inverse[p, 1, 1], inverse[p, 1, 2] = b, d, e
        inverse[p, 2, 0], inverse[p, 2, 1], inverse[p, 2, 2] = c, e, f


@part_of_kernel
def invert(a: float, b: float, c: float, d: float, e: float, f: float, trace: float) -> tuple[float, ...]:
    """Compute entries 00, 01, 02, 11, 12, 22 of a symmetric block's inverse.

    A small share of a trace is added to the diagonal, in case the block is singular.
    """
    shift = NEGLIGIBLE * trace
    if not shift > 0.0:
        shift = 1.0
    a, d, f = a + shift, d + shift, f + shift
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    D, E, F = a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * A + b * B + c * C
    return (
        A / determinant,
        B / determinant,
        C / determinant,
        D / determinant,
        E / determinant,
        F / determinant,
    )


def largest_eigenvalue(product: DistributedMatrix, number: np.ndarray, inverse: np.ndarray) -> float:
    """Compute an upper bound of the largest eigenvalue of inverse times matrix by power iteration.

    Collective.

    number : (rows,) global ones of this rank's rows
    inverse : (rows, 6), as in `distributed.step_rows`

    The sums are exact.
    """
    number = 3 * number[:, None] + np.arange(3)
    v = (((number * 2654435761) % 2**32) / 2.0**32 - 0.5).astype(np.float32)
    nil = np.zeros_like(v)
    for _ in range(POWER_ITERATIONS):  # which grow the vector by 1e12 at most
        previous = v.astype(float)
        product.own[:] = v
        product.share()
        step_rows(product.blocks, inverse, nil, product.x, np.float32(-1.0), np.float32(0.0), v)
    squares = (dot_rows(vector, vector) for vector in (previous, v.astype(float)))
    old_square, new_square = exact_sums(product.shared.comm, *squares)
    if new_square == 0.0:  # everything is slack and there is no stiffness: any bound holds
        return 1.0
    return EIGENVALUE_MARGIN * math.sqrt(new_square / old_square)


@kernel
def aggregate_nodes(
    start: IntArray, column: IntArray, corners: bool, number: IntArray, mark: IntArray, block: IntArray
) -> int:
    """Join nodes to aggregates and return their number.

    An aggregate is a node, its neighbours and, with corners, the nodes that touch two of these.
    number : (n,) filled with each node's aggregate, -1 or less if it has no neighbour
    mark : (n,) of zeros, block : (n,), overwritten

    In a first pass, nodes whose block is all free become aggregates; in a second pass, those whose block is
    half free. Then each remaining node joins the aggregate of a neighbour. In a last pass the nodes still
    left form aggregates of what is free.
    """
    n, count = number.shape[0], 0
    for i in range(n):
        number[i] = FREE if start[i + 1] - start[i] > 1 else ALONE
    for required_share in (1.0, 0.5, 0.0):
        for i in range(n):
            if number[i] != FREE:
                continue
            size = 0
            for k in range(start[i], start[i + 1]):
                mark[column[k]], block[size] = 2, column[k]
                size += 1
            for a in range(size if corners else 0):
                neighbour = block[a]
                for k in range(start[neighbour], start[neighbour + 1]):
                    q = column[k]
                    if neighbour == i or mark[q] == 2:
                        continue
                    if mark[q] == 0:
                        block[size] = q
                        size += 1
                    mark[q] += 1
            size_of_core = free = 0
            for a in range(size):
                if mark[block[a]] == 2:
                    size_of_core += 1
                    free += number[block[a]] == FREE
            is_aggregate = free >= required_share * size_of_core and (free > 1 or required_share == 0.0)
            for a in range(size):
                q = block[a]
                if is_aggregate and mark[q] == 2 and number[q] == FREE:
                    number[q] = count
                mark[q] = 0
            count += is_aggregate
        if required_share == 0.5:
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
    """Compute the number (n,) of each row's aggregate, -1 or less: none, and the number of aggregates.

    Collective.

    The algorithm is sequential in the order of the global numbers, so rank 0 runs it.
    """
    comm = matrix.comm
    gathered: Any = comm.gather((matrix.rows.own_gid, np.diff(matrix.start), matrix.column))

    def joined() -> Any:
        row, counts, column = (np.concatenate(arrays) for arrays in zip(*gathered))
        counts, entries = row_entries(counts, np.argsort(row))
        number, block = np.empty((2, len(row)), np.int64)
        start, mark = row_starts(counts), np.zeros(len(row), np.uint8)
        return number, aggregate_nodes(start, column[entries], corners, number, mark, block)

    return comm.bcast(on_root(comm, joined))
