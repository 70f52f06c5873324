"""Measures of failure: what counts as the failure of a run, by default and as a study file asks for it."""

from typing import NamedTuple

import numpy as np

COUNTED = ("finished", "no_rest")  # states that tell whether the roof stood
LOST_ROOF = (0.0, 0.05, 0.10, 0.25, 0.50)  # shares of the roof; more than this lost is a failure


class Failure(NamedTuple):
    """A run fails where an outcome, a column of /members, is above a value. by : [m], of `sunk_area`"""

    name: str
    of: str
    above: float
    by: float | None = None


def failures(members: dict[str, np.ndarray], own: tuple[Failure, ...] = ()) -> dict[str, np.ndarray]:
    """Whether each member (N,) has failed, by each measure.

    members : the columns of /members by name, texts as str; own : measures of the study file

    A run without an equilibrium under the mean wind has failed by all of them.
    """
    no_rest = members["state"] == "no_rest"
    lost = np.where(no_rest, 1.0, members["roof_lost"])
    measures = {"first fracture": no_rest | np.isfinite(members["first_fracture"])}
    for share in LOST_ROOF:
        name = f"more than {share:.0%} of the roof lost" if share else "any of the roof lost"
        measures[name] = lost > share
    for each in own:
        measures[each.name] = no_rest | (members[each.of] > each.above)
    return measures


def failure_section(members: dict[str, np.ndarray], own: tuple[Failure, ...]) -> dict[str, np.ndarray]:
    """What stands in /failures: the measures of the study file, and how many runs of how many have failed."""
    counted = np.isin(members["state"], COUNTED)
    measures = failures(members, own)
    return {
        "measure": np.array([each.name for each in own]),
        "of": np.array([each.of for each in own]),
        "above": np.array([each.above for each in own], float),
        "runs": np.full(len(own), counted.sum()),
        "failed": np.array([(measures[each.name] & counted).sum() for each in own]),
    }
