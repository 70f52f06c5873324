"""What of the law of an element is the same for all elements of a rank.

Theory: paper 2.2 and 2.3, Fig. 3. Ideal elastic-plastic with slack, in total form. With the trial force
s = EA (eps - eps_p):

    s > N_y             yields: eps_p grows until s = N_y
    s < 0, cable        slack: s = 0, whatever the length; a bar takes compression, down to -N_y
    s < -N_E, a bar     buckles, where its Euler's load N_E is less than N_y: s = -N_E, elastic

The paper writes increments, whose sum is the logarithmic strain; both measures are offered. Another one is a
row of `measures.MEASURES`, a branch where `law.logarithmic` has one, and a choice of [cable] strain.

The law stands twice: for one element of `Elements` (`element.py`), and for vectors of slots in the step
(`physics.elements`, `step.forces`).
"""

import numpy as np

from netfall.core.records import Record, empty, f8_2, real, whole
from netfall.mechanics.law.limits import NEARLY
from netfall.mechanics.law.measures import MEASURES, strains


class Law(Record):
    """What of the law is the same for all elements of a rank.

    logarithmic : 1 for the logarithmic strain, 0 for the engineering strain
    plastic : 1 where elements yield; EA : [N] axial stiffness, 0 where it differs, in the slots
    yield_force : [N], inf: none, or it differs; yield_strain : yield_force / EA
    reach : L / L0 from which an element is looked at for fracture (the least, where they differ), inf: never
    alike : 1 where `near` [N], the elastic axial force from which one is looked at for either, holds for all
    branches : (5, 2 or 3) alpha, tau [s], and of `set_branches`; absent: there are none
    """

    logarithmic: whole
    plastic: whole
    EA: real
    yield_force: real
    yield_strain: real
    reach: real
    alike: whole
    near: real
    branches: f8_2


def law_of(
    measure: str,
    plastic: bool,
    EA: float | None,
    yield_force: float | None,
    least: float | None,
    alike: bool,
    branches: np.ndarray | None,
) -> Law:
    """The law of a rank. measure : a key of MEASURES; least : fracture strain of all, None: nothing breaks

    alike : whether all have that fracture strain
    """
    reach = np.inf if least is None else float(reaches(least, measure))
    yield_strain = np.inf if not EA or yield_force is None else yield_force / EA
    alike, near = alike and EA is not None, np.inf
    if alike:
        near = min(
            EA * float(strains(reach, 1.0, measure)) if reach < np.inf else np.inf,
            NEARLY * yield_force if plastic else np.inf,
        )
    return Law(
        measure == "logarithmic",
        plastic,
        EA or 0.0,
        np.inf if yield_force is None else yield_force,
        yield_strain,
        reach,
        alike,
        near,
        empty(f8_2) if branches is None else branches,
    )


def reaches(eps_u: np.ndarray, measure: str) -> np.ndarray:
    """L / L0 (m,) from which elements of fracture strains (m,) are looked at; inf: never"""
    return np.where(np.isinf(eps_u), np.inf, MEASURES[measure].stretch(eps_u) * NEARLY)
