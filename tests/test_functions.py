"""The functions that are ours, for the same bits on any processor, against exact ones to many digits."""

import math
from statistics import NormalDist

import mpmath
import numpy as np
import pytest

from netfall.core import functions
from netfall.core.arithmetic import exponential, exponential_minus_one
from netfall.core.arrays import distinct, first_largest, is_one_of
from netfall.core.functions import quantile
from netfall.core.kernels import kernel
from netfall.core.linear import (
    factorise_cholesky,
    product,
    solve_cholesky_columns,
    solve_complex,
)
from netfall.core.sparse import Singular, solve_sparse
from netfall.loads.wind.noise import standard_normal

mpmath.mp.prec = 160
ROUNDING = np.finfo(float).eps


def numbers(low: float, high: float, count: int = 2000, logarithmic: bool = False) -> np.ndarray:
    result = np.random.default_rng(1).uniform(low, high, count)
    return 10.0**result if logarithmic else result


def worst(ours: np.ndarray, exact, arguments: np.ndarray) -> float:
    """Largest error in units of the last place of the exact value."""
    errors = []
    for value, argument in zip(np.asarray(ours).tolist(), arguments.tolist()):
        true = exact(mpmath.mpf(argument))
        errors.append(abs((mpmath.mpf(value) - true) / mpmath.mpf(float(np.spacing(abs(float(true)))))))
    return float(max(errors))


@kernel
def each(numbers, whole, less_one):
    for i in range(numbers.shape[0]):
        whole[i] = exponential(numbers[i])
        less_one[i] = exponential_minus_one(numbers[i])


# Measured, in units of the last place: 0.85, 0.75, 1.9, 1.4, 1.4, 0.9, 1.7.
@pytest.mark.parametrize(
    "name, exact, over, units",
    [
        ("exp", mpmath.exp, (-700.0, 700.0), 1.0),
        ("exp", mpmath.exp, (-1.0, 1.0), 1.0),
        ("log", mpmath.log, (-290.0, 290.0, "powers"), 1.0),
        ("log", mpmath.log, (0.5, 2.0), 1.0),
        ("log1p", mpmath.log1p, (-20.0, 5.0, "powers"), 2.0),
        ("sin", mpmath.sin, (-3.0, 3.0), 1.5),
        ("cos", mpmath.cos, (-3.0, 3.0), 1.5),
        ("cube_root", mpmath.cbrt, (-10.0, 20.0, "powers"), 1.0),
    ],
)
def test_functions_are_right_to_two_units_of_the_last_place(name, exact, over, units):
    x = numbers(*over[:2], logarithmic=len(over) == 3)
    assert worst(getattr(functions, name)(x), exact, x) <= units


def test_sines_of_many_turns_are_right_to_sixteen_digits_after_the_point():
    x = numbers(-functions.LARGEST_ANGLE, functions.LARGEST_ANGLE)
    for ours, exact in ((functions.sin, mpmath.sin), (functions.cos, mpmath.cos)):
        off = [abs(mpmath.mpf(y) - exact(mpmath.mpf(a))) for y, a in zip(ours(x).tolist(), x.tolist())]
        assert max(off) <= ROUNDING


def test_powers_are_as_exact_as_their_logarithm():
    """Compare heights above ground over 10 m, with the exponents of the profile."""
    x = numbers(-1.0, 3.0, logarithmic=True)
    for exponent in (0.12, 0.16, 0.4):
        exact = lambda a, e=exponent: a ** mpmath.mpf(e)
        assert worst(functions.power(x, exponent), exact, x) <= 1.0 + 7 * exponent


def test_exact_values_stay_exact():
    assert float(functions.exp(0.0)) == float(functions.cos(0.0)) == 1.0
    assert float(functions.sin(0.0)) == float(functions.log1p(0.0)) == 0.0
    assert float(functions.log(1.0)) == 0.0 and float(functions.log(2.0)) == math.log(2.0)
    assert functions.geometric(1.0, 16.0, 5).tolist() == pytest.approx([1, 2, 4, 8, 16], rel=4 * ROUNDING)
    with np.errstate(divide="ignore"):
        assert functions.log(np.array([0.0, -0.0])).tolist() == [-math.inf] * 2
        assert np.isnan(functions.log(np.array([-1.0, math.nan]))).all()
    assert np.isfinite(functions.exp(np.array([-1e4, 1e4]))).all()


def test_exponentials_of_the_material_law():
    x = np.concatenate([numbers(-3.0, 3.0), numbers(-12.0, -1.0, logarithmic=True)])
    whole, less_one = np.empty((2, len(x)))
    each(x, whole, less_one)
    assert worst(whole, mpmath.exp, x) <= 1.0
    assert worst(less_one, mpmath.expm1, x) <= 4.0  # near -0.35, where e^x less 1 is a third of e^x


def test_normal_numbers_are_those_of_numpy_to_rounding():
    """Method and random bits are the same: of a million, 280 are in the tail and 7000 near a layer."""
    ours = standard_normal(np.random.Philox(key=5), 1_000_000)
    theirs = np.random.Generator(np.random.Philox(key=5)).standard_normal(1_000_000)
    assert np.abs(ours - theirs).max() <= 1e-13  # numpy's tables have their own last digits
    assert np.abs(ours).max() > 4.5
    assert np.array_equal(ours, standard_normal(np.random.Philox(key=5), 1_000_000))


def test_quantiles_are_those_of_the_standard_library():
    p = np.concatenate([numbers(0.0, 1.0), numbers(-300.0, -1.0, logarithmic=True)])
    expected = np.array([NormalDist().inv_cdf(each) for each in p.tolist()])
    assert np.abs(quantile(p) - expected).max() <= 8 * ROUNDING * np.abs(expected).max()


