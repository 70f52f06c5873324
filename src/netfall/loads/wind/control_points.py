"""Control points of gusts and interpolation between them, on a grid over the plan or in space.

On a grid, along and across the wind, gusts are bilinear between the points.

In the space of the loaded nodes, the points are the centres of clusters of the surface (k-means, Lloyd 1982,
from the farthest-point choice of Gonzalez 1985), weighted by area, in stretched axes (`surface.stretch`). The
gust between them is the best linear estimate from the nearest four. It assumes a field whose differences have
a variance proportional to distance (ordinary kriging with a linear variogram, Matheron 1963), as Davenport's
coherence has for short distances. For points in a row this is linear interpolation.
"""

from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray, IntArray
from netfall.core.functions import lengths
from netfall.loads.wind.measured import nearest_points
from netfall.loads.wind.surface import POSITION_TOLERANCE, Surface, mean_by_area, stretch

MIN_POINT_DISTANCE = 2.0  # m: smallest distance of control points


def plan_points(y: np.ndarray, loaded: np.ndarray, limit: int) -> tuple[Any, ...]:
    """Return control points (c, 3) [m] on a grid over the plan of nodes y (n, 3), in axes of the wind.

    Also returns the points around each node (n, 4), their weights (n, 4), and the sides (2,) [m] of a cell.

    loaded : (n,) whether the wind acts on a node
    """
    gx, gy = control_grid(y, limit)
    X, Y = np.meshgrid(gx, gy, indexing="ij")
    plan = np.column_stack([X.ravel(), Y.ravel()])
    points = np.column_stack([plan, control_heights(plan, y[loaded] if loaded.any() else y)])
    cell = np.ptp(y[:, :2], axis=0) / np.maximum([len(gx) - 1, len(gy) - 1], 1)
    corner, weight = _bilinear(y, gx, gy)
    return points, corner, weight, cell


def is_resolved(
    y: FloatArray,
    points: FloatArray,
    corner: IntArray,
    weight: FloatArray,
    cell: FloatArray,
    decay: tuple[float, float, float],
) -> bool:
    """Return whether every node y (n, 3) is as close to control points in height as in plan, by coherence.

    The height of a node above the surface through the control points is compared with half a cell diagonal.
    """
    height = np.sum(weight * points[corner, 2], axis=1)
    reach = 0.5 * lengths(np.asarray(decay[:2])[None] * cell)[0]
    return bool((decay[2] * np.abs(y[:, 2] - height) <= reach).all())


