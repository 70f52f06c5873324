"""Ranks that persist and run one netfall command after another, which saves starts of processes.

    mpirun -n 3 python tests/standing_ranks.py

Each line of standard input is a task in JSON: working folder, arguments of `netfall`, whether standard error
goes to standard output, and additional environment variables. Each line of standard output answers one task:
exit code (255 if the ranks' codes differ), standard output and standard error. The end of input ends the
ranks. A single rank also performs the tasks that a study would give to workers of one rank, one by one.
"""

import contextlib
import io
import json
import os
import sys
import tempfile
import threading
from subprocess import PIPE, CompletedProcess, Popen
from unittest.mock import patch


class StandingRanks:
    """Handle of the ranks. A task starts them if they do not run."""

    def __init__(self, launch: list, environment: dict):
        """launch : the command that starts this file on the ranks"""
        self.launch, self.environment = [*map(str, launch), __file__], environment
        self.process, self.complaints = None, None

    def run(self, *arguments, cwd=None, timeout=300, one_stream=False, environment=None):
        """Run `netfall` with these arguments; return the finished process, as if it were a new one.

        one_stream : whether standard error goes to standard output
        """
        if self.process is None or self.process.poll() is not None:
            self._start()
        folder = os.fspath(cwd or os.getcwd())
        task = [folder, list(map(str, arguments)), one_stream, environment or {}]
        self.process.stdin.write(json.dumps(task) + "\n")
        self.process.stdin.flush()
        alarm = threading.Timer(timeout, self.process.kill)
        alarm.start()
        answer = self.process.stdout.readline()
        alarm.cancel()
        if not answer:
            code = self.process.wait()
            self.complaints.seek(0)
            return CompletedProcess(arguments, code or 1, "", f"the ranks ended: {self.complaints.read()}")
        return CompletedProcess(arguments, *json.loads(answer))

    def _start(self):
        self.stop()
        self.complaints = tempfile.TemporaryFile("w+")
        pipes = dict(stdin=PIPE, stdout=PIPE, stderr=self.complaints, text=True)
        self.process = Popen(self.launch, env=self.environment, **pipes)

    def stop(self):
        """End the ranks."""
        if self.process is not None:
            with contextlib.suppress(BrokenPipeError):
                self.process.stdin.close()
            self.process.wait(60)
            self.process.stdout.close()
            self.complaints.close()
            self.process = None


class LoudStream(io.StringIO):
    """Stream that also writes to standard error at once, because a rank that aborts cannot answer."""

    def write(self, text):
        sys.__stderr__.write(text)
        sys.__stderr__.flush()
        return super().write(text)


def call(folder: str, arguments: list[str], one_stream: bool, more: dict) -> tuple[int, str, str]:
    """Call netfall's `main` as a new process would; return exit code, output and errors."""
    from netfall.__main__ import main

    error, code = LoudStream(), 0
    out = error if one_stream else io.StringIO()
    os.chdir(folder)
    sys.argv = ["netfall", *arguments]
    variables = patch.dict(os.environ, more)
    with variables, contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
    return code, out.getvalue(), "" if one_stream else error.getvalue()


def run_tasks_here(pool, stop):
    """Let a worker's `run_tasks` perform the tasks of a pool in this process, without workers."""
    from netfall.driver import worker

    key = number = answers = None

    def next_task(_):
        nonlocal key, number
        key, number, task = (None if stop.is_set else pool.take(key)) or (None, None, None)
        return task and json.loads(json.dumps(task | {"number": number}))

    def take_answer(line, file, flush):
        nonlocal answers
        if answers is None:  # the worker has started
            answers = file
            pool.started(json.loads(line))
        else:
            answer = json.loads(line)
            pool.done(answer.pop("number"), answer)

    worker.next_task, worker.print = next_task, take_answer
    try:
        worker.run_tasks()
    finally:
        if answers is not None:
            answers.close()


def keep_workers_here():
    """Let pools run the tasks of workers of one rank in this process, unless another launcher starts them."""
    from netfall.core.launch import default_launcher
    from netfall.driver import compile
    from netfall.study.pool import WorkerPool, worker_command

    compile.compile_missing = lambda _: None  # each command compiles what it needs
    run_by_workers = WorkerPool.run
    here = [worker_command(launcher, 1) for launcher in (None, default_launcher())]
    WorkerPool.run = lambda pool, stop: (
        run_tasks_here(pool, stop) if pool.command in here else run_by_workers(pool, stop)
    )


def serve():
    """Work on tasks until there are no more."""
    from mpi4py import MPI

    from netfall.driver.worker import next_task

    if MPI.COMM_WORLD.size == 1:
        keep_workers_here()
    comm = MPI.COMM_WORLD.Dup()  # separates these messages from those of netfall
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # libraries that print by themselves
    while (task := next_task(comm)) is not None:
        codes, outs, errors = zip(*(comm.allgather(call(*task))))
        if comm.rank == 0:
            code = codes[0] if len({*codes}) == 1 else 255
            print(json.dumps([code, "".join(outs), "".join(errors)]), file=answers, flush=True)


if __name__ == "__main__":
    serve()
