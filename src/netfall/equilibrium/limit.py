"""The largest part of a load that a net of cables bears, by work control: see `work`.

Each trial prescribes the work and finds the load. How near the net then is to giving way grows nearly in
proportion to the work, so few trials do; the load hardly changes between the last of them.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from netfall.equilibrium.mixed import NIL, Mixed
from netfall.equilibrium.newton import LEFT, Newton, NoConvergence
from netfall.equilibrium.overload import SHARP, UNSTRAINED, Strained
from netfall.equilibrium.work import Work
from netfall.ground.stop import StopRequest
from netfall.mechanics.state import State
from netfall.numerics.functions import power

FIRST = 1.5  # times: how closely displacements are found to begin with, by which something gives way
MOST_SIZES = 100  # of these
ASIDE, FARTHER = 0.01, 0.02  # of what gives way: so far beyond it the next trial is to be, and the first ones
HALF = 0.5  # of what keeps the load within `SHARP` of the other end: how far beyond, where that end is near
APART = 0.4  # of `SHARP`: the same where it is far
FAR = 2.0  # of what gives way: from there it grows as a power of the work, where nothing is borne yet
POWER = 1.5  # that
WITHIN = 0.05  # of what is between two trials: no nearer to either
MOST_TRIALS = 20
NEAR = 1e-4  # the last step of a trial, see `Mixed`


class Trial(NamedTuple):
    """An equilibrium under a given work [J]; factor : of the load; there : how near it is to giving way."""

    work: float
    factor: float
    there: Strained

    @property
    def most(self) -> float:
        """As of `Strained`."""
        return self.there.most


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
    work = Work(newton, load)
    _begin(newton, state, work, strained)
    work.target = work.done()
    mixed, x = Mixed(newton, state, stop, work), state.x.copy(order="K")
    before = low = Trial(0.0, 0.0, UNSTRAINED)
    high = None
    for _ in range(MOST_TRIALS):
        mixed.narrow(NEAR, tolerances[0])
        now = Trial(work.target, work.factor, strained())
        if now.there.reason:
            high = now
        else:
            before, low, x[:] = low, now, state.x
            if low.factor >= 1.0:
                return LimitLoad(low.factor, UNSTRAINED, mixed.gradients, mixed.missing)
        report(low.factor, min(high.factor, 1.0) if high else 1.0)
        if high and high.factor - low.factor <= SHARP * high.factor:
            break
        work.target = _next(before, low, high)
        mixed.begin_again()
    else:
        raise NoConvergence(f"{MOST_TRIALS} trials were not enough")
    if now is not low:
        state.x[:], work.target, work.factor = x, low.work, low.factor
        mixed.begin_again()
    try:
        mixed.narrow(0.0, tolerances[1])
    except NoConvergence:  # what is missing tells
        if max(mixed.missing) > tolerances[0]:
            raise
    return LimitLoad(work.factor, high.there, mixed.gradients, mixed.missing)


def _begin(newton: Newton, state: State, work: Work, strained: Callable[[], Strained]) -> None:
    """Move the net in the shape of its first answer to the load so far that something gives way."""
    K, x = newton.tangent(), state.x.copy(order="K")
    shape, _ = newton.solve(K, newton.cycle(K), work.load, LEFT)
    newton.spread_out(shape)
    shape, low = newton.spread.copy(), 0.0
    (most,) = newton.largest(shape)
    if most == 0.0:
        raise NoConvergence("the load moves nothing")
    part, low, high = newton.extent / most, 0.0, np.inf
    for _ in range(MOST_SIZES):
        state.x[:] = x + part * shape
        if strained().reason:
            high = part
        else:
            low = part
        if high <= FIRST * low:
            return
        part = 2.0 * low if high == np.inf else np.sqrt(low * high) if low else 0.5 * high
    raise NoConvergence("no displacements are about those with which something gives way")


def _next(before: Trial, low: Trial, high: Trial | None) -> float:
    """The work [J] of the next trial, by the line through the last two that are borne, or through both ends.

    It aims a little beyond what gives way, from the side of the farther end.
    """
    if high is None:
        far = (1.0 + FARTHER - low.most) * (low.work - before.work) / max(low.most - before.most, NIL)
        return low.work + min(far, low.work)
    most, wide = high.most - low.most, high.work - low.work
    enough = SHARP * high.factor * most / (high.factor - low.factor)  # between both ends
    below, above = 1.0 - low.most, high.most - 1.0
    room = enough - min(below, above)
    aside = min(ASIDE, HALF * room if room > 0.0 else APART * enough)
    aim = 1.0 - aside if below > above else 1.0 + aside
    if low.work == 0.0 and high.most > FAR:
        return high.work * float(power(aim / high.most, 1.0 / POWER))
    return low.work + min(max((aim - low.most) / most, WITHIN), 1.0 - WITHIN) * wide
