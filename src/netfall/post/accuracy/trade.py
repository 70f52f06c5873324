"""`netfall trade`: accuracy study of a job: error and run time of settings against a reference.

Every setting is a run of the job with some changed keys. The reference is the job at a tenth of its automatic
step (or of its given step, if that is shorter), or overrides of the user. Errors refer to quantities that an
engineer reads. Before the first fracture of the reference, the solution is unique. After it a collapse is
chaotic, and single values scatter. (Time step and seed of the wind change the gusts, so they are not settings
of accuracy.)
"""

import itertools
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py

from netfall.core.cache import program_digest
from netfall.core.errors import InputError, Interrupted
from netfall.core.timings import StopFlag
from netfall.geometry.sections import given_cable_keys
from netfall.job.job import Job
from netfall.job.keys.fields import keys_of
from netfall.job.keys.models import Cable
from netfall.job.keys.schema import BREAKING_KEYS
from netfall.job.read import read_job
from netfall.post import messages
from netfall.post.accuracy import compare
from netfall.post.accuracy.compare import AccuracyOutcome, OutcomeJournal, end_of_comparison, read_outcome
from netfall.post.accuracy.series import RunSeries, read_dynamic_job, series_folder
from netfall.study.files import InputFiles

REFERENCE_REFINEMENT = 10.0  # automatic time step over the time step of the reference
FORMAT = 5  # version of the layout of the journal


@dataclass(frozen=True)
class AccuracyStudy:
    """A job, its runs and their outcomes. inputs : the files of the job; stop : requests an early end"""

    runs: RunSeries
    overrides: list[str]
    outcomes: OutcomeJournal
    inputs: InputFiles
    stop: StopFlag

    def measure(
        self,
        settings: list[list[str]],
        repeats: int,
        until: float | None = None,
        report: Callable[[int, AccuracyOutcome], None] = lambda row, outcome: None,
    ) -> list[AccuracyOutcome]:
        """Return the outcome of each setting, from its fastest run; execute missing runs.

        until : as in `read_outcome`; report : receives the number of a setting, from 0, and its outcome

        Raises Interrupted if `stop` is set, InputError if no run can start or a file has changed.
        """
        overrides = [[*self.overrides, *setting] for setting in settings]
        keys = [f"{read_job(self.runs.job, items).digest()} until {until!r}" for items in overrides]
        outcomes: list[AccuracyOutcome] = []

        def missing() -> Iterator[list[str]]:
            for row, key in enumerate(keys):
                while (best := self.outcomes.best(key, repeats)) is None:
                    yield overrides[row]
                outcomes.append(best)
                report(row, best)

        def done(answer: dict[str, Any], file: h5py.File | None) -> None:
            self.inputs.check()
            self.outcomes.add(keys[len(outcomes)], read_outcome(answer, file, until))

        self.runs.run(missing(), done, self.stop)
        if remaining := len(settings) - len(outcomes):
            raise Interrupted(messages.TRADE_INTERRUPTED(remaining=remaining))
        return outcomes


