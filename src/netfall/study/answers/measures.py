"""Failure criteria: which runs count as failed, by default and by the [[failure]] entries of a study file."""

from typing import NamedTuple

import numpy as np

from netfall.results.losses import REMOVAL_FAILED
from netfall.results.outcomes import OUTCOME_BY_NAME
from netfall.study.models import FailureCriterion

JUDGED_STATES = ("finished", "no_equilibrium")  # states of runs that decide whether the roof failed
LOST_ROOF = (0.0, 0.05, 0.10, 0.25, 0.50)  # lost shares of the roof above which a run counts as failed


class Judgement(NamedTuple):
    """Whether samples (N,) have failed by a criterion; judged : whether they have its outcome."""

    failed: np.ndarray
    judged: np.ndarray


def failures(samples: dict[str, np.ndarray], own: tuple[FailureCriterion, ...] = ()) -> dict[str, Judgement]:
    """Apply each failure criterion to the samples.

    samples : the columns of /samples by name, text as str; own : criteria of the study file

    A run without an equilibrium under the mean wind has failed by all criteria. A run that lacks an outcome,
    such as the utilisation if nothing has a strength, is not judged. Exceptions: a run without a fracture
    time has not broken. A run without a dynamic factor, because more elements broke or because there is no
    equilibrium after the removal, has failed.
    """
    no_equilibrium, all_judged = samples["state"] == "no_equilibrium", np.ones(len(samples["state"]), bool)
    lost_share = np.where(no_equilibrium, 1.0, samples["detached_area"])
    measures = {
        "first fracture": Judgement(no_equilibrium | np.isfinite(samples["first_fracture"]), all_judged)
    }
    for share in LOST_ROOF:
        name = f"more than {share:.0%} of the roof lost" if share else "any of the roof lost"
        measures[name] = Judgement(lost_share > share, np.isfinite(lost_share))
    for criterion in own:
        value, failed = samples[criterion.outcome].astype(float), no_equilibrium
        if OUTCOME_BY_NAME[criterion.outcome].needs_removal:
            failed_after = np.isin(samples["equilibrium_after_removal"], REMOVAL_FAILED)
            failed = failed | (samples["broken"] > 0) | failed_after
        failed = failed | (value > criterion.limit)
        judged = all_judged if criterion.outcome == "first_fracture" else failed | np.isfinite(value)
        measures[criterion.name] = Judgement(failed, judged)
    return measures


def failure_section(
    samples: dict[str, np.ndarray], own: tuple[FailureCriterion, ...]
) -> dict[str, np.ndarray]:
    """Return the datasets of /failures: criteria of the study file, number of judged and of failed runs."""
    counted = np.isin(samples["state"], JUDGED_STATES)
    by_name = failures(samples, own)
    verdicts = [by_name[item.name] for item in own]
    return {
        "measure": np.array([item.name for item in own]),
        "outcome": np.array([item.outcome for item in own]),
        "limit": np.array([item.limit for item in own], float),
        "runs": np.array([(counted & item.judged).sum() for item in verdicts]),
        "failed": np.array([(counted & item.failed).sum() for item in verdicts]),
    }
