"""The equilibrium of a large net by load increments: by way of those under parts of what is missing.

Where a whole correction goes too far, so that tensions come out other than its tangent foresaw, only part of
the residual is answered: the net is brought near to equilibrium with the rest of it held, then the next
increment follows. Each is a few corrections near to where the last one was, so their number does not grow
with the net; that of a relaxation does.
"""

from collections.abc import Callable

import numpy as np

from netfall.equilibrium.newton import (
    AT_START,
    LEFT,
    MANY_GRADIENTS,
    MOST_GRADIENTS,
    ROUGH,
    Newton,
    NoConvergence,
    StartPoint,
    Stopped,
)
from netfall.equilibrium.overload import SURELY, UNSTRAINED, GivesWay, Strained
from netfall.ground.stop import StopRequest
from netfall.multigrid.tangent import without_compression
from netfall.parallel.mpi import MPI

Watch = Callable[[], Strained]

UNFORESEEN = 0.3  # of the largest tension: the most that an increment may change tensions unforeseen
FAR = 0.6  # of that: if a rough correction changes so much, a better one does too much
MOST_CHANGED = 0.05  # of all elements: the most that may become slack, taut or yield in an increment
SMALLEST = 1e-3  # of what is missing: an increment below that is none
SHORTER = 0.1, 0.9  # times, within which an increment is shortened until it is foreseen
HALF = 0.5  # times, where the active set changes too much
MOST_INCREMENTS = 50
SLOW = 5000  # iterations for all that is missing, as the last increment tells; a relaxation is then cheaper
FAILURES = 3  # of increments that are then tried again, shorter
AGAIN = 0.25  # times
CORRECTIONS = 15  # for each increment
MANY_ROUGH = 12  # iterations for that; another approximate inverse is then cheaper
MOST_ROUGH = 80
NEAR = 2e-2  # of the largest displacement and tension: what the last of them may move


def approach(newton: Newton, start: np.ndarray, stop: StopRequest, watch: Watch | None = None) -> StartPoint:
    """Move the net near to equilibrium, for `Newton.find` to go on. Collective.

    start : (n, 3), as of `Newton.find`; watch() : how near it is to giving way, None: it may

    Raises NoConvergence, Stopped, GivesWay. A tangent that is singular at the start is left to `Newton.find`.
    """
    increments, left = _Increments(newton, start, stop), 1.0
    for number in range(MOST_INCREMENTS):
        r, K = newton.residual(), increments.tangent()
        if number > 0 and newton.comm.allreduce(bool(((K.axial == 0.0) & (K.N > 0.0)).any()), MPI.LOR):
            raise NoConvergence("cables yield: which of them is open until the end")
        try:
            s = increments.solve(K, r, rough=number > 0)
        except NoConvergence:
            if number == 0:
                return AT_START
            raise
        before, x = increments.gradients, newton.net.x.copy(order="K")
        share, size = increments.add_increment(K, s, r)
        if share == 1.0:
            return StartPoint(increments.gradients, size, increments.cycle)
        there = watch() if watch else UNSTRAINED
        if there.most > SURELY:
            newton.net.x[:] = x
            raise GivesWay(1.0 - left, 1.0 - (1.0 - share) * left, there)
        left *= 1.0 - share
        if increments.gradients - before > SLOW * share:
            raise NoConvergence("there are too many load increments")
    raise NoConvergence(f"{MOST_INCREMENTS} load increments were not enough")


def at_once(newton: Newton, start: np.ndarray, stop: StopRequest) -> StartPoint:
    """Answer all of the residual, where the tangent foresees what that does; as `approach`. Collective."""
    increments = _Increments(newton, start, stop)
    K = increments.tangent()

    def glance(s: np.ndarray) -> None:
        if increments.unforeseen(K, s) > FAR:
            raise FarOff("it is far")

    try:
        s = increments.solve(K, newton.residual(), rough=False, glance=glance)
    except FarOff:
        raise
    except NoConvergence:
        return AT_START
    share, size = increments._move(K, s, 1.0)
    if share < 1.0:
        raise NoConvergence("it is far")
    return StartPoint(increments.gradients, size, increments.cycle)


