"""Records: arrays and numbers that kernels receive together, through one address.

A kernel with a hundred array arguments spends most of its compilation, and much of each call, on unpacking
them from Python. A record is one argument: a table of addresses, shapes and numbers. Compiled code reads a
field at each use.

    class Joints(Record):
        stiffness: f8
        particles: i8_2

    joints = Joints(stiffness, particles)      # in Python: attributes, `with_values`
    joints.stiffness[k]                        # in kernels: arrays in C order, numbers, or other records

The type of a record does not depend on the features of a problem: an absent field is an array without
elements (`is_present`). So all problems share one compiled kernel.

This module uses undocumented parts of numba: `AttributeTemplate`, `data_model_manager`
(docs/pages/development/architecture.md).
"""

import functools
import hashlib
import struct
from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from llvmlite import ir
from numba import extending, types
from numba.core.typing.templates import AttributeTemplate
from numpy.typing import NDArray

from netfall.core.arrays import FloatArray, IntArray
from netfall.core.kernels import intrinsic, member, numba_type

# Kinds of fields: the type in Python and, as its annotation, the type in kernels.
real = Annotated[float, types.float64]  # numbers
whole = Annotated[int, types.int64]
f8 = Annotated[FloatArray, types.Array(types.float64, 1, "C")]  # arrays, of one to three axes
f8_2 = Annotated[FloatArray, types.Array(types.float64, 2, "C")]
f8_3 = Annotated[FloatArray, types.Array(types.float64, 3, "C")]
i8 = Annotated[IntArray, types.Array(types.int64, 1, "C")]
i8_2 = Annotated[IntArray, types.Array(types.int64, 2, "C")]
i8_3 = Annotated[IntArray, types.Array(types.int64, 3, "C")]
i4 = Annotated[IntArray, types.Array(types.int32, 1, "C")]
u8 = Annotated[NDArray[np.uint64], types.Array(types.uint64, 1, "C")]
u4 = Annotated[IntArray, types.Array(types.uint32, 1, "C")]
u4_2 = Annotated[IntArray, types.Array(types.uint32, 2, "C")]
u1 = Annotated[IntArray, types.Array(types.uint8, 1, "C")]
u1_2 = Annotated[IntArray, types.Array(types.uint8, 2, "C")]

WORD = ir.IntType(64)
NUMBERS = (int, float, np.number, np.bool_)


class RecordType(types.Type):
    """Numba type of a record class. fields : types by name; places : first word of each in the table"""

    def __init__(self, name: str, fields: dict[str, types.Type]):
        self.fields, words = fields, 0
        self.places: dict[str, int] = {}
        self.dtypes = {n: np.dtype(str(k.dtype)) for n, k in fields.items() if isinstance(k, types.Array)}
        for field, kind in fields.items():
            self.places[field] = words
            words += 1 + kind.ndim if isinstance(kind, types.Array) else 1
        text = ", ".join(f"{field}: {kind}" for field, kind in fields.items())
        super().__init__(name=f"{name}({hashlib.sha256(text.encode()).hexdigest()[:8]})")  # short symbols


class Record:
    """Arrays and numbers that kernels receive together. The annotations of a subclass declare the fields.

    Arrays must be in C order and of the declared type; the record keeps them alive. A record is constant, but
    the contents of its arrays may change.
    """

    kind: ClassVar[RecordType]
    classes: ClassVar[dict[RecordType, type["Record"]]] = {}  # by their types in kernels

    def __init_subclass__(cls, fields: dict[str, types.Type] | None = None):
        """Store the type in kernels; fields : replace the annotations of the class, if given."""
        if fields is None:
            fields = {name: numba_type(annotation) for name, annotation in cls.__annotations__.items()}
        cls.kind = RecordType(cls.__qualname__, fields)
        cls.classes[cls.kind] = cls

    def __init__(self, *values: Any, **named: Any):
        """Build the table from values of the fields, in the order of the fields or by name.

        Raises TypeError if a value is missing or of another type.
        """
        fields = self.kind.fields
        by_name = dict(zip(fields, values, strict=False)) | named
        if len(values) + len(named) != len(fields) or by_name.keys() != fields.keys():
            names = sorted(fields.keys() ^ by_name.keys()) or sorted(
                set(list(fields)[: len(values)]) & set(named)
            )
            raise TypeError(f"{type(self).__name__}: missing, unknown or given twice: {', '.join(names)}")
        self.__dict__ |= by_name
        words: list[int] = []
        for name, kind in fields.items():
            _add_words(words, by_name[name], kind, name, self.kind)
        self.words = np.array([word % 2**64 for word in words], np.uint64)
        self.address: int = self.words.__array_interface__["data"][0]

    def __reduce__(self) -> tuple[type[Self], tuple[Any, ...]]:
        """Rebuild the record when unpickled, as the addresses differ in another process."""
        return type(self), tuple(getattr(self, name) for name in self.kind.fields)

    def with_values(self, **changes: Any) -> Self:
        """Return a record with other values in some fields."""
        return type(self)(**({name: getattr(self, name) for name in self.kind.fields} | changes))

    @classmethod
    def absent(cls) -> Self:
        """Return a record whose arrays have no elements and whose numbers are zero."""
        return cls(*(empty(kind) for kind in cls.kind.fields.values()))


