"""Compilation of kernels: plain numba with one set of options.

There is no fast-math: sums keep their order, so the bits do not depend on the number of ranks. The error
model is that of numpy: a division by zero gives inf, not an exception.
"""

from functools import cached_property

from llvmlite import ir
from numba import cfunc, njit, types
from numba.extending import intrinsic

OPTIONS = {"error_model": "numpy"}
# Options of kernels that only kernels call: no Python and C wrappers, which take a third of the compile time.
INNER_OPTIONS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

kernel = njit(**OPTIONS, cache=True, no_cfunc_wrapper=True)  # called from Python and by kernels
inner_kernel = njit(**OPTIONS, **INNER_OPTIONS)  # called by kernels
part_of_kernel = njit(**OPTIONS, **INNER_OPTIONS, forceinline=True)  # always inlined into its caller


class Routine:
    """Kernel that other kernels call by its address (`call`); it returns an integer.

    It is compiled and optimised separately. If a large function were inlined in the calling loop, compilation
    would take longer. The code would also run slower, because of register pressure.
    """

    def __init__(self, function, kinds):
        """Store the function; kinds : types of its arguments, numbers and records."""
        self.function, self.kinds = function, kinds

    @cached_property
    def compiled(self):
        """C function, compiled or loaded on first use."""
        return cfunc(types.int64(*self.kinds), cache=True, **OPTIONS)(self.function)

    @property
    def address(self) -> int:
        """Address of the compiled function."""
        return self.compiled.address


def routine(*kinds):
    """Return a decorator that makes a function a `Routine`."""
    return lambda function: Routine(function, kinds)


def address_caller(result):
    """Return an intrinsic that calls the function at an address; result : its numba return type."""

    @intrinsic
    def call(typing, address, arguments):
        """Call with a tuple of numbers and records."""

        def code(context, builder, signature, values):
            arguments_ir = [builder.extract_value(values[1], k) for k in range(len(arguments))]
            kind = ir.FunctionType(
                context.get_value_type(result), [argument.type for argument in arguments_ir]
            )
            return builder.call(builder.inttoptr(values[0], kind.as_pointer()), arguments_ir)

        return result(types.uint64, arguments), code

    return call


call = address_caller(types.int64)
