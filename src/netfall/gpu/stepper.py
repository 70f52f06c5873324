"""Launches of the kernel that advances a state, and the copies of its arrays on the device."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import types

from netfall.core.kernels import call
from netfall.core.records import RecordType, empty
from netfall.explicit.loop import Interval, LoopState
from netfall.gpu import kernels, scalars
from netfall.gpu.target import Translator, cuda_module, is_simulated, tuple_of

THREADS = 128  # in a block
SIMULATED_THREADS = 3  # numba's simulator starts each as a thread of Python

KINDS = (int, int, *[float] * 5, int, bool, int, bool)  # of the fields of an `Interval`


@cache
def advance_kernel() -> Any:
    """Compile `kernels.advance` for the device."""
    cuda = cuda_module()
    return cuda.jit(make_translator(cuda).plain(kernels.advance))


def make_translator(cuda: Any) -> Translator:
    """Return the translator of CPU kernels for `numba.cuda` or its simulator."""

    def plain(function: Callable[..., Any]) -> Any:
        return function

    compiled = plain if is_simulated() else cuda.jit(device=True)
    table, names = scalars.replacements(cuda, compiled)
    translator = Translator(compiled, table, names | {"cuda": cuda})
    translator.replace(call, translator.translate(kernels.break_element))
    return translator


class Stepper:
    """Copies of the arrays of a `LoopState` on the device, and the launches that advance them."""

    def __init__(self) -> None:
        self.cuda = cuda_module()
        self.simulated = is_simulated()
        self._threads = SIMULATED_THREADS if self.simulated else THREADS
        self.work: LoopState | None = None

    def run(self, interval: Interval, work: LoopState) -> tuple[int, int]:
        """Advance the state without history rows; return steps done and what `time_loop` returns second."""
        if work is not self.work:
            self._prepare(work)
        self._counts[:], self._result[:] = 0, 0
        for host, device in self._copies.values():
            self._copy(host, device)
        numbers = (kind(value) for kind, value in zip(KINDS, interval))  # of the types that are compiled
        advance_kernel()[self._blocks(), self._threads](Interval(*numbers), self._arguments)
        for host, device in self._copies.values():
            self._fetch(host, device)
        work.chunks.has_yielded[:] = work.law.plastic  # elements follow from slots only where this is set
        return int(self._result[kernels.DONE]), int(self._result[kernels.PENDING])

    def _prepare(self, work: LoopState) -> None:
        """Allocate the arrays on the device and arrange the arguments of the kernel."""
        self.work = work
        self._copies: dict[int, tuple[np.ndarray, Any]] = {}  # by the address of the array on the host
        self._counts, self._result = np.zeros(2, np.int64), np.zeros(2, np.int64)
        width = int(work.chunks.width[: work.chunks.owned].max(initial=0))
        fractures = work.fractures
        records = (work.particles, work.elements, work.slots, work.law, work.chunks, work.spare)
        more = (fractures.rules, fractures.events, work.relative)
        moved = (self._tuple(record, record.kind) for record in records + more)
        arrays = (np.zeros((0, 0)), self._counts, self._result)
        after = (self._on_device(array) for array in arrays)
        y = self._on_device(work.y)
        self._arguments = kernels.Work(int(work.traits), int(work.breaks), width, y, *moved, *after)

    def _blocks(self) -> int:
        """Return the number of blocks: one for each THREADS particles, as far as all can run at once."""
        if self.simulated:
            return 1
        assert self.work is not None
        kernel = advance_kernel()
        if not kernel.overloads:
            kernel[1, THREADS](Interval(0, 0, 0.0, 0.0, 0.0, 0.0, 1.0), self._arguments)
        (compiled,) = kernel.overloads.values()
        wanted = -(-self.work.particles.x.shape[1] // THREADS)
        most: int = compiled.max_cooperative_grid_blocks(THREADS)
        return min(wanted, most)

    def _tuple(self, record: Any, kind: RecordType) -> Any:
        """Return a record as a named tuple of numbers and of arrays on the device."""
        fields = []
        for name, field in kind.fields.items():
            value = getattr(record, name, empty(field))
            if isinstance(field, RecordType):
                fields.append(self._tuple(value, field))
            elif isinstance(field, types.Array):
                fields.append(self._on_device(value))
            else:
                fields.append(float(value) if field == types.float64 else int(value))
        return tuple_of(kind)(*fields)

    def _on_device(self, array: np.ndarray) -> Any:
        """Return the copy of an array on the device; arrays with elements are copied in each run."""
        if array.size == 0:
            return self._allocated(array)
        address = array.__array_interface__["data"][0]
        if address not in self._copies:
            self._copies[address] = array, self._allocated(array)
        return self._copies[address][1]

    def _allocated(self, array: np.ndarray) -> Any:
        return array.copy() if self.simulated else self.cuda.device_array(array.shape, array.dtype)

    def _copy(self, host: np.ndarray, device: Any) -> None:
        if self.simulated:
            device[...] = host
        else:
            device.copy_to_device(host)

    def _fetch(self, host: np.ndarray, device: Any) -> None:
        if self.simulated:
            host[...] = device
        else:
            device.copy_to_host(host)
