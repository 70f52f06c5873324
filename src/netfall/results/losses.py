"""What a report tells of members that were lost ([[remove]]) or broke: when, and the tensions around it."""

import numpy as np

from netfall.results.loss_lines import telling_factor, tension_ratios


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

    The extremes are those of every step, which the rows of the history miss; then the rest of the damaged
    net, where there is one. Entries of one moment have the same tensions and are one loss. nan: not known.
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
        high, low = (g[f"tension_{which}"][entries[0]] for which in ("highest", "lowest"))
        rows.append((f"{name}, t = {t:.4g} s", high, low, gone | broken))
        after = np.where(gone, np.nan, g["tension_after"][entries[0]])
        if not np.isnan(after).all():
            rows.append((f"rest after {name}", after, after, gone))
    return rows


def largest_after(f) -> dict[str, np.ndarray]:
    """The largest tension over tension before, and telling dynamic factor, (m,) after any loss; nan: none."""
    none, every = np.full(len(f["net/elements"]), np.nan), range(len(f["removal/time"]))
    largest = lambda of: np.fmax.reduce([none, *(of(f["removal"], k) for k in every)])
    return {"tension_ratio": largest(tension_ratios), "dynamic_factor": largest(telling_factor)}


def worst_after(f, resistance: np.ndarray, count: int) -> list[tuple[int, int]]:
    """Loss and element of the tensions that use the most of the resistance (m,) [N], the worst first.

    Where nothing has a resistance the largest. Of each cable one after each loss; entries of one moment are
    one loss.
    """
    g, cable = f["removal"], f["net/cable"][:]
    found = []
    for k in np.unique(g["time"][:], return_index=True)[1]:
        share = g["tension_highest"][k] / (resistance if np.isfinite(resistance).any() else 1.0)
        rows = np.flatnonzero(share > 0.0)
        rows = rows[np.argsort(-share[rows], kind="stable")]
        rows = rows[np.sort(np.unique(cable[rows], return_index=True)[1])][:count]
        found += [(float(share[e]), int(k), int(e)) for e in rows]
    return [(k, e) for _, k, e in sorted(found, key=lambda one: -one[0])[:count]]
