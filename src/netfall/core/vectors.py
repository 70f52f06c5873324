"""Vectors of LANES numbers in registers, for the loops that take most of a run's time.

A kernel reads as ordinary arithmetic, with operators and `fma`, `sqrt`, `where`, `maximum`, `minimum`. With
floats it computes one particle, with vectors LANES of them. Vectorisation does not depend on the compiler's
analysis of a loop. The bits equal those of scalar arithmetic, for any LANES.

Members of arrays are found by an undocumented name of numba (`kernels.member`).
"""

import operator
from collections.abc import Callable
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba import types
from numba.extending import lower_builtin, models, register_model, type_callable

from netfall.core.kernels import intrinsic, member


def _lanes() -> int:
    """Return how many numbers one register of this processor holds: 8 with AVX-512, otherwise 4.

    With AVX2, vectors of two registers were slower, because a loop needs more than its 16 registers.
    """
    try:
        return 8 if llvm.get_host_cpu_features().get("avx512f") else 4
    except RuntimeError:  # LLVM does not know the features of this platform
        return 4


LANES = _lanes()  # numbers per vector
DOUBLE, WORD, BIT, BYTE = ir.DoubleType(), ir.IntType(64), ir.IntType(1), ir.IntType(8)


class Vector(types.Type):
    """Numba type of LANES numbers: float64, int64 or boolean."""

    def __init__(self, kind: Any, width: Any):
        self.kind, self.width = kind, width
        super().__init__(name=f"Vector({kind}, {LANES})")


@register_model(Vector)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any):
        super().__init__(manager, kind, ir.VectorType(kind.width, LANES))


NUMBERS = Vector(types.float64, DOUBLE)
INTEGERS = Vector(types.int64, WORD)
BOOLEANS = Vector(types.boolean, BIT)


def _broadcast(context: Any, builder: Any, value: Any, kind: Any, like: Any) -> Any:
    """Broadcast a number to all lanes; return a vector unchanged."""
    if isinstance(kind, Vector):
        return value
    number = context.cast(builder, value, kind, like.kind)
    if like.kind == types.boolean:
        number = builder.trunc(number, BIT) if number.type != BIT else number
    vector = builder.insert_element(
        ir.Constant(ir.VectorType(number.type, LANES), ir.Undefined), number, ir.Constant(ir.IntType(32), 0)
    )
    return builder.shuffle_vector(
        vector, vector, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    )


