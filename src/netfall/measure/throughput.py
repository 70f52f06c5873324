"""`netfall scale STUDY`: runs a minute against workers.

The members are those that share form, rest and gust model with the first one. What each worker does once, its
start and what is shared, is left out: the clock runs from the answer with which each may have had one.
"""

import itertools
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from netfall.ground.errors import InputError
from netfall.ground.stop import NEVER
from netfall.measure import tables
from netfall.study.file import Plan, read_plan
from netfall.study.pool import Pool, worker_command
from netfall.study.runs import Queue, task_of

RUNS = 16  # of each worker, the first one left out


def measure(plan: Plan, numbers: list[int], workers: int, launcher: str | None) -> tuple[float, float]:
    """Run members on so many workers: runs a minute, and the median over the members of their seconds over
    those of their dynamic stages.
    """
    answered, ratios, left = [], [], iter(numbers)

    def take(last):
        number = next(left, None)
        return None if number is None else ("", number, task_of(plan, plan.member(number)))

    def done(number, told):
        if told["state"] != "finished":
            raise InputError(f"{plan.path}: run {number} ended as {told['state']}: {told['reason']}")
        answered.append(time.monotonic())
        ratios.append(told["seconds"] / told["dynamic_seconds"])

    def died(number, why, again):
        if not again:
            raise InputError(f"{plan.path}: run {number}: {why}")

    command = worker_command(launcher, plan.ranks)
    Pool(command, workers, plan.time_limit, take, done, died).run(NEVER)
    counted = answered[workers - 1 :]
    minute = 60.0 * (len(counted) - 1) / (counted[-1] - counted[0])
    return minute, float(np.median(ratios[workers:]))


def throughput(
    path: Path,
    workers: list[int],
    launcher: str | None,
    repeats: int,
    folder: Path,
    say: Callable[[str], None],
) -> list[Path]:
    """Measure each number of workers in turn, `repeats` times; print the table and write it. Its path.

    Raises InputError.
    """
    plan = read_plan(path)
    first = next(iter(Queue(plan, range(len(plan))).groups.values()))
    asked = (RUNS + 1) * max(workers)
    numbers = list(itertools.islice(itertools.cycle(first), asked))
    measured: dict[int, list] = {count: [] for count in workers}  # (minute, ratio) of each sitting
    for _ in range(repeats):
        for count in workers:
            measured[count].append(measure(plan, numbers[: (RUNS + 1) * count], count, launcher))
    rows = [_row(count, plan.ranks, measured[count], measured[workers[0]]) for count in workers]
    head = ["workers", "runs a minute", "times the first", "a run over its dynamic stage"]
    how = {"workers": "d", "runs_a_minute": ".1f", "times_the_first": ".2f", "run_over_dynamic_stage": ".2f"}
    for line in tables.as_text(head, [[format(row[name], how[name]) for name in how] for row in rows]):
        say(line)
    folder.mkdir(parents=True, exist_ok=True)
    return [tables.write_csv(rows, folder / f"{path.stem}_throughput.csv")]


def _row(workers: int, ranks: int, mine: list, first: list) -> dict:
    """The medians of one number of workers; compared with the first of each sitting, one beside the other."""
    median = lambda values: float(np.median(list(values)))
    return {
        "workers": workers,
        "ranks": ranks,
        "runs_a_minute": median(minute for minute, _ in mine),
        "times_the_first": median(minute / one for (minute, _), (one, _) in zip(mine, first)),
        "run_over_dynamic_stage": median(ratio for _, ratio in mine),
    }
