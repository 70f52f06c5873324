"""`netfall scale`: speed of a job's dynamic stage as a function of the number of ranks.

Strong scaling: the unchanged job on more ranks. Weak scaling: a constant number of elements per rank. A net
from a generator then grows in its dimensions at constant spacing of cables; in a net from tables each element
is divided. The runs are interleaved, and the fastest of them counts, since other load of a shared machine
only slows a run down.
"""

import math
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from netfall.core.errors import InputError
from netfall.core.launch import check_launcher
from netfall.job.job import Job
from netfall.job.schema import GENERATOR_KEYS
from netfall.post import messages
from netfall.post.accuracy import tables
from netfall.post.accuracy.series import RunSeries, read_dynamic_job, series_folder

# Keys of a generator that stay constant; the others grow with the square root of the area.
CONSTANT_KEYS = ("spacing", "halves", "ring_height", "ring_depth", "spoke_force", "hoop_force", "brace_force")
WHOLE = {"cells": 1, "hoops": 1, "spokes": 4}  # integer keys: they are multiples of these
RATE = "element_steps_per_s"
PHASES = {
    "forces": "dynamics: forces and kick",
    "exchange": "dynamics: exchange",
    "drift": "dynamics: drift",
    "rows": "dynamics: rows",
    "output": "dynamics: output",
}
RANK_STATISTICS = ("min", "mean", "max")  # statistics over the ranks for the time of each phase


def scale(
    path: Path,
    overrides: list[str],
    ranks: list[int],
    launcher: str,
    repeats: int,
    folder: Path,
    say: Callable[[str], None],
) -> list[Path]:
    """Run the job on each number of ranks and print the table. Raises InputError.

    Returns the paths of the table and its picture, in `folder`.
    """
    job = read_dynamic_job(path, overrides)
    for line in job.warnings:
        say(line)
    check_launcher(launcher)
    cases = [("strong", count, []) for count in ranks]
    cases += [("weak", count, enlarge_overrides(job, count / ranks[0])) for count in ranks]
    cases = [case for case in cases if case[2] is not None]
    if len(cases) < 2 * len(ranks):
        say(messages.NO_WEAK_SCALING())
    csv = folder / f"{job.name}_scale.csv"
    with series_folder(csv) as place:
        best: dict[tuple, dict] = {}
        for repeat in range(repeats):
            for kind, count, larger in cases:
                if kind == "weak" and not larger:  # the job itself
                    best[kind, count] = best["strong", count] | {"kind": kind}
                    continue
                runs = RunSeries(path, count, launcher, place, profile=True)
                row = measure(kind, runs, [*overrides, *larger])
                say(
                    f"{kind}, {count} rank{'s' * (count > 1)}, run {repeat + 1} of {repeats}: "
                    f"{row['elements']} elements, {row['dynamics_s']:.3g} s, {row[RATE]:.3g} element-steps/s"
                )
                best[kind, count] = max(best.get((kind, count), row), row, key=lambda row: row[RATE])
        rows = list(best.values())
        compare(rows)
        for line in as_text(rows):
            say(line)
        return [tables.write_csv(rows, csv), draw(job, rows, csv.with_suffix(".png"))]


def enlarge_overrides(job: Job, factor: float) -> list[str] | None:
    """Return overrides that make the job's net `factor` times as large; None if that is impossible."""
    if factor == 1.0:
        return []
    if job.net.generator is None:
        return [f"net.subdivide={round(job.net.subdivide * factor)}"] if factor == round(factor) else None
    keys = [key for key in GENERATOR_KEYS[job.net.generator] if key not in CONSTANT_KEYS]
    dimensions = getattr(job.net, job.net.generator)
    longer = {key: getattr(dimensions, key) * math.sqrt(factor) for key in keys}
    return [f"net.{job.net.generator}.{key}={_rounded(key, value)!r}" for key, value in longer.items()]


def _rounded(key: str, value: float) -> float | int:
    """Return the value of a generator's key, for an integer key the nearest valid one."""
    return WHOLE[key] * round(value / WHOLE[key]) if key in WHOLE else value


def measure(kind: str, runs: RunSeries, overrides: list[str]) -> dict:
    """Measure one run, and return its row. Raises InputError if it does not finish."""
    rows = []

    def done(answer: dict, file: h5py.File | None) -> None:
        if file is None:
            rank_text = f"{runs.ranks} rank{'s' * (runs.ranks > 1)}"
            raise InputError(
                messages.SCALING_RUN_FAILED(
                    path=runs.job, ranks=rank_text, state=answer["state"], reason=answer["reason"]
                )
            )
        rows.append({"kind": kind, "ranks": runs.ranks} | read_timing(file))

    runs.run([overrides], done)
    return rows[0]