def _operator(
    function: Callable[..., Any], make: dict[Any, Callable[..., Any]], result: Vector | None = None
) -> None:
    """Define a Python operator for two vectors, or a vector and a number.

    make : code generators, by the kind of the vectors; result : type, None: that of the arguments
    """

    @type_callable(function)
    def kind(context: Any) -> Any:
        def of(a: Any, b: Any) -> Any:
            like = next((k for k in (a, b) if isinstance(k, Vector)), None)
            supported = like is not None and like.kind in make
            return (result or like) if supported else None

        return of

    def lower(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        like = next(k for k in signature.args if isinstance(k, Vector))
        operands = (_broadcast(context, builder, v, k, like) for v, k in zip(values, signature.args))
        return make[like.kind](builder, *operands)

    for kinds in ((Vector, Vector), (Vector, types.Number), (types.Number, Vector)):
        lower_builtin(function, *kinds)(lower)


_f8, _i8, _bool = types.float64, types.int64, types.boolean
_operator(operator.add, {_f8: lambda b, x, y: b.fadd(x, y), _i8: lambda b, x, y: b.add(x, y)})
_operator(operator.sub, {_f8: lambda b, x, y: b.fsub(x, y), _i8: lambda b, x, y: b.sub(x, y)})
_operator(operator.mul, {_f8: lambda b, x, y: b.fmul(x, y)})
_operator(operator.truediv, {_f8: lambda b, x, y: b.fdiv(x, y)})
_operator(operator.rshift, {_i8: lambda b, x, y: b.ashr(x, y)})
_operator(operator.lshift, {_i8: lambda b, x, y: b.shl(x, y)})
_operator(operator.gt, {_f8: lambda b, x, y: b.fcmp_ordered(">", x, y)}, BOOLEANS)
_operator(operator.lt, {_f8: lambda b, x, y: b.fcmp_ordered("<", x, y)}, BOOLEANS)
_operator(operator.ne, {_f8: lambda b, x, y: b.fcmp_unordered("!=", x, y)}, BOOLEANS)
_operator(operator.eq, {_f8: lambda b, x, y: b.fcmp_ordered("==", x, y)}, BOOLEANS)
_operator(operator.or_, {_bool: lambda b, x, y: b.or_(x, y)})
_operator(operator.and_, {_bool: lambda b, x, y: b.and_(x, y)})


def _unary(function: Callable[..., Any], make: Callable[..., Any]) -> None:
    """Define a Python operator for one vector."""

    @type_callable(function)
    def kind(context: Any) -> Any:
        def of(a: Any) -> Any:
            return a if isinstance(a, Vector) else None

        return of

    lower_builtin(function, Vector)(lambda context, builder, signature, values: make(builder, values[0]))


def _llvm(name: Any, builder: Any, *values: Any) -> Any:
    """Call an LLVM intrinsic by name."""
    kind = values[0].type
    name = f"llvm.{name}.v{LANES}f64" if isinstance(kind, ir.VectorType) else f"llvm.{name}.f64"
    function = builder.module.globals.get(name)
    if function is None:
        function = ir.Function(builder.module, ir.FunctionType(kind, [kind] * len(values)), name)
    return builder.call(function, values)


_unary(operator.neg, lambda builder, a: builder.fneg(a))
_unary(abs, lambda builder, a: _llvm("fabs", builder, a))


def _elementwise(make: Any, truth_first: Any = False) -> Any:
    """Return the typing of a function of numbers or vectors; numbers are broadcast if any is a vector."""

    def typing(typing_context: Any, *args: Any) -> Any:
        vectors = any(isinstance(a, Vector) for a in args)
        kinds: list[types.Type] = [NUMBERS if vectors else types.float64] * len(args)
        if truth_first:
            kinds[0] = BOOLEANS if vectors else types.boolean

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            if vectors:
                operands = [_broadcast(context, builder, v, a, k) for v, a, k in zip(values, args, kinds)]
            else:
                operands = [context.cast(builder, v, a, k) for v, a, k in zip(values, args, kinds)]
            return make(builder, *operands)

        return kinds[-1](*args), code

    return typing


@intrinsic
def fma(typing: Any, a: Any, b: Any, c: Any) -> tuple[Any, Callable[..., Any]]:
    """Compute a b + c, rounded once; in single precision if all three are."""
    if (a, b, c) == (types.float32,) * 3:
        return a(a, a, a), lambda context, builder, signature, values: builder.fma(*values)
    return _elementwise(lambda builder, *values: _llvm("fma", builder, *values))(typing, a, b, c)


@intrinsic
def where(typing: Any, truth: Any, a: Any, b: Any) -> tuple[Any, Callable[..., Any]]:
    """Select a if `truth`, otherwise b, in each lane."""
    return _elementwise(lambda builder, t, x, y: builder.select(t, x, y), True)(typing, truth, a, b)


@intrinsic
def maximum(typing: Any, a: Any, b: Any) -> tuple[Any, Callable[..., Any]]:
    """Return the larger number in each lane; b if either is nan."""
    return _elementwise(lambda builder, x, y: builder.select(builder.fcmp_ordered(">", x, y), x, y))(
        typing, a, b
    )


@intrinsic
def minimum(typing: Any, a: Any, b: Any) -> tuple[Any, Callable[..., Any]]:
    """Return the smaller number in each lane; b if either is nan."""
    return _elementwise(lambda builder, x, y: builder.select(builder.fcmp_ordered("<", x, y), x, y))(
        typing, a, b
    )


@intrinsic
def sqrt(typing: Any, a: Any) -> tuple[Any, Callable[..., Any]]:
    """Compute the square root."""
    return _elementwise(lambda builder, x: _llvm("sqrt", builder, x))(typing, a)


def _conversion(kind: Any, vector: Vector, convert: Callable[..., Any]) -> Any:
    """Return the typing of a function that converts a number or vector to the kind of `vector`.

    convert : method of the builder
    """
    if isinstance(kind, Vector):
        target, llvm = vector, ir.VectorType(vector.width, LANES)
    else:
        target, llvm = vector.kind, vector.width
    return target(kind), lambda context, builder, signature, values: convert(builder, values[0], llvm)


@intrinsic
def bits_of(typing: Any, a: Any) -> tuple[Any, Callable[..., Any]]:
    """Return the 64 bits of a number as an integer."""
    return _conversion(a, INTEGERS, ir.IRBuilder.bitcast)


@intrinsic
def number_of(typing: Any, a: Any) -> tuple[Any, Callable[..., Any]]:
    """Return the number with these 64 bits."""
    return _conversion(a, NUMBERS, ir.IRBuilder.bitcast)


@intrinsic
def as_number(typing: Any, a: Any) -> tuple[Any, Callable[..., Any]]:
    """Convert an integer to a number."""
    return _conversion(a, NUMBERS, ir.IRBuilder.sitofp)


@intrinsic
def any_of(typing: Any, truth: Any) -> tuple[Any, Callable[..., Any]]:
    """Return whether any lane is true."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        bits = builder.bitcast(values[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(truth), code


@intrinsic
def zeros(typing: Any) -> tuple[Any, Callable[..., Any]]:
    """Return zero in all lanes."""
    zero = ir.Constant(ir.VectorType(DOUBLE, LANES), [0.0] * LANES)
    return NUMBERS(), lambda context, builder, signature, values: zero


@intrinsic
def nowhere(typing: Any) -> tuple[Any, Callable[..., Any]]:
    """Return false in all lanes."""
    false = ir.Constant(ir.VectorType(BIT, LANES), [0] * LANES)
    return BOOLEANS(), lambda context, builder, signature, values: false


# --- memory: arrays (rows, particles) in C order


def _address(context: Any, builder: Any, kind: Any, array: Any, row: Any, p: Any) -> Any:
    """Return the address of particle p in a row of an array, or in an array without rows."""
    data = member(context, builder, kind, array, "data")
    if kind.ndim == 1:
        return builder.gep(data, [p])
    length = builder.extract_value(member(context, builder, kind, array, "shape"), 1)
    return builder.gep(data, [builder.add(builder.mul(row, length), p)])


def _lanes_from(builder: Any, address: Any, number: Any = DOUBLE) -> Any:
    """Return the address of a vector of LANES numbers from the address of the first."""
    return builder.bitcast(address, ir.VectorType(number, LANES).as_pointer())


@intrinsic
def load(typing: Any, array: Any, row: Any, p: Any) -> tuple[Any, Callable[..., Any]]:
    """Load the numbers of particles p to p + LANES in a row."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.load(_lanes_from(builder, _address(context, builder, array, *values)), align=8)

    return NUMBERS(array, types.int64, types.int64), code


@intrinsic
def index_in(typing: Any, array: Any, row: Any, p: Any) -> tuple[Any, Callable[..., Any]]:
    """Return the index of particle p in a row, for `load_at`; it is valid in all arrays with rows as long.

    A loop over rows then advances one number instead of an address in each array.
    """

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        table, row, p = values
        length = builder.extract_value(member(context, builder, array, table, "shape"), 1)
        return builder.add(builder.mul(row, length), p)

    return types.int64(array, types.int64, types.int64), code


@intrinsic
def load_at(typing: Any, array: Any, index: Any) -> tuple[Any, Callable[..., Any]]:
    """Load LANES numbers from an index on."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        data = member(context, builder, array, values[0], "data")
        return builder.load(_lanes_from(builder, builder.gep(data, [values[1]])), align=8)

    return NUMBERS(array, types.int64), code


@intrinsic
def store_at(typing: Any, array: Any, index: Any, value: Any) -> tuple[Any, Callable[..., Any]]:
    """Store LANES numbers from an index on."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        data = member(context, builder, array, values[0], "data")
        builder.store(values[2], _lanes_from(builder, builder.gep(data, [values[1]])), align=8)
        return context.get_dummy_value()

    return types.none(array, types.int64, NUMBERS), code


@intrinsic
def load_or_repeat(typing: Any, array: Any, row: Any, p: Any, common: Any) -> tuple[Any, Callable[..., Any]]:
    """Load as `load`; without elements in `array`, load the LANES numbers of `common`.

    The code selects an address once, before a loop over rows. A branch would cost more than the load.
    """

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        table, row, p, repeated = values
        size, data = (member(context, builder, array, table, name) for name in ("nitems", "data"))
        length = builder.extract_value(member(context, builder, array, table, "shape"), 1)
        zero = ir.Constant(WORD, 0)
        present = builder.icmp_signed("!=", size, zero)
        begin = builder.select(present, data, member(context, builder, common, repeated, "data"))
        index = builder.add(builder.mul(row, length), builder.select(present, p, zero))
        return builder.load(_lanes_from(builder, builder.gep(begin, [index])), align=8)

    return NUMBERS(array, types.int64, types.int64, common), code


@intrinsic
def load_mask_at(typing: Any, array: Any, index: Any) -> tuple[Any, Callable[..., Any]]:
    """Load LANES bytes from an index on; true if not zero."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        data = member(context, builder, array, values[0], "data")
        marks = builder.load(_lanes_from(builder, builder.gep(data, [values[1]]), BYTE), align=1)
        return builder.icmp_unsigned("!=", marks, ir.Constant(marks.type, [0] * LANES))

    return BOOLEANS(array, types.int64), code


@intrinsic
def load_mask(typing: Any, array: Any, row: Any, p: Any) -> tuple[Any, Callable[..., Any]]:
    """Load the bytes of particles p to p + LANES in a row; true if not zero."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        marks = builder.load(_lanes_from(builder, _address(context, builder, array, *values), BYTE), align=1)
        return builder.icmp_unsigned("!=", marks, ir.Constant(marks.type, [0] * LANES))

    return BOOLEANS(array, types.int64, types.int64), code


@intrinsic
def store(typing: Any, array: Any, row: Any, p: Any, value: Any) -> tuple[Any, Callable[..., Any]]:
    """Store the numbers of particles p to p + LANES."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        builder.store(
            values[3], _lanes_from(builder, _address(context, builder, array, *values[:3])), align=8
        )
        return context.get_dummy_value()

    return types.none(array, types.int64, types.int64, NUMBERS), code


@intrinsic
def store_below(
    typing: Any, p: Any, high: Any, array: Any, row: Any, value: Any
) -> tuple[Any, Callable[..., Any]]:
    """Store the numbers of particles p to `high`, at most LANES."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        p, high, table, row, vector = values
        is_whole = builder.icmp_signed("<=", builder.add(p, ir.Constant(WORD, LANES)), high)
        with builder.if_else(is_whole, likely=True) as (whole, part):
            with whole:
                address = _address(context, builder, array, table, row, p)
                builder.store(vector, _lanes_from(builder, address), align=8)
            with part:
                for lane in range(LANES):
                    index = builder.add(p, ir.Constant(WORD, lane))
                    with builder.if_then(builder.icmp_signed("<", index, high)):
                        number = builder.extract_element(vector, ir.Constant(ir.IntType(32), lane))
                        builder.store(number, _address(context, builder, array, table, row, index), align=8)
        return context.get_dummy_value()

    return types.none(types.int64, types.int64, array, types.int64, NUMBERS), code


@intrinsic
def gather(typing: Any, array: Any, row: Any, other: Any, index: Any) -> tuple[Any, Callable[..., Any]]:
    """Load, from a row, the numbers of the LANES particles that `other` lists from an index on.

    They are unsigned integers of 32 bits. Numbers are loaded one by one, because hardware gathers are slow on
    processors patched against data leaks through them.
    """

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        array_value, row, table, index = values
        vector = ir.Constant(ir.VectorType(DOUBLE, LANES), ir.Undefined)
        data = member(context, builder, other, table, "data")
        for lane in range(LANES):
            place = builder.gep(data, [builder.add(index, ir.Constant(WORD, lane))])
            particle = builder.zext(builder.load(place, align=4), WORD)
            number = builder.load(_address(context, builder, array, array_value, row, particle), align=8)
            vector = builder.insert_element(vector, number, ir.Constant(ir.IntType(32), lane))
        return vector

    return NUMBERS(array, types.int64, other, types.int64), code


@intrinsic
def particle_at(typing: Any, other: Any, index: Any) -> tuple[Any, Callable[..., Any]]:
    """Return the particle that `other` lists at an index."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place = builder.gep(member(context, builder, other, values[0], "data"), [values[1]])
        return builder.zext(builder.load(place, align=4), WORD)

    return types.int64(other, types.int64), code
