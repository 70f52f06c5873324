"""Length, inverse length and logarithm compared with exact ones, in units of the last place."""

from decimal import Decimal, localcontext

import numpy as np
import pytest

from netfall.core.arithmetic import logarithm
from netfall.core.kernels import kernel
from netfall.core.vectors import LANES, load, store_below
from netfall.physics.element_step import inverse_length


@kernel
def in_vectors(x, z, numbers, inverses, lengths, logarithms):
    for p in range(0, numbers.shape[0], LANES):
        high, dx, dz = numbers.shape[0], load(x, 0, p), load(z, 0, p)
        inverse, length = inverse_length(dx, dz - dz, dz)
        store_below(p, high, inverses, 0, inverse)
        store_below(p, high, lengths, 0, length)
        store_below(p, high, logarithms, 0, logarithm(load(numbers, 0, p)))


@kernel
def one_by_one(x, z, numbers, inverses, lengths, logarithms):
    for i in range(numbers.shape[0]):
        inverses[i], lengths[i] = inverse_length(x[i], z[i] - z[i], z[i])
        logarithms[i] = logarithm(numbers[i])


def exact(function) -> Decimal:
    """Return the value of a function to forty digits."""
    with localcontext() as context:
        context.prec = 40
        return function()


def is_near(computed: float, expected: Decimal) -> bool:
    return abs(Decimal(computed) - expected) <= Decimal(2 * np.spacing(abs(computed)))


@pytest.mark.parametrize("low, high", [(-290, 290), (-3, 3), (-1e-3, 1e-3)])
def test_within_two_units_of_the_last_place(low, high):
    """Over all magnitudes, and about 1 as in strains; the same bits in vectors and single numbers."""
    rng = np.random.default_rng(3)
    numbers = 10.0 ** rng.uniform(low, high, 376 * LANES)
    numbers[:5] = [1.0, 2.0, 0.5, np.sqrt(0.5), 4.0]
    numbers[5:8] = np.nextafter([np.sqrt(0.5), 1.0, 1.0], [1.0, 0.0, 2.0])
    x, z = 10.0 ** rng.uniform(0.45 * low, 0.45 * high, (2, len(numbers)))  # whose squares can be added
    computed, again = np.empty((2, 3, len(numbers)))
    in_vectors(x, z, numbers, *computed)
    one_by_one(x, z, numbers, *again)
    assert computed.tobytes() == again.tobytes()
    for number, dx, dz, inverse, length, log in zip(*(row.tolist() for row in (numbers, x, z, *computed))):
        true = exact(lambda: (Decimal(dx) ** 2 + Decimal(dz) ** 2).sqrt())
        assert is_near(length, true) and is_near(inverse, exact(lambda: 1 / true))
        assert is_near(log, exact(Decimal(number).ln))


def test_infinity_and_nan_remain():
    """Such a length is not a number either, which the energy check finds."""
    x, computed = np.full(LANES, np.inf), np.empty((3, LANES))
    x[1::2] = np.nan
    in_vectors(x, np.ones(LANES), np.ones(LANES), *computed)
    assert not np.isfinite(computed[1]).any() and np.isnan(computed[0, 1::2]).all()