def read_timing(file: h5py.File) -> dict:
    """Return the speed of a run, and the seconds [s] of the dynamic stage's phases."""
    seconds = file["provenance/timings"].attrs
    elements, steps = len(file["net/elements"]), int(file["provenance"].attrs["steps"])
    dynamics = float(seconds["dynamics"][2])
    row = {"elements": elements, "steps": steps, "dynamics_s": dynamics, RATE: elements * steps / dynamics}
    row |= {"speed_up": math.nan, "efficiency": math.nan}
    for name, phase in PHASES.items():
        row |= {
            f"{name}_{statistic}_s": float(value) for statistic, value in zip(RANK_STATISTICS, seconds[phase])
        }
    return row


def compare(rows: list[dict]) -> None:
    """Set the speed-up and efficiency of each row, relative to the smallest number of ranks of its kind."""
    for row in rows:
        first = min((other for other in rows if other["kind"] == row["kind"]), key=lambda row: row["ranks"])
        row["speed_up"] = row[RATE] / first[RATE]
        row["efficiency"] = row["speed_up"] * first["ranks"] / row["ranks"]


def shares(row: dict, phase: str) -> list[float]:
    """Return the share of a phase in the dynamic stage [%]: least, mean and largest over the ranks."""
    return [100 * row[f"{phase}_{statistic}_s"] / row["dynamics_s"] for statistic in RANK_STATISTICS]


def as_text(rows: list[dict]) -> list[str]:
    """Return the table as text; phases in per cent of the dynamic stage: least / mean / largest."""
    head = ["scaling", "ranks", "elements", "steps", "seconds", "element-steps/s", "speed-up", "efficiency"]
    return tables.as_text([*head, *(f"{name} [%]" for name in PHASES)], [_cells(row) for row in rows])


def _cells(row: dict) -> list[str]:
    return [
        *(str(row[name]) for name in ("kind", "ranks", "elements", "steps")),
        *(f"{row[name]:.3g}" for name in ("dynamics_s", RATE)),
        *(f"{row[name]:.2f}" for name in ("speed_up", "efficiency")),
        *(" / ".join(f"{share:.0f}" for share in shares(row, name)) for name in PHASES),
    ]


def draw(job: Job, rows: list[dict], path: Path) -> Path:
    """Plot the speed-up over the ranks, and the time of the phases."""
    with tables.two_panels(path, 11, 4.4) as (figure, left, right):
        _draw_speed_up(left, rows)
        _draw_phases(right, rows)
        figure.suptitle(job.title or job.name)
    return path


def _draw_speed_up(axes, rows: list[dict]) -> None:
    counts = sorted({row["ranks"] for row in rows})
    axes.plot(counts, [count / counts[0] for count in counts], color="0.6", linestyle="--", label="ideal")
    for kind, marker in (("strong", "o"), ("weak", "s")):
        points = sorted((row["ranks"], row["speed_up"]) for row in rows if row["kind"] == kind)
        if len(points) > 1:
            axes.plot(*zip(*points), marker=marker, label=f"{kind} scaling")
    axes.set(
        xlabel="ranks",
        ylabel=f"element-steps per second, of those on {counts[0]} rank{'s' * (counts[0] > 1)}",
        xticks=counts,
        ylim=(0, None),
    )
    axes.legend()


def _draw_phases(axes, rows: list[dict]) -> None:
    bottom, places = np.zeros(len(rows)), range(len(rows))
    for name in PHASES:
        least, mean, most = np.array([shares(row, name) for row in rows]).T
        spread, line = [mean - least, most - mean], {"elinewidth": 0.8}
        axes.bar(places, mean, bottom=bottom, yerr=spread, capsize=3, label=name, error_kw=line)
        bottom += mean
    axes.set(
        xticks=places,
        xticklabels=[f"{row['kind']}\n{row['ranks']}" for row in rows],
        ylabel="share of the dynamic stage [%]",
        ylim=(0, 110),
    )
    axes.legend(fontsize=8, ncols=4, loc="upper center")
    axes.set_title("mean of the ranks; bars: least and largest", fontsize=9)
