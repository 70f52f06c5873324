"""Rotation of vectors about z, to rotated axes and back, with the same bits on any processor."""

import numpy as np

from netfall.core.functions import cos, sin


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
