"""`netfall scale`: speed of a job's dynamic stage as a function of the number of ranks.

Strong scaling: the unchanged job on more ranks. Weak scaling: a constant number of elements per rank. The
dimensions of a generated net then grow at constant cable spacing; in a net from tables each element is
divided. The runs are interleaved, and the fastest run counts, because other load on a shared machine only
slows a run down.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from netfall.core.errors import InputError
from netfall.core.messages import count_of
from netfall.job.csv_table import write_table
from netfall.job.job import Job
from netfall.job.keys.schema import GENERATOR_KEYS
from netfall.post import messages
from netfall.post.accuracy.series import RunSeries, read_dynamic_job, series_folder
from netfall.post.plots import canvas
from netfall.post.report.markdown import plain_table
from netfall.results.locks import whole

# Keys of a generator that stay constant; the others grow with the square root of the area.
CONSTANT_KEYS = ("spacing", "halves", "ring_height", "ring_depth", "spoke_force", "hoop_force", "brace_force")
MULTIPLES = {"cells": 1, "hoops": 1, "spokes": 4}  # integer keys are multiples of these numbers
RATE = "element_steps_per_s"
PHASES = {
    "forces": "dynamics: forces",
    "exchange": "dynamics: exchange",
    "drift": "dynamics: positions",
    "rows": "dynamics: rows",
    "output": "dynamics: output",
}
RANK_STATISTICS = ("min", "mean", "max")  # statistics over the ranks for the time of each phase
COLUMNS = {  # column of the printed table: its head and format; the phases follow
    "kind": ("scaling", ""),
    "ranks": ("ranks", ""),
    "elements": ("elements", ""),
    "steps": ("steps", ""),
    "dynamics_s": ("seconds", ".3g"),
    RATE: ("element-steps/s", ".3g"),
    "speed_up": ("speed-up", ".2f"),
    "efficiency": ("efficiency", ".2f"),
}


def scale(
    path: Path,
    overrides: list[str],
    ranks: list[int],
    launcher: str,
    repeats: int,
    folder: Path,
    say: Callable[..., None],
) -> list[Path]:
    """Run the job on each number of ranks and print the table. Raises InputError.

    Returns the paths of the table and its picture, in `folder`.
    """
    job = read_dynamic_job(path, overrides, launcher, say)
    cases: list[tuple[str, int, list[str]]] = [("strong", count, []) for count in ranks]
    enlarged = [(count, enlarge_overrides(job, count / ranks[0])) for count in ranks]
    cases += [("weak", count, larger) for count, larger in enlarged if larger is not None]
    if len(cases) < 2 * len(ranks):
        say(messages.NO_WEAK_SCALING())
    csv = folder / f"{job.name}_scale.csv"
    with series_folder(csv) as place:
        best: dict[tuple[str, int], dict[str, Any]] = {}
        for repeat in range(repeats):
            for kind, count, larger in cases:
                if kind == "weak" and not larger:  # the job itself
                    best[kind, count] = best["strong", count] | {"kind": kind}
                    continue
                runs = RunSeries(path, count, launcher, place, profile=True)
                row = measure(kind, runs, [*overrides, *larger])
                say(
                    f"{kind}, {count_of(count, 'rank')}, run {repeat + 1} of {repeats}: "
                    f"{row['elements']} elements, {row['dynamics_s']:.3g} s, {row[RATE]:.3g} element-steps/s"
                )
                best[kind, count] = max(best.get((kind, count), row), row, key=lambda row: row[RATE])
        rows = list(best.values())
        compare(rows)
        head = [name for name, _ in COLUMNS.values()] + [f"{name} [%]" for name in PHASES]
        say(*plain_table(head, [_cells(row) for row in rows]))
        with whole(csv) as temporary:
            write_table(temporary, {name: [row[name] for row in rows] for name in rows[0]})
        return [csv, draw(job, rows, csv.with_suffix(".png"))]


def enlarge_overrides(job: Job, factor: float) -> list[str] | None:
    """Return overrides that make the net of a job `factor` times as large; None if that is impossible."""
    if factor == 1.0:
        return []
    if job.net.generator is None:
        return [f"net.subdivide={round(job.net.subdivide * factor)}"] if factor == round(factor) else None
    overrides, dimensions = [], getattr(job.net, job.net.generator)
    for key in GENERATOR_KEYS[job.net.generator]:
        if key not in CONSTANT_KEYS:
            value = getattr(dimensions, key) * math.sqrt(factor)
            value = MULTIPLES[key] * round(value / MULTIPLES[key]) if key in MULTIPLES else value
            overrides.append(f"net.{job.net.generator}.{key}={value!r}")
    return overrides


def measure(kind: str, runs: RunSeries, overrides: list[str]) -> dict[str, Any]:
    """Measure one run, and return its row. Raises InputError if it does not finish."""
    rows = []

    def done(answer: dict[str, Any], file: h5py.File | None) -> None:
        if file is None:
            ranks, state, reason = count_of(runs.ranks, "rank"), answer["state"], answer["reason"]
            error = messages.SCALING_RUN_FAILED(path=runs.job, ranks=ranks, state=state, reason=reason)
            raise InputError(error)
        rows.append({"kind": kind, "ranks": runs.ranks} | read_timing(file))

    runs.run([overrides], done)
    return rows[0]


def read_timing(file: h5py.File) -> dict[str, Any]:
    """Return the speed of a run, and the seconds [s] of the dynamic stage's phases."""
    seconds = file["provenance/timings"].attrs
    elements, steps = len(file["net/elements"]), int(file["provenance"].attrs["steps"])
    dynamics = float(seconds["dynamics"][2])
    row = {"elements": elements, "steps": steps, "dynamics_s": dynamics, RATE: elements * steps / dynamics}
    row |= {"speed_up": math.nan, "efficiency": math.nan}
    for name, phase in PHASES.items():
        for statistic, value in zip(RANK_STATISTICS, seconds[phase]):
            row[f"{name}_{statistic}_s"] = float(value)
    return row


