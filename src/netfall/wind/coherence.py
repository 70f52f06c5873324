"""Gusts and mean speed from place to place: Davenport's coherence, and the power-law profile of the mean.

Coherence: exp(-n sqrt(Cx^2 dx^2 + Cy^2 dy^2 + Cz^2 dz^2) / U), Davenport 1968, x along the wind.
"""

import numpy as np

from netfall.numerics.functions import cos, exp, lengths, power, sin

LOWEST_HEIGHT = 1.0  # m; the power law is not continued below it


def davenport_coherence(n: np.ndarray, separation: np.ndarray, decay, speed) -> np.ndarray:
    """Root coherence (f, pairs) at frequencies n (f,) [Hz] of points apart by `separation` (pairs, 3) [m].

    In axes of the wind. decay : (Cx, Cy, Cz), dimensionless; speed : (pairs,) [m/s], mean of the two points
    One separation (3,) gives (f,).
    """
    delay = lengths(np.asarray(decay) * separation) / speed
    return exp(-np.multiply.outer(n, delay))


def mean_speed(height: np.ndarray, speed: float, exponent: float) -> np.ndarray:
    """Mean speed [m/s] at heights above ground [m]: U0 (z / 10 m)^exponent."""
    return speed * power(np.maximum(height, LOWEST_HEIGHT) / 10.0, exponent)


def along_wind(x: np.ndarray, direction: float) -> np.ndarray:
    """Places x (n, 3) in axes along the wind, across it and up. direction : [degrees] from x towards y."""
    angle = direction * (np.pi / 180.0)
    c, s = cos(angle), sin(angle)
    return np.column_stack([c * x[:, 0] + s * x[:, 1], c * x[:, 1] - s * x[:, 0], x[:, 2]])
