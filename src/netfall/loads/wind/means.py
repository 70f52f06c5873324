"""Gusts as means over the loaded surface around control points, which give the exact spectrum of its load.

Between the control points gusts are g(y) = sum_i h_i(y) u_i, where the h_i sum to 1 at every node. The u_i
are the projection of the gusts u on the surface,

    u_i = sum_j M^-1_ij sum_p a_p h_j(y_p) u(y_p),    M_ij = sum_p a_p h_i(y_p) h_j(y_p),    a_p the areas.

A load whose shape is a sum of the h_i, such as the whole load, therefore has at every frequency the
spectrum of Davenport's coherence. Interpolated gusts at points are too coherent over a cell at high
frequencies. Means are weaker at a single node, because they lack gusts smaller than a cell.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray
from netfall.core.errors import InputError
from netfall.core.functions import exp
from netfall.core.linear import factorise_cholesky, product, solve_cholesky_columns
from netfall.loads import messages
from netfall.loads.wind.surface import Surface


@dataclass(frozen=True)
class SurfaceMeans:
    """Means of gusts over a surface. delay : (a,) [s]; pairs : (a, c, c), of `Surface.pairs`"""

    delay: np.ndarray
    pairs: np.ndarray

    def covariances(self, n: FloatArray, weight: FloatArray) -> np.ndarray:
        """Compute sums (w, c, c) of their coherence over frequencies n (f,) [Hz] with weights (w, f)."""
        r = product(weight, self._coherence(n))
        sums = product(r, self.pairs.reshape(len(self.delay), -1))
        return sums.reshape(-1, *self.pairs.shape[1:])

    def kept(self, n: Any, some: Any) -> np.ndarray:
        """Compute the share (f,) of the spectrum at n (f,) [Hz] in the means `some`, averaged over these."""
        return product(self._coherence(n), self.pairs[:, some, some]).mean(1)

    def _coherence(self, n: FloatArray) -> np.ndarray:
        """Compute the coherence (f, a) of the delays."""
        return exp(-np.multiply.outer(n, self.delay))


def make_surface_means(
    surface: Surface, corner: np.ndarray, weight: np.ndarray, count: int, decay: Any
) -> SurfaceMeans:
    """Build the means around control points from the interpolation weights (n, 4) of the nodes."""
    corner, weight = corner[surface.node], weight[surface.node]
    index = surface.patch[:, None] * count + corner
    shape = np.bincount(index.ravel(), (surface.area[:, None] * weight).ravel(), len(surface.place) * count)
    delay, pairs = surface.pairs(shape.reshape(-1, count), decay)
    index = corner[:, :, None] * count + corner[:, None]
    overlap = surface.area[:, None, None] * weight[:, :, None] * weight[:, None]
    M: Any = np.bincount(index.ravel(), overlap.ravel(), count * count).reshape(count, count)
    inverse = np.eye(count)
    if factorise_cholesky(M):
        raise InputError(messages.COINCIDENT_CONTROL_POINTS())
    solve_cholesky_columns(M, inverse)
    return SurfaceMeans(delay, np.array([_between(inverse, matrix) for matrix in pairs]))


def _between(inverse: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return inverse matrix inverse^T, symmetric to the last bit."""
    full = product(product(inverse, matrix), inverse.T)
    return 0.5 * (full + full.T)
