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
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from netfall.errors import InputError

LOOK = 0.2  # s between looks at the clock and at the wish to stop
END = 10.0  # s that a worker is given to end
STARTS = 3  # in a row that fail: then none will do
TOLD = 200  # characters of what a worker said at its end


class Worker:
    """Some ranks, and the task that they have; key : of their last one; ready : whether they have started."""

    def __init__(self, command: list[str]):
        self.key = self.task = None
        self.ready, self.since, self.heard = False, 0.0, bytearray()
        self.complaints = tempfile.TemporaryFile("w+")
        try:
            self.process = subprocess.Popen(
                command,
                env=dict(os.environ),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self.complaints,
                bufsize=0,
                start_new_session=True,  # an interrupt from the keyboard is for the study
            )
        except OSError as error:
            raise InputError(
                f"{command[0]}: {error.strerror}; give the command that starts MPI ranks here with --launcher"
            ) from None

    def give(self, key, number: int, task: dict) -> None:
        """A task, and the number of the member."""
        self.key, self.task, self.since = key, number, time.monotonic()
        rest = memoryview(json.dumps(task).encode() + b"\n")
        with contextlib.suppress(BrokenPipeError):  # it has died: its silence tells
            while rest:
                rest = rest[self.process.stdin.write(rest) :]

    def lines(self) -> list[bytes] | None:
        """What it has said since the last time, whole lines; None if it has died."""
        more = os.read(self.process.stdout.fileno(), 1 << 20)
        self.heard += more
        *lines, rest = self.heard.split(b"\n") if b"\n" in more else (self.heard,)
        self.heard = bytearray(rest)
        return lines if more else None

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


@dataclass
class Pool:
    """Up to `count` workers, started by a command as they are needed.

    take(key) : the next task, (key, number, task), best one whose key a worker had last; None: no more
    done(number, answer) : an answer has come
    died(number, why, again) : a task ended its worker, or took longer than time_limit [s], then not `again`
    """

    command: list[str]
    count: int
    time_limit: float
    take: Callable
    done: Callable
    died: Callable
    workers: list[Worker] = field(default_factory=list)
    stillborn: int = 0  # workers in a row that ended before they had started

    def run(self, stop) -> None:
        """Have tasks done until there are no more, or `stop.wanted`. Raises InputError if none can start."""
        try:
            with selectors.DefaultSelector() as self.selector:
                while not stop.wanted:
                    self._hand_out()
                    busy = [worker for worker in self.workers if worker.task is not None]
                    if not busy:
                        return
                    ready = {key.data for key, _ in self.selector.select(LOOK)}
                    for worker in busy:
                        if worker in ready:
                            self._hear(worker)
                        elif time.monotonic() - worker.since > self.time_limit:
                            self._drop(worker, kill=True)
                            late = f"took longer than time_limit = {self.time_limit:g} s"
                            self.died(worker.task, late, False)
        finally:
            for worker in self.workers:
                worker.end(kill=worker.task is not None)

    def _hand_out(self) -> None:
        """A task for each worker that has none, and a worker for each task that is left."""
        idle = [worker for worker in self.workers if worker.task is None]
        while idle or len(self.workers) < self.count:
            worker = idle.pop() if idle else None
            task = self.take(worker and worker.key)
            if task is None:
                return
            if worker is None:
                worker = Worker(self.command)
                self.workers.append(worker)
                self.selector.register(worker.process.stdout, selectors.EVENT_READ, worker)
            worker.give(*task)

    def _hear(self, worker: Worker) -> None:
        """Take answers, or the death of a worker."""
        lines = worker.lines()
        if lines is None:
            self._bury(worker)
            return
        for line in lines:
            if worker.ready:
                number, worker.task = worker.task, None
                self.done(number, json.loads(line))
            worker.ready, self.stillborn = True, 0

    def _bury(self, worker: Worker) -> None:
        why = worker.last_words()
        self._drop(worker)
        self.stillborn = 0 if worker.ready else self.stillborn + 1
        if self.stillborn == STARTS:
            command = shlex.join(self.command)
            raise InputError(f"{command}: does not start: {why}; --launcher gives another way")
        self.died(worker.task, why, True)

    def _drop(self, worker: Worker, kill: bool = False) -> None:
        self.selector.unregister(worker.process.stdout)
        self.workers.remove(worker)
        worker.end(kill)
