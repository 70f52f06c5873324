"""Quantiles of the standard normal distribution with the same bits on any processor.

Random strengths, errors of length and the random draws of studies use them; statistics of finished studies
use `scipy.special`. numpy and the C library choose their logarithms by the processor.
"""

import numpy as np

from netfall.core.functions import log

# Wichura's rational approximations (1988, AS 241, PPND16) of the quantile: in q = p - 1/2 up to 0.425, then
# in r = sqrt(-ln p) about 1.6 and about 5; numerators and denominators, from the highest power down.
COEFFICIENTS = """
2509.0809287301226727     33430.575583588128105     67265.770927008700853     45921.953931549871457
13731.693765509461125     1971.5909503065514427     133.14166789178437745     3.3871328727963666080
5226.4952788528545610     28729.085735721942674     39307.895800092710610     21213.794301586595867
5394.1960214247511077     687.18700749205790830     42.313330701600911252     1
7.74545014278341407640e-4 2.27238449892691845833e-2 0.241780725177450611770   1.27045825245236838258
3.64784832476320460504    5.76949722146069140550    4.63033784615654529590    1.42343711074968357734
1.05075007164441684324e-9 5.47593808499534494600e-4 1.51986665636164571966e-2 0.148103976427480074590
0.689767334985100004550   1.67638483018380384940    2.05319162663775882187    1
2.01033439929228813265e-7 2.71155556874348757815e-5 1.24266094738807843860e-3 2.65321895265761230930e-2
0.296560571828504891230   1.78482653991729133580    5.46378491116411436990    6.65790464350110377720
2.04426310338993978564e-15 1.42151175831644588870e-7 1.84631831751005468180e-5 7.86869131145613259100e-4
1.48753612908506148525e-2 0.136929880922735805310   0.599832206555887937690   1
"""
CENTRE, MIDDLE, FAR_OUT = np.array(COEFFICIENTS.split(), float).reshape(3, 2, 8)


def quantile(p: np.ndarray) -> np.ndarray:
    """Return the p-quantile of the standard normal distribution, 0 < p < 1 (Wichura 1988)."""
    q = np.asarray(p, float) - 0.5
    r = np.sqrt(-log(np.where(q < 0.0, p, 1.0 - p)))
    out = np.where(r <= 5.0, _ratio(MIDDLE, r - 1.6), _ratio(FAR_OUT, r - 5.0))
    return np.where(np.abs(q) <= 0.425, q * _ratio(CENTRE, 0.180625 - q * q), np.where(q < 0.0, -out, out))


def _ratio(polynomials: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the ratio of two polynomials at x."""
    numerator, denominator = np.zeros_like(x), np.zeros_like(x)
    for a, b in zip(*polynomials):
        numerator, denominator = numerator * x + a, denominator * x + b
    return numerator / denominator
