"""Copies of nets on the device, and launches that advance them."""

from collections.abc import Callable
from functools import cache
from threading import Barrier, current_thread
from types import SimpleNamespace
from typing import Any
from weakref import WeakSet

import numpy as np

from netfall.core.errors import InputError
from netfall.explicit.loop import LoopState
from netfall.gpu import kernels, messages, scalars
from netfall.gpu.memory import INPUTS, REST, MemoryMap, NetMemory, address_of
from netfall.gpu.target import Translator, cuda_module, is_simulated, record_reader

MEMORY_SHARE = 0.9  # share of the free memory of the device for nets; kernels also need some
THREADS = 128  # in a block
SIMULATED_THREADS = 3  # numba's simulator starts each as a Python thread


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
        meet: Any = Barrier(SIMULATED_THREADS).wait
        thread: Any = lambda: current_thread().threadIdx.x  # type: ignore[attr-defined]
        threads: Any = lambda: SIMULATED_THREADS
        net: Any = lambda: current_thread().blockIdx.x  # type: ignore[attr-defined]
        cuda = SimpleNamespace(local=SimpleNamespace(array=np.zeros))
    elif in_blocks:
        meet = compiled(lambda: cuda.syncthreads())
        thread, threads = compiled(lambda: cuda.threadIdx.x), compiled(lambda: cuda.blockDim.x)
        net = compiled(lambda: cuda.blockIdx.x)
    else:
        meet = compiled(lambda: cuda.cg.this_grid().sync())
        thread, threads = compiled(lambda: cuda.grid(1)), compiled(lambda: cuda.gridsize(1))
        net = compiled(lambda: 0)
    names |= {"cuda": cuda, "meet": meet, "thread": thread, "threads": threads, "net_number": net}
    names |= {"net_at": record_reader(NetMemory.kind), "float64": np.float64}
    names |= dict.fromkeys(kernels.ABSENT, compiled(lambda *arguments: 0))
    names |= {"ScratchOfThread": kernels.ScratchOfThread}
    translator = Translator(compiled, table, names)
    for function in kernels.FUNCTIONS:
        names[getattr(function, "function", function).__name__] = translator.translate(function)
    return translator


def free_memory() -> float:
    """Return the free memory of the device in bytes."""
    context = cuda_module().current_context()
    if not is_simulated():
        context.deallocations.clear()
    return float(context.get_memory_info().free)


def copy(source: Any, target: Any) -> None:
    """Copy bytes between the host and the device, or on the device."""
    if not isinstance(target, np.ndarray):
        target.copy_to_device(source)
    elif isinstance(source, np.ndarray):  # in the simulator
        target[:] = source
    else:
        source.copy_to_host(target)


class GpuNet:
    """One net: its copy on the device, and the order of the next launch.

    order : columns of `kernels`; lengths : before_dt to sample_dt of an `Interval`
    """

    def __init__(self) -> None:
        self.order = np.zeros(kernels.COLUMNS, np.int64)
        self.lengths: tuple[float, ...] = ()
        self.map: Any = None
        self.release()

    def release(self) -> None:
        """Release the memory on the device."""
        self.memory: Any = np.zeros(0, np.uint8)

    def allocate(self, work: LoopState) -> bool:
        """Allocate memory for a net, and for the copy of a trial; return whether that is possible."""
        if self.map is not None and self.map.work is work and self.memory.size:
            return True
        self.map = MemoryMap(work)
        needed = self.map.staged.size
        if self.memory.size != needed:
            self.release()
            if needed > MEMORY_SHARE * free_memory():
                return False
            self.memory = (np.zeros if is_simulated() else cuda_module().device_array)(needed, np.uint8)
        if is_simulated():
            self.address = self.map.record_in(self.memory, self.map.net)
        else:
            self.address = self.memory.__cuda_array_interface__["data"][0]
            self.map.write_tables(self.address)
        return True

    def stage(self, last: int) -> None:
        """Copy the groups of arrays up to the last to the memory of the host."""
        for pairs in self.map.groups[: last + 1]:
            for array, place in pairs:
                place[...] = array

    def upload(self) -> None:
        """Copy all arrays and tables to the device."""
        self.stage(REST)
        copy(self.map.staged[: self.map.size], self.memory[: self.map.size])

    def fetch(self, group: int) -> None:
        """Copy a group of arrays from the device."""
        begin, end = self.map.bounds[group], self.map.bounds[group + 1]
        copy(self.memory[begin:end], self.map.staged[begin:end])
        for array, place in self.map.groups[group]:
            array[...] = place

    def fetch_array(self, array: np.ndarray) -> None:
        """Copy a single array from the device."""
        begin = self.map.offsets[address_of(array)]
        copy(self.memory[begin : begin + array.nbytes], array.view(np.uint8).reshape(-1))

    def revert(self) -> None:
        """Return to what the last trial saved."""
        copy(self.memory[self.map.size :], self.memory[self.map.bounds[REST] : self.map.bounds[REST + 1]])


Advance = Callable[[GpuNet | None], None]  # None: wait until another net may have been released


class Gpu:
    """A GPU that advances several nets at once, each in one block, or a single net in all blocks."""

    def __init__(self, in_blocks: bool = False):
        self.in_blocks = in_blocks
        self._nets: WeakSet[GpuNet] = WeakSet()

    def upload(self, net: GpuNet, work: LoopState) -> bool:
        """Copy a net to the device; return whether it fits.

        Raises InputError if it does not fit even without other nets.
        """
        if not net.allocate(work):
            if not any(other.memory.size for other in self._nets):
                needed = net.map.staged.size / MEMORY_SHARE
                raise InputError(messages.TOO_LARGE(needed=needed / 1e9, free=free_memory() / 1e9))
            return False
        self._nets.add(net)
        net.upload()
        return True

    def advance(self, nets: list[GpuNet]) -> None:
        """Advance nets by their orders, which then contain the work done."""
        if not nets:
            return
        orders, lengths = np.array([net.order for net in nets]), np.array([net.lengths for net in nets])
        for net in nets:
            net.stage(INPUTS)
        inputs = [net.map.net.inputs for net in nets]
        orders[1:, kernels.BEGIN] = np.cumsum([len(words) for words in inputs[:-1]])
        cuda, addresses = cuda_module(), tuple(net.address for net in nets)
        on_device = cuda.to_device(orders)
        tables = addresses if is_simulated() else cuda.to_device(np.array(addresses, np.uint64))
        arguments = on_device, cuda.to_device(lengths), cuda.to_device(np.concatenate(inputs)), tables
        kernel, blocks = advance_kernel(self.in_blocks), len(nets)
        if not self.in_blocks:
            blocks = _blocks(kernel, arguments, nets[0].map.work.particles.x.shape[1])
        kernel[blocks, SIMULATED_THREADS if is_simulated() else THREADS](*arguments)
        on_device.copy_to_host(orders)
        for net, order in zip(nets, orders):
            net.order[:] = order


def _blocks(kernel: Any, arguments: tuple[Any, ...], particles: int) -> int:
    """Return the number of blocks for one net: one for each THREADS particles, as long as all can run."""
    if is_simulated():
        return 1
    if not kernel.overloads:  # an order without steps compiles it
        orders, *others = arguments
        kernel[1, THREADS](cuda_module().to_device(np.zeros(orders.shape, np.int64)), *others)
    (compiled,) = kernel.overloads.values()
    most: int = compiled.max_cooperative_grid_blocks(THREADS)
    return min(-(-particles // THREADS), most)
