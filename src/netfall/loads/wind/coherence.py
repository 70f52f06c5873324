"""Davenport's coherence of gusts, and the power-law profile of the mean speed.

Coherence: exp(-n sqrt(Cx^2 dx^2 + Cy^2 dy^2 + Cz^2 dz^2) / U), Davenport 1968, x along the wind.
"""

import numpy as np

from netfall.core.arrays import FloatArray
from netfall.core.functions import cos, exp, lengths, power, sin

LOWEST_HEIGHT = 1.0  # m: below it the mean speed is constant


def davenport_coherence(
    n: np.ndarray, separation: np.ndarray, decay: tuple[float, float, float], speed: FloatArray
) -> np.ndarray:
    """Compute the root coherence (f, pairs) at frequencies n (f,) [Hz] and separations (pairs, 3) [m].

    In axes of the wind. decay : (Cx, Cy, Cz), dimensionless; speed : (pairs,) [m/s], mean of the two points
    One separation (3,) gives (f,).
    """
    delay = lengths(np.asarray(decay) * separation) / speed
    return exp(-np.multiply.outer(n, delay))


def mean_speed(height: np.ndarray, speed: float, exponent: float) -> np.ndarray:
    """Compute the mean speed [m/s] at heights above ground [m]: U0 (z / 10 m)^exponent."""
    return speed * power(np.maximum(height, LOWEST_HEIGHT) / 10.0, exponent)


def along_wind(x: np.ndarray, direction: float) -> np.ndarray:
    """Rotate positions x (n, 3) to axes along wind, across it and up. direction : [degrees] from x to y."""
    angle = direction * (np.pi / 180.0)
    c, s = cos(angle), sin(angle)
    return np.column_stack([c * x[:, 0] + s * x[:, 1], c * x[:, 1] - s * x[:, 0], x[:, 2]])
