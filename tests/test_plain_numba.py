"""Records and vectors, the base of all kernels."""

import pickle
from fractions import Fraction

import numpy as np
import pytest
from numba import njit

from netfall.core.kernels import OPTIONS, call, inner_kernel, kernel, routine
from netfall.core.records import Record, f8, f8_2, is_present, real, u1, u4_2, whole
from netfall.core.vectors import (
    LANES,
    as_number,
    bits_of,
    fma,
    load,
    maximum,
    minimum,
    number_of,
    sqrt,
    store_below,
    where,
)

# --- records


class Inner(Record):
    numbers: f8
    table: f8_2


class Outer(Record):
    factor: real
    count: whole
    flags: u1
    pairs: u4_2
    inner: Inner


@kernel
def read(outer, out):
    out[0], out[1] = outer.factor, outer.count
    out[2], out[3], out[4] = is_present(outer.flags), is_present(outer.pairs), is_present(outer.inner.table)
    for i in range(outer.flags.shape[0]):
        out[5] += outer.flags[i]
    for i in range(outer.pairs.shape[0]):
        out[6] += outer.pairs[i, 0] - outer.pairs[i, 1]
    for i in range(outer.inner.table.shape[0]):
        for k in range(outer.inner.table.shape[1]):
            out[7] += outer.inner.table[i, k] * outer.inner.numbers[k]


def inner() -> Inner:
    return Inner(np.array([1.0, 10.0, 100.0]), np.arange(6.0).reshape(2, 3))


def outer(**changes) -> Outer:
    flags, pairs = np.array([1, 0, 255], np.uint8), np.array([[5, 2], [9, 1]], np.uint32)
    return Outer(
        **({"factor": -0.1, "count": -7, "flags": flags, "pairs": pairs, "inner": inner()} | changes)
    )


def values_of(record: Outer) -> list[float]:
    out = np.zeros(8)
    read(record, out)
    return out.tolist()


def test_compiled_code_reads_the_fields_of_a_record():
    """Numbers, arrays of several types and axes, an inner record; by position, name, changed, pickled."""
    whole = outer()
    assert values_of(whole) == [-0.1, -7, 1, 1, 1, 256, 11, 210 + 543]
    by_place = Outer(-0.1, -7, whole.flags, whole.pairs, whole.inner)
    for other in (by_place, pickle.loads(pickle.dumps(whole)), whole.with_values()):
        assert values_of(other) == values_of(whole)
    assert values_of(whole.with_values(factor=np.inf, count=2**40))[:2] == [np.inf, 2.0**40]
    assert values_of(whole)[:2] == [-0.1, -7]  # a record is never changed,
    whole.inner.table[0] = 0.0  # but its arrays may be
    assert values_of(by_place)[7] == 543
    assert np.isnan(values_of(outer(factor=np.nan))[0])


def test_absent_fields_are_absent_in_compiled_code():
    nothing = Outer.absent()
    assert values_of(nothing) == [0.0] * 8
    assert values_of(outer(inner=nothing.inner))[4:] == [0, 256, 11, 0]
    assert values_of(outer(pairs=np.zeros((0, 2), np.uint32)))[2:5] == [1, 0, 1]
    assert values_of(nothing.with_values(inner=inner()))[2:5] == [0, 0, 1]
    assert not [name for name in ("flags", "pairs") if getattr(nothing, name).size]


@pytest.mark.parametrize(
    "name, value",
    [
        ("flags", np.zeros(3)),  # of another type
        ("flags", np.zeros(3, bool)),
        ("flags", [1, 0, 255]),
        ("flags", None),
        ("pairs", np.zeros((2, 2), np.int32)),
        ("pairs", np.zeros(4, np.uint32)),  # of another shape
        ("pairs", np.zeros((2, 2), np.uint32, order="F")),  # in another order of memory
        ("pairs", np.zeros((2, 4), np.uint32)[:, ::2]),
        ("pairs", np.zeros((2, 2), ">u4")),
        ("inner", Outer.absent()),
        ("inner", None),
        ("inner", np.zeros(3)),
        ("factor", None),
        ("factor", "1"),
        ("count", None),
        ("count", np.zeros(3)),
    ],
)
def test_wrong_fields_are_named(name, value):
    with pytest.raises(TypeError, match=f"^{name}: "):
        outer(**{name: value})


@routine(whole, real, Outer.kind)
def scaled(number, factor, record):
    """A routine that returns an integer and writes into arrays."""
    record.inner.table[0, 0] = factor * record.factor
    return number + record.count


@kernel
def call_scaled(address, number, factor, record):
    return call(address, (number, factor, record))


def test_a_routine_is_called_by_its_address():
    record = outer()
    assert call_scaled(scaled.address, 2**40, 3.0, record) == 2**40 - 7
    assert record.inner.table[0, 0] == 3.0 * -0.1


# --- vectors: each operation on LANES numbers as on each of them alone


