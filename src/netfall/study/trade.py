"""`netfall trade`: what each saving of a job costs in accuracy, against a reference of its own.

Every setting is a run of the job with some keys changed. The reference is the job at a tenth of its automatic step
(or of its own, if that is shorter), or what the user names. Errors are in what an engineer reads; before the reference's first fracture a roof has one answer, after it a
collapse is chaotic, and single figures scatter. (The wind's time step and seed are no accuracy: they change the gusts themselves.)
"""

import hashlib
import itertools
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import h5py
import numpy as np

from netfall.errors import InputError
from netfall.job.read import Job, read_job
from netfall.output.frames import Frames
from netfall.output.place import claim, release
from netfall.sources import program_digest
from netfall.study.launch import RunFailed, check_launcher, passing_result, run_job_command

FINER = 10.0  # how much shorter the reference's step is
FORMAT = 2
LASTING = ("finished", "refused", "diverged")  # what a further try would give again
NEAR = 0.08  # decades, in which points of the picture share a name


@dataclass
class Outcome:
    """What one run gave, in SI units; nan where there is nothing of the kind."""

    state: str  # finished | refused | diverged | failed
    reason: str
    seconds: float  # of the dynamic stage, the slowest rank
    time_step: float
    largest_displacement: float  # up to the reference's first fracture
    largest_tension: float  # the same
    first_fracture: float  # time
    first_element: int
    broken: int
    balance_error: float
    broken_elements: str  # ids, for the overlap


@dataclass
class Row:
    """A setting with its errors: relative ones, but for the overlap (Jaccard index of the broken sets)."""

    setting: str
    outcome: Outcome
    errors: dict[str, float]
    error: float  # the largest of the relative ones
    best: bool = False  # nothing is both faster and closer


ERRORS = ("displacement", "tension", "first_fracture", "broken")


def trade(
    path: Path,
    overrides: list[str],
    vary: list[str],
    reference: list[str],
    ranks: int,
    launcher: str,
    repeats: int,
    tolerance: float,
    folder: Path,
    say: Callable[[str], None],
) -> list[Path]:
    """Run the grid, print the table, write it and its picture into `folder`; their paths. Raises InputError.

    vary : SECTION.KEY=VALUE,VALUE,...; every combination is run. Empty: one key at a time, of those that the job has
    reference : overrides of the reference, beside those of all runs; repeats : runs of each setting, of which the fastest counts (a first
    one may compile); tolerance : of the largest relative error
    """
    job = read_job(path, overrides)
    if job.dynamics is None:
        raise InputError(
            f"{path}: [dynamics] is missing: what is compared is the dynamic stage; add the section"
        )
    check_launcher(launcher)
    settings = combinations(vary) if vary else usual_settings(job)
    for setting in settings:
        varied = read_job(path, [*overrides, *setting])  # all errors before the first run
    safety = any(item.partition("=")[0].strip() == "dynamics.safety" for item in vary)
    if safety and varied.dynamics.time_step != "auto":
        say(
            "note: --vary dynamics.safety: time_step is fixed, so it sets at most the mass of fragments; with "
            "--set dynamics.time_step=auto it sets the step"
        )
    folder.mkdir(parents=True, exist_ok=True)
    table = folder / f"{job.name}_trade.h5"
    claimed = claim(table)
    try:
        return _trade(job, overrides, settings, reference, ranks, launcher, repeats, tolerance, table, say)
    finally:
        release(claimed)


def _trade(job, overrides, settings, reference, ranks, launcher, repeats, tolerance, table, say):
    path, folder = job.path, table.parent
    store = Store(table, hashlib.sha256(json.dumps([program_digest(), ranks, FORMAT]).encode()).hexdigest())
    once = lambda setting, until: measure(path, [*overrides, *setting], ranks, launcher, folder, until)
    run = lambda setting, until: store.outcome(
        read_job(path, [*overrides, *setting]),
        setting,
        until,
        lambda: best_of(repeats, lambda: once(setting, until)),
    )
    if not reference:
        coarse = automatic_step(path, overrides, ranks, launcher, folder)
        if job.dynamics.time_step != "auto":
            coarse = min(coarse, job.dynamics.time_step)
        reference = [f"dynamics.time_step={coarse / FINER:.6g}"]
    say(f"reference: {text_of(reference)}")
    finest = read_job(path, [*overrides, *reference])
    exact = store.outcome(finest, reference, np.inf, lambda: once(reference, np.inf))
    if exact.state != "finished":
        raise InputError(f"{path}: the reference was {exact.state}: {exact.reason}")
    until = exact.first_fracture if np.isfinite(exact.first_fracture) else np.inf
    exact = run(reference, until)
    rows = []
    for number, setting in enumerate(settings, 1):
        row = compare(text_of(setting), run(setting, until), exact)
        rows.append(row)
        say(
            f"{number} of {len(settings)}: {row.setting}: "
            + (
                f"{row.outcome.seconds:.3g} s, error {row.error:.2g}"
                if row.outcome.state == "finished"
                else f"{row.outcome.state}: {row.outcome.reason}"
            )
        )
    mark_best(rows)
    for line in as_text(rows, exact, tolerance):
        say(line)
    store.write_table(rows, exact, tolerance, text_of(reference), ranks)
    return [store.path, draw(job, rows, exact, tolerance, folder / f"{job.name}_trade.png")]


