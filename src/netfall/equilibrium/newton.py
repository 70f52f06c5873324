"""Equilibrium by Newton's method: each correction answers the residual forces by the tangent stiffness.

Conjugate gradients with a cycle through the levels of `cycle` solve for it; what a full correction moves
is an estimate of the error before it, in displacement and tension, at any refinement. Where the tangent is
not positive, what compression takes from it is left out; where it is singular all the same (no prestress, all
slack) inertia is added until it is not.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from netfall.ground.stop import NEVER, StopRequest
from netfall.mechanics.bending import add_joint_stiffness
from netfall.mechanics.elements import add_stiffness, axial_forces
from netfall.mechanics.supports import keep_on_guides, largest_residual
from netfall.multigrid.cycle import Cycle, Structure
from netfall.multigrid.distributed import advance, dot_rows, turn
from netfall.multigrid.factors import Factors
from netfall.multigrid.tangent import Tangent, without_compression
from netfall.numerics.functions import lengths
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.parallel.sums import exact_sums

MOST_CORRECTIONS = 25
FEW_CORRECTIONS = 8  # near the equilibrium
MOST_GRADIENTS = 200  # iterations of conjugate gradients for one correction; a relaxation is then cheaper
LEFT = 3e-3  # of the residual, that these leave: two corrections then nearly reach the default tolerance
ROUGH = 0.1  # of the residual: a correction that leaves so much is rough
GLANCE = 12  # iterations after which a correction tells whether it goes too far
LEFT_LAST = 0.1  # the same, where no more is needed to be within the tolerance
HALVINGS = 10  # of a correction that goes too far
FARTHEST = 0.1  # of the net's extent: what a correction may move
FIRST_INERTIA = 1e-6  # of the nodes' stiffness, once the tangent is found singular
MOST_INERTIA = 1e-3
MANY_GRADIENTS = 25  # for one correction of a large net; another approximate inverse is then cheaper
FEW_GRADIENTS = 8  # the same with factors
CAUTION = 10.0  # times more is taken to be left of the tensions after so many
LARGE = 10_000  # particles; below that relaxation takes no longer than what serves larger nets
SHORT = 0.3  # of a correction: if no more than that can be gone, the next gets more inertia
FASTEST, SLOWEST = 0.5, 0.99  # of the size of the last step, that the next ones are taken to have
ROUNDING = 1e-14  # of the net's extent: a correction below that is rounding
ULPS = 4.0  # units in the last place of coordinates, by which lengths are off
NIL = 1e-6  # of the net's extent: a displacement below that counts as so much


class NewtonResult(NamedTuple):
    """An equilibrium that was found: gradients : iterations of all corrections; residual : largest [N]

    moved, tension : estimated errors, shares of the largest displacement from the start and largest tension
    """

    gradients: int
    residual: float
    moved: float
    tension: float


class StartPoint(NamedTuple):
    """How far a net has come: gradients : iterations; size : of the last correction, as the larger of
    `moved` and `tension` of `NewtonResult`; cycle : approximate inverse in use, None: to be made
    """

    gradients: int = 0
    size: float = np.inf
    cycle: Cycle | None = None


AT_START = StartPoint()


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

    before : the larger size of the step before
    """
    rate = min(max(max(sizes) / before, FASTEST), SLOWEST)
    return tuple(size * (1.0 - part + rate / (1.0 - rate)) for size in sizes)


def is_large(distribution: Distribution) -> bool:
    """Whether a net is so large that the ways of large nets are shorter."""
    return distribution.n >= LARGE


