"""The largest part of a load that a net of cables bears, by work control.

Near the largest load that a net bears a little more of it moves the net far, and under more there is no
equilibrium at all. Under a given work of the load, force times displacement of all particles, there is one
for any: the energy of cables is convex in the positions. So each trial prescribes the work, and the factor of
the load is an unknown beside the positions. How near the net then is to giving way grows nearly in proportion
to the work, so few trials do; the load hardly changes between the last of them.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from netfall.equilibrium.mixed import MOST_STEPS, NARROWED, Mixed
from netfall.equilibrium.newton import Newton, NoConvergence
from netfall.equilibrium.overload import NOTHING, OF_WORK, UNSTRAINED, Strained, Trial, search_limit
from netfall.ground.stop import StopRequest
from netfall.mechanics.state import State
from netfall.multigrid.tangent import Tangent


class Work:
    """Work control of a load (n_owned, 3) [N] that acts besides that of the net, from where the net is.

    factor : of that load; target : of its work [J], `factor` aside
    """

    def __init__(self, newton: Newton, load: np.ndarray):
        self.newton, self.load = newton, newton.not_held(load)
        self.start = newton.net.x[newton.owned].copy()
        self.factor = self.target = 0.0

    def done(self) -> float:
        """The work of the load where the net is [J], `factor` aside. Collective."""
        (work,) = self.newton.dots((self.load, self.newton.net.x[self.newton.owned] - self.start))
        return work

    def solve(self, K: Tangent, cycle, r: np.ndarray, left: float) -> tuple[np.ndarray, float, int]:
        """Correction (n_owned, 3) [m] of a residual r without the load, of `factor`, iterations. Collective.

        left : of the residual, at most. By conjugate gradients among displacements in which the load does no
        work (Gould, Hribar, Nocedal 2001), after one that brings it to `target`. Raises as `Newton.solve`.
        """
        newton, load, more = self.newton, self.load, 0.0
        answer = newton.not_held(cycle(load))
        (compliance,) = newton.dots((load, answer))

        def idle(rows: np.ndarray) -> np.ndarray:
            """As the cycle has it, without work; rows lose the part of the load that this leaves to it."""
            nonlocal more
            z = newton.not_held(cycle(rows))
            (work,) = newton.dots((load, z))
            less = work / compliance
            rows -= less * load
            z -= less * answer
            more -= less
            return z

        first = (self.target - self.done()) / compliance * answer
        r = r + self.factor * load - newton.stiffness_times(K, first)
        s, count = newton.solve(K, idle, r, left)
        return first + s, more, count


class LimitLoad(NamedTuple):
    """How much of a load is borne.

    factor : of it; beyond : what gives way under hardly more, `UNSTRAINED`: nothing, as all of it is borne
    gradients : iterations; missing : estimated errors, shares of the largest displacement and tension
    """

    factor: float
    beyond: Strained
    gradients: int
    missing: tuple[float, float]


def limit_load(
    newton: Newton,
    state: State,
    load: np.ndarray,
    strained: Callable[[], Strained],
    tolerances: tuple[float, float],
    stop: StopRequest,
    report: Callable[[float, float], None],
) -> LimitLoad:
    """Bring the net to the largest part of a load (n_owned, 3) [N] that it bears, to `SHARP`. Collective.

    newton : of what acts besides the load; strained() : how near the net is to giving way; tolerances : of
    the errors, on the way and at last; report(low, high) : factors between which the search is

    Raises NoConvergence, Stopped.
    """
    newton.begin()
    work, best = Work(newton, load), state.x.copy(order="K")
    _begin(newton, state, work, strained)
    first = work.done()
    mixed = Mixed(newton, state, stop, work)

    def trial(target: float) -> Trial:
        if target != first:
            mixed.begin_again()
        work.target = target
        mixed.narrow(NARROWED[0], tolerances[0])
        now = Trial(target, work.factor, strained())
        if not now.there.reason:
            best[:] = state.x
        return now

    low, high = _ends(trial, first)
    if high is not None:
        low, high = search_limit(trial, low, high, OF_WORK, report)
    beyond = UNSTRAINED if high is None or low.factor >= 1.0 else high.there
    state.x[:], work.target, work.factor = best, low.at, low.factor
    if beyond is UNSTRAINED:
        return LimitLoad(low.factor, beyond, mixed.gradients, mixed.missing)
    mixed.begin_again()
    try:
        mixed.narrow(0.0, tolerances[1])
    except NoConvergence:  # what is missing tells
        if max(mixed.missing) > tolerances[0]:
            raise
    return LimitLoad(work.factor, beyond, mixed.gradients, mixed.missing)


def _ends(trial: Callable[[float], Trial], first: float) -> tuple[Trial, Trial | None]:
    """Trials below and above the limit; None above: all of the load is borne. first : work [J]"""
    low, at = NOTHING, first
    for _ in range(MOST_STEPS):
        now = trial(at)
        if now.there.reason:
            return low, now
        low, at = now, 2.0 * at
        if low.factor >= 1.0:
            return low, None
    raise NoConvergence("nothing gives way under any work")


def _begin(newton: Newton, state: State, work: Work, strained: Callable[[], Strained]) -> None:
    """Move the net in the shape of its first answer to the load, nearly so far that something gives way."""
    K, x = newton.tangent(), state.x.copy(order="K")
    shape, _ = newton.solve(K, newton.cycle(K), work.load)
    newton.spread_out(shape)
    (most,) = newton.largest(newton.spread)
    if most == 0.0:
        raise NoConvergence("the load moves nothing")
    shape, times = newton.extent / most * newton.spread, 1.0
    state.x[:] = x + shape
    factor = 0.5 if strained().reason else 2.0
    for _ in range(MOST_STEPS):
        times *= factor
        state.x[:] = x + times * shape
        if bool(strained().reason) == (factor > 1.0):
            return
    raise NoConvergence("no displacements are about those with which something gives way")
