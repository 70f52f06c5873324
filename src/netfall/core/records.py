"""Records: arrays and numbers that kernels take together, by one address.

A kernel that takes a hundred arrays as arguments spends most of its compilation, and much of each call, on
the way in from Python. A record is one argument: a table of the addresses, shapes and numbers, which compiled
code reads where a field is used.

    class Joints(Record):
        stiffness: f8
        particles: i8_2

    joints = Joints(stiffness, particles)      # in Python: attributes, `replaced`
    joints.stiffness[k]                        # in kernels: arrays in C order, numbers, or other records

The type of a record says nothing of what a scene has: a field that is absent is an array without elements
(`has`). So all scenes share one compiled kernel.

Undocumented of numba is used here `AttributeTemplate`, `make_array` and `populate_array` (MAINTAINING.md).
"""

import hashlib
import struct

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)
from numba.np.arrayobj import populate_array

real, whole = types.float64, types.int64  # numbers
f8, f8_2, f8_3 = (types.Array(types.float64, k, "C") for k in (1, 2, 3))  # arrays, of one to three axes
i8, i8_2, i8_3 = (types.Array(types.int64, k, "C") for k in (1, 2, 3))
i4 = types.Array(types.int32, 1, "C")
i1 = types.Array(types.int8, 1, "C")
u8 = types.Array(types.uint64, 1, "C")
u4, u4_2 = (types.Array(types.uint32, k, "C") for k in (1, 2))
u1, u1_2 = (types.Array(types.uint8, k, "C") for k in (1, 2))

WORD = ir.IntType(64)
NUMBERS = (int, float, np.number, np.bool_)


class RecordType(types.Type):
    """Type of a class of records. fields : types by name; places : the first word of each in the table"""

    def __init__(self, name: str, fields: dict):
        self.fields, self.places, words = fields, {}, 0
        self.dtypes = {n: np.dtype(str(k.dtype)) for n, k in fields.items() if isinstance(k, types.Array)}
        for field, kind in fields.items():
            self.places[field] = words
            words += 1 + kind.ndim if isinstance(kind, types.Array) else 1
        text = ", ".join(f"{field}: {kind}" for field, kind in fields.items())
        super().__init__(name=f"{name}({hashlib.sha256(text.encode()).hexdigest()[:8]})")  # short symbols


class Record:
    """Arrays and numbers that kernels take together. Subclasses say by annotations what of.

    The arrays must be in C order and of the type said; the record keeps them alive. It is never changed, but
    the arrays may be.
    """

    kind: RecordType

    def __init_subclass__(cls):
        fields = {name: getattr(hint, "kind", hint) for name, hint in cls.__annotations__.items()}
        cls.kind = RecordType(cls.__qualname__, fields)

    def __init__(self, *values, **named):
        """values, named : of the fields, in their order or by name.

        Raises TypeError if one is missing or of another type.
        """
        fields = self.kind.fields
        given = dict(zip(fields, values, strict=False)) | named
        if len(values) + len(named) != len(fields) or given.keys() != fields.keys():
            names = sorted(fields.keys() ^ given.keys()) or sorted(
                set(list(fields)[: len(values)]) & set(named)
            )
            raise TypeError(f"{type(self).__name__}: missing, unknown or given twice: {', '.join(names)}")
        self.__dict__ |= given
        words = []
        for name, kind in fields.items():
            _add_words(words, given[name], kind, name, self.kind)
        self._table = np.array([word % 2**64 for word in words], np.uint64)
        self.address = self._table.__array_interface__["data"][0]

    def __reduce__(self):
        """In another process the arrays stand elsewhere."""
        return type(self), tuple(getattr(self, name) for name in self.kind.fields)

    def replaced(self, **changes):
        """A record with other values in some fields."""
        return type(self)(**({name: getattr(self, name) for name in self.kind.fields} | changes))

    @classmethod
    def absent(cls):
        """A record without anything: arrays without elements, zeros, and such records."""
        return cls(*(empty(kind) for kind in cls.kind.fields.values()))


