"""Limit points between two equilibria of one load path: where a net snaps through, and under how much load.

From an equilibrium A the part of the load that is missing comes on, from 0 to 1. If the displacements up to
the equilibrium B are those that the tangent stiffness at A foresees, and that at B too, the path between them
is plain. Otherwise the interval is halved, the equilibrium between is found from its lower end, and both
halves are judged. A path that only bends becomes plain in short intervals. At a limit point the net jumps
however short the interval is, and if the equilibrium between is not stable, the tangent has lost its positive
definiteness below it. The energy of cables is convex in the positions: a net without bars has no limit point.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from netfall.equilibrium.newton import NoConvergence
from netfall.equilibrium.stable import unstable_at
from netfall.ground.errors import DivergedError
from netfall.numerics.functions import lengths
from netfall.parallel.mpi import MPI

OFF = 0.5  # of the motion of an element's ends against each other: what a tangent may miss of it
LEAST = 1e-3  # of an element's length: a smaller motion of its ends against each other is no jump
NARROW = 2.0**-9  # of the load: in so short an interval a path that only bends is plain
NARROWEST = 2.0**-16  # the same where the tangent foresees more than there is, as where cables become taut
MOST_TRIALS = 60  # equilibria between


class LimitPoint(NamedTuple):
    """Where a load path snaps through, or loses its stability.

    share : of the load, to `NARROW`; particle : global number of the one that jumps most, -1: none jumps
    jump : its displacement beyond what the tangent foresees [m]
    """

    share: float
    particle: int
    jump: float


class _Motion(NamedTuple):
    """What happens in an interval; plain : whether both tangents foresee it; jumps : whether one misses.

    particle, size : global number of the particle that moves most beyond that, and by how much [m]
    """

    plain: bool
    jumps: bool
    particle: int
    size: float


class _Untold(Exception):
    """The path goes through states of which it cannot be told whether they follow steadily."""


UNKNOWN = _Motion(False, False, -1, 0.0)


class LoadPath:
    """The path from an equilibrium to another under more load.

    newton(share) : Newton's method under a share of the load that comes on, with its lengths and held nodes
    find(share) : brings the state from where it is to the equilibrium under it; raises DivergedError
    """

    def __init__(self, state, newton: Callable, find: Callable[[float], object], hangs: bool):
        """hangs : whether the net may be a mechanism on the way, stable only when it is taut."""
        self.state, self.newton, self.find, self.hangs = state, newton, find, hangs

    def limit_point(self, x: np.ndarray, end: np.ndarray | None) -> tuple[LimitPoint | None, np.ndarray]:
        """The first limit point, None: there is none, or it cannot be told; positions at the end. Collective.

        x : (n, 3) [m] in the equilibrium without that load; end : with it, None: it is not stable
        The end may be another than was given: that to which the path leads.
        """
        try:
            return self._search(x, end)
        except _Untold:
            return None, end

    def _search(self, x: np.ndarray, end: np.ndarray | None) -> tuple[LimitPoint | None, np.ndarray]:
        low, above, sought = 0.0, [(1.0, end)], end is None
        for _ in range(MOST_TRIALS):
            high, there = above[-1]
            motion = UNKNOWN if there is None else self._motion(x, there, low, high)
            if motion is None and (low, high) == (0.0, 1.0):
                return None, end
            motion = motion or UNKNOWN
            if motion.plain:
                low, x = above.pop()
                if not above:
                    return None, x
                continue
            narrow = high - low <= NARROW
            if narrow and not sought and high == 1.0:
                sought, above[-1] = True, (high, self._between(x, high))
                continue
            if narrow and (there is None or motion.jumps):
                return LimitPoint(low, motion.particle, motion.size), end
            if high - low <= NARROWEST:
                low, x = above.pop()
                if not above:
                    return None, x
                continue
            middle = 0.5 * (low + high)
            above.append((middle, self._between(x, middle)))
        return None, end

    def _between(self, x: np.ndarray, share: float) -> np.ndarray | None:
        """Positions in the stable equilibrium under a share of the load, from x; None: none was found."""
        self.state.x[:] = x
        try:
            self.find(share)
            stable = unstable_at(self.newton(share)) < 0
        except DivergedError:
            stable = False
        if not stable and self.hangs:
            raise _Untold
        return self.state.x.copy(order="K") if stable else None

    def _motion(self, x, there, low: float, high: float) -> _Motion | None:
        """What happens from x to there (n, 3) [m]; None: a tangent is singular, so it cannot be judged."""
        state, moved, foreseen = self.state, there - x, []
        for begin, share, to, sign in ((x, low, high, 1.0), (there, high, low, -1.0)):
            state.x[:] = begin
            step = self._answer(share, to)
            if step is None:
                return None
            foreseen.append(np.where(state.free[: len(step)] != 0, sign * step, moved))
        a, b = state.ends.T
        apart = moved[b] - moved[a]
        size = lengths(apart)
        counts = size > LEAST * state.elements_now().L
        missed = [apart - (step[b] - step[a]) for step in foreseen]
        off = [bool((counts & (lengths(each) > OFF * size)).any()) for each in missed]
        short = [counts & ((each * apart).sum(1) > OFF * size**2) for each in missed]
        own = slice(state.n_owned)
        beyond = lengths((moved - foreseen[0])[own])
        newton = self.newton(low)
        gid = newton.distribution.subdomain.particle_gid[own]
        p = int(np.argmax(beyond)) if len(beyond) else -1
        here = (float(beyond[p]), -int(gid[p])) if p >= 0 else (-1.0, 0)
        most, particle = max(newton.comm.allgather(here))
        found = np.array([any(off), short[0].any()], np.int64)
        newton.comm.Allreduce(MPI.IN_PLACE, found, MPI.MAX)
        return _Motion(not found[0], bool(found[1]), -particle, most)

    def _answer(self, share: float, to: float) -> np.ndarray | None:
        """Displacements (n, 3) [m] that the tangent under one share foresees under another.

        The net is in equilibrium under the first. None: the tangent is singular.
        """
        newton = self.newton(share)
        newton.begin()
        K = newton.tangent()
        cycle, newton = newton.cycle(K), self.newton(to)
        try:
            s, _ = newton.solve(K, cycle, newton.residual())
        except NoConvergence:
            return None
        newton.spread_out(s)
        return newton.spread.copy()


def load_on_path(finder, load: np.ndarray, before: dict, start: dict, carried: float) -> Callable:
    """What acts at a share of the way from the state before a load to that under it: load(share) (n, 3) [N].

    finder : `find.Finder`; before, start : arrays of the state, by name, in equilibrium before the load, and
    with the unstressed lengths and held nodes that come with it; carried : share of all at the end of the way

    The call also sets lengths and held nodes, which change in proportion. Collective.
    """
    state = finder.state
    held, lengths = state.free == 0, [name for name in ("L0", "strand") if name in start]

    def set_lengths(share: float) -> None:
        for name in lengths:
            getattr(state, name)[:] = before[name] + share * (start[name] - before[name])
        state.x[held] = (before["x"] + share * (start["x"] - before["x"]))[held]

    state.x[:] = before["x"]
    set_lengths(0.0)
    left = finder.residual(load)

    def part(share: float) -> np.ndarray:
        set_lengths(share * carried)
        return load - (1.0 - share * carried) * left

    return part


def is_compressible(comm: MPI.Comm, state) -> bool:
    """Whether anything carries compression or bends; else the energy is convex. Collective."""
    return comm.allreduce(state.joints is not None or bool((state.bar != 0).any()), MPI.LOR)
