"""Elementary functions, normal quantiles and rotated axes, with the same bits on any processor.

The exponentials, logarithms, sines and powers of numpy and the C library depend on the processor in their
last digits. That is enough to change a collapse. Everything that affects a result uses these functions, for
arrays and numbers alike; kernels use `arithmetic`. Only statistics of finished studies use `scipy.special`.
Errors, in units of the last place: tests/test_functions.py.

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
SUM_BLOCK = 8192  # number of terms up to which every numpy version adds in the same order


def exp(x: np.ndarray | float) -> np.ndarray:
    """Compute e^x."""
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
    """Return sine and cosine of angles less whole quarter turns, and the number of these turns modulo 4."""
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


# Wichura's rational approximations (1988, AS 241, PPND16) of the quantile: in q = p - 1/2 up to 0.425, then
# in r = sqrt(-ln p) near 1.6 and near 5; numerators and denominators, from the highest power down.
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


MAX_HORIZONTAL_PART = 1e-9  # horizontal part of a unit normal below which it counts as vertical


def directions(angle: np.ndarray) -> np.ndarray:
    """Return unit vectors (n, 2) in plan at angles (n,) [degrees] from x towards y."""
    radians = np.fmod(angle, 360.0) * (np.pi / 180.0)
    return np.column_stack([cos(radians), sin(radians)])


def to_rotated_axes(rows: np.ndarray, angle: np.ndarray | None) -> np.ndarray:
    """Transform vectors (n, 3) from x, y, z to axes rotated by angles (n,) [degrees]; None: no change."""
    return rows if angle is None else _rotated(rows, angle, 1.0)


def from_rotated_axes(rows: np.ndarray, angle: np.ndarray | None) -> np.ndarray:
    """Transform vectors (n, 3) from axes rotated by angles (n,) [degrees] to x, y, z; None: no change."""
    return rows if angle is None else _rotated(rows, angle, -1.0)


def _rotated(rows: np.ndarray, angle: np.ndarray, sign: float) -> np.ndarray:
    """Rotate the vectors with a nonzero angle; the others keep their bits."""
    rotated, index = rows.copy(), np.flatnonzero(angle != 0.0)
    c, s = directions(angle[index]).T
    x, y = rows[index, 0], rows[index, 1]
    rotated[index, 0], rotated[index, 1] = c * x + sign * s * y, c * y - sign * s * x
    return rotated


def surface_axes(normal: list[float] | None) -> np.ndarray | None:
    """Return unit vectors (3, 3) along a surface, up in it, and outward; None: the plan, with x, y and z.

    Seen from outside, the first is horizontal to the right. normal : (3,), outward, of any length
    """
    if normal is None:
        return None
    outward = np.array(normal, float) / lengths(np.array([normal], float))[0]
    up = np.array([0.0, 0.0, 1.0]) - outward[2] * outward
    size = lengths(up[None])[0]
    up = up / size if size > MAX_HORIZONTAL_PART else np.array([0.0, 1.0, 0.0])
    return np.stack([np.cross(up, outward), up, outward])


def along_axes(points: np.ndarray, axes: np.ndarray | None) -> np.ndarray:
    """Return the coordinates (..., 3) of points (..., 3) along axes (3, 3); None: in x, y and z."""
    if axes is None:
        return points
    return np.stack([np.sum(points * axis, axis=-1) for axis in axes], -1)
