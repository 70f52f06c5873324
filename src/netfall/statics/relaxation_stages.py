"""Dynamic relaxation to decreasing residuals, with Newton's method tried after each of them.

The search ends when the estimated errors are within the tolerance. The tangent may give no estimate, because
compressed bars buckle or part of the net is a mechanism. Then the net is relaxed to a tenth of the residual,
repeatedly, until the state no longer changes.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from netfall.core.errors import DivergedError
from netfall.core.message import kN
from netfall.core.stop import NEVER_STOP, StopFlag
from netfall.physics.state import State
from netfall.statics import messages
from netfall.statics.newton import NEARLY, Newton, NoConvergence, Solution, StartPoint
from netfall.statics.relaxation import Paused, Relaxation, initial_relaxation, relax
from netfall.statics.stability import unstable_at

# residuals over the largest force [-], after which Newton's method is tried
STAGE_RESIDUALS = (1e-2, 1e-3, 1e-4, 1e-5)
MAX_EXTRA_STAGES = 6  # further residuals, each a tenth of the one before, if no tangent estimates the error
EXTRA_ITERATIONS = 1000  # iterations allowed for each of these, in addition to the number taken before


def relax_in_stages(
    finder: Any,
    newton: Newton,
    tolerance: float,
    reference: float,
    max_iterations: int,
    name: str,
    stop: StopFlag,
    start: np.ndarray,
    resume: Relaxation | None,
) -> Solution:
    """Relax the state of a `solver.EquilibriumFinder` to equilibrium and return the `Solution`. Collective.

    start : positions (n, 3) [m] from which the equilibrium is sought
    The other arguments are those of `EquilibriumFinder.find`.

    Raises DivergedError if the iterations run out, UnboundedDisplacement, Paused.
    """
    state, final_residual = finder.state, tolerance * reference
    residuals = [share * reference for share in STAGE_RESIDUALS if share > tolerance]
    residuals += [final_residual / 10.0**k for k in range(MAX_EXTRA_STAGES)]
    first, total = (resume.stage, resume.total) if resume else (0, 0)
    positions, solution, previous, resume_point = start, None, None, None
    for stage in range(first, len(residuals)):
        goal = residuals[stage]

        def report(_: int, residual: float, goal: float = goal) -> None:
            finder.report(f"{name}: relaxing, residual {kN(residual)} of {kN(goal)}")

        allowed = min(max_iterations, EXTRA_ITERATIONS + total) if solution else max_iterations
        try:
            net = newton.net
            iterations, residual = relax(
                finder.comm, finder.halo, net, goal, allowed, name, report, stop, resume
            )
        except Paused as pause:
            # The run resumed at `resume_point` takes the same path.
            at = resume_point or replace(pause.at, stage=stage, total=total)
            raise Paused(replace(at, start=start)) from None
        except DivergedError:
            if solution is None:
                raise
            state.x[:] = positions
            break
        if solution and not iterations:  # the state has not changed
            continue
        total, resume, positions = total + iterations, None, state.x.copy(order="K")
        try:
            return finder.find_by_newton(newton, tolerance, NEVER_STOP, StartPoint(total))
        except NoConvergence:
            state.x[:] = positions
        if goal <= final_residual:
            solution = Solution(total, residual, *_errors(newton, state, previous), True, unstable_at(newton))
            previous = positions, state.present_element_state().N
            if solution.error <= tolerance:
                break
            resume_point = resume_point or replace(initial_relaxation(positions), stage=stage, total=total)
    assert solution is not None  # the last stage sets it
    _check_error(newton, solution, tolerance, residuals[-1], name)
    return solution


def _errors(
    newton: Newton, state: State, previous: tuple[np.ndarray, np.ndarray] | None
) -> tuple[float, float]:
    """Estimate the errors of the relaxed state. Collective.

    previous : positions (n, 3) [m] and axial forces (m,) [N] at ten times the residual, None: not known
    """
    try:
        return newton.errors(state.x_start)
    except NoConvergence:
        return newton.changes(*previous, state) if previous else (np.nan, np.nan)


def _check_error(
    newton: Newton, solution: Solution, tolerance: float, sufficient_residual: float, name: str
) -> None:
    """Raise DivergedError if the error of a solution is too large or not known. Collective.

    sufficient_residual : [N] that suffices: if a net hardly moves, its relative error is meaningless
    """
    allowed = NEARLY * max(tolerance, newton.rounding(newton.tangent()))
    if not (solution.error <= allowed or solution.residual <= sufficient_residual):
        message = messages.ERROR_UNKNOWN if np.isnan(solution.error) else messages.ERROR_TOO_LARGE
        raise DivergedError(
            message(
                name=name,
                iterations=solution.iterations,
                residual=solution.residual,
                error=solution.error,
                tolerance=tolerance,
            )
        )
