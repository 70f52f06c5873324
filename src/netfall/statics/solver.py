"""Search for one static equilibrium of a net with three methods in turn.

Newton's method is tried first: it converges if the net is close to the equilibrium. If it fails, the
primal-dual interior point method with tensions as unknowns (`mixed`) follows. It converges from any start, in
nets of cables. Dynamic relaxation (`relaxation_stages`) is the last method.

The search ends when the estimated error is within the tolerance. The error has two parts: the displacement of
one more correction over the largest displacement, and its change of tension over the largest tension. So
`tolerance` means the same for any net and any refinement.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any

import numpy as np

from netfall.core.errors import DivergedError
from netfall.core.stop import NEVER_STOP, StopFlag
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.physics.elements import add_axial_forces_now, axial_forces
from netfall.physics.state import State
from netfall.statics import messages
from netfall.statics.interior_point import STEP_SIZES, InteriorPoint
from netfall.statics.limit_load import LimitUtilisation
from netfall.statics.limit_point import has_compression
from netfall.statics.multigrid.cycle import CycleStructure
from netfall.statics.multigrid.lines import Lines, distribute_lines
from netfall.statics.multigrid.tangent import Tangent, tangent_of
from netfall.statics.newton import Newton, NoConvergence, Solution, StartPoint, StopRequested
from netfall.statics.relaxation import Paused, Relaxation, initial_relaxation, net_of
from netfall.statics.relaxation_stages import relax_in_stages
from netfall.statics.slip import Slips
from netfall.statics.stability import unstable_at
from netfall.statics.work_control import LimitLoad, limit_load

# share of the residual force that may remain in a response [-]: small, since differences are used
RESPONSE_RESIDUAL = 1e-10


@dataclass
class EquilibriumFinder:
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
    _structure: CycleStructure | None = field(default=None, init=False)

    def reset_structure(self) -> None:
        """Discard the cached multigrid structure after the elements of the net have changed."""
        self._structure = None

    @contextmanager
    def without_elements(self, rows: np.ndarray) -> Iterator[None]:
        """Let the net be without some elements, local rows (k,), until the context ends."""
        EA, broken = self.state.EA[rows], self.state.broken[rows]
        self.state.EA[rows], self.state.broken[rows] = 0.0, 1  # removed, not slack
        self.reset_structure()
        try:
            yield
        finally:
            self.state.EA[rows], self.state.broken[rows] = EA, broken
            self.reset_structure()

    def find(
        self,
        load: np.ndarray,
        tolerance: float,
        reference: float,
        max_iterations: int,
        name: str,
        stop: StopFlag = NEVER_STOP,
        resume: Relaxation | None = None,
        relaxes: bool = True,
        watch: Callable[[], None] | None = None,
    ) -> Solution:
        """Bring the state to equilibrium under a load (n, 3) [N] of owned and halo particles. Collective.

        tolerance : of the estimated errors; reference : [N], the largest force that acts; max_iterations : of
            the relaxation; stop, resume : see `relax`; relaxes : whether relaxation is tried last;
        watch : see `InteriorPoint`

        Raises DivergedError if no equilibrium is found, UnboundedDisplacement if there is none, Paused if
        asked to stop.
        """
        newton, x = self.newton(load), self.state.x
        if resume is None or not resume.is_begun:
            start, resume = x.copy(order="K"), None
            for method in (self._try_newton, partial(self._try_interior_point, watch=watch)):
                try:
                    return method(newton, tolerance, stop)
                except StopRequested:
                    x[:] = start
                    raise Paused(initial_relaxation(start)) from None
                except NoConvergence:
                    x[:] = start
        else:
            assert resume.start is not None  # it has begun
            start = resume.start
        if not relaxes:
            raise DivergedError(messages.NOT_FOUND_DIRECTLY(name=name))
        return relax_in_stages(self, newton, tolerance, reference, max_iterations, name, stop, start, resume)

    def _allows_interior_point(self) -> bool:
        """Return whether the interior point method applies, which takes tensions as unknowns. Collective.

        It applies to nets of cables alone: their energy is convex, so there is one equilibrium.
        """
        return self.slips is None and not has_compression(self.comm, self.state)

    def has_limit_load(self) -> bool:
        """Return whether `limit_load` applies: to nets of cables alone that yield. Collective."""
        return self._allows_interior_point() and self.state.features.plastic

    def _try_newton(self, newton: Newton, tolerance: float, stop: StopFlag) -> Solution:
        """Find the equilibrium by Newton's method. Raises NoConvergence, StopRequested. Collective."""
        return self.find_by_newton(newton, tolerance, stop, quick=self._allows_interior_point())

    def _try_interior_point(
        self, newton: Newton, tolerance: float, stop: StopFlag, watch: Callable[[], None] | None
    ) -> Solution:
        """Find the equilibrium by the interior point method, then by Newton's method. Collective.

        Raises NoConvergence, StopRequested, UnboundedDisplacement, and any exception that watch() raises.
        """
        if not self._allows_interior_point():
            raise NoConvergence("there are bars, or cables slip")
        mixed, x, solution = InteriorPoint(newton, self.state, stop, watch=watch), self.state.x, None
        for size in STEP_SIZES:
            start_point = mixed.iterate(size, tolerance)
            if max(mixed.missing) <= tolerance:
                break
            positions = x.copy(order="K")
            try:
                solution = self.find_by_newton(newton, tolerance, stop, start_point)
                break
            except NoConvergence:
                x[:] = positions
        solution = solution or self._interior_point_solution(newton, mixed.gradients, mixed.missing)
        if solution.unstable_at >= 0:
            raise NoConvergence("the equilibrium is unstable; relaxation may find a stable one")
        return solution

    def _interior_point_solution(
        self, newton: Newton, gradients: int, errors: tuple[float, float]
    ) -> Solution:
        """Return the present state of the interior point method as a `Solution`. Collective."""
        (residual,) = newton.largest(newton.residual())
        return Solution(gradients, residual, *errors, unstable_at=unstable_at(newton))

    def find_by_newton(
        self,
        newton: Newton,
        tolerance: float,
        stop: StopFlag,
        start_point: StartPoint | None = None,
        quick: bool = False,
    ) -> Solution:
        """Find the equilibrium by Newton's method, see `Newton.find`. Raises NoConvergence, StopRequested.

        Collective.
        """
        solution = newton.find(tolerance, self.state.x_start, stop, start_point, quick)
        return solution._replace(unstable_at=unstable_at(newton))

    def residual(self, load: np.ndarray) -> np.ndarray:
        """Compute the residual forces (n, 3) [N] on the free axes under a load, 0 at halo particles."""
        r = np.zeros_like(self.state.x)
        r[: self.state.n_owned] = self.newton(load).residual()
        return r

    def converges_quickly(self, load: np.ndarray) -> bool:
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
        strained: Callable[[], LimitUtilisation],
        tolerances: tuple[float, float],
        stop: StopFlag,
        report: Callable[[float, float], None],
    ) -> tuple[LimitLoad, Solution]:
        """Bring the state to the limit load factor of one of two loads. Collective.

        load : (n, 3) [N], acts in full; scaled_load : (n, 3) [N], acts times the factor

        The other arguments are those of `work_control.limit_load`.
        """
        owned_load = scaled_load[: self.state.n_owned]
        limit = limit_load(self.newton(load), self.state, owned_load, strained, tolerances, stop, report)
        newton = self.newton(load + limit.factor * scaled_load)
        return limit, self._interior_point_solution(newton, limit.gradients, limit.missing)

    def responses(self, load: np.ndarray) -> Callable[[np.ndarray], tuple[Any, ...]]:
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

        def respond(change: Any) -> Any:
            fixed = self.fixed_node_response(change)
            newton.f[:] = 0.0
            add_axial_forces_now(state.x, state.ends, fixed, state.present_element_state().L, newton.f)
            r = newton.without_held(newton.f[newton.owned])
            s, _ = newton.solve(K, cycle, r, RESPONSE_RESIDUAL)
            newton.set_displacement(s)
            axial = np.empty(len(change))
            axial_forces(newton.spread, state.ends, K.direction, K.axial, axial)
            if K.slip is not None:
                K.slip.add_changes(newton.spread, axial)
            return newton.spread, fixed + axial

        return respond

    def fixed_node_response(self, change: np.ndarray) -> np.ndarray:
        """Compute the changes of axial forces (m,) [N] at fixed nodes.

        change : (m,) [m] of unstressed lengths
        """
        state, K = self.state, self._tangent()
        if K.slip is not None:
            change = K.slip.length_changes(change)
        return -K.axial * (state.present_element_state().L / state.L0) * change

    def newton(self, load: np.ndarray) -> Newton:
        """Set up Newton's method for the net under a load (n, 3) [N]."""
        net = net_of(self.state, load, self.slips)
        if self._structure is None:
            self._structure = CycleStructure(cache(self._lines))
        return Newton(self.comm, self.halo, self.distribution, net, self._tangent, self._structure)

    def _lines(self) -> Lines:
        state = self.state  # initial positions, so that a resumed run has the same lines
        return distribute_lines(self.distribution, state.ends, state.x_start, state.free)

    def _tangent(self) -> Tangent:
        # first: unstressed lengths follow the positions
        slip = None if self.slips is None else self.slips.tangent()
        return tangent_of(self.state)._replace(slip=slip)
