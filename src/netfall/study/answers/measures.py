"""Failure criteria: which runs count as failed, by default and by the [[failure]] entries of a study file."""

from typing import NamedTuple

import numpy as np

from netfall.results.outcomes import OUTCOME_BY_NAME
from netfall.results.removal_text import REMOVAL_FAILED
from netfall.study.models import FailureCriterion

JUDGED_STATES = ("finished", "no_rest")  # states of runs that decide whether the roof failed
LOST_ROOF = (0.0, 0.05, 0.10, 0.25, 0.50)  # lost shares of the roof above which a run counts as failed


class Judgement(NamedTuple):
    """Whether samples (N,) have failed by a criterion; judged : whether they have its outcome."""

    failed: np.ndarray
    judged: np.ndarray


def failures(members: dict[str, np.ndarray], own: tuple[FailureCriterion, ...] = ()) -> dict[str, Judgement]:
    """Apply each failure criterion to the samples.

    members : the columns of /members by name, text as str; own : criteria of the study file

    A run without an equilibrium under the mean wind has failed by all criteria. A run that lacks an outcome,
    such as the utilisation if nothing has a strength, is not judged. Exceptions: a run without a fracture
    time has not broken. A run without a dynamic factor, because more elements broke or because there is no
    equilibrium after the removal, has failed.
    """
    no_rest, all_judged = members["state"] == "no_rest", np.ones(len(members["state"]), bool)
    lost_share = np.where(no_rest, 1.0, members["roof_lost"])
    measures = {"first fracture": Judgement(no_rest | np.isfinite(members["first_fracture"]), all_judged)}
    for share in LOST_ROOF:
        name = f"more than {share:.0%} of the roof lost" if share else "any of the roof lost"
        measures[name] = Judgement(lost_share > share, np.isfinite(lost_share))
    for criterion in own:
        value, failed = members[criterion.of].astype(float), no_rest
        if OUTCOME_BY_NAME[criterion.of].needs_removal:
            failed = failed | (members["broken"] > 0) | np.isin(members["rest_after_loss"], REMOVAL_FAILED)
        failed = failed | (value > criterion.above)
        judged = all_judged if criterion.of == "first_fracture" else failed | np.isfinite(value)
        measures[criterion.name] = Judgement(failed, judged)
    return measures


def failure_section(
    members: dict[str, np.ndarray], own: tuple[FailureCriterion, ...]
) -> dict[str, np.ndarray]:
    """Return the datasets of /failures: criteria of the study file, number of judged and of failed runs."""
    counted = np.isin(members["state"], JUDGED_STATES)
    by_name = failures(members, own)
    verdicts = [by_name[item.name] for item in own]
    return {
        "measure": np.array([item.name for item in own]),
        "of": np.array([item.of for item in own]),
        "above": np.array([item.above for item in own], float),
        "runs": np.array([(counted & item.judged).sum() for item in verdicts]),
        "failed": np.array([(counted & item.failed).sum() for item in verdicts]),
    }
