"""Workers: MPI ranks (`netfall.driver.worker`) that run one sample of a study after another.

The workers are started by the launcher of MPI ranks: mpirun on one machine, srun in an allocation of Slurm.
A worker receives tasks and answers through pipes. No other process can reach it. It ends whenever the study
ends, and uses no processor time while it waits. (Libraries for such workers open sockets to the network.
Their workers outlive a killed driver, and they repeat a task that kills its worker without limit.)
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
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from netfall.core.errors import InputError
from netfall.core.launch import check_launcher, default_launcher
from netfall.core.timings import StopFlag
from netfall.study import messages

POLL_S = 0.2  # s between checks of the clock and of the stop flag
END_TIMEOUT_S = 10.0  # s within which workers must end
START_TIMEOUT_S = 900.0  # s within which a worker must start; in an allocation of a queue it may have to wait
DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of Linux
MAX_WORKER_ENDS = 3  # number of workers that may die from a task before it counts as failed
STARTS = 3  # consecutive failed starts after which the study ends
DESCRIPTORS, SPARE = 3, 64  # number of open files in this process: per worker, and for all other purposes
MAX_QUOTED = 200  # largest number of characters that a message quotes from the output of an ended worker


def raise_file_limit(workers: int) -> None:
    """Raise the limit of open files as needed by the workers. Raises InputError if that is not possible."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = DESCRIPTORS * workers + SPARE
    if hard != resource.RLIM_INFINITY and needed > hard:
        most = (hard - SPARE) // DESCRIPTORS
        raise InputError(messages.TOO_MANY_FILES(workers=workers, needed=needed, limit=hard, most=most))
    if soft != resource.RLIM_INFINITY and needed > soft:
        resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))


class Worker:
    """The ranks of one worker, and their current tasks.

    tasks : by number of the sample; key : of the last task; since : times at which the tasks began [s]
    slots : allowed number of tasks at once; most : largest number so far; ready : whether it has started
    """

    def __init__(self, command: list[str], slots: int):
        self.key: str | None = None
        self.tasks: dict[int, tuple[Any, ...]] = {}
        self.since: dict[int, float] = {}
        self.slots, self.ready, self.begin, self.heard = slots, False, time.monotonic(), bytearray()
        self.most = 0
        self.complaints = tempfile.TemporaryFile("w+", errors="replace")
        try:
            self.process = subprocess.Popen(
                command,
                env=dict(os.environ),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self.complaints,
                bufsize=0,
                start_new_session=True,  # a keyboard interrupt must reach only the study
                preexec_fn=_end_with_parent,
            )
        except OSError as error:
            self.complaints.close()
            raise InputError(messages.NO_LAUNCHER(command=command[0], reason=error.strerror)) from None
        assert self.process.stdin and self.process.stdout  # pipes, as requested
        self.stdin, self.stdout = self.process.stdin, self.process.stdout

    def send(self, key: str | None, number: int, task: dict[str, Any]) -> None:
        """Send a task with the number of the sample, which the answer repeats."""
        self.key, self.tasks[number], self.since[number] = key, (key, number, task), time.monotonic()
        self.most = max(self.most, len(self.tasks))
        unsent = memoryview(json.dumps(task | {"number": number}).encode() + b"\n")
        with contextlib.suppress(BrokenPipeError):  # the worker has ended; `lines` detects it
            while unsent:
                unsent = unsent[self.stdin.write(unsent) :]

    def lines(self) -> list[bytearray] | None:
        """Return the complete lines since the last call; None if the worker has ended.

        Other lines than JSON objects come from the launcher and are ignored.
        """
        received = os.read(self.stdout.fileno(), 1 << 20)
        self.heard += received
        *lines, incomplete = self.heard.split(b"\n") if b"\n" in received else (self.heard,)
        self.heard = bytearray(incomplete)
        return [line for line in lines if line.startswith(b"{")] if received else None

    def end_reason(self) -> str:
        """Return why the worker ended, from its exit code and its last message."""
        code = self.process.wait()
        self.complaints.seek(0)
        output = [line.strip() for line in self.complaints.read().splitlines() if line.strip(" -\t")]
        message = next((line for line in output if line.startswith("error: ")), output[-1] if output else "")
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        return f"its worker ended with {how}{': ' if message else ''}{message[:MAX_QUOTED]}"

    def request_end(self) -> None:
        """Request the end of the worker, even in the middle of a task."""
        with contextlib.suppress(BrokenPipeError):
            self.stdin.close()
        if self.tasks:
            self.process.terminate()

    def end(self, until: float) -> None:
        """Wait for the end after `request_end`, until a time of the monotonic clock; then kill the worker."""
        try:
            self.process.wait(max(0.0, until - time.monotonic()))
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
        self.stdout.close()
        self.complaints.close()


def _end_with_parent() -> None:
    """Make the system end this process, a starting worker, when the study ends."""
    ctypes.CDLL(None).prctl(DEATH_SIGNAL, signal.SIGTERM)


def worker_command(launcher: str | None, ranks: int, device: str = "cpu") -> list[str]:
    """Return the command that starts a worker.

    launcher : of its ranks, with {ranks} in it; None: the default; device : of `gpu.plan.plan_maker`
    """
    worker = [sys.executable, "-m", "netfall.driver.worker", *([device] if device != "cpu" else [])]
    if launcher is None and ranks == 1:
        return worker
    if launcher is None:  # workers share the cores
        launcher = default_launcher().replace("-n {ranks}", "--bind-to none -n {ranks}")
    check_launcher(launcher)
    return [*shlex.split(launcher.format(ranks=ranks)), *worker]


