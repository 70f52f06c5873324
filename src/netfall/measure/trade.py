"""`netfall trade`: what each saving of a job costs in accuracy, against a reference of its own.

Every setting is a run of the job with some keys changed. The reference is the job at a tenth of its automatic
step (or of its own, if that is shorter), or what the user names. Errors are in what an engineer reads; before
the reference's first fracture a roof has one answer, after it a collapse is chaotic, and single figures
scatter. (The wind's time step and seed are no accuracy: they change the gusts themselves.)
"""

import hashlib
import itertools
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from netfall.ground.errors import InputError
from netfall.ground.launch import check_launcher
from netfall.ground.sources import program_digest
from netfall.job.job import Job
from netfall.job.read import read_job
from netfall.job.schema import may_break
from netfall.measure.compare import Row, as_text, compare, draw, mark_best, write_table
from netfall.measure.outcome import Outcome, Store, best_of, measure
from netfall.write.locks import claim, release

FINER = 10.0  # how much shorter the reference's step is
FORMAT = 2


@dataclass(frozen=True)
class Study:
    """The job of a study, and how its runs are started."""

    path: Path
    overrides: list[str]
    ranks: int
    launcher: str
    repeats: int
    folder: Path

    def job(self, setting: list[str]) -> Job:
        """The job with a setting. Raises InputError."""
        return read_job(self.path, [*self.overrides, *setting])

    def once(self, setting: list[str], until: float) -> Outcome:
        """The outcome of one run."""
        overrides = [*self.overrides, *setting]
        return measure(self.path, overrides, self.ranks, self.launcher, self.folder, until)

    def stored_or_run(self, store: Store, setting: list[str], until: float, repeats: int) -> Outcome:
        """The outcome that is stored, else that of the fastest of several runs."""
        key = f"{text_of(setting)} until {until!r} of {self.job(setting).digest()}"
        return store.outcome(key, lambda: best_of(repeats, lambda: self.once(setting, until)))


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

    vary : SECTION.KEY=VALUE,VALUE,...; every combination is run. Empty: one key at a time, of those that the
    job has
    reference : overrides of the reference, beside those of all runs
    repeats : runs of each setting, of which the fastest counts (a first one may compile)
    tolerance : of the largest relative error
    """
    job = read_job(path, overrides)
    if job.dynamics is None:
        raise InputError(
            f"{path}: [dynamics] is missing: what is compared is the dynamic stage; add the section"
        )
    check_launcher(launcher)
    study = Study(path, overrides, ranks, launcher, repeats, folder)
    settings = combinations(vary) if vary else usual_settings(job)
    for setting in settings:
        varied = study.job(setting)  # all errors before the first run
    safety = any(item.partition("=")[0].strip() == "dynamics.safety" for item in vary)
    if safety and varied.dynamics.time_step != "auto":
        say(
            "note: --vary dynamics.safety: time_step is fixed, so it sets at most the mass of fragments; "
            "with --set dynamics.time_step=auto it sets the step"
        )
    folder.mkdir(parents=True, exist_ok=True)
    table = folder / f"{job.name}_trade.h5"
    claimed = claim(table)
    try:
        store = Store(table, digest_of(ranks))
        reference = reference or shorter_step(study, job)
        say(f"reference: {text_of(reference)}")
        exact, until = measure_reference(study, store, reference)
        rows = measure_settings(study, store, settings, exact, until, say)
        mark_best(rows)
        for line in as_text(rows, exact, tolerance):
            say(line)
        against = {"reference": text_of(reference), "reference_seconds": exact.seconds}
        write_table(table, rows, **against, tolerance=tolerance, ranks=ranks)
        picture = folder / f"{job.name}_trade.png"
        return [table, draw(job.title or job.name, rows, exact, tolerance, picture)]
    finally:
        release(claimed)


def digest_of(ranks: int) -> str:
    """Fingerprint of what all outcomes of a study depend on besides the job."""
    return hashlib.sha256(json.dumps([program_digest(), ranks, FORMAT]).encode()).hexdigest()


def shorter_step(study: Study, job: Job) -> list[str]:
    """The usual reference: a tenth of the automatic step, or of the job's own if that is shorter."""
    coarse = automatic_step(study, job)
    if job.dynamics.time_step != "auto":
        coarse = min(coarse, job.dynamics.time_step)
    return [f"dynamics.time_step={coarse / FINER:.6g}"]


def automatic_step(study: Study, job: Job) -> float:
    """The step [s] that "auto" takes, from a run of a single history row."""
    setting = ["dynamics.time_step=auto", "dynamics.safety=0.8", "output.frames=1"]
    setting.append(f"dynamics.duration={min(job.dynamics.duration, job.output.history)!r}")
    found = study.once(setting, np.inf)
    if found.state != "finished":
        raise InputError(f"{study.path}: the run for the automatic step was {found.state}: {found.reason}")
    return found.time_step


def measure_reference(study: Study, store: Store, reference: list[str]) -> tuple[Outcome, float]:
    """The outcome of the reference, and the time [s] of its first fracture, up to which runs are compared."""
    whole = study.stored_or_run(store, reference, np.inf, 1)
    if whole.state != "finished":
        raise InputError(f"{study.path}: the reference was {whole.state}: {whole.reason}")
    until = whole.first_fracture if np.isfinite(whole.first_fracture) else np.inf
    return study.stored_or_run(store, reference, until, study.repeats), until


def measure_settings(
    study: Study,
    store: Store,
    settings: list[list[str]],
    exact: Outcome,
    until: float,
    say: Callable[[str], None],
) -> list[Row]:
    """The row of each setting, told as it is measured."""
    rows = []
    for number, setting in enumerate(settings, 1):
        found = study.stored_or_run(store, setting, until, study.repeats)
        row = compare(text_of(setting), found, exact)
        rows.append(row)
        finished = f"{found.seconds:.3g} s, error {row.error:.2g}"
        told = finished if found.state == "finished" else f"{found.state}: {found.reason}"
        say(f"{number} of {len(settings)}: {row.setting}: {told}")
    return rows


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
    if may_break(vars(job.cable) | job.groups):
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
