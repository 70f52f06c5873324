"""Runs that are measured: one at a time on the workers of a study, each result kept until it is read."""

import math
import shutil
from collections.abc import Callable, Iterable
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import h5py

from netfall.ground.errors import InputError
from netfall.ground.sources import TELLING, program_digest
from netfall.ground.stop import NEVER, StopRequest
from netfall.job.job import Job
from netfall.job.read import read_job
from netfall.study.pool import Pool, check_started, task_for, worker_command
from netfall.write.locks import claim, release


@dataclass(frozen=True)
class Series:
    """Runs of a job on so many ranks. place : folder of their results; profile : time the parts of a step"""

    job: Path
    ranks: int
    launcher: str
    place: Path
    profile: bool = False

    def run(self, settings: Iterable[list[str]], done: Callable, stop: StopRequest = NEVER) -> None:
        """Run the job with each of the settings, overrides; the next is taken when one is done.

        done(told, file) : what a worker tells of a run (`program.member`), and its result, open; None for one
        that did not come to its end

        Raises InputError if no worker can start.
        """
        left, result = iter(settings), self.place / "result.vtkhdf"

        def take(_):
            overrides = next(left, None)
            shutil.rmtree(self.place, ignore_errors=True)  # what the run before left
            if overrides is None:
                return None
            self.place.mkdir()
            return "", 0, task_for(self.job, overrides, result=result, profile=self.profile)

        def answered(_, told):
            if told["state"] != "finished":
                done(told, None)
                return
            with h5py.File(result, "r") as file:
                done(told, file)

        def died(_, why, again):
            if not again:
                done({"state": "failed", "exit_code": 1, "reason": why}, None)

        started = lambda told: check_started(told, self.ranks, program_digest(TELLING))
        command = worker_command(self.launcher, self.ranks)
        Pool(command, 1, math.inf, take, answered, died, started).run(stop)


@contextmanager
def place_of_series(table: Path):
    """A folder for the results of runs, as long as the name of the table that comes of them is reserved.

    Raises InputError if another process measures for this table.
    """
    table.parent.mkdir(parents=True, exist_ok=True)
    claimed, place = claim(table), table.with_name(f".{table.stem}.runs")
    try:
        yield place
    finally:
        shutil.rmtree(place, ignore_errors=True)
        release(claimed)


def dynamic_job(path: Path, overrides: list[str]) -> Job:
    """The job whose dynamic stage is measured. Raises InputError if it has none."""
    job = read_job(path, overrides)
    if job.dynamics is None:
        raise InputError(
            f"{path}: [dynamics] is missing: what is measured is the dynamic stage; add the section"
        )
    return job
