"""Outcomes against a reference: errors, Pareto front, table and plot."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from netfall.post.accuracy import tables
from netfall.post.accuracy.outcome import AccuracyOutcome
from netfall.results.locks import atomic_h5
from netfall.study.table import write_columns

ERRORS = ("displacement", "tension", "first_fracture", "broken")
HEAD = [
    *("setting", "step [s]", "seconds", "displacement [m]", "tension [kN]", "first fracture [s] (element)"),
    *("broken", "overlap", "balance", "error"),
]
NEAR = 0.08  # decades; closer points of the plot share a label


@dataclass
class SettingErrors:
    """A setting with its relative errors, and the overlap (Jaccard index of the broken sets)."""

    setting: str
    outcome: AccuracyOutcome
    errors: dict[str, float]
    error: float  # the largest relative error
    best: bool = False  # on the Pareto front: no setting is both faster and more accurate


def compare_outcome(setting: str, outcome: AccuracyOutcome, exact: AccuracyOutcome) -> SettingErrors:
    """Compute the errors of an outcome against the reference."""
    if outcome.state != "finished":
        return SettingErrors(setting, outcome, dict.fromkeys((*ERRORS, "overlap"), np.nan), np.inf)
    errors = {
        "displacement": _relative(outcome.largest_displacement, exact.largest_displacement),
        "tension": _relative(outcome.largest_tension, exact.largest_tension),
        "first_fracture": _relative(outcome.first_fracture, exact.first_fracture),
        "broken": _relative(outcome.broken, exact.broken),
    }
    broken, broken_exact = set(outcome.broken_elements.split()), set(exact.broken_elements.split())
    overlap = (
        len(broken & broken_exact) / max(1, len(broken | broken_exact)) if broken or broken_exact else 1.0
    )
    return SettingErrors(setting, outcome, errors | {"overlap": overlap}, max(errors.values()))


def _relative(value: float, exact: float) -> float:
    """Compute the error of one quantity; 0 if neither run has it, infinite if only one has."""
    if value == exact or not (np.isfinite(value) or np.isfinite(exact)):
        return 0.0
    if np.isfinite(value) and exact and np.isfinite(exact):
        return abs(value - exact) / abs(exact)
    return np.inf


def mark_pareto_front(rows: list[SettingErrors]) -> None:
    """Mark the Pareto front of run time and error."""
    for row in rows:
        row.best = row.outcome.state == "finished" and not any(
            other.outcome.state == "finished"
            and other.outcome.seconds <= row.outcome.seconds
            and other.error <= row.error
            and (other.outcome.seconds, other.error) != (row.outcome.seconds, row.error)
            for other in rows
        )


def fastest_within(rows: list[SettingErrors], tolerance: float) -> SettingErrors | None:
    """Return the fastest setting within the tolerance."""
    within = [row for row in rows if row.error <= tolerance]
    return min(within, key=lambda row: row.outcome.seconds, default=None)


def comparison_text(rows: list[SettingErrors], exact: AccuracyOutcome, tolerance: float) -> list[str]:
    """Return the table as text, with * on the Pareto front, and the fastest setting within the tolerance."""
    ranked = sorted(rows, key=lambda row: row.outcome.seconds)
    lines = [
        _cells("\\* " * row.best + row.setting, row.outcome, row.errors["overlap"], row.error)
        for row in ranked
    ]
    return [
        *tables.as_text(HEAD, [_cells("**reference**", exact, 1.0, 0.0), *lines]),
        f"cheapest within an error of {tolerance:g}: {_advice(fastest_within(rows, tolerance), exact)}"
        "; * nothing else is both faster and closer",
    ]


def _cells(name: str, o: AccuracyOutcome, overlap: float, error: float) -> list[str]:
    if o.state != "finished":
        return [name, "", "", o.state, *[""] * (len(HEAD) - 4)]
    return [
        name,
        f"{o.time_step:.3g}",
        f"{o.seconds:.3g}",
        f"{o.largest_displacement:.5g}",
        f"{o.largest_tension / 1e3:.5g}",
        f"{o.first_fracture:.5f} ({o.first_element})" if o.broken else "none",
        str(o.broken),
        f"{overlap:.2f}",
        f"{o.energy_balance_error:.1e}",
        f"{error:.2g}",
    ]


def _advice(row: SettingErrors | None, exact: AccuracyOutcome) -> str:
    if row is None:
        return "none of these"
    seconds = row.outcome.seconds
    faster = f"{exact.seconds / seconds:.1f} times faster than the reference"
    return f"{row.setting} ({seconds:.3g} s, {faster})"


def write_table(path: Path, rows: list[SettingErrors], **attributes) -> None:
    """Write the table as datasets of one length, /table; attributes : what it was measured against"""
    columns = {
        "setting": [row.setting for row in rows],
        "error": [row.error for row in rows],
        "pareto": np.array([row.best for row in rows], np.uint8),
        "overlap": [row.errors["overlap"] for row in rows],
    }
    columns |= {f"{name}_error": [row.errors[name] for row in rows] for name in ERRORS}
    columns |= {name: [getattr(row.outcome, name) for row in rows] for name in AccuracyOutcome._fields}
    with atomic_h5(path) as file:
        write_columns(file, "table", columns)
        file["table"].attrs.update(attributes)


def plot_comparison(
    title: str, rows: list[SettingErrors], exact: AccuracyOutcome, tolerance: float, path: Path
) -> Path:
    """Plot run time against error."""
    finished = sorted(
        (row for row in rows if row.outcome.state == "finished" and np.isfinite(row.error)),
        key=lambda row: row.outcome.seconds,
    )
    lines = "\n".join(f"{number:2d}  {row.setting}" for number, row in enumerate(finished, 1))
    lines = lines.replace(", ", ",\n      ")
    with tables.two_panels(path, 11, 6, width_ratios=(3, 1.3)) as (_, axes, names):
        _points(axes, finished)
        names.axis("off")
        names.text(0.0, 1.0, lines, va="top", fontsize=8, transform=names.transAxes)
        axes.axhline(tolerance, color="C3", lw=0.8, ls="--", label=f"tolerance {tolerance:g}")
        axes.axvline(exact.seconds, color="0.5", lw=0.8, ls=":", label="reference")
        axes.set(xscale="log", yscale="log", xlabel="dynamic stage [s]", ylabel="largest relative error")
        axes.set_title(f"{title}: run time against error")
        axes.margins(x=0.2)
        axes.legend(fontsize=8)
    return path


def _points(axes, finished: list[SettingErrors]) -> None:
    """Plot the settings as points with their numbers, and the Pareto front as a line."""
    floor = min([row.error for row in finished if row.error > 0], default=1e-6) / 3
    places = [(row.outcome.seconds, max(row.error, floor)) for row in finished]
    front = np.array([place for place, row in zip(places, finished) if row.best]).reshape(-1, 2)
    axes.plot(*front.T, color="C0", lw=1, zorder=1, label="nothing is both faster and closer")
    for place, row in zip(places, finished):
        axes.plot(*place, "o", color="C0" if row.best else "0.6")
    for numbers in _label_groups(places):
        text = ", ".join(str(k + 1) for k in numbers)
        axes.annotate(text, places[numbers[0]], xytext=(5, 5), textcoords="offset points", fontsize=8)


def _label_groups(places: list[tuple[float, float]]) -> list[list[int]]:
    """Group points whose labels would overlap."""
    groups: list[list[int]] = []
    decades = np.log10(places).reshape(-1, 2)
    for k in range(len(places)):
        group = next((group for group in groups if np.abs(decades[group[0]] - decades[k]).max() < NEAR), None)
        if group is None:
            groups.append([k])
        else:
            group.append(k)
    return groups
