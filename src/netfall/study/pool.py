"""Workers: ranks that stay (`netfall.program.worker`) and run members of a study, each worker one at a time.

The engine is the launcher of MPI ranks: mpirun on one machine, srun in an allocation of Slurm. A worker is
told its tasks, and answers, through pipes: nobody else can reach it, it ends when the study does, however
that ends, and it waits asleep. (Libraries that keep such workers were tried: their sockets are open to the
network, their workers outlive a driver that was killed, a task that kills its worker comes back for ever.)
"""

import contextlib
import ctypes
import json
import os
import resource
import selectors
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from netfall.ground.errors import InputError
from netfall.ground.launch import check_launcher, default_launcher

LOOK = 0.2  # s between looks at the clock and at the wish to stop
END = 10.0  # s that workers are given to end
START = 900.0  # s that a worker is given to start: in a queue's allocation it may have to wait
DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of Linux
DEATHS = 3  # of workers at one task, after which it is given up
STARTS = 3  # in a row that fail: then none will do
DESCRIPTORS, SPARE = 3, 64  # open files: of a worker here, and of all else
TOLD = 200  # characters of what a worker said at its end


def make_room_for(workers: int) -> None:
    """Raise the limit of open files as far as so many workers need it. Raises InputError if it is too low."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = DESCRIPTORS * workers + SPARE
    if hard != resource.RLIM_INFINITY and needed > hard:
        most = (hard - SPARE) // DESCRIPTORS
        raise InputError(
            f"{workers} workers at once need {needed} open files, and the limit is {hard} (ulimit -Hn): "
            f"expected --workers of {most} at most; run the others as parts (--shard)"
        )
    if soft != resource.RLIM_INFINITY and needed > soft:
        resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))


class Worker:
    """Some ranks, and the number of the task that they have; key : of their last one; given : all of it;
    ready : whether they have started.
    """

    def __init__(self, command: list[str]):
        self.key = self.task = self.given = None
        self.ready, self.since, self.heard = False, time.monotonic(), bytearray()
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
                preexec_fn=_end_with_the_study,
            )
        except OSError as error:
            raise InputError(
                f"{command[0]}: {error.strerror}; give the command that starts MPI ranks here with --launcher"
            ) from None

    def give(self, key, number: int, task: dict) -> None:
        """A task, and the number of the member."""
        self.key, self.task, self.given = key, number, (key, number, task)
        if self.ready:
            self.since = time.monotonic()
        rest = memoryview(json.dumps(task).encode() + b"\n")
        with contextlib.suppress(BrokenPipeError):  # it has died: its silence tells
            while rest:
                rest = rest[self.process.stdin.write(rest) :]

    def lines(self) -> list[bytes] | None:
        """What it has said since the last time, whole lines; None if it has died.

        What is no object of JSON its launcher has said.
        """
        more = os.read(self.process.stdout.fileno(), 1 << 20)
        self.heard += more
        *lines, rest = self.heard.split(b"\n") if b"\n" in more else (self.heard,)
        self.heard = bytearray(rest)
        return [line for line in lines if line.startswith(b"{")] if more else None

    def last_words(self) -> str:
        """Why it has died, as far as it said so."""
        code = self.process.wait()
        self.complaints.seek(0)
        said = [line.strip() for line in self.complaints.read().splitlines() if line.strip()]
        told = next((line for line in said if line.startswith("netfall:")), said[-1] if said else "")
        ended = f"signal {-code}" if code < 0 else f"exit code {code}"
        return f"its worker ended with {ended}{': ' if told else ''}{told[:TOLD]}"

    def let_go(self) -> None:
        """Tell it to end, in the middle of a task if it has one."""
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.close()
        if self.task is not None:
            self.process.terminate()

    def end(self, until: float) -> None:
        """Wait for its end, after `let_go`, until a time of the monotonic clock; then make an end of it."""
        try:
            self.process.wait(max(0.0, until - time.monotonic()))
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
        self.process.stdout.close()
        self.complaints.close()


def _end_with_the_study() -> None:
    """Have the system end this process, a worker that begins, when the study does, however that ends."""
    ctypes.CDLL(None).prctl(DEATH_SIGNAL, signal.SIGTERM)


def worker_command(launcher: str | None, ranks: int) -> list[str]:
    """The words that start a worker. launcher : of its ranks, with {ranks} in it; None: the usual one"""
    own = [sys.executable, "-m", "netfall.program.worker"]
    if launcher is None and ranks == 1:
        return own
    if launcher is None:  # workers share the cores
        launcher = default_launcher().replace("-n {ranks}", "--bind-to none -n {ranks}")
    check_launcher(launcher)
    return [*shlex.split(launcher.format(ranks=ranks)), *own]


def task_for(
    job: Path,
    overrides: list[str],
    removes: list[dict] = (),
    result: Path | None = None,
    profile: bool = False,
    net: bool = False,
    depth: float | None = None,
) -> dict:
    """What a worker is told of a run. result : file to write; profile : whether to time the parts of a step;
    net : whether to tell the net in its form in place of a run; depth : [m], of the outcome `sunk_area`
    """
    task = {"job": str(job), "overrides": overrides, "removes": removes, "result": result and str(result)}
    return task | {"profile": profile, "net": net, "depth": depth}


def check_started(told: dict, ranks: int, program: str) -> None:
    """Raises InputError where a worker that has started is not one of so many ranks of this program."""
    if told["ranks"] != ranks:
        raise InputError(
            f"--launcher: started {told['ranks']} ranks; expected a command that starts {{ranks}} of "
            f"them, here {ranks}"
        )
    if told["program"] != program:
        raise InputError("the program has changed meanwhile; start the command again to see what is valid")


@dataclass
class Pool:
    """Up to `count` workers, started by a command as they are needed.

    take(key) : the next task, (key, number, task), best one whose key a worker had last; None: no more
    done(number, answer) : an answer has come
    died(number, why, again) : a task ended its worker, and is given out `again`, up to DEATHS times; or took
    longer than time_limit [s]
    started : what a worker says when it has started
    """

    command: list[str]
    count: int
    time_limit: float
    take: Callable
    done: Callable
    died: Callable
    started: Callable = lambda told: None
    workers: list[Worker] = field(default_factory=list)
    deaths: Counter = field(default_factory=Counter)  # by the number of the task
    waiting: list[tuple] = field(default_factory=list)  # tasks that are given out again
    stillborn: int = 0  # workers in a row that ended before they had started

    def run(self, stop) -> None:
        """Have tasks done until there are no more, or `stop.wanted`. Raises InputError if none can start."""
        make_room_for(self.count)
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
                        else:
                            self._look_at_the_clock(worker)
        finally:
            for worker in self.workers:
                worker.let_go()
            until = time.monotonic() + END
            for worker in self.workers:
                worker.end(until)

    def _look_at_the_clock(self, worker: Worker) -> None:
        """End a worker that takes too long: for a task, or to start."""
        passed = time.monotonic() - worker.since
        if worker.ready and passed > self.time_limit:
            self._drop(worker)
            self.died(worker.task, f"took longer than time_limit = {self.time_limit:g} s", False)
        elif not worker.ready and passed > START:
            self._bury(worker, f"has not started in {START:g} s")

    def _hand_out(self) -> None:
        """A task for each worker that has none, and a worker for each task that is left."""
        idle = [worker for worker in self.workers if worker.task is None]
        while idle or len(self.workers) < self.count:
            worker = idle.pop() if idle else None
            task = self.waiting.pop() if self.waiting else self.take(worker and worker.key)
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
                self.deaths.pop(number, None)
                self.done(number, json.loads(line))
            else:
                self.started(json.loads(line))
                worker.ready, worker.since, self.stillborn = True, time.monotonic(), 0

    def _bury(self, worker: Worker, why: str = "") -> None:
        why = why or worker.last_words()
        self._drop(worker)
        self.stillborn = 0 if worker.ready else self.stillborn + 1
        if self.stillborn == STARTS:
            command = shlex.join(self.command)
            raise InputError(f"{command}: does not start: {why}; --launcher gives another way")
        self.deaths[worker.task] += 1
        again = self.deaths[worker.task] < DEATHS
        if again:
            self.waiting.append(worker.given)
        self.died(worker.task, why if again else f"{why}, {DEATHS} times", again)

    def _drop(self, worker: Worker) -> None:
        self.selector.unregister(worker.process.stdout)
        self.workers.remove(worker)
        worker.let_go()
        worker.end(time.monotonic() + END)
