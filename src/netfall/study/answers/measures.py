"""Measures of failure: what counts as the failure of a run, by default and as a study file asks for it."""

from typing import NamedTuple

import numpy as np

from netfall.results.loss_lines import WITHOUT
from netfall.results.outcomes import BY_NAME

COUNTED = ("finished", "no_rest")  # states that tell whether the roof stood
LOST_ROOF = (0.0, 0.05, 0.10, 0.25, 0.50)  # shares of the roof; more than this lost is a failure


class Failure(NamedTuple):
    """A run fails where an outcome, a column of /members, is above a value. by : [m], of `sunk_area`"""

    name: str
    of: str
    above: float
    by: float | None = None


class Verdict(NamedTuple):
    """Whether members (N,) have failed by a measure; judged : whether they tell, having its outcome"""

    failed: np.ndarray
    judged: np.ndarray


def failures(members: dict[str, np.ndarray], own: tuple[Failure, ...] = ()) -> dict[str, Verdict]:
    """What each measure says of the members.

    members : the columns of /members by name, texts as str; own : measures of the study file

    A run without an equilibrium under the mean wind has failed by all of them. One without an outcome, as
    the utilisation where nothing has a strength, tells neither; but one without a fracture has not broken,
    and one that has no dynamic factor because more broke, or because there is no rest after the loss, failed.
    """
    no_rest, all_tell = members["state"] == "no_rest", np.ones(len(members["state"]), bool)
    lost = np.where(no_rest, 1.0, members["roof_lost"])
    measures = {"first fracture": Verdict(no_rest | np.isfinite(members["first_fracture"]), all_tell)}
    for share in LOST_ROOF:
        name = f"more than {share:.0%} of the roof lost" if share else "any of the roof lost"
        measures[name] = Verdict(lost > share, np.isfinite(lost))
    for each in own:
        value, failed = members[each.of].astype(float), no_rest
        if BY_NAME[each.of].of_losses:
            failed = failed | (members["broken"] > 0) | np.isin(members["rest_after_loss"], WITHOUT)
        failed = failed | (value > each.above)
        judged = all_tell if each.of == "first_fracture" else failed | np.isfinite(value)
        measures[each.name] = Verdict(failed, judged)
    return measures


def failure_section(members: dict[str, np.ndarray], own: tuple[Failure, ...]) -> dict[str, np.ndarray]:
    """What stands in /failures: the measures of the study file, and how many runs of how many have failed."""
    counted = np.isin(members["state"], COUNTED)
    found = failures(members, own)
    verdicts = [found[each.name] for each in own]
    return {
        "measure": np.array([each.name for each in own]),
        "of": np.array([each.of for each in own]),
        "above": np.array([each.above for each in own], float),
        "runs": np.array([(counted & each.judged).sum() for each in verdicts]),
        "failed": np.array([(counted & each.failed).sum() for each in verdicts]),
    }
