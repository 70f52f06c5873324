"""The levels of `multilevel`, made on rank 0: aggregates of particles, and how these move."""

import math
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from netfall.compile import kernel
from netfall.parallel.sums import exact_sums

COARSEST = 100  # aggregates at which the levels end
MOST_LEVELS = 20
MERGED = 0.7  # of a level's particles, in aggregates, at most: else it is the last one
POWERS = 15  # iterations for the largest eigenvalue of a coarse level
SAFE = 1.1  # on that
TINY = 1e-9  # of a block's trace, added to it: what nothing holds would make it singular


@dataclass
class Level:
    """One level on rank 0: `matrix`, scipy BSR of 3 x 3 blocks; `inverse` (n, 3, 3) of its diagonal blocks.

    top : bound of the eigenvalues of inverse times matrix; coarser : prolongation from the next level, if any
    """

    matrix: object
    inverse: np.ndarray
    top: float
    coarser: object = None


def levels_of(matrix) -> list[Level]:
    """The levels of a tangent stiffness, a scipy BSR matrix of 3 x 3 blocks in which all axes can move.

    Held axes have a row and column of zeros but for the diagonal. Rank 0.
    """
    from scipy.sparse import bsr_array

    levels = []
    while True:
        matrix.sort_indices()
        n = matrix.shape[0] // 3
        inverse = inverse_blocks(diagonal_blocks(matrix))
        # An element's stiffness is at most twice its share of the diagonal blocks, so 2 bounds a net's.
        level = Level(matrix, inverse, largest_eigenvalue(matrix, inverse) if levels else 2.0)
        levels.append(level)
        if n <= COARSEST or len(levels) == MOST_LEVELS:
            return levels
        number, count = aggregates(matrix.indptr, matrix.indices)
        if not 0 < count < MERGED * n:
            return levels
        member = np.flatnonzero(number >= 0)
        start = np.concatenate([[0], np.cumsum(number >= 0)])
        alike = np.broadcast_to(np.eye(3), (len(member), 3, 3))
        whole = bsr_array((alike, number[member], start), shape=(3 * n, 3 * count))
        scaled = bsr_array((inverse, np.arange(n), np.arange(n + 1)), shape=matrix.shape)
        level.coarser = bsr_array(whole - (4.0 / (3.0 * level.top)) * (scaled @ (matrix @ whole)))
        level.coarser.sort_indices()
        matrix = bsr_array(level.coarser.T @ (matrix @ level.coarser), blocksize=(3, 3))


def diagonal_blocks(matrix) -> np.ndarray:
    """The blocks (n, 3, 3) on the diagonal of a BSR matrix."""
    n = matrix.shape[0] // 3
    row = np.repeat(np.arange(n), np.diff(matrix.indptr))
    at = np.flatnonzero(row == matrix.indices)
    blocks = np.zeros((n, 3, 3))
    blocks[row[at]] = matrix.data[at]
    return blocks


def inverse_blocks(blocks: np.ndarray) -> np.ndarray:
    """Inverses (n, 3, 3) of symmetric blocks, by their cofactors; a little is added, for singular ones."""
    a, b, c = blocks[:, 0, 0], blocks[:, 0, 1], blocks[:, 0, 2]
    d, e, f = blocks[:, 1, 1], blocks[:, 1, 2], blocks[:, 2, 2]
    more = TINY * (a + d + f)
    more = np.where(more > 0.0, more, 1.0)
    a, d, f = a + more, d + more, f + more
    A, B, C = d * f - e * e, c * e - b * f, b * e - c * d
    D, E, F = a * f - c * c, b * c - a * e, a * d - b * b
    whole = np.stack([A, B, C, B, D, E, C, E, F], 1).reshape(-1, 3, 3)
    return whole / (a * A + b * B + c * C)[:, None, None]


def largest_eigenvalue(matrix, inverse: np.ndarray) -> float:
    """Of inverse times matrix, by powers, a little more to be safe. The sums are exact."""
    n = len(inverse)
    v = ((np.arange(3 * n) * 2654435761) % 2**32) / 2.0**32 - 0.5
    value = 1.0
    for _ in range(POWERS):
        force = (matrix @ v).reshape(n, 1, 3)
        w = np.add.reduce(inverse * force, axis=2).ravel()
        new, old = exact_sums(MPI.COMM_SELF, w * w, v * v)
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


def aggregates(start, column) -> tuple[np.ndarray, int]:
    """The number (n,) of each node's aggregate, -1 or less: none, and how many there are."""
    number = np.empty(len(start) - 1, np.int64)
    count = aggregates_into(start.astype(np.int64), column.astype(np.int64), number)
    return number, count
