"""Loaded surface of a net as patches, sums of the coherence over pairs of them, and means of gusts over it.

A patch is the tributary area of a node, or in a large net all nodes in a cube. Davenport's coherence is a
function f of the delay alone, exp(-n delay). Its sum over pairs is therefore sum_a f(d_a) K_a with a table of
delays d_a; between them f is a cubic through the nearest four.

Between the control points gusts are g(y) = sum_i h_i(y) u_i, where the h_i sum to 1 at every node. The u_i
are the projection of the gusts u on the surface,

    u_i = sum_j M^-1_ij sum_p a_p h_j(y_p) u(y_p),    M_ij = sum_p a_p h_i(y_p) h_j(y_p),    a_p the areas.

A load distributed as a sum of the h_i, such as the total load, therefore has the spectrum of Davenport's
coherence at every frequency. Interpolated gusts at points are too coherent over a cell at high frequencies.
Means are too weak at a single node, because they lack gusts smaller than a cell.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray, IntArray
from netfall.core.errors import InputError
from netfall.core.functions import exp, geometric, lengths, log
from netfall.core.linear import factorise_cholesky, product, solve_cholesky_columns
from netfall.loads import messages

MAX_PATCHES = 400  # largest number of patches, unless PATCHES_PER_POINT asks for more
PATCHES_PER_POINT = 4  # allowed patches per control point
CUBE_GROWTH = 1.2  # factor on the side of the cubes until there are few enough patches
DELAYS_PER_E_FOLD = 8  # delays of the table per factor e; the error of a cubic of exp(-n d) is then 1e-5
MIN_DELAY = 1e-5  # share of the longest delay; shorter delays count as this
# share of the extent of the roof [-] up to which positions and distances count as equal: otherwise a form
# that differs in its last digits would have other gusts from the same seed
POSITION_TOLERANCE = 1e-6
MIN_POINT_DISTANCE = 2.0  # in sizes of two patches, in delays: from here on patches count as points
PAIRS_BLOCK = 4096  # pairs per block: bounds the memory
POINT_PAIRS = 128  # point pairs per pair of patches: the mean error of exp(-n d) is 3 %
# of a uniform sequence in a cube
SEQUENCE_STEPS = 0.8191725133961645, 0.6710436067037893, 0.5497004779019703


@dataclass(frozen=True)
class Surface:
    """Patches of the loaded nodes, in axes of the wind.

    node : (n,) rows of the loaded nodes, in an order that depends only on positions; patch : (n,) of each
    node
    area : (n,) [m2]
    place : (q, 3) [m], centres of the patches; spread : (q, 3) [m2], variance of the positions in each
    speed : (q,) [m/s], mean speed at each
    """

    node: np.ndarray
    patch: np.ndarray
    area: np.ndarray
    place: np.ndarray
    spread: np.ndarray
    speed: np.ndarray

    def over_patches(self, values: np.ndarray) -> np.ndarray:
        """Sum values (n,) of the loaded nodes over each patch (q,)."""
        return np.bincount(self.patch, values, len(self.place))

    def pairs(self, shape: np.ndarray, decay: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
        """Return delays d (a,) [s] and K (a, c, c) with sum_a f(d_a) K_a = shape^T f(delays) shape.

        shape : (q, c), c loads on the patches
        """
        column, value = _packed(shape)
        p, q = np.triu_indices(len(shape))
        weight = np.where(p == q, 0.5, 1.0)
        d, count = self._table(decay), shape.shape[1]
        half = np.zeros(len(d) * count * count)
        for first in range(0, len(p), PAIRS_BLOCK):
            block = slice(first, first + PAIRS_BLOCK)
            pair, a, share = self._shares(d, p[block], q[block], decay)
            one, other, share = p[block][pair], q[block][pair], share * weight[block][pair]
            row = (a[:, None] * count + column[one])[:, :, None]
            index = row * count + column[other][:, None]
            product = share[:, None, None] * value[one][:, :, None] * value[other][:, None]
            half += np.bincount(index.ravel(), product.ravel(), len(half))
        half = half.reshape(len(d), count, count)
        return d, half + half.transpose(0, 2, 1)

    def _shares(
        self, d: FloatArray, one: IntArray, other: IntArray, decay: tuple[float, float, float]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distribute pairs of patches over the delays of the table.

        Returns the number of the pair (k,), the number of the delay (k,), and the weight (k,).
        Patches close to each other have the delays of points within them, on average; distant ones
        have the delay of their centres.
        """
        to_delay = np.asarray(decay) / (0.5 * (self.speed[one] + self.speed[other]))[:, None]
        separation = (self.place[other] - self.place[one]) * to_delay
        size = np.sqrt(6.0 * (self.spread[one] + self.spread[other])) * to_delay
        far = lengths(separation) >= MIN_POINT_DISTANCE * lengths(size)
        offsets, weight = _differences()
        close_delays = lengths(separation[~far, None] + size[~far, None] * offsets)
        pair = np.append(np.flatnonzero(far), np.repeat(np.flatnonzero(~far), POINT_PAIRS))
        first, share = _cubic(d, np.append(lengths(separation[far]), close_delays.ravel()))
        share = share * np.append(np.ones(far.sum()), np.tile(weight, (~far).sum()))
        index = np.concatenate([pair * len(d) + first + k for k in range(4)])
        sums = np.bincount(index, share.ravel(), len(one) * len(d)).reshape(len(one), len(d))
        number, a = np.nonzero(sums)
        return number, a, sums[number, a]

    def _table(self, decay: tuple[float, float, float]) -> np.ndarray:
        """Return delays (a,) [s] in geometric progression, up to the longest between two patches."""
        extent = np.ptp(self.place, axis=0) + 2.0 * np.sqrt(3.0 * self.spread.max(0))
        high = lengths((extent * decay)[None])[0] / self.speed.min()
        high = high if high > 0.0 else 1.0
        return geometric(MIN_DELAY * high, high, 1 + int(DELAYS_PER_E_FOLD * float(log(1.0 / MIN_DELAY))))


