"""The equilibrium of cables by an interior point method, from any start: slack, soft, yielding.

The energy of cables is convex in the positions, and its least value a second-order cone program; see
`equilibrium.cones`. All inequalities are kept with a gap that is made smaller step by step, each a correction
by a tangent that is always positive, predicted and corrected (Mehrotra 1992; Andersen, Roos, Terlaky 2003).
The number of steps hardly grows with the net, and nothing is to be known of what goes slack or yields.
"""

import numpy as np
from mpi4py import MPI

from netfall.equilibrium.cones import (
    STRETCHED,
    add_pulls,
    aim_cones,
    begin_cones,
    cables_of,
    change_cones,
    correct_cones,
    gaps_of_cones,
    scale_cones,
)
from netfall.equilibrium.newton import Newton, NoConvergence, StartPoint, Stopped, still_missing
from netfall.equilibrium.relaxation import RunsAway
from netfall.ground.stop import StopRequest
from netfall.mechanics.state import State
from netfall.parallel.sums import exact_sums

MOST_STEPS = 100
WIDE = 100.0  # times the energy of an element: the gap to begin with; too narrow a one takes more steps
FORESEEN, LEFT = 0.3, 0.1  # of the residual, that the first and the second solution of a step leave
MANY = 8  # iterations for that; another approximate inverse is then cheaper
LEAST_SHARE = 1e-4  # of the gap: aimed at
NEARLY = 0.95, 0.999  # of the way until an inequality no longer holds: at least, at most
LOST = 1e3  # times as far as `overload.run_away` has it: there is no equilibrium
WHOLE = 0.5  # of a step: enough of it has been gone to be near to equilibrium


class Interior:
    """The elements on the way; gap : mean of all products [J]; gradients : iterations until now.

    size : of the last step, the larger share as of `NewtonResult`; missing : estimated errors after it, as of
        that, since steps become smaller at a rate that stays
    """

    def __init__(self, newton: Newton, state: State, stop: StopRequest):
        """Begin where the net is. Collective. Raises NoConvergence where this is no way for the net."""
        self.newton, self.state, self.stop = newton, state, stop
        self.cables = cables_of(state)
        owned, m = newton.distribution.subdomain.element_owned, state.m
        self.owned = np.flatnonzero(owned & (self.cables.carries == 1))
        count = len(self.owned) + np.count_nonzero(np.isfinite(self.cables.limit[self.owned]))
        self.count = newton.comm.allreduce(count)
        if not self.count:
            raise NoConvergence("there are no cables")
        self.now, self.at, self.more, self.aimed = (np.zeros((m, k)) for k in (6, 5, 5, 5))
        self.change, self.products = np.zeros((m, 9)), np.zeros((m, 2))
        self.gradients, self.steps, self.cycle = 0, 0, None
        self.size, self.missing = np.inf, (np.inf, np.inf)
        self.now[:, 1] = np.maximum(state.elements_now().N, STRETCHED * state.EA)
        self.gap = WIDE * self.energy()
        begin_cones(state.x, self.cables, self.gap, self.now)

    def narrow(self, gap: float, tolerance: float) -> StartPoint:
        """Move the net until the gap, a share of the mean energy, or what is missing is so small. Collective.

        Raises NoConvergence, Stopped, RunsAway.
        """
        self.newton.begin()
        while not self.step() or (self.gap > gap * self.energy() and max(self.missing) > tolerance):
            if self.steps >= MOST_STEPS:
                raise NoConvergence(f"{MOST_STEPS} steps were not enough")
        return StartPoint(self.gradients, self.size)

    def errors(self) -> tuple[float, float]:
        """`missing`, and that tensions are not yet those of the law at the positions. Collective."""
        N, own = self.state.elements_now().N, self.owned
        off, most = self.newton.largest(N[own] - self.now[own, 1], N[own])
        return self.missing[0], max(self.missing[1], off / most if most > 0.0 else 0.0)

    def energy(self) -> float:
        """Mean energy [J] of an element at its tension. Collective."""
        N, EA, L0 = (each[self.owned] for each in (self.now[:, 1], self.state.EA, self.state.L0))
        return exact_sums(self.newton.comm, 0.5 * N * N / EA * L0)[0] / self.count

    def step(self) -> bool:
        """One step; whether most of it has been gone. Collective. Raises as `narrow`."""
        newton, x, cables = self.newton, self.state.x, self.cables
        if newton.comm.allreduce(int(self.stop.wanted), MPI.MAX):
            raise Stopped
        K, law = self._tangent()
        self.more[:] = 0.0
        s = self._solve(K, self._residual(law, 0.0), FORESEEN)
        left = (1.0 - min(1.0, self._changes(K, s, 0.0))) ** 2
        gap = max(left, LEAST_SHARE) * self.gap
        correct_cones(cables, self.now, self.at, self.change, self.more)
        s += self._solve(K, self._residual(law, gap) - newton.stiffness_times(K, s), LEFT)
        sizes = newton.sizes(K, s, self.state.x_start)[:2]
        far = min(1.0, min(max(NEARLY[0], 1.0 - left), NEARLY[1]) * self._changes(K, s, gap))
        x += far * newton.spread
        self.now += far * self.change[:, :6]
        gaps_of_cones(x, cables, self.now, self.products)
        if newton.net.away is not None and newton.net.away(newton.comm) > LOST:
            raise RunsAway("what yields stretches without end")
        self.gap = sum(exact_sums(newton.comm, *self.products[self.owned].T.copy())) / self.count
        self.missing = still_missing(sizes, far, self.size)
        self.size, self.steps = max(sizes), self.steps + 1
        return far > WHOLE

    def _tangent(self):
        """The tangent, and pulls (m, 3) [N] of the law at the positions. Collective."""
        K = self.newton.tangent()
        law = K.N[:, None] * K.direction
        arrays = K.direction, K.axial, K.across
        scale_cones(self.state.x, self.cables, self.now, self.at, *arrays)
        return K, law

    def _residual(self, law: np.ndarray, gap: float) -> np.ndarray:
        """Residual forces (n_owned, 3) [N] with the pulls that cables aim at, at fixed nodes. Collective."""
        newton, state = self.newton, self.state
        aim_cones(state.x, self.cables, self.now, self.at, gap, self.more, self.aimed)
        newton.net.forces(state.x, newton.f)
        pulls = np.where(self.cables.carries[:, None] == 1, self.aimed[:, :3] - law, 0.0)
        add_pulls(state.ends, pulls, newton.f)
        return newton.not_held(newton.f[newton.owned])

    def _changes(self, K, s: np.ndarray, gap: float) -> float:
        """Changes of the elements with displacements (n_owned, 3); how much of it can be gone. Collective."""
        newton, x, arrays = self.newton, self.state.x, (K.direction, K.axial, K.across)
        newton.spread_out(s)
        beside = self.now, self.at, *arrays, gap, self.more, self.aimed, self.change
        far = change_cones(x, newton.spread, self.cables, *beside)
        return newton.comm.allreduce(float(far), MPI.MIN)

    def _solve(self, K, r: np.ndarray, left: float) -> np.ndarray:
        newton, own = self.newton, self.cycle is None
        if own:
            self.cycle = newton.cycle(K)
        try:
            s, count = newton.solve(K, self.cycle, r, left)
        except NoConvergence:
            if own:
                raise
            self.cycle = None
            return self._solve(K, r, left)
        self.gradients += count
        if count > MANY:
            self.cycle = None
        return s
