"""The normal distribution by sums, products and quotients alone, which give the same bits on any processor.

numpy and the C library choose their exponentials and logarithms by the processor; a fit that is iterated with
them would differ in its last digits from one machine to another.
"""

import numpy as np

# ln 2 as a sum of two: the first has so few digits that its multiples are exact (Cody and Waite 1980).
LN2_HIGH, LN2_LOW = 0.693147180369123816490, 1.90821492927058770002e-10
SQRT_HALF = 0.70710678118654752440
ONE_BY_ROOT_TWO_PI = 0.39894228040143267794
TERMS = 14  # of the two series: what follows is below the last digit
FAR = 7.07106781186547  # from here on a continued fraction is used
# Hart's rational approximation 5666 as West (2005) gives it: exp(-x^2/2) times this quotient is 1 - Phi(x).
ABOVE = (
    (3.52624965998911e-02, 0.700383064443688, 6.37396220353165, 33.912866078383)
    + (112.079291497871, 221.213596169931, 220.206867912376)
)  # fmt: skip
BELOW = (
    (8.83883476483184e-02, 1.75566716318264, 16.064177579207, 86.7807322029461, 296.564248779674)
    + (637.333633378831, 793.826512519948, 440.413735824752)
)  # fmt: skip


def exp(x: np.ndarray) -> np.ndarray:
    """e to the power of x."""
    x = np.clip(x, -745.0, 709.0)
    power = np.rint(x * 1.4426950408889634)
    rest = (x - power * LN2_HIGH) - power * LN2_LOW
    total = np.ones_like(rest)
    for k in range(TERMS, 0, -1):
        total = 1.0 + rest * total / k
    return np.ldexp(total, power.astype(np.int32))


def log(x: np.ndarray) -> np.ndarray:
    """The natural logarithm of x > 0."""
    share, power = np.frexp(np.asarray(x, float))
    small = share < SQRT_HALF
    share, power = np.where(small, 2.0 * share, share), power - small
    s = (share - 1.0) / (share + 1.0)
    square, total = s * s, np.zeros_like(s)
    for k in range(TERMS, -1, -1):
        total = 1.0 / (2 * k + 1) + square * total
    return power * LN2_HIGH + (power * LN2_LOW + 2.0 * s * total)


def tail_ratio(x: np.ndarray) -> np.ndarray:
    """(1 - Phi(x)) / exp(-x^2 / 2) for x >= 0 (West 2005)."""
    above, below = np.full_like(x, ABOVE[0]), np.full_like(x, BELOW[0])
    for c in ABOVE[1:]:
        above = above * x + c
    for c in BELOW[1:]:
        below = below * x + c
    far = x + 0.65
    for k in (4.0, 3.0, 2.0, 1.0):
        far = x + k / far
    return np.where(x < FAR, above / below, ONE_BY_ROOT_TWO_PI / far)


def cdf(x: np.ndarray) -> np.ndarray:
    """Phi(x): the share of a standard normal distribution below x; infinite x too."""
    side = np.minimum(np.abs(x), 40.0)
    tail = exp(-0.5 * side * side) * tail_ratio(side)
    return np.where(x > 0, 1.0 - tail, tail)


def inverse_mills(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """phi(x) / Phi(x) and phi(x) / (1 - Phi(x)), also where these are too small to be numbers."""
    side = np.abs(x)
    tail = tail_ratio(side)
    peak = exp(-0.5 * np.minimum(side, 40.0) ** 2)
    toward = ONE_BY_ROOT_TWO_PI / tail
    away = ONE_BY_ROOT_TWO_PI * peak / (1.0 - np.minimum(peak * tail, 0.5))
    return np.where(x > 0, away, toward), np.where(x > 0, toward, away)
