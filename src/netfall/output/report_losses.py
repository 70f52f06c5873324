"""What a report tells of members that were lost ([[remove]]) or broke: when, and the tensions around it."""

import numpy as np


def lost_at(f) -> np.ndarray:
    """Time (m,) [s] at which elements were lost, nan: not at all."""
    time = np.full(len(f["net/elements"]), np.nan)
    if "removal" in f:
        time[f["removal/element"][:]] = f["removal/time"][:][f["removal/entry"][:]]
    return time


def broken_at(f) -> np.ndarray:
    """Time (m,) [s] at which elements broke, nan: whole."""
    time = np.full(len(f["net/elements"]), np.nan)
    if "events" in f:
        e, t = f["events/element"][:], f["events/time"][:]
        time[e[::-1]] = t[::-1]  # of two ends the first
    return time


def loss_rows(f) -> list[tuple[str, np.ndarray, np.ndarray, np.ndarray]]:
    """Name, largest and least tension (m,) [N], and what is gone (m,) bool, of two stages for each loss.

    The peak is one of every step, which the rows of the history miss; then the rest of the damaged net, where
    there is one. Entries of one moment have the same tensions and are one loss. nan: not known.
    """
    if "removal" not in f:
        return []
    g, lost, broken, rows = f["removal"], lost_at(f), ~np.isnan(broken_at(f)), []
    time = g["time"][:]
    happened = set(g["entry"][:].tolist())
    for t in sorted({time[k] for k in happened}):
        entries = np.flatnonzero(time == t)
        name = f"loss{'es' * (len(entries) > 1)} {', '.join(str(k + 1) for k in entries)}"
        gone = lost <= t
        peak = np.where(gone, np.nan, g["tension_peak"][entries[0]])
        rows.append((f"{name}, t = {t:.4g} s", peak, peak, gone | broken))
        after = np.where(gone, np.nan, g["tension_after"][entries[0]])
        if not np.isnan(after).all():
            rows.append((f"rest after {name}", after, after, gone))
    return rows
