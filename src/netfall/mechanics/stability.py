"""Limits of the explicit step, and the elements that set them.

Central difference is stable for dt < 2 / omega_max. Four figures, each with its element:
- `any_shape`: holds for the intact net in whatever shape it takes. Each particle's mass is shared among its
  elements in proportion to their stiffness k = EA / L0; an element alone then has
  omega^2 = Omega_a^2 + Omega_b^2, Omega_p^2 = sum(k) / M, and omega_max of the assembly is at most the
  largest of these (Rayleigh quotient). The transverse stiffness N / L is below k and needs no extra.
- `slackening`: omega dt = 1 for every cable, half of the above. A cable that goes slack and comes taut
  again within a few steps returns another energy than it took, by chance more or less: averaged over the
  moment of contact, a mass that runs into a slack cable leaves with at most 0.4 % more up to omega dt = 1,
  but with 7 % more at 1.5, 28 % at 1.6 and 107 % at 1.8 (tests/test_extremes.py); there short cables among
  heavy particles strain themselves to pieces, long before the step is unstable.
- `after_fracture`: holds after any fractures in any shape. A fragment, that is a particle that splits off,
  takes half of its element's own mass and, if the step needs it, some of what its end carried besides
  (cladding): its mass is at least k dt^2 / 2. Then omega_p^2 = sum(k) / M <= 2 / dt^2 at every particle,
  fragments and what they leave alike, and as above omega^2 <= 4 / dt^2 for every element. What may be taken
  is bounded (`after_fracture_limit`); nothing is made from nothing. An element that cannot
  break leaves no fragment and takes nothing: it counts at its particles alone, in sum(k) and M. Where nothing
  is carried this is dt < L0 / c of the shortest element. Without fragments there is no such limit: what
  breaks is taken out, which makes nothing stiffer and nothing lighter.
- `assembled`: 2 / omega_max of the assembled net as it stands, its slack cables taut: the sharp limit of the
  start (`stages/step_limit.py`).
`scaled_mass` adds inertia where that makes `slackening` longest; the limits are then those of the heavier
net.
"""

from dataclasses import dataclass

import numpy as np

from netfall.core.kernels import kernel
from netfall.mechanics.law.measures import largest_stiffness
from netfall.physics.elements import TINY

CLOSE = 1e-6  # of a step, to which mass scaling finds it
ROUNDING = 1e-9  # of a particle's mass: what it carries besides its elements, if more


@dataclass(frozen=True)
class Limit:
    """A limit of the step dt [s] and the element (global number) that sets it, -1 where none does."""

    name: str
    dt: float
    element: int


def any_shape_limits(elements, EA, L0, mass, free, bar, support, chains=None) -> list[Limit]:
    """`any_shape` and `slackening`, for the intact net.

    mass : (n,) [kg]; free : (n,) bool, whether any axis is free; bar : (m,) bool
    support : (n,) [N/m] of elastic supports, the stiffest axis, and the size of joints of chains that bend
    chains : particles (k, 3) of these, and an element (k,) of each; a joint alone has the sum over three
    """
    k = largest_stiffness(EA, L0)
    stiffness = np.bincount(elements[:, 0], k, len(mass)) + np.bincount(elements[:, 1], k, len(mass))
    stiffness += support
    square = np.where(free, stiffness / np.where(free, mass, 1.0), 0.0)
    omega2 = square[elements[:, 0]] + square[elements[:, 1]]
    limits = []
    for name, phase, of in (("any_shape", 2.0, omega2), ("slackening", 1.0, np.where(bar, 0.0, omega2))):
        worst = int(np.argmax(of))
        dt = phase / float(np.sqrt(of[worst])) if of[worst] > 0 else np.inf
        limits.append(Limit(name, dt, worst if of[worst] > 0 else -1))
    if chains is not None and len(chains[1]):
        of = square[chains[0]].sum(1)
        worst = int(np.argmax(of))
        own = Limit("any_shape", 2.0 / float(np.sqrt(max(of[worst], TINY))), int(chains[1][worst]))
        limits[0] = min(limits[0], own, key=lambda limit: limit.dt)
    return limits


