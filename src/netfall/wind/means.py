"""Gusts that are means over the loaded surface around control points, with which its load is right.

Between the control points gusts are g(y) = sum_i h_i(y) u_i, where the h_i sum to 1 at every node. The u_i
are the projection of the gusts u on the surface,

    u_i = sum_j M^-1_ij sum_p a_p h_j(y_p) u(y_p),    M_ij = sum_p a_p h_i(y_p) h_j(y_p),    a_p the areas.

So a load whose shape is made of the h_i, such as the whole load, has at every frequency the spectrum that
Davenport's coherence gives it. Gusts at the points, interpolated, are alike over a whole cell, however fast
they vary. Means are weaker at a single node: they lack what is alike over less than a cell.
"""

from dataclasses import dataclass

import numpy as np

from netfall.ground.errors import InputError
from netfall.numerics.functions import exp
from netfall.numerics.linear import factorised, product, solve_columns
from netfall.wind.surface import Surface


@dataclass(frozen=True)
class Means:
    """Means of gusts over a surface. delay : (a,) [s]; pairs : (a, c, c), of `Surface.pairs`"""

    delay: np.ndarray
    pairs: np.ndarray

    def covariances(self, n, weight) -> np.ndarray:
        """Sums (w, c, c) over frequencies n (f,) [Hz] of their coherence, by weights (w, f)."""
        r = np.empty((len(weight), len(self.delay)))
        product(weight, self._coherence(n), r)
        found = np.empty((len(weight), self.pairs[0].size))
        product(r, self.pairs.reshape(len(self.delay), -1), found)
        return found.reshape(-1, *self.pairs.shape[1:])

    def kept(self, n, some) -> np.ndarray:
        """Share (f,) of the spectrum at frequencies n (f,) that some of them have, mean over these."""
        found = np.empty((len(n), len(some)))
        product(self._coherence(n), np.ascontiguousarray(self.pairs[:, some, some]), found)
        return found.mean(1)

    def _coherence(self, n) -> np.ndarray:
        return exp(-np.multiply.outer(n, self.delay))


def means_over(surface: Surface, corner: np.ndarray, weight: np.ndarray, count: int, decay) -> Means:
    """Return the means around control points of which the nodes have the weights (n, 4)."""
    corner, weight = corner[surface.node], weight[surface.node]
    at = surface.patch[:, None] * count + corner
    shape = np.bincount(at.ravel(), (surface.area[:, None] * weight).ravel(), len(surface.place) * count)
    delay, pairs = surface.pairs(shape.reshape(-1, count), decay)
    at = corner[:, :, None] * count + corner[:, None]
    alike = surface.area[:, None, None] * weight[:, :, None] * weight[:, None]
    M, inverse = np.bincount(at.ravel(), alike.ravel(), count * count).reshape(count, count), np.eye(count)
    if factorised(M):
        raise InputError("[wind] two control points are one to rounding; expected fewer control_points")
    solve_columns(M, inverse)
    return Means(delay, np.array([_between(inverse, each) for each in pairs]))


def _between(inverse: np.ndarray, each: np.ndarray) -> np.ndarray:
    """Return inverse each inverse^T, symmetric to the last bit."""
    half, whole = np.empty_like(each), np.empty_like(each)
    product(inverse, each, half)
    product(half, np.ascontiguousarray(inverse.T), whole)
    return 0.5 * (whole + whole.T)
