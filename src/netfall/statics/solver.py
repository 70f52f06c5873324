"""Search for one static equilibrium of a net with three methods in turn.

Newton's method is tried first: it converges if the net is close to the equilibrium. If it fails, the
primal-dual interior point method with tensions as unknowns (`mixed`) follows. It converges from any start, in
nets of cables. Dynamic relaxation (`goals`) is the last method.

The search ends when the estimated error is within the tolerance. The error has two parts: the displacement of
one more correction over the largest displacement, and its change of tension over the largest tension. So
`tolerance` means the same for any net and any refinement.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from netfall.core.errors import DivergedError
from netfall.core.stop import NEVER, StopRequest
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.physics.elements import add_tensions, axial_forces
from netfall.physics.state import State
from netfall.statics.interior_point import NARROWED, Mixed
from netfall.statics.limit_load import Strained
from netfall.statics.limit_point import is_compressible
from netfall.statics.multigrid.cycle import Structure
from netfall.statics.multigrid.lines import Lines, lines_of
from netfall.statics.multigrid.tangent import Tangent, tangent_of
from netfall.statics.newton import Newton, NoConvergence, Solution, StartPoint, Stopped
from netfall.statics.relaxation import Paused, Relaxation, net_of, not_begun
from netfall.statics.relaxation_stages import relaxed_in_turn
from netfall.statics.slip import Slips
from netfall.statics.stability import unstable_at
from netfall.statics.work_control import LimitLoad, limit_load

# share of the residual force that may remain in a response [-]: small, since differences are used
EXACT = 1e-10


@dataclass
class Finder:
    """Search for equilibria of one state.

    slips : cables that slide over nodes, None: there are none
    report(words) : receives a line of text about the progress
    """

    comm: MPI.Comm
    halo: Halo
    distribution: Distribution
    state: State
    slips: Slips | None = None
    report: Callable[[str], None] = field(default_factory=lambda: lambda words: None, init=False)
    _structure: Structure | None = field(default=None, init=False)

    def forget(self) -> None:
        """Discard the cached multigrid structure after the elements of the net have changed."""
        self._structure = None

    def find(
        self,
        load: np.ndarray,
        tolerance: float,
        reference: float,
        max_iterations: int,
        name: str,
        stop: StopRequest = NEVER,
        resume: Relaxation | None = None,
        relaxes: bool = True,
        watch: Callable[[], None] | None = None,
    ) -> Solution:
        """Bring the state to equilibrium under a load (n, 3) [N] of owned and halo particles. Collective.

        tolerance : of the estimated errors; reference : [N], the largest force that acts; max_iterations : of
            the relaxation; stop, resume : see `relax`; relaxes : whether relaxation is tried last;
        watch : see `Mixed`

        Raises DivergedError if no equilibrium is found, RunsAway if there is none, Paused if asked to stop.
        """
        newton, x = self.newton(load), self.state.x
        if resume is None or not resume.is_begun:
            start, resume = x.copy(order="K"), None
            for method in (self._by_newton, self._by_tensions):
                try:
                    return method(newton, tolerance, stop, watch)
                except Stopped:
                    x[:] = start
                    raise Paused(not_begun(start)) from None
                except NoConvergence:
                    x[:] = start
        else:
            start = resume.start
        if not relaxes:
            raise DivergedError(f"{name}: no equilibrium was found at once")
        return relaxed_in_turn(self, newton, tolerance, reference, max_iterations, name, stop, start, resume)

    def _has_tensions(self) -> bool:
        """Return whether the interior point method applies, which takes tensions as unknowns. Collective.

        It applies to nets of cables alone: their energy is convex, so there is one equilibrium.
        """
        return self.slips is None and not is_compressible(self.comm, self.state)

    def has_limit_load(self) -> bool:
        """Return whether `limit_load` applies: to nets of cables alone that yield. Collective."""
        return self._has_tensions() and self.state.features.plastic

    def _by_newton(self, newton: Newton, tolerance: float, stop: StopRequest, watch) -> Solution:
        """Find the equilibrium by Newton's method. Raises NoConvergence, Stopped. Collective."""
        return self.corrected(newton, tolerance, stop, quick=self._has_tensions())

    def _by_tensions(self, newton: Newton, tolerance: float, stop: StopRequest, watch) -> Solution:
        """Find the equilibrium by the interior point method, then by Newton's method. Collective.

        Raises NoConvergence, Stopped, RunsAway, and any exception that watch() raises.
        """
        if not self._has_tensions():
            raise NoConvergence("there are bars, or cables slip")
        mixed, x, solution = Mixed(newton, self.state, stop, watch=watch), self.state.x, None
        for size in NARROWED:
            start_point = mixed.narrow(size, tolerance)
            if max(mixed.missing) <= tolerance:
                break
            positions = x.copy(order="K")
            try:
                solution = self.corrected(newton, tolerance, stop, start_point)
                break
            except NoConvergence:
                x[:] = positions
        solution = solution or self._narrowed(newton, mixed.gradients, mixed.missing)
        if solution.unstable_at >= 0:
            raise NoConvergence("it is not stable: relaxation leads to one that is, if there is one")
        return solution

    def _narrowed(self, newton: Newton, gradients: int, errors: tuple[float, float]) -> Solution:
        """Return the present state of the interior point method as a `Solution`. Collective."""
        (residual,) = newton.largest(newton.residual())
        return Solution(gradients, residual, *errors, unstable_at=unstable_at(newton))

    def corrected(
        self,
        newton: Newton,
        tolerance: float,
        stop: StopRequest,
        start_point: StartPoint | None = None,
        quick: bool = False,
    ) -> Solution:
        """Find the equilibrium by Newton's method, see `Newton.find`. Raises NoConvergence, Stopped.

        Collective.
        """
        solution = newton.find(tolerance, self.state.x_start, stop, start_point, quick)
        return solution._replace(unstable_at=unstable_at(newton))

    def residual(self, load: np.ndarray) -> np.ndarray:
        """Compute the residual forces (n, 3) [N] on the free axes under a load, 0 at halo particles."""
        r = np.zeros_like(self.state.x)
        r[: self.state.n_owned] = self.newton(load).residual()
        return r

    def foresees(self, load: np.ndarray) -> bool:
        """Return whether Newton's method converges quickly under a load (n, 3) [N]. Collective.

        The positions are restored.
        """
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
        scaled_load: np.ndarray,
        strained: Callable[[], Strained],
        tolerances: tuple[float, float],
        stop: StopRequest,
        report: Callable[[float, float], None],
    ) -> tuple[LimitLoad, Solution]:
        """Bring the state to the limit load factor of one of two loads. Collective.

        load : (n, 3) [N], acts in full; scaled_load : (n, 3) [N], acts times the factor

        The other arguments are those of `work_control.limit_load`.
        """
        owned_load = scaled_load[: self.state.n_owned]
        limit = limit_load(self.newton(load), self.state, owned_load, strained, tolerances, stop, report)
        newton = self.newton(load + limit.factor * scaled_load)
        return limit, self._narrowed(newton, limit.gradients, limit.missing)

    def responses(self, load: np.ndarray) -> Callable[[np.ndarray], tuple]:
        """Return a function that computes the response to a change (m,) [m] of unstressed lengths.

        Collective.

        load : (n, 3) [N] that acts

        Calls are collective too. They return displacements (n, 3) [m] and changes of axial force (m,) [N],
        and raise NoConvergence if the tangent is singular.
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
        """Compute the changes of axial forces (m,) [N] at fixed nodes.

        change : (m,) [m] of unstressed lengths
        """
        state, K = self.state, self._tangent()
        if K.slip is not None:
            change = K.slip.of_strands(change)
        return -K.axial * (state.elements_now().L / state.L0) * change

    def newton(self, load: np.ndarray) -> Newton:
        """Set up Newton's method for the net under a load (n, 3) [N]."""
        net = net_of(self.state, load, self.slips)
        if self._structure is None:
            self._structure = Structure(cache(self._lines))
        return Newton(self.comm, self.halo, self.distribution, net, self._tangent, self._structure)

    def _lines(self) -> Lines:
        state = self.state  # initial positions, so that a resumed run has the same lines
        return lines_of(self.distribution, state.ends, state.x_start, state.free)

    def _tangent(self) -> Tangent:
        # first: unstressed lengths follow the positions
        slip = None if self.slips is None else self.slips.tangent()
        return tangent_of(self.state)._replace(slip=slip)