def text_of(setting: list[str]) -> str:
    """A setting as a user would type it."""
    return ", ".join(setting) or "as it is"


def combinations(vary: list[str]) -> list[list[str]]:
    """Every combination of the values of every key. Raises InputError."""
    axes = []
    for item in vary:
        name, equals, values = item.partition("=")
        if not equals or "." not in name or not all(value.strip() for value in values.split(",")):
            raise InputError(
                f"--vary {item}: expected SECTION.KEY=VALUE,VALUE,..., for example dynamics.safety=0.8,0.4"
            )
        axes.append([f"{name.strip()}={value.strip()}" for value in values.split(",")])
    return [list(choice) for choice in itertools.product(*axes)]


def usual_settings(job: Job) -> list[list[str]]:
    """The job as it is, and with one key at a time changed, of those that it has."""
    automatic = ["dynamics.time_step=auto"]
    settings = [[]] + [[*automatic, f"dynamics.safety={safety}"] for safety in (0.95, 0.4, 0.2)]
    scaled = automatic
    if np.isfinite(
        [float(job.cable.fracture_strain or np.inf)]
        + [float(values.get("fracture_strain") or np.inf) for values in job.groups.values()]
    ).any():
        settings += [[*automatic, f"dynamics.fragment_mass={share}"] for share in (0.0, 0.01, 0.02, 0.1)]
        scaled = [*automatic, "dynamics.fragments=false"]
        settings.append(scaled)
    settings += [[*scaled, f"dynamics.mass_scaling={share}"] for share in (0.02, 0.05, 0.1)]
    settings.append(
        [
            *scaled,
            "dynamics.mass_scaling=0.05",
            "dynamics.safety=0.95",
            f"output.history={5.0 * job.output.history:g}",
        ]
    )
    settings += [
        [f"dynamics.precision={precision}"]
        for precision in ("double", "mixed", "single")
        if precision != job.dynamics.precision
    ]
    settings.append(["output.energy=false"])
    other = "logarithmic" if job.cable.strain == "engineering" else "engineering"
    settings += [[f"cable.strain={other}"], [f"net.subdivide={2 * job.net.subdivide}"]]
    return settings


def automatic_step(path: Path, overrides: list[str], ranks: int, launcher: str, folder: Path) -> float:
    """The step [s] that "auto" takes, from a run of a single history row."""
    with_auto = [*overrides, "dynamics.time_step=auto", "dynamics.safety=0.8", "output.frames=1"]
    job = read_job(path, overrides)
    with_auto.append(f"dynamics.duration={min(job.dynamics.duration, job.output.history)!r}")
    found = measure(path, with_auto, ranks, launcher, folder, np.inf)
    if found.state != "finished":
        raise InputError(f"{path}: the run for the automatic step was {found.state}: {found.reason}")
    return found.time_step


def best_of(repeats: int, run: Callable[[], Outcome]) -> Outcome:
    """The fastest of several runs; one alone if it did not finish."""
    found = run()
    for _ in range(repeats - 1):
        if found.state == "finished":
            found = min(found, run(), key=lambda outcome: outcome.seconds)
    return found


def measure(
    path: Path, overrides: list[str], ranks: int, launcher: str, folder: Path, until: float
) -> Outcome:
    """The outcome of one run; displacements and tensions up to the time `until` [s]."""
    nothing = {field.name: np.nan for field in fields(Outcome)} | {
        "first_element": -1,
        "broken": -1,
        "broken_elements": "",
    }
    with passing_result(folder) as result:
        try:
            run_job_command(launcher, ranks, path, result, overrides)
        except RunFailed as failed:
            return Outcome(**{**nothing, "state": failed.state, "reason": failed.reason})
        with h5py.File(result, "r") as file:
            return read_outcome(file, until)


