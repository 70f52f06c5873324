"""Control points in the space that the loaded nodes fill, and gusts between them.

The points are the centres of clusters of the surface (k-means, Lloyd 1982, from the farthest-point choice of
Gonzalez 1985), by area, in stretched axes (`surface.stretch`). Between them gusts are the best
linear estimate from the nearest four of a field whose difference has a variance in proportion to distance
(ordinary kriging with a linear variogram, Matheron 1963): so Davenport's coherence begins. In a row of points
it is linear interpolation.
"""

import numpy as np

from netfall.numerics.functions import lengths
from netfall.wind.measured import nearest_places
from netfall.wind.surface import Surface, by_area, stretch

CLOSEST = 5.0  # m between control points times the root of decay, at the least
ROUNDS = 50  # of k-means, at most
BLOCK = 1 << 16  # nodes whose weights are found at once


def cluster_points(surface: Surface, decay, limit: int) -> np.ndarray:
    """Return at most `limit` control points (c, 3) [m] amid the patches of a surface, in axes of the wind."""
    y = surface.place * stretch(decay)
    area = surface.over_patches(surface.area)
    centre = y[_farthest(y, area, limit)]
    label = np.full(len(y), -1)
    for _ in range(ROUNDS):
        before, label = label, np.argmin(lengths(y[:, None] - centre), axis=1)
        if (label == before).all():
            break
        centre = _centres(y, area, label)
        label = np.unique(label, return_inverse=True)[1].reshape(-1)  # without clusters that became empty
    return _centres(surface.place, area, label)


def _farthest(y: np.ndarray, area: np.ndarray, limit: int) -> list[int]:
    """Rows of y (q, 3): the one farthest from the centre, then again and again that farthest from those."""
    apart = lengths(y - _centres(y, area, np.zeros(len(y), int)))
    found = [int(np.argmax(apart))]
    apart = lengths(y - y[found[0]])
    while len(found) < limit and apart.max() >= CLOSEST:
        found.append(int(np.argmax(apart)))
        apart = np.minimum(apart, lengths(y - y[found[-1]]))
    return found


def _centres(y: np.ndarray, area: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Centres (c, 3) of clusters, those that have members, by area."""
    label = np.unique(label, return_inverse=True)[1].reshape(-1)
    return by_area(label, area, y)


def cluster_weights(y: np.ndarray, points: np.ndarray, decay) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest control points (n, 4) of each node y (n, 3), and weights (n, 4) whose sum is 1."""
    y, points = y * stretch(decay), points * stretch(decay)
    parts = [_weights(y[first : first + BLOCK], points) for first in range(0, len(y), BLOCK)]
    return np.concatenate([corner for corner, _ in parts]), np.concatenate([weight for _, weight in parts])


def _weights(y: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    few = min(4, len(points))
    order, apart = (found[:, :few] for found in nearest_places(y, points))
    corner, weight = np.zeros((len(y), 4), np.int64), np.zeros((len(y), 4))
    corner[:, :few] = order
    near = points[order]
    gap = lengths(near[:, :, None] - near[:, None])
    # covariances of what differs from the nearest point: twice those of a field of variogram = distance
    between = gap[:, 1:, :1] + gap[:, :1, 1:] - gap[:, 1:, 1:]
    there = gap[:, 1:, 0] + apart[:, :1] - apart[:, 1:]
    weight[:, 1:few] = _solved(between, there)
    weight[:, 0] = 1.0 - weight[:, 1:].sum(1)
    return corner, weight


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve systems (n, k, k) x = (n, k), positive definite, by elimination in one order."""
    matrix, x = matrix.copy(), right.copy()
    k = x.shape[1]
    for i in range(k):
        for j in range(i + 1, k):
            factor = matrix[:, j, i] / matrix[:, i, i]
            matrix[:, j] -= factor[:, None] * matrix[:, i]
            x[:, j] -= factor * x[:, i]
    for i in range(k - 1, -1, -1):
        for j in range(i + 1, k):
            x[:, i] -= matrix[:, i, j] * x[:, j]
        x[:, i] /= matrix[:, i, i]
    return x
