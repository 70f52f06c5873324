"""Simultaneous tasks in this process, with nets that a GPU advances together."""

from collections.abc import Callable
from functools import partial
from threading import Condition, Thread
from typing import Any

from netfall.gpu.stepper import Advance, Gpu, GpuNet


class Together:
    """Tasks in threads, of which one runs until it waits for its net to be advanced. Then another one runs.

    So two tasks never change shared data at once. When all wait, the GPU advances their nets.
    abort : ends the process after an error, since the other tasks would wait for ever
    """

    def __init__(self, gpu: Gpu, abort: Callable[[BaseException], None]):
        self._gpu, self._abort, self._turn = gpu, abort, Condition()
        self._threads: list[Thread] = []
        self._ended, self._launches = 0, 0
        self._waiting: list[GpuNet | None] = []

    def start(self, function: Callable[[Advance], Any]) -> None:
        """Start a task; the function receives one that advances a net, or only waits if the net is None."""
        self._threads.append(Thread(target=self._run, args=(function,)))
        self._threads[-1].start()

    def join(self) -> None:
        """Wait for the ends of all tasks."""
        for thread in self._threads:
            thread.join()

    def _run(self, function: Callable[[Advance], Any]) -> None:
        nets: set[GpuNet] = set()
        with self._turn:
            try:
                function(partial(self._advance, nets))
                for net in nets:
                    net.release()
                self._ended += 1
                self._launch_if_all_wait()
            except BaseException as error:
                self._abort(error)

    def _advance(self, nets: set[GpuNet], net: GpuNet | None) -> None:
        if net is not None:
            nets.add(net)
        self._waiting.append(net)
        launches = self._launches
        self._launch_if_all_wait()
        self._turn.wait_for(lambda: self._launches > launches)

    def _launch_if_all_wait(self) -> None:
        if self._waiting and len(self._waiting) == len(self._threads) - self._ended:
            self._gpu.advance([net for net in self._waiting if net is not None])
            self._waiting.clear()
            self._launches += 1
            self._turn.notify_all()