def compare(rows: list[dict[str, Any]]) -> None:
    """Set the speed-up and efficiency of each row, relative to the smallest number of ranks of its kind."""
    for row in rows:
        first = min((other for other in rows if other["kind"] == row["kind"]), key=lambda row: row["ranks"])
        row["speed_up"] = row[RATE] / first[RATE]
        row["efficiency"] = row["speed_up"] * first["ranks"] / row["ranks"]


def shares(row: dict[str, Any], phase: str) -> list[float]:
    """Return the share of a phase in the dynamic stage [%]: least, mean and largest over the ranks."""
    return [100 * row[f"{phase}_{statistic}_s"] / row["dynamics_s"] for statistic in RANK_STATISTICS]


def _cells(row: dict[str, Any]) -> list[str]:
    """Return the cells of a row; phases in per cent of the dynamic stage: least / mean / largest."""
    cells = [format(row[name], shape) for name, (_, shape) in COLUMNS.items()]
    return cells + [" / ".join(f"{share:.0f}" for share in shares(row, name)) for name in PHASES]


def draw(job: Job, rows: list[dict[str, Any]], path: Path) -> Path:
    """Plot the speed-up over the ranks, and the time of the phases."""
    figure, ((left, right),) = canvas.open_charts(1, 2, 11, 4.4)
    counts = sorted({row["ranks"] for row in rows})
    left.plot(counts, [count / counts[0] for count in counts], color="0.6", linestyle="--", label="ideal")
    for kind, marker in (("strong", "o"), ("weak", "s")):
        points = sorted((row["ranks"], row["speed_up"]) for row in rows if row["kind"] == kind)
        if len(points) > 1:
            left.plot(*zip(*points), marker=marker, label=f"{kind} scaling")
    ylabel = f"element-steps per second, of those on {count_of(counts[0], 'rank')}"
    left.set(xlabel="ranks", ylabel=ylabel, xticks=counts, ylim=(0, None))
    left.legend()
    bottom, places = np.zeros(len(rows)), range(len(rows))
    for name in PHASES:
        least, mean, most = np.array([shares(row, name) for row in rows]).T
        spread, line = [mean - least, most - mean], {"elinewidth": 0.8}
        right.bar(places, mean, bottom=bottom, yerr=spread, capsize=3, label=name, error_kw=line)
        bottom += mean
    right.set_xticks(places, [f"{row['kind']}\n{row['ranks']}" for row in rows])
    right.set(ylabel="share of the dynamic stage [%]", ylim=(0, 110))
    right.legend(fontsize=8, ncols=4, loc="upper center")
    right.set_title("mean of the ranks; bars: least and largest", fontsize=9)
    figure.suptitle(job.title or job.name)
    return canvas.save(figure, path)