def square_variances(vector: np.ndarray) -> np.ndarray:
    """Compute the variances (n, 3) [m2] of positions in squares with vector areas (n, 3) [m2]."""
    area = lengths(vector)[:, None]
    return np.asarray(area * (1.0 - (vector / np.where(area > 0.0, area, 1.0)) ** 2) / 12.0)


def make_surface(
    patches: Any, vector: np.ndarray, speed: np.ndarray, decay: FloatArray, points: int
) -> Surface:
    """Build the loaded surface of nodes with vector areas (n, 3), in wind axes.

    patches : centres (n, 3) [m] of the areas, and variances (n, 3) [m2] of positions in them
    speed : (n,) [m/s], mean at the nodes; points : largest number of control points
    If no node is loaded, all nodes count equally.
    """
    y, spread = patches
    loaded = vector.any(1)
    node = np.flatnonzero(loaded) if loaded.any() else np.arange(len(y))
    vector = vector if loaded.any() else np.tile([0.0, 0.0, 1.0], (len(y), 1))
    places = np.column_stack([vector, y])[node]
    extent = np.repeat([np.abs(vector).max(), np.ptp(y, axis=0).max() or 1.0], 3)
    node = node[np.lexsort(np.round(places / (POSITION_TOLERANCE * extent)).T)]
    y, vector, speed = y[node], vector[node], speed[node]
    area = lengths(vector)
    patch = _cubes(y * stretch(decay), max(MAX_PATCHES, PATCHES_PER_POINT * points))
    centre = mean_by_area(patch, area, y)
    spread = mean_by_area(patch, area, (y - centre[patch]) ** 2 + spread[node])
    return Surface(node, patch, area, centre, spread, mean_by_area(patch, area, speed[:, None])[:, 0])


def stretch(decay: FloatArray | tuple[float, ...]) -> np.ndarray:
    """Return scale factors (3,) along and across the wind and upward, after which patches are cubes.

    They are roots of the decays. This is a compromise between cubes in space, for load distributions, and
    cubes in delays, for gusts.
    """
    return np.sqrt(np.asarray(decay))


def mean_by_area(patch: np.ndarray, area: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Compute area-weighted means (q, k) over each patch of values (n, k)."""
    sums = [np.bincount(patch, area * column) for column in values.T]
    return np.column_stack(sums) / np.bincount(patch, area)[:, None]


def _cubes(y: np.ndarray, most: int) -> np.ndarray:
    """Number the patches (n,) of points y (n, 3): each point is one or, if there are too many, each cube."""
    if len(y) <= most:
        return np.arange(len(y))
    low, extent = y.min(0), np.ptp(y, axis=0)
    longest, second = sorted(extent)[:0:-1]
    side = max(0.5 * float(np.sqrt(longest * second / most)), longest / most) or 1.0
    while True:
        i, j, k = np.floor((y - low) / side).astype(np.int64).T
        cubes, number = np.unique((i * (j.max() + 1) + j) * (k.max() + 1) + k, return_inverse=True)
        if len(cubes) <= most:
            return number
        side *= CUBE_GROWTH


def _differences() -> tuple[np.ndarray, np.ndarray]:
    """Return differences (POINT_PAIRS, 3) of two random points in a unit cube, and weights that sum to 1.

    Their density along each axis is 1 - |t|. They concentrate at 0, where coherence peaks: t = u |u|, with u
    uniformly spread (a sequence of Roberts 2018).
    """
    u = 2.0 * ((0.5 + np.arange(1, POINT_PAIRS + 1)[:, None] * np.array(SEQUENCE_STEPS)) % 1.0) - 1.0
    weight = np.abs(u) * (1.0 - u * u)
    weight = weight[:, 0] * weight[:, 1] * weight[:, 2]
    return u * np.abs(u), weight / weight.sum()


def _packed(shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return columns and values (q, k) of the non-zeros in rows (q, c), padded with zeros."""
    width = np.count_nonzero(shape, axis=1).max()
    column = np.argsort(shape == 0.0, axis=1, kind="stable")[:, :width]
    return column, np.take_along_axis(shape, column, 1)


def _cubic(d: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the first of four delays (n,) of a table d around each value, and Lagrange weights (4, n)."""
    values = np.clip(values, d[0], d[-1])
    first = np.clip(np.searchsorted(d, values, side="right") - 2, 0, len(d) - 4)
    share = np.ones((4, len(values)))
    for k in range(4):
        for other in range(4):
            if other != k:
                share[k] *= (values - d[first + other]) / (d[first + k] - d[first + other])
    return first, share


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
    means = np.array([product(product(inverse, matrix), inverse.T) for matrix in pairs])
    return SurfaceMeans(delay, 0.5 * (means + means.transpose(0, 2, 1)))  # symmetric to the last bit
