"""Equilibrium by Newton's method: each correction answers the residual forces by the tangent stiffness.

Conjugate gradients with a cycle through the levels of `cycle` solve for it; what a full correction moves
is an estimate of the error before it, in displacement and tension, at any refinement. Where the tangent is
not positive, what compression takes from it is left out; where it is singular all the same (no prestress, all
slack) inertia is added until it is not.
"""

from typing import NamedTuple

import numpy as np

from netfall.ground.stop import NEVER, StopRequest
from netfall.mechanics.bending import add_joint_stiffness
from netfall.mechanics.elements import add_stiffness, axial_forces
from netfall.mechanics.supports import keep_on_guides, largest_residual
from netfall.multigrid.cycle import Cycle
from netfall.multigrid.distributed import advance, dot_rows, turn
from netfall.multigrid.tangent import Tangent, without_compression
from netfall.numerics.functions import lengths
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.parallel.sums import exact_sums

MOST_CORRECTIONS = 25  # of one equilibrium: what converges takes 3 to 15
MOST_GRADIENTS = 200  # iterations of conjugate gradients for a correction: a singular tangent takes more
MANY_GRADIENTS = 25  # such iterations, beyond which a new cycle is cheaper than the old one (jobs/bench)
LEFT = 3e-3  # of a residual [-], after a correction: two corrections then nearly reach the default tolerance
LEFT_LAST = 0.1  # the same, where no more is needed to be within the tolerance
CAUTION = 10.0  # times more is taken to be left after many iterations: slow modes hold more of the error
FARTHEST = 0.1  # of the net's extent [-]: what a correction may move; farther its tangent tells nothing
HALVINGS = 10  # of a correction that goes too far
SHORT = 0.3  # of a correction [-]: if less of it can be gone, the next gets more inertia
FAR = 0.6  # of the largest tension [-]: a correction that changes more, unforeseen, begins too far away
INERTIA = 1e-6, 1e-3  # of the nodes' stiffness [-], added to a singular tangent, at first and at most: more
# would slow what the tangent resists
NEARLY = 10.0  # times the tolerance [-]: the largest error where rounding or a singular tangent ends a search
ULPS = 4.0  # units in the last place of coordinates, by which lengths are off: two ends, two roundings
NIL = 1e-6  # of the net's extent [-]: smaller displacements count as so much, of which errors are shares


STABLE, UNKNOWN = -1, -2  # in place of a particle of which an equilibrium shows that it is not stable


class Solution(NamedTuple):
    """An equilibrium that was found.

    iterations : of conjugate gradients, or of the relaxation; residual : largest [N]
    displacement_error, tension_error : estimates, shares of the largest: of what is left, or, where the
        tangent tells nothing, of what the last tenth of the residual changed; nan where none could be made
    relaxed : whether by dynamic relaxation; unstable_at : where the equilibrium is not stable, the global
        number of the particle that moves most, else `STABLE`, or `UNKNOWN` where that could not be decided
    """

    iterations: int
    residual: float
    displacement_error: float
    tension_error: float
    relaxed: bool = False
    unstable_at: int = UNKNOWN

    @property
    def error(self) -> float:
        """The larger of both."""
        return max(self.displacement_error, self.tension_error)


class StartPoint(NamedTuple):
    """How far a net has come near an equilibrium.

    gradients : iterations; size : of the last correction, the larger share as of `Newton.sizes`
    """

    gradients: int = 0
    size: float = np.inf


class Stopped(Exception):
    """Newton's method was asked to stop."""


class NoConvergence(Exception):
    """Newton's method did not find the equilibrium."""


class SlowConvergence(NoConvergence):
    """Conjugate gradients did not converge: the tangent is nearly singular."""


class NotPositiveDefinite(NoConvergence):
    """There are displacements (n_owned, 3), `shape`, against which the tangent has no stiffness."""

    def __init__(self, shape: np.ndarray):
        super().__init__("the tangent is not positive")
        self.shape = shape


def still_missing(sizes: tuple[float, float], part: float, before: float) -> tuple[float, ...]:
    """Errors left after a part of a step of such sizes, where steps become smaller at a rate that stays.

    before : the larger size of the step before. At least as much is left as the step itself.
    """
    rate = max(sizes) / before if before else np.inf
    left = max(1.0, rate / (1.0 - rate)) if rate < 1.0 else np.inf
    return tuple(size * (1.0 - part + left) if size else 0.0 for size in sizes)


