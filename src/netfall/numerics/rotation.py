"""Rows of vectors turned about z, into axes of their own and back; the same bits on any processor."""

import numpy as np

from netfall.numerics.functions import cos, sin


def directions(angle: np.ndarray) -> np.ndarray:
    """Unit vectors (n, 2) of the first own axis in plan, at angles (n,) [degrees] from x towards y."""
    radians = np.fmod(angle, 360.0) * (np.pi / 180.0)
    return np.column_stack([cos(radians), sin(radians)])


def to_own(rows: np.ndarray, angle: np.ndarray | None) -> np.ndarray:
    """Vectors (n, 3), along x, y and z, in axes turned by angles (n,) [degrees]; None: as they are."""
    return rows if angle is None else _turned(rows, angle, 1.0)


def from_own(rows: np.ndarray, angle: np.ndarray | None) -> np.ndarray:
    """Vectors (n, 3) in axes turned by angles (n,) [degrees], along x, y and z; None: as they are."""
    return rows if angle is None else _turned(rows, angle, -1.0)


def _turned(rows: np.ndarray, angle: np.ndarray, sign: float) -> np.ndarray:
    """What has no angle keeps its bits."""
    turned, at = rows.copy(), np.flatnonzero(angle != 0.0)
    c, s = directions(angle[at]).T
    x, y = rows[at, 0], rows[at, 1]
    turned[at, 0], turned[at, 1] = c * x + sign * s * y, c * y - sign * s * x
    return turned