def read_outcome(file: h5py.File, until: float) -> Outcome:
    """The quantities of one result file."""
    frames = Frames(file)
    displacement = tension = 0.0
    for step in np.flatnonzero(frames.times <= until):
        displacement = max(
            displacement, np.linalg.norm(frames.point("displacement", step), axis=1).max(initial=0.0)
        )
        tension = max(tension, frames.cell("tension", step).max(initial=0.0))
    events, ids = file["events"], file["net/element_id"][:]
    broken = np.unique(events["element"][:])
    first = events["time"][0] if len(events["time"]) else np.nan
    return Outcome(
        "finished",
        "",
        float(file["provenance/timings"].attrs["dynamics"][2]),
        float(file["provenance"].attrs["time_step"]),
        float(displacement),
        float(tension),
        float(first),
        int(ids[events["element"][0]]) if len(broken) else -1,
        len(broken),
        float(np.abs(file["history/balance_error"][:]).max()),
        " ".join(map(str, ids[broken].tolist())),
    )


def compare(setting: str, found: Outcome, exact: Outcome) -> Row:
    """Errors against the reference."""
    if found.state != "finished":
        return Row(setting, found, dict.fromkeys((*ERRORS, "overlap"), np.nan), np.inf)
    relative = lambda a, b: (
        0.0
        if a == b or (not np.isfinite(a) and not np.isfinite(b))
        else abs(a - b) / abs(b)
        if np.isfinite(a) and b and np.isfinite(b)
        else np.inf
    )
    errors = {
        "displacement": relative(found.largest_displacement, exact.largest_displacement),
        "tension": relative(found.largest_tension, exact.largest_tension),
        "first_fracture": relative(found.first_fracture, exact.first_fracture),
        "broken": relative(found.broken, exact.broken),
    }
    mine, theirs = set(found.broken_elements.split()), set(exact.broken_elements.split())
    return Row(
        setting,
        found,
        errors | {"overlap": len(mine & theirs) / max(1, len(mine | theirs)) if mine or theirs else 1.0},
        max(errors.values()),
    )


def mark_best(rows: list[Row]) -> None:
    """Mark the Pareto front of run time and error."""
    for row in rows:
        row.best = row.outcome.state == "finished" and not any(
            other.outcome.state == "finished"
            and other.outcome.seconds <= row.outcome.seconds
            and other.error <= row.error
            and (other.outcome.seconds, other.error) != (row.outcome.seconds, row.error)
            for other in rows
        )


def cheapest(rows: list[Row], tolerance: float) -> Row | None:
    """The fastest setting within the tolerance."""
    return min(
        (row for row in rows if row.error <= tolerance), key=lambda row: row.outcome.seconds, default=None
    )


def as_text(rows: list[Row], exact: Outcome, tolerance: float) -> list[str]:
    """The table for the eye, the front marked with *, and the cheapest setting within the tolerance."""
    lines = [
        "| setting | step [s] | seconds | displacement [m] | tension [kN] | first fracture [s] (element) | broken | overlap | balance | error |",
        "|" + "---|" * 10,
    ]

    def line(name: str, o: Outcome, overlap: float, error: float) -> str:
        if o.state != "finished":
            return f"| {name} | | | {o.state} | | | | | | |"
        first = f"{o.first_fracture:.5f} ({o.first_element})" if o.broken else "none"
        return (
            f"| {name} | {o.time_step:.3g} | {o.seconds:.3g} | {o.largest_displacement:.5g} | {o.largest_tension / 1e3:.5g} | {first} | {o.broken} "
            f"| {overlap:.2f} | {o.balance_error:.1e} | {error:.2g} |"
        )

    lines.append(line("**reference**", exact, 1.0, 0.0))
    lines += [
        line(("\\* " if row.best else "") + row.setting, row.outcome, row.errors["overlap"], row.error)
        for row in sorted(rows, key=lambda row: row.outcome.seconds)
    ]
    found = cheapest(rows, tolerance)
    lines.append(
        f"cheapest within an error of {tolerance:g}: "
        + (
            f"{found.setting} ({found.outcome.seconds:.3g} s, {exact.seconds / found.outcome.seconds:.1f} times faster than "
            f"the reference)"
            if found
            else "none of these"
        )
        + "; * nothing else is both faster and closer"
    )
    return lines


