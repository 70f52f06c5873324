"""Sums over ranks are correctly rounded in any order."""

import itertools
import math

import numpy as np
from mpi4py import MPI

from netfall.parallel.sums import ALL, LIMBS, add_exactly, exact_sums, round_limbs


def test_sum_is_correctly_rounded():
    """Compared with math.fsum over all magnitudes and with cancellation."""
    rng = np.random.default_rng(1)
    for spread in (1, 30, 300):
        values = rng.standard_normal(2000) * 10.0 ** rng.uniform(-spread, min(spread, 290), 2000)
        values = np.concatenate([values, -values[:1500] * (1 + 1e-15)])
        assert exact_sums(MPI.COMM_SELF, values)[0] == math.fsum(values)


def test_ties_go_to_even():
    """Half of the last place, and the least more and less than it, of either sign."""
    for base, beyond, sign in itertools.product(
        (1.0, 1.0 + 2.0**-52, 2.0**-1020), (0.0, 2.0**-54, -(2.0**-54), 2.0**-60), (1.0, -1.0)
    ):
        values = sign * np.array(
            [
                base,
                base * 2.0**-53 * (1.0 if base < 0.5 else 1.0 / base),
                5e-324 if beyond else 0.0,
                base * beyond,
            ]
        )
        assert exact_sums(MPI.COMM_SELF, values)[0] == math.fsum(values)


def test_sum_does_not_depend_on_order_or_parts():
    """Shuffled, and in two parts as on two ranks."""
    rng = np.random.default_rng(2)
    values = rng.standard_normal(999) * 10.0 ** rng.uniform(-20, 20, 999)
    parts = np.zeros((2, LIMBS), np.int64)
    add_exactly(values[:400].copy(), ALL, parts[0])
    add_exactly(values[400:].copy(), ALL, parts[1])
    assert round_limbs(parts.sum(0)[None])[0] == exact_sums(MPI.COMM_SELF, rng.permutation(values))[0]


def test_special_values():
    """Zeros, subnormal numbers and the largest double are exact; inf and nan give nan."""
    for values in ([0.0, -0.0], [5e-324, 5e-324], [1.7976931348623157e308], [1e308, -1e308, 3.0]):
        assert exact_sums(MPI.COMM_SELF, np.array(values))[0] == math.fsum(values)
    assert math.isnan(exact_sums(MPI.COMM_SELF, np.array([1.0, np.inf]))[0])
    assert exact_sums(MPI.COMM_SELF, np.full(3, -1e308))[0] == -math.inf
    assert math.isnan(exact_sums(MPI.COMM_SELF, np.array([1.0, np.nan]))[0])
