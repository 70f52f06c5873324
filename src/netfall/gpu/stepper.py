"""Copies of nets on the device, and launches that advance them."""

from collections.abc import Callable
from functools import cache
from threading import Condition, Thread, get_ident
from typing import Any
from weakref import WeakSet

import numpy as np

from netfall.core.errors import InputError
from netfall.explicit.loop import LoopState
from netfall.gpu import kernels, messages, scalars
from netfall.gpu.memory import INPUTS, REST, MemoryMap, address_of
from netfall.gpu.target import cuda_module, is_simulated

MEMORY_SHARE = 0.9  # share of the free memory of the device for nets; kernels also need some
THREADS = 128  # in a block


@cache
def advance_kernel(in_blocks: bool) -> Any:
    """Compile `kernels.advance` for the device. in_blocks : whether each net has one block"""
    cuda = cuda_module()
    return cuda.jit(scalars.make_translator(cuda, in_blocks).plain(kernels.advance))


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
    thread : that steps the net
    """

    def __init__(self) -> None:
        self.order = np.zeros(kernels.COLUMNS, np.int64)
        self.thread = get_ident()
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


class Gpu:
    """A GPU that advances a single net, in all blocks."""

    in_blocks = False

    def __init__(self) -> None:
        self.nets: WeakSet[GpuNet] = WeakSet()  # which have been on the device

    def upload(self, net: GpuNet, work: LoopState) -> None:
        """Copy a net to the device when it fits. Raises InputError if it does not fit without others."""
        while not net.allocate(work):
            if not any(other.memory.size for other in self.nets):
                needed = net.map.staged.size / MEMORY_SHARE
                raise InputError(messages.TOO_LARGE(needed=needed / 1e9, free=free_memory() / 1e9))
            self.advance(None)
        self.nets.add(net)
        net.upload()

    def advance(self, net: GpuNet | None) -> None:
        """Advance a net by its order. None: only wait until another net may have been released."""
        self.launch([net] if net else [])

    def launch(self, nets: list[GpuNet]) -> None:
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
        kernel[blocks, scalars.SIMULATED_THREADS if is_simulated() else THREADS](*arguments)
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


class Together(Gpu):
    """A GPU that advances the nets of several tasks at once, each net in one block.

    The tasks are threads, of which one runs until it waits for its net to be advanced. Then another one runs.
    So two tasks never change shared data at once. When all wait, the GPU advances their nets.
    """

    in_blocks = True

    def __init__(self, abort: Callable[[BaseException], None]):
        """abort : ends the process after an error, since the other tasks would wait for ever"""
        super().__init__()
        self._abort, self._turn = abort, Condition()
        self._started, self._ended, self._launches = 0, 0, 0
        self._waiting: list[GpuNet | None] = []

    def start(self, task: Callable[[], Any]) -> None:
        """Start a task."""
        self._started += 1
        Thread(target=self._run, args=(task,)).start()

    def join(self) -> None:
        """Wait for the ends of all tasks."""
        with self._turn:
            self._turn.wait_for(lambda: self._ended == self._started)

    def _run(self, task: Callable[[], Any]) -> None:
        with self._turn:
            try:
                task()
                for net in self.nets:
                    if net.thread == get_ident():
                        net.release()
                self._ended += 1
                self._launch_if_all_wait()
                self._turn.notify_all()
            except BaseException as error:
                self._abort(error)

    def advance(self, net: GpuNet | None) -> None:
        """Advance a net, see `Gpu.advance`, as soon as all tasks wait."""
        self._waiting.append(net)
        launches = self._launches
        self._launch_if_all_wait()
        self._turn.wait_for(lambda: self._launches > launches)

    def _launch_if_all_wait(self) -> None:
        if self._waiting and len(self._waiting) == self._started - self._ended:
            self.launch([net for net in self._waiting if net is not None])
            self._waiting.clear()
            self._launches += 1
            self._turn.notify_all()
