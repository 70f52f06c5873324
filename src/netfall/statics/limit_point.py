"""Limit points between two equilibria on one load path: the load factors at which a net snaps through.

From an equilibrium A the missing part of the load is applied, with a factor from 0 to 1. The path to the
equilibrium B is plain if the tangents at A and at B both predict the displacements between A and B. Otherwise
the interval is halved: the equilibrium at its middle is found from its lower end, and both halves are
examined. A path that only curves becomes plain in short intervals. At a limit point the net jumps however
short the interval is, but as a cable goes slack it moves less in a shorter one. If the equilibrium at the
middle is not stable, the tangent loses its positive definiteness below it. The energy of cables is convex in
the positions, so a net without bars has no limit point.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from netfall.core.arrays import FloatArray
from netfall.core.errors import DivergedError
from netfall.core.functions import lengths
from netfall.parallel.mpi import MPI
from netfall.physics.state import State
from netfall.statics.bounds import LARGE_SHARE, NEGLIGIBLE
from netfall.statics.limit_load import BRACKET_WIDTH
from netfall.statics.newton import NoConvergence

MIN_WIDTH = 2.0**-15  # share of the load below which an interval with a jump is not halved
LEAST_PASSED = 0.01  # share of the largest force [-], below which no compression counts as passed
COSINE_30 = 0.75**0.5  # [-], of 30 degrees, by which a compressed bar has turned over
COSINE_2 = 0.9994  # [-], of 2 degrees: two shallower compressed bars that snap through carry next to nothing
MIN_JUMP = 1e-3  # relative motion of an element's ends over its length [-], below which it is not a jump


class LimitPoint(NamedTuple):
    """Load factor at which a path snaps through or loses its stability.

    share : load factor, to within half of `BRACKET_WIDTH`, where a path that only curves is plain
    particle : global number of the one that jumps most, -1: none jumps
    jump : its displacement beyond the prediction of the tangent [m]
    """

    share: float
    particle: int
    jump: float


class _Motion(NamedTuple):
    """Motion over an interval compared with the predictions of the tangents at its ends.

    plain : whether both tangents predict it; jumps : whether one of them misses motion
    particle, size : global number of the particle that moves most beyond the prediction, and by how much [m]
    """

    plain: bool
    jumps: bool
    particle: int
    size: float


UNKNOWN_MOTION = _Motion(False, False, -1, 0.0)


class LoadPath:
    """Path from one equilibrium to another under more load.

    newton(share) : Newton's method at a load factor, with the lengths and held nodes that belong to it
    find(share) : brings the state to the equilibrium at that factor; raises DivergedError
    """

    def __init__(
        self, state: State, newton: Callable[..., Any], find: Callable[[float], object], is_mechanism: bool
    ):
        """is_mechanism : whether the net may be one along the path; it is stable only when taut."""
        self.state, self.newton, self.find, self.is_mechanism = state, newton, find, is_mechanism

    def limit_point(
        self, x: np.ndarray, end: np.ndarray | None
    ) -> tuple[LimitPoint | None, np.ndarray | None]:
        """Find the first limit point, None: there is none. Collective.

        x : (n, 3) [m] in equilibrium without the load; end : with the load, None: unstable

        Also returns the positions at the end of the path, which may differ from the given ones.
        """
        low, jump = 0.0, UNKNOWN_MOTION
        # factors, positions, whether found from close by
        stack: list[tuple[float, Any, bool]] = [(1.0, end, end is None)]
        while True:  # except for those with a jump, at most 2 / BRACKET_WIDTH intervals are narrow
            high, upper, is_near = stack[-1]
            motion = UNKNOWN_MOTION if upper is None else self._motion(x, upper, low, high)
            if motion is None and (low, high) == (0.0, 1.0):
                return self._limit_point_of_fall(x, end, low), end
            motion, is_narrow = motion or UNKNOWN_MOTION, high - low <= 0.5 * BRACKET_WIDTH
            if motion.plain or (is_narrow and is_near and upper is not None and not motion.jumps):
                # if narrow, the tangent predicts more motion than there is, for example as cables become taut
                (low, x, _), jump = stack.pop(), UNKNOWN_MOTION
                if not stack:
                    return None, x
                continue
            jump = motion if motion.jumps else jump
            if is_narrow and is_near and (upper is None or high - low <= MIN_WIDTH):
                return LimitPoint(low, jump.particle, jump.size), end
            if is_narrow and not is_near:
                high, _, _ = stack.pop()
            else:
                high = 0.5 * (low + high)
            upper = self._between(x, high)
            if upper is None and self.is_mechanism and not is_narrow:
                return self._limit_point_of_fall(x, end, low), end
            stack.append((high, upper, is_narrow))

    def _limit_point_of_fall(self, x: FloatArray, end: FloatArray | None, low: float) -> LimitPoint | None:
        """Return a limit point at x (n, 3) [m] if a bar turns over between x and `end`. Collective.

        If the net may be a mechanism along the path, only bars that turn by more than 90 degrees count.
        """
        if end is None or not self.has_turned_over(x, end, compressed=not self.is_mechanism):
            return None
        newton = self.newton(low)
        jump, particle = newton.largest_at(lengths((end - x)[newton.owned]))
        return LimitPoint(low, particle, jump)

    def has_turned_over(self, x: FloatArray, end: FloatArray, compressed: bool = True) -> bool:
        """Return whether a bar turns by more than 90 degrees from x to `end` (n, 3) [m]. Collective.

        compressed : whether 30 degrees are enough if it is compressed at the end
        """
        state, (a, b), newton = self.state, self.state.ends.T, self.newton(1.0)
        state.x[:] = end
        first, last = x[b] - x[a], end[b] - end[a]
        is_compressed = compressed & (state.present_element_state().eps < -NEGLIGIBLE)
        least = np.where(is_compressed, COSINE_30, 0.0) * lengths(first) * lengths(last)
        turns = (state.bar != 0) & (state.EA > 0.0) & ((first * last).sum(1) < least)
        return newton.comm.allreduce(bool(turns.any()), MPI.LOR)

    def may_snap(self, x: FloatArray, end: FloatArray) -> bool:
        """Return whether the path from x to `end` (n, 3) [m] has a sign of a limit point. Collective.

        A bar turns over, or the tangent at x is singular or predicts compression in a bar that has tension at
        the end, or that turns by more than 2 degrees and far more than predicted.
        """
        if self.has_turned_over(x, end):
            return True
        state, (a, b) = self.state, self.state.ends.T
        state.x[:] = end
        N = state.present_element_state().N
        if (newton := self._predicted(x, 0.0, 1.0)) is None:
            return True
        d, u, now = x[b] - x[a], newton.u[b] - newton.u[a], state.present_element_state()
        foreseen = now.N + state.EA / state.L0 * (u * d).sum(1) / now.L
        least = LEAST_PASSED * newton.comm.allreduce(float(np.abs(N).max(initial=0.0)), MPI.MAX)
        last = end[b] - end[a]
        turns = _misses(last - d, u, now.L)[1] & ((last * d).sum(1) < COSINE_2 * lengths(last) * lengths(d))
        passes = (state.bar != 0) & ((N > 0.0) | turns) & (foreseen < -least)
        return newton.comm.allreduce(bool(passes.any()), MPI.LOR)

    def _between(self, x: np.ndarray, share: float) -> np.ndarray | None:
        """Find the stable equilibrium at a load factor from positions x; None: none was found."""
        self.state.x[:] = x
        try:
            self.find(share)
            stable = self.newton(share).unstable_at() < 0
        except DivergedError:
            stable = False
        return self.state.x.copy(order="K") if stable else None

    def _predicted(self, x: FloatArray, factor: float, target: float) -> Any:
        """Predict the displacements to a load factor by the tangent at x (n, 3) [m]. Collective.

        Returns Newton's method with them, None: the tangent is singular.
        """
        self.state.x[:] = x
        newton = self.newton(factor)  # the net is in equilibrium there
        newton.begin()
        K = newton.tangent()
        cycle, newton = newton.cycle(K), self.newton(target)
        try:
            s, _ = newton.solve(K, cycle, newton.residual())
        except NoConvergence:
            return None
        newton.set_displacement(s)
        return newton

    def _motion(self, x: FloatArray, upper: FloatArray, low: float, high: float) -> _Motion | None:
        """Compare the motion from x to `upper` (n, 3) [m] with predictions; None if a tangent is singular."""
        state, motion, foreseen, is_known = self.state, upper - x, [], []
        for begin, factor, target, sign in ((x, low, high, 1.0), (upper, high, low, -1.0)):
            if (newton := self._predicted(begin, factor, target)) is None:
                return None
            predicted = newton.u
            newton.begin()
            # a tangent that is singular but for rounded tensions predicts any motion: no sign of a jump
            is_known.append(newton.largest(predicted[newton.owned])[0] <= newton.extent)
            foreseen.append(np.where(state.free[: len(predicted)] != 0, sign * predicted, motion))
        a, b = state.ends.T
        relative, L = motion[b] - motion[a], state.present_element_state().L
        missed = [_misses(relative, predicted[b] - predicted[a], L) for predicted in foreseen]
        exceeds, falls_short = ([bool(rows.any()) for rows in each] for each in zip(*missed))
        largest, particle = newton.largest_at(lengths((motion - foreseen[0])[newton.owned]))
        # from a start that is a mechanism the net moves far as its cables become taut
        jumps = (falls_short[0] and is_known[0]) or (low > 0.0 and falls_short[1] and is_known[1])
        flags = np.array([any(exceeds), jumps], np.int64)
        newton.comm.Allreduce(MPI.IN_PLACE, flags, MPI.MAX)
        return _Motion(not flags[0], bool(flags[1]), particle, largest)


def _misses(relative: FloatArray, predicted: FloatArray, L: FloatArray) -> tuple[np.ndarray, np.ndarray]:
    """Return whether a prediction misses the motion of each element (m,), and whether it is too short.

    relative, predicted : motion (m, 3) [m] of the second end relative to the first; L : (m,) [m]
    """
    size, error = lengths(relative), relative - predicted
    counts = size > MIN_JUMP * L
    exceeds = counts & (lengths(error) > LARGE_SHARE * size)
    return exceeds, counts & ((error * relative).sum(1) > LARGE_SHARE * size**2)


def load_on_path(
    finder: Any, load: np.ndarray, before: dict[str, Any], start: dict[str, Any], carried: float
) -> Callable[..., Any]:
    """Return a function load(share) (n, 3) [N] of the load between one state and another.

    finder : `solver.EquilibriumFinder`
    before, start : arrays of the state, by name: in equilibrium before the load, and with the unstressed
        lengths and held nodes that come with the load
    carried : load factor at the end of the way

    The function also sets lengths and held nodes, which change in proportion, and the slips of the start.
    Collective.
    """
    state = finder.state
    held, lengths = state.free == 0, {"L0": before["L0"]}
    if "strand" in start:  # the slips before a stage are part of its lengths
        lengths["strand"] = start["strand"] + (before["L0"] - start["L0"])

    def set_lengths(share: float) -> None:
        for name, first in lengths.items():
            getattr(state, name)[:] = first + share * (start[name] - first)
        state.x[held] = (before["x"] + share * (start["x"] - before["x"]))[held]
        if "slip" in start:
            state.slip[:] = start["slip"]

    state.x[:] = before["x"]
    set_lengths(0.0)
    finder.settle_slips()
    residual = finder.residual(load)

    def load_at(share: float) -> np.ndarray:
        set_lengths(share * carried)
        return load - (1.0 - share * carried) * residual

    return load_at


def has_compression(comm: MPI.Comm, state: State) -> bool:
    """Return whether anything carries compression or bends; otherwise the energy is convex. Collective."""
    return comm.allreduce(state.joints is not None or bool((state.bar != 0).any()), MPI.LOR)
