"""Sums that do not depend on the order of their terms, and therefore not on the number of ranks.

Each term is added without rounding to a fixed-point number wide enough for every double: limbs of 32 bits in
64-bit integers. Limbs of different ranks are added exactly, as integers. Only the final sum is rounded. (A
plain MPI sum rounds in an order that changes with the ranks.)
"""

import math

import numpy as np

from netfall.core.arrays import FloatArray, IntArray, Integer
from netfall.core.kernels import copied_kernel, inner_kernel, kernel, part_of_kernel
from netfall.core.vectors import bits_of, number_of
from netfall.parallel.mpi import MPI

LIMBS = 67  # 66 of 32 bits cover 2^-1074 to 2^1024; the last one counts nonfinite terms
LOWEST = 1074  # the first limb's unit is 2^-1074
UNITS = 2**LOWEST  # number of such units in 1
ALL = np.zeros(0, np.uint8)
MASK = np.int64(0xFFFFFFFF)
SIZE = np.int64(0x7FFFFFFFFFFFFFFF)  # all bits of a number but the sign
SUM_BLOCK = 2048  # values per block; the sum of their multiples of a unit is below 2^62
# biased exponents of a block's largest value between which `cut_in_three` works
MIN_EXPONENT, MAX_EXPONENT = 103, 2044


@inner_kernel
def pieces_of(value: float) -> tuple[Integer, Integer, Integer, Integer]:
    """Return the number of a limb, and the integers that a value adds to this limb and the next two."""
    bits = bits_of(value)
    exponent = (bits >> 52) & np.int64(0x7FF)
    mantissa = bits & np.int64(0xFFFFFFFFFFFFF)
    if exponent == 0x7FF:
        return np.int64(LIMBS - 3), np.int64(0), np.int64(0), np.int64(1)
    if exponent == 0:
        exponent = np.int64(1)
    else:
        mantissa |= np.int64(0x10000000000000)
    shift = exponent - 1
    k, bit_offset = shift >> 5, shift & 31
    low, high = (mantissa & MASK) << bit_offset, (mantissa >> 32) << bit_offset
    low_carry = (low >> 32) & MASK
    sign = np.int64(1) if bits >= 0 else np.int64(-1)
    return k, sign * (low & MASK), sign * (low_carry + (high & MASK)), sign * (high >> 32)


@inner_kernel
def add_term(value: float, limbs: IntArray) -> None:
    """Add a value exactly to the fixed-point number in limbs (LIMBS,); for up to 2^30 values."""
    k, low, middle, high = pieces_of(value)
    limbs[k] += low
    limbs[k + 1] += middle
    limbs[k + 2] += high


@inner_kernel
def add_multiple(count: int, position: int, limbs: IntArray) -> None:
    """Add count 2^(position - LOWEST), |count| < 2^62, to the fixed-point number in limbs."""
    sign = np.int64(1) if count >= 0 else np.int64(-1)
    size, k, bit_offset = sign * count, position >> 5, position & 31
    low, high = (size & MASK) << bit_offset, (size >> 32) << bit_offset
    limbs[k] += sign * (low & MASK)
    limbs[k + 1] += sign * ((low >> 32) + (high & MASK))
    limbs[k + 2] += sign * (high >> 32)


@inner_kernel
def largest_bits(first: int, last: int, values: FloatArray, mask: IntArray) -> Integer:
    """Return the largest magnitude of values first to last, as bits; mask : as in `add_exactly`"""
    top, unmasked = np.int64(0), mask.shape[0] == 0
    for i in range(np.uint64(first), np.uint64(last)):
        bits = bits_of(values[i]) & SIZE
        top = max(top, bits if unmasked or mask[i] else np.int64(0))
    return top


@part_of_kernel
def unit_number(exponent: int) -> float:
    """Return 1.5 times the power of two with this biased exponent."""
    return number_of((exponent << 52) | np.int64(0x8000000000000))


