"""Parts of the law of an element that all elements of a rank share.

Theory: paper 2.2 and 2.3, Fig. 3. Ideal elastic-plastic with slack, in total form. With the trial force
s = EA (eps - eps_p):

    s > N_y             yields: eps_p grows until s = N_y
    s < 0, cable        slack: s = 0, at any length; a bar takes compression, down to -N_y
    s < -N_E, a bar     buckles, if its Euler load N_E is less than N_y: s = -N_E, elastic

The paper writes increments, whose sum is the logarithmic strain; both measures are offered. A further one
needs a row of `measures.MEASURES`, a branch wherever `LawParameters.logarithmic` has one, and a choice of
[cable] strain.

`element.py` implements the law twice: for one element of `Elements`, and for vectors of slots in the step,
with formulas of `physics.element_step`.
"""

import numpy as np

from netfall.core.arrays import FloatArray
from netfall.core.records import Record, empty, f8, f8_2, whole
from netfall.core.vectors import LANES
from netfall.physics.law.measures import CHECK_SHARE, MEASURES, strains


class LawParameters(Record):
    """Parameters of the law that all elements of a rank share.

    logarithmic : 1 for the logarithmic strain, 0 for the engineering strain
    plastic : 1 if elements yield
    EA and following : (LANES,) copies of one number, for `vectors.load_or_repeat`
    EA : [N] axial stiffness, 0 if it differs; the slots have it then
    yield_force : [N], inf: none, or it differs; yield_strain : yield_force / EA
    check_stretch : L / L0 from which an element is checked for fracture (the least, if they differ); inf:
        never
    near : [N] size of the elastic axial force from which an element is checked for any limit (the least)
    branches : (5, 2 or 3) alpha, tau [s], and rows of `set_branches`; absent: there are none
    """

    logarithmic: whole
    plastic: whole
    EA: f8
    yield_force: f8
    yield_strain: f8
    check_stretch: f8
    near: f8
    infinite: f8
    branches: f8_2


def build_law(
    measure: str,
    plastic: bool,
    EA: float | None,
    yield_force: float | None,
    min_eps_u: float | None,
    check_force: float,
    branches: np.ndarray | None,
) -> LawParameters:
    """Build the law of a rank.

    measure : a key of MEASURES; min_eps_u : the least fracture strain, None: nothing breaks
    check_force : the least of `check_forces`
    """
    reach = np.inf if min_eps_u is None else float(check_stretches(min_eps_u, measure))
    yield_strain = np.inf if not EA or yield_force is None else yield_force / EA
    return LawParameters(
        measure == "logarithmic",
        plastic,
        *(
            np.full(LANES, value)
            for value in (
                EA or 0.0,
                np.inf if yield_force is None else yield_force,
                yield_strain,
                reach,
                check_force,
                np.inf,
            )
        ),
        empty(f8_2) if branches is None else branches,
    )


def check_forces(
    EA: FloatArray,
    yield_force: FloatArray | None,
    eps_u: FloatArray | None,
    euler: FloatArray | None,
    measure: str,
) -> np.ndarray:
    """Return elastic axial forces (m,) [N], by size, from which elements are checked for limits; inf: never.

    yield_force, euler : (m,) [N], eps_u : (m,); None: nothing yields, buckles, breaks
    """
    check_force = np.full(len(EA), np.inf)
    if eps_u is not None:
        breaks, reach = np.isfinite(eps_u), check_stretches(eps_u, measure)
        if euler is not None:  # bars break in compression too, at smaller forces
            reach = 2.0 - 1.0 / reach
        check_force[breaks] = (EA * strains(np.where(breaks, reach, 1.0), 1.0, measure))[breaks]
    for limit in (yield_force, euler):
        if limit is not None:
            check_force = np.minimum(check_force, CHECK_SHARE * limit)
    return check_force


def check_stretches(eps_u: np.ndarray | float, measure: str) -> np.ndarray:
    """Return L / L0 (m,) from which elements of fracture strains (m,) are checked; inf: never."""
    return np.where(np.isinf(eps_u), np.inf, MEASURES[measure].stretch(eps_u) * CHECK_SHARE)
