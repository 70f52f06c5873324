"""What the loss of members did, in sentences, from the datasets of a result; no file is opened here."""

import numpy as np

from netfall.job.values import counted

MOST_NAMED = 4  # elements, those with the largest values
STATIC_CHANGE = 0.1  # of the largest tension of the net: with less a dynamic factor has no meaning
LITTLE = 0.02  # of the largest tension of the net: tensions below are next to none
SOMETHING_BREAKS = "something breaks there"
# What came of the search for the rest after a loss, the worst first, and how it is told everywhere.
RESTS = {
    "no_equilibrium": "no rest was found",
    "undecided": "it is undecided whether the rest of the net comes to rest: the search ended",
    "unstable": "no rest was found, not stable",
    "breaks": f"the rest of the net would come to rest, but {SOMETHING_BREAKS}",
    "equilibrium": "the rest of the net comes to rest",
}
WITHOUT = ("no_equilibrium", "unstable")  # a rest


def states_of_rest(removal) -> list[str]:
    """For each entry what came of its rest, a key of RESTS; "": nothing was lost."""
    names = removal["state"]
    return [str(name) for name in (names.asstr()[:] if hasattr(names, "asstr") else names)]


def worst_rest(states: list[str]) -> str:
    """The worst of some, "": none."""
    return next((state for state in RESTS if state in states), "")


def loss_lines(removal, events, element_id: np.ndarray) -> list[str]:
    """A line for each loss: what was lost, whether the roof comes to rest, what else broke, largest factors.

    removal, events : datasets by name, as in the result file; element_id : (m,)
    """
    lines, time, rests = [], removal["time"][:], states_of_rest(removal)
    for k in range(len(time)):
        lost = removal["element"][:][removal["entry"][:] == k]
        if not len(lost):
            lines.append(f"loss {k + 1}: nothing was lost: after the end, or lost before")
            continue
        later = time[time > time[k]].min(initial=np.inf)
        broke = (events["time"][:] >= time[k]) & (events["time"][:] < later)
        others = np.unique(events["element"][:][broke])
        torn = element_id[removal["breaking_element"][:][removal["breaking_entry"][:] == k]]  # in that rest
        parts = [
            f"loss {k + 1}, t = {time[k]:.4g} s: {counted('element', element_id[lost])}",
            RESTS[rests[k] or "no_equilibrium"] + (f": {counted('element', torn)}" if len(torn) else ""),
            f"{counted('element', element_id[others])} broke then" if len(others) else "nothing broke then",
        ]
        parts += _ratios(removal, k, element_id) + _factors(telling_factor(removal, k), element_id)
        parts += _unrest(removal, k)
        lines.append("; ".join(parts))
    return lines


def tension_ratios(removal, k: int) -> np.ndarray:
    """Largest tension after entry k over that before (m,); nan where that is next to none, or lost."""
    before, highest = removal["tension_before"][k], removal["tension_highest"][k]
    telling = before > LITTLE * np.fmax.reduce(before, initial=0.0)
    return np.divide(highest, before, out=np.full(len(before), np.nan), where=telling)


def _ratios(removal, k: int, element_id: np.ndarray) -> list[str]:
    ratio, before, highest = (
        tension_ratios(removal, k),
        removal["tension_before"][k],
        removal["tension_highest"][k],
    )
    named = [
        f"{ratio[e]:.3g} (element {element_id[e]}: {before[e] / 1e3:.4g} -> {highest[e] / 1e3:.4g} kN)"
        for e in _largest_of_each(ratio, element_id)
    ]
    return [f"largest tension over tension before {', '.join(named)}"] if named else []


def _unrest(removal, k: int) -> list[str]:
    """Whether the roof still moved from the loss before entry k: tensions then are not those of its rest."""
    time = removal["time"][:]
    earlier = np.flatnonzero(time < time[k])
    if not len(earlier):
        return []
    j = earlier[np.argmax(time[earlier])]
    before, rest = removal["tension_before"][k], removal["tension_after"][j]
    off, largest = (np.fmax.reduce(np.abs(N), initial=0.0) for N in (before - rest, rest))
    if off <= LITTLE * largest:
        return []
    return [
        f"the roof still moved from loss {j + 1}, with tensions up to {off / 1e3:.4g} kN off its rest: "
        "factors and largest tensions are of both"
    ]


def telling_factor(removal, k: int) -> np.ndarray:
    """Dynamic factors (m,) of entry k; nan where the equilibrium changes by less than STATIC_CHANGE."""
    before, after = removal["tension_before"][k], removal["tension_after"][k]
    largest = np.fmax(np.abs(before), np.abs(after)).max(initial=0.0)  # nan where there is no rest
    return np.where(np.abs(after - before) > STATIC_CHANGE * largest, removal["dynamic_factor"][k], np.nan)


def _factors(factor: np.ndarray, element_id: np.ndarray) -> list[str]:
    rows = _largest_of_each(factor, element_id)
    if not len(rows):
        return []
    named = ", ".join(f"{factor[e]:.3g} (element {element_id[e]})" for e in rows)
    of = f"{STATIC_CHANGE:.0%} of the largest tension"
    return [f"largest dynamic factors {named}, where the equilibrium changes by more than {of}"]


def _largest_of_each(values: np.ndarray, element_id: np.ndarray) -> np.ndarray:
    """Rows of the largest values that are known, one of the parts of each element."""
    rows = np.flatnonzero(~np.isnan(values))
    rows = rows[np.argsort(-values[rows], kind="stable")]
    return rows[np.sort(np.unique(element_id[rows], return_index=True)[1])][:MOST_NAMED]
