"""How kernels are compiled: plain numba, with one set of options.

No fast-math: sums keep their order, so the bits do not depend on the number of ranks. numpy's error model: a
division by zero gives inf and not an exception.
"""

from functools import cached_property

from llvmlite import ir
from numba import cfunc, njit, types
from numba.extending import intrinsic

OPTIONS = {"error_model": "numpy"}
# For kernels alone: without the ways in from Python and C, which take a third of the time to compile.
INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

kernel = njit(**OPTIONS, cache=True, no_cfunc_wrapper=True)  # called from Python, and by kernels
inner_kernel = njit(**OPTIONS, **INNER)  # called by kernels
part_of_kernel = njit(**OPTIONS, **INNER, forceinline=True)  # a part of the loop that calls it


class Routine:
    """A kernel that others call by its address (`call`); it returns a whole number.

    It is compiled and optimised by itself. Within the loop that calls it a large function would take longer
    to compile and, by how registers are shared, longer to run.
    """

    def __init__(self, function, kinds):
        """kinds : types of its arguments: numbers and records"""
        self.function, self.kinds = function, kinds

    @cached_property
    def compiled(self):
        """The function as C calls it, compiled or loaded when it is first asked for."""
        return cfunc(types.int64(*self.kinds), cache=True, **OPTIONS)(self.function)

    @property
    def address(self) -> int:
        """Where it begins."""
        return self.compiled.address


def routine(*kinds):
    """Decorator that makes a function a `Routine`."""
    return lambda function: Routine(function, kinds)


def calling(result):
    """An intrinsic function that calls what begins at an address and returns a `result`, a type of numba."""

    @intrinsic
    def call(typing, address, arguments):
        """Call with a tuple of numbers and records."""

        def code(context, builder, signature, values):
            given = [builder.extract_value(values[1], k) for k in range(len(arguments))]
            kind = ir.FunctionType(context.get_value_type(result), [one.type for one in given])
            return builder.call(builder.inttoptr(values[0], kind.as_pointer()), given)

        return result(types.uint64, arguments), code

    return call


call = calling(types.int64)
