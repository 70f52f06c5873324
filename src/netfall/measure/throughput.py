"""`netfall scale STUDY`: runs a minute against workers.

The members are those that share form, rest and gust model with the first one. What each worker does once, its
start and what is shared, is left out: the clock runs from the answer with which each may have had one.
"""

import csv
import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from netfall.ground.errors import InputError
from netfall.ground.stop import NEVER
from netfall.study.file import Plan, read_plan
from netfall.study.pool import Pool
from netfall.study.runs import Queue, task_of, worker_words
from netfall.study.study import net_key, pieces_of
from netfall.write.locks import whole

RUNS = 16  # of each worker, the first one left out


@dataclass
class Throughput:
    """One measurement: when answers came [s], and seconds of members and of their dynamic stages."""

    workers: int
    answered: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    dynamics: list[float] = field(default_factory=list)

    @property
    def minute(self) -> float:
        """Runs a minute."""
        counted = self.answered[self.workers - 1 :]
        return 60.0 * (len(counted) - 1) / (counted[-1] - counted[0])

    @property
    def overhead(self) -> float:
        """Median over the members of their seconds over those of their dynamic stages."""
        ratios = np.array(self.seconds) / np.array(self.dynamics)
        return float(np.median(ratios[self.workers :]))


def measure(plan: Plan, numbers: list[int], workers: int, launcher: str | None) -> Throughput:
    """Run members on so many workers."""
    found, left = Throughput(workers), iter(numbers)

    def take(last):
        number = next(left, None)
        return None if number is None else ("", number, task_of(plan, plan.member(number)))

    def done(number, told):
        if told["state"] != "finished":
            raise InputError(f"{plan.path}: run {number} ended as {told['state']}: {told['reason']}")
        found.answered.append(time.monotonic())
        found.seconds.append(told["seconds"])
        found.dynamics.append(told["dynamic_seconds"])

    def died(number, why, again):
        raise InputError(f"{plan.path}: run {number}: {why}")

    command = worker_words(launcher, plan.ranks)
    Pool(command, workers, plan.time_limit, take, done, died).run(NEVER)
    return found


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
    plan = read_plan(path, pieces_of, net_key)
    first = next(iter(Queue(plan, range(len(plan))).groups.values()))
    asked = (RUNS + 1) * max(workers)
    numbers = list(itertools.islice(itertools.cycle(first), asked))
    measured: dict[int, list[Throughput]] = {count: [] for count in workers}
    for _ in range(repeats):
        for count in workers:
            measured[count].append(measure(plan, numbers[: (RUNS + 1) * count], count, launcher))
    folder.mkdir(parents=True, exist_ok=True)
    table = folder / f"{path.stem}_throughput.csv"
    with whole(table) as place, place.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["workers", "ranks", "runs_a_minute", "times_the_first", "run_over_dynamic_stage"])
        say("workers  runs a minute  times the first  a run over its dynamic stage")
        for count in workers:
            minute, overhead = (
                float(np.median([getattr(each, name) for each in measured[count]]))
                for name in ("minute", "overhead")
            )
            # of each sitting, one number of workers beside the other
            pairs = zip(measured[count], measured[workers[0]])
            ratio = float(np.median([each.minute / one.minute for each, one in pairs]))
            rows.writerow([count, plan.ranks, f"{minute:.4g}", f"{ratio:.3f}", f"{overhead:.3f}"])
            say(f"{count:7d}  {minute:13.1f}  {ratio:15.2f}  {overhead:28.2f}")
    return [table]