TWO = 2.0
OPERATIONS = {
    "sum": lambda a, b, c: a + b,
    "difference": lambda a, b, c: a - b,
    "product": lambda a, b, c: a * b,
    "quotient": lambda a, b, c: a / b,
    "negative": lambda a, b, c: -a,
    "size": lambda a, b, c: abs(a),
    "fused": lambda a, b, c: fma(a, b, c),
    "root": lambda a, b, c: sqrt(abs(a)),
    "larger": lambda a, b, c: maximum(a, b),
    "smaller": lambda a, b, c: minimum(a, b),
    "with numbers, first": lambda a, b, c: TWO * a + (1 - a) - TWO / a,
    "with numbers, last": lambda a, b, c: a * TWO + (a - 1) - a / TWO,
    "fused with numbers": lambda a, b, c: fma(a, TWO, 1) + fma(TWO, b, -1.0) + fma(1, TWO, c),
    "limited by numbers": lambda a, b, c: maximum(minimum(a, 1.0), -1.0) + maximum(0.5, b) + minimum(0, c),
    "less": lambda a, b, c: where(a < b, a, c),
    "more": lambda a, b, c: where(a > b, a, c),
    "equal": lambda a, b, c: where(a == b, a, c),
    "another": lambda a, b, c: where(a != b, a, c),
    "not itself": lambda a, b, c: where(a != a, 1.0, c),
    "against numbers": lambda a, b, c: where(a < 0.0, 1.0, where(0.5 < b, c, TWO)),
    "both": lambda a, b, c: where((a < b) & (b < c), a, c),
    "either": lambda a, b, c: where((a > b) | (b == c), a, c),
    "the same bits": lambda a, b, c: number_of(bits_of(a)),
    "exponent": lambda a, b, c: as_number(bits_of(a) >> 52),
    "bits added": lambda a, b, c: as_number(bits_of(a) + bits_of(b)),
    "bits subtracted": lambda a, b, c: as_number((bits_of(a) - bits_of(b)) - 1),
    "bits shifted": lambda a, b, c: as_number(bits_of(a) << 3),
}


def numbers_of_all_kinds(n: int) -> np.ndarray:
    """Return three rows of numbers with nan, inf, zeros of both signs, and very small numbers."""
    rng = np.random.default_rng(7)
    rows = rng.normal(size=(3, n)) * 10.0 ** rng.integers(-3, 3, (3, n))
    odd = [0.0, -0.0, np.inf, -np.inf, np.nan, 5e-324, -1e-310, 1.0, -1.0, 1.7e308]
    rows[:, : len(odd) ** 2] = [
        np.repeat(odd, len(odd)),
        np.tile(odd, len(odd)),
        np.roll(np.repeat(odd, 10), 7),
    ]
    rows[1, 150:200] = rows[0, 150:200]
    return rows


def both_ways(operation) -> tuple:
    """Return kernels that apply an operation to three rows, as vectors and to single numbers."""
    each = inner_kernel(operation)

    @njit(**OPTIONS)
    def of_vectors(rows, high, out):
        for p in range(0, high, LANES):
            store_below(p, high, out, 0, each(load(rows, 0, p), load(rows, 1, p), load(rows, 2, p)))

    @njit(**OPTIONS)
    def one_by_one(rows, high, out):
        for p in range(high):
            out[p] = each(rows[0, p], rows[1, p], rows[2, p])

    return of_vectors, one_by_one


def canonical(values: np.ndarray) -> np.ndarray:
    """Return the bits, with equal ones for all nan."""
    return np.where(np.isnan(values), np.int64(-1), values.view(np.int64))


@pytest.mark.parametrize("name", OPERATIONS)
def test_vector_operations_have_the_bits_of_scalar_ones(name):
    rows, high = numbers_of_all_kinds(40 * LANES), 40 * LANES - 3
    values_of, expected = np.full((2, 40 * LANES), 7.0)
    of_vectors, one_by_one = both_ways(OPERATIONS[name])
    of_vectors(rows, high, values_of)
    one_by_one(rows, high, expected)
    assert np.array_equal(canonical(values_of), canonical(expected)) and (values_of[high:] == 7.0).all()


def test_scalar_functions_agree_with_numpy():
    """Root and bits are numpy's, `fused` rounds once; larger and smaller return b if either is nan."""
    rows = numbers_of_all_kinds(400)
    n, out = rows.shape[1], np.empty(400)
    given = lambda name: (both_ways(OPERATIONS[name])[1](rows, n, out), out.copy())[1]
    assert np.array_equal(canonical(given("root")), canonical(np.sqrt(np.abs(rows[0]))))
    exponents = (rows[0].view(np.int64) >> 52).astype(float)
    nans = np.isnan(rows[0])
    assert np.array_equal(given("exponent")[~nans], exponents[~nans])
    assert np.array_equal(canonical(given("larger")), canonical(np.where(rows[0] > rows[1], *rows[:2])))
    assert np.array_equal(canonical(given("smaller")), canonical(np.where(rows[0] < rows[1], *rows[:2])))
    fused = given("fused")
    for k in np.flatnonzero(np.isfinite(rows).all(0)):
        a, b, c = (Fraction(value) for value in rows[:, k].tolist())
        if abs(a * b + c) < 1e308:
            assert fused[k] == float(a * b + c)
