"""Stability limits of the explicit step, and the elements that set them.

Central difference is stable for dt < 2 / omega_max. There are three limits, each with its element:
- `any_shape`: holds for the intact net in any shape. Each particle's mass is shared among its elements in
  proportion to their stiffness k = EA / L0. A single element then has omega^2 = Omega_a^2 + Omega_b^2,
  Omega_p^2 = sum(k) / M, and omega_max of the assembly is at most the largest of these (Rayleigh quotient).
  The transverse stiffness N / L is below k and needs no extra.
- `slackening`: omega dt = 1 for every cable, half of the above. A cable that goes slack and taut again within
  a few steps returns another energy than it took, at random more or less. Averaged over the moment of
  contact, a mass that runs into a slack cable leaves with at most 0.6 % more up to omega dt = 0.8 and 1.6 %
  up to 1, but with 7 % more at 1.5, 28 % at 1.6 and 107 % at 1.8 (tests/test_extremes.py). There short
  cables between heavy particles break from numerical strain, long before the step is unstable.
- `after_fracture`: holds after any fractures in any shape. A fragment, that is a particle that splits off,
  takes half of its element's own mass. If the step requires it, it also takes some of the other mass that its
  end carried (cladding): its mass is at least k dt^2 / 2. Then omega_p^2 = sum(k) / M <= 2 / dt^2 at every
  particle, fragment or not, and as above omega^2 <= 4 / dt^2 for every element. The mass that may be taken is
  bounded (`after_fracture_limit`); no mass is created. An element that cannot break leaves no fragment and
  takes nothing: it counts at its particles alone, in sum(k) and M. If nothing is carried this is dt < L0 / c
  of the shortest element. Without fragments there is no such limit, because the removal of an element makes
  nothing stiffer or lighter.
`scaled_mass` adds inertia where that makes `slackening` longest; the limits are then those of the heavier
net.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from netfall.core.arrays import BoolArray, FloatArray, IntArray
from netfall.core.kernels import kernel
from netfall.physics.element_step import LENGTH2_OFFSET
from netfall.physics.law.measures import largest_stiffness

STEP_TOLERANCE = 1e-6  # relative tolerance of the step that mass scaling finds
CARRIED_TOLERANCE = 1e-9  # relative to a particle's mass; a larger surplus over its elements is carried mass


@dataclass(frozen=True)
class Limit:
    """Limit of the step dt [s] and the element (global number) that sets it, -1 if none does."""

    name: str
    dt: float
    element: int


def any_shape_limits(
    elements: IntArray,
    EA: FloatArray,
    L0: FloatArray,
    mass: FloatArray,
    free: BoolArray,
    bar: BoolArray,
    support: FloatArray,
    chains: Any = None,
) -> list[Limit]:
    """Return the limits `any_shape` and `slackening` of the intact net.

    mass : (n,) [kg]; free : (n,) bool, whether any axis is free; bar : (m,) bool
    support : (n,) [N/m] of elastic supports, the stiffest axis, plus the bounds of the joints of bending
        chains
    chains : particles (k, 3) of these, and an element (k,) of each; a single joint has the sum over three
    """
    k = largest_stiffness(EA, L0)
    stiffness = (
        np.bincount(elements[:, 0], k, len(mass)) + np.bincount(elements[:, 1], k, len(mass)) + support
    )
    square = np.where(free, stiffness / np.where(free, mass, 1.0), 0.0)
    omega2 = square[elements[:, 0]] + square[elements[:, 1]]
    limits = []
    for name, phase, values in (("any_shape", 2.0, omega2), ("slackening", 1.0, np.where(bar, 0.0, omega2))):
        worst = int(np.argmax(values))
        dt = phase / float(np.sqrt(values[worst])) if values[worst] > 0 else np.inf
        limits.append(Limit(name, dt, worst if values[worst] > 0 else -1))
    if chains is not None and len(chains[1]):
        values = square[chains[0]].sum(1)
        worst = int(np.argmax(values))
        chain_limit = Limit(
            "any_shape", 2.0 / float(np.sqrt(max(values[worst], LENGTH2_OFFSET))), int(chains[1][worst])
        )
        limits[0] = min(limits[0], chain_limit, key=lambda limit: limit.dt)
    return limits


def after_fracture_limit(
    elements: IntArray,
    k: FloatArray,
    half: FloatArray,
    mass: FloatArray,
    held: BoolArray,
    eps_u: FloatArray,
    support: FloatArray,
    share: float,
) -> Limit:
    """Return the limit for any fragment of the net, if it takes up to `share` of the mass its end carries.

    k : (m,) [N/m], see `largest_stiffness`; half : (m,) [kg], half of each element's own mass
    mass : (n,) [kg]; held : (n,) bool, supports, whose fragments may take all of it
    eps_u : (m,) fracture strains; inf: the element never breaks; support : as in `any_shape_limits`

    It is the largest dt that meets two conditions. No end needs more than may be taken: max(0, k
    dt^2 / 2 - half) <= share * carried. All elements of a particle together need no more than it carries. An
    element that cannot break takes nothing. In the second condition all of its k dt^2 / 2 - half counts, of
    either sign, so that sum(k) dt^2 / 2 <= M holds for the remaining particle. If an elastic support
    carries nothing and all of its elements can break, the half of any one may remain on the spring.
    """
    breaks = np.isfinite(eps_u)
    if not breaks.any():
        return Limit("after_fracture", np.inf, -1)
    carried = mass - np.bincount(elements.ravel(), np.repeat(half, 2), len(mass))
    carried = np.where(carried > CARRIED_TOLERANCE * mass, carried, 0.0)
    may_take = np.where(held, 1.0, share) * carried
    single_dt = np.sqrt(2.0 * (half + may_take[elements].min(1)) / k)  # the largest dt of each single element
    single_dt[~breaks] = np.inf
    may_vanish = ~held & (carried == 0.0) & (np.bincount(elements[~breaks].ravel(), minlength=len(mass)) == 0)
    spring = np.where(may_vanish, support, 0.0)[elements].max(1)
    single_dt = np.where(spring > 0.0, np.sqrt(2.0 * half / (k + spring)), single_dt)
    worst = int(np.argmin(single_dt))
    dt = float(single_dt[worst])

    def lacking(dt: float) -> np.ndarray:
        """Return the mass (n,) [kg] that particles lack for fragments at a step dt."""
        need = 0.5 * k * dt * dt - half
        need = np.where(breaks, np.maximum(0.0, need), need)
        needed = np.bincount(elements.ravel(), np.repeat(need, 2), len(mass))
        needed += np.where(may_vanish, 0.0, 0.5 * support * dt * dt)
        return np.where(held, 0.0, needed - carried)

    if lacking(dt).max(initial=0.0) > 0.0:
        low, high = float(np.sqrt(2.0 * half / k).min()), dt  # at low only springs need mass
        low = 0.0 if lacking(low).max() > 0.0 else low
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if lacking(middle).max(initial=0.0) > 0.0 else (middle, high)
        dt = low
        candidates = np.flatnonzero((elements == np.argmax(lacking(high))).any(1))
        worst = int(candidates[np.argmax((k / np.maximum(half, 1e-300))[candidates])])
    return Limit("after_fracture", dt, worst)


def scaled_mass(
    elements: IntArray,
    EA: FloatArray,
    L0: FloatArray,
    mass: FloatArray,
    free: BoolArray,
    support: FloatArray,
    share: float,
) -> np.ndarray:
    """Return masses (n,) [kg] with added inertia that makes the step for slack cables, omega dt = 1, longest.

    share : of the sum of the moving masses that may be added

    An element requires Omega_a^2 + Omega_b^2 <= 1 / dt^2, Omega_p^2 = sum(k) / M. A particle above half of
    that gets as much mass as leaves the remainder to its neighbours, or half if one of them is above it too.
    free : (n,) bool, whether any axis is free
    """
    k = largest_stiffness(EA, L0)
    element_stiffness = np.bincount(elements[:, 0], k, len(mass)) + np.bincount(elements[:, 1], k, len(mass))
    stiffness = np.where(free, element_stiffness + support, 0.0)
    square = stiffness / np.where(free, mass, 1.0)
    budget = share * mass[free].sum()

    def added(dt: float) -> np.ndarray:
        """Return the mass (n,) [kg] to add for a step dt."""
        limit = 1.0 / (dt * dt)
        neighbour = np.zeros(len(mass))
        for a, b in ((0, 1), (1, 0)):
            np.maximum.at(neighbour, elements[:, a], np.minimum(square[elements[:, b]], 0.5 * limit))
        return np.maximum(stiffness / np.maximum(0.5 * limit, limit - neighbour) - mass, 0.0) * free

    low = 1.0 / np.sqrt(2.0 * square.max(initial=0.0)) if square.any() else 0.0  # needs no added mass
    if not (low > 0.0 and budget > 0.0):
        return mass
    high = 2.0 * low
    while added(high).sum() <= budget:
        low, high = high, 2.0 * high
    while high - low > STEP_TOLERANCE * low:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if added(middle).sum() <= budget else (low, middle)
    return mass + added(low)


@kernel
def fragment_mass(EA: float, L0: float, half: float, dt: float) -> float:
    """Return the mass [kg] of a fragment particle that is stable for steps of dt [s]."""
    return max(half, 0.5 * EA / L0 * dt * dt)
