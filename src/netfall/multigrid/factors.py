"""The inverse of a tangent stiffness by its factors L D L^T, which every rank has whole; of small nets.

Of a wheel or a dome they are as quick to make as a cycle through levels, and answer exactly. Neighbouring
equilibria are then found in a few iterations of conjugate gradients. Every rank makes them of the same
numbers in the same order, so their bits do not depend on the ranks.
"""

import numpy as np

from netfall.multigrid.tangent import Tangent, block_matrix, incidence_of
from netfall.numerics.sparse import dissected, factors_of, substitute, tree_of
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution

MOST_PRODUCTS = 5e6  # that the factors may take, 5 ms; a cycle through levels is quicker in much larger nets


class Pattern:
    """What all tangents of a net have in common: which particles meet, in an order in which L is short.

    number : (n,) of each particle in it; products : that the factors take
    """

    def __init__(self, distribution: Distribution, net):
        """Collective. net : `relaxation.Net`"""
        comm, d = distribution.comm, distribution.subdomain
        ends = comm.bcast(distribution.gather_elements(d.particle_gid[net.ends]))
        free = comm.bcast(distribution.gather_particles(net.free))
        order = comm.bcast(dissected(ends, distribution.n) if comm.rank == 0 else None)
        self.order, self.number = order, np.argsort(order)
        self.ends, self.free = self.number[ends], free[order] != 0
        self.at = incidence_of(self.ends, np.arange(len(order)), len(order))
        self.mine = self.number[d.particle_gid[: d.n_owned]]
        high, low = np.sort(self.ends, axis=1).T[::-1]
        by_row = np.lexsort((low, high))
        start = np.searchsorted(high[by_row], np.arange(len(order) + 1))
        self.products = 27.0 * float((tree_of(start, low[by_row])[1].astype(float) ** 2).sum())


class Factors:
    """The inverse, for rows (n_owned, 3) on each rank."""

    def __init__(self, distribution: Distribution, pattern: Pattern, lower, d: np.ndarray):
        self.comm, self.pattern, self.lower, self.d = distribution.comm, pattern, lower, d

    def __call__(self, b: np.ndarray) -> np.ndarray:
        """The displacements (n_owned, 3) that the forces b (n_owned, 3) make. Collective."""
        whole = np.zeros((len(self.pattern.order), 3))
        whole[self.pattern.mine] += b
        self.comm.Allreduce(MPI.IN_PLACE, whole, MPI.SUM)  # one term that is not zero: no rounding
        substitute(self.lower, self.d, whole.reshape(-1))
        return whole[self.pattern.mine]


def factors_of_tangent(
    distribution: Distribution, pattern: Pattern, K: Tangent, inertia: float
) -> Factors | None:
    """Of a tangent, without what compression takes from it where it is not positive. Collective.

    inertia : share of the nodes' stiffness that is added. None where that is not positive either.
    """
    comm, order = distribution.comm, pattern.order
    elements = np.column_stack([K.direction, K.axial, K.across])
    elements = comm.bcast(distribution.gather_elements(elements))
    support = between = None
    if K.between is not None:
        between = comm.bcast(distribution.gather_particles(K.between))[order]
    if K.support is not None or inertia:
        beside = inertia * K.nodal[:, None] + (np.zeros(3) if K.support is None else K.support)
        support = comm.bcast(distribution.gather_particles(beside))[order]
    direction, axial, across = np.ascontiguousarray(elements[:, :3]), *elements[:, 3:].T.copy()
    for part in (across, np.maximum(across, 0.0)):
        lower, d, last, _ = factors_of(*_rows(pattern, direction, axial, part, support, between))
        if last == len(d) and (d > 0.0).all():
            return Factors(distribution, pattern, lower, d)
    return None


def _rows(pattern: Pattern, direction, axial, across, support, between):
    """The matrix as of `factors_of`, left of the diagonal alone."""
    n, none = len(pattern.order), np.zeros(len(pattern.order))
    of_net = pattern.free, support, none, np.arange(n), pattern.at, n, between
    matrix = block_matrix(pattern.ends, direction, axial, across, *of_net).tocsr()
    row = np.repeat(np.arange(3 * n), np.diff(matrix.indptr))
    left, diagonal = matrix.indices < row, matrix.diagonal()
    start = np.concatenate([[0], np.cumsum(np.bincount(row[left], minlength=3 * n))])
    column = matrix.indices[left].astype(np.int64)
    return start, column, matrix.data[left], diagonal, np.abs(diagonal)
