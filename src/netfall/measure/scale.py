"""`netfall scale`: how the speed of a job's dynamic stage grows with the ranks.

Strong scaling: the job as it is, on more ranks. Weak scaling: as many elements for each rank; a net from a
generator grows in its dimensions, with cables as far apart as before; one from tables has each element
divided into more. The runs are interleaved, and the best of them counts: a machine that is shared is slower
at times, never faster.
"""

import csv
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from netfall.ground.errors import InputError
from netfall.ground.launch import check_launcher, passing_result, run_job_command
from netfall.job.job import Job
from netfall.job.read import read_job
from netfall.write.locks import whole

GROWING = {
    "saddle": ("side", "rise", "cells"),
    "stadium": ("length", "width", "arch_rise"),
    "wheel": ("diameter", "opening", "spokes", "hoops"),
    "ring": ("length", "width", "rise"),
    "dome": ("diameter", "opening", "dome_height", "strut", "spokes", "hoops"),
}  # dimensions that grow with the root of the area
WHOLE = {"cells": 1, "hoops": 1, "spokes": 4}  # numbers, and what they are multiples of
PHASES = {
    "forces": "dynamics: forces and kick",
    "exchange": "dynamics: exchange",
    "drift": "dynamics: drift",
    "output": "dynamics: output",
}


@dataclass
class Timing:
    """One run: seconds of the dynamic stage and of its phases, least, mean and largest of the ranks."""

    kind: str  # strong | weak
    ranks: int
    elements: int
    steps: int
    dynamics: float
    phases: dict[str, np.ndarray]

    @property
    def rate(self) -> float:
        """Elements times steps in a second."""
        return self.elements * self.steps / self.dynamics


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
    job = read_job(path, overrides)
    if job.dynamics is None:
        raise InputError(
            f"{path}: [dynamics] is missing: what is measured is the dynamic stage; add the section"
        )
    check_launcher(launcher)
    folder.mkdir(parents=True, exist_ok=True)
    cases = [("strong", count, []) for count in ranks]
    cases += [("weak", count, grown(job, count / ranks[0])) for count in ranks]
    cases = [case for case in cases if case[2] is not None]
    if len(cases) < 2 * len(ranks):
        say(
            "note: no weak scaling for numbers of ranks that are no multiples of the first: "
            "a table's elements can be divided only into whole numbers of parts"
        )
    best: dict[tuple, Timing] = {}
    for repeat in range(repeats):
        for kind, count, larger in cases:
            if kind == "weak" and not larger:  # the job itself
                best[kind, count] = Timing(**{**vars(best["strong", count]), "kind": kind})
                continue
            timing = measure(kind, count, path, [*overrides, *larger], launcher, folder)
            say(
                f"{kind}, {count} rank{'s' * (count > 1)}, run {repeat + 1} of {repeats}: "
                f"{timing.elements} elements, {timing.dynamics:.3g} s, {timing.rate:.3g} element-steps/s"
            )
            if (kind, count) not in best or timing.rate > best[kind, count].rate:
                best[kind, count] = timing
    timings = list(best.values())
    rows = table(timings)
    for line in as_text(rows):
        say(line)
    return [
        write_csv(rows, folder / f"{job.name}_scale.csv"),
        draw(job, timings, folder / f"{job.name}_scale.png"),
    ]


def grown(job: Job, factor: float) -> list[str] | None:
    """Overrides that make the job's net `factor` times as large; None where that cannot be."""
    if factor == 1.0:
        return []
    if job.net.generator is None:
        return [f"net.subdivide={round(job.net.subdivide * factor)}"] if factor == round(factor) else None
    longer = {key: getattr(job.net, key) * math.sqrt(factor) for key in GROWING[job.net.generator]}
    whole = lambda key, value: WHOLE[key] * round(value / WHOLE[key])
    return [f"net.{key}={whole(key, v) if key in WHOLE else repr(v)}" for key, v in longer.items()]


