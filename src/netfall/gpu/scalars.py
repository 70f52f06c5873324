"""The operations of `core.vectors` for one number, on CUDA devices and in numba's simulator."""

import ctypes
import ctypes.util
import math
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from netfall.core import vectors
from netfall.core.records import is_present
from netfall.gpu.target import is_simulated

# --- the same in the simulator and on a device


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


def replacements(cuda: Any, compiled: Any) -> tuple[dict[Any, Any], dict[str, Any]]:
    """Return the replacements of the operations of `core.vectors`, and of names of any module.

    compiled : decorator of functions that kernels call
    """
    special = _in_simulator() if is_simulated() else _on_device(cuda, compiled)
    own = {name: special.pop(name) for name in ("product", "atomic_add", "atomic_max", "atomic_min")}
    table = {operation: compiled(function) for operation, function in SCALAR_FORMS.items()} | special
    # functions of Python return the first of equal numbers
    names = {"max": compiled(lambda a, b: b if b > a else a), "min": compiled(lambda a, b: b if b < a else a)}
    return table, own | names | {"LANES": 1}


def _in_simulator() -> dict[Any, Any]:
    library = ctypes.PyDLL(ctypes.util.find_library("m"))  # no other thread runs during a call
    library.fma.restype, library.fma.argtypes = ctypes.c_double, [ctypes.c_double] * 3

    def fma(a: Any, b: Any, c: Any) -> Any:
        return np.float64(library.fma(a, b, c))

    atomic = import_module("numba.cuda.simulator.kernelapi").FakeCUDAAtomic()
    return {
        vectors.fma: fma,
        vectors.sqrt: np.sqrt,
        vectors.bits_of: lambda a: np.float64(a).view(np.int64),
        vectors.number_of: lambda a: np.int64(a).view(np.float64),
        "product": lambda a, b: a * b,
        "atomic_add": atomic.add,
        "atomic_max": atomic.max,
        "atomic_min": atomic.min,
    }


def _on_device(cuda: Any, compiled: Any) -> dict[Any, Any]:
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

    return {
        vectors.fma: compiled(lambda a, b, c: cuda.fma(a, b, c)),
        vectors.sqrt: math.sqrt,
        vectors.bits_of: compiled(lambda a: libdevice.double_as_longlong(a)),
        vectors.number_of: compiled(lambda a: libdevice.longlong_as_double(a)),
        "product": product,
        "atomic_add": compiled(lambda array, index, value: cuda.atomic.add(array, index, value)),
        "atomic_max": compiled(lambda array, index, value: cuda.atomic.max(array, index, value)),
        "atomic_min": compiled(lambda array, index, value: cuda.atomic.min(array, index, value)),
    }
