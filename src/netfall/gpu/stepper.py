"""Launches on the device that advance nets."""

from collections.abc import Callable
from functools import cache
from threading import Condition, Thread, get_ident
from typing import Any
from weakref import WeakSet

import numpy as np

from netfall.core.errors import InputError
from netfall.explicit.loop import LoopState
from netfall.gpu import kernels, memory, messages, scalars
from netfall.gpu.memory import GpuNet
from netfall.gpu.target import cuda_module

THREADS = 128  # in a block


@cache
def advance_kernel(in_blocks: bool) -> Any:
    """Compile `kernels.advance` for the device. in_blocks : whether each net has one block"""
    cuda = cuda_module()
    return cuda.jit(scalars.make_translator(cuda, in_blocks).plain(kernels.advance))


class Gpu:
    """A GPU that advances a net in all blocks, or the nets of several tasks at once, each in one block.

    The tasks are threads, of which one runs until it waits for its net to be advanced. Then another one runs.
    So two tasks never change shared data at once. When all wait, the GPU advances their nets.
    """

    def __init__(self, abort: Callable[[BaseException], None] | None = None):
        """abort : ends the process after an error, since other tasks would wait for ever; None: one net"""
        self.nets: WeakSet[GpuNet] = WeakSet()  # which have been on the device
        self._abort, self._turn = abort, Condition()
        self._running, self._launches = 0 if abort else 1, 0
        self._waiting: list[GpuNet | None] = []

    def start(self, task: Callable[[], Any]) -> None:
        """Start a task."""
        self._running += 1
        Thread(target=self._run, args=(task,)).start()

    def join(self) -> None:
        """Wait for the ends of all tasks."""
        with self._turn:
            self._turn.wait_for(lambda: self._running == 0)

    def _run(self, task: Callable[[], Any]) -> None:
        with self._turn:
            try:
                task()
                for net in self.nets:
                    if net.thread == get_ident():
                        net.release()
                self._running -= 1
                self._launch_if_all_wait()
                self._turn.notify_all()
            except BaseException as error:
                assert self._abort
                self._abort(error)

    def upload(self, net: GpuNet, work: LoopState) -> None:
        """Copy a net to the device when it fits. Raises InputError if it does not fit without others."""
        while not net.allocate(work):
            if not any(other.memory.size for other in self.nets):
                needed = net.staged.size / memory.MEMORY_SHARE
                raise InputError(messages.TOO_LARGE(needed=needed / 1e9, free=memory.free_memory() / 1e9))
            self.advance(None)
        self.nets.add(net)
        net.upload()

    def advance(self, net: GpuNet | None) -> None:
        """Advance a net by its order when all tasks wait. None: wait until another net may be released."""
        with self._turn:
            self._waiting.append(net)
            launches = self._launches
            self._launch_if_all_wait()
            self._turn.wait_for(lambda: self._launches > launches)

    def _launch_if_all_wait(self) -> None:
        if self._waiting and len(self._waiting) == self._running:
            self.launch([net for net in self._waiting if net is not None])
            self._waiting.clear()
            self._launches += 1
            self._turn.notify_all()

    def launch(self, nets: list[GpuNet]) -> None:
        """Advance nets by their orders, which then contain the work done."""
        if not nets:
            return
        for net in nets:
            net.stage(memory.INPUTS)
        orders, inputs = np.array([net.order for net in nets]), [net.net.inputs for net in nets]
        orders[1:, kernels.BEGIN] = np.cumsum([len(words) for words in inputs[:-1]])
        tables = np.array([net.address for net in nets], np.uint64)
        arguments = tuple(map(cuda_module().to_device, (orders, np.concatenate(inputs), tables)))
        kernel, blocks = advance_kernel(self._abort is not None), len(nets)
        if not self._abort:
            blocks = _blocks(kernel, arguments, nets[0].net.work.particles.x.shape[1])
        kernel[blocks, THREADS](*arguments)
        arguments[0].copy_to_host(orders)
        for net, order in zip(nets, orders):
            net.order[:] = order


def _blocks(kernel: Any, arguments: tuple[Any, ...], particles: int) -> int:
    """Return the number of blocks for one net: one for each THREADS particles, as long as all can run."""
    if not kernel.overloads:  # an order without steps compiles it
        orders, *others = arguments
        kernel[1, THREADS](cuda_module().to_device(np.zeros(orders.shape, np.int64)), *others)
    (compiled,) = kernel.overloads.values()
    most: int = compiled.max_cooperative_grid_blocks(THREADS)
    return min(-(-particles // THREADS), most)
