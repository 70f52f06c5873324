"""Control points in the space of the loaded nodes, and interpolation of gusts between them.

The points are the centres of clusters of the surface (k-means, Lloyd 1982, from the farthest-point choice of
Gonzalez 1985), weighted by area, in stretched axes (`surface.stretch`). The gust between them is the best
linear estimate from the nearest four. It assumes a field whose differences have a variance proportional to
distance (ordinary kriging with a linear variogram, Matheron 1963), as Davenport's coherence has for short
distances. In a row of points this is linear interpolation.
"""

from typing import Any

import numpy as np

from netfall.core.functions import lengths
from netfall.loads.wind.measured import nearest_points
from netfall.loads.wind.surface import Surface, mean_by_area, stretch

MIN_CLUSTER_DISTANCE = 5.0  # smallest distance of control points: m times the root of decay
MAX_KMEANS_ITERATIONS = 50  # largest number of k-means iterations
BLOCK = 1 << 16  # nodes per block of weights: bounds the memory


def cluster_points(surface: Surface, decay: Any, limit: int) -> np.ndarray:
    """Return at most `limit` control points (c, 3) [m] among the patches of a surface, in wind axes."""
    y = surface.place * stretch(decay)
    area = surface.over_patches(surface.area)
    centre = y[_farthest(y, area, limit)]
    label = np.full(len(y), -1)
    for _ in range(MAX_KMEANS_ITERATIONS):
        before, label = label, np.argmin(lengths(y[:, None] - centre), axis=1)
        if (label == before).all():
            break
        centre = _centres(y, area, label)
        label = np.unique(label, return_inverse=True)[1].reshape(-1)  # drops empty clusters
    return _centres(surface.place, area, label)


def _farthest(y: np.ndarray, area: np.ndarray, limit: int) -> list[int]:
    """Return rows of y (q, 3): the one farthest from the centre, then repeatedly the farthest from these."""
    distance = lengths(y - _centres(y, area, np.zeros(len(y), int)))
    rows = [int(np.argmax(distance))]
    distance = lengths(y - y[rows[0]])
    while len(rows) < limit and distance.max() >= MIN_CLUSTER_DISTANCE:
        rows.append(int(np.argmax(distance)))
        distance = np.minimum(distance, lengths(y - y[rows[-1]]))
    return rows


def _centres(y: np.ndarray, area: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Compute the area-weighted centres (c, 3) of the clusters that have members."""
    label = np.unique(label, return_inverse=True)[1].reshape(-1)
    return mean_by_area(label, area, y)


def cluster_weights(y: np.ndarray, points: np.ndarray, decay: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest control points (n, 4) of each node y (n, 3), and weights (n, 4) whose sum is 1."""
    y, points = y * stretch(decay), points * stretch(decay)
    parts = [_weights(y[first : first + BLOCK], points) for first in range(0, len(y), BLOCK)]
    return np.concatenate([corner for corner, _ in parts]), np.concatenate([weight for _, weight in parts])


def _weights(y: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return nearest control points and weights of one block of nodes; arguments as in `cluster_weights`."""
    count = min(4, len(points))
    order, distance = (table[:, :count] for table in nearest_points(y, points))
    corner, weight = np.zeros((len(y), 4), np.int64), np.zeros((len(y), 4))
    corner[:, :count] = order
    nearest = points[order]
    separation = lengths(nearest[:, :, None] - nearest[:, None])
    # covariances of differences from the nearest point, twice those of a field of variogram = distance
    between = separation[:, 1:, :1] + separation[:, :1, 1:] - separation[:, 1:, 1:]
    to_node = separation[:, 1:, 0] + distance[:, :1] - distance[:, 1:]
    weight[:, 1:count] = _solve_systems(between, to_node)
    weight[:, 0] = 1.0 - weight[:, 1:].sum(1)
    return corner, weight


def _solve_systems(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
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
