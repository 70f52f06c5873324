"""`netfall scale STUDY`: runs per minute against the number of workers.

The samples have the form, equilibrium and gust model of the first sample. The start of a worker and the
computation of shared results are excluded: the clock starts with the answer after which each worker may have
had a sample.
"""

import itertools
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from netfall.core.errors import InputError
from netfall.core.timings import NEVER_STOP
from netfall.job.csv_table import write_table
from netfall.post import messages
from netfall.post.report.markdown import plain_table
from netfall.results.locks import whole
from netfall.study.file import Plan, read_study_plan
from netfall.study.pool import WorkerPool, worker_command
from netfall.study.study import SampleQueue, sample_task

RUNS_PER_WORKER = 16  # number of measured runs per worker, without the first run
COLUMNS = {  # printed column: its head and format
    "workers": ("workers", "d"),
    "runs_a_minute": ("runs a minute", ".1f"),
    "times_the_first": ("times the first", ".2f"),
    "run_over_dynamic_stage": ("a run over its dynamic stage", ".2f"),
}


def measure(plan: Plan, numbers: list[int], workers: int, launcher: str | None) -> tuple[float, float]:
    """Run samples on `workers` workers, and return the runs per minute and a time ratio.

    The ratio is the median over the samples of their total time over that of the dynamic stage.
    """
    answered, ratios = [], []
    tasks = (("", number, sample_task(plan, plan.sample(number))) for number in numbers)

    def done(number: int, told: dict[str, Any]) -> None:
        if told["state"] != "finished":
            path, state, reason = plan.path, told["state"], told["reason"]
            raise InputError(messages.SAMPLE_FAILED(path=path, number=number, state=state, reason=reason))
        answered.append(time.monotonic())
        ratios.append(told["seconds"] / told["dynamic_seconds"])

    def died(number: int, why: str, again: bool) -> None:
        if not again:
            raise InputError(messages.WORKER_ENDED(path=plan.path, number=number, reason=why))

    command = worker_command(launcher, plan.run.ranks)
    pool = WorkerPool(command, workers, plan.run.time_limit, lambda _: next(tasks, None), done, died)
    pool.run(NEVER_STOP)
    counted = answered[workers - 1 :]
    per_minute = 60.0 * (len(counted) - 1) / (counted[-1] - counted[0])
    return per_minute, float(np.median(ratios[workers:]))


def run_throughput(
    path: Path,
    workers: list[int],
    launcher: str | None,
    repeats: int,
    folder: Path,
    say: Callable[..., None],
) -> list[Path]:
    """Measure each number of workers in turn, `repeats` times; print and write the table. Return its path.

    The speed is relative to the first number of workers, repeat by repeat. Raises InputError.
    """
    plan = read_study_plan(path)
    say(*plan.notes)
    shared = itertools.cycle(next(iter(SampleQueue(plan, range(len(plan))).groups.values())))
    numbers = list(itertools.islice(shared, (RUNS_PER_WORKER + 1) * max(workers)))
    minutes, ratios = np.zeros((2, len(workers), repeats))
    for repeat, (k, count) in itertools.product(range(repeats), enumerate(workers)):
        samples = numbers[: (RUNS_PER_WORKER + 1) * count]
        minutes[k, repeat], ratios[k, repeat] = measure(plan, samples, count, launcher)
    medians = {"runs_a_minute": minutes, "times_the_first": minutes / minutes[0]}
    medians["run_over_dynamic_stage"] = ratios
    columns = {"workers": workers, "ranks": [plan.run.ranks] * len(workers)}
    columns |= {name: np.median(values, axis=1).tolist() for name, values in medians.items()}
    rows = zip(*(columns[name] for name in COLUMNS))
    heads, shapes = zip(*COLUMNS.values())
    say(*plain_table(list(heads), [list(map(format, row, shapes)) for row in rows]))
    table = folder / f"{path.stem}_throughput.csv"
    with whole(table) as temporary:
        write_table(temporary, columns)
    return [table]
