"""Compilation of kernels: plain numba with one set of options.

There is no fast-math: sums keep their order, so the bits do not depend on the number of ranks. The error
model is that of numpy: a division by zero gives inf, not an exception.

For mypy a kernel is the Python function behind the decorator, and an intrinsic takes and returns anything.
"""

from collections.abc import Callable
from functools import cached_property
from typing import Any, Protocol, TypeVar

import numba.extending
from llvmlite import ir
from numba import cfunc, njit, types

OPTIONS: dict[str, Any] = {"error_model": "numpy"}
# Options of kernels that only kernels call: no Python and C wrappers, which take a third of the compile time.
INNER_OPTIONS: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

Function = TypeVar("Function", bound=Callable[..., Any])


class Decorator(Protocol):
    """Decorator that keeps the type of the function."""

    def __call__(self, function: Function, /) -> Function:
        """Return the compiled function."""


numba_njit: Callable[..., Decorator] = njit  # the type annotations of numba lack some options
kernel = numba_njit(**OPTIONS, cache=True, no_cfunc_wrapper=True)  # called from Python and by kernels
inner_kernel = numba_njit(**OPTIONS, **INNER_OPTIONS)  # called by kernels
part_of_kernel = numba_njit(**OPTIONS, **INNER_OPTIONS, forceinline=True)  # always inlined into its caller
# Copied into the one kernel that calls it before types are inferred, and not compiled separately.
copied_kernel = numba_njit(**OPTIONS, **INNER_OPTIONS, inline="always")
# Generates code for a function of kernels. Calls omit its first argument, the typing context.
intrinsic: Callable[[Callable[..., Any]], Callable[..., Any]] = numba.extending.intrinsic


def numba_type(annotation: Any) -> types.Type:
    """Return the type in kernels for the annotation of a record's field.

    annotation : one of the kinds in `records`, a class of records, or the type in kernels itself
    """
    if hasattr(annotation, "__metadata__"):
        return annotation.__metadata__[0]
    return getattr(annotation, "kind", annotation)


def member(context: Any, builder: Any, kind: Any, array: Any, name: str) -> Any:
    """Return a member of an array in generated code: "data", "shape" or "nitems"."""
    return builder.extract_value(array, context.data_model_manager[kind].get_field_position(name))


class Routine:
    """Kernel that other kernels call by its address (`call`); it returns an integer.

    It is compiled and optimised separately. If a large function were inlined in the calling loop, compilation
    would take longer. The code would also run slower, because of register pressure.
    """

    def __init__(self, function: Callable[..., int], kinds: tuple[types.Type, ...]):
        """Store the function; kinds : types of its arguments, numbers and records."""
        self.function, self.kinds = function, kinds

    @cached_property
    def compiled(self) -> Any:
        """C function, compiled or loaded on first use."""
        return cfunc(types.int64(*self.kinds), cache=True, **OPTIONS)(self.function)

    @property
    def address(self) -> int:
        """Address of the compiled function."""
        return int(self.compiled.address)

    def address_if(self, needed: object) -> int:
        """Address of the compiled function if it is needed; otherwise 0, and nothing is compiled."""
        return self.address if needed else 0


def routine(*annotations: Any) -> Callable[[Callable[..., int]], Routine]:
    """Return a decorator that makes a function a `Routine`; annotations : of its arguments."""
    kinds = tuple(numba_type(annotation) for annotation in annotations)
    return lambda function: Routine(function, kinds)


def address_caller(result: types.Type) -> Callable[..., Any]:
    """Return an intrinsic that calls the function at an address; result : its numba return type."""

    @intrinsic
    def call(typing: Any, address: types.Type, arguments: types.Tuple) -> tuple[Any, Callable[..., Any]]:
        """Call with a tuple of numbers and records."""

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            arguments_ir = [builder.extract_value(values[1], k) for k in range(len(arguments))]
            kind = ir.FunctionType(
                context.get_value_type(result), [argument.type for argument in arguments_ir]
            )
            return builder.call(builder.inttoptr(values[0], kind.as_pointer()), arguments_ir)

        return result(types.uint64, arguments), code

    return call


call = address_caller(types.int64)
