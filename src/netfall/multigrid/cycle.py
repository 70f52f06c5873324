"""An approximate inverse of a net's tangent stiffness, at a cost in proportion to the net.

Smoothed aggregation (Vanek, Mandel, Brezina 1996): particles are joined to aggregates of neighbours, these
again, until few are left; each level moves its aggregates as wholes, smoothed by one step of Jacobi's
iteration.
Between the net and the first of them lines of elements, solved whole, take out what varies from line to line
(`lines`); between the others, and in a net with chains that bend, Chebyshev's polynomial in the stiffness,
scaled by each particle's 3 x 3 block, what varies from particle to particle. A cycle through the levels is
symmetric, so that conjugate gradients may use it. All ranks make the levels, in double precision; a cycle is
in single precision. Small levels each rank has whole.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from netfall.multigrid.distributed import DistributedMatrix, first_step
from netfall.multigrid.levels import COARSEST, TOP_OF_JOINTS, levels_of
from netfall.multigrid.lines import MOST_TOUCHING, Lines, LineSmoother
from netfall.multigrid.rows import Pattern
from netfall.multigrid.tangent import Incidence, Tangent, incidence_of, tangent_rows
from netfall.numerics.linear import factorised, solve_factorised
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution

DEGREE = 4  # of the polynomial before and after each coarser level
RANGE = 20.0  # the polynomial damps eigenvalues from the largest down to this part of it
DENSE = 4 * COARSEST  # particles of the last level up to which it is solved


@dataclass
class Structure:
    """What the cycles of one net have in common, its elements, axes and joints: found with the first one.

    lines() : of the net, asked for where they serve. Collective
    at : the elements at each particle; pattern : of the tangent; coarsenings : as of `levels_of`
    """

    lines: Callable[[], Lines]
    at: Incidence | None = None
    pattern: Pattern | None = None
    coarsenings: list = field(default_factory=list)


class Cycle:
    """The approximate inverse, for rows (n_owned, 3) on each rank."""

    def __init__(self, distribution: Distribution, net, K: Tangent, inertia: float, kept: Structure):
        """Of a net's tangent, without what compression takes from it. Collective.

        net : `relaxation.Net`; inertia : share of the nodes' stiffness that is added; kept : of the net
        """
        comm, d = distribution.comm, distribution.subdomain
        self.comm = comm
        if kept.at is None:
            kept.at = incidence_of(net.ends, d.particle_gid, d.n_owned)
        self.levels, self.factor = [], None
        self.whole = 0  # the first level of which each rank has all rows; `rows` are those of its own ones
        rows = tangent_rows(distribution, net, K, kept.at, inertia, kept.pattern)
        kept.pattern, bends = rows.pattern, K.joints is not None
        of_joints = (TOP_OF_JOINTS, DENSE) if bends else ()
        for level in levels_of(rows, kept.coarsenings, *of_joints):
            spread = level.matrix.comm is comm
            if spread:
                self.rows = level.up.columns if level.up else level.matrix.rows
            if level.up is None and level.matrix.rows.n <= DENSE:
                self.factor = level.matrix.dense()
                factorised(self.factor)
                break
            self.whole += spread
            beside = (DistributedMatrix(level.down), DistributedMatrix(level.up)) if level.up else ()
            found = kept.lines() if not bends and not self.levels else None
            if found and 0 < found.touching <= MOST_TOUCHING:
                self.levels.append(
                    _LineLevel(LineSmoother(found, level.matrix, net, K), level.product, *beside)
                )
            else:
                self.levels.append(_PointLevel(level.single, level.top, level.product, *beside))
            del level  # its memory serves the next one

    def __call__(self, b: np.ndarray) -> np.ndarray:
        """Nearly the displacements (n_owned, 3) that the forces b (n_owned, 3) make. Collective."""
        with np.errstate(over="ignore"):  # of what diverges, which the caller sees
            single = b.astype(np.float32)
        return self._cycle(0, single).astype(float)

    def _cycle(self, k: int, b: np.ndarray) -> np.ndarray:
        if k == self.whole:
            b = self._gathered(b)
        x = self._solved(b) if k == len(self.levels) else self._smoothed(k, b)
        return x[self.rows.mine] if k == self.whole else x

    def _smoothed(self, k: int, b: np.ndarray) -> np.ndarray:
        level = self.levels[k]
        x = level.matrix.own
        level.smooth(b, True)
        if level.down is None:
            return x
        x += level.up(self._cycle(k + 1, level.down(b - level.matrix()).copy()))
        level.matrix.share()
        level.smooth(b, False)
        return x

    def _gathered(self, b: np.ndarray) -> np.ndarray:
        whole = np.zeros((self.rows.n, 3), np.float32)
        whole[self.rows.mine] = b
        self.comm.Allreduce(MPI.IN_PLACE, whole, MPI.SUM)  # one term that is not zero: no rounding
        return whole

    def _solved(self, b: np.ndarray) -> np.ndarray:
        flat = b.astype(float).ravel()
        solve_factorised(self.factor, flat)
        with np.errstate(over="ignore"):  # of a singular tangent, which conjugate gradients find out
            return flat.reshape(-1, 3).astype(np.float32)


@dataclass
class _LineLevel:
    lines: LineSmoother
    matrix: DistributedMatrix
    down: DistributedMatrix | None = None
    up: DistributedMatrix | None = None

    def smooth(self, b: np.ndarray, zero: bool) -> None:
        """One step of the lines towards matrix x = b, on the x in `matrix.own`; as `_PointLevel.smooth`."""
        x = self.matrix.own
        if zero:
            x[:] = 0.0
            self.lines.add_step(b, x)
            self.matrix.share()
        else:
            self.lines.add_step(b - self.matrix(), x)


@dataclass
class _PointLevel:
    inverse: np.ndarray
    top: float
    matrix: DistributedMatrix
    down: DistributedMatrix | None = None
    up: DistributedMatrix | None = None

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
                self.matrix.share()
            else:
                self.matrix.take_step(b, self.inverse, np.float32(scale), np.float32(keep), step)
            after = 1.0 / (2.0 * ratio - factor)
            keep, scale, factor = after * factor, 2.0 * after / half, after
