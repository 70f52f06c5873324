"""What the loss of members did, in sentences, from the datasets of a result; no file is opened here."""

import numpy as np

MOST_NAMED = 4  # ids of what was lost, and of the largest factors
MUCH = 0.02  # of the largest tension: factors of what changes less are large without being telling


def loss_lines(removal, events, element_id: np.ndarray) -> list[str]:
    """A line for each loss: what was lost, whether the roof comes to rest, what else broke, largest factors.

    removal, events : datasets by name, as in the result file; element_id : (m,)
    """
    lines, time = [], removal["time"][:]
    for k in range(len(time)):
        lost = removal["element"][:][removal["entry"][:] == k]
        if not len(lost):
            lines.append(f"loss {k + 1}: nothing was lost: after the end, or lost before")
            continue
        later = time[time > time[k]].min(initial=np.inf)
        broke = (events["time"][:] >= time[k]) & (events["time"][:] < later)
        others = np.unique(events["element"][:][broke])
        rest = removal["tension_after"][k]
        parts = [
            f"loss {k + 1}, t = {time[k]:.4g} s: {_elements(element_id[lost])}",
            "no rest was found" if np.isnan(rest).all() else "the rest of the net comes to rest",
            f"{_elements(element_id[others])} broke then" if len(others) else "nothing broke then",
        ]
        lines.append("; ".join(parts + _factors(telling_factor(removal, k), element_id)))
    return lines


def telling_factor(removal, k: int) -> np.ndarray:
    """Dynamic factors (m,) of entry k where the rest changes by much, nan elsewhere; as in `loss_lines`."""
    before, after = removal["tension_before"][k], removal["tension_after"][k]
    largest = np.fmax(np.abs(before), np.abs(after)).max(initial=0.0)  # nan where there is no rest
    return np.where(np.abs(after - before) > MUCH * largest, removal["dynamic_factor"][k], np.nan)


def _factors(factor: np.ndarray, element_id: np.ndarray) -> list[str]:
    rows = np.flatnonzero(~np.isnan(factor))
    if not len(rows):
        return []
    rows = rows[np.argsort(-factor[rows], kind="stable")]
    rows = rows[np.sort(np.unique(element_id[rows], return_index=True)[1])][
        :MOST_NAMED
    ]  # the largest of each
    named = ", ".join(f"{factor[e]:.3g} (element {element_id[e]})" for e in rows)
    return [f"largest dynamic factors {named}, where the rest changes by {MUCH:.0%} of the largest tension"]


def _elements(ids: np.ndarray) -> str:
    ids = list(dict.fromkeys(ids.tolist()))  # the parts of one that was subdivided share its id
    few = ", ".join(map(str, ids[:MOST_NAMED])) + (", ..." if len(ids) > MOST_NAMED else "")
    return f"element {few}" if len(ids) == 1 else f"{len(ids)} elements ({few})"
