"""One equilibrium of a net: by Newton's method, by the interior point method, by relaxation.

Newton's method finds it where the net is near. Where that does not converge, the interior point method with
tensions as unknowns does (`mixed`), from any start, in nets of cables; dynamic relaxation serves last
(`goals`). The estimated error decides when it is found: what one more correction would move, as a share of
the largest displacement, and what it would change of tensions, as a share of the largest. So `tolerance`
means the same for any net and any refinement.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from netfall.equilibrium.goals import relaxed_in_turn
from netfall.equilibrium.limit import LimitLoad, limit_load
from netfall.equilibrium.mixed import NARROWED, Mixed
from netfall.equilibrium.newton import Newton, NoConvergence, Solution, StartPoint, Stopped
from netfall.equilibrium.overload import Strained
from netfall.equilibrium.relaxation import Paused, Relaxation, net_of, not_begun
from netfall.equilibrium.slip import Slips
from netfall.equilibrium.snap import is_compressible
from netfall.equilibrium.stable import unstable_at
from netfall.ground.errors import DivergedError
from netfall.ground.stop import NEVER, StopRequest
from netfall.mechanics.elements import add_tensions, axial_forces
from netfall.mechanics.state import State
from netfall.multigrid.cycle import Structure
from netfall.multigrid.lines import lines_of
from netfall.multigrid.tangent import Tangent, tangent_of
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution

EXACT = 1e-10  # of the forces out of balance [-]: what a response leaves, whose differences are used


@dataclass
class Finder:
    """Finds equilibria of one state.

    slips : cables that slip over nodes, None: none do
    report(words) : of what is being done
    """

    comm: MPI.Comm
    halo: Halo
    distribution: Distribution
    state: State
    slips: Slips | None = None
    report: Callable[[str], None] = field(default_factory=lambda: lambda words: None, init=False)
    _structure: Structure | None = field(default=None, init=False)

    def forget(self) -> None:
        """Of a net whose elements are others from now on."""
        self._structure = None

    def find(
        self,
        load: np.ndarray,
        tolerance: float,
        reference: float,
        max_iterations: int,
        what: str,
        stop: StopRequest = NEVER,
        resume: Relaxation | None = None,
        relaxes: bool = True,
        watch: Callable[[], None] | None = None,
    ) -> Solution:
        """Bring the state to equilibrium under a load (n, 3) [N] of owned and halo particles. Collective.

        tolerance : of the estimated errors; reference : [N], the largest force that acts; max_iterations : of
        the relaxation; stop, resume : as in `relax`; relaxes : whether relaxation serves last;
        watch : as of `Mixed`

        Raises DivergedError if none is found, RunsAway if there is none, Paused if asked to stop.
        """
        newton, x = self.newton(load), self.state.x
        if resume is None or not resume.is_begun:
            start, resume = x.copy(order="K"), None
            for way in (self._by_newton, self._by_tensions):
                try:
                    return way(newton, tolerance, stop, watch)
                except Stopped:
                    x[:] = start
                    raise Paused(not_begun(start)) from None
                except NoConvergence:
                    x[:] = start
        else:
            start = resume.start
        if not relaxes:
            raise DivergedError(f"{what}: no equilibrium was found at once")
        words = what, stop, start, resume
        return relaxed_in_turn(self, newton, tolerance, reference, max_iterations, *words)

    def _has_tensions(self) -> bool:
        """Whether tensions may be unknowns: those of cables alone have one equilibrium. Collective."""
        return self.slips is None and not is_compressible(self.comm, self.state)

    def has_limit_load(self) -> bool:
        """Whether `limit_load` serves the net: cables that yield, whose energy is convex. Collective."""
        return self._has_tensions() and self.state.features.plastic

    def _by_newton(self, newton: Newton, tolerance: float, stop: StopRequest, watch) -> Solution:
        """By Newton's method, from where the net is. Raises NoConvergence, Stopped. Collective."""
        return self.corrected(newton, tolerance, stop, quick=self._has_tensions())

    def _by_tensions(self, newton: Newton, tolerance: float, stop: StopRequest, watch) -> Solution:
        """By the interior point method, then by Newton's method. Collective.

        Raises NoConvergence, Stopped, RunsAway, what watch() raises.
        """
        if not self._has_tensions():
            raise NoConvergence("there are bars, or cables slip")
        mixed, x, found = Mixed(newton, self.state, stop, watch=watch), self.state.x, None
        for size in NARROWED:
            near = mixed.narrow(size, tolerance)
            if max(mixed.missing) <= tolerance:
                break
            before = x.copy(order="K")
            try:
                found = self.corrected(newton, tolerance, stop, near)
                break
            except NoConvergence:
                x[:] = before
        found = found or self._narrowed(newton, mixed.gradients, mixed.missing)
        if found.unstable_at >= 0:
            raise NoConvergence("it is not stable: relaxation leads to one that is, if there is one")
        return found

    def _narrowed(self, newton: Newton, gradients: int, missing: tuple[float, float]) -> Solution:
        """Return what the interior point method has found. Collective."""
        (residual,) = newton.largest(newton.residual())
        return Solution(gradients, residual, *missing, unstable_at=unstable_at(newton))

    def corrected(
        self,
        newton: Newton,
        tolerance: float,
        stop: StopRequest,
        near: StartPoint | None = None,
        quick: bool = False,
    ) -> Solution:
        """By Newton's method, as of `Newton.find`. Raises NoConvergence, Stopped. Collective."""
        found = newton.find(tolerance, self.state.x_start, stop, near, quick)
        return found._replace(unstable_at=unstable_at(newton))

    def residual(self, load: np.ndarray) -> np.ndarray:
        """Residual forces (n, 3) [N] on the free axes under a load, 0 at halo particles."""
        r = np.zeros_like(self.state.x)
        r[: self.state.n_owned] = self.newton(load).residual()
        return r

    def foresees(self, load: np.ndarray) -> bool:
        """Whether the tangent tells nearly what a load (n, 3) [N] does, so that rest is near. Collective."""
        x = self.state.x.copy(order="K")
        try:
            self.newton(load).find(np.inf, self.state.x_start, quick=True)
            return True
        except NoConvergence:
            return False
        finally:
            self.state.x[:] = x

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
        return limit, self._narrowed(newton, limit.gradients, limit.missing)

    def responses(self, load: np.ndarray) -> Callable[[np.ndarray], tuple]:
        """What a change (m,) [m] of unstressed lengths does where the net is, by a call.

        load : (n, 3) [N] that acts. Collective, and so are the calls: they give (n, 3) [m] of nodes and
        (m,) [N], and raise NoConvergence where the tangent is singular.
        """
        newton, state = self.newton(load), self.state
        newton.begin()
        K = newton.tangent()
        cycle = newton.cycle(K)

        def respond(change):
            fixed = self.at_fixed_nodes(change)
            newton.f[:] = 0.0
            add_tensions(state.x, state.ends, fixed, state.elements_now().L, newton.f)
            r = newton.not_held(newton.f[newton.owned])
            s, _ = newton.solve(K, cycle, r, EXACT)
            newton.spread_out(s)
            axial = np.empty(len(change))
            axial_forces(newton.spread, state.ends, K.direction, K.axial, axial)
            if K.slip is not None:
                K.slip.add_changes(newton.spread, axial)
            return newton.spread, fixed + axial

        return respond

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
        return Newton(self.comm, self.halo, self.distribution, net, self._tangent, self._structure)

    def _tangent(self) -> Tangent:
        slip = None if self.slips is None else self.slips.tangent()  # first: lengths follow the positions
        return tangent_of(self.state)._replace(slip=slip)
