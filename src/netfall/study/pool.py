"""Workers: ranks that stay (`netfall.worker`) and run the members of a study, each worker one at a time.

The engine is the launcher of MPI ranks: mpirun on one machine, srun in an allocation of Slurm. A worker is
told its tasks, and answers, through pipes: nobody else can reach it, it ends when the study does, however
that ends, and it waits asleep. (Libraries that keep such workers were tried: their sockets are open to the
network, their workers outlive a driver that was killed, a task that kills its worker comes back for ever.)
"""

import contextlib
import json
import os
import selectors
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable

from netfall.errors import InputError

LOOK = 0.2  # s between looks at the clock and at the wish to stop
END = 10.0  # s that a worker is given to end
TOLD = 200  # characters of what a worker said at its end


class Worker:
    """Some ranks, and the task that they have; `key` is that of their last one."""

    def __init__(self, command: list[str]):
        self.key = self.task = None
        self.since = 0.0
        self.complaints = tempfile.TemporaryFile("w+")
        try:
            self.process = subprocess.Popen(
                command,
                env=dict(os.environ),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self.complaints,
                start_new_session=True,  # an interrupt from the keyboard is for the study
            )
        except OSError as error:
            raise InputError(
                f"{command[0]}: {error.strerror}; give the command that starts MPI ranks here with --launcher"
            ) from None

    def give(self, key, number: int, task: dict) -> None:
        """A task, and the number of the member."""
        self.key, self.task, self.since = key, number, time.monotonic()
        with contextlib.suppress(BrokenPipeError):  # it has died: its silence tells
            self.process.stdin.write(json.dumps(task).encode() + b"\n")
            self.process.stdin.flush()

    def answer(self) -> dict | None:
        """The answer to the task, which has begun to come; None if the worker has died."""
        line = self.process.stdout.readline()
        with contextlib.suppress(ValueError):
            return json.loads(line)
        return None

    def last_words(self) -> str:
        """Why it has died, as far as it said so."""
        code = self.process.wait()
        self.complaints.seek(0)
        said = [line.strip() for line in self.complaints.read().splitlines() if line.strip()]
        told = next((line for line in said if line.startswith("netfall:")), said[-1] if said else "")
        ended = f"signal {-code}" if code < 0 else f"exit code {code}"
        return f"its worker ended with {ended}{': ' if told else ''}{told[:TOLD]}"

    def end(self, kill: bool = False) -> None:
        """Let it go; with `kill` in the middle of a task."""
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.close()
        if kill:
            self.process.terminate()
        try:
            self.process.wait(END)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()
        self.complaints.close()


def worker_command(launcher: list[str]) -> list[str]:
    """The words that start a worker. launcher : those that start something on its ranks"""
    return [*launcher, sys.executable, "-m", "netfall.worker"]


def run_tasks(
    command: list[str],
    count: int,
    take: Callable,
    done: Callable,
    died: Callable,
    time_limit: float,
    stop,
) -> None:
    """Have tasks done by `count` workers until there are no more, or `stop.wanted`.

    take(key) : the next task, (key, number, task), best one whose key a worker had last; None: no more
    done(number, answer) : an answer has come
    died(number, why, again) : a task ended its worker, or took longer than time_limit [s], then not `again`
    """
    workers: list[Worker] = []
    with selectors.DefaultSelector() as selector:
        try:
            while not stop.wanted:
                _hand_out(workers, selector, command, count, take)
                busy = [worker for worker in workers if worker.task is not None]
                if not busy:
                    return
                ready = {key.data for key, _ in selector.select(LOOK)}
                for worker in busy:
                    late = time.monotonic() - worker.since > time_limit
                    if worker in ready:
                        _hear(worker, workers, selector, done, died)
                    elif late:
                        _drop(worker, workers, selector, kill=True)
                        died(worker.task, f"took longer than time_limit = {time_limit:g} s", False)
        finally:
            for worker in workers:
                worker.end(kill=worker.task is not None)


def _hand_out(workers: list, selector, command: list[str], count: int, take: Callable) -> None:
    """A task for each worker that has none, and a worker for each task that is left."""
    idle = [worker for worker in workers if worker.task is None]
    while idle or len(workers) < count:
        worker = idle.pop() if idle else None
        next_one = take(worker and worker.key)
        if next_one is None:
            return
        if worker is None:
            worker = Worker(command)
            workers.append(worker)
            selector.register(worker.process.stdout, selectors.EVENT_READ, worker)
        worker.give(*next_one)


def _hear(worker: Worker, workers: list, selector, done: Callable, died: Callable) -> None:
    """Take an answer, or the death of a worker."""
    number, answer = worker.task, worker.answer()
    if answer is not None:
        worker.task = None
        done(number, answer)
        return
    why = worker.last_words()
    _drop(worker, workers, selector)
    died(number, why, True)


def _drop(worker: Worker, workers: list, selector, kill: bool = False) -> None:
    selector.unregister(worker.process.stdout)
    workers.remove(worker)
    worker.end(kill)
