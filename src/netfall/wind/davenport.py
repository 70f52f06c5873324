"""Davenport's gust: spectrum, coherence, and the power-law profile of the mean speed.

Spectrum: paper Eq. 5 (Davenport 1961); its integral over all frequencies is 6 k U0^2.
Coherence: exp(-n sqrt(Cx^2 dx^2 + Cy^2 dy^2 + Cz^2 dz^2) / U), Davenport 1968.
"""

import numpy as np

GUST_LENGTH = 1200.0  # m, the length in x = 1200 n / U0
LOWEST_HEIGHT = 1.0  # m; the power law is not continued below it


def davenport_spectrum(n: np.ndarray, speed: float, roughness: float) -> np.ndarray:
    """One-sided spectrum of the gust speed [m2/s2/Hz] at frequencies n [Hz].

    speed : U0 [m/s], mean at 10 m
    roughness : k, surface roughness coefficient

    S(n) = 4 k U0^2 x^2 / (n (1 + x^2)^(4/3)), x = 1200 n / U0  (paper Eq. 5)
    """
    x = GUST_LENGTH * np.asarray(n, float) / speed
    # x^2 / n written as x 1200 / U0, which also holds at n = 0
    return 4.0 * roughness * speed**2 * x * (GUST_LENGTH / speed) / (1.0 + x * x) ** (4.0 / 3.0)


def gust_variance(speed: float, roughness: float) -> float:
    """Variance of the gust speed [m2/s2]: the integral of the spectrum, 6 k U0^2."""
    return 6.0 * roughness * speed**2


def davenport_coherence(n: np.ndarray, separation: np.ndarray, decay: np.ndarray, speed: float) -> np.ndarray:
    """Root coherence at frequencies n [Hz] of two points apart by `separation` (3,) [m].

    decay : (Cx, Cy, Cz), dimensionless; speed : mean speed of the two points [m/s]
    """
    return np.exp(-np.asarray(n) * np.sqrt(np.sum((np.asarray(decay) * separation) ** 2)) / speed)


def mean_speed(height: np.ndarray, speed: float, exponent: float) -> np.ndarray:
    """Mean speed [m/s] at heights above ground [m]: U0 (z / 10 m)^exponent."""
    return speed * (np.maximum(height, LOWEST_HEIGHT) / 10.0) ** exponent
