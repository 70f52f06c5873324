"""The tangent stiffness in single precision by its elements, half as long as in blocks, for preconditioners.

A product is bound by memory: five numbers and a far end for each end of an element, where a block has nine.
A row sums its elements in ascending global number of the far end, so it has the same bits on any number of
ranks.
"""

from typing import NamedTuple

import numpy as np

from netfall.core.kernels import kernel
from netfall.core.records import has
from netfall.multigrid.tangent import Incidence, Tangent, without_compression
from netfall.numerics.arithmetic import fused
from netfall.parallel.halo import Halo


class Rows(NamedTuple):
    """The rows of one rank, n of them.

    start : (n + 1,) where the elements of each begin; other : (k,) far ends; element : (k, 5) direction,
    axial stiffness less that across, that across [N/m]; free : (n, 3)
    support : (n, 3) [N/m]; between : (n,) [N/m] of the support, between x and y. Absent: no elements
    """

    start: np.ndarray
    other: np.ndarray
    element: np.ndarray
    support: np.ndarray
    free: np.ndarray
    between: np.ndarray


@kernel
def multiply_elements(rows, x, y):
    """y (n_owned, 3) = matrix times x (n, 3). rows : `Rows`"""
    start, other, element, support, free, between = rows
    supported, coupled = has(support), has(between)
    for i in range(np.uint64(y.shape[0])):
        a = b = c = np.float32(0.0)
        if supported:
            a, b, c = support[i, 0] * x[i, 0], support[i, 1] * x[i, 1], support[i, 2] * x[i, 2]
        if coupled:
            a, b = a + between[i] * x[i, 1], b + between[i] * x[i, 0]
        for k in range(np.uint64(start[i]), np.uint64(start[i + 1])):  # unsigned: none is negative
            j = np.uint64(other[k])
            u, v, w = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2]
            dx, dy, dz, across = element[k, 0], element[k, 1], element[k, 2], element[k, 4]
            along = element[k, 3] * fused(dz, w, fused(dy, v, dx * u))
            a = fused(across, u, fused(along, dx, a))
            b = fused(across, v, fused(along, dy, b))
            c = fused(across, w, fused(along, dz, c))
        none = np.float32(0.0)
        y[i, 0] = a if free[i, 0] else none
        y[i, 1] = b if free[i, 1] else none
        y[i, 2] = c if free[i, 2] else none


@kernel
def fill_elements(at, direction, axial, across, start, other, element):
    """Fill these of `Rows`, slack elements left out.

    at : `Incidence`; direction, axial, across : of `Tangent`
    """
    k = 0
    for p in range(start.shape[0] - 1):
        start[p] = k
        for entry in range(at.start[p], at.start[p + 1]):
            e = at.element[entry]
            along = axial[e] - across[e]
            if along == 0.0 and across[e] == 0.0:
                continue
            other[k] = at.far[entry]
            element[k, 0], element[k, 1], element[k, 2] = direction[e, 0], direction[e, 1], direction[e, 2]
            element[k, 3], element[k, 4] = along, across[e]
            k += 1
    start[-1] = k


class ElementMatrix:
    """The product with a vector of rows (n_owned, 3) float32 on each rank.

    It does what `distributed.DistributedMatrix` does, without a stored matrix.

    What it is multiplied with is zero on held axes.
    """

    def __init__(self, halo: Halo, net, K: Tangent, at: Incidence, inertia: float):
        """Compression is left out.

        net : `relaxation.Net`; at : of the particles that this rank owns; inertia : share of the nodes'
        stiffness that is added
        """
        n, K = halo.n_owned, without_compression(K)
        support = np.zeros((0, 3), np.float32)
        if K.support is not None or inertia:
            held = np.zeros((n, 3)) if K.support is None else K.support[:n]
            support = np.ascontiguousarray(held + inertia * K.nodal[:n, None], np.float32)
        start, other = np.empty(n + 1, np.int32), np.empty(len(at.far), np.int32)
        element = np.empty((len(at.far), 5), np.float32)
        fill_elements(at, K.direction, K.axial, K.across, start, other, element)
        free = np.ascontiguousarray(net.free[:n] != 0, np.uint8)
        between = np.zeros(0, np.float32) if K.between is None else K.between[:n].astype(np.float32)
        self.rows = Rows(start, other[: start[-1]], element[: start[-1]], support, free, between)
        self.halo = halo
        self.x = np.zeros((len(net.x), 3), np.float32)
        self.own, self.y = self.x[:n], np.empty((n, 3), np.float32)

    def __call__(self) -> np.ndarray:
        """The rows of the product with `own`, as shared, in an array that the next call overwrites."""
        multiply_elements(self.rows, self.x, self.y)
        return self.y

    def share(self) -> None:
        """Let the other ranks know `own`. Collective."""
        self.halo.update(self.x)
