"""An approximate inverse of a net's tangent stiffness, at a cost in proportion to the net.

Smoothed aggregation (Vanek, Mandel, Brezina 1996): particles are joined to aggregates of a particle and its
neighbours, these again, until few are left; each level moves its aggregates as wholes, smoothed by one step
of Jacobi's iteration.
Between levels Chebyshev's polynomial in the stiffness, scaled by each particle's 3 x 3 block, takes out what
varies from particle to particle. A cycle through the levels is symmetric, so that conjugate gradients may use
it. Levels are made on rank 0, in global numbers, and spread; a cycle is in single precision.
"""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from netfall.linear import factorised, solve_factorised
from netfall.parallel.agree import on_root
from netfall.parallel.blocks import SpreadMatrix, first_step, shares
from netfall.parallel.halo import Halo
from netfall.parallel.subdomain import Distribution
from netfall.solve.aggregation import COARSEST, Level, levels_of
from netfall.solve.element_matrix import ElementMatrix
from netfall.solve.tangent import Tangent, whole_matrix

DEGREE = 4  # of the polynomial before and after each coarser level
RANGE = 20.0  # the polynomial damps eigenvalues from the largest down to this part of it
DENSE = 4 * COARSEST  # particles of the last level up to which it is solved
UPPER = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])  # entries of symmetric blocks that are kept


class Cycle:
    """The approximate inverse, for rows (n_owned, 3) on each rank."""

    def __init__(
        self, comm: MPI.Comm, distribution: Distribution, halo: Halo, net, K: Tangent, inertia: float
    ):
        """Of a net's tangent, without what compression takes from it. Collective.

        net : `relaxation.Net`; inertia : share of the nodes' stiffness that is added
        """
        self.comm, owned = comm, distribution.owned()
        matrix = whole_matrix(distribution, net, K, inertia)
        finest = ElementMatrix(distribution, halo, net, K, inertia)
        levels = on_root(comm, lambda: levels_of(matrix))
        everywhere = on_root(comm, lambda: _owned_everywhere(levels, owned))
        spread = on_root(comm, lambda: _spread(levels, everywhere))
        self.levels = []
        for k in range(comm.bcast(None if spread is None else len(spread))):
            each = spread[k] if spread else None
            ends = comm.bcast(each and each["down"] is None)
            matrix = SpreadMatrix(comm, each and each["matrix"]) if k else finest
            beside = [] if ends else [SpreadMatrix(comm, each and each[name]) for name in ("down", "up")]
            inverse, top = comm.scatter(each and each["inverse"]), comm.bcast(each and each["top"])
            self.levels.append(_SpreadLevel(inverse, top, matrix, *beside))
        self.factor = comm.bcast(on_root(comm, lambda: _last(levels[-1].matrix)))
        self.last = comm.scatter(everywhere and everywhere[-1])

    def __call__(self, b: np.ndarray) -> np.ndarray:
        """Nearly the displacements (n_owned, 3) that the forces b (n_owned, 3) make. Collective."""
        with np.errstate(over="ignore"):  # of what diverges, which the caller sees
            single = b.astype(np.float32)
        return self._cycle(0, single).astype(float)

    def _cycle(self, k: int, b: np.ndarray) -> np.ndarray:
        if k == len(self.levels):
            return self._solve_last(b)
        level = self.levels[k]
        x = level.matrix.own
        level.smooth(b, True)
        if level.down is None:
            return x
        x += level.up(self._cycle(k + 1, level.down(b - level.matrix()).copy()))
        level.smooth(b, False)
        return x

    def _solve_last(self, b: np.ndarray) -> np.ndarray:
        whole = np.zeros((len(self.factor) // 3, 3))
        whole[self.last] = b
        self.comm.Allreduce(MPI.IN_PLACE, whole, MPI.SUM)  # one term that is not zero: no rounding
        flat = whole.ravel()
        solve_factorised(self.factor, flat)
        return whole[self.last].astype(np.float32)


@dataclass
class _SpreadLevel:
    inverse: np.ndarray
    top: float
    matrix: SpreadMatrix | ElementMatrix
    down: SpreadMatrix | None = None
    up: SpreadMatrix | None = None

    def smooth(self, b: np.ndarray, zero: bool) -> None:
        """Chebyshev's iteration of `DEGREE` terms towards matrix x = b, on the x in `matrix.own`.

        zero : begin with x = 0
        """
        middle, half = 0.5 * (self.top + self.top / RANGE), 0.5 * (self.top - self.top / RANGE)
        ratio = middle / half
        factor, step = 1.0 / ratio, np.zeros_like(b)
        keep, scale = 0.0, 1.0 / middle
        for term in range(DEGREE):
            if zero and term == 0:
                first_step(self.inverse, b, np.float32(scale), step)
                self.matrix.own[:] = step
            else:
                self.matrix.take_step(b, self.inverse, np.float32(scale), np.float32(keep), step)
            after = 1.0 / (2.0 * ratio - factor)
            keep, scale, factor = after * factor, 2.0 * after / half, after


def _owned_everywhere(levels: list[Level], owned: list[np.ndarray]) -> list[list[np.ndarray]]:
    """What each rank owns of each level: an aggregate goes to the owner of its first particle."""
    rank_of = np.empty(levels[0].matrix.shape[0] // 3, np.int64)
    for rank, own in enumerate(owned):
        rank_of[own] = rank
    everywhere = [owned]
    for level in levels[:-1]:
        up = level.coarser
        row = np.repeat(np.arange(up.shape[0] // 3), np.diff(up.indptr))
        first = np.full(up.shape[1] // 3, len(row), np.int64)
        np.minimum.at(first, up.indices, row)
        rank_of = rank_of[first]
        everywhere.append([np.flatnonzero(rank_of == rank) for rank in range(len(owned))])
    return everywhere


def _spread(levels: list[Level], everywhere: list[list[np.ndarray]]) -> list[dict]:
    """What each rank gets of all levels but the last, and of that too if it is too large to be solved.

    everywhere : of `_owned_everywhere`
    """
    from scipy.sparse import bsr_array

    out = []
    for k, level in enumerate(levels):
        fine, down = everywhere[k], None
        if level.coarser is None and level.matrix.shape[0] <= 3 * DENSE:
            break
        if level.coarser is not None:
            down = bsr_array(level.coarser.T, blocksize=(3, 3))
            down.sort_indices()
        out.append(
            {
                "matrix": shares(level.matrix, fine, fine) if k else None,
                "down": None if down is None else shares(down, everywhere[k + 1], fine),
                "up": None if down is None else shares(level.coarser, fine, everywhere[k + 1]),
                "inverse": [level.inverse[own][:, *UPPER].astype(np.float32) for own in fine],
                "top": level.top,
            }
        )
    return out


def _last(matrix) -> np.ndarray | None:
    """The factor of the last level; None if that is too large."""
    if matrix.shape[0] > 3 * DENSE:
        return None
    whole = matrix.toarray()
    factorised(whole)
    return whole
