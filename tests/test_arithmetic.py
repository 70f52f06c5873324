"""Inverse root and logarithm against exact ones; their errors are in units of the last place."""

from decimal import Decimal, localcontext

import numpy as np
import pytest

from netfall.ground.compile import kernel, vector_kernel
from netfall.numerics.arithmetic import inverse_root, logarithm


@vector_kernel
def in_registers(numbers, roots, logarithms):
    for i in range(np.uint64(len(numbers))):
        roots[i] = inverse_root(numbers[i])
        logarithms[i] = logarithm(numbers[i])


@kernel
def each(numbers, roots, logarithms):
    in_registers(numbers, roots, logarithms)


def exact(number: float, function) -> Decimal:
    with localcontext() as context:
        context.prec = 40
        return function(Decimal(number))


@pytest.mark.parametrize("low, high", [(-290, 290), (-3, 3), (-1e-3, 1e-3)])
def test_within_two_units_of_the_last_place(low, high):
    """Over all magnitudes, and about 1, where strains are; the same bits in registers and one by one."""
    numbers = 10.0 ** np.random.default_rng(3).uniform(low, high, 3003)
    numbers[:8] = [
        1.0,
        2.0,
        0.5,
        np.sqrt(0.5),
        np.nextafter(np.sqrt(0.5), 1.0),
        np.nextafter(1.0, 0.0),
        np.nextafter(1.0, 2.0),
        4.0,
    ]
    roots, logarithms, one = np.empty_like(numbers), np.empty_like(numbers), np.empty((2, 1))
    each(numbers, roots, logarithms)
    for number, root, log in zip(numbers.tolist(), roots.tolist(), logarithms.tolist()):
        each(np.array([number]), one[0], one[1])
        assert (root, log) == (one[0, 0], one[1, 0])
        assert abs(Decimal(root) - exact(number, lambda a: 1 / a.sqrt())) <= Decimal(2 * np.spacing(root))
        assert abs(Decimal(log) - exact(number, lambda a: a.ln())) <= Decimal(2 * np.spacing(abs(log)))


def test_what_is_no_number_stays_none():
    """Infinity and nan give nan, which the look at the energies finds."""
    roots = np.empty(2)
    each(np.array([np.inf, np.nan]), roots, np.empty(2))
    assert np.isnan(roots).all()
