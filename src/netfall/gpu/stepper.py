"""Arrays of nets on the device, copies from and to the host, and launches that advance nets."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from threading import Barrier
from typing import Any

import numpy as np

from netfall.core.errors import InputError
from netfall.explicit.loop import LoopState
from netfall.gpu import kernels, messages, scalars
from netfall.gpu.layout import HOST_CHANGES, LOADS, filled_rows, layout, numbers_of, shapes_of, value_at
from netfall.gpu.target import Translator, cuda_module, is_simulated

FIRST_PLACES = 2  # first number of places for nets of equal shapes; it doubles each time
MEMORY_SHARE = 0.9  # share of the free memory of the device for nets; kernels also need some
THREADS = 128  # in a block
SIMULATED_THREADS = 3  # numba's simulator starts each as a Python thread
BARRIER_TIMEOUT_S = 600.0  # s that a simulated thread waits for the others


@cache
def advance_kernel(in_blocks: bool) -> Any:
    """Compile `kernels.advance` for the device. in_blocks : whether each net has one block"""
    cuda = cuda_module()
    return cuda.jit(make_translator(cuda, in_blocks).plain(kernels.advance))


def make_translator(cuda: Any, in_blocks: bool) -> Translator:
    """Return the translator of CPU kernels for `numba.cuda` or its simulator."""

    def plain(function: Callable[..., Any]) -> Any:
        return function

    compiled = plain if is_simulated() else cuda.jit(device=True)
    table, names = scalars.replacements(cuda, compiled)
    if is_simulated():  # blocks run one after another
        meet: Any = Barrier(SIMULATED_THREADS, timeout=BARRIER_TIMEOUT_S).wait
    elif in_blocks:
        meet = compiled(lambda: cuda.syncthreads())
    else:
        meet = compiled(lambda: cuda.cg.this_grid().sync())
    names |= {"cuda": cuda, "meet": meet, "IN_BLOCKS": in_blocks, "work_at": compiled(layout().work_at())}
    translator = Translator(compiled, table, names)
    translator.names["break_element"] = translator.translate(kernels.break_element)
    return translator


class NetArrays:
    """Arrays on the device of nets with equal shapes; see `layout`. They grow with the number of nets."""

    def __init__(self, shapes: tuple[tuple[int, ...], ...], most: int):
        """most : number of nets at once"""
        cuda, self.simulated, self._most = cuda_module(), is_simulated(), most
        self._to_device = np.copy if self.simulated else cuda.to_device
        self._allocate = np.zeros if self.simulated else cuda.device_array
        self._count, self._free = 0, list[int]()  # number of places, and free places
        self._shapes, self._grouped = shapes, tuple[Any, ...]()
        sizes = [np.dtype(str(leaf.kind.dtype)).itemsize for leaf in layout().arrays]
        self.net_bytes = sum(size * math.prod(shape) for size, shape in zip(sizes, shapes))
        self.arrays: list[Any] = [None] * len(shapes)
        self.loads: dict[int, np.ndarray] = {}  # on the host, by the place of the array
        self.reals, self.wholes = np.zeros((0, len(layout().reals))), np.zeros((0, len(layout().wholes)), int)

    @property
    def is_empty(self) -> bool:
        """Whether there is no net."""
        return len(self._free) == self._count

    @property
    def total_bytes(self) -> int:
        """Memory of all places."""
        return self._count * self.net_bytes

    def take_place(self, free_bytes: float) -> int | None:
        """Return a place for a net; None if the device lacks memory for another net."""
        if not self._free:  # while the arrays grow, the old arrays also exist
            most = min(self._most, free_bytes // self.net_bytes)
            count = int(min(max(FIRST_PLACES, 2 * self._count), most))
            if count <= self._count:
                return None
            self._enlarge(count)
        return self._free.pop()

    def give_back(self, place: int) -> None:
        """Release a place for another net."""
        self._free.append(place)

    def _enlarge(self, count: int) -> None:
        """Enlarge the arrays to `count` nets; existing nets keep their values."""
        for place, leaf in enumerate(layout().arrays):
            before, shape = self.arrays[place], (count, *self._shapes[place])
            self.arrays[place] = self._allocate(shape, str(leaf.kind.dtype))
            if self._count and before.size:
                self._copy(before, self.arrays[place][: self._count])
            if leaf.path in LOADS:
                self.loads[place] = np.resize(self.loads.get(place, np.zeros(1)), shape)
        self._grouped = tuple(
            tuple(self.arrays[place] for place in group) for group in layout().groups.values()
        )
        self.reals, self.wholes = (
            np.concatenate([old, np.zeros((count - self._count, old.shape[1]), old.dtype)])
            for old in (self.reals, self.wholes)
        )
        self._free += range(self._count, count)
        self._count = count

    def upload(self, net: int, work: LoopState) -> None:
        """Copy all arrays of a net to its place."""
        self.reals[net], self.wholes[net] = numbers_of(work)
        for _, host, device in self._shared(net, work):
            self._copy(host, device)

    def fetch(self, net: int, work: LoopState, prefix: str) -> None:
        """Copy back the arrays with paths that start with `prefix`, unless the host has newer values."""
        for path, host, device in self._shared(net, work, prefix):
            if path not in HOST_CHANGES:
                self._copy(device, host)

    def _shared(self, net: int, work: LoopState, prefix: str = "") -> Iterator[tuple[str, np.ndarray, Any]]:
        """Yield the paths and the filled rows of the arrays on both the host and the device."""
        for leaf, array in zip(layout().arrays, self.arrays):
            wanted = leaf.copied and leaf.path.startswith(prefix)
            host = value_at(work, leaf.path) if wanted else np.zeros(0)
            if host.size and (rows := filled_rows(leaf, work)) != 0:
                yield leaf.path, host[:rows], array[net] if rows is None else array[net, :rows]

    def launch(self, nets: list["GpuNet"], in_blocks: bool) -> None:
        """Advance nets by their orders, which then contain the work done."""
        for place, staged in self.loads.items():
            if staged.size:
                for net in nets:
                    staged[net.place] = value_at(net.work, layout().arrays[place].path)
                self._copy(staged, self.arrays[place])
        orders = np.array([net.order for net in nets], np.int64)
        lengths = np.array([net.lengths for net in nets])
        arguments = *map(self._to_device, (orders, lengths, self.reals, self.wholes)), self._grouped
        kernel, blocks = advance_kernel(in_blocks), len(nets)
        if not in_blocks:
            blocks = self._blocks(kernel, arguments, nets[0].work.particles.x.shape[1])
        kernel[blocks, SIMULATED_THREADS if self.simulated else THREADS](*arguments)
        self._copy(arguments[0], orders)
        for net, order in zip(nets, orders):
            net.order[:] = order

    def _blocks(self, kernel: Any, arguments: tuple[Any, ...], particles: int) -> int:
        """Return the number of blocks for one net: one for each THREADS particles, as long as all can run."""
        if self.simulated:
            return 1
        if not kernel.overloads:  # an order without steps compiles it
            orders, lengths, *others = arguments
            kernel[1, THREADS](self._to_device(np.zeros(orders.shape, np.int64)), lengths, *others)
        wanted = -(-particles // THREADS)
        (compiled,) = kernel.overloads.values()
        most: int = compiled.max_cooperative_grid_blocks(THREADS)
        return min(wanted, most)

    def _copy(self, source: Any, target: Any) -> None:
        """Copy an array between the host and the device, or on the device."""
        if self.simulated:
            target[...] = source
        elif isinstance(target, np.ndarray):
            source.copy_to_host(target)
        else:
            target.copy_to_device(source)


def free_memory() -> float:
    """Return the free memory of the device in bytes."""
    return float(cuda_module().current_context().get_memory_info().free)


@dataclass(eq=False)
class GpuNet:
    """One net: its place among those of equal shapes, and its next order.

    order : columns of `kernels`; lengths : before_dt to sample_dt of an `Interval`
    """

    arrays: NetArrays | None = None
    place: int = 0
    work: Any = None
    order: np.ndarray = field(default_factory=lambda: np.zeros(kernels.PENDING + 1, np.int64))
    lengths: tuple[float, ...] = ()

    def release(self) -> None:
        """Release the place on the device."""
        if self.arrays is not None:
            self.arrays.give_back(self.place)
        self.arrays = None


Advance = Callable[[GpuNet | None], None]  # None: wait until another net may have been released


class Gpu:
    """A GPU that advances up to `count` nets at once: each in one block, or a single net in all blocks."""

    def __init__(self, count: int = 1):
        self.count = count
        self._arrays: dict[tuple[Any, ...], NetArrays] = {}  # by shapes

    def could_hold(self, work: LoopState) -> bool:
        """Return whether a net fits in the memory, at least without the present nets."""
        own = sum(arrays.total_bytes for arrays in self._arrays.values())
        return NetArrays(shapes_of(work), 1).net_bytes <= MEMORY_SHARE * (free_memory() + own)

    def upload(self, net: GpuNet, work: LoopState) -> bool:
        """Copy a net to the device; return whether it fits.

        Raises InputError if it does not fit even without other nets.
        """
        shapes = shapes_of(work)
        if net.arrays is None or net.arrays is not self._arrays.get(shapes):
            net.release()
            if not self._take_place(net, shapes):
                return False
        assert net.arrays is not None
        net.work = work
        net.arrays.upload(net.place, work)
        return True

    def _take_place(self, net: GpuNet, shapes: tuple[tuple[int, ...], ...]) -> bool:
        needed = 0
        for _ in range(2):
            arrays = self._arrays.get(shapes) or NetArrays(shapes, self.count)
            place, needed = arrays.take_place(MEMORY_SHARE * free_memory()), arrays.net_bytes
            if place is not None:
                net.arrays, net.place, self._arrays[shapes] = arrays, place, arrays
                return True
            # again, without the arrays that no net needs any more
            self._arrays = {key: other for key, other in self._arrays.items() if not other.is_empty}
        if not self._arrays:
            raise InputError(messages.TOO_LARGE(needed=needed / MEMORY_SHARE / 1e9, free=free_memory() / 1e9))
        return False

    def advance(self, nets: list[GpuNet]) -> None:
        """Advance nets on the device by their orders."""
        for arrays in self._arrays.values():
            of_shapes = [net for net in nets if net.arrays is arrays]
            if of_shapes:
                arrays.launch(of_shapes, self.count > 1)
