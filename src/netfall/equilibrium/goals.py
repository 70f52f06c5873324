"""Dynamic relaxation to one residual after another, with Newton's method tried from each of them.

A relaxation has reached its residual when the estimated errors are within the tolerance. If the tangent gives
no estimate (compressed bars buckle, a mechanism hangs), the net is relaxed to a tenth of the residual, and
again, until that changes no more.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from netfall.equilibrium.newton import Newton, NoConvergence, StartPoint
from netfall.equilibrium.relaxation import Paused, Relaxation, not_begun, relax
from netfall.ground.errors import DivergedError
from netfall.ground.stop import StopRequest

NEARER = (1e-2, 1e-3, 1e-4, 1e-5)  # of the largest force: residuals after which Newton's is tried once more
TIGHTER = 10.0  # times: what the relaxation is asked more of, where its error is too large
MOST_AGAIN = 6  # times
AGAIN = 1000  # iterations and as many as it has taken so far: what each of these may take
NEARLY = 10.0  # times the tolerance: the largest error of what relaxation alone has found
ROUNDING = 1e-13  # of the largest force: residuals below that are rounding


@dataclass
class Goals:
    """The residuals to which one equilibrium is relaxed in turn.

    finder : `find.Finder`; tolerance, reference, what, stop : as of `Finder.find`
    start : positions (n, 3) [m] from which the equilibrium is sought; patient : whether no correction is too
    dear; first : number of the residual to begin with, from 0
    """

    finder: Any
    newton: Newton
    tolerance: float
    reference: float
    what: str
    stop: StopRequest
    start: np.ndarray
    patient: bool = True
    first: int = 0

    def __post_init__(self):
        self.asked = self.tolerance * self.reference
        self.residuals = [*(share * self.reference for share in NEARER if share > self.tolerance), self.asked]
        self.residuals += [
            max(self.asked / TIGHTER**k, ROUNDING * self.reference) for k in range(1, MOST_AGAIN)
        ]
        self.first = min(self.first, len(self.residuals) - 1)
        # Near a limit load the tangent of what yields is singular, and tells no error in the search for it.
        self.strict = self.patient or not self.finder.state.features.plastic

    def relax(self, most: int, resume: Relaxation | None = None, begun: int = 0, in_all: bool = False):
        """The `Solution`, and the state in it. Collective.

        most : iterations for each residual, or for all of them if in_all; resume : as of `relaxation.relax`
        begun : added to the numbers of the residuals in a `Relaxation`

        Raises DivergedError if the iterations run out, RunsAway, Paused.
        """
        finder, state, newton = self.finder, self.finder.state, self.newton
        first, total = (resume.stage - begun, resume.total) if resume else (self.first, 0)
        before, found, last, enough = self.start, None, None, None
        for stage in range(first, len(self.residuals)):
            finder.goal, goal = stage + 1, self.residuals[stage]
            left = most - total if in_all else most
            try:
                iterations, residual = relax(
                    finder.comm,
                    finder.halo,
                    newton.net,
                    goal,
                    min(left, AGAIN + total) if found else left,
                    self.what,
                    lambda i, r, g=goal: finder.report(
                        f"{self.what}: relaxing, residual {r:.2g} N of {g:.2g} N"
                    ),
                    stop=self.stop,
                    resume=resume,
                )
            except Paused as pause:
                pause.at.stage, pause.at.total = stage + begun, total
                pause.at = enough or pause.at  # from where the same follows
                pause.at.start = self.start
                raise
            except DivergedError:
                if found is None or (self.strict and in_all and AGAIN + total > left):
                    raise
                state.x[:] = before
                break
            if found and not iterations:  # nothing has changed
                continue
            total, resume, before = total + iterations, None, state.x.copy(order="K")
            try:
                if not self.patient and iterations == 0 and goal > self.asked:
                    raise NoConvergence("it was not from here")
                return finder.corrected_from(newton, self.tolerance, StartPoint(total), self.patient)
            except NoConvergence:
                state.x[:] = before
            if goal <= self.asked:
                found = finder.relaxed(newton, total, residual, last)
                last = before, state.elements_now().N
                if found.error <= self.tolerance:
                    break
                enough = enough or replace(not_begun(before), stage=stage + begun, total=total)
        least = self.newton.rounding(self.newton.tangent())
        allowed = (1.0 if in_all else NEARLY) * max(self.tolerance, least)
        # The smallest residual is enough: of a net that hardly moves the relative error says nothing.
        if self.strict and not (found.error <= allowed or found.residual <= self.residuals[-1]):
            known = (
                f"an estimated error of {found.error:.1g}" if found.error == found.error else "no known error"
            )
            raise DivergedError(
                f"{self.what}: {total} iterations of relaxation led to a residual of {found.residual:.3g} N "
                f"with {known}, tolerance {self.tolerance:.3g}"
            )
        return found
