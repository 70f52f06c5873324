"""The equilibrium of cables by an interior point method, from any start: slack, soft, yielding.

The energy of cables is convex in the positions, and its least value a second-order cone program; see
`equilibrium.cones`. All inequalities are kept with a gap that is made smaller step by step, each a correction
by a tangent that is always positive, predicted and corrected (Mehrotra 1992; Andersen, Roos, Terlaky 2003).
The number of steps hardly grows with the net, and nothing is to be known of what goes slack or yields.
"""

import numpy as np
from mpi4py import MPI

from netfall.equilibrium.cones import (
    add_pulls,
    aim_cones,
    begin_cones,
    cables_of,
    change_cones,
    correct_cones,
    gaps_of_cones,
    scale_cones,
)
from netfall.equilibrium.newton import Newton, NoConvergence, Stopped
from netfall.equilibrium.relaxation import RunsAway
from netfall.ground.stop import StopRequest
from netfall.mechanics.state import State
from netfall.parallel.sums import exact_sums

FEWEST = 2000  # particles; below that relaxation takes hardly longer
MOST_STEPS = 60
NARROW = 1e-3  # of the tolerance, and of the energy of an element: a gap that leaves hardly a correction
STRETCHED = 1e-4  # strain to begin with, at least, in choosing the gap
WIDE = 2.0  # times less than the work of the first step: a gap that is too narrow to begin with
MOST_BEGINNINGS = 4
LEFT = 0.1  # of the residual, that each of both solutions of a step leaves
MANY = 8  # iterations for that; another approximate inverse is then cheaper
LEAST_SHARE = 1e-4  # of the gap: aimed at
NEARLY = 0.95  # of the way until an inequality no longer holds
LOST = 1e3  # times as far as `overload.run_away` has it: there is no equilibrium
WHOLE = 0.5  # of a step: enough of it has been gone to be near to equilibrium


def move_inside(newton: Newton, state: State, tolerance: float, stop: StopRequest) -> int:
    """Move the net so near to equilibrium that `Newton.find` reaches it; the iterations. Collective.

    tolerance : of `Newton.find`

    Raises NoConvergence, Stopped, RunsAway.
    """
    if newton.distribution.n < FEWEST:
        raise NoConvergence("the net is small")
    newton.begin()
    inside = _Inside(newton, state, stop)
    inside.begin()
    for _ in range(MOST_STEPS):
        if inside.step() and inside.gap <= NARROW * tolerance * inside.energy():
            return inside.gradients
    raise NoConvergence(f"{MOST_STEPS} steps were not enough")


class _Inside:
    """The elements on the way; gap : mean of all products [J]."""

    def __init__(self, newton: Newton, state: State, stop: StopRequest):
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
        self.gradients, self.cycle, self.gap = 0, None, 0.0

    def begin(self) -> None:
        """Begin with a gap about as wide as the work that the first step does. Collective."""
        newton, state = self.newton, self.state
        self.now[:, 1] = np.maximum(state.elements_now().N, STRETCHED * state.EA)
        self.gap = self.energy()
        for _ in range(MOST_BEGINNINGS):
            begin_cones(state.x, self.cables, self.gap, self.now)
            K, law = self._tangent()
            r = self._residual(law, 0.0)
            work = newton.dots((self._solve(K, r), r))[0] / self.count
            if work <= WIDE * self.gap:
                return
            self.gap = float(np.sqrt(self.gap * work))  # not wider than that of the last one

    def energy(self) -> float:
        """Mean energy [J] of an element at its tension. Collective."""
        N, EA, L0 = (each[self.owned] for each in (self.now[:, 1], self.state.EA, self.state.L0))
        return exact_sums(self.newton.comm, 0.5 * N * N / EA * L0)[0] / self.count

    def step(self) -> bool:
        """One step; whether most of it has been gone. Collective. Raises as `move_inside`."""
        newton, x, cables = self.newton, self.state.x, self.cables
        if newton.comm.allreduce(int(self.stop.wanted), MPI.MAX):
            raise Stopped
        K, law = self._tangent()
        self.more[:] = 0.0
        s = self._solve(K, self._residual(law, 0.0))
        far = min(1.0, self._changes(K, s, 0.0))
        gap = max((1.0 - far) ** 3, LEAST_SHARE) * self.gap
        correct_cones(cables, self.now, self.at, self.change, self.more)
        s += self._solve(K, self._residual(law, gap) - newton.stiffness_times(K, s))
        far = min(1.0, NEARLY * self._changes(K, s, gap))
        x += far * newton.spread
        self.now += far * self.change[:, :6]
        gaps_of_cones(x, cables, self.now, self.products)
        if newton.net.away is not None and newton.net.away(newton.comm) > LOST:
            raise RunsAway("what yields stretches without end")
        self.gap = sum(exact_sums(newton.comm, *self.products[self.owned].T.copy())) / self.count
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

    def _solve(self, K, r: np.ndarray) -> np.ndarray:
        newton, own = self.newton, self.cycle is None
        if own:
            self.cycle = newton.cycle(K)
        try:
            s, count = newton.solve(K, self.cycle, r, LEFT)
        except NoConvergence:
            if own:
                raise
            self.cycle = None
            return self._solve(K, r)
        self.gradients += count
        if count > MANY:
            self.cycle = None
        return s
