"""Simultaneous tasks in this process, with nets that a GPU advances together.

Each task has a thread, but only one runs at a time, until its net must be advanced. Two tasks therefore never
change shared data at once.
"""

import time
from collections.abc import Callable
from threading import Semaphore, Thread
from typing import Any

from netfall.gpu.stepper import Advance, Gpu, GpuNet


class Task:
    """A function in a thread that runs only during `resume`.

    net : to be advanced before the task can continue; result : of the function, after its end
    seconds : [s] of computing, with its share of the common launches
    """

    def __init__(self, function: Callable[[Advance], Any]):
        """function : receives a function that advances a net, or waits if the net is None"""
        self.net: GpuNet | None = None
        self.nets: set[GpuNet] = set()
        self.result: Any = None
        self.seconds = 0.0
        self.ended = False
        self._error: BaseException | None = None
        self._function, self._go, self._pause = function, Semaphore(0), Semaphore(0)
        Thread(target=self._run, daemon=True).start()

    def resume(self) -> None:
        """Run the task until its net must be advanced, or to its end. Raises the errors of the function."""
        self.net, begin = None, time.perf_counter()
        self._go.release()
        self._pause.acquire()
        self.seconds += time.perf_counter() - begin
        if self._error is not None:
            raise self._error

    def _advance(self, net: GpuNet | None) -> None:
        self.net = net
        if net is not None:
            self.nets.add(net)
        self._pause.release()
        self._go.acquire()

    def _run(self) -> None:
        self._go.acquire()
        try:
            self.result = self._function(self._advance)
        except BaseException as error:
            self._error = error
        for net in self.nets:
            net.release()
        self.ended = True
        self._pause.release()


def run_together(
    gpu: Gpu, take: Callable[[bool], list[Any] | None], send: Callable[[Any, float], None]
) -> None:
    """Run tasks on a GPU until there are no more.

    take(waits) : returns new functions for `Task`, after a wait for one if `waits`; None: no more
    send : takes the result of each, and its computing time [s]
    """
    tasks: list[Task] = []
    more = True
    while tasks or more:
        functions = take(not tasks) if more else []
        more = functions is not None
        tasks += map(Task, functions or [])
        for task in tasks:
            task.resume()
            if task.ended:
                send(task.result, task.seconds)
        tasks = [task for task in tasks if not task.ended]
        advanced, begin = [task for task in tasks if task.net is not None], time.perf_counter()
        gpu.advance([task.net for task in advanced if task.net is not None])
        for task in advanced:
            task.seconds += (time.perf_counter() - begin) / len(advanced)
