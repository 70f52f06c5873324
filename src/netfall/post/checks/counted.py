"""Selection of the stages that count for a check, and of those that are no stable equilibrium."""

import h5py
import numpy as np

from netfall.results.file import COMBINATION_KINDS, read_cases
from netfall.results.states import Envelope, is_undecided, is_unstable, no_equilibrium

NOT_VERIFIED = {  # why a check cannot pass, the worst first, and how a report says it of a group
    "no equilibrium": "FAILS: {} has no equilibrium.",
    "undecided": "UNDECIDED: no equilibrium of {} was found.",
    "not stable": "FAILS: {} is not stable.",
}


def stage_kinds(f: h5py.File, envelope: Envelope) -> np.ndarray:
    """Return the kind of case (`results.file.Case`) of each stage in an envelope, "": none."""
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


def groups_not_verified(f: h5py.File, paths: list[str]) -> list[tuple[str, str]]:
    """Return those groups of the result file that are no stable equilibrium, each after one of NOT_VERIFIED.

    paths : groups that count for a check. Stages of erection need not be stable: their struts are held until
        the cables are taut.
    """
    failed: list[tuple[str, str]] = []
    for path in paths:
        if no_equilibrium(f[path]):
            failed.append(("undecided" if is_undecided(f[path]) else "no equilibrium", path))
        elif is_unstable(f[path]) and not path.startswith("stages/"):
            failed.append(("not stable", path))
    return sorted(failed, key=lambda pair: list(NOT_VERIFIED).index(pair[0]))