def empty(kind):
    """What stands for a field that is absent."""
    if isinstance(kind, types.Array):
        return np.zeros((0,) * kind.ndim, str(kind.dtype))
    if isinstance(kind, RecordType):
        return _Absent(kind)
    return 0


class _Absent:
    """A record that is absent within another one: its table is all zeros."""

    def __init__(self, kind):
        self.kind = kind
        words = sum(1 + one.ndim if isinstance(one, types.Array) else 1 for one in kind.fields.values())
        self._table = np.zeros(max(words, 1), np.uint64)
        self._parts = [empty(one) for one in kind.fields.values() if isinstance(one, RecordType)]
        names = [name for name, one in kind.fields.items() if isinstance(one, RecordType)]
        for name, part in zip(names, self._parts):
            self._table[kind.places[name]] = part.address
        self.address = self._table.__array_interface__["data"][0]


def _add_words(words: list, value, kind, name: str, of: RecordType) -> None:
    """Add what stands in the table for a value."""
    if isinstance(kind, types.Array):
        right = isinstance(value, np.ndarray) and value.ndim == kind.ndim and value.flags.c_contiguous
        if not right or value.dtype != of.dtypes[name]:
            what = getattr(value, "dtype", type(value).__name__), getattr(value, "shape", ())
            raise TypeError(f"{name}: {what[0]} {what[1]}; expected {kind}")
        words += value.__array_interface__["data"][0], *value.shape
    elif isinstance(kind, RecordType):
        if getattr(value, "kind", None) is not kind:
            raise TypeError(f"{name}: {type(value).__name__}; expected {kind}")
        words.append(value.address)
    elif not isinstance(value, NUMBERS):
        raise TypeError(f"{name}: {type(value).__name__}; expected a number")
    else:
        words.append(struct.unpack("q", struct.pack("d", value))[0] if kind == real else int(value))


@intrinsic
def has(typing, array):
    """Whether a field is there: whether its array has any elements."""

    def code(context, builder, signature, values):
        size = context.make_array(array)(context, builder, values[0]).nitems
        return builder.icmp_signed("!=", size, ir.Constant(WORD, 0))

    return types.boolean(array), code


# --- for compiled code


@typeof_impl.register(Record)
@typeof_impl.register(_Absent)
def _type_of(record, context):
    return record.kind


@register_model(RecordType)
class _Address(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, WORD)


@unbox(RecordType)
def _unbox(kind, record, c):
    attribute = c.pyapi.object_getattr_string(record, "address")
    number = c.pyapi.long_as_ulonglong(attribute)
    c.pyapi.decref(attribute)
    return NativeValue(number)


@infer_getattr
class _Fields(AttributeTemplate):
    key = RecordType

    def generic_resolve(self, kind, name):
        return kind.fields.get(name)


@lower_getattr_generic(RecordType)
def _read(context, builder, kind, address, name):
    """The value of a field; the table is never written, so it may be read once for a whole loop."""
    field, place = kind.fields[name], kind.places[name]
    table = builder.inttoptr(address, WORD.as_pointer())

    def word(k):
        number = builder.load(builder.gep(table, [ir.Constant(WORD, place + k)]))
        number.set_metadata("invariant.load", builder.module.add_metadata([]))
        return number

    if not isinstance(field, types.Array):
        return builder.bitcast(word(0), ir.DoubleType()) if field == real else word(0)
    array = context.make_array(field)(context, builder)
    size = np.dtype(str(field.dtype)).itemsize
    shape = [word(1 + k) for k in range(field.ndim)]
    strides = [ir.Constant(WORD, size)]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length))
    data = builder.inttoptr(word(0), context.get_data_type(field.dtype).as_pointer())
    populate_array(
        array, data=data, shape=shape, strides=strides, itemsize=ir.Constant(WORD, size), meminfo=None
    )
    return array._getvalue()
