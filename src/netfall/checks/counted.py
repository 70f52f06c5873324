"""Selection of the stages that count for a check, and of those that are no stable equilibrium."""

import numpy as np

from netfall.results.cases import KINDS, cases_of
from netfall.results.states import Envelope, is_undecided, no_equilibrium, not_stable

UNBORNE = "no equilibrium", "undecided", "not stable"


def stage_kinds(f, envelope: Envelope) -> np.ndarray:
    """Return the kind of case (`results.cases.Case`) of each stage in an envelope, "": none."""
    kinds = {case.shown.place: case.kind for case in cases_of(f)}
    return np.array([kinds.get(place, "") for place in envelope.places], object)


def counted(kinds: np.ndarray, kind: str) -> np.ndarray:
    """Select the stages (stages,) that count for checks of a kind; kinds : from `stage_kinds`.

    If the job has combinations of this kind, these and the first stage, the form, count. Ultimate checks also
    include stages of no kind, such as member removals and dynamics, whose loads are accidental. If the job
    has none, all stages count but the combinations of the other kind.
    """
    counts = kinds == kind
    if not kind or not counts.any():
        return ~np.isin(kinds, KINDS) if kind else np.ones(len(kinds), bool)
    counts |= (kinds == "") & (kind == KINDS[0])
    counts[0] = True
    return counts


def places_of(envelope: Envelope, which: np.ndarray) -> list[str]:
    """Return the groups of the result file that hold selected stages; which : (stages,) from `counted`."""
    return list(dict.fromkeys(place for place, counts in zip(envelope.places, which) if counts and place))


def without_equilibrium(f, places: list[str]) -> list[str]:
    """Return the groups of the result file that have no equilibrium."""
    return [place for place in places if no_equilibrium(f[place])]


def without_stability(f, places: list[str]) -> list[str]:
    """Return the groups of the result file whose equilibrium is not stable.

    Stages of erection are left out: their struts are held until the cables are taut.
    """
    return [place for place in places if not place.startswith("stages/") and not_stable(f[place])]


def unborne_of(f, places: list[str]) -> str:
    """Return why a check cannot pass, given the groups that count for it: one of UNBORNE, or "" if it can.

    places : groups of the result file
    """
    without = without_equilibrium(f, places)
    undecided = [place for place in without if is_undecided(f[place])]
    reasons = len(without) > len(undecided), undecided, without_stability(f, places)
    return next((word for word, applies in zip(UNBORNE, reasons) if applies), "")
