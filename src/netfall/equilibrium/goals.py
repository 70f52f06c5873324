"""Dynamic relaxation to one residual after another, with Newton's method tried from each of them.

A relaxation has reached its residual when the estimated errors are within the tolerance. If the tangent gives
no estimate (compressed bars buckle, a mechanism hangs), the net is relaxed to a tenth of the residual, and
again, until that changes no more.
"""

from dataclasses import replace

import numpy as np

from netfall.equilibrium.newton import NEARLY, Newton, NoConvergence, Solution, StartPoint
from netfall.equilibrium.relaxation import Paused, Relaxation, not_begun, relax
from netfall.equilibrium.stable import unstable_at
from netfall.ground.errors import DivergedError
from netfall.ground.stop import NEVER, StopRequest
from netfall.mechanics.state import State

NEARER = (1e-2, 1e-3, 1e-4, 1e-5)  # residuals over the largest force, after which Newton's method is tried
MOST_AGAIN = 6  # residuals below, each a tenth of the one before, where no tangent tells an error
AGAIN = 1000  # iterations that each of these may take, beside as many as were taken before


def relaxed_in_turn(
    finder,
    newton: Newton,
    tolerance: float,
    reference: float,
    most: int,
    what: str,
    stop: StopRequest,
    start: np.ndarray,
    resume: Relaxation | None,
) -> Solution:
    """Relax the state of a `find.Finder` to equilibrium; the `Solution`. Collective.

    start : positions (n, 3) [m] from which the equilibrium is sought; the others as of `Finder.find`

    Raises DivergedError if the iterations run out, RunsAway, Paused.
    """
    state, asked = finder.state, tolerance * reference
    residuals = [share * reference for share in NEARER if share > tolerance]
    residuals += [asked / 10.0**k for k in range(MOST_AGAIN)]
    first, total = (resume.stage, resume.total) if resume else (0, 0)
    before, found, last, enough = start, None, None, None
    for stage in range(first, len(residuals)):
        goal = residuals[stage]
        report = lambda i, r, g=goal: finder.report(f"{what}: relaxing, residual {r:.2g} N of {g:.2g} N")
        few = min(most, AGAIN + total) if found else most
        try:
            net = newton.net
            iterations, residual = relax(finder.comm, finder.halo, net, goal, few, what, report, stop, resume)
        except Paused as pause:
            pause.at.stage, pause.at.total = stage, total
            pause.at = enough or pause.at  # from where the same follows
            pause.at.start = start
            raise
        except DivergedError:
            if found is None:
                raise
            state.x[:] = before
            break
        if found and not iterations:  # nothing has changed
            continue
        total, resume, before = total + iterations, None, state.x.copy(order="K")
        try:
            return finder.corrected(newton, tolerance, NEVER, StartPoint(total))
        except NoConvergence:
            state.x[:] = before
        if goal <= asked:
            found = Solution(total, residual, *_errors(newton, state, last), True, unstable_at(newton))
            last = before, state.elements_now().N
            if found.error <= tolerance:
                break
            enough = enough or replace(not_begun(before), stage=stage, total=total)
    _check_error(newton, found, tolerance, residuals[-1], what)
    return found


def _errors(newton: Newton, state: State, last: tuple | None) -> tuple[float, float]:
    """Estimated errors of what relaxation has reached. Collective.

    last : positions (n, 3) [m] and axial forces (m,) [N] of ten times the residual, None: not known
    """
    try:
        return newton.errors(state.x_start)
    except NoConvergence:
        return newton.changes(*last, state) if last else (np.nan, np.nan)


def _check_error(newton: Newton, found: Solution, tolerance: float, least: float, what: str) -> None:
    """Raise DivergedError where the error of what was found is too large, or not known. Collective.

    least : residual [N] that is enough: of a net that hardly moves the relative error says nothing
    """
    allowed = NEARLY * max(tolerance, newton.rounding(newton.tangent()))
    if not (found.error <= allowed or found.residual <= least):
        known = f"an estimated error of {found.error:.1g}" if found.error == found.error else "no known error"
        raise DivergedError(
            f"{what}: {found.iterations} iterations of relaxation led to a residual of "
            f"{found.residual:.3g} N with {known}, tolerance {tolerance:.3g}"
        )
