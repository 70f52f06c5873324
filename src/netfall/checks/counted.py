"""Which stages of a result count for a check, and whether they are equilibria, and stable."""

import numpy as np

from netfall.results.cases import KINDS, cases_of
from netfall.results.states import Envelope, is_undecided, no_equilibrium, not_stable

UNBORNE = "no equilibrium", "undecided", "not stable"


def stage_kinds(f, envelope: Envelope) -> np.ndarray:
    """Of each stage of an envelope the kind of its case or combination (`results.cases.Case`), else ""."""
    kinds = {case.shown.place: case.kind for case in cases_of(f)}
    return np.array([kinds.get(place, "") for place in envelope.places], object)


def counted(kinds: np.ndarray, kind: str) -> np.ndarray:
    """Which stages (stages,) count for a check of some kind; kinds : as of `stage_kinds`.

    Where the job has combinations of this kind: these and the first stage, the form; for ultimate checks
    also losses, dynamics and what else is of no kind, whose loads are those of an accident. Where it has
    none: all but the combinations of the other kind.
    """
    own = kinds == kind
    if not kind or not own.any():
        return ~np.isin(kinds, KINDS) if kind else np.ones(len(kinds), bool)
    own |= (kinds == "") & (kind == KINDS[0])
    own[0] = True
    return own


def places_of(envelope: Envelope, which: np.ndarray) -> list[str]:
    """The groups of the result that some stages of an envelope are of. which : (stages,), as of `counted`"""
    return list(dict.fromkeys(place for place, counts in zip(envelope.places, which) if counts and place))


def without_equilibrium(f, places: list[str]) -> list[str]:
    """Those of some groups of the result that have no equilibrium."""
    return [place for place in places if no_equilibrium(f[place])]


def without_stability(f, places: list[str]) -> list[str]:
    """The same that are not stable, but stages of erection, whose struts are held until cables are taut."""
    return [place for place in places if not place.startswith("stages/") and not_stable(f[place])]


def unborne_of(f, places: list[str]) -> str:
    """One of UNBORNE for a check that these groups of the result count for, "": all of them are borne."""
    without = without_equilibrium(f, places)
    undecided = [place for place in without if is_undecided(f[place])]
    found = len(without) > len(undecided), undecided, without_stability(f, places)
    return next((word for word, some in zip(UNBORNE, found) if some), "")