def after_fracture_limit(elements, EA, L0, half, mass, held, eps_u, support, share: float) -> Limit:
    """Limit for any fragment of the net, if fragments take along up to `share` of what their ends carry.

        half : (m,) [kg], half of each element's own mass; mass : (n,) [kg]; held : (n,) bool, supports,
            whose fragments may take all of it
        eps_u : (m,) fracture strains; inf: the element never breaks; support : as in `any_shape_limits`

    The largest dt for which at no end more is needed than may be taken, max(0, k dt^2 / 2 - half) <= share *
    carried, nor at any particle by all of its elements together more than it carries. What cannot break takes
    nothing: all of k dt^2 / 2 - half counts there, of either sign, so that sum(k) dt^2 / 2 <= M holds for
    whatever is left of the particle.
    """
    breaks = np.isfinite(eps_u)
    if not breaks.any():
        return Limit("after_fracture", np.inf, -1)
    k = largest_stiffness(EA, L0)
    carried = mass - np.bincount(elements.ravel(), np.repeat(half, 2), len(mass))
    carried = np.where(carried > ROUNDING * mass, carried, 0.0)
    may_take = np.where(held, 1.0, share) * carried
    alone = np.sqrt(2.0 * (half + may_take[elements].min(1)) / k)  # the largest dt of each element by itself
    alone[~breaks] = np.inf
    worst = int(np.argmin(alone))
    dt = float(alone[worst])

    def lacking(dt: float) -> np.ndarray:
        need = 0.5 * k * dt * dt - half
        need = np.where(breaks, np.maximum(0.0, need), need)
        needed = np.bincount(elements.ravel(), np.repeat(need, 2), len(mass)) + 0.5 * support * dt * dt
        return np.where(held, 0.0, needed - carried)

    if lacking(dt).max(initial=0.0) > 0.0:
        low, high = float(np.sqrt(2.0 * half / k).min()), dt  # at low nothing is needed
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if lacking(middle).max(initial=0.0) > 0.0 else (middle, high)
        dt = low
        at = np.flatnonzero((elements == np.argmax(lacking(high))).any(1))
        worst = int(at[np.argmax((k / np.maximum(half, 1e-300))[at])])
    return Limit("after_fracture", dt, worst)


def scaled_mass(elements, EA, L0, mass, free, support, share: float) -> np.ndarray:
    """Masses (n,) [kg] with inertia added where that makes the step for slack cables, omega dt = 1, longest.

    share : of the sum of the moving masses that may be added

    An element asks for Omega_a^2 + Omega_b^2 <= 1 / dt^2, Omega_p^2 = sum(k) / M. A particle that is above
    half of that gets as much as leaves the rest to its neighbours, or half if one of them is above it too.
    free : (n,) bool, whether any axis is free
    """
    k = largest_stiffness(EA, L0)
    of_elements = np.bincount(elements[:, 0], k, len(mass)) + np.bincount(elements[:, 1], k, len(mass))
    stiffness = np.where(free, of_elements + support, 0.0)
    square = stiffness / np.where(free, mass, 1.0)
    budget = share * mass[free].sum()

    def added(dt: float) -> np.ndarray:
        whole = 1.0 / (dt * dt)
        beside = np.zeros(len(mass))
        for a, b in ((0, 1), (1, 0)):
            np.maximum.at(beside, elements[:, a], np.minimum(square[elements[:, b]], 0.5 * whole))
        return np.maximum(stiffness / np.maximum(0.5 * whole, whole - beside) - mass, 0.0) * free

    low = 1.0 / np.sqrt(2.0 * square.max(initial=0.0)) if square.any() else 0.0  # nothing is needed
    if not (low > 0.0 and budget > 0.0):
        return mass
    high = 2.0 * low
    while added(high).sum() <= budget:
        low, high = high, 2.0 * high
    while high - low > CLOSE * low:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if added(middle).sum() <= budget else (low, middle)
    return mass + added(low)


@kernel
def fragment_mass(EA: float, L0: float, half: float, dt: float) -> float:
    """Mass [kg] of a particle that splits off with an element, in a run whose steps ask for stability at dt
    [s].
    """
    return max(half, 0.5 * EA / L0 * dt * dt)