def test_dense_solutions_leave_residuals_of_rounding():
    rng = np.random.default_rng(2)
    root = rng.normal(size=(60, 60))
    matrix, right = root @ root.T + np.eye(60), rng.normal(size=(60, 4))
    upper, solution = matrix.copy(), right.copy()
    assert factorise_cholesky(upper) == 0
    solve_cholesky_columns(upper, solution)
    assert np.abs(matrix @ solution - right).max() < 1e-11
    assert np.abs(np.linalg.solve(matrix, right) - solution).max() < 1e-11
    a = rng.normal(size=(5, 60))
    assert np.abs(product(a, right) - a @ right).max() < 1e-13


def test_complex_systems_have_the_bits_of_pythons_own_arithmetic():
    """Twenty systems at once, with rows exchanged. Python follows the same rules, one number at a time."""
    rng = np.random.default_rng(5)
    left, right = (rng.normal(size=(20, 6, m)) + 1j * rng.normal(size=(20, 6, m)) for m in (6, 3))
    factored, solution = left.copy(), right.copy()
    solve_complex(factored, solution)
    assert np.abs(left @ solution - right).max() < 1e-12
    for matrix, b, x in zip(left.tolist(), right.tolist(), solution.tolist()):
        for k in range(6):
            sizes = [row[k].real ** 2 + row[k].imag ** 2 for row in matrix[k:]]
            best = k + sizes.index(max(sizes))
            for rows in (matrix, b):
                rows[k], rows[best] = rows[best], rows[k]
            for i in range(k + 1, 6):
                factor = matrix[i][k] / matrix[k][k]
                for rows in (matrix, b):
                    rows[i] = [a - factor * c for a, c in zip(rows[i], rows[k])]
        for i in range(5, -1, -1):
            for k in range(i + 1, 6):
                b[i] = [a - matrix[i][k] * c for a, c in zip(b[i], b[k])]
            b[i] = [a / matrix[i][i] for a in b[i]]
        assert b == x


def test_singular_rows_are_counted():
    singular = np.ones((3, 3))
    assert factorise_cholesky(singular) == 2
    assert np.triu(singular).tolist() == [[1, 1, 1], [0, 1, 0], [0, 0, 1]]


def test_sparse_solutions_of_matrices_with_both_signs():
    """A random graph, pairs given twice and either way; some diagonals negative, as struts make them."""
    rng, n = np.random.default_rng(4), 200
    ends = rng.integers(0, n, (700, 2))
    ends = ends[ends[:, 0] != ends[:, 1]]
    q, diagonal, right = rng.normal(size=len(ends)), rng.choice([-40.0, 40.0], n), rng.normal(size=(n, 3))
    whole = np.diag(diagonal)
    for (a, b), value in zip(ends, q):
        whole[a, b] += value
        whole[b, a] += value
    assert np.abs(solve_sparse(ends, q, diagonal, right) - np.linalg.solve(whole, right)).max() < 1e-12


def test_a_singular_matrix_is_reported_with_its_rows():
    """Rows 0 and 1 pull only at each other; 2 and 3 are held. 0.1 + 0.2 - 0.3 = 5.6e-17 is not a pivot."""
    pairs, q = np.array([[0, 1], [2, 3]]), np.array([-1.0, -1.0])
    with pytest.raises(Singular) as raised:
        solve_sparse(pairs, q, np.array([1.0, 1.0, 2.0, 2.0]), np.ones((4, 1)))
    assert raised.value.rows.tolist() == [0, 1]
    alone = np.zeros((0, 2), int), np.zeros(0), np.array([0.1 + 0.2 - 0.3, 1.0]), np.ones((2, 1))
    with pytest.raises(Singular) as raised:
        solve_sparse(*alone, size=np.array([0.6, 1.0]))
    assert raised.value.rows.tolist() == [0]


def test_a_pivot_of_zero_is_no_singular_matrix():
    """[[0, 1], [1, 0]] changes its two right sides, by way of an order in which no pivot is zero."""
    ends, q, diagonal = np.array([[0, 1], [1, 2]]), np.array([1.0, 3.0]), np.array([0.0, 0.0, 1.0])
    whole = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 3.0], [0.0, 3.0, 1.0]])
    b = np.array([[1.0], [2.0], [4.0]])
    assert np.abs(whole @ solve_sparse(ends, q, diagonal, b) - b).max() < 1e-14


def test_sets_of_integers_equal_those_of_numpy():
    """Results are ascending and unique for any shape; membership also holds for numbers beyond the set."""
    rng = np.random.default_rng(1)
    for size, most in ((0, 5), (1, 1), (1000, 50), (1000, 10**11)):
        values, others = rng.integers(0, most, (2, size, 2))
        assert (distinct(values) == np.unique(values)).all()
        assert len(distinct(values)) == len(np.unique(values))
        assert (is_one_of(values, others[: size // 2].ravel()) == np.isin(values, others[: size // 2])).all()
        assert is_one_of(values, values.ravel()).all() and not is_one_of(values + most, values.ravel()).any()


def test_the_largest_of_equal_values_has_the_least_number():
    """Independent of the order of the rows; nan counts as the largest."""
    values, number = np.array([1.0, 3.0, 2.0, 3.0, 3.0]), np.array([5, 9, 1, 4, 7])
    for order in np.random.default_rng(1).permuted(np.tile(np.arange(5), (20, 1)), axis=1):
        assert number[order][first_largest(values[order], number[order])] == 4
    assert first_largest(np.array([1.0, np.nan, 2.0]), np.arange(3)) == 1
