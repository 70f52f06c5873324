"""Tasks that run at once in this process, and whose nets a GPU advances together.

Each task has a thread, but only one runs at a time, until its net is to be advanced. So nothing that tasks
share is changed by two of them at once.
"""

import time
from collections.abc import Callable
from threading import Semaphore, Thread
from typing import Any

from netfall.gpu.stepper import Advance, Gpu, GpuNet


class Task:
    """A function in a thread that runs only during `resume`.

    net : to be advanced before the task can go on; result : of the function, once it has ended
    seconds : [s] of computing, with its share of what nets do together
    """

    def __init__(self, function: Callable[[Advance], Any]):
        """function : takes what advances a net, or waits if that is None"""
        self.net: GpuNet | None = None
        self.nets: set[GpuNet] = set()
        self.result: Any = None
        self.seconds = 0.0
        self.ended = False
        self._error: BaseException | None = None
        self._function, self._go, self._pause = function, Semaphore(0), Semaphore(0)
        Thread(target=self._run, daemon=True).start()

    def resume(self) -> None:
        """Run the task until its net is to be advanced, or to its end. Raises what the function raises."""
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
            net.leave()
        self.ended = True
        self._pause.release()


def run_together(
    gpu: Gpu, take: Callable[[bool], list[Any] | None], send: Callable[[Any, float], None]
) -> None:
    """Run tasks on a GPU until there are no more.

    take(waits) : returns new functions for `Task`, after a wait for one if asked for; None: no more
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