def empty(field: Any) -> Any:
    """Return the value of an absent field, given its annotation or its type in kernels."""
    kind = numba_type(field)
    if isinstance(kind, types.Array):
        return np.zeros((0,) * kind.ndim, str(kind.dtype))
    if isinstance(kind, RecordType):
        return Record.classes[kind].absent()
    return 0


def _add_words(words: list[int], value: Any, kind: types.Type, name: str, record_type: RecordType) -> None:
    """Append the table words of a value."""
    if isinstance(kind, types.Array):
        fits = isinstance(value, np.ndarray) and value.ndim == kind.ndim and value.flags.c_contiguous
        if not fits or value.dtype != record_type.dtypes[name]:
            actual = getattr(value, "dtype", type(value).__name__), getattr(value, "shape", ())
            raise TypeError(f"{name}: {actual[0]} {actual[1]}; expected {kind}")
        words += value.__array_interface__["data"][0], *value.shape
    elif isinstance(kind, RecordType):
        if getattr(value, "kind", None) is not kind:
            raise TypeError(f"{name}: {type(value).__name__}; expected {kind}")
        words.append(value.address)
    elif not isinstance(value, NUMBERS):
        raise TypeError(f"{name}: {type(value).__name__}; expected a number")
    else:
        words.append(struct.unpack("q", struct.pack("d", value))[0] if kind == types.float64 else int(value))


@intrinsic
def is_present(typing: Any, array: types.Array) -> tuple[Any, Callable[..., Any]]:
    """Return whether a field is present: whether its array has elements."""

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        size = member(context, builder, array, values[0], "nitems")
        return builder.icmp_signed("!=", size, ir.Constant(WORD, 0))

    return types.boolean(array), code


# --- numba extension: how compiled code reads records


@extending.typeof_impl.register(Record)
def _type_of(record: Record, context: Any) -> RecordType:
    return record.kind


@extending.unbox(RecordType)
def _unbox(kind: RecordType, record: Any, c: Any) -> extending.NativeValue:
    attribute = c.pyapi.object_getattr_string(record, "address")
    number = c.pyapi.long_as_ulonglong(attribute)
    c.pyapi.decref(attribute)
    return extending.NativeValue(number)


def read_field(context: Any, builder: Any, kind: RecordType, address: Any, name: str) -> Any:
    """Read a field. The table is constant, so a compiler may move the read out of a loop."""
    field, offset = kind.fields[name], kind.places[name]
    table = builder.inttoptr(address, WORD.as_pointer())

    def word(k: int) -> Any:
        number = builder.load(builder.gep(table, [ir.Constant(WORD, offset + k)]))
        number.set_metadata("invariant.load", builder.module.add_metadata([]))
        return number

    if not isinstance(field, types.Array):
        return builder.bitcast(word(0), ir.DoubleType()) if field == types.float64 else word(0)
    model, size = context.data_model_manager[field], np.dtype(str(field.dtype)).itemsize
    shape = [word(1 + k) for k in range(field.ndim)]
    strides = [ir.Constant(WORD, size)]
    for length in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], length))
    data = builder.inttoptr(word(0), context.get_data_type(field.dtype).as_pointer())
    # The members are written into a value. populate_array of numba.np.arrayobj goes through memory with three
    # times the code, and took a tenth of the compile time of all kernels.
    array = ir.Constant(model.get_value_type(), None)
    members = {
        "data": data,
        "itemsize": ir.Constant(WORD, size),
        "nitems": functools.reduce(builder.mul, shape),
    }
    for name, value in members.items():
        array = builder.insert_value(array, value, model.get_field_position(name))
    for name, values in (("shape", shape), ("strides", strides)):
        for k, value in enumerate(values):
            array = builder.insert_value(array, value, [model.get_field_position(name), k])
    return array


def register_records(extension: Any, model: type[Any], template: type[Any]) -> None:
    """Let compiled code read records, which it receives as addresses.

    extension, model, template : `numba.extending`, `PrimitiveModel` and `AttributeTemplate` of a compiler
    """

    @extension.register_model(RecordType)
    class Address(model):
        def __init__(self, manager: Any, kind: RecordType):
            super().__init__(manager, kind, WORD)

    @extension.infer_getattr
    class Fields(template):
        key = RecordType

        def generic_resolve(self, kind: RecordType, name: str) -> types.Type | None:
            return kind.fields.get(name)

    extension.lower_getattr_generic(RecordType)(read_field)


register_records(extending, extending.models.PrimitiveModel, AttributeTemplate)
