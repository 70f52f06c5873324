"""Named tuples that kernels hand on by their address.

numba takes a named tuple apart at each call, and puts it together again behind it: some hundred arrays of
seven numbers each, for a function that reads two of them. That was more than half of what a time loop was
compiled from. Here a kernel keeps what it is given in its frame, and functions that it calls get the address.

Python too can hand one on by its address, when it is `laid` down in memory as kernels have it.
"""

import hashlib
import struct
from functools import cached_property

import numba
import numpy as np
from numba import types
from numba.core import cgutils
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_builtin,
    lower_cast,
    lower_getattr_generic,
    models,
    register_model,
    type_callable,
    typeof_impl,
    unbox,
)

# Of the flags of an array: in order of C, of Fortran, aligned, writable.
LAYOUT = 0x1 | 0x2 | 0x100 | 0x400
_TYPES: dict = {}  # that were met, by `_mark`


class Handed(types.Type):
    """Type of a named tuple that is handed on by its address. tuple_type : its type"""

    def __init__(self, tuple_type):
        self.tuple_type = tuple_type
        self.digest = hashlib.sha256(str(tuple_type).encode()).hexdigest()[:16]
        super().__init__(f"Handed{self.digest}")

    @property
    def key(self):
        """What it is told from others by."""
        return self.tuple_type

    def __hash__(self):
        return int(self.digest, 16)  # numba goes through all fields at each look into a dictionary


def handed(kind):
    """Type of what is of such a type when it is handed on."""
    return Handed(kind) if isinstance(kind, types.BaseNamedTuple) else kind


def whole(kind):
    """Type of what is handed on so: what `handed` was given."""
    return kind.tuple_type if isinstance(kind, Handed) else kind


@register_model(Handed)
class _Address(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, manager[kind.tuple_type].get_value_type().as_pointer())


@lower_cast(types.BaseNamedTuple, Handed)
def _keep(context, builder, kind, to, value):
    return cgutils.alloca_once_value(builder, value)


@lower_cast(Handed, types.BaseNamedTuple)
def _load(context, builder, kind, to, value):
    return impl_ret_borrowed(context, builder, to, builder.load(value))


def hand(value):
    """A named tuple by its address; within kernels alone."""
    return value


@type_callable(hand)
def _type_of_hand(context):
    return handed


@lower_builtin(hand, types.BaseNamedTuple)
def _hand(context, builder, signature, arguments):
    return _keep(context, builder, *signature.args, signature.return_type, *arguments)


@infer_getattr
class _Fields(AttributeTemplate):
    key = Handed

    def generic_resolve(self, kind, name):
        """Type of a field; of a tuple within the tuple its address too."""
        fields = kind.tuple_type.fields
        return handed(kind.tuple_type.types[fields.index(name)]) if name in fields else None


@lower_getattr_generic(Handed)
def _read_field(context, builder, kind, value, name):
    index = kind.tuple_type.fields.index(name)
    field = kind.tuple_type.types[index]
    if isinstance(field, types.NoneType):
        return context.get_dummy_value()
    place = cgutils.gep_inbounds(builder, value, 0, index)
    if isinstance(field, types.BaseNamedTuple):
        return place
    return impl_ret_borrowed(context, builder, field, builder.load(place))  # whoever has the tuple keeps it


class Laid:
    """A named tuple that kernels are given by its address. Arrays are the same, numbers those of the begin.

    kind : its type, `handed` on, where that is known
    """

    def __init__(self, value, kind=None):
        self.value, self.type = value, kind or Handed(type_of(value))

    @cached_property
    def memory(self) -> np.ndarray:
        """What stands there."""
        layout, numbers = [], []
        lay(self.value, layout, numbers)
        return np.frombuffer(struct.pack("".join(layout), *numbers), np.uint8)

    @cached_property
    def address(self) -> int:
        """Where it stands."""
        return self.memory.ctypes.data


def type_of(value):
    """numba's type of a value. Of what is like one that was met it is known: numba looks at each array."""
    mark = _mark(value)
    if mark not in _TYPES:
        _TYPES[mark] = numba.typeof(value)
    return _TYPES[mark]


def _mark(value):
    """What values of one type have in common."""
    if isinstance(value, tuple):
        return type(value), *map(_mark, value)
    if isinstance(value, np.ndarray):
        return value.dtype, value.ndim, value.flags.num & LAYOUT
    return getattr(value, "type", type(value))


def types_of(values) -> list:
    """The types of some values, named tuples `handed` on."""
    return [handed(type_of(value)) for value in values]


def laid(value, kind=None):
    """A named tuple as `Laid`, anything else as it is."""
    return Laid(value, kind) if isinstance(value, tuple) else value


def lay(value, layout: list, numbers: list) -> None:
    """Add what stands in memory for a value: its layout in the letters of `struct`, and the numbers.

    Of an array: its owner and Python object, which only those look at that count owners; size, size of an
    item, where it begins, shape and strides.
    """
    if isinstance(value, np.ndarray):
        layout.append(f"PPqqP{2 * value.ndim}q")
        begin = value.__array_interface__["data"][0]
        numbers += 0, 0, value.size, value.itemsize, begin, *value.shape, *value.strides
    elif isinstance(value, tuple):
        layout.append("0q")  # it begins and ends where numbers of eight bytes may
        for part in value:
            lay(part, layout, numbers)
        layout.append("0q")
    elif value is None:
        layout.append("P")
        numbers.append(0)
    elif isinstance(value, float):
        layout.append("d")
        numbers.append(value)
    elif isinstance(value, bool):
        layout.append("?")
        numbers.append(value)
    elif isinstance(value, int | np.integer):
        layout.append("q" if isinstance(value, int) else value.dtype.char)
        numbers.append(value)
    else:  # an entry
        layout.append("P")
        numbers.append(value.address)


@typeof_impl.register(Laid)
def _type_of_laid(laid, context):
    return laid.type


def address_of(thing, c) -> NativeValue:
    """The `address` of a Python object, for `unbox`."""
    address = c.pyapi.object_getattr_string(thing, "address")
    number = c.pyapi.long_as_ulonglong(address)
    c.pyapi.decref(address)
    return NativeValue(number, is_error=cgutils.is_not_null(c.builder, c.pyapi.err_occurred()))


@unbox(Handed)
def _unbox(kind, laid, c):
    address = address_of(laid, c)
    pointer = c.builder.inttoptr(address.value, c.context.get_value_type(kind))
    return NativeValue(pointer, is_error=address.is_error)