class Newton:
    """Newton's method for one net on these ranks."""

    def __init__(self, comm: MPI.Comm, halo: Halo, distribution: Distribution, net, tangent, structure):
        """net : `relaxation.Net`; tangent() : the `Tangent` at its positions. Collective.

        structure : what the cycles of the net have in common, `cycle.Structure`
        """
        self.comm, self.halo, self.distribution = comm, halo, distribution
        self.net, self.tangent, self.structure = net, tangent, structure
        self.owned = slice(halo.n_owned)
        self.moves = np.ascontiguousarray(net.free[self.owned]) != 0
        self.stays = np.nonzero(~self.moves)
        self.moved_elements = net.free.any(1)[net.ends].any(1)  # the others, between supports, do not count
        self.spread = np.zeros_like(np.ascontiguousarray(net.x))
        self.answer = np.zeros_like(self.spread)
        self.f = np.zeros_like(net.x)
        self.inertia = self.extent = 0.0

    def begin(self) -> None:
        """Forget earlier inertia, and see how large the net is now. Collective."""
        x = self.net.x[self.owned]
        low, high = x.min(0, initial=np.inf), x.max(0, initial=-np.inf)
        self.comm.Allreduce(MPI.IN_PLACE, low, MPI.MIN)
        self.comm.Allreduce(MPI.IN_PLACE, high, MPI.MAX)
        self.extent, self.inertia = float((high - low).max()), 0.0

    def dots(self, *pairs) -> list[float]:
        """Inner products over all ranks of pairs of arrays (n_owned, 3), correctly rounded. Collective."""
        rows = np.empty((len(pairs), self.halo.n_owned))
        for out, (a, b) in zip(rows, pairs):
            dot_rows(a, b, out)
        return exact_sums(self.comm, *rows)

    def largest(self, *values) -> list[float]:
        """Largest size in each of several arrays over all ranks. Collective."""
        mine = np.array([np.abs(each).max(initial=0.0) for each in values])
        self.comm.Allreduce(MPI.IN_PLACE, mine, MPI.MAX)
        return mine.tolist()

    def residual(self) -> np.ndarray:
        """Residual forces (n_owned, 3) [N] on the free axes."""
        self.net.forces(self.net.x, self.f)
        return self.not_held(self.f[self.owned])

    def spread_out(self, u: np.ndarray) -> None:
        """Put displacements u (n_owned, 3) [m] in `spread` (n, 3), halo particles too. Collective."""
        self.spread[self.owned] = u
        self.halo.update(self.spread)

    def stiffness_times(self, K: Tangent, u: np.ndarray) -> np.ndarray:
        """Forces (n_owned, 3) [N] that answer displacements u (n_owned, 3) [m]; a view. Collective."""
        self.spread_out(u)
        self.answer[:] = 0.0
        add_stiffness(self.spread, self.net.ends, K.direction, K.axial, K.across, self.answer)
        if K.joints is not None:
            add_joint_stiffness(self.spread, K.joints.particles, K.joints.stiffness, self.answer)
        if K.support is not None:
            self.answer += K.support * self.spread
        if K.between is not None:
            self.answer[:, :2] += K.between[:, None] * self.spread[:, 1::-1]
        out = self.answer[self.owned]
        if K.slip is not None:
            K.slip.soften(self.spread, self.answer)
        if self.inertia:
            out += self.inertia * K.nodal[self.owned, None] * u
        return self._held(out)

    def not_held(self, rows: np.ndarray) -> np.ndarray:
        """A copy of rows (n_owned, 3) with nothing along what is held."""
        return self._held(np.where(self.moves, rows, 0.0))

    def _held(self, rows: np.ndarray) -> np.ndarray:
        """The same rows (n_owned, 3), with 0 on held axes, and along lines on which supports hold."""
        rows[self.stays] = 0.0
        if self.net.turned is not None:
            keep_on_guides(self.net.turned, rows)
        return rows

    def solve(self, K: Tangent, cycle: Cycle, r: np.ndarray, share: float = LEFT) -> tuple[np.ndarray, int]:
        """Return the correction (n_owned, 3) [m] of a residual, of which a share is left, and the iterations.

        Collective. Raises NoConvergence where the tangent is singular in its direction.
        """
        s, left, before = np.zeros_like(r), r.copy(), np.empty_like(r)
        z = self._held(cycle(left))
        p = z.copy()
        rz, rr = self.dots((left, z), (left, left))
        if rr == 0.0:
            return s, 0
        if not (0.0 < rz < np.inf and rr < np.inf):
            raise NoConvergence("the preconditioner is not positive")
        first = rz
        for iteration in range(1, MOST_GRADIENTS + 1):
            q = self.stiffness_times(K, p)
            (pq,) = self.dots((p, q))
            if not pq > 0.0:
                raise NotPositiveDefinite(p)
            step = rz / pq
            advance(step, p, q, s, left, before)
            z = self._held(cycle(left))
            size, new, old = self.dots((left, left), (left, z), (before, z))
            if size <= share * share * rr and new <= share * share * first:
                return s, iteration
            turn((new - old) / rz, z, p)
            rz = new
            if not 0.0 < rz < np.inf:
                raise NoConvergence("the preconditioner is not positive")
        raise SlowConvergence(f"{MOST_GRADIENTS} iterations of conjugate gradients were not enough")

    def cycle(self, K: Tangent) -> Cycle:
        """The approximate inverse of a tangent. Collective."""
        return Cycle(self.distribution, self.net, K, self.inertia, self.structure)

    def find(
        self,
        tolerance: float,
        start: np.ndarray,
        stop: StopRequest = NEVER,
        near: StartPoint | None = None,
        quick: bool = False,
    ) -> Solution:
        """Move the net to equilibrium. Collective.

        tolerance : of what is missing after the last correction, a share of the largest displacement from
            `start` (n, 3) and of the largest tension; stop : a wish to pause
        near : how far the net has come near an equilibrium, so that no correction is too dear
        quick : whether another method is better where a correction goes too far

        Raises NoConvergence, Stopped if asked to stop; the positions are then those of the last correction.
        """
        self.begin()
        K, (total, before) = self.tangent(), near or StartPoint()
        cycle, r = None, self.residual()
        exact = True  # the tangent, compression included
        for _ in range(MOST_CORRECTIONS):
            if self.comm.allreduce(int(stop.wanted), MPI.MAX):
                raise Stopped
            cycle = cycle or self.cycle(K)
            share = min(max(LEFT, tolerance / (LEFT * max(before, tolerance))), LEFT_LAST)
            try:
                s, count = self.solve(K, cycle, r, share)
            except NoConvergence as error:
                if quick or (isinstance(error, SlowConvergence) and not near):
                    raise
                if exact and self.comm.allreduce(K.softened, MPI.LOR):
                    K, exact = without_compression(K), False
                else:
                    self._more_inertia()
                    cycle = None
                before = np.inf
                continue
            total += count
            moved, change, predicted = self.sizes(K, s, start)
            part = self.go(s, r)
            old, r, K = K, self.residual(), self.tangent()
            unforeseen = self.unforeseen(old, K, predicted)
            whole, change = part == 1.0 and not self.inertia, max(change, unforeseen)
            if quick and (part < SHORT or unforeseen > FAR):
                raise NoConvergence("it is not near")
            size, changed = max(moved, change), self.active_set_changes(old, K)
            if changed:  # slack or yield that came or went: the tangent did not know
                before = np.inf
            if changed or count > MANY_GRADIENTS:
                cycle = None
            left = CAUTION * share if count > MANY_GRADIENTS else share
            missing = max(left, min(1.0, size / before)) if 0.0 < before < np.inf else 1.0
            done = missing * size <= tolerance or missing * size <= self.rounding(K)
            if whole and exact and done:
                mine = largest_residual(self.f, self.net.free, self.halo.n_owned)
                worst = self.comm.allreduce(mine, MPI.MAX)
                return Solution(total, worst, missing * moved, missing * change)
            before, exact = size if whole else np.inf, True
            if part < SHORT:
                self._more_inertia()
            elif part == 1.0:
                self.inertia = 0.0 if self.inertia <= INERTIA[0] else 0.1 * self.inertia
        raise NoConvergence(f"{MOST_CORRECTIONS} corrections were not enough")

    def rounding(self, K: Tangent) -> float:
        """What rounded coordinates may change of tensions, a share of the largest. Collective."""
        size = np.abs(self.net.x).max(1, initial=0.0)[self.net.ends].max(1, initial=0.0)
        force = ULPS * np.finfo(float).eps * (K.axial + np.abs(K.across)) * size
        force, tension = self.largest(force[self.moved_elements], K.N[self.moved_elements])
        return force / tension if tension > 0.0 else 0.0

    def errors(self, start: np.ndarray) -> tuple[float, float]:
        """Estimated errors where the net is: of displacement and tension, shares of the largest. Collective.

        Raises NoConvergence where the tangent is singular.
        """
        self.begin()
        K = self.tangent()
        s, _ = self.solve(K, self.cycle(K), self.residual())
        return self.sizes(K, s, start)[:2]

    def changes(self, x: np.ndarray, N: np.ndarray, state) -> tuple[float, float]:
        """What has changed since x (n, 3) [m], N (m,) [N]: shares of displacement and tension as of `errors`.

        Collective, after `begin`.
        """
        own, now, counts = self.owned, state.elements_now().N, self.moved_elements
        parts = (state.x - x)[own], (state.x - state.x_start)[own], (now - N)[counts], now[counts]
        step, far, most, tension = self.largest(*(lengths(each) if each.ndim > 1 else each for each in parts))
        return step / max(far, NIL * self.extent), most / tension if tension > 0.0 else 0.0

    def _more_inertia(self) -> None:
        self.inertia = 10.0 * self.inertia or INERTIA[0]
        if self.inertia > INERTIA[1]:
            raise NoConvergence("the tangent is singular")

    def unforeseen(self, old: Tangent, new: Tangent, predicted: np.ndarray) -> float:
        """Largest change of tension that the old tangent did not predict, a share of the largest."""
        off, tension = self.largest(
            (new.N - old.N - predicted)[self.moved_elements], new.N[self.moved_elements]
        )
        return off / tension if tension > 0.0 else 0.0

    def active_set_changes(self, old: Tangent, new: Tangent) -> int:
        """How many elements have become slack or taut, or begun or ceased to yield. Collective."""
        changed = (old.axial == 0.0) != (new.axial == 0.0)
        return self.comm.allreduce(np.count_nonzero(changed & self.distribution.subdomain.element_owned))

    def sizes(self, K: Tangent, s: np.ndarray, start: np.ndarray) -> tuple[float, float, np.ndarray]:
        """A correction's largest displacement and change of tension, shares of the largest; all changes."""
        self.spread_out(s)
        change = np.empty(len(K.axial))
        away = np.ascontiguousarray(self.net.x[self.owned] - start[self.owned])
        axial_forces(self.spread, self.net.ends, K.direction, K.axial, change)
        if K.slip is not None:
            K.slip.add_changes(self.spread, change)
        squares = np.empty((2, self.halo.n_owned))
        dot_rows(s, s, squares[0])
        away += s
        dot_rows(away, away, squares[1])
        counts = self.moved_elements
        sizes = (np.sqrt(squares[0]), np.sqrt(squares[1]), change[counts], K.N[counts])
        step, far, most, tension = self.largest(*sizes)
        if step <= ULPS * np.finfo(float).eps * self.extent:
            return 0.0, 0.0, change
        return step / max(far, NIL * self.extent), most / tension if tension > 0.0 else 0.0, change

    def most_of(self, s: np.ndarray) -> float:
        """The part of a correction that does not move anything too far. Collective."""
        return min(1.0, FARTHEST * self.extent / max(self.largest(s)[0], 1e-300))

    def go(self, s: np.ndarray, r: np.ndarray) -> float:
        """Move by a correction, or by the part of it along which the residual does not turn round.

        How much of it. Collective.
        """
        share = self.most_of(s)
        before = self.net.x.copy()
        (slope,) = self.dots((r, s))
        self.spread_out(s)
        for _ in range(HALVINGS):
            self.net.x[:] = before + share * self.spread
            (after,) = self.dots((self.residual(), s))
            if np.isfinite(after) and after >= -0.5 * slope:
                break
            part = slope / (slope - after) if np.isfinite(after) else 0.1
            share *= min(max(part, 0.1), 0.5)
        return share
