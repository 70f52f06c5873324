"""What the loss of each element or cable did, over all members of a study that lost it."""

from dataclasses import dataclass

import numpy as np

from netfall.study.members import Study

# A dynamic factor above this is of an element whose tension at rest hardly changes, or of a roof that went on
# breaking, which the rest after the loss alone does not know.
TELLING = 10.0


@dataclass
class Losses:
    """A row for each thing that was lost, in the order of the members; the worst over its members, nan: none.

    name : (l,) the id of the element, or the name of the cable
    place : (N,) the row of each member
    dynamic_factor, roof_lost : (l,)
    broken : (l,) elements that broke besides
    no_rest : (l,) members that found no equilibrium
    """

    name: np.ndarray
    place: np.ndarray
    dynamic_factor: np.ndarray
    roof_lost: np.ndarray
    broken: np.ndarray
    no_rest: np.ndarray


def losses_of(study: Study) -> Losses | None:
    """The losses of a study; None if it removes nothing."""
    m = study.members
    if "removed" not in m:
        return None
    names, first, place = np.unique(m["removed"].astype(str), return_index=True, return_inverse=True)
    order = np.argsort(first)  # as the members stand
    place = np.argsort(order)[place]
    factor = m.get("dynamic_factor_max", np.full(len(place), np.nan))
    no_rest = m["state"] == "no_rest"
    lost = np.where(no_rest, 1.0, m["roof_lost"])

    def worst(values: np.ndarray, kept: np.ndarray) -> np.ndarray:
        most = np.full(len(names), -np.inf)
        kept = kept & np.isfinite(values)
        np.maximum.at(most, place[kept], values[kept])
        return np.where(np.isfinite(most), most, np.nan)

    return Losses(
        names[order],
        place,
        worst(factor, study.finished),
        worst(lost, study.finished | no_rest),
        worst(m["broken"].astype(float), study.finished),
        np.bincount(place[no_rest], minlength=len(names)),
    )


def elements_lost(study: Study, losses: Losses) -> np.ndarray:
    """The row (m,) of the loss that takes each element, -1: none; those of cables where /net names them,
    in `cable` (m,).
    """
    row = {name: k for k, name in enumerate(losses.name)}
    found = np.array([row.get(name, -1) for name in study.net["element_id"].astype(str)], int)
    if "cable" not in study.net:
        return found
    return np.where(found >= 0, found, [row.get(str(name), -1) for name in study.net["cable"]])
