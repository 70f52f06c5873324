"""Forces that an element does not pass: where it yields, where it breaks, where a bar buckles (Euler)."""

from typing import NamedTuple

import numpy as np

NEARLY, REACHED = 1.0 - 1e-9, 1.0 - 1e-12  # of a limit: looked at again, exactly; as good as it


class Caps(NamedTuple):
    """Forces (m,) [N] of elements; inf: none.

    yielding : at which they yield
    buckling : compression at which bars buckle, where their Euler's load is less than that
    straight : Euler's load of bars that bear more, for they neither buckle nor bend
    """

    yielding: np.ndarray
    buckling: np.ndarray
    straight: np.ndarray


def caps_of(yield_force, euler_load, buckling, bending) -> Caps:
    """Caps of elements that yield at forces (m,) [N] and have Euler's loads (m,) [N]; nan: no second moment.

    buckling, bending : (m,) bool, bars that do; None: none does
    """
    none = np.zeros(len(yield_force), bool)
    buckles, bends = (none if flags is None else flags for flags in (buckling, bending))
    of = lambda bars: np.where(bars, euler_load, np.inf)
    straight = np.isfinite(euler_load) & ~buckles & ~bends
    return Caps(yield_force, of(buckles & (euler_load < yield_force)), of(straight))


def strength_of(EA, fracture_strain, yield_force) -> np.ndarray:
    """Axial force (m,) [N] that an element never passes before it breaks, inf: none."""
    return np.minimum(EA * fracture_strain, yield_force)
