"""What of the law of an element is the same for all elements of a rank.

Theory: paper 2.2 and 2.3, Fig. 3. Ideal elastic-plastic with slack, in total form. With the trial force
s = EA (eps - eps_p):

    s > N_y             yields: eps_p grows until s = N_y
    s < 0, cable        slack: s = 0, whatever the length; a bar takes compression, down to -N_y
    s < -N_E, a bar     buckles, where its Euler's load N_E is less than N_y: s = -N_E, elastic

The paper writes increments, whose sum is the logarithmic strain; both measures are offered. Another one is a
row of `measures.MEASURES`, a branch where `law.logarithmic` has one, and a choice of [cable] strain.

The law stands twice: for one element of `Elements` (`element.py`), and for a slot of the vector loop of the
step (`slot.py`), arranged for whole registers.
"""

from typing import NamedTuple

import numpy as np

from netfall.mechanics.law.limits import NEARLY
from netfall.mechanics.law.measures import MEASURES, strains


class Law(NamedTuple):
    """What of the law is the same for all elements of a rank.

    logarithmic : True for the logarithmic strain, None for the engineering strain
    plastic : True where elements yield, None where all are elastic
    EA : [N] axial stiffness, None: differs, in the slots; yield_force, yield_strain = yield_force / EA : the
        same
    reach : L / L0 from which an element is looked at for fracture (the least, where they differ), None:
        nothing breaks
    near : [N] elastic axial force from which one is looked at for either, None: differs, or nothing happens
    branches : (5, 2 or 3) alpha, tau [s], and of `set_branches`; None: there are none
    """

    logarithmic: bool | None
    plastic: bool | None
    EA: float | None
    yield_force: float | None
    yield_strain: float | None
    reach: float | None
    near: float | None = None
    branches: np.ndarray | None = None


def law_of(
    measure: str, plastic: bool, EA: float | None, yield_force: float | None, least: float | None, alike: bool
) -> Law:
    """The law of a rank. measure : a key of MEASURES; least : fracture strain of all, None: nothing breaks

    alike : whether all have that fracture strain
    """
    reach = None if least is None else float(reaches(least, measure))
    yield_strain = None if EA is None or yield_force is None else yield_force / EA if EA > 0.0 else np.inf
    near = None
    if alike and EA is not None and (plastic or least is not None):
        near = min(
            EA * float(strains(reach, 1.0, measure)) if reach and reach < np.inf else np.inf,
            NEARLY * yield_force if plastic else np.inf,
        )
    return Law(measure == "logarithmic" or None, plastic or None, EA, yield_force, yield_strain, reach, near)


def reaches(eps_u: np.ndarray, measure: str) -> np.ndarray:
    """L / L0 (m,) from which elements of fracture strains (m,) are looked at; inf: never"""
    return np.where(np.isinf(eps_u), np.inf, MEASURES[measure].stretch(eps_u) * NEARLY)
