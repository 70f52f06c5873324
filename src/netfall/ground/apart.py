"""Kernels that other kernels call by their address: compiled by themselves, and kept by themselves.

What a kernel calls is else a part of it, and all of it is compiled in one piece, by one processor. A call by
address cannot be joined with what is around it, and is for what is done once in many steps, or to many
particles at once.

What the called kernel works on is bound to its address. So the caller need not know of what kind that is, and
is compiled once for all scenes; where a scene has nothing to call, the call does nothing.
"""

from functools import cache, cached_property

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing import signature
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import lower_builtin, models, register_model, typeof_impl, unbox

from netfall.ground.handed import address_of, laid, types_of

ADDRESS = ir.IntType(64)


class Entry:
    """A kernel and what it works on. It is compiled, or loaded, when another one is first given it.

    kernel : of `compile.kernel_apart`, which gives nothing back; None: nothing is done
    kinds : types of its arguments, first of those of a call, then of what is `given` with the address: named
        tuples, or None
    """

    def __init__(self, kernel, *arguments, given=()):
        """arguments : like those of a call"""
        self.kernel, self.kinds = kernel, tuple(types_of((*arguments, *given)))
        self.given = list(map(laid, given, self.kinds[len(arguments) :]))
        self.type, self.begins = _met(kernel, self.kinds, len(arguments))

    def prepare(self) -> None:
        """Compile it, or load it."""
        if self.kernel is not None and not self.begins:
            self.begins.append(self.kernel.address_for(self.kinds))

    @cached_property
    def table(self) -> np.ndarray:
        """What kernels read: where it begins, 0 if nowhere, and where that stands which it is given."""
        self.prepare()
        addresses = [0 if one is None else one.address for one in self.given]
        return np.array([*(self.begins or [0]), *addresses], np.uint64)

    @property
    def address(self) -> int:
        """Where the table stands."""
        return self.table.ctypes.data

    def __call__(self, *arguments):
        """Where kernels run as plain Python."""
        if self.kernel is not None:
            self.kernel(*arguments, *self.given)


@cache
def _met(kernel, kinds: tuple, of_call: int) -> tuple:
    """Type of an entry, and a list of where the kernel begins, once that is known; for all that are alike.

    of_call : kinds that are of a call's arguments
    """
    return EntryType(kinds[:of_call], len(kinds) - of_call), []


class EntryType(types.Type):
    """Type of an `Entry`. kinds : types of a call's arguments; given : how many more there are"""

    def __init__(self, kinds, given):
        self.kinds, self.given = kinds, given
        super().__init__(f"Entry({', '.join(map(str, kinds))}; {given})")


@typeof_impl.register(Entry)
def _type_of_entry(entry, context):
    return entry.type


@register_model(EntryType)
class _Address(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, ADDRESS)


@unbox(EntryType)
def _unbox(kind, entry, c):
    return address_of(entry, c)


def call(entry, *arguments):
    """Call what begins there, if anything does; for kernels."""
    entry(*arguments)


@infer_global(call)
class _Call(AbstractTemplate):
    def generic(self, arguments, named):
        """Arguments become what the kernel was compiled for."""
        entry, *given = arguments
        if isinstance(entry, EntryType) and len(given) == len(entry.kinds):
            return signature(types.none, entry, *entry.kinds)
        return None


@lower_builtin(call, types.VarArg(types.Any))
def _lower_call(context, builder, signature, arguments):
    entry, *kinds = signature.args
    plain = context.call_conv.get_function_type(types.none, kinds)
    table = builder.inttoptr(arguments[0], ADDRESS.as_pointer())
    begins, *given = (
        builder.load(cgutils.gep(builder, table, k, inbounds=True)) for k in range(1 + entry.given)
    )
    function_type = ir.FunctionType(plain.return_type, [*plain.args, *[ADDRESS] * entry.given])
    result, error = (cgutils.alloca_once(builder, kind.pointee) for kind in plain.args[:2])
    packed = context.get_arg_packer(kinds).as_arguments(builder, arguments[1:])
    with builder.if_then(cgutils.is_not_null(builder, begins)):
        function = builder.inttoptr(begins, function_type.as_pointer())
        builder.call(function, [result, error, *packed, *given])
    return context.get_dummy_value()