def worker_task(
    job: Path,
    overrides: list[str],
    removes: Sequence[dict[str, Any]] = (),
    result: Path | None = None,
    profile: bool = False,
    net: bool = False,
    depth: float | None = None,
) -> dict[str, Any]:
    """Return the task of a worker for one run.

    result : file to write; profile : whether to time the parts of a step
    net : whether to return the form-found net instead of a run; depth : [m], of the outcome `sunk_area`
    """
    task = {"job": str(job), "overrides": overrides, "removes": removes, "result": result and str(result)}
    return task | {"profile": profile, "net": net, "depth": depth}


def check_worker(answer: dict[str, Any], ranks: int, program: str) -> None:
    """Check that a started worker has the right number of ranks and the same program. Raises InputError."""
    if answer["ranks"] != ranks:
        raise InputError(messages.WRONG_RANKS(started=answer["ranks"], expected=ranks))
    if answer["program"] != program:
        raise InputError(messages.OTHER_PROGRAM())


@dataclass
class WorkerPool:
    """Up to `count` workers, started by a command as needed.

    slots : largest number of tasks at once of a worker; a task that ended a worker is repeated alone
    take(key) : returns the next task, (key, number, task), preferably with the last key of a worker; None: no
    more tasks
    done(number, answer) : receives an answer
    died(number, why, again) : a task ended its worker, and is repeated if `again`, up to MAX_WORKER_ENDS
        times; or the task took longer than time_limit [s] times the number of simultaneous tasks
    started : receives the message of a started worker
    """

    command: list[str]
    count: int
    time_limit: float
    take: Callable[..., Any]
    done: Callable[..., Any]
    died: Callable[..., Any]
    started: Callable[..., Any] = lambda told: None
    slots: int = 1
    workers: list[Worker] = field(default_factory=list)
    ended_workers: Counter[Any] = field(default_factory=Counter)  # ended workers by number of the task
    waiting: list[tuple[Any, ...]] = field(default_factory=list)  # tasks to repeat
    failed_starts: int = 0  # consecutive workers that ended before they had started

    def run(self, stop: StopFlag) -> None:
        """Run tasks until none remain, or `stop.is_set`. Raises InputError if no worker can start."""
        raise_file_limit(self.count)
        try:
            with selectors.DefaultSelector() as self.selector:
                while not stop.is_set:
                    self._send_tasks()
                    busy = [worker for worker in self.workers if worker.tasks]
                    if not busy:
                        return
                    ready = {key.data for key, _ in self.selector.select(POLL_S)}
                    for worker in busy:
                        if worker in ready:
                            self._receive(worker)
                        else:
                            self._check_time(worker)
        finally:
            for worker in self.workers:
                worker.request_end()
            until = time.monotonic() + END_TIMEOUT_S
            for worker in self.workers:
                worker.end(until)

    def _check_time(self, worker: Worker) -> None:
        """End a worker that exceeds the time limit of a task, or of its start."""
        now = time.monotonic()
        at_once = min(worker.most, worker.slots)  # each task waits for the others
        late = [number for number, begin in worker.since.items() if now - begin > at_once * self.time_limit]
        if worker.ready and late:
            self._remove_worker(worker)
            times = f" times {at_once} runs at once" if at_once > 1 else ""
            self.waiting += [task for number, task in worker.tasks.items() if number not in late]
            for number in late:
                why = f"took longer than time_limit = {self.time_limit:g} s{times}"
                self.died(number, why, False)
        elif not worker.ready and now - worker.begin > START_TIMEOUT_S:
            self._remove_ended(worker, f"has not started in {START_TIMEOUT_S:g} s")

    def _send_tasks(self) -> None:
        """Send tasks to workers with free slots, idle ones first, and start workers for the other tasks."""
        while True:
            free = [worker for worker in self.workers if len(worker.tasks) < worker.slots]
            worker = min(free, key=lambda free_worker: len(free_worker.tasks), default=None)
            if (worker is None or worker.tasks) and len(self.workers) < self.count:
                worker = None
            elif worker is None:
                return
            alone = bool(self.waiting) and (worker is None or not worker.tasks)
            task = self.waiting.pop() if alone else self.take(worker and worker.key)
            if task is None:
                return
            if worker is None:
                worker = Worker(self.command, self.slots)
                self.workers.append(worker)
                self.selector.register(worker.stdout, selectors.EVENT_READ, worker)
            worker.slots = 1 if alone else self.slots
            worker.send(*task)

    def _receive(self, worker: Worker) -> None:
        """Process the answers of a worker, or its end."""
        lines = worker.lines()
        if lines is None:
            self._remove_ended(worker)
            return
        for line in lines:
            answer = json.loads(line)
            if worker.ready:
                number = answer.pop("number")
                del worker.tasks[number], worker.since[number]
                self.ended_workers.pop(number, None)
                self.done(number, answer)
            else:
                self.started(answer)
                worker.ready, self.failed_starts = True, 0
                worker.since = dict.fromkeys(worker.since, time.monotonic())

    def _remove_ended(self, worker: Worker, why: str = "") -> None:
        why = why or worker.end_reason()
        self._remove_worker(worker)
        self.failed_starts = 0 if worker.ready else self.failed_starts + 1
        if self.failed_starts == STARTS:
            command = shlex.join(self.command)
            raise InputError(messages.NO_START(command=command, reason=why))
        for number, task in worker.tasks.items():
            self.ended_workers[number] += 1
            again = self.ended_workers[number] < MAX_WORKER_ENDS
            if again:
                self.waiting.append(task)
            self.died(number, why if again else f"{why}, {MAX_WORKER_ENDS} times", again)

    def _remove_worker(self, worker: Worker) -> None:
        self.selector.unregister(worker.stdout)
        self.workers.remove(worker)
        worker.request_end()
        worker.end(time.monotonic() + END_TIMEOUT_S)
