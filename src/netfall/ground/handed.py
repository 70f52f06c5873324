"""Named tuples that kernels hand on by their address.

numba takes a named tuple apart at each call, and puts it together again behind it: some hundred arrays of
seven numbers each, for a function that reads two of them. That was more than half of what a time loop was
compiled from. Here a kernel keeps what it is given in its frame, and functions that it calls get the address.
"""

import hashlib

from numba import types
from numba.core import cgutils
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    infer_getattr,
    lower_builtin,
    lower_cast,
    lower_getattr_generic,
    models,
    register_model,
    type_callable,
)


class Handed(types.Type):
    """Type of a named tuple that is handed on by its address. tuple_type : its type"""

    def __init__(self, tuple_type):
        self.tuple_type = tuple_type
        super().__init__(f"Handed{hashlib.sha256(str(tuple_type).encode()).hexdigest()[:16]}")

    @property
    def key(self):
        """What it is told from others by."""
        return self.tuple_type


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
