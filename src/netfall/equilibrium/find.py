"""One equilibrium of a net, by Newton's method or by the ways that serve where that does not find it.

The estimated error decides when it is found: what one more correction would move, as a share of the largest
displacement, and what it would change of tensions, as a share of the largest. So `tolerance` means the same
for any net and any refinement. What Newton's method does not find is relaxed (`goals`). What that does not
find soon is sought from where chains hang (`hang`), and with tensions as unknowns (`mixed`).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from typing import NamedTuple

import numpy as np

from netfall.equilibrium.goals import Goals
from netfall.equilibrium.hang import hung_positions
from netfall.equilibrium.increments import Watch, approach, at_once
from netfall.equilibrium.limit import LimitLoad, limit_load
from netfall.equilibrium.mixed import Mixed
from netfall.equilibrium.newton import AT_START, Newton, NoConvergence, StartPoint, Stopped, is_large
from netfall.equilibrium.overload import NOT_FOUND_AT_ONCE, SURELY, UNSTRAINED, GivesWay, Strained
from netfall.equilibrium.relaxation import Paused, Relaxation, RunsAway, net_of, not_begun
from netfall.equilibrium.slip import Slips
from netfall.equilibrium.stable import unstable_at
from netfall.ground.errors import DivergedError
from netfall.ground.stop import NEVER, StopRequest
from netfall.mechanics.elements import add_tensions, axial_forces
from netfall.mechanics.state import State
from netfall.multigrid.cycle import Cycle, Structure
from netfall.multigrid.factors import MOST_PRODUCTS, Factors, Pattern, factors_of_tangent
from netfall.multigrid.lines import lines_of
from netfall.multigrid.tangent import Tangent, tangent_of
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution

ALIKE = 1.5  # times stiffer or softer: what the first approximate inverse serves
SLACKER = 0.01  # of the largest stiffness: below that an element counts as slack in comparing two tangents
SMALLER = 0.5  # times: the residual of a guess, if it is to be taken
QUICK = 10_000  # iterations of a relaxation of a small net; beyond that tensions as unknowns are quicker
EXACT = 1e-10  # of the forces out of balance, that a response leaves
MIXED = -1
NO_ELEMENTS = np.zeros(0, np.int64)
FEWEST = 2000  # particles for that, and for factors of many answers; below it others take hardly longer
NEAR = 1e-4, 1e-6, 0.0  # steps with tensions as unknowns: so near Newton's method is tried again
ROUNDED = 10.0  # times the tolerance: what is then missing is told, where rounding ends these steps


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
    relaxed: bool
    unstable_at: int

    @property
    def error(self) -> float:
        """The larger of both."""
        return max(self.displacement_error, self.tension_error)


@dataclass
class Finder:
    """Finds equilibria of one state; keeps the approximate inverse of its first tangent.

    serving : the inverse, in factors, that serves instead; None: none
    slips : cables that slip over nodes, None: none do
    goal : which of the residuals the last equilibrium was relaxed to before Newton's method went on; 0: none;
        `MIXED`: it was brought near by `mixed`
    report(words) : of what is being done
    """

    comm: MPI.Comm
    halo: Halo
    distribution: Distribution
    state: State
    slips: Slips | None = None
    serving: Factors | None = field(default=None, init=False)
    goal: int = field(default=0, init=False)
    report: Callable[[str], None] = field(default_factory=lambda: lambda words: None, init=False)
    _first: tuple[Tangent, list[float], Cycle] | None = field(default=None, init=False)
    _pattern: Pattern | None = field(default=None, init=False)
    _structure: Structure | None = field(default=None, init=False)

    def forget(self) -> None:
        """Of a net whose elements are others from now on."""
        self._first = self._pattern = self._structure = self.serving = None

    def factors(self) -> Factors | None:
        """The inverse where the net is, for `serving`; None: none, or a cycle is quicker. Collective."""
        if is_large(self.distribution) or self.state.features.bending:  # what joints add has no place in them
            return None
        self._pattern = self._pattern or Pattern(self.distribution, self.state)
        few = self._pattern.products <= MOST_PRODUCTS
        return self._factors(self._tangent(), 0.0) if few else None

    def _factors(self, K: Tangent, inertia: float) -> Factors | None:
        return factors_of_tangent(self.distribution, self._pattern, K, inertia)

    def find(
        self,
        load: np.ndarray,
        tolerance: float,
        reference: float,
        max_iterations: int,
        what: str,
        stop: StopRequest = NEVER,
        resume: Relaxation | None = None,
        guess: np.ndarray | None = None,
        watch: Watch | None = None,
        goal: int | None = None,
    ) -> Solution:
        """Bring the state to equilibrium under a load (n, 3) [N] of owned and halo particles. Collective.

        tolerance : of the estimated errors; reference : [N], the largest force that acts; max_iterations : of
        the relaxation; stop, resume : as in `relax`; guess : positions (n, 3) [m] that may be nearer
        watch : as of `approach`; goal : in a search near by, to begin with, as of `Finder`

        Raises DivergedError if neither finds one, Paused if asked to stop, GivesWay.
        """
        newton, state = self.newton(load), self.state
        if resume is not None and (resume.iteration > 0 or resume.stage > 0):
            start = resume.start
        else:
            resume, start = None, state.x.copy(order="K")
            by_newton = self._begun_by_newton(newton, tolerance, stop, guess, watch, goal)
            if by_newton is not None:
                return by_newton
        first = goal - 1 if goal and goal != MIXED and resume is None else 0  # a finer search may have more
        goals = Goals(self, newton, tolerance, reference, what, stop, start, goal is None, first)
        count = len(goals.residuals)
        if resume is None or resume.stage < count:
            try:
                return goals.relax(min(max_iterations, QUICK), resume, in_all=True)
            except RunsAway:
                raise
            except DivergedError:
                resume = None
        if resume is None or (resume.stage == count and resume.iteration == 0):
            state.x[:], resume = start, None
            try:
                return self._from_far(newton, load, tolerance, stop)
            except Stopped:
                state.x[:] = start
                raise Paused(replace(not_begun(start), stage=count, start=start)) from None
            except NoConvergence:
                state.x[:] = start
        goals.first = 0
        return goals.relax(max_iterations, resume, begun=count)

    def _begun_by_newton(
        self, newton: Newton, tolerance: float, stop: StopRequest, guess, watch, goal: int | None
    ) -> Solution | None:
        """By Newton's method; None, and the state as it was: not found. Collective.

        The rest as of `find`. Raises Paused, GivesWay.
        """
        x, self.goal = self.state.x, 0
        before = x.copy(order="K")
        guessed = guess is not None and self._begin_at(guess, newton)
        try:
            if not goal or goal == MIXED:  # else it would not be found
                return self._by_newton(newton, tolerance, stop, watch, before, goal)
        except Stopped:
            x[:] = before
            raise Paused(not_begun(before)) from None
        except GivesWay:
            if not guessed:  # from where shares are of what is missing, not of the load
                raise
            x[:] = before
            return self._begun_by_newton(newton, tolerance, stop, None, watch, goal)
        except NoConvergence:
            pass
        x[:] = before
        return None

    def residual(self, load: np.ndarray) -> np.ndarray:
        """Residual forces (n, 3) [N] on the free axes under a load, 0 at halo particles."""
        r = np.zeros_like(self.state.x)
        r[: self.state.n_owned] = self.newton(load).residual()
        return r

    def foresees(self, load: np.ndarray) -> bool:
        """Whether the tangent tells nearly what a load (n, 3) [N] does, so that rest is near. Collective."""
        x = self.state.x.copy(order="K")
        try:
            return at_once(self.newton(load), self.state.x_start, NEVER) is not AT_START
        except NoConvergence:
            return False
        finally:
            self.state.x[:] = x

    def _begin_at(self, guess: np.ndarray, newton: Newton) -> bool:
        """Begin there if the residual is so much smaller there; whether it is. Collective."""
        state, before, residuals = self.state, self.state.x.copy(order="K"), []
        for x in (before, guess):
            state.x[:] = x
            residuals += newton.largest(newton.residual())
        nearer = residuals[1] < SMALLER * residuals[0]
        if not nearer:
            state.x[:] = before
        return nearer

    def relaxed(self, newton: Newton, total: int, residual: float, last: tuple | None) -> Solution:
        """What relaxation alone has reached. Collective.

        last : positions (n, 3) [m] and axial forces (m,) [N] of ten times the residual, None: not known
        """
        try:
            errors = newton.errors(self.state.x_start)
        except NoConvergence:
            errors = newton.changes(*last, self.state) if last else (np.nan, np.nan)
        return Solution(total, residual, *errors, True, unstable_at(newton))

    def _by_newton(
        self,
        newton: Newton,
        tolerance: float,
        stop: StopRequest,
        watch: Watch | None,
        before: np.ndarray,
        goal: int | None,
    ) -> Solution:
        """By Newton's method, from where the net is, or by way of tensions as unknowns. Collective.

        before : positions (n, 3) [m] from which that begins; goal : `MIXED`, where it is taken at once

        Raises NoConvergence, Stopped, GivesWay, RunsAway.
        """
        if not goal:
            try:
                return self._corrected(newton, tolerance, AT_START, stop, watch=watch)
            except NoConvergence:
                self.state.x[:] = before
        if goal != MIXED and not self._is_mixed():
            raise NoConvergence("there is more than cables, or the net is small")
        return self._by_tensions(newton, tolerance, stop, watch, self.has_limit_load())

    def _by_tensions(
        self,
        newton: Newton,
        tolerance: float,
        stop: StopRequest,
        watch: Watch | None = None,
        limited: bool = False,
    ) -> Solution:
        """With tensions as unknowns, then by Newton's method. Collective.

        limited : whether `limit_load` is to decide what gives way. Raises as `_by_newton`.
        """
        self.goal, mixed = MIXED, Mixed(newton, self.state, stop)
        for size in NEAR:
            try:
                near = mixed.narrow(size, tolerance, watch if limited else None)
                there = watch() if watch else UNSTRAINED
                if there.most > SURELY:  # no more is to be known of it
                    raise GivesWay(0.0, 1.0, there)
            except NoConvergence:
                if max(mixed.missing) <= ROUNDED * tolerance:
                    break
                if watch and limited:
                    raise GivesWay(0.0, 1.0, NOT_FOUND_AT_ONCE) from None
                raise
            if size == 0.0 or max(mixed.missing) <= tolerance:
                break
            before = self.state.x.copy(order="K")
            try:
                return self._corrected(newton, tolerance, near, stop, True)
            except NoConvergence:
                self.state.x[:] = before
        residual = newton.largest(newton.residual())
        return Solution(mixed.gradients, *residual, *mixed.missing, False, unstable_at(newton))

    def _from_far(self, newton: Newton, load: np.ndarray, tolerance: float, stop: StopRequest) -> Solution:
        """From where chains hang, else with tensions as unknowns. Collective.

        Raises NoConvergence, Stopped.
        """
        x, slipping = self.state.x, self.slips.chains.element if self.slips else NO_ELEMENTS
        start, hung = x.copy(order="K"), hung_positions(self.distribution, self.state, load, slipping)
        for begin in (hung, start):
            if begin is None:
                continue
            x[:] = begin
            if begin is hung:
                try:
                    return self._corrected(newton, tolerance, AT_START, stop, patient=False)
                except NoConvergence:
                    x[:] = begin
            try:
                if self._has_tensions():
                    return self._by_tensions(newton, tolerance, stop)
            except NoConvergence:
                continue
        raise NoConvergence("neither led to an equilibrium")

    def has_limit_load(self) -> bool:
        """Whether `limit_load` serves the net."""
        return self._is_mixed() and self.state.features.plastic

    def limit_load(
        self,
        load: np.ndarray,
        more: np.ndarray,
        strained: Callable[[], Strained],
        tolerances: tuple[float, float],
        stop: StopRequest,
        report: Callable[[float, float], None],
    ) -> tuple[LimitLoad, Solution]:
        """Bring the state to the largest part of `more` that it bears beside a load (n, 3) [N]. Collective.

        The rest as of `limit.limit_load`.
        """
        own = more[: self.state.n_owned]
        limit = limit_load(self.newton(load), self.state, own, strained, tolerances, stop, report)
        newton = self.newton(load + limit.factor * more)
        residual = newton.largest(newton.residual())
        return limit, Solution(limit.gradients, *residual, *limit.missing, False, unstable_at(newton))

    def _has_tensions(self) -> bool:
        """Whether tensions may be unknowns."""
        return self.slips is None and self.state.joints is None

    def _is_mixed(self) -> bool:
        """Whether they are before anything is relaxed."""
        return self.distribution.n >= FEWEST and self._has_tensions()

    def corrected_from(self, newton: Newton, tolerance: float, begun: StartPoint, patient: bool) -> Solution:
        """By Newton's method, from where a relaxation has come. Raises NoConvergence. Collective."""
        return self._corrected(newton, tolerance, begun, NEVER, True, patient=patient)

    def _corrected(
        self,
        newton: Newton,
        tolerance: float,
        begun: StartPoint,
        stop: StopRequest,
        near: bool = False,
        watch: Watch | None = None,
        patient: bool = True,
    ) -> Solution:
        """By Newton's method. Raises NoConvergence, Stopped, GivesWay.

        begun : how far the net has come; near : whether that is near, so that no correction is too dear if it
        is patient
        """
        start = self.state.x_start
        if newton.large and not near:
            direct = self._is_mixed() and (watch is None or self.state.features.plastic)
            begun = at_once(newton, start, stop) if direct else approach(newton, start, stop, watch)
        found = newton.find(tolerance, start, stop, near and patient, begun)
        of_errors = found.residual, found.moved, found.tension
        return Solution(found.gradients, *of_errors, False, unstable_at(newton))

    def responses(self, load: np.ndarray, count: int) -> Callable[[np.ndarray], tuple]:
        """What so many changes (m,) [m] of unstressed lengths do where the net is, each by a call.

        load : (n, 3) [N] that acts. Collective, and so are the calls: they give (n, 3) [m] of nodes and
        (m,) [N], and raise NoConvergence where the tangent is singular.
        """
        newton, state = self.newton(load), self.state
        newton.begin()
        K = newton.tangent()
        inverse = cache(lambda: self._factors_for(K, count) or self._approximate_inverse(newton, K))

        def respond(change):
            fixed = self.at_fixed_nodes(change)
            newton.f[:] = 0.0
            add_tensions(state.x, state.ends, fixed, state.elements_now().L, newton.f)
            r = newton.not_held(newton.f[newton.owned])
            s, _ = newton.solve(K, inverse(), r, EXACT)
            newton.spread_out(s)
            axial = np.empty(len(change))
            axial_forces(newton.spread, state.ends, K.direction, K.axial, axial)
            if K.slip is not None:
                K.slip.add_changes(newton.spread, axial)
            return newton.spread, fixed + axial

        return respond

    def _factors_for(self, K: Tangent, count: int) -> Factors | None:
        """Those of a larger net, where so many answers are worth them. Collective."""
        if self.distribution.n < FEWEST or self.state.features.bending:
            return None
        self._pattern = self._pattern or Pattern(self.distribution, self.state)
        return self._factors(K, 0.0) if self._pattern.products <= count * MOST_PRODUCTS else None

    def at_fixed_nodes(self, change: np.ndarray) -> np.ndarray:
        """Changes of axial forces (m,) [N] with unstressed lengths, changed by (m,) [m], at fixed nodes."""
        state, K = self.state, self._tangent()
        if K.slip is not None:
            change = K.slip.of_strands(change)
        return -K.axial * (state.elements_now().L / state.L0) * change

    def newton(self, load: np.ndarray) -> Newton:
        """Newton's method for the net under a load (n, 3) [N]."""
        net, state = net_of(self.state, load, self.slips), self.state
        if self._structure is None:  # lines of the net at the start, also in a run that is taken up
            of_state = lambda: lines_of(self.distribution, state.ends, state.x_start, state.free)
            self._structure = Structure(cache(of_state))
        inverses = self._approximate_inverse, self._structure, self.serving and self._factors
        return Newton(self.comm, self.halo, self.distribution, net, self._tangent, *inverses)

    def _tangent(self) -> Tangent:
        slip = None if self.slips is None else self.slips.tangent()  # first: lengths follow the positions
        return tangent_of(self.state)._replace(slip=slip)

    def _approximate_inverse(self, newton: Newton, K: Tangent) -> Cycle | Factors:
        """That which serves, or that of the first tangent while K is like it, or else K's own. Collective."""
        if self.serving is not None:
            return newton.cycle(K) if newton.inertia else self.serving
        if self._first is None:
            first = self._tangent_at_first()
            least = [SLACKER * size for size in newton.largest(first.axial, first.across)]
            self._first = first, least, newton.cycle(first)
        first, least, cycle = self._first
        unlike = K.joints is not None  # which turn with their chains
        unlike |= not (_alike(K.axial, first.axial, least[0]) and _alike(K.across, first.across, least[1]))
        return newton.cycle(K) if newton.inertia or self.comm.allreduce(unlike, MPI.LOR) else cycle

    def _tangent_at_first(self) -> Tangent:
        """Before anything has moved or yielded, the same in a run that is taken up."""
        state = self.state
        now = [(rows, rows.copy(order="K")) for rows in (state.x, state.L0, state.eps_p) if rows is not None]
        state.x[:] = state.x_start
        if state.strand is not None:
            state.L0[:] = state.strand
        if state.eps_p is not None:
            state.eps_p[:] = 0.0
        first = tangent_of(state)
        for rows, values in now:
            rows[:] = values
        return first


def _alike(now: np.ndarray, before: np.ndarray, least: float) -> bool:
    """Whether two stiffnesses (m,) of the same elements are of one size; below `least` they are."""
    now, before = np.maximum(now, least), np.maximum(before, least)
    return bool((now <= ALIKE * before).all() and (before <= ALIKE * now).all())
