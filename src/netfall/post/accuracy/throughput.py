"""`netfall scale STUDY`: runs per minute against the number of workers.

The samples are those that share form, equilibrium and gust model with the first one. The start of a worker
and the computation of shared results are excluded: the clock starts with the answer by which each worker may
have had one.
"""

import itertools
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from netfall.core.errors import InputError
from netfall.core.stop import NEVER_STOP
from netfall.post import messages
from netfall.post.accuracy import tables
from netfall.study.file import Plan, read_study_plan
from netfall.study.pool import WorkerPool, worker_command
from netfall.study.runs import SampleQueue, sample_task

RUNS_PER_WORKER = 16  # measured runs per worker, without the first one


def measure(plan: Plan, numbers: list[int], workers: int, launcher: str | None) -> tuple[float, float]:
    """Run samples on so many workers, and return the runs per minute and a time ratio.

    The ratio is the median over the samples of their total time over that of the dynamic stage.
    """
    answered, ratios, remaining = [], [], iter(numbers)

    def take(last):
        number = next(remaining, None)
        return None if number is None else ("", number, sample_task(plan, plan.sample(number)))

    def done(number, told):
        if told["state"] != "finished":
            raise InputError(
                messages.SAMPLE_FAILED(
                    path=plan.path, number=number, state=told["state"], reason=told["reason"]
                )
            )
        answered.append(time.monotonic())
        ratios.append(told["seconds"] / told["dynamic_seconds"])

    def died(number, why, again):
        if not again:
            raise InputError(messages.WORKER_ENDED(path=plan.path, number=number, reason=why))

    command = worker_command(launcher, plan.ranks)
    WorkerPool(command, workers, plan.time_limit, take, done, died).run(NEVER_STOP)
    counted = answered[workers - 1 :]
    per_minute = 60.0 * (len(counted) - 1) / (counted[-1] - counted[0])
    return per_minute, float(np.median(ratios[workers:]))


def run_throughput(
    path: Path,
    workers: list[int],
    launcher: str | None,
    repeats: int,
    folder: Path,
    say: Callable[[str], None],
) -> list[Path]:
    """Measure each number of workers in turn, `repeats` times; print and write the table. Return its path.

    Raises InputError.
    """
    plan = read_study_plan(path)
    for note in plan.notes:
        say(note)
    shared = next(iter(SampleQueue(plan, range(len(plan))).groups.values()))
    run_count = (RUNS_PER_WORKER + 1) * max(workers)
    numbers = list(itertools.islice(itertools.cycle(shared), run_count))
    measured: dict[int, list] = {count: [] for count in workers}  # (runs per minute, ratio) of each repeat
    for _ in range(repeats):
        for count in workers:
            measured[count].append(measure(plan, numbers[: (RUNS_PER_WORKER + 1) * count], count, launcher))
    rows = [_row(count, plan.ranks, measured[count], measured[workers[0]]) for count in workers]
    head = ["workers", "runs a minute", "times the first", "a run over its dynamic stage"]
    formats = {
        "workers": "d",
        "runs_a_minute": ".1f",
        "times_the_first": ".2f",
        "run_over_dynamic_stage": ".2f",
    }
    for line in tables.as_text(
        head, [[format(row[name], formats[name]) for name in formats] for row in rows]
    ):
        say(line)
    folder.mkdir(parents=True, exist_ok=True)
    return [tables.write_csv(rows, folder / f"{path.stem}_throughput.csv")]


def _row(workers: int, ranks: int, results: list, reference: list) -> dict:
    """Return the medians for one number of workers; the speed is relative to the first, repeat by repeat."""
    minutes, ratios = np.transpose(results)
    reference_minutes, _ = np.transpose(reference)
    return {
        "workers": workers,
        "ranks": ranks,
        "runs_a_minute": float(np.median(minutes)),
        "times_the_first": float(np.median(minutes / reference_minutes)),
        "run_over_dynamic_stage": float(np.median(ratios)),
    }
