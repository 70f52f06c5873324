"""Measured runs, one at a time, on the workers of a study. Each result is removed after it is read."""

import math
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py

from netfall.core.cache import program_digest
from netfall.core.errors import InputError
from netfall.core.launch import check_launcher
from netfall.core.timings import NEVER_STOP, StopFlag
from netfall.job.job import Job
from netfall.job.read import read_job
from netfall.post import messages
from netfall.results.locks import locked_output
from netfall.study.pool import WorkerPool, check_worker, worker_command, worker_task


@dataclass(frozen=True)
class RunSeries:
    """Runs of a job. place : folder of their results; profile : whether to time the parts of a step"""

    job: Path
    ranks: int
    launcher: str
    place: Path
    profile: bool = False

    def run(
        self,
        settings: Iterable[list[str]],
        done: Callable[[dict[str, Any], h5py.File | None], None],
        stop: StopFlag = NEVER_STOP,
    ) -> None:
        """Run the job with each setting, a list of overrides, one after another.

        done(outcomes, file) : receives the outcomes of a run (`driver.sample`) and its open result file,
            None for a run that did not finish

        Raises InputError if no worker can start.
        """
        result = self.place / "result.vtkhdf"

        def tasks() -> Iterator[tuple[str, int, dict[str, Any]]]:
            for overrides in settings:
                shutil.rmtree(self.place, ignore_errors=True)  # files of the last run
                self.place.mkdir()
                yield "", 0, worker_task(self.job, overrides, result=result, profile=self.profile)

        def answered(_: int, outcomes: dict[str, Any]) -> None:
            if outcomes["state"] != "finished":
                done(outcomes, None)
                return
            with h5py.File(result, "r") as file:
                done(outcomes, file)

        def died(_: int, why: str, again: bool) -> None:
            if not again:
                done({"state": "failed", "exit_code": 1, "reason": why}, None)

        def started(answer: dict[str, Any]) -> None:
            check_worker(answer, self.ranks, program_digest())

        command, queue = worker_command(self.launcher, self.ranks), tasks()
        WorkerPool(command, 1, math.inf, lambda _: next(queue, None), answered, died, started).run(stop)


@contextmanager
def series_folder(table: Path) -> Iterator[Path]:
    """Yield a folder for the results of runs, and lock the name of their table in the meantime.

    Raises InputError if another process measures for this table.
    """
    place = table.with_name(f".{table.stem}.runs")
    with locked_output(table):
        try:
            yield place
        finally:
            shutil.rmtree(place, ignore_errors=True)


def read_dynamic_job(path: Path, overrides: list[str], launcher: str, say: Callable[..., None]) -> Job:
    """Read a job whose dynamic stage is measured, and print its warnings.

    Raises InputError if it has no dynamic stage, or if the launcher cannot start ranks.
    """
    job = read_job(path, overrides)
    if job.dynamics is None:
        raise InputError(messages.NO_DYNAMICS(path=path))
    check_launcher(launcher)
    return job