def measure(kind: str, ranks: int, path: Path, overrides: list[str], launcher: str, folder: Path) -> Timing:
    """The times of one run."""
    with passing_result(folder) as result:
        run_job_command(launcher, ranks, path, result, overrides, "--profile")
        with h5py.File(result, "r") as file:
            provenance = file["provenance"].attrs
            if provenance["ranks"] != ranks:
                raise InputError(
                    f'--launcher "{launcher}": started {provenance["ranks"]} ranks in one world '
                    f"where {ranks} were asked for"
                )
            seconds = file["provenance/timings"].attrs
            return Timing(
                kind,
                ranks,
                len(file["net/elements"]),
                int(provenance["steps"]),
                float(seconds["dynamics"][2]),
                {name: seconds[long] for name, long in PHASES.items()},
            )


def table(timings: list[Timing]) -> list[dict]:
    """A row for each case; speed-up and efficiency against the smallest number of ranks of its kind."""
    rows = []
    for t in timings:
        first = min((other for other in timings if other.kind == t.kind), key=lambda other: other.ranks)
        speed_up = t.rate / first.rate
        row = {
            "kind": t.kind,
            "ranks": t.ranks,
            "elements": t.elements,
            "steps": t.steps,
            "dynamics_s": t.dynamics,
            "element_steps_per_s": t.rate,
            "speed_up": speed_up,
            "efficiency": speed_up * first.ranks / t.ranks,
        }
        for name, values in t.phases.items():
            row |= {f"{name}_{which}_s": float(value) for which, value in zip(("min", "mean", "max"), values)}
        rows.append(row)
    return rows


def as_text(rows: list[dict]) -> list[str]:
    """The table for the eye; phases in per cent of the dynamic stage: least / mean / largest of the ranks."""
    lines = [
        "| scaling | ranks | elements | steps | seconds | element-steps/s | speed-up | efficiency | "
        + " | ".join(f"{name} [%]" for name in PHASES)
        + " |",
        "|" + "---|" * (8 + len(PHASES)),
    ]
    for row in rows:
        shares = [
            " / ".join(
                f"{100 * row[f'{name}_{which}_s'] / row['dynamics_s']:.0f}"
                for which in ("min", "mean", "max")
            )
            for name in PHASES
        ]
        lines.append(
            f"| {row['kind']} | {row['ranks']} | {row['elements']} | {row['steps']} "
            f"| {row['dynamics_s']:.3g} | {row['element_steps_per_s']:.3g} "
            f"| {row['speed_up']:.2f} | {row['efficiency']:.2f} | " + " | ".join(shares) + " |"
        )
    return lines


def write_csv(rows: list[dict], path: Path) -> Path:
    """The table, all figures in seconds."""
    with whole(path) as place, open(place, "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return path


def draw(job: Job, timings: list[Timing], path: Path) -> Path:
    """Speed-up over the ranks, and what a rank's time goes into."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.4), layout="constrained")
    rows = table(timings)
    counts = sorted({row["ranks"] for row in rows})
    left.plot(counts, [count / counts[0] for count in counts], color="0.6", linestyle="--", label="ideal")
    for kind, marker in (("strong", "o"), ("weak", "s")):
        mine = sorted((row["ranks"], row["speed_up"]) for row in rows if row["kind"] == kind)
        if len(mine) > 1:
            left.plot(*zip(*mine), marker=marker, label=f"{kind} scaling")
    left.set(
        xlabel="ranks",
        ylabel=f"element-steps per second, of those on {counts[0]} rank{'s' * (counts[0] > 1)}",
        xticks=counts,
        ylim=(0, None),
    )
    left.legend()
    bottom = np.zeros(len(timings))
    for name in PHASES:
        share = np.array([100 * t.phases[name][1] / t.dynamics for t in timings])
        spread = np.array([100 * (t.phases[name][1:] - t.phases[name][:-1]) / t.dynamics for t in timings]).T
        right.bar(
            range(len(timings)),
            share,
            bottom=bottom,
            yerr=spread,
            capsize=3,
            label=name,
            error_kw={"elinewidth": 0.8},
        )
        bottom += share
    right.set(
        xticks=range(len(timings)),
        xticklabels=[f"{t.kind}\n{t.ranks}" for t in timings],
        ylabel="share of the dynamic stage [%]",
        ylim=(0, 110),
    )
    right.legend(fontsize=8, ncols=4, loc="upper center")
    right.set_title("mean of the ranks; bars: least and largest", fontsize=9)
    figure.suptitle(job.title or job.name)
    with whole(path) as place:
        figure.savefig(place, dpi=130)
    plt.close(figure)
    return path
