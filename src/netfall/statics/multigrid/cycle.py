"""Multigrid V-cycle: an approximate inverse of a net's tangent stiffness, at a cost proportional to the net.

Smoothed aggregation (Vanek, Mandel, Brezina 1996) joins particles to aggregates of neighbours, and these to
larger aggregates, until a direct solver can solve the rest. A correction on a coarse level moves each
aggregate as a whole, smoothed by one Jacobi step. A small net has no levels: the direct solver solves it.

A line smoother works on the fine grid: it solves lines of elements exactly and damps errors that vary from
line to line (`lines`). On coarser grids, and in a net with bending chains, a Chebyshev polynomial in the
stiffness damps errors that vary from particle to particle. It is scaled by each particle's 3 x 3 block.

A V-cycle is symmetric, so conjugate gradients may use it. All ranks set up the levels together, in double
precision. A cycle is in single precision. Each rank factorises the whole matrix of the last level.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from netfall.core.sparse import elimination_tree, nested_dissection_order, sparse_factors, substitute
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.statics.multigrid.distributed import DistributedMatrix
from netfall.statics.multigrid.levels import MAX_DIRECT, build_levels
from netfall.statics.multigrid.lines import MOST_TOUCHING, Lines, LineSmoother
from netfall.statics.multigrid.rows import BlockRows, Pattern, row_entries, row_starts
from netfall.statics.multigrid.tangent import Incidence, Tangent, incidence_of, tangent_rows
from netfall.statics.relaxation import StaticNet

CHEBYSHEV_DEGREE = 4  # of the polynomial before and after each coarser level
CHEBYSHEV_RANGE = 20.0  # largest eigenvalue over the smallest one that the polynomial damps [-]


class Elimination:
    """Order in which the direct solver eliminates the unknowns of a matrix. It depends only on the pattern.

    entries : (k,) of the blocks of all ranks, row by row; unknowns : (3 n,) in this order
    below, diagonal : where the entries of the matrix in this order are among those of its blocks
    start, column : rows of the former; tree : of `elimination_tree`
    """

    def __init__(self, pattern: Pattern):
        """pattern : of the matrix, on the ranks. Collective."""
        gathered = pattern.comm.allgather((pattern.rows.own_gid, np.diff(pattern.start), pattern.column))
        rows, counts, columns = (np.concatenate(arrays) for arrays in zip(*gathered))
        counts, self.entries = row_entries(counts, np.argsort(rows))
        n, column = len(rows), columns[self.entries]
        row = np.repeat(np.arange(n), counts)
        above = row < column
        order = nested_dissection_order(np.column_stack([row, column])[above], n)
        self.unknowns = (3 * order[:, None] + np.arange(3)).ravel()
        place = np.argsort(self.unknowns).reshape(n, 3)
        # the entries of the blocks that end up below the diagonal, by row
        rows, columns = np.broadcast_arrays(place[row][:, :, None], place[column][:, None, :])
        self.below = np.flatnonzero(rows > columns)
        self.below = self.below[np.lexsort((columns.flat[self.below], rows.flat[self.below]))]
        self.start = row_starts(np.bincount(rows.flat[self.below], minlength=3 * n))
        self.column = columns.flat[self.below]
        on = np.flatnonzero(rows == columns)
        self.diagonal = on[np.argsort(rows.flat[on])]
        self.tree = elimination_tree(self.start, self.column)


class DirectSolver:
    """Solution of matrix x = b, of which each rank holds all rows. Unknowns without stiffness stay 0."""

    def __init__(self, elimination: Elimination, matrix: BlockRows):
        """Factorise the matrix; elimination : of its pattern. Collective."""
        self.unknowns = elimination.unknowns
        entries = np.concatenate(matrix.comm.allgather(matrix.block))[elimination.entries].ravel()
        value, diagonal = entries[elimination.below], entries[elimination.diagonal]
        permuted = elimination.start, elimination.column, value, diagonal, diagonal
        self.lower, self.d, *_ = sparse_factors(permuted, elimination.tree, drops=True)

    def __call__(self, b: np.ndarray) -> np.ndarray:
        """Return x (n, 3) of b (n, 3), in double precision."""
        x = b.reshape(-1)[self.unknowns].astype(float)
        substitute(self.lower, self.d, x)
        answer = np.empty_like(x)
        answer[self.unknowns] = x
        return answer.reshape(b.shape)


@dataclass
class CycleStructure:
    """Data that the cycles of one net share while its elements, axes and joints stay the same.

    The first cycle fills it.

    lines() : returns the lines of the net, called if the line smoother applies. Collective
    at : the elements at each particle; pattern : of the tangent; coarsenings : see `build_levels`
    elimination : of the coarsest level
    """

    lines: Callable[[], Lines]
    at: Incidence | None = None
    pattern: Pattern | None = None
    coarsenings: list[Any] = field(default_factory=list)
    elimination: Elimination | None = None


class VCycle:
    """Approximate inverse for rows (n_owned, 3) on each rank."""

    def __init__(
        self,
        distribution: Distribution,
        net: StaticNet,
        K: Tangent,
        inertia: float,
        structure: CycleStructure,
    ):
        """Set up the levels for a net's tangent, without the effect of compression. Collective.

        inertia : share of the nodal stiffness that is added; structure : data shared
            by the cycles of the net
        """
        comm, d = distribution.comm, distribution.subdomain
        self.comm = comm
        if structure.at is None:
            structure.at = incidence_of(net.ends, d.particle_gid, d.n_owned)
        self.levels: list[Any] = []
        self.direct: DirectSolver | None = None
        rows = tangent_rows(distribution, net, K, structure.at, inertia, structure.pattern)
        structure.pattern, has_joints = rows.pattern, K.joints is not None
        # the eigenvalues are at most the particles of an element or joint: its stiffness is at most that
        # many times its share of the diagonal
        top = net.ends.shape[1] if K.joints is None else K.joints.particles.shape[1]
        for level in build_levels(rows, structure.coarsenings, top):
            if level.up is None and level.matrix.rows.n <= MAX_DIRECT:
                structure.elimination = structure.elimination or Elimination(level.matrix.pattern)
                self.direct, self.rows = DirectSolver(structure.elimination, level.matrix), level.matrix.rows
                break
            down = DistributedMatrix(level.down) if level.down else None
            up = DistributedMatrix(level.up) if level.up else None
            lines = structure.lines() if not has_joints and not self.levels else None
            if lines and 0 < lines.touching <= MOST_TOUCHING:
                smoother = LineSmoother(lines, level.matrix, net, K)
                self.levels.append(_LineLevel(smoother, level.product, down, up))
            else:
                self.levels.append(_PointLevel(level.single, level.top, level.product, down, up))
            del level  # frees memory for the next one

    def __call__(self, b: np.ndarray) -> np.ndarray:
        """Return approximate displacements (n_owned, 3) due to the forces b (n_owned, 3). Collective."""
        with np.errstate(over="ignore"):  # the caller notices divergence
            single = b.astype(np.float32)
        return self._cycle(0, single).astype(float)

    def _cycle(self, k: int, b: np.ndarray) -> np.ndarray:
        if k == len(self.levels):
            assert self.direct is not None
            whole = np.zeros((self.rows.n, 3), np.float32)
            whole[self.rows.own_gid] = b
            self.comm.Allreduce(MPI.IN_PLACE, whole, MPI.SUM)  # only one term is not zero, so no rounding
            with np.errstate(over="ignore"):  # conjugate gradients notice a singular tangent
                return self.direct(whole).astype(np.float32)[self.rows.own_gid]
        level = self.levels[k]
        x: np.ndarray = level.matrix.own
        level.smooth(b, True)
        if level.down is not None:
            x += level.up(self._cycle(k + 1, level.down(b - level.matrix()).copy()))
            level.matrix.share()
            level.smooth(b, False)
        return x


@dataclass
class _LineLevel:
    lines: LineSmoother
    matrix: DistributedMatrix
    down: DistributedMatrix | None = None
    up: DistributedMatrix | None = None

    def smooth(self, b: np.ndarray, zero: bool) -> None:
        """Take one step of the line smoother towards matrix x = b, on the x in `matrix.own`.

        zero : whether to start from x = 0
        """
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
        """Take `CHEBYSHEV_DEGREE` terms of Chebyshev iteration towards matrix x = b; x is `matrix.own`.

        zero : whether to start from x = 0
        """
        middle = 0.5 * (self.top + self.top / CHEBYSHEV_RANGE)
        half = 0.5 * (self.top - self.top / CHEBYSHEV_RANGE)
        ratio = middle / half
        factor, step = 1.0 / ratio, np.zeros_like(b)
        keep, scale = 0.0, 1.0 / middle
        if zero:
            self.matrix.own[:] = 0.0
            self.matrix.share()
        for _ in range(CHEBYSHEV_DEGREE):
            self.matrix.take_step(b, self.inverse, np.float32(scale), np.float32(keep), step)
            new_factor = 1.0 / (2.0 * ratio - factor)
            keep, scale, factor = new_factor * factor, 2.0 * new_factor / half, new_factor
