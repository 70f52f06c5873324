"""Gusts: spectra at one point, coherence between points; profile of the mean speed.

A spectrum is a shape F of x = n L / U0 whose integral over all x is 1:

    S(n) = sigma^2 L / U0 F(n L / U0),    sigma^2 = 6 k U0^2 = (I U0)^2

U0 and L refer to 10 m. The lengths L, unless `gust_length` gives another: Davenport 1200 m (paper Eq. 5);
Kaimal 8.1 x 0.7 x 10 m = 56.7 m (IEC 61400-1:2005: 8.1 times 0.7 times the height, up to 60 m); von Karman
and EN 1991-1-4 63.2 m = 300 m (10 / 200)^0.52 (its annex B.1 with z0 = 0.05 m, terrain II). At 40 m these
formulas give 227 m and 130 m; Davenport's length does not depend on height.

Coherence: exp(-n sqrt(Cx^2 dx^2 + Cy^2 dy^2 + Cz^2 dz^2) / U), Davenport 1968, x along the wind.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray
from netfall.core.functions import cos, cube_root, exp, geometric, integral, lengths, log, power, sin

KARMAN_CONSTANT = 70.78013  # 4 B(1/2, 1/3)^2, usually rounded to 70.8: with it the integral is 1
TAIL_START = 1e4  # x above which every shape is proportional to x^(-5/3)


def five_thirds(a: np.ndarray) -> np.ndarray:
    """Compute a^(5/3) of a > 0."""
    root = cube_root(a)
    return a * root * root


def davenport(x: np.ndarray) -> np.ndarray:
    """Compute 2/3 x / (1 + x^2)^(4/3).

    S = 4 k U0^2 x^2 / (n (1 + x^2)^(4/3)), Davenport 1961, paper Eq. 5.
    """
    square = 1.0 + x * x
    return (2.0 / 3.0) * x / (square * cube_root(square))


def kaimal(x: np.ndarray) -> np.ndarray:
    """Compute 4 / (1 + 6 x)^(5/3): Kaimal et al. 1972 in the form of IEC 61400-1, n S / sigma^2 = x F."""
    return 4.0 / five_thirds(1.0 + 6.0 * x)


def von_karman(x: np.ndarray) -> np.ndarray:
    """Compute 4 / (1 + 70.8 x^2)^(5/6): von Karman 1948, n S / sigma^2 = x F; L is the integral length."""
    return 4.0 / np.sqrt(five_thirds(1.0 + KARMAN_CONSTANT * x * x))


def en1991(x: np.ndarray) -> np.ndarray:
    """Compute 6.8 / (1 + 10.2 x)^(5/3): EN 1991-1-4:2005, Eq. B.2, with x = f_L, S_L = x F."""
    return 6.8 / five_thirds(1.0 + 10.2 * x)


@dataclass(frozen=True)
class SpectrumShape:
    """Spectrum: density F; default length L [m] at 10 m; memory of the gusts in the AR model, in L.

    growth : exponent of the height with which L grows up to the height `highest` [m]
    """

    density: Callable[..., Any]
    length: float
    memory: float
    growth: float = 0.0
    highest: float = np.inf

    def length_at(self, height: float) -> float:
        """Return the length L [m] at a height [m]."""
        return self.length * (min(height, self.highest) / 10.0) ** self.growth


SHAPES = {
    "davenport": SpectrumShape(davenport, 1200.0, 1.5),
    "kaimal": SpectrumShape(kaimal, 56.7, 8.0, 1.0, 60.0),
    "von_karman": SpectrumShape(von_karman, 63.2, 6.0, 0.52, 200.0),
    "en1991": SpectrumShape(en1991, 63.2, 13.6, 0.52, 200.0),
}


@dataclass(frozen=True)
class Gust:
    """Gusts at one point. speed : U0 [m/s]; deviation : sigma [m/s]; length : L [m]; memory : [m]"""

    density: Callable[..., Any]
    speed: float
    deviation: float
    length: float
    memory: float

    def spectrum(self, n: np.ndarray) -> np.ndarray:
        """Compute the one-sided spectrum [m2/s2/Hz] at frequencies n [Hz]."""
        scale = self.length / self.speed
        return self.deviation * self.deviation * scale * self.density(np.asarray(n, float) * scale)

    def share_above(self, n: float) -> float:
        """Compute the share of the variance at frequencies above n [Hz]."""
        x = n * self.length / self.speed
        if x >= TAIL_START:
            return float(1.5 * x * self.density(x))
        nodes = geometric(x, TAIL_START, 4000)
        return float(
            integral(nodes * self.density(nodes), log(nodes)) + 1.5 * TAIL_START * self.density(TAIL_START)
        )


def turbulence_intensity(settings: Any) -> float:
    """Return the turbulence intensity I at 10 m of a [wind]: sqrt(6 k), or as given."""
    if settings.turbulence_intensity is not None:
        return settings.turbulence_intensity
    return float(np.sqrt(6.0 * settings.surface_drag))


def make_gust(settings: Any) -> Gust | None:
    """Return the gusts of a [wind]; None without gusts, or with gusts from a table."""
    if settings.speed is None or settings.pressures or turbulence_intensity(settings) == 0.0:
        return None
    shape = SHAPES[settings.spectrum]
    length = shape.length if settings.gust_length == "auto" else settings.gust_length
    deviation = turbulence_intensity(settings) * settings.speed
    return Gust(shape.density, settings.speed, deviation, length, shape.memory * length)


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
