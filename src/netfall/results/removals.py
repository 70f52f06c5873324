"""Removed ([[remove]]) and broken elements of a result: times, tensions before and after, and text."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from netfall.job.values import counted
from netfall.results.datasets import BEYOND_LIMIT_POINT, EQUILIBRIUM, NO_EQUILIBRIUM, UNDECIDED, UNSTABLE

REMOVAL = "removal"  # group of member removals
MOST_NAMED = 4  # elements that a line names: those with the largest values
MIN_STATIC_CHANGE = 0.1  # of the element's tension; dynamic factors of smaller changes are meaningless
LEAST_FACTOR = 0.9  # dynamic factor below which the motion may end before the peak
NEGLIGIBLE_TENSION = 0.02  # of the net's largest tension: smaller tensions are negligible
WHERE_SIGNIFICANT = (
    f"if the equilibrium changes by more than {MIN_STATIC_CHANGE:.0%} of the element's tension and "
    f"{NEGLIGIBLE_TENSION:.0%} of the net's largest"
)
# Outcomes of the equilibrium search after a member removal, worst first, and their text.
OUTCOME_TEXT = {
    NO_EQUILIBRIUM: "the net has no equilibrium",
    UNDECIDED: "it is undecided whether the net has an equilibrium",
    UNSTABLE: "the equilibrium of the net is unstable",
    BEYOND_LIMIT_POINT: "the path to the equilibrium of the net passes a limit point",
    "breaks": "the net is in equilibrium, but strengths are exceeded",
    EQUILIBRIUM: "the net is in equilibrium",
}
REMOVAL_FAILED = (NO_EQUILIBRIUM, UNSTABLE, BEYOND_LIMIT_POINT)  # outcomes without a stable equilibrium


def removal_states(removal: Any) -> list[str]:
    """Return the outcome after each entry, a key of OUTCOME_TEXT; "" if nothing was removed."""
    names = removal["state"]
    return [str(name) for name in (names.asstr()[:] if hasattr(names, "asstr") else names)]


def removal_lines(
    removal: Any, events: Any, element_id: np.ndarray, displacements: list[list[str]] | None = None
) -> list[str]:
    """Describe each member removal: elements, equilibrium after it, fractures, largest dynamic factors.

    removal, events : datasets by name, as in the result file; element_id : (m,)
    displacements : text on those in the equilibrium after each entry, [] if it is not known
    """
    lines, time, outcomes = [], removal["time"][:], removal_states(removal)
    torn = first_fracture(events)
    for k in range(len(time)):
        removed = removal["element"][:][removal["entry"][:] == k]
        if not len(removed):
            lines.append(
                f"removal {k + 1}: nothing was removed: its time is after the end, or it was removed before"
            )
            continue
        after_removal = (events["time"][:] >= time[k]) & (events["time"][:] < _next_time(removal, k))
        broken = np.unique(events["element"][:][after_removal])
        breaking = element_id[removal["breaking_element"][:][removal["breaking_entry"][:] == k]]
        parts = [
            f"removal {k + 1}, t = {time[k]:.4g} s: {counted('element', element_id[removed])}",
            OUTCOME_TEXT[outcomes[k] or NO_EQUILIBRIUM]
            + (f": {counted('element', breaking)}" if len(breaking) else ""),
            f"{counted('element', element_id[broken])} broke afterwards"
            if len(broken)
            else "nothing broke afterwards",
            *(displacements[k] if displacements else []),
        ]
        ratio, factor = tension_ratios(removal, k), significant_dynamic_factors(removal, k, torn)
        before, highest = removal["tension_before"][k] / 1e3, removal["tension_highest"][k] / 1e3
        ratios = [
            f"{ratio[e]:.3g} (element {element_id[e]}: {before[e]:.4g} -> {highest[e]:.4g} kN)"
            for e in _largest_of_each(ratio, element_id)
        ]
        if ratios:
            parts.append(f"largest tension over tension before {', '.join(ratios)}")
        factors = [f"{factor[e]:.3g} (element {element_id[e]})" for e in _largest_of_each(factor, element_id)]
        if factors:
            parts.append(f"largest dynamic factors {', '.join(factors)}, {WHERE_SIGNIFICANT}")
        if len(early := element_id[factor < LEAST_FACTOR]):
            parts.append(
                f"{counted('element', early)} did not reach the tension of that equilibrium before the next "
                "removal or the end: check that the motion after the removal is long enough"
            )
        parts += _residual_motion_text(removal, k)
        lines.append("; ".join(parts))
    return lines


def tension_ratios(removal: Any, k: int) -> np.ndarray:
    """Compute the largest tension after entry k over the tension before it (m,).

    nan if the tension before is negligible or the element was removed.
    """
    before, highest = removal["tension_before"][k], removal["tension_highest"][k]
    significant = before > NEGLIGIBLE_TENSION * np.fmax.reduce(before, initial=0.0)
    return np.divide(highest, before, out=np.full(len(before), np.nan), where=significant)


def _residual_motion_text(removal: Any, k: int) -> list[str]:
    """Return a remark if the roof still moved at entry k because of an earlier removal.

    The tensions before entry k then differ from those of the equilibrium after that earlier removal.
    """
    time = removal["time"][:]
    earlier = np.flatnonzero(time < time[k])
    if not len(earlier):
        return []
    j = earlier[np.argmax(time[earlier])]
    before, static = removal["tension_before"][k], removal["tension_after"][j]
    deviation, largest = (np.fmax.reduce(np.abs(N), initial=0.0) for N in (before - static, static))
    if deviation <= NEGLIGIBLE_TENSION * largest:
        return []
    return [
        f"the roof still moved from removal {j + 1}, with tensions up to {deviation / 1e3:.4g} kN off the "
        "equilibrium: factors and largest tensions are of both"
    ]


def first_fracture(events: Any) -> float:
    """Return the time [s] of the first fracture; inf: none. events : datasets by name"""
    return float(events["time"][:].min(initial=np.inf))


def _next_time(removal: Any, k: int) -> float:
    """Return the time [s] of the next removal after entry k; inf: no removal follows."""
    time = removal["time"][:]
    return float(time[time > time[k]].min(initial=np.inf))


def significant_dynamic_factors(removal: Any, k: int, torn: float = np.inf) -> np.ndarray:
    """Return the dynamic factors (m,) of entry k, nan if the static change is negligible.

    Negligible is less than MIN_STATIC_CHANGE of the element's larger static tension, or less than
    NEGLIGIBLE_TENSION of the net's largest tension.
    torn : [s] time of the first fracture; if it is before the next removal, all are nan, because the factors
    refer to the equilibrium of a net without fractures
    """
    if torn < np.inf and torn < _next_time(removal, k):
        return np.full(len(removal["tension_before"][k]), np.nan)
    before, after = removal["tension_before"][k], removal["tension_after"][k]
    larger = np.fmax(np.abs(before), np.abs(after))
    least_change = np.maximum(MIN_STATIC_CHANGE * larger, NEGLIGIBLE_TENSION * larger.max(initial=0.0))
    return np.where(np.abs(after - before) > least_change, removal["dynamic_factor"][k], np.nan)


def _largest_of_each(values: np.ndarray, number: np.ndarray, count: int = MOST_NAMED) -> np.ndarray:
    """Return the rows of the largest known values, at most `count`, and one row per number (m,)."""
    rows = np.flatnonzero(~np.isnan(values))
    rows = rows[np.argsort(-values[rows], kind="stable")]
    return rows[np.sort(np.unique(number[rows], return_index=True)[1])][:count]


def removal_times(f: Any) -> np.ndarray:
    """Return the time (m,) [s] at which each element was removed, nan if it was not."""
    time = np.full(len(f["net/elements"]), np.nan)
    if "removal" in f:
        time[f["removal/element"][:]] = f["removal/time"][:][f["removal/entry"][:]]
    return time


def fracture_times(f: Any) -> np.ndarray:
    """Return the time (m,) [s] at which each element broke, nan if it did not."""
    time = np.full(len(f["net/elements"]), np.nan)
    if "events" in f:
        e, t = f["events/element"][:], f["events/time"][:]
        time[e[::-1]] = t[::-1]  # if both ends broke, the earlier fracture
    return time


def removals_by_time(removal: Any) -> Iterator[tuple[float, int, str]]:
    """Yield the time [s] of each removal, its first entry and its name, which contains all its entries."""
    time = removal["time"][:]
    for t in np.unique(time[np.unique(removal["entry"][:])]):
        entries = np.flatnonzero(time == t)
        yield t, entries[0], f"removal{'s' * (len(entries) > 1)} {', '.join(str(k + 1) for k in entries)}"


def removal_stages(f: Any) -> list[tuple[str, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Return envelope rows of each member removal: name, largest and least tension, moment, failed elements.

    Tensions are (m,) [N], moments (m,) [N m], failed elements (m,) bool. The first row has the extremes over
    all steps; the history rows can miss them. The second row has the equilibrium of the damaged net, if it
    exists. Entries at the same time share their tensions and count as one removal. nan: not known.
    """
    if "removal" not in f:
        return []
    removal, removal_time, broken, rows = f["removal"], removal_times(f), ~np.isnan(fracture_times(f)), []
    for t, entry, name in removals_by_time(removal):
        removed = removal_time <= t
        high, low = (removal[f"tension_{which}"][entry] for which in ("highest", "lowest"))
        unknown = np.full(len(high), np.nan)
        rows.append((f"{name}, t = {t:.4g} s", high, low, unknown, removed | broken))
        after = np.where(removed, np.nan, removal["tension_after"][entry])
        if not np.isnan(after).all():
            has_moment = "bending_moment_after" in removal
            moment = removal["bending_moment_after"][entry] if has_moment else unknown
            rows.append((f"equilibrium after {name}", after, after, moment, removed))
    return rows