@copied_kernel
def cut_in_three(
    first: int, last: int, values: FloatArray, mask: IntArray, large: tuple[float, float, float]
) -> tuple[Integer, Integer, Integer, bool]:
    """Sum values first to last in units of three large numbers; return the sums, and whether bits remain.

    (x + large) - large is x rounded to a multiple of the unit of `large` (its last bit), and the remainder is
    exact (Rump, Ogita, Oishi 2008). In the bits of x + large that multiple is an integer.
    """
    a, b, c = np.int64(0), np.int64(0), np.int64(0)
    leftover, unmasked = np.int64(0), mask.shape[0] == 0
    one, two, three = large
    for i in range(np.uint64(first), np.uint64(last)):
        x = values[i] if unmasked or mask[i] else 0.0
        y = x + one
        a += bits_of(y) - bits_of(one)
        x -= y - one
        y = x + two
        b += bits_of(y) - bits_of(two)
        x -= y - two
        y = x + three
        c += bits_of(y) - bits_of(three)
        leftover |= bits_of(x - (y - three))
    return a, b, c, leftover != 0


@kernel
def add_exactly(values: FloatArray, mask: IntArray, limbs: IntArray) -> None:
    """Add the values (n,) with nonzero mask (n,) to the fixed-point number in limbs; mask `ALL`: all values.

    Vectorised code splits the values of a block into three pieces of 52 bits below the largest value, whose
    sums are integers. Blocks with more bits, or outside the exponent range, are added one by one.
    """
    for first in range(0, values.shape[0], SUM_BLOCK):
        last = min(first + SUM_BLOCK, values.shape[0])
        top = largest_bits(first, last, values, mask)
        if top == 0:
            continue
        exponent, has_more = top >> 52, True
        if MIN_EXPONENT <= exponent and exponent <= MAX_EXPONENT:
            large = unit_number(exponent + 2), unit_number(exponent - 50), unit_number(exponent - 102)
            a, b, c, has_more = cut_in_three(first, last, values, mask, large)
        if has_more:
            add_terms(first, last, values, mask, limbs)
        else:
            add_multiple(a, exponent + 1, limbs)
            add_multiple(b, exponent - 51, limbs)
            add_multiple(c, exponent - 103, limbs)


@copied_kernel
def add_terms(first: int, last: int, values: FloatArray, mask: IntArray, limbs: IntArray) -> None:
    """Add values first to last one by one; mask : as in `add_exactly`"""
    for i in range(first, last):
        if mask.shape[0] == 0 or mask[i]:
            add_term(values[i], limbs)


def round_limbs(limbs: IntArray) -> np.ndarray:
    """Return the doubles (k,) nearest to fixed-point numbers (k, LIMBS), nan if a term was nonfinite."""
    totals = [0] * len(limbs)
    rows, places = limbs.nonzero()
    for row, place, limb in zip(rows.tolist(), places.tolist(), limbs[rows, places].tolist()):
        totals[row] += limb << 32 * place
    return np.where(limbs[:, LIMBS - 1] != 0, math.nan, [_rounded(total) for total in totals])


def _rounded(total: int) -> float:
    """Return the double nearest to a number of units of the first limb."""
    try:
        return total / UNITS  # Python rounds the quotient of integers to the nearest double
    except OverflowError:
        return math.inf if total > 0 else -math.inf


def exact_sums(comm: MPI.Comm, *terms: np.ndarray) -> list[float]:
    """Return correctly rounded sums over all ranks of several arrays of terms. Collective."""
    limbs = np.zeros((len(terms), LIMBS), np.int64)
    for values, sum_limbs in zip(terms, limbs):
        add_exactly(np.ascontiguousarray(values, np.float64).ravel(), ALL, sum_limbs)
    return round_over_ranks(comm, limbs).tolist()


def round_over_ranks(comm: MPI.Comm, limbs: np.ndarray) -> np.ndarray:
    """Return sums (k,) over all ranks of limbs (k, LIMBS), which then hold the total. Collective."""
    comm.Allreduce(MPI.IN_PLACE, limbs, MPI.SUM)
    return round_limbs(limbs)