def trade(
    path: Path,
    overrides: list[str],
    vary: list[str],
    reference: list[str],
    repeats: int,
    tolerance: float,
    ranks: int,
    launcher: str,
    folder: Path,
    say: Callable[..., None],
    stop: StopFlag,
) -> list[Path]:
    """Run the settings, print the table, and write it and its plot into `folder`; return their paths.

    vary : SECTION.KEY=VALUE,VALUE,...; every combination is run. Empty: one key at a time, of the keys in the
    job
    reference : overrides of the reference, in addition to those of all runs
    repeats : runs of each setting, of which the fastest counts (a first one may compile)
    tolerance : of the largest relative error; stop : requests an early end

    Raises InputError, Interrupted if `stop` is set.
    """
    job = read_dynamic_job(path, overrides, launcher, say)
    settings = combinations(vary) if vary else default_settings(job)
    *varied, reference_job = [read_job(path, [*overrides, *setting]) for setting in [*settings, reference]]
    safety = any(item.partition("=")[0].strip() == "dynamics.safety" for item in vary)
    if safety and (dynamics := varied[-1].dynamics) and dynamics.time_step != "auto":
        say(messages.SAFETY_WITHOUT_EFFECT())
    files = dict.fromkeys(file for used_job in (*varied, reference_job) for file in used_job.files())
    header = {"format": FORMAT, "program": program_digest(), "ranks": ranks}
    table = folder / f"{job.name}_trade.h5"
    with (
        series_folder(table) as place,
        closing(OutcomeJournal(table.with_suffix(".journal"), header)) as outcomes,
    ):
        runs = RunSeries(path, ranks, launcher, place)
        study = AccuracyStudy(runs, overrides, outcomes, InputFiles([path, *files]), stop)
        reference = reference or default_reference(study, job)
        say(f"reference: {setting_text(reference)}")
        (exact,) = study.measure([reference], repeats)
        if exact.state != "finished":
            raise InputError(messages.REFERENCE_FAILED(path=path, state=exact.state, reason=exact.reason))
        rows = []

        def report(row: int, outcome: AccuracyOutcome) -> None:
            rows.append(compare.compare_outcome(setting_text(settings[row]), outcome, exact))
            finished = f"{outcome.seconds:.3g} s, error {rows[-1].error:.2g}"
            summary = finished if outcome.state == "finished" else f"{outcome.state}: {outcome.reason}"
            say(f"{row + 1} of {len(settings)}: {rows[-1].setting}: {summary}")

        study.measure(settings, repeats, end_of_comparison(exact.first_fracture), report)
        compare.mark_pareto_front(rows)
        say(*compare.comparison_text(rows, exact, tolerance))
        against = {"reference": setting_text(reference), "reference_seconds": exact.seconds}
        compare.write_table(table, rows, against | {"tolerance": tolerance, "ranks": ranks})
        title, picture = job.title or job.name, table.with_suffix(".png")
        return [table, compare.plot_comparison(title, rows, exact, tolerance, picture)]


def default_reference(study: AccuracyStudy, job: Job) -> list[str]:
    """Return the default reference: a tenth of the automatic step, or of the given step if shorter.

    The automatic step is the shortest step of "auto" in a run with a single history row.
    """
    assert job.dynamics is not None  # of `read_dynamic_job`
    setting = ["dynamics.time_step=auto", "dynamics.safety=0.8", "output.frames=1"]
    setting.append(f"dynamics.duration={min(job.dynamics.duration, job.output.history_interval)!r}")
    (outcome,) = study.measure([setting], 1)
    state, reason, coarse = outcome.state, outcome.reason, outcome.time_step
    if state != "finished":
        raise InputError(messages.AUTOMATIC_STEP_FAILED(path=study.runs.job, state=state, reason=reason))
    if job.dynamics.time_step != "auto":
        coarse = min(coarse, job.dynamics.time_step)
    return [f"dynamics.time_step={coarse / REFERENCE_REFINEMENT:.6g}"]


def setting_text(setting: list[str]) -> str:
    """Return a setting as a user would type it."""
    return ", ".join(setting) or "as it is"


def combinations(vary: list[str]) -> list[list[str]]:
    """Return every combination of the values of every key. Raises InputError."""
    axes = []
    for item in vary:
        name, equals, values = item.partition("=")
        if not equals or "." not in name or not all(value.strip() for value in values.split(",")):
            raise InputError(messages.WRONG_VARIATION(item=item))
        axes.append([f"{name.strip()}={value.strip()}" for value in values.split(",")])
    return [list(choice) for choice in itertools.product(*axes)]


def default_settings(job: Job) -> list[list[str]]:
    """Return the default settings: the job unchanged, and with one key at a time changed."""
    automatic = ["dynamics.time_step=auto"]
    settings: list[list[str]] = [[]]
    settings += [[*automatic, f"dynamics.safety={safety}"] for safety in (0.95, 0.4, 0.2)]
    scaled = automatic
    if BREAKING_KEYS & {*given_cable_keys(job)}:
        settings += [[*automatic, f"dynamics.fragment_mass={share}"] for share in (0.0, 0.01, 0.02, 0.1)]
        scaled = [*automatic, "dynamics.fragments=false"]
        settings.append(scaled)
    settings += [[*scaled, f"dynamics.mass_scaling={share}"] for share in (0.02, 0.05, 0.1)]
    interval = f"output.history_interval={5.0 * job.output.history_interval:g}"
    settings.append([*scaled, "dynamics.mass_scaling=0.05", "dynamics.safety=0.95", interval])
    settings.append(["output.energy=false"])
    measures = keys_of(Cable)["strain_measure"].choices
    settings += [[f"cable.strain_measure={other}"] for other in measures if other != job.cable.strain_measure]
    return [*settings, [f"net.subdivide={2 * job.net.subdivide}"]]