def largest_after_removals(f: Any) -> dict[str, np.ndarray]:
    """Return the largest tension ratio and significant dynamic factor (m,) after any removal, nan if none."""
    removal, entries, torn = f["removal"], range(len(f["removal/time"])), first_fracture(f["events"])
    unknown = np.full(len(f["net/elements"]), np.nan)
    return {
        "tension_ratio": np.fmax.reduce([unknown, *(tension_ratios(removal, k) for k in entries)]),
        "dynamic_factor": np.fmax.reduce(
            [unknown, *(significant_dynamic_factors(removal, k, torn) for k in entries)]
        ),
    }


def worst_removals(
    f: Any, resistance: np.ndarray, end_weight: np.ndarray, count: int
) -> list[tuple[int, int]]:
    """Return removal and element with the highest utilisation of a resistance (m,) [N], worst first.

    end_weight : (m,) [N], what the force at an end exceeds that in the middle by
    If no element has a resistance, the largest tensions count. Each cable appears once per removal. Entries
    at the same time count as one removal.
    """
    removal, cable, candidates = f["removal"], f["net/cable"][:], []
    for k in np.unique(removal["time"][:], return_index=True)[1]:
        at_end = removal["tension_highest"][k] + end_weight
        utilisation = at_end / (resistance if np.isfinite(resistance).any() else 1.0)
        rows = _largest_of_each(np.where(utilisation > 0.0, utilisation, np.nan), cable, count)
        candidates += [(float(utilisation[e]), int(k), int(e)) for e in rows]
    return [(k, e) for _, k, e in sorted(candidates, key=lambda candidate: -candidate[0])[:count]]
