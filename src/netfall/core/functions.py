"""Elementary functions from sums, products, quotients and roots, with the same bits on any processor.

The exponentials, logarithms, sines and powers of numpy and the C library depend on the processor in their
last digits. That is enough to change a collapse. Everything that affects a result uses these functions, for
arrays and numbers alike; kernels use `arithmetic`. Errors, in units of the last place:
tests/test_functions.py.

Sums are short enough to be added in order, and no product is fused with a sum.
"""

import math

import numpy as np

# Constants in parts: the first have so few digits that their products with small integers are exact (Cody and
# Waite 1980).
LN2_HIGH, LN2_LOW = float.fromhex("0x1.62e42fefa3800p-1"), float.fromhex("0x1.ef35793c76730p-45")
QUARTER_TURN_PARTS = tuple(
    float.fromhex(part) for part in ("0x1.921fb544p+0", "0x1.0b4611a6p-34", "0x1.3198a2e037073p-69")
)
LARGEST_ANGLE = 1e6  # [rad] up to which sine and cosine have an absolute error of 1e-16
SQRT_HALF = float.fromhex("0x1.6a09e667f3bcdp-1")
TERMS = 14  # of a series; the remainder is below the last digit
SUM_BLOCK = 8192  # length up to which every numpy version adds in the same order


def exp(x: np.ndarray | float) -> np.ndarray:
    """Compute e to the power of x."""
    x = np.clip(x, -745.0, 709.7)
    power = np.rint(x * (1.0 / math.log(2.0)))
    remainder = (x - power * LN2_HIGH) - power * LN2_LOW
    series = np.full_like(remainder, 1.0 / math.factorial(TERMS))
    for k in range(TERMS - 1, 1, -1):
        series = 1.0 / math.factorial(k) + remainder * series
    series = 1.0 + (remainder + remainder * remainder * series)
    half = np.rint(0.5 * power)  # in two halves, since the power of two may be subnormal
    return np.ldexp(np.ldexp(series, half.astype(np.int32)), (power - half).astype(np.int32))


def log(x: np.ndarray | float) -> np.ndarray:
    """Compute the natural logarithm of x > 0; minus infinity for 0, nan below."""
    x = np.asarray(x, float)
    share, power = np.frexp(x)
    small = share < SQRT_HALF
    share, power = np.where(small, 2.0 * share, share), power - small
    f = share - 1.0
    s = f / (2.0 + f)
    square, series = s * s, np.zeros_like(s)
    for k in range(TERMS - 2, 0, -1):
        series = (series + 1.0 / (2 * k + 1)) * square
    # ln share = 2 artanh s = f - s (f - 2 series): its first term is exact
    result = power * LN2_HIGH + (f - (s * (f - 2.0 * series) - power * LN2_LOW))
    return np.where(x > 0.0, result, np.where(x == 0.0, -np.inf, np.nan))


def log1p(x: np.ndarray | float) -> np.ndarray:
    """Compute the natural logarithm of 1 + x for x > -1, accurate also for small x."""
    shifted = 1.0 + np.asarray(x, float)
    rounded_x = shifted - 1.0
    is_tiny = rounded_x == 0.0
    return np.where(is_tiny, x, log(shifted) * (x / np.where(is_tiny, 1.0, rounded_x)))


def _reduce_angles(x: np.ndarray | float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Reduce angles by whole quarter turns.

    Return sine and cosine of the remainder, and the number of quarters modulo 4.
    """
    x = np.asarray(x, float)
    number = np.rint(x * (2.0 / math.pi))
    remainder = x
    for part in QUARTER_TURN_PARTS:
        remainder = remainder - number * part
    square = remainder * remainder
    sine, cosine = np.zeros_like(remainder), np.zeros_like(remainder)
    for k in range(TERMS // 2 + 1, 0, -1):
        sine = square * ((-1) ** k / math.factorial(2 * k + 1) + sine)
        cosine = square * ((-1) ** k / math.factorial(2 * k) + cosine)
    return remainder + remainder * sine, 1.0 + cosine, number.astype(np.int64) % 4


def sin(x: np.ndarray | float) -> np.ndarray:
    """Compute the sine of angles x up to `LARGEST_ANGLE`."""
    s, c, quarter = _reduce_angles(x)
    return np.choose(quarter, [s, c, -s, -c])


def cos(x: np.ndarray | float) -> np.ndarray:
    """Compute the cosine of angles x up to `LARGEST_ANGLE`."""
    s, c, quarter = _reduce_angles(x)
    return np.choose(quarter, [c, -s, -c, s])


def power(x: np.ndarray | float, exponent: float) -> np.ndarray:
    """Compute x^exponent for x > 0; the error is 1 + |exponent ln x| units in the last place."""
    return exp(exponent * log(x))


def cube_root(x: np.ndarray | float) -> np.ndarray:
    """Compute the cube root of x > 0."""
    root = power(x, 1.0 / 3.0)
    return root - (root * root * root - x) / (3.0 * root * root)  # one step of Newton's method


def geometric(low: float, high: float, count: int) -> np.ndarray:
    """Return numbers (count,) in geometric progression from low to high."""
    between = exp(np.linspace(0.0, 1.0, count) * log(high / low)) * low
    between[0] = low
    if count > 1:
        between[-1] = high
    return between


def lengths(rows: np.ndarray) -> np.ndarray:
    """Compute the lengths (n,) of rows (n, 2) or (n, 3)."""
    squares = rows * rows
    total = squares[..., 0] + squares[..., 1]
    return np.sqrt(total if rows.shape[-1] == 2 else total + squares[..., 2])


def total(x: np.ndarray) -> float:
    """Compute the sum of numbers (n,) in the order of numpy 2.3 and later."""
    if len(x) <= SUM_BLOCK:
        return x.sum()
    half = len(x) // 2
    half -= half % 8
    return total(x[:half]) + total(x[half:])


def integral(y: np.ndarray, x: np.ndarray) -> float:
    """Compute the integral of y (n,) over x (n,) by the trapezoidal rule."""
    return total(np.diff(x) * (y[1:] + y[:-1]) / 2.0)
