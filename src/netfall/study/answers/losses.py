"""What the loss of each element or cable did, over all members of a study that lost it."""

from dataclasses import dataclass

import numpy as np

from netfall.results.loss_lines import WITHOUT
from netfall.study.answers.read import Study
from netfall.study.answers.samples import inputs_of, is_seed

# A dynamic factor above this is of an element whose tension at rest hardly changes, or of a roof that went on
# breaking, which the rest after the loss alone does not know.
TELLING = 10.0
ALIKE = 1e-3  # of the net's extent: losses at places that differ by less, about its middle, are symmetric


@dataclass
class Losses:
    """A row for each thing that was lost, in the order of the members; the worst over its members, nan: none.

    name : (l,) the id of the element, or the name of the cable
    place : (N,) the row of each member
    tension_ratio, dynamic_factor, roof_lost : (l,)
    broken : (l,) elements that broke besides
    no_rest : (l,) members that found no equilibrium, under the mean wind before or in the net after the loss
    not_stable, breaking : (l,) members whose rest after the loss is not stable (of no_rest), or breaks more
    """

    name: np.ndarray
    place: np.ndarray
    tension_ratio: np.ndarray
    dynamic_factor: np.ndarray
    roof_lost: np.ndarray
    broken: np.ndarray
    no_rest: np.ndarray
    not_stable: np.ndarray
    breaking: np.ndarray


def losses_of(study: Study) -> Losses | None:
    """The losses of a study; None if it removes nothing."""
    m = study.members
    if "removed" not in m:
        return None
    names, first, place = np.unique(m["removed"].astype(str), return_index=True, return_inverse=True)
    order = np.argsort(first)  # as the members stand
    place = np.argsort(order)[place]
    none = np.full(len(place), np.nan)
    ratio, factor = m.get("tension_ratio_max", none), m.get("dynamic_factor_max", none)
    fallen, rest = m["state"] == "no_rest", m.get("rest_after_loss", np.full(len(place), ""))
    lost = np.where(fallen, 1.0, m["roof_lost"])
    count = lambda which: np.bincount(place[which], minlength=len(names))

    def worst(values: np.ndarray, kept: np.ndarray) -> np.ndarray:
        most = np.full(len(names), -np.inf)
        kept = kept & np.isfinite(values)
        np.maximum.at(most, place[kept], values[kept])
        return np.where(np.isfinite(most), most, np.nan)

    return Losses(
        names[order],
        place,
        worst(ratio, study.finished),
        worst(factor, study.finished),
        worst(lost, study.finished | fallen),
        worst(m["broken"].astype(float), study.finished),
        count(fallen | np.isin(rest, WITHOUT)),
        count(rest == "unstable"),
        count(rest == "breaks"),
    )


def one_draw(study: Study, losses: Losses) -> tuple[int, int] | None:
    """Two symmetric losses with different counts of what breaks, where all have the one draw of gusts.

    None: there are none, or the wind has no gusts, or seeds differ.
    """
    m = study.members
    if not np.any(m.get("gusts", 0)) or any(is_seed(name) for name in inputs_of(m)):
        return None
    place = _places(study, losses)
    for k in range(len(place)):
        alike = (np.abs(place - place[k]) < ALIKE).all(1) & (losses.broken != losses.broken[k])
        others = np.flatnonzero(alike & np.isfinite(losses.broken) & np.isfinite(losses.broken[k]))
        if len(others):
            return k, int(others[0])
    return None


def _places(study: Study, losses: Losses) -> np.ndarray:
    """Where each loss is about the middle of the net (l, 5): least and largest radius in plan and height, in
    shares of its extent, and how many elements it takes; equal where losses are symmetric. nan: unknown.
    """
    x, row = study.net["particles"], elements_lost(study, losses)
    found = np.full((len(losses.name), 5), np.nan)
    if not len(x):
        return found
    middle = 0.5 * (x.min(0) + x.max(0))
    extent = np.ptp(x, axis=0).max() or 1.0
    radius = np.sqrt((x[:, 0] - middle[0]) ** 2 + (x[:, 1] - middle[1]) ** 2) / extent
    for k in range(len(found)):
        ends = study.net["elements"][row == k].ravel()
        if len(ends):
            r, z = radius[ends], x[ends, 2] / extent
            found[k] = r.min(), r.max(), z.min(), z.max(), len(ends)
    return found


def elements_lost(study: Study, losses: Losses) -> np.ndarray:
    """The row (m,) of the loss that takes each element, -1: none; those of cables where /net names them,
    in `cable` (m,).
    """
    row = {name: k for k, name in enumerate(losses.name)}
    found = np.array([row.get(name, -1) for name in study.net["element_id"].astype(str)], int)
    if "cable" not in study.net:
        return found
    return np.where(found >= 0, found, [row.get(str(name), -1) for name in study.net["cable"]])