class Store:
    """Outcomes so far, in one HDF5 file; a study that was stopped goes on where it was.

    digest : of what all outcomes depend on; if it has changed, none of them is used
    """

    def __init__(self, path: Path, digest: str):
        self.path, self.digest = path, digest

    def outcome(self, job: Job, setting: list[str], until: float, run: Callable[[], Outcome]) -> Outcome:
        """The outcome that is stored for the very job of the setting, else that of a run, which is stored if it lasts."""
        key = f"{text_of(setting)} until {until!r} of {job.digest()}".replace("/", "|")
        with h5py.File(self.path, "a") as file:
            if file.attrs.get("digest") != self.digest:
                file.clear()
                file.attrs["digest"] = self.digest
            stored = file.get("outcomes", {})
            if key in stored:
                return Outcome(**json.loads(stored[key][()]))
        found = run()
        if found.state in LASTING:
            with h5py.File(self.path, "a") as file:
                file.require_group("outcomes")[key] = json.dumps(asdict(found))
        return found

    def write_table(
        self, rows: list[Row], exact: Outcome, tolerance: float, reference: str, ranks: int
    ) -> None:
        """The table as datasets of one length, /table; attributes say what it was measured against."""
        with h5py.File(self.path, "a") as file:
            file.pop("table", None)
            group = file.create_group("table")
            group.attrs.update(
                {
                    "reference": reference,
                    "tolerance": tolerance,
                    "ranks": ranks,
                    "reference_seconds": exact.seconds,
                }
            )
            group["setting"] = np.array([row.setting for row in rows], h5py.string_dtype())
            group["error"] = np.array([row.error for row in rows])
            group["pareto"] = np.array([row.best for row in rows], np.uint8)
            for name in (*ERRORS, "overlap"):
                group[f"{name}_error" if name != "overlap" else name] = np.array(
                    [row.errors[name] for row in rows]
                )
            for field in fields(Outcome):
                values = [getattr(row.outcome, field.name) for row in rows]
                group[field.name] = (
                    np.array(values, h5py.string_dtype()) if isinstance(values[0], str) else np.array(values)
                )


def draw(job: Job, rows: list[Row], exact: Outcome, tolerance: float, path: Path) -> Path:
    """Run time against error."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (axes, names) = plt.subplots(1, 2, figsize=(11, 6), width_ratios=(3, 1.3), layout="constrained")
    finished = sorted(
        (row for row in rows if row.outcome.state == "finished" and np.isfinite(row.error)),
        key=lambda row: row.outcome.seconds,
    )
    floor = min([row.error for row in finished if row.error > 0], default=1e-6) / 3
    place = lambda row: (row.outcome.seconds, max(row.error, floor))
    front = [row for row in finished if row.best]
    axes.plot(
        [place(row)[0] for row in front],
        [place(row)[1] for row in front],
        color="C0",
        lw=1,
        zorder=1,
        label="nothing is both faster and closer",
    )
    together: list[list[int]] = []  # numbers of points whose names would hide one another
    near = lambda one, other: (
        np.abs(np.log10(place(finished[one - 1])) - np.log10(place(finished[other - 1]))).max() < NEAR
    )
    for number, row in enumerate(finished, 1):
        axes.plot(*place(row), "o", color="C0" if row.best else "0.6")
        group = next((group for group in together if near(group[0], number)), None)
        if group is None:
            together.append([number])
        else:
            group.append(number)
    for numbers in together:
        axes.annotate(
            ", ".join(map(str, numbers)),
            place(finished[numbers[0] - 1]),
            xytext=(5, 5),
            textcoords="offset points",
            fontsize=8,
        )
    names.axis("off")
    names.text(
        0.0,
        1.0,
        "\n".join(f"{number:2d}  {row.setting}" for number, row in enumerate(finished, 1)).replace(
            ", ", ",\n      "
        ),
        va="top",
        fontsize=8,
        transform=names.transAxes,
    )
    axes.axhline(tolerance, color="C3", lw=0.8, ls="--", label=f"tolerance {tolerance:g}")
    axes.axvline(exact.seconds, color="0.5", lw=0.8, ls=":", label="reference")
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="dynamic stage [s]",
        ylabel="largest relative error",
        title=f"{job.title or job.name}: run time against error",
    )
    axes.margins(x=0.2)
    axes.legend(fontsize=8)
    figure.savefig(path, dpi=130)
    plt.close(figure)
    return path
