"""Outcomes of the runs of an accuracy study: their journal; errors, Pareto front, table and plot."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from netfall.post.plots import canvas
from netfall.post.report.markdown import plain_table
from netfall.results.file import Frames
from netfall.results.locks import atomic_h5
from netfall.results.warning_text import MAX_BALANCE_ERROR
from netfall.study.files import Journal, read_journal
from netfall.study.table import write_columns

NAN = float("nan")
REPRODUCIBLE_STATES = {0: "finished", 2: "refused", 3: "diverged"}  # by exit code: a repeated run ends alike


class AccuracyOutcome(NamedTuple):
    """Outcome of one run in SI units; nan if a quantity does not exist."""

    state: str  # finished | refused | diverged | failed
    reason: str = ""
    seconds: float = NAN  # run time of the dynamic stage on the slowest rank
    time_step: float = NAN
    largest_displacement: float = NAN  # up to the reference's first fracture
    largest_tension: float = NAN  # up to the reference's first fracture
    first_fracture: float = NAN  # time [s]
    first_element: int = -1
    broken: int = -1
    energy_balance_error: float = NAN
    broken_elements: str = ""  # ids, for the overlap


def read_outcome(answer: dict[str, Any], file: h5py.File | None, until: float | None) -> AccuracyOutcome:
    """Return the outcome of a run from its worker's answer and its result file, None without a file.

    until : time [s] up to which displacement and tension count, None: the first fracture of this run
    """
    if file is None:
        return AccuracyOutcome(REPRODUCIBLE_STATES.get(answer["exit_code"], "failed"), answer["reason"])
    frames, events, ids = Frames(file), file["events"], file["net/element_id"][:]
    first = float(events["time"][0]) if len(events["time"]) else NAN
    if until is None:
        until = end_of_comparison(first)
    broken = np.unique(ids[events["element"][:]])  # parts of a subdivided element share its id
    if np.isinf(until):  # snapshots miss peaks, but an envelope also covers the time after a fracture
        displacements, tensions = file["envelope/displacement_max"][:], file["envelope/tension_max"][:]
    else:
        steps = np.flatnonzero(frames.times <= until)
        displacements = [np.linalg.norm(frames.point("displacement", step), axis=1).max() for step in steps]
        tensions = [frames.tension(step).max() for step in steps]
    return AccuracyOutcome(
        "finished",
        seconds=float(file["provenance/timings"].attrs["dynamics"][2]),
        time_step=float(file["provenance"].attrs["shortest_time_step"]),
        largest_displacement=float(np.fmax.reduce(displacements, initial=0.0)),
        largest_tension=float(np.fmax.reduce(tensions, initial=0.0)),
        first_fracture=first,
        first_element=int(ids[events["element"][0]]) if len(broken) else -1,
        broken=len(broken),
        energy_balance_error=float(np.abs(file["history/energy_balance_error"][:]).max()),
        broken_elements=" ".join(map(str, broken.tolist())),
    )


def end_of_comparison(first_fracture: float) -> float:
    """Return the time [s] up to which runs are compared: the first fracture of the reference, or the end."""
    return first_fracture if np.isfinite(first_fracture) else np.inf


class OutcomeJournal:
    """Outcomes so far by run key, in a journal, so that an interrupted accuracy study can continue."""

    def __init__(self, path: Path, header: dict[str, Any]) -> None:
        """header : inputs of all outcomes; if it has changed, a new journal starts"""
        records = read_journal(path)[0] if path.exists() else []
        if records[:1] != [header]:
            path.unlink(missing_ok=True)
        self.there: dict[str, list[AccuracyOutcome]] = {}
        for record in records[1:] if path.exists() else []:
            self.there.setdefault(record["run"], []).append(AccuracyOutcome(**record["outcome"]))
        self.journal = Journal(path, header)

    def add(self, key: str, outcome: AccuracyOutcome) -> None:
        """Add an outcome. It is not written to the journal if a repeated run may improve it."""
        self.there.setdefault(key, []).append(outcome)
        if outcome.state in REPRODUCIBLE_STATES.values():
            self.journal.add({"run": key, "outcome": outcome._asdict()})

    def best(self, key: str, repeats: int) -> AccuracyOutcome | None:
        """Return the fastest of `repeats` runs; None if more runs are needed.

        A key with an unfinished run needs no more runs.
        """
        outcomes = self.there.get(key, [])
        finished = [outcome for outcome in outcomes if outcome.state == "finished"]
        if len(finished) == len(outcomes) < repeats:
            return None
        return min(finished, key=lambda outcome: outcome.seconds, default=outcomes[-1])

    def close(self) -> None:
        """Close the journal."""
        self.journal.sync()
        self.journal.close()


COMPARED = {  # outcomes to compare with the reference, by the names of their errors
    "displacement": "largest_displacement",
    "tension": "largest_tension",
    "first_fracture": "first_fracture",
    "broken": "broken",
}
HEAD = [
    *("setting", "step [s]", "seconds", "displacement [m]", "tension [kN]", "first fracture [s] (element)"),
    *("broken", "overlap", "balance", "error"),
]


@dataclass
class SettingErrors:
    """A setting with its relative errors, and the overlap (Jaccard index of the broken sets)."""

    setting: str
    outcome: AccuracyOutcome
    errors: dict[str, float]
    overlap: float
    error: float  # the largest relative error
    best: bool = False  # on the Pareto front: no setting is both faster and more accurate


def compare_outcome(setting: str, outcome: AccuracyOutcome, exact: AccuracyOutcome) -> SettingErrors:
    """Compute the errors of an outcome against the reference."""
    if outcome.state != "finished":
        return SettingErrors(setting, outcome, dict.fromkeys(COMPARED, np.nan), np.nan, np.inf)
    pairs = {name: (getattr(outcome, key), getattr(exact, key)) for name, key in COMPARED.items()}
    errors = {name: _relative(*pair) for name, pair in pairs.items()}
    broken, broken_exact = set(outcome.broken_elements.split()), set(exact.broken_elements.split())
    either = broken | broken_exact
    overlap = len(broken & broken_exact) / len(either) if either else 1.0
    return SettingErrors(setting, outcome, errors, overlap, max(errors.values()))


def _relative(value: float, exact: float) -> float:
    """Compute the error of one quantity; 0 if neither run has it, infinite if only one run has it."""
    if value == exact or not (np.isfinite(value) or np.isfinite(exact)):
        return 0.0
    if np.isfinite(value) and exact and np.isfinite(exact):
        return abs(value - exact) / abs(exact)
    return np.inf


def mark_pareto_front(rows: list[SettingErrors]) -> None:
    """Mark the Pareto front of run time and error."""
    places = [(row.outcome.seconds, row.error) for row in rows if row.outcome.state == "finished"]
    for row in rows:
        own = row.outcome.seconds, row.error
        better = [place for place in places if place != own and place[0] <= own[0] and place[1] <= own[1]]
        row.best = own in places and not better


def comparison_text(rows: list[SettingErrors], exact: AccuracyOutcome, tolerance: float) -> list[str]:
    """Return the table as text, with * on the Pareto front, and the fastest setting within the tolerance.

    A run with a large energy balance error (W735) is not recommended.
    """
    ranked = sorted(rows, key=lambda row: row.outcome.seconds)
    lines = [_cells("\\* " * row.best + row.setting, row.outcome, row.overlap, row.error) for row in ranked]
    advice = "none of these"
    # an unknown error, nan, does not count as large
    balanced = [row for row in rows if not row.outcome.energy_balance_error > MAX_BALANCE_ERROR]
    if within := [row for row in balanced if row.error <= tolerance]:
        fastest = min(within, key=lambda row: row.outcome.seconds)
        seconds = fastest.outcome.seconds
        faster = f"{exact.seconds / seconds:.1f} times faster than the reference"
        advice = f"{fastest.setting} ({seconds:.3g} s, {faster})"
    return [
        *plain_table(HEAD, [_cells("**reference**", exact, 1.0, 0.0), *lines]),
        f"cheapest within an error of {tolerance:g}, energy balance within {MAX_BALANCE_ERROR:g}: {advice}; "
        "* no other setting is both faster and more accurate",
    ]


def _cells(name: str, o: AccuracyOutcome, overlap: float, error: float) -> list[str]:
    if o.state != "finished":
        return [name, "", "", o.state, *[""] * (len(HEAD) - 4)]
    first = f"{o.first_fracture:.5f} ({o.first_element})" if o.broken else "none"
    return [
        *(name, f"{o.time_step:.3g}", f"{o.seconds:.3g}", f"{o.largest_displacement:.5g}"),
        *(f"{o.largest_tension / 1e3:.5g}", first, str(o.broken), f"{overlap:.2f}"),
        *(f"{o.energy_balance_error:.1e}", f"{error:.2g}"),
    ]


def write_table(path: Path, rows: list[SettingErrors], attributes: dict[str, Any]) -> None:
    """Write the table as datasets of one length, /table; attributes : of the reference"""
    columns = {
        "setting": [row.setting for row in rows],
        "error": [row.error for row in rows],
        "pareto": np.array([row.best for row in rows], np.uint8),
        "overlap": [row.overlap for row in rows],
    }
    columns |= {f"{name}_error": [row.errors[name] for row in rows] for name in COMPARED}
    columns |= {name: [getattr(row.outcome, name) for row in rows] for name in AccuracyOutcome._fields}
    with atomic_h5(path) as file:
        write_columns(file, "table", columns)
        file["table"].attrs.update(attributes)


def plot_comparison(
    title: str, rows: list[SettingErrors], exact: AccuracyOutcome, tolerance: float, path: Path
) -> Path:
    """Plot run time against error: settings as points with numbers, and the Pareto front as a line."""
    shown = [row for row in rows if row.outcome.state == "finished" and np.isfinite(row.error)]
    shown.sort(key=lambda row: row.outcome.seconds)
    floor = min([row.error for row in shown if row.error > 0], default=1e-6) / 3
    points = np.array([(row.outcome.seconds, max(row.error, floor)) for row in shown]).reshape(-1, 2)
    best = np.array([row.best for row in shown], bool)
    figure, ((axes, names),) = canvas.open_charts(1, 2, 11, 6, width_ratios=(3, 1.3))
    lines = "\n".join(f"{number:2d}  {row.setting}" for number, row in enumerate(shown, 1))
    names.axis("off")
    names.text(0.0, 1.0, lines.replace(", ", ",\n      "), va="top", fontsize=8, transform=names.transAxes)
    axes.plot(
        *points[best].T, color="C0", lw=1, zorder=1, label="no other setting is both faster and more accurate"
    )
    axes.plot(*points[best].T, "o", color="C0", zorder=1001)  # labels do not cover them
    axes.plot(*points[~best].T, "o", color="0.6", zorder=1001)
    axes.axhline(tolerance, color="C3", lw=0.8, ls="--", label=f"tolerance {tolerance:g}")
    axes.axvline(exact.seconds, color="0.5", lw=0.8, ls=":", label="reference")
    axes.set(xscale="log", yscale="log", xlabel="dynamic stage [s]", ylabel="largest relative error")
    axes.set_title(f"{title}: run time against error")
    axes.margins(x=0.2)
    axes.legend(fontsize=8)
    canvas.add_labels(axes, points, [str(number) for number in range(1, len(shown) + 1)])
    return canvas.save(figure, path)
