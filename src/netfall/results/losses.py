"""Removed ([[remove]]) and broken elements of a result: times, and tensions before and after."""

from typing import Any

import numpy as np

from netfall.results.removal_text import significant_dynamic_factors, tension_ratios


def lost_at(f: Any) -> np.ndarray:
    """Return the time (m,) [s] at which each element was removed, nan if it was not."""
    time = np.full(len(f["net/elements"]), np.nan)
    if "removal" in f:
        time[f["removal/element"][:]] = f["removal/time"][:][f["removal/entry"][:]]
    return time


def broken_at(f: Any) -> np.ndarray:
    """Return the time (m,) [s] at which each element broke, nan if it did not."""
    time = np.full(len(f["net/elements"]), np.nan)
    if "events" in f:
        e, t = f["events/element"][:], f["events/time"][:]
        time[e[::-1]] = t[::-1]  # if both ends broke, the earlier fracture
    return time


def removal_stages(f: Any) -> list[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
    """Return envelope rows of each member removal: name, largest and least tension, failed elements.

    Tensions are (m,) [N], failed elements (m,) bool. The first row has the extremes over all steps, which the
    history rows miss. The second has the equilibrium of the damaged net, if it exists. Entries at the same
    time share their tensions and count as one removal. nan: not known.
    """
    if "removal" not in f:
        return []
    removal, removal_time, broken, rows = f["removal"], lost_at(f), ~np.isnan(broken_at(f)), []
    time = removal["time"][:]
    happened = set(removal["entry"][:].tolist())
    for t in sorted({time[k] for k in happened}):
        entries = np.flatnonzero(time == t)
        name = f"loss{'es' * (len(entries) > 1)} {', '.join(str(k + 1) for k in entries)}"
        removed = removal_time <= t
        high, low = (removal[f"tension_{which}"][entries[0]] for which in ("highest", "lowest"))
        rows.append((f"{name}, t = {t:.4g} s", high, low, removed | broken))
        after = np.where(removed, np.nan, removal["tension_after"][entries[0]])
        if not np.isnan(after).all():
            rows.append((f"rest after {name}", after, after, removed))
    return rows


def largest_after_removals(f: Any) -> dict[str, np.ndarray]:
    """Return the largest tension ratio and significant dynamic factor (m,) after any removal, nan if none."""
    removal, entries = f["removal"], range(len(f["removal/time"]))
    unknown = np.full(len(f["net/elements"]), np.nan)
    return {
        "tension_ratio": np.fmax.reduce([unknown, *(tension_ratios(removal, k) for k in entries)]),
        "dynamic_factor": np.fmax.reduce(
            [unknown, *(significant_dynamic_factors(removal, k) for k in entries)]
        ),
    }


def worst_removals(f: Any, resistance: np.ndarray, count: int) -> list[tuple[int, int]]:
    """Return removal and element with the highest utilisation of a resistance (m,) [N], the worst first.

    If no element has a resistance, the largest tensions count. Each cable appears once per removal. Entries
    at the same time count as one removal.
    """
    removal, cable = f["removal"], f["net/cable"][:]
    candidates = []
    for k in np.unique(removal["time"][:], return_index=True)[1]:
        utilisation = removal["tension_highest"][k] / (resistance if np.isfinite(resistance).any() else 1.0)
        rows = np.flatnonzero(utilisation > 0.0)
        rows = rows[np.argsort(-utilisation[rows], kind="stable")]
        rows = rows[np.sort(np.unique(cable[rows], return_index=True)[1])][:count]
        candidates += [(float(utilisation[e]), int(k), int(e)) for e in rows]
    return [(k, e) for _, k, e in sorted(candidates, key=lambda candidate: -candidate[0])[:count]]
