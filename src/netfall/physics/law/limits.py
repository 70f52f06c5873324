"""Limits of the axial force: yield, fracture, and Euler buckling of bars."""

from typing import Any, NamedTuple

import numpy as np

from netfall.core.arrays import FloatArray

# Shares of a limit: from CHECK_SHARE on it is checked exactly, from REACHED_SHARE on it counts as reached.
CHECK_SHARE, REACHED_SHARE = 1.0 - 1e-9, 1.0 - 1e-12


class ForceLimits(NamedTuple):
    """Limit forces (m,) [N] of elements; inf: none.

    yielding : yield force
    buckling : compression at which bars buckle, if their Euler load is less than the yield force
    straight : Euler load of bars that carry more, because they neither buckle nor bend
    """

    yielding: np.ndarray
    buckling: np.ndarray
    straight: np.ndarray


def caps_of(yield_force: FloatArray, euler_load: FloatArray, buckling: Any, bending: Any) -> ForceLimits:
    """Return limit forces of elements with yield forces (m,) [N] and Euler loads (m,) [N].

    Euler loads are nan without a second moment of area.
    buckling, bending : (m,) bool, bars that buckle, bars that bend; None: no bar does
    """
    none = np.zeros(len(yield_force), bool)
    buckles, bends = (none if flags is None else flags for flags in (buckling, bending))
    buckles_first = buckles & (euler_load < yield_force)
    stays_straight = np.isfinite(euler_load) & ~buckles & ~bends
    return ForceLimits(
        yielding=yield_force,
        buckling=np.where(buckles_first, euler_load, np.inf),
        straight=np.where(stays_straight, euler_load, np.inf),
    )


def axial_strengths(EA: Any, fracture_strain: Any, yield_force: Any) -> np.ndarray:
    """Return the axial force (m,) [N] that an element never exceeds before it breaks; inf: none."""
    return np.minimum(EA * fracture_strain, yield_force)
