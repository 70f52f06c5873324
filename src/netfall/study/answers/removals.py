"""Effects of the removal of each element or cable, over all samples of a study that remove it."""

from dataclasses import dataclass

import numpy as np

from netfall.results.removals import REMOVAL_FAILED
from netfall.study.answers.read import Study

# Dynamic factor above which it is meaningless: the static tension hardly changes, or the roof continued to
# break, which the equilibrium after the removal does not include.
MAX_DYNAMIC_FACTOR = 10.0


@dataclass
class Removals:
    """A row for each removed element or cable, with the worst values over its samples; nan: unknown.

    name : (l,) the id of the element, or the name of the cable, in the order of the samples
    place : (N,) the row of each sample
    tension_ratio, dynamic_factor, detached_area : (l,)
    broken : (l,) number of other elements that broke
    no_equilibrium : (l,) samples without an equilibrium, before or after the removal
    left_out : (l,) samples without a result
    not_stable, breaking : (l,) samples whose equilibrium after the removal is unstable (included in
        no_equilibrium), or breaks more elements
    """

    name: np.ndarray
    place: np.ndarray
    tension_ratio: np.ndarray
    dynamic_factor: np.ndarray
    detached_area: np.ndarray
    broken: np.ndarray
    no_equilibrium: np.ndarray
    left_out: np.ndarray
    not_stable: np.ndarray
    breaking: np.ndarray


def removals_of(study: Study) -> Removals | None:
    """Return the member removals of a study; None if it removes nothing."""
    samples = study.samples
    if "removed" not in samples:
        return None
    names, first, place = np.unique(samples["removed"].astype(str), return_index=True, return_inverse=True)
    order = np.argsort(first)  # order of the samples
    place = np.argsort(order)[place]
    unknown = np.full(len(place), np.nan)
    ratio, factor = samples.get("tension_ratio_max", unknown), samples.get("dynamic_factor_max", unknown)
    failed = samples["state"] == "no_equilibrium"
    state_after = samples.get("equilibrium_after_removal", np.full(len(place), ""))
    lost_share = np.where(failed, 1.0, samples["detached_area"])

    def count(which: np.ndarray) -> np.ndarray:
        return np.bincount(place[which], minlength=len(names))

    def worst(values: np.ndarray, included: np.ndarray) -> np.ndarray:
        largest = np.full(len(names), -np.inf)
        included = included & np.isfinite(values)
        np.maximum.at(largest, place[included], values[included])
        return np.where(np.isfinite(largest), largest, np.nan)

    return Removals(
        names[order],
        place,
        worst(ratio, study.finished),
        worst(factor, study.finished),
        worst(lost_share, study.finished | failed),
        worst(samples["broken"].astype(float), study.finished),
        count(failed | np.isin(state_after, REMOVAL_FAILED)),
        count(~study.finished & ~failed),
        count(state_after == "unstable"),
        count(state_after == "breaks"),
    )


def removal_of_element(study: Study, removals: Removals) -> np.ndarray:
    """Return the row (m,) of the removal that contains each element, -1: none.

    Cables are known only if /net has `cable` (m,). A cable may have the id of another element as its name.
    """
    row = {name: k for k, name in enumerate(removals.name)}
    rows = np.array([row.get(name, -1) for name in study.net["element_id"].astype(str)], int)
    if study.removes == "element" or "cable" not in study.net:
        return rows
    of_cable = np.array([row.get(str(name), -1) for name in study.net["cable"]], int)
    return of_cable if study.removes == "cable" else np.where(rows >= 0, rows, of_cable)
