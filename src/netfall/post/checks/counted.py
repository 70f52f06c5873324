"""Selection of the stages that count for a check, and of those that are no stable equilibrium."""

import numpy as np

from netfall.results.cases import COMBINATION_KINDS, read_cases
from netfall.results.states import Envelope, is_undecided, is_unstable, no_equilibrium

NOT_VERIFIED = "no equilibrium", "undecided", "not stable"


def stage_kinds(f, envelope: Envelope) -> np.ndarray:
    """Return the kind of case (`results.cases.Case`) of each stage in an envelope, "": none."""
    kinds = {case.shown.place: case.kind for case in read_cases(f)}
    return np.array([kinds.get(path, "") for path in envelope.places], object)


def counted(kinds: np.ndarray, kind: str) -> np.ndarray:
    """Select the stages (stages,) that count for checks of a kind; kinds : from `stage_kinds`.

    If the job has combinations of this kind, these and the first stage, the form, count. Ultimate checks also
    include stages of no kind, such as member removals and dynamics, whose loads are accidental. If the job
    has none, all stages count but the combinations of the other kind.
    """
    counts = kinds == kind
    if not kind or not counts.any():
        return ~np.isin(kinds, COMBINATION_KINDS) if kind else np.ones(len(kinds), bool)
    counts |= (kinds == "") & (kind == COMBINATION_KINDS[0])
    counts[0] = True
    return counts


def places_of(envelope: Envelope, selected: np.ndarray) -> list[str]:
    """Return the groups of the result file that hold selected stages; selected : (stages,) from `counted`."""
    return list(dict.fromkeys(path for path, counts in zip(envelope.places, selected) if counts and path))


def groups_without_equilibrium(f, paths: list[str]) -> list[str]:
    """Return those groups of the result file that have no equilibrium."""
    return [path for path in paths if no_equilibrium(f[path])]


def unstable_groups(f, paths: list[str]) -> list[str]:
    """Return those groups of the result file whose equilibrium is not stable.

    Stages of erection are left out: their struts are held until the cables are taut.
    """
    return [path for path in paths if not path.startswith("stages/") and is_unstable(f[path])]


def reason_not_verified(f, paths: list[str]) -> str:
    """Return why a check cannot pass: one of NOT_VERIFIED, or "" if it can.

    paths : groups of the result file that count for the check
    """
    without = groups_without_equilibrium(f, paths)
    undecided = [path for path in without if is_undecided(f[path])]
    reasons = len(without) > len(undecided), undecided, unstable_groups(f, paths)
    return next((word for word, applies in zip(NOT_VERIFIED, reasons) if applies), "")
