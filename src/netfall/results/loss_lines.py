"""What the loss of members did, in sentences, from the datasets of a result; no file is opened here."""

import numpy as np

from netfall.job.values import counted

MOST_FACTORS = 4  # of the largest ones
MUCH = 0.02  # of the largest tension: factors of what changes less are large without being telling
RISES = 2.0  # times the tension before: from there on told beside the factor
MOST_RISES = 2  # of these
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
        parts += _factors(telling_factor(removal, k), element_id) + _rises(removal, k, element_id)
        parts += _unrest(removal, k)
        lines.append("; ".join(parts))
    return lines


def rises(removal, k: int) -> np.ndarray:
    """Largest tension after entry k over that before (m,); nan where that is next to none, or lost."""
    before, highest = removal["tension_before"][k], removal["tension_highest"][k]
    telling = before > MUCH * np.fmax.reduce(before, initial=0.0)
    return np.divide(highest, before, out=np.full(len(before), np.nan), where=telling)


def _rises(removal, k: int, element_id: np.ndarray) -> list[str]:
    """Where tensions rise to a multiple, which a factor of 1 may hide."""
    rise = rises(removal, k)
    rows = _largest_of_each(np.where(rise >= RISES, rise, np.nan), element_id)
    kN = lambda name, e: f"{removal[name][k][e] / 1e3:.4g}"
    named = [
        f"{rise[e]:.3g} times (element {element_id[e]}: {kN('tension_before', e)} -> "
        f"{kN('tension_highest', e)} kN)"
        for e in rows[:MOST_RISES]
    ]
    return [f"largest tensions over those before {', '.join(named)}"] if named else []


def _unrest(removal, k: int) -> list[str]:
    """Whether the roof still moved from the loss before entry k: tensions then are not those of its rest."""
    time = removal["time"][:]
    earlier = np.flatnonzero(time < time[k])
    if not len(earlier):
        return []
    j = earlier[np.argmax(time[earlier])]
    before, rest = removal["tension_before"][k], removal["tension_after"][j]
    off, largest = (np.fmax.reduce(np.abs(N), initial=0.0) for N in (before - rest, rest))
    if off <= MUCH * largest:
        return []
    return [
        f"the roof still moved from loss {j + 1}, with tensions up to {off / 1e3:.4g} kN off its rest: "
        "factors and largest tensions are of both"
    ]


def telling_factor(removal, k: int) -> np.ndarray:
    """Dynamic factors (m,) of entry k where the rest changes by much, nan elsewhere; as in `loss_lines`."""
    before, after = removal["tension_before"][k], removal["tension_after"][k]
    largest = np.fmax(np.abs(before), np.abs(after)).max(initial=0.0)  # nan where there is no rest
    return np.where(np.abs(after - before) > MUCH * largest, removal["dynamic_factor"][k], np.nan)


def _factors(factor: np.ndarray, element_id: np.ndarray) -> list[str]:
    rows = _largest_of_each(factor, element_id)
    if not len(rows):
        return []
    named = ", ".join(f"{factor[e]:.3g} (element {element_id[e]})" for e in rows)
    return [f"largest dynamic factors {named}, where the rest changes by {MUCH:.0%} of the largest tension"]


def _largest_of_each(values: np.ndarray, element_id: np.ndarray) -> np.ndarray:
    """Rows of the largest values that are known, one of the parts of each element."""
    rows = np.flatnonzero(~np.isnan(values))
    rows = rows[np.argsort(-values[rows], kind="stable")]
    return rows[np.sort(np.unique(element_id[rows], return_index=True)[1])][:MOST_FACTORS]
