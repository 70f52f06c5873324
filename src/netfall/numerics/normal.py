"""The normal distribution by sums, products and quotients alone, which give the same bits on any processor.

numpy and the C library choose their exponentials and logarithms by the processor; a fit that is iterated with
them would differ in its last digits from one machine to another.
"""

import numpy as np

from netfall.numerics.functions import exp, log

ONE_BY_ROOT_TWO_PI = 0.39894228040143267794
FAR = 7.07106781186547  # from here on a continued fraction is used
# Wichura's rational approximations (1988, AS 241, PPND16) of the quantile: in q = p - 1/2 up to 0.425, then
# in r = sqrt(-ln p) about 1.6 and about 5; numerators and denominators, from the highest power down.
CENTRE = (
    (2.5090809287301226727e3, 3.3430575583588128105e4, 6.7265770927008700853e4, 4.5921953931549871457e4)
    + (1.3731693765509461125e4, 1.9715909503065514427e3, 1.3314166789178437745e2, 3.3871328727963666080e0),
    (5.2264952788528545610e3, 2.8729085735721942674e4, 3.9307895800092710610e4, 2.1213794301586595867e4)
    + (5.3941960214247511077e3, 6.8718700749205790830e2, 4.2313330701600911252e1, 1.0),
)
MIDDLE = (
    (
        7.74545014278341407640e-4,
        2.27238449892691845833e-2,
        2.41780725177450611770e-1,
        1.27045825245236838258e0,
    )
    + (
        3.64784832476320460504e0,
        5.76949722146069140550e0,
        4.63033784615654529590e0,
        1.42343711074968357734e0,
    ),
    (
        1.05075007164441684324e-9,
        5.47593808499534494600e-4,
        1.51986665636164571966e-2,
        1.48103976427480074590e-1,
    )
    + (6.89767334985100004550e-1, 1.67638483018380384940e0, 2.05319162663775882187e0, 1.0),
)
FAR_OUT = (
    (
        2.01033439929228813265e-7,
        2.71155556874348757815e-5,
        1.24266094738807843860e-3,
        2.65321895265761230930e-2,
    )
    + (
        2.96560571828504891230e-1,
        1.78482653991729133580e0,
        5.46378491116411436990e0,
        6.65790464350110377720e0,
    ),
    (
        2.04426310338993978564e-15,
        1.42151175831644588870e-7,
        1.84631831751005468180e-5,
        7.86869131145613259100e-4,
    )
    + (1.48753612908506148525e-2, 1.36929880922735805310e-1, 5.99832206555887937690e-1, 1.0),
)
# Hart's rational approximation 5666 as West (2005) gives it: exp(-x^2/2) times this quotient is 1 - Phi(x).
ABOVE = (
    (3.52624965998911e-02, 0.700383064443688, 6.37396220353165, 33.912866078383)
    + (112.079291497871, 221.213596169931, 220.206867912376)
)  # fmt: skip
BELOW = (
    (8.83883476483184e-02, 1.75566716318264, 16.064177579207, 86.7807322029461, 296.564248779674)
    + (637.333633378831, 793.826512519948, 440.413735824752)
)  # fmt: skip


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


def quantile(p: np.ndarray) -> np.ndarray:
    """The x whose `cdf` is p, 0 < p < 1 (Wichura 1988)."""
    q = np.asarray(p, float) - 0.5
    r = np.sqrt(-log(np.where(q < 0.0, p, 1.0 - p)))
    out = np.where(r <= 5.0, _ratio(MIDDLE, r - 1.6), _ratio(FAR_OUT, r - 5.0))
    return np.where(np.abs(q) <= 0.425, q * _ratio(CENTRE, 0.180625 - q * q), np.where(q < 0.0, -out, out))


def _ratio(polynomials, x: np.ndarray) -> np.ndarray:
    above, below = np.zeros_like(x), np.zeros_like(x)
    for a, b in zip(*polynomials):
        above, below = above * x + a, below * x + b
    return above / below