class Newton:
    """Newton's method for one net on these ranks."""

    def __init__(
        self,
        comm: MPI.Comm,
        halo: Halo,
        distribution: Distribution,
        net,
        tangent,
        inverse,
        structure: Structure,
        factors=None,
    ):
        """net : `relaxation.Net`; tangent() : the `Tangent` at its positions
        inverse(newton, tangent) : the approximate inverse to use. Collective.
        structure : what the cycles have in common
        factors(tangent, inertia) : one that is made in place of a cycle, or None. Collective. None: none is
        """
        self.comm, self.halo, self.distribution = comm, halo, distribution
        self.net, self.tangent, self.inverse = net, tangent, inverse
        self.structure, self.factors = structure, factors
        self.owned = slice(halo.n_owned)
        self.moves = np.ascontiguousarray(net.free[self.owned]) != 0
        self.stays = np.nonzero(~self.moves)
        self.moved_elements = net.free.any(1)[net.ends].any(1)  # the others, between supports, do not count
        self.spread = np.zeros_like(np.ascontiguousarray(net.x))
        self.answer = np.zeros_like(self.spread)
        self.f = np.zeros_like(net.x)
        self.inertia = self.extent = 0.0
        self.large = is_large(distribution)
        self.many = FEW_GRADIENTS if factors else MANY_GRADIENTS if self.large else MOST_GRADIENTS
        self.most_left = LEFT if factors else LEFT_LAST  # by factors more is cheap

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

    def solve(
        self,
        K: Tangent,
        cycle,
        r: np.ndarray,
        share: float = LEFT,
        most: int = MOST_GRADIENTS,
        rough: Callable[[np.ndarray], None] | None = None,
    ) -> tuple[np.ndarray, int]:
        """The correction (n_owned, 3) [m] of a residual, and the iterations, at most so many. Collective.

        rough(correction) : called each `GLANCE` iterations, until it leaves no more than `ROUGH` of the whole

        Raises NoConvergence where the tangent is singular in its direction.
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
        for iteration in range(1, most + 1):
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
            near = size <= ROUGH * ROUGH * rr
            if rough and (near or iteration % GLANCE == 0):
                rough(s)
                rough = None if near else rough
            turn((new - old) / rz, z, p)
            rz = new
            if not 0.0 < rz < np.inf:
                raise NoConvergence("the preconditioner is not positive")
        raise SlowConvergence(f"{most} iterations of conjugate gradients were not enough")

    def cycle(self, K: Tangent) -> Cycle | Factors:
        """The approximate inverse of a tangent. Collective."""
        factors = self.factors and self.factors(K, self.inertia)
        if factors:
            return factors
        of_net = self.distribution, self.halo, self.net
        return Cycle(self.comm, *of_net, K, self.inertia, self.structure)

    def find(
        self,
        tolerance: float,
        start,
        stop: StopRequest = NEVER,
        near: bool = False,
        begun: StartPoint = AT_START,
    ) -> NewtonResult:
        """Move the net to equilibrium. Collective.

        tolerance : of what is missing after the last correction, a share of the largest displacement from
            `start` (n, 3) and of the largest tension; stop : a wish to pause
        near : whether the net is near the equilibrium, so that few corrections will do, and none is too dear
        begun : how far the net has come before

        Raises NoConvergence, Stopped if asked to stop; the positions are then those of the last correction.
        """
        self.begin()
        K = self.tangent()
        total, before, cycle = begun
        cycle, r = cycle or self.inverse(self, K), self.residual()
        exact = True  # the tangent, compression included
        most = FEW_CORRECTIONS if near else MOST_CORRECTIONS
        for _ in range(most):
            if self.comm.allreduce(int(stop.wanted), MPI.MAX):
                raise Stopped
            own = cycle is None
            if own:
                cycle = self.cycle(K)
            share = min(max(LEFT, tolerance / (LEFT * max(before, tolerance))), self.most_left)
            try:
                s, count = self.solve(K, cycle, r, share)
            except NoConvergence as error:
                slow = isinstance(error, SlowConvergence)
                if slow and self.factors and not own:
                    cycle = None
                    continue
                if slow and not near:
                    raise
                if exact and self.comm.allreduce(K.softened, MPI.LOR):
                    K, exact = without_compression(K), False
                else:
                    self._more_inertia()
                    cycle = self.cycle(K)
                before = np.inf
                continue
            total += count
            moved, change, predicted = self.sizes(K, s, start)
            part = self.go(s, r)
            old, r, K = K, self.residual(), self.tangent()
            whole, change = part == 1.0 and not self.inertia, max(change, self.unforeseen(old, K, predicted))
            size, changed = max(moved, change), self.active_set_changes(old, K)
            if changed:  # slack or yield that came or went: the tangent did not know
                before = np.inf
            if (self.large and changed) or count > self.many:
                cycle = None
            left = CAUTION * share if self.large and count > MANY_GRADIENTS else share
            missing = max(left, min(1.0, size / before)) if 0.0 < before < np.inf else 1.0
            done = missing * size <= tolerance or missing * size <= self.rounding(K)
            if whole and exact and done:
                mine = largest_residual(self.f, self.net.free, self.halo.n_owned)
                worst = self.comm.allreduce(mine, MPI.MAX)
                return NewtonResult(total, worst, missing * moved, missing * change)
            before, exact = size if whole else np.inf, True
            if part < SHORT:
                if near and begun.size < np.inf:
                    raise NoConvergence("it is not near")
                self._more_inertia()
            elif part == 1.0:
                self.inertia = 0.0 if self.inertia <= FIRST_INERTIA else 0.1 * self.inertia
        raise NoConvergence(f"{most} corrections were not enough")

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
        s, _ = self.solve(K, self.inverse(self, K), self.residual())
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
        self.inertia = FIRST_INERTIA if not self.inertia else 10.0 * self.inertia
        if self.inertia > MOST_INERTIA:
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
        if step <= ROUNDING * self.extent:
            return 0.0, 0.0, change
        return step / max(far, NIL * self.extent), most / tension if tension > 0.0 else 0.0, change

    def most_of(self, s: np.ndarray) -> float:
        """The part of a correction that does not move anything too far. Collective."""
        return min(1.0, FARTHEST * self.extent / max(self.largest(s)[0], 1e-300))

    def go(self, s: np.ndarray, r: np.ndarray, left=0.0) -> float:
        """Move by a correction, or by the part of it along which the residual does not turn round.

        How much of it. left : residual (n_owned, 3) [N] that r leaves out. Collective.
        """
        share = self.most_of(s)
        before = self.net.x.copy()
        (slope,) = self.dots((r, s))
        self.spread_out(s)
        for _ in range(HALVINGS):
            self.net.x[:] = before + share * self.spread
            (after,) = self.dots((self.residual() - left, s))
            if np.isfinite(after) and after >= -0.5 * slope:
                break
            part = slope / (slope - after) if np.isfinite(after) else 0.1
            share *= min(max(part, 0.1), 0.5)
        return share
