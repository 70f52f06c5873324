"""Sums that do not depend on the order of their terms, and so not on the number of ranks.

Each term is added without rounding to a fixed-point number wide enough for every double: limbs of 32 bits held
in 64-bit integers. Limbs of different ranks add up as integers, exactly; one rounding at the very end.
(A plain MPI sum rounds in an order that changes with the ranks.)
"""

import numba
import numpy as np
from mpi4py import MPI

LIMBS = 67  # 66 of 32 bits cover 2^-1074 to 2^1024; the last one counts what is not finite
LOWEST = 1074  # the first limb's unit is 2^-1074
MASK = np.int64(0xFFFFFFFF)


@numba.njit(cache=True, error_model="numpy")
def add_exactly(values, limbs):
    """Add the values (n,) to the fixed-point number in limbs (LIMBS,), exactly, for up to 2^30 values."""
    bits = values.view(np.int64)
    for i in range(bits.shape[0]):
        exponent = (bits[i] >> 52) & np.int64(0x7FF)
        mantissa = bits[i] & np.int64(0xFFFFFFFFFFFFF)
        if exponent == 0x7FF:
            limbs[LIMBS - 1] += 1
            continue
        if exponent == 0:
            exponent = np.int64(1)
        else:
            mantissa |= np.int64(0x10000000000000)
        shift = exponent - 1
        k, off = shift >> 5, shift & 31
        low, high = (mantissa & MASK) << off, (mantissa >> 32) << off
        low_carry = (low >> 32) & MASK
        sign = np.int64(1) if bits[i] >= 0 else np.int64(-1)
        limbs[k] += sign * (low & MASK)
        limbs[k + 1] += sign * (low_carry + (high & MASK))
        limbs[k + 2] += sign * (high >> 32)


def rounded(limbs: np.ndarray) -> float:
    """The double nearest to the fixed-point number, nan if a term was not finite."""
    if limbs[-1]:
        return float("nan")
    total = sum(int(limbs[k]) << (32 * k) for k in np.flatnonzero(limbs[:-1]).tolist())
    try:
        return total / (1 << LOWEST)
    except OverflowError:
        return float("inf") if total > 0 else float("-inf")


def exact_sums(comm: MPI.Comm, *terms: np.ndarray) -> list[float]:
    """Sums over all ranks of several arrays of terms, correctly rounded. Collective."""
    limbs = np.zeros((len(terms), LIMBS), np.int64)
    for row, values in zip(limbs, terms):
        add_exactly(np.ascontiguousarray(values, np.float64).ravel(), row)
    comm.Allreduce(MPI.IN_PLACE, limbs, MPI.SUM)
    return [rounded(row) for row in limbs]