def control_grid(x: np.ndarray, limit: int) -> tuple[np.ndarray, np.ndarray]:
    """Return coordinates along x and y of at most `limit` control points over the plan of x (n, 3)."""
    low, extent = x[:, :2].min(0), np.ptp(x[:, :2], axis=0)
    max_count = 1 + np.floor(extent / MIN_POINT_DISTANCE).astype(int)
    ratio = (extent[0] + 1e-9) / (extent[1] + 1e-9)
    nx = int(np.clip(round(np.sqrt(limit * ratio)), 1, min(limit, max_count[0])))
    ny = int(np.clip(limit // nx, 1, max_count[1]))

    def coordinates(k: int, count: int) -> FloatArray:
        return low[k] + extent[k] * (np.linspace(0, 1, count) if count > 1 else np.array([0.5]))

    return coordinates(0, nx), coordinates(1, ny)


def control_heights(plan: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return heights z (c,) [m] of control points, in plan (c, 2), over the loaded nodes x (n, 3).

    It is the height of the nearest node, or the mean of the highest and lowest of several nearest nodes. The
    result does not depend on the order of the nodes, and a mirrored roof has mirrored points.
    """
    slack = POSITION_TOLERANCE * np.ptp(x[:, :2], axis=0).max()

    def height(point: FloatArray) -> float:
        distance = np.sqrt(np.sum((x[:, :2] - point) ** 2, axis=1))
        z = x[distance <= distance.min() + slack, 2]
        return 0.5 * (z.min() + z.max())

    return np.array([height(point) for point in plan])


def _bilinear(x: FloatArray, gx: FloatArray, gy: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the control points (n, 4) around each particle in plan, and their weights."""

    def along(values: Any, grid: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
        if len(grid) == 1:
            return np.zeros(len(values), np.int64), np.zeros(len(values), np.int64), np.zeros(len(values))
        i = np.clip(np.searchsorted(grid, values, side="right") - 1, 0, len(grid) - 2)
        return i, i + 1, np.clip((values - grid[i]) / (grid[i + 1] - grid[i]), 0.0, 1.0)

    i0, i1, s = along(x[:, 0], gx)
    j0, j1, t = along(x[:, 1], gy)
    ny = len(gy)
    corner = np.stack([i0 * ny + j0, i0 * ny + j1, i1 * ny + j0, i1 * ny + j1], -1)
    return corner, np.stack([(1 - s) * (1 - t), (1 - s) * t, s * (1 - t), s * t], -1)


MIN_CLUSTER_DISTANCE = 5.0  # smallest distance of control points: m times the root of decay
MAX_KMEANS_ITERATIONS = 50  # largest number of k-means iterations
WEIGHTS_BLOCK = 1 << 16  # nodes per block of weights: bounds the memory


def cluster_points(surface: Surface, decay: Any, limit: int) -> np.ndarray:
    """Return at most `limit` control points (c, 3) [m] among the patches of a surface, in wind axes."""
    y = surface.place * stretch(decay)
    area = surface.over_patches(surface.area)
    centre = y[_farthest(y, area, limit)]
    label = np.full(len(y), -1)
    for _ in range(MAX_KMEANS_ITERATIONS):
        before, label = label, _first_smallest(lengths(y[:, None] - centre), y)
        if (label == before).all():
            break
        label = np.unique(label, return_inverse=True)[1].reshape(-1)  # drops empty clusters
        centre = mean_by_area(label, area, y)
    return mean_by_area(label, area, surface.place)


def _farthest(y: np.ndarray, area: np.ndarray, limit: int) -> list[int]:
    """Return rows of y (q, 3): the one farthest from the centre, then repeatedly the farthest from these."""
    distance = lengths(y - mean_by_area(np.zeros(len(y), int), area, y))
    rows = [int(_first_smallest(-distance, y))]
    distance = lengths(y - y[rows[0]])
    while len(rows) < limit and distance.max() >= MIN_CLUSTER_DISTANCE:
        rows.append(int(_first_smallest(-distance, y)))
        distance = np.minimum(distance, lengths(y - y[rows[-1]]))
    return rows


def _first_smallest(distance: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the index of the smallest distance (..., c) along the last axis, of equal ones the first.

    y : (q, 3) the patches; their extent is the scale of the tolerance, because in a symmetric roof many
    distances differ only by rounding.
    """
    allowed = distance.min(-1) + POSITION_TOLERANCE * np.ptp(y, axis=0).max()
    return np.argmax(distance <= allowed[..., None], axis=-1)


def cluster_weights(y: np.ndarray, points: np.ndarray, decay: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest control points (n, 4) of each node y (n, 3), and weights (n, 4) whose sum is 1."""
    y, points = y * stretch(decay), points * stretch(decay)
    parts = [_weights(y[first : first + WEIGHTS_BLOCK], points) for first in range(0, len(y), WEIGHTS_BLOCK)]
    return np.concatenate([corner for corner, _ in parts]), np.concatenate([weight for _, weight in parts])


def _weights(y: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return nearest control points and weights of one block of nodes; arguments as in `cluster_weights`."""
    count = min(4, len(points))
    equal = POSITION_TOLERANCE * float(np.ptp(points, axis=0).max())
    order, distance = (table[:, :count] for table in nearest_points(y, points, equal))
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
