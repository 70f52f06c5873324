"""Limit load factor of a net of cables by work control.

Close to the limit load a small increment of load moves the net far, and above it there is no equilibrium. So
each trial prescribes the work of the load instead: force times displacement, over all particles. An
equilibrium exists for any work, because the energy of cables is convex in the positions. The load factor is
one more unknown. The utilisation of the net grows nearly in proportion to the work, so few trials suffice.
The load hardly changes between the last of them.
"""

from collections.abc import Callable

import numpy as np

from netfall.core.timings import StopFlag
from netfall.physics.state import State
from netfall.statics.bounds import MOST_STEPS
from netfall.statics.interior_point import STEP_SIZES, InteriorPoint
from netfall.statics.limit_load import (
    NO_UTILISATION,
    UNLOADED,
    LimitUtilisation,
    Trial,
    search_limit,
)
from netfall.statics.multigrid.cycle import VCycle
from netfall.statics.multigrid.tangent import Tangent
from netfall.statics.newton import Newton, NoConvergence


class WorkControl:
    """Work control of a load (n_owned, 3) [N] that acts in addition to the load of the net.

    The displacements count from the positions at construction.
    factor : load factor; target : prescribed work [J] of the load with factor 1
    """

    def __init__(self, newton: Newton, load: np.ndarray):
        self.newton, self.load = newton, newton.without_held(load)
        self.start = newton.net.x[newton.owned].copy()
        self.factor = self.target = 0.0

    def work(self) -> float:
        """Compute the work [J] of the load with factor 1 at the present positions. Collective."""
        (work,) = self.newton.inner_products((self.load, self.newton.net.x[self.newton.owned] - self.start))
        return work

    def solve(self, K: Tangent, cycle: VCycle, r: np.ndarray) -> tuple[np.ndarray, float, int]:
        """Return the correction (n_owned, 3) [m], the change of `factor`, and the iterations. Collective.

        r : residual without the load

        A first correction brings the work to `target`. Conjugate gradients then search among displacements in
        which the load does no work (Gould, Hribar, Nocedal 2001). Raises as `Newton.solve`.
        """
        newton, load, factor_change = self.newton, self.load, 0.0
        response = newton.without_held(cycle(load))
        (compliance,) = newton.inner_products((load, response))

        def without_work(rows: np.ndarray) -> np.ndarray:
            """Apply the cycle and remove the work of the load from the result.

            Subtracts the same multiple of the load from `rows`, in place. The cycle rounds to single
            precision, so a large multiple hides the rest of `rows`. Then the cycle is applied to the rest.
            """
            nonlocal factor_change
            for _ in range(2):
                z = newton.without_held(cycle(rows))
                work, energy = newton.inner_products((load, z), (rows, z))
                excess = work / compliance
                rows -= excess * load
                z -= excess * response
                factor_change -= excess
                if energy - excess * work > np.finfo(np.float32).eps * energy:
                    break
            return z

        to_target = (self.target - self.work()) / compliance * response
        r = r + self.factor * load - newton.stiffness_times(K, to_target)
        s, count = newton.solve(K, without_work, r)
        return to_target + s, factor_change, count


def limit_load(
    newton: Newton,
    state: State,
    load: np.ndarray,
    strained: Callable[[], LimitUtilisation],
    tolerances: tuple[float, float],
    stop: StopFlag,
    report: Callable[[float, float], None],
) -> tuple[float, LimitUtilisation, InteriorPoint]:
    """Bring the net to the limit load factor of a load (n_owned, 3) [N], within `BRACKET_WIDTH`. Collective.

    newton : of the loads that act in addition; strained() : returns the utilisation of the net;
    tolerances : of the errors, during the search and at its end; report(low, high) : receives the factors
        that bracket the limit

    Returns the factor, 1: the whole load is carried; the utilisation slightly above it, `NO_UTILISATION` if
    the whole load is carried; and the method in the state at the limit. Raises NoConvergence, StopRequested.
    """
    newton.begin()
    control, best_positions = WorkControl(newton, load), state.x.copy(order="K")
    _start_near_limit(newton, state, control, strained)
    first = control.work()
    interior_point = InteriorPoint(newton, state, stop, control)

    def trial(target: float) -> Trial:
        if target != first:
            interior_point.restart_near_equilibrium()
        control.target = target
        interior_point.iterate(STEP_SIZES[0], tolerances[0])
        result = Trial(target, control.factor, strained())
        if not result.utilisation.reason:
            best_positions[:] = state.x
        return result

    low, high, beyond = UNLOADED, trial(first), NO_UTILISATION
    for _ in range(MOST_STEPS):
        if high.utilisation.reason or high.factor >= 1.0:
            break
        low, high = high, trial(2.0 * high.at)
    else:
        raise NoConvergence("no work reaches the limit")
    if high.utilisation.reason:
        low, high = search_limit(trial, low, high, report)
        beyond = NO_UTILISATION if low.factor >= 1.0 else high.utilisation
    else:
        low = high
    state.x[:], control.target, control.factor = best_positions, low.at, low.factor
    if beyond is not NO_UTILISATION:
        interior_point.restart_near_equilibrium()
        try:
            interior_point.iterate(0.0, tolerances[1])
        except NoConvergence:  # the estimated errors decide
            if max(interior_point.errors) > tolerances[0]:
                raise
    return control.factor, beyond, interior_point


def _start_near_limit(
    newton: Newton, state: State, control: WorkControl, strained: Callable[[], LimitUtilisation]
) -> None:
    """Move the net along its linear response to the load, to within a factor of 2 of its limit.

    Raises NoConvergence if no displacement of that shape brackets the limit.
    """
    K, x = newton.tangent(), state.x.copy(order="K")
    shape, _ = newton.solve(K, newton.cycle(K), control.load)
    newton.set_displacement(shape)
    (largest,) = newton.largest(newton.u)
    if largest == 0.0:
        raise NoConvergence("the load moves nothing")
    shape, scale = newton.extent / largest * newton.u, 1.0
    state.x[:] = x + shape
    factor = 0.5 if strained().reason else 2.0
    for _ in range(MOST_STEPS):
        scale *= factor
        state.x[:] = x + scale * shape
        if bool(strained().reason) == (factor > 1.0):
            return
    raise NoConvergence("no displacements of this shape are near the limit")