class FarOff(NoConvergence):
    """A tangent does not foresee what answers the residual."""


class _Increments:
    """The approximate inverse in use; iterations and failures so far."""

    def __init__(self, newton: Newton, start: np.ndarray, stop: StopRequest):
        self.newton, self.start, self.stop = newton, start, stop
        self.gradients, self.failures, self.cycle = 0, 0, None
        newton.begin()

    def tangent(self):
        """Where the net is, without compression."""
        return without_compression(self.newton.tangent())

    def solve(self, K, r: np.ndarray, rough: bool = True, glance=None) -> np.ndarray:
        """The correction of a residual; glance(it) : when rough. Raises NoConvergence, Stopped."""
        share, many, most = (
            (ROUGH, MANY_ROUGH, MOST_ROUGH) if rough else (LEFT, MANY_GRADIENTS, MOST_GRADIENTS)
        )
        newton = self.newton
        if newton.comm.allreduce(int(self.stop.wanted), MPI.MAX):
            raise Stopped
        if self.cycle is None:
            self.cycle = newton.inverse(newton, K)
        s, count = newton.solve(K, self.cycle, r, share, most, glance)
        self.gradients += count
        if count > many:
            self.cycle = None
        return s

    def add_increment(self, K, s: np.ndarray, r: np.ndarray) -> tuple[float, float]:
        """Answer the share of a residual r (n_owned, 3) [N] that its correction s foresees; it, and its size.

        All of it is answered by s alone. Raises NoConvergence, Stopped.
        """
        newton, most = self.newton, 1.0
        before = newton.net.x.copy()
        while True:
            share, size = self._move(K, s, most)
            if share == 1.0:
                return share, size
            try:
                self._settle((1.0 - share) * r)
                return share, size
            except NoConvergence:
                self.failures += 1
                if self.failures > FAILURES:
                    raise
                newton.net.x[:] = before
                self.cycle, most = None, AGAIN * share

    def unforeseen(self, K, s: np.ndarray) -> float:
        """Largest change of tension by a correction, beyond what K foresees, a share. Collective."""
        newton = self.newton
        predicted, share = newton.sizes(K, s, self.start)[2], newton.most_of(s)
        before = newton.net.x.copy()
        newton.spread_out(s)
        newton.net.x[:] = before + share * newton.spread
        unforeseen = newton.unforeseen(K, self.tangent(), share * predicted)
        newton.net.x[:] = before
        return unforeseen

    def _move(self, K, s: np.ndarray, most: float) -> tuple[float, float]:
        """Move by the part of a correction that its tangent foresees, at most so much; it, and its size."""
        newton = self.newton
        moved, change, predicted = newton.sizes(K, s, self.start)
        before, share = newton.net.x.copy(), min(most, newton.most_of(s))
        newton.spread_out(s)
        while True:
            newton.net.x[:] = before + share * newton.spread
            now = self.tangent()
            unforeseen = newton.unforeseen(K, now, share * predicted)
            if (
                unforeseen <= UNFORESEEN
                and newton.active_set_changes(K, now) <= MOST_CHANGED * newton.distribution.m
            ):
                return share, max(share * moved, share * change, unforeseen)
            if unforeseen <= UNFORESEEN:
                share *= HALF
            else:
                share *= min(max(SHORTER[0], 0.95 * np.sqrt(UNFORESEEN / unforeseen)), SHORTER[1])
            if share < SMALLEST:
                raise NoConvergence("no load increment is foreseen")

    def _settle(self, left: np.ndarray) -> None:
        """Bring the net near to equilibrium but for a residual (n_owned, 3) [N]. Raises as that."""
        newton = self.newton
        K = self.tangent()
        for _ in range(CORRECTIONS):
            r = newton.residual() - left
            s = self.solve(K, r)
            moved, change, predicted = newton.sizes(K, s, self.start)
            share = newton.go(s, r, left)
            old, K = K, self.tangent()
            size = max(ROUGH * moved, ROUGH * change, newton.unforeseen(old, K, predicted))
            if share == 1.0 and size <= NEAR:
                return
        raise NoConvergence(f"{CORRECTIONS} corrections were not enough")
