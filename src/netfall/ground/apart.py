"""Kernels that other kernels call by their address: compiled by themselves, and kept by themselves.

What a kernel calls is else a part of it, and all of it is compiled in one piece, by one processor. A call by
address cannot be joined with what is around it, and is for what is done once in many steps, or to many
particles at once.
"""

import hashlib
from functools import cached_property

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing import signature
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import lower_builtin, models, register_model, typeof_impl, unbox

from netfall.ground.handed import address_of, handed, types_of


class Entry:
    """Where a kernel begins that is compiled for arguments like some. It is when a kernel is first given it.

    kernel : of `compile.kernel_apart`, which gives nothing back; kinds : types of its arguments
    """

    def __init__(self, kernel, *arguments):
        self.kernel, self.kinds = kernel, tuple(map(handed, types_of(arguments)))

    @cached_property
    def address(self) -> int:
        """Where it begins, when it is compiled, or loaded."""
        return self.kernel.address_for(self.kinds)

    def prepare(self) -> None:
        """Compile it, or load it."""
        self.address  # noqa: B018

    def __call__(self, *arguments):
        """Where kernels run as plain Python."""
        self.kernel(*arguments)


class EntryType(types.Type):
    """Type of an `Entry`. kinds : types of its arguments"""

    def __init__(self, kinds):
        self.kinds = kinds
        super().__init__(f"Entry{hashlib.sha256(str(kinds).encode()).hexdigest()[:16]}")

    @property
    def key(self):
        """What it is told from others by."""
        return self.kinds


@typeof_impl.register(Entry)
def _type_of_entry(entry, context):
    return EntryType(entry.kinds)


@register_model(EntryType)
class _Address(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, ir.IntType(64))


@unbox(EntryType)
def _unbox(kind, entry, c):
    return address_of(entry, c)


def call(entry, *arguments):
    """Call what begins there; for kernels."""
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
    kinds = signature.args[1:]
    function_type = context.call_conv.get_function_type(types.none, kinds)
    result, error = (cgutils.alloca_once(builder, kind.pointee) for kind in function_type.args[:2])
    packed = context.get_arg_packer(kinds).as_arguments(builder, arguments[1:])
    builder.call(builder.inttoptr(arguments[0], function_type.as_pointer()), [result, error, *packed])
    return context.get_dummy_value()
