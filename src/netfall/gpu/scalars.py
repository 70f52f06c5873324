"""The operations of `core.vectors` for one number, on CUDA devices."""

import math
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from netfall.core import vectors
from netfall.core.records import is_present
from netfall.gpu import kernels
from netfall.gpu.memory import NetMemory
from netfall.gpu.target import Translator, record_reader


def _store(array: Any, row: Any, p: Any, value: Any) -> None:
    if array.ndim == 2:  # numba compiles only the line that is reached
        array[row, p] = value
    else:
        array[p] = value


def _store_below(p: Any, high: Any, array: Any, row: Any, value: Any) -> None:
    if p < high:
        array[row, p] = value


def _store_at(array: Any, index: Any, value: Any) -> None:
    array[index] = value


SCALAR_FORMS: dict[Any, Callable[..., Any]] = {
    vectors.load: lambda array, row, p: array[row, p] if array.ndim == 2 else array[p],
    vectors.store: _store,
    vectors.gather: lambda array, row, other, index: array[row, other[index]],
    vectors.load_or_repeat: lambda array, row, p, common: array[row, p] if array.size != 0 else common[0],
    vectors.index_in: lambda array, row, p: (row, p),
    vectors.load_at: lambda array, index: array[index],
    vectors.store_at: _store_at,
    vectors.particle_at: lambda other, index: other[index],
    vectors.load_mask: lambda array, row, p: array[row, p] != 0,
    vectors.load_mask_at: lambda array, index: array[index] != 0,
    vectors.store_below: _store_below,
    vectors.where: lambda truth, a, b: a if truth else b,
    vectors.maximum: lambda a, b: a if a > b else b,
    vectors.minimum: lambda a, b: a if a < b else b,
    vectors.zeros: lambda: 0.0,
    vectors.nowhere: lambda: False,
    vectors.any_of: lambda truth: truth,
    vectors.as_number: lambda a: float(a),
    is_present: lambda array: array.size != 0,
}


def make_translator(cuda: Any, in_blocks: bool) -> Translator:
    """Return the translator of CPU kernels for `numba.cuda`.

    in_blocks : whether a net has the threads of one block; otherwise one net has all threads
    """
    compiled = cuda.jit(device=True)
    special, names = device_operations(cuda, compiled, in_blocks)
    table = {operation: compiled(function) for operation, function in SCALAR_FORMS.items()} | special
    # functions of Python return the first of equal numbers
    names |= {
        "max": compiled(lambda a, b: b if b > a else a),
        "min": compiled(lambda a, b: b if b < a else a),
    }
    names |= {"LANES": 1, "float64": np.float64, "ScratchOfThread": kernels.ScratchOfThread}
    names |= {"net_at": record_reader(NetMemory.kind)}
    names |= dict.fromkeys(kernels.ABSENT, compiled(lambda *arguments: 0))
    translator = Translator(compiled, table, names)
    for function in kernels.FUNCTIONS:
        names[getattr(function, "function", function).__name__] = translator.translate(function)
    return translator


def device_operations(
    cuda: Any, compiled: Any, in_blocks: bool
) -> tuple[dict[Any, Callable[..., Any]], dict[str, Any]]:
    """Return operations by the intrinsic that they replace, and other names of kernels."""
    libdevice, types = import_module("numba.cuda.libdevice"), cuda.types
    overload = import_module("numba.cuda.extending").overload

    def product(a: Any, b: Any) -> Any: ...

    # numba requires the same names and annotations of the arguments in both functions of an overload
    @overload(product, target="cuda")
    def product_of(a: Any, b: Any) -> Any:
        def rounded(a: Any, b: Any) -> Any:
            return libdevice.dmul_rn(a, b)

        def exact(a: Any, b: Any) -> Any:
            return a * b

        return rounded if isinstance(a, types.Float) or isinstance(b, types.Float) else exact

    if in_blocks:
        places = lambda: cuda.blockIdx.x, lambda: cuda.threadIdx.x, lambda: cuda.blockDim.x
        meet = compiled(lambda: cuda.syncthreads())
    else:
        places = lambda: 0, lambda: cuda.grid(1), lambda: cuda.gridsize(1)
        meet = compiled(lambda: cuda.cg.this_grid().sync())
    return {
        vectors.fma: compiled(lambda a, b, c: cuda.fma(a, b, c)),
        vectors.sqrt: math.sqrt,
        vectors.bits_of: compiled(lambda a: libdevice.double_as_longlong(a)),
        vectors.number_of: compiled(lambda a: libdevice.longlong_as_double(a)),
    }, dict(zip(("net_number", "thread", "threads"), map(compiled, places))) | {
        "cuda": cuda,
        "meet": meet,
        "product": product,
    }
