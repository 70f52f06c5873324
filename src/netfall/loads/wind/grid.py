"""Control points on a grid over the plan, along and across the wind, and bilinear gusts between them."""

from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray, IntArray
from netfall.core.functions import lengths

CLOSEST = 2.0  # m: smallest distance of control points
NEAREST_TOLERANCE = 1e-5  # share of the plan size up to which distances from a control point count as equal


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
    """Tell whether every node y (n, 3) is as close to control points in height as in plan, by coherence.

    The height of a node above the surface through the control points counts against half a cell diagonal.
    """
    height = np.sum(weight * points[corner, 2], axis=1)
    reach = 0.5 * lengths(np.asarray(decay[:2])[None] * cell)[0]
    return bool((decay[2] * np.abs(y[:, 2] - height) <= reach).all())


def control_grid(x: np.ndarray, limit: int) -> tuple[np.ndarray, np.ndarray]:
    """Return coordinates along x and y of at most `limit` control points over the plan of x (n, 3)."""
    low, extent = x[:, :2].min(0), np.ptp(x[:, :2], axis=0)
    max_count = 1 + np.floor(extent / CLOSEST).astype(int)
    ratio = (extent[0] + 1e-9) / (extent[1] + 1e-9)
    nx = int(np.clip(round(np.sqrt(limit * ratio)), 1, min(limit, max_count[0])))
    ny = int(np.clip(limit // nx, 1, max_count[1]))

    def coordinates(k: int, count: int) -> FloatArray:
        return low[k] + extent[k] * (np.linspace(0, 1, count) if count > 1 else np.array([0.5]))

    return coordinates(0, nx), coordinates(1, ny)


def control_heights(plan: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return heights z (c,) [m] of control points, in plan (c, 2), over the loaded nodes x (n, 3).

    It is the height of the nearest node; of several nearest nodes, the middle between highest and lowest. The
    result does not depend on the order of the nodes, and a mirrored roof has mirrored points.
    """
    slack = NEAREST_TOLERANCE * np.ptp(x[:, :2], axis=0).max()

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
