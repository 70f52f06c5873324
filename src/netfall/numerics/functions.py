"""Elementary functions by sums, products, quotients and roots, which give the same bits on any processor.

numpy and the C library choose their exponentials, logarithms, sines and powers by the processor, and these
differ in their last digits: enough for another collapse. What reaches a result takes these, which are for
arrays and numbers alike; kernels have theirs in `arithmetic`. Errors, in units of the last place:
tests/test_functions.py.

Sums are short enough to be added in order, and no product is rounded together with a sum.
"""

import math

import numpy as np

# Constants in parts: the first have so few digits that their multiples by small integers are exact (Cody and
# Waite 1980).
LN2_HIGH, LN2_LOW = float.fromhex("0x1.62e42fefa3800p-1"), float.fromhex("0x1.ef35793c76730p-45")
QUARTER = tuple(
    float.fromhex(part) for part in ("0x1.921fb544p+0", "0x1.0b4611a6p-34", "0x1.3198a2e037073p-69")
)
LARGEST_ANGLE = 1e6  # for which sine and cosine are right to an absolute 1e-16
SQRT_HALF = float.fromhex("0x1.6a09e667f3bcdp-1")
TERMS = 14  # of a series: what follows is below the last digit
PIECE = 8192  # numbers that any numpy adds in the same order


def exp(x: np.ndarray) -> np.ndarray:
    """e to the power of x."""
    x = np.clip(x, -745.0, 709.7)
    power = np.rint(x * (1.0 / math.log(2.0)))
    rest = (x - power * LN2_HIGH) - power * LN2_LOW
    total = np.full_like(rest, 1.0 / math.factorial(TERMS))
    for k in range(TERMS - 1, 1, -1):
        total = 1.0 / math.factorial(k) + rest * total
    total = 1.0 + (rest + rest * rest * total)
    half = np.rint(0.5 * power)  # twice, for the result may be smaller than the smallest power of two
    return np.ldexp(np.ldexp(total, half.astype(np.int32)), (power - half).astype(np.int32))


def log(x: np.ndarray) -> np.ndarray:
    """The natural logarithm of x > 0; of 0 minus infinity, of what is less no number."""
    x = np.asarray(x, float)
    share, power = np.frexp(x)
    small = share < SQRT_HALF
    share, power = np.where(small, 2.0 * share, share), power - small
    f = share - 1.0
    s = f / (2.0 + f)
    square, total = s * s, np.zeros_like(s)
    for k in range(TERMS - 2, 0, -1):
        total = (total + 1.0 / (2 * k + 1)) * square
    # ln share = 2 artanh s = f - s (f - 2 total): its first term is exact
    found = power * LN2_HIGH + (f - (s * (f - 2.0 * total) - power * LN2_LOW))
    return np.where(x > 0.0, found, np.where(x == 0.0, -np.inf, np.nan))


def log1p(x: np.ndarray) -> np.ndarray:
    """The natural logarithm of 1 + x, for x > -1, also where x is small."""
    whole = 1.0 + np.asarray(x, float)
    taken = whole - 1.0
    near = taken == 0.0
    return np.where(near, x, log(whole) * (x / np.where(near, 1.0, taken)))


def _quarters(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sine and cosine of what is left of angles after whole quarters of a turn, and the number of these."""
    x = np.asarray(x, float)
    number = np.rint(x * (2.0 / math.pi))
    rest = x
    for part in QUARTER:
        rest = rest - number * part
    square = rest * rest
    sine, cosine = np.zeros_like(rest), np.zeros_like(rest)
    for k in range(TERMS // 2 + 1, 0, -1):
        sine = square * ((-1) ** k / math.factorial(2 * k + 1) + sine)
        cosine = square * ((-1) ** k / math.factorial(2 * k) + cosine)
    return rest + rest * sine, 1.0 + cosine, number.astype(np.int64) % 4


def sin(x: np.ndarray) -> np.ndarray:
    """The sine of angles x up to `LARGEST_ANGLE`."""
    s, c, quarter = _quarters(x)
    return np.choose(quarter, [s, c, -s, -c])


def cos(x: np.ndarray) -> np.ndarray:
    """The cosine of angles x up to `LARGEST_ANGLE`."""
    s, c, quarter = _quarters(x)
    return np.choose(quarter, [c, -s, -c, s])


def power(x: np.ndarray, exponent: float) -> np.ndarray:
    """x > 0 to the power of an exponent: right to 1 + |exponent ln x| units of the last place."""
    return exp(exponent * log(x))


def cube_root(x: np.ndarray) -> np.ndarray:
    """The cube root of x > 0."""
    root = power(x, 1.0 / 3.0)
    return root - (root * root * root - x) / (3.0 * root * root)  # one step of Newton's method


def geometric(low: float, high: float, count: int) -> np.ndarray:
    """Numbers (count,) from low to high, each in the same proportion to the one before."""
    between = exp(np.linspace(0.0, 1.0, count) * log(high / low)) * low
    between[0] = low
    if count > 1:
        between[-1] = high
    return between


def lengths(rows: np.ndarray) -> np.ndarray:
    """Lengths (n,) of rows (n, 2) or (n, 3)."""
    squares = rows * rows
    total = squares[..., 0] + squares[..., 1]
    return np.sqrt(total if rows.shape[-1] == 2 else total + squares[..., 2])


def total(x: np.ndarray) -> float:
    """The sum of numbers (n,), in the order in which numpy adds them from its version 2.3 on."""
    if len(x) <= PIECE:
        return x.sum()
    half = len(x) // 2
    half -= half % 8
    return total(x[:half]) + total(x[half:])


def integral(y: np.ndarray, x: np.ndarray) -> float:
    """The integral of y (n,) over x (n,) by the trapezoidal rule."""
    return total(np.diff(x) * (y[1:] + y[:-1]) / 2.0)
