"""Axes rotated about z, and of a roof seen from its outer side, with the same bits on any processor."""

import numpy as np

from netfall.core.functions import cos, lengths, sin

VERTICAL = 1e-9  # horizontal part of a unit normal below which it counts as vertical


def directions(angle: np.ndarray) -> np.ndarray:
    """Return unit vectors (n, 2) in plan at angles (n,) [degrees] from x towards y."""
    radians = np.fmod(angle, 360.0) * (np.pi / 180.0)
    return np.column_stack([cos(radians), sin(radians)])


def to_rotated_axes(rows: np.ndarray, angle: np.ndarray | None) -> np.ndarray:
    """Transform vectors (n, 3) from x, y, z to axes rotated by angles (n,) [degrees]; None: no change."""
    return rows if angle is None else _rotated(rows, angle, 1.0)


def from_rotated_axes(rows: np.ndarray, angle: np.ndarray | None) -> np.ndarray:
    """Transform vectors (n, 3) from axes rotated by angles (n,) [degrees] to x, y, z; None: no change."""
    return rows if angle is None else _rotated(rows, angle, -1.0)


def _rotated(rows: np.ndarray, angle: np.ndarray, sign: float) -> np.ndarray:
    """Rotate the vectors with a nonzero angle; the others keep their bits."""
    rotated, index = rows.copy(), np.flatnonzero(angle != 0.0)
    c, s = directions(angle[index]).T
    x, y = rows[index, 0], rows[index, 1]
    rotated[index, 0], rotated[index, 1] = c * x + sign * s * y, c * y - sign * s * x
    return rotated


def surface_axes(normal: list[float] | None) -> np.ndarray | None:
    """Return unit vectors (3, 3) along a surface, up in it, and outward; None: of the plan, x, y and z.

    Seen from outside, the first is horizontal to the right. normal : (3,), outward, of any length
    """
    if normal is None:
        return None
    outward = np.array(normal, float) / lengths(np.array([normal], float))[0]
    up = np.array([0.0, 0.0, 1.0]) - outward[2] * outward
    size = lengths(up[None])[0]
    up = up / size if size > VERTICAL else np.array([0.0, 1.0, 0.0])
    return np.stack([np.cross(up, outward), up, outward])


def along_axes(points: np.ndarray, axes: np.ndarray | None) -> np.ndarray:
    """Return the coordinates (..., 3) of points (..., 3) along axes (3, 3); None: the points."""
    if axes is None:
        return points
    return np.stack([np.sum(points * axis, axis=-1) for axis in axes], -1)
