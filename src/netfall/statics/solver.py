"""Search for one static equilibrium of a net with three methods in turn.

Newton's method is tried first: it converges if the net is close to the equilibrium. If it fails, the
primal-dual interior point method with tensions as unknowns follows. It converges from any start, in nets of
cables. Dynamic relaxation is the last method: it goes to decreasing residuals, and Newton's method is tried
after each of them.

The search ends when the estimated error is within the tolerance. The error has two parts: the displacement of
one more correction over the largest displacement, and its change of tension over the largest tension. So
`tolerance` means the same for any net and any refinement. The tangent may give no estimate, because
compressed bars buckle or part of the net is a mechanism. Then the net is relaxed to a tenth of the residual,
repeatedly, until the state no longer changes.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

from netfall.core.errors import DivergedError
from netfall.core.messages import kN
from netfall.core.timings import NEVER_STOP, StopFlag
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.physics.elements import add_axial_forces, axial_forces
from netfall.physics.state import State
from netfall.statics import messages
from netfall.statics.bounds import MAX_DECADES, NEGLIGIBLE
from netfall.statics.interior_point import STEP_SIZES, InteriorPoint
from netfall.statics.limit_point import has_compression
from netfall.statics.multigrid.cycle import CycleStructure
from netfall.statics.multigrid.lines import Lines, distribute_lines
from netfall.statics.multigrid.tangent import Tangent, tangent_of
from netfall.statics.newton import MANY_ITERATIONS, NEAR_TOLERANCE, Newton, NoConvergence, Solution
from netfall.statics.relaxation import relax, static_net
from netfall.statics.slip import Slips

# residuals over the largest force [-], after which Newton's method is tried
STAGE_RESIDUALS = (1e-2, 1e-3, 1e-4, 1e-5)
EXTRA_ITERATIONS = 1000  # iterations allowed for each of these, in addition to the number taken before


class Criterion(NamedTuple):
    """Condition that ends a search for an equilibrium: its accuracy, or too many iterations.

    tolerance : of the estimated errors; reference : [N], the largest force that acts
    max_iterations : of the relaxation; name : of the load, in messages
    """

    tolerance: float
    reference: float
    max_iterations: int
    name: str


def _lines_of(distribution: Distribution, state: State) -> Lines:
    """Return the lines of a net from its initial positions, which are the same in a resumed run."""
    return distribute_lines(distribution, state.ends, state.x_start, state.free)


@dataclass
class EquilibriumFinder:
    """Search for equilibria of one state.

    slips : cables that slide over nodes, None: there are none
    report(text) : receives a line of text about the progress
    """

    comm: MPI.Comm
    halo: Halo
    distribution: Distribution
    state: State
    slips: Slips | None = None
    report: Callable[[str], None] = field(default_factory=lambda: lambda text: None, init=False)
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

    def find(self, load: np.ndarray, criterion: Criterion, stop: StopFlag = NEVER_STOP) -> Solution:
        """Bring the state to equilibrium under a load (n, 3) [N] of owned and halo particles. Collective.

        Raises DivergedError if no equilibrium is found, UnboundedDisplacement if there is none,
        StopRequested if the stop flag is set.
        """
        newton, x = self.newton(load), self.state.x
        start = x.copy(order="K")
        try:
            return self._find_directly(newton, criterion.tolerance, stop)
        except NoConvergence:
            x[:] = start
        return self._relax(newton, criterion, stop, start)

    def _allows_interior_point(self) -> bool:
        """Return whether the interior point method applies, which takes tensions as unknowns. Collective.

        It applies to nets of cables alone: their energy is convex, so there is one equilibrium.
        """
        return self.slips is None and not has_compression(self.comm, self.state)

    def _find_directly(self, newton: Newton, tolerance: float, stop: StopFlag) -> Solution:
        """Find the equilibrium by Newton's method, otherwise by the interior point method. Collective.

        The latter's last correction is one of Newton's method if that converges. Raises NoConvergence,
        StopRequested, UnboundedDisplacement.
        """
        state, x = self.state, self.state.x
        start, has_second = x.copy(order="K"), self._allows_interior_point()
        try:
            return newton.find(tolerance, state.x_start, stop, quick=has_second)
        except NoConvergence:
            if not has_second:
                raise
        x[:] = start
        interior_point, solution = InteriorPoint(newton, state, stop), None
        for size in STEP_SIZES:
            before = interior_point.iterate(size, tolerance)
            if max(interior_point.errors) <= tolerance:
                break
            positions = x.copy(order="K")
            try:
                solution = newton.find(tolerance, state.x_start, stop, before)
                break
            except NoConvergence:
                x[:] = positions
        solution = solution or newton.solution(interior_point.gradients, interior_point.errors)
        if solution.unstable_at >= 0:
            raise NoConvergence("the equilibrium is unstable; relaxation may find a stable one")
        return solution

    def _relax(
        self,
        newton: Newton,
        criterion: Criterion,
        stop: StopFlag,
        start: np.ndarray,
    ) -> Solution:
        """Relax the state to equilibrium. Collective.

        start : positions (n, 3) [m] from which the equilibrium is sought; the others are those of `find`

        Raises DivergedError if the iterations run out, UnboundedDisplacement, StopRequested.
        """
        state, (tolerance, reference, most, name) = self.state, criterion
        final_residual = tolerance * reference
        residuals = [share * reference for share in STAGE_RESIDUALS if share > tolerance]
        residuals += [final_residual / 10.0**k for k in range(MAX_DECADES)]
        total, positions, tensions, solution = 0, start, None, None
        for goal in residuals:

            def report(_: int, residual: float, goal: float = goal) -> None:
                self.report(f"{name}: relaxing, residual {kN(residual)} of {kN(goal)}")

            allowed = min(most, EXTRA_ITERATIONS + total) if solution else most
            try:
                iterations, residual = relax(self.halo, newton.net, goal, allowed, name, report, stop)
            except DivergedError:
                if solution is None:
                    raise
                state.x[:] = positions
                break
            if solution and not iterations:  # the state has not changed
                continue
            before, positions, total = positions, state.x.copy(order="K"), total + iterations
            try:
                return newton.find(tolerance, state.x_start, NEVER_STOP, (total, np.inf))
            except NoConvergence:
                state.x[:] = positions
            if goal <= final_residual:
                N, errors = state.present_element_state().N, (np.nan, np.nan)
                try:
                    newton.begin()
                    K = newton.tangent()
                    s, _ = newton.solve(K, newton.cycle(K), newton.residual())
                    errors = newton.step_sizes(K, s, state.x_start)[:2]
                except NoConvergence:
                    if tensions is not None:  # the change since ten times the residual
                        moved, distance = ((state.x - x)[newton.owned] for x in (before, state.x_start))
                        errors = newton.relative_changes(moved, distance, N - tensions, N)
                solution = Solution(total, residual, *errors, True, newton.unstable_at())
                tensions = N
                if solution.error <= tolerance:
                    break
        assert solution is not None  # the last stage sets it
        error = solution.error
        allowed_error = NEAR_TOLERANCE * max(tolerance, newton.rounding(newton.tangent()))
        # the last residual suffices: if a net hardly moves, its relative error is meaningless
        if not (error <= allowed_error or solution.residual <= residuals[-1]):
            message = messages.ERROR_UNKNOWN if np.isnan(error) else messages.ERROR_TOO_LARGE
            raise DivergedError(
                message(
                    name=name,
                    iterations=solution.iterations,
                    residual=solution.residual,
                    error=error,
                    tolerance=tolerance,
                )
            )
        return solution

    def residual(self, load: np.ndarray) -> np.ndarray:
        """Compute the residual forces (n, 3) [N] on the free axes under a load, 0 at halo particles."""
        r = np.zeros_like(self.state.x)
        r[: self.state.n_owned] = self.newton(load).residual()
        return r

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
            add_axial_forces(state.x, state.ends, fixed, state.present_element_state().L, newton.f)
            r = newton.without_held(newton.f[newton.owned])
            s, _ = newton.solve(K, cycle, r, NEGLIGIBLE)  # small, since differences are used
            newton.set_displacement(s)
            axial = axial_forces(newton.u, state.ends, K.direction, K.axial)
            if K.slip is not None:
                K.slip.add_changes(newton.u, axial)
            return newton.u, fixed + axial

        return respond

    def fixed_node_response(self, change: np.ndarray) -> np.ndarray:
        """Compute the changes of axial forces (m,) [N] at fixed nodes.

        change : (m,) [m] of unstressed lengths
        """
        state, K = self.state, self._tangent()
        if K.slip is not None:
            change = K.slip.length_changes(change)
        return -K.axial * (state.present_element_state().L / state.L0) * change

    def settle_slips(self) -> None:
        """Let slips follow the present positions, with resistances that fit them. Collective."""
        if self.slips is not None:
            self.slips.begin()
            for _ in range(MANY_ITERATIONS):
                self.slips.follow()
                change, tension = self.slips.update_resistances()
                if change <= NEGLIGIBLE * tension:
                    break

    def newton(self, load: np.ndarray) -> Newton:
        """Set up Newton's method for the net under a load (n, 3) [N]."""
        net = static_net(self.state, load, self.slips)
        if self._structure is None:
            self._structure = CycleStructure(cache(partial(_lines_of, self.distribution, self.state)))
        return Newton(self.comm, self.halo, self.distribution, net, self._tangent, self._structure)

    def _tangent(self) -> Tangent:
        # first: unstressed lengths follow the positions
        slip = None if self.slips is None else self.slips.tangent()
        return tangent_of(self.state)._replace(slip=slip)
