"""The operations of `core.vectors` for one number, on CUDA devices and in numba's simulator of them."""

import ctypes
import ctypes.util
import math
import operator
import threading
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from netfall.core import vectors
from netfall.core.records import is_present
from netfall.gpu.target import is_simulated

# --- the same in the simulator and on a device


def _load(array: Any, row: Any, p: Any) -> Any:
    return array[row, p] if array.ndim == 2 else array[p]


def _store_below(p: Any, high: Any, array: Any, row: Any, value: Any) -> None:
    if p < high:
        array[row, p] = value


def _store(array: Any, row: Any, p: Any, value: Any) -> None:
    if array.ndim == 2:
        array[row, p] = value
    else:
        array[p] = value


def _gather(array: Any, row: Any, other: Any, index: Any) -> Any:
    return array[row, other[index]]


def _index_in(array: Any, row: Any, p: Any) -> Any:
    return row, p


def _load_at(array: Any, index: Any) -> Any:
    return array[index]


def _store_at(array: Any, index: Any, value: Any) -> None:
    array[index] = value


def _load_or_repeat(array: Any, row: Any, p: Any, common: Any) -> Any:
    return array[row, p] if array.size != 0 else common[0]


def _load_mask(array: Any, row: Any, p: Any) -> Any:
    return array[row, p] != 0


def _load_mask_at(array: Any, index: Any) -> Any:
    return array[index] != 0


def _is_present(array: Any) -> Any:
    return array.size != 0


def _where(truth: Any, a: Any, b: Any) -> Any:
    return a if truth else b


def _maximum(a: Any, b: Any) -> Any:
    return a if a > b else b


def _minimum(a: Any, b: Any) -> Any:
    return a if a < b else b


def _later_maximum(a: Any, b: Any) -> Any:
    return b if b > a else a


def _later_minimum(a: Any, b: Any) -> Any:
    return b if b < a else a


def _zeros() -> float:
    return 0.0


def _nowhere() -> bool:
    return False


def _any_of(truth: Any) -> Any:
    return truth


def _as_number(a: Any) -> float:
    return float(a)


SCALAR_FORMS = {
    vectors.gather: _gather,
    vectors.load_or_repeat: _load_or_repeat,
    vectors.index_in: _index_in,
    vectors.load_at: _load_at,
    vectors.store_at: _store_at,
    vectors.particle_at: _load_at,
    vectors.load_mask: _load_mask,
    vectors.load_mask_at: _load_mask_at,
    vectors.store_below: _store_below,
    vectors.where: _where,
    vectors.maximum: _maximum,
    vectors.minimum: _minimum,
    vectors.zeros: _zeros,
    vectors.nowhere: _nowhere,
    vectors.any_of: _any_of,
    vectors.as_number: _as_number,
    is_present: _is_present,
}


def replacements(cuda: Any, compiled: Any) -> tuple[dict[Any, Any], dict[str, Any]]:
    """Return what stands for the operations of `core.vectors`, and for names of any module.

    compiled : decorator of functions that kernels call
    """
    special = _in_simulator() if is_simulated() else _on_device(cuda, compiled)
    own = {name: special.pop(name) for name in ("product", "atomic_add", "atomic_max", "atomic_min")}
    table = {operation: compiled(function) for operation, function in SCALAR_FORMS.items()} | special
    names = own | {"LANES": 1, "max": compiled(_later_maximum), "min": compiled(_later_minimum)}
    return table, names


def _in_simulator() -> dict[Any, Any]:
    library = ctypes.PyDLL(ctypes.util.find_library("m"))  # lets no other thread run during a call
    library.fma.restype, library.fma.argtypes = ctypes.c_double, [ctypes.c_double] * 3

    lock = threading.Lock()

    def fma(a: Any, b: Any, c: Any) -> Any:
        return np.float64(library.fma(a, b, c))

    def atomic(operation: Callable[[Any, Any], Any]) -> Callable[..., Any]:
        def change(array: Any, index: Any, value: Any) -> Any:
            with lock:
                before = int(array[index])
                array[index] = operation(array[index], value)
            return before

        return change

    return {
        vectors.fma: fma,
        vectors.sqrt: np.sqrt,
        vectors.load: _load,
        vectors.store: _store,
        vectors.bits_of: lambda a: np.float64(a).view(np.int64),
        vectors.number_of: lambda a: np.int64(a).view(np.float64),
        "product": lambda a, b: a * b,
        "atomic_add": atomic(operator.add),
        "atomic_max": atomic(max),
        "atomic_min": atomic(min),
    }


def _on_device(cuda: Any, compiled: Any) -> dict[Any, Any]:
    libdevice, types = import_module("numba.cuda.libdevice"), cuda.types
    overload = import_module("numba.cuda.extending").overload

    def load(array: Any, row: Any, p: Any) -> Any: ...

    def store(array: Any, row: Any, p: Any, value: Any) -> Any: ...

    def product(a: Any, b: Any) -> Any: ...

    # numba requires the same names and annotations of the arguments in both functions of an overload

    @overload(load, target="cuda")
    def load_of(array: Any, row: Any, p: Any) -> Any:
        def in_row(array: Any, row: Any, p: Any) -> Any:
            return array[row, p]

        def alone(array: Any, row: Any, p: Any) -> Any:
            return array[p]

        return in_row if array.ndim == 2 else alone

    @overload(store, target="cuda")
    def store_of(array: Any, row: Any, p: Any, value: Any) -> Any:
        def in_row(array: Any, row: Any, p: Any, value: Any) -> Any:
            array[row, p] = value

        def alone(array: Any, row: Any, p: Any, value: Any) -> Any:
            array[p] = value

        return in_row if array.ndim == 2 else alone

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
        vectors.load: load,
        vectors.store: store,
        vectors.bits_of: compiled(lambda a: libdevice.double_as_longlong(a)),
        vectors.number_of: compiled(lambda a: libdevice.longlong_as_double(a)),
        "product": product,
        "atomic_add": compiled(lambda array, index, value: cuda.atomic.add(array, index, value)),
        "atomic_max": compiled(lambda array, index, value: cuda.atomic.max(array, index, value)),
        "atomic_min": compiled(lambda array, index, value: cuda.atomic.min(array, index, value)),
    }
