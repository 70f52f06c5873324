"""Logarithm, exponential and angle, for vectors or single numbers.

The logarithm of the C library takes one number at a time, and its bits depend on the machine. Errors in units
of the last place (tests/test_arithmetic.py): two of this logarithm, five of the angle.
"""

import math

import numpy as np

from netfall.core.arrays import Lanes
from netfall.core.functions import LN2_HIGH, LN2_LOW, SQRT_HALF
from netfall.core.kernels import part_of_kernel
from netfall.core.vectors import as_number, bits_of, fma, number_of

INVERSE_LN2 = 1.0 / (LN2_HIGH + LN2_LOW)
MIN_SINE_NEAR_PI = 1e-6  # lower bound of sin psi near pi; psi / sin psi is constant below it


fused = fma


@part_of_kernel
def logarithm(a: Lanes) -> Lanes:
    """Compute the natural logarithm of a finite a >= 1e-300.

    a = 2^k m with m from sqrt(1/2) to sqrt(2); ln m = 2 artanh s, s = (m - 1) / (m + 1) < 0.172. The series
    is cut after s^21, with an error of 1e-18.
    """
    bits = bits_of(a)
    k = (bits - bits_of(SQRT_HALF)) >> 52
    m = number_of(bits - (k << 52))
    exponent, f = as_number(k), m - 1.0
    s = f / (2.0 + f)
    z = s * s
    series = fused(1.0 / 21.0, z, 1.0 / 19.0)
    for n in range(8, 0, -1):
        series = fused(series, z, 1.0 / (2 * n + 1))
    # ln m = f - f^2/2 + ..., written as f - s (f - 2 z series): its first term is exact
    return fused(exponent, LN2_HIGH, f - fused(s, fused(-2.0 * z, series, f), -exponent * LN2_LOW))


@part_of_kernel
def _series(x: float) -> float:
    """Return (e^x - 1 - x) / x^2 for |x| < 0.35, cut after x^12 / 14!, with an error of 1e-17."""
    total = 1.0
    for k in range(14, 2, -1):
        total = fused(total, x / k, 1.0)
    return 0.5 * total


@part_of_kernel
def exponential(a: float) -> float:
    """Compute e to the power of a, |a| < 700."""
    k = math.floor(a * INVERSE_LN2 + 0.5)
    remainder = fused(-k, LN2_LOW, fused(-k, LN2_HIGH, a))
    mantissa = 1.0 + fused(remainder * remainder, _series(remainder), remainder)
    return mantissa * number_of((np.int64(k) + 1023) << 52)


@part_of_kernel
def exponential_minus_one(a: float) -> float:
    """Compute e^a - 1, |a| < 700, with full relative accuracy for small a."""
    if abs(a) < 0.35:
        return fused(a * a, _series(a), a)
    return exponential(a) - 1.0


@part_of_kernel
def exponential_minus_linear(a: float) -> float:
    """Compute e^a - 1 - a, |a| < 700, with full relative accuracy for small a."""
    if abs(a) < 0.35:
        return a * a * _series(a)
    return exponential(a) - 1.0 - a


@part_of_kernel
def angle_per_sine(S: float, C: float) -> float:
    """Compute psi / S for the angle psi from 0 to pi with tan psi = S / C, S >= 0; 1 / C at S = 0 < C.

    The angle is bisected until its tangent v is at most tan(pi / 16). The series of the arc tangent is cut
    after v^21, with an error of 2e-17.
    """
    H = math.sqrt(S * S + C * C)
    half = H + abs(C)  # S / half = tan(psi / 2); if psi exceeds a right angle, tan((pi - psi) / 2)
    t = S / half
    fourth = 1.0 + math.sqrt(1.0 + t * t)
    u = t / fourth
    eighth = 1.0 + math.sqrt(1.0 + u * u)
    v = u / eighth
    z = -v * v
    series = 1.0 / 21.0
    for n in range(9, -1, -1):
        series = fused(series, z, 1.0 / (2 * n + 1))
    ratio = 8.0 * series / (half * fourth * eighth)
    return ratio if C >= 0.0 else (math.pi - ratio * S) / max(S, MIN_SINE_NEAR_PI * H)
