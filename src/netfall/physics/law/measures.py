"""Closed forms of the law for arrays of elements: measures of strain, and limits of the axial force."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from netfall.core.arrays import FloatArray
from netfall.core.functions import exp, log


class Measure(NamedTuple):
    """Measure of strain, in closed form.

    strain(L, L0) : strain of length L [m]; stretch(eps) : L / L0; unstressed(L, eps) : L0 [m]
    over(L, L0) : [m], dN/dL is EA / over; largest : N / EA up to which the functions are finite
    """

    strain: Callable[..., Any]
    stretch: Callable[..., Any]
    unstressed: Callable[..., Any]
    over: Callable[..., Any]
    largest: float


MEASURES = {  # by [cable] strain_measure
    "engineering": Measure(
        strain=lambda L, L0: (L - L0) / L0,
        stretch=lambda eps: 1.0 + eps,
        unstressed=lambda L, eps: L / (1.0 + eps),
        over=lambda L, L0: L0,
        largest=np.inf,
    ),
    "logarithmic": Measure(
        strain=lambda L, L0: log(L / L0),
        stretch=exp,
        unstressed=lambda L, eps: L * exp(-eps),
        over=lambda L, L0: L,
        largest=500.0,  # exp overflows above about 709
    ),
}


def largest_stiffness(EA: np.ndarray, L0: np.ndarray) -> np.ndarray:
    """Return the largest axial stiffness dN/dL (m,) [N/m] of elements, for the limits of the step."""
    return EA / L0


def unstressed_length(L: np.ndarray, N: np.ndarray, EA: np.ndarray, strain: str) -> np.ndarray:
    """Return the unstressed length (m,) [m] of elements of length L (m,) [m] under N (m,) [N]."""
    return MEASURES[strain].unstressed(L, N / EA)


def stretched_length(L0: np.ndarray, N: np.ndarray, EA: np.ndarray, strain: str) -> np.ndarray:
    """Return the length (m,) [m] under N (m,) [N] of elements of unstressed length L0 (m,) [m]."""
    return L0 * MEASURES[strain].stretch(N / EA)


def exceeds_stiffness(N: np.ndarray, EA: np.ndarray, strain: str) -> np.ndarray:
    """Return whether no unstressed length exists at which an element carries N (m,) [N]."""
    return (1.0 + N / EA <= 0) | (np.abs(N) > MEASURES[strain].largest * EA)


def heated_length(L0: np.ndarray, expansion: np.ndarray, temperature: float) -> np.ndarray:
    """Return the unstressed length (m,) [m] at a temperature [K] above that of L0 (m,) [m]."""
    return L0 * (1.0 + expansion * temperature)


def prestressed_length(
    L0: np.ndarray, L: np.ndarray, N: np.ndarray, EA: np.ndarray, factor: float, strain: str
) -> np.ndarray:
    """Return the unstressed length (m,) [m] of elements that carry factor N (m,) [N] at length L (m,) [m].

    L0 : (m,) [m] at the factor 1, and of elements without force at any factor
    """
    if factor == 1.0:
        return L0
    return np.where(N == 0.0, L0, unstressed_length(L, factor * N, EA, strain))


def elastic_stiffness(EA: np.ndarray, L0: np.ndarray, L: np.ndarray, strain: str) -> np.ndarray:
    """Return dN/dL (m,) [N/m] at lengths L (m,) [m] of elements that are taut and do not yield."""
    return EA / MEASURES[strain].over(L, L0)


def strains(L: np.ndarray, L0: np.ndarray | float, strain: str) -> np.ndarray:
    """Return strains (m,) of lengths L (m,) [m] relative to unstressed lengths L0 (m,) [m]."""
    return MEASURES[strain].strain(L, L0)


def elastic_forces(L: Any, L0: Any, EA: Any, bar: Any, strain: str) -> np.ndarray:
    """Return axial forces (m,) [N] without yield at lengths L (m,) [m]; bar : (m,) bool."""
    N = EA * strains(L, L0, strain)
    return np.where(bar, N, np.maximum(N, 0.0))


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
