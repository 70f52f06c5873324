"""Equilibrium of cables with tensions and positions as unknowns, from any start.

Cables may go slack and yield.

Newton's method for positions alone overestimates tensions: a displacement u across an element of length L
stretches it by u^2 / 2 L. That error is large if cables are stiff and their tension is small. In this method
the tension N of a cable is a separate unknown. Residual forces and geometric stiffness use the tension that
the last correction predicted (Magisano, Leonetti, Garcea 2017), and the constitutive law is linear in it. So
a correction may be large, and the next one squares the remaining error.

A cable that goes slack and yields has the complementary energy of a bar with bounds on its tension:

    0 <= N <= limit,  N - p + q = a,  p >= 0,  N p = 0,  q >= 0,  q (limit - N) = 0

Here a is the force of a bar without bounds, p belongs to slackening and q to plastic flow. The interior point
method solves N p = q (limit - N) = k gap instead. Here k is the stiffness [N/m] and gap the barrier parameter
[J], which decreases to 0, so no tangent is singular on the way. The method is primal-dual, on tensions alone.
The energy is convex in the positions for any barrier parameter (Kanno and Ohsaki 2003).
"""

from typing import Any

import numpy as np

from netfall.core.functions import lengths, log
from netfall.core.timings import StopFlag, StopRequested
from netfall.parallel.mpi import MPI
from netfall.parallel.sums import exact_sums
from netfall.physics.law.measures import REACHED_SHARE
from netfall.physics.state import State
from netfall.statics import messages
from netfall.statics.bounds import LARGE_SHARE, MOST_STEPS
from netfall.statics.newton import NEAR_TOLERANCE, Newton, NoConvergence
from netfall.statics.relaxation import UnboundedDisplacement

# lowest strain [-] used to choose the initial barrier parameter: the strain of slack cables is not a scale
MIN_INITIAL_STRAIN = 1e-4
# initial barrier parameter over the energy of an element [-]; first plastic flow means large strains
ELASTIC_BARRIER, PLASTIC_BARRIER = 0.2, 100.0
# ratio of successive barrier parameters [-]: 0.04 took 13 % more iterations (jobs/bench). A step leaves at
# least this share of a tension and of its distance from the limit. The first tension is at least this share
# of the yield force or of the tension without it, as p and q then follow from it.
BARRIER_FACTOR = 0.1
STEP_SHARES = np.sqrt(0.5) ** np.arange(12)  # shares of a step that are tried [-], the largest first
# share of the cables [-] that a step may take beyond zero, or that may be unsettled when the barrier
# parameter is reduced. Otherwise both would wait for the last cable of a large net.
ALLOWED_SHARE = 5e-3
STEP_SIZES = 1e-4, 1e-6, 0.0  # sizes of the last step [-] after which Newton's method is tried; 0: to the end


class InteriorPoint:
    """Primal-dual interior point method for the cables of one state. Bars keep their law.

    rows : (k,) the cables in the net
    unknowns : (4, k), the tension N, its distance from the limit, p and q, all [N]
    barrier : barrier parameter [J]
    gradients : iterations so far
    size : of the last step, the larger of the shares of `Newton.step_sizes`
    errors : estimated errors after that step, at least the deviation of tensions from the law
    """

    def __init__(self, newton: Newton, state: State, stop: StopFlag):
        """Start from the present positions. Collective. Raises NoConvergence if the net has no cables."""
        self.newton, self.state, self.stop = newton, state, stop
        self.steps = self.gradients = 0
        self.rows = rows = np.flatnonzero((state.EA > 0.0) & (state.bar == 0))
        self.owned = own = newton.distribution.subdomain.element_owned[rows]
        plastic, self.ends = state.features.plastic, state.ends[rows]
        self.EA, self.L0 = state.EA[rows], state.L0[rows]
        self.limit = state.yield_force[rows] if plastic else np.full(len(rows), np.inf)
        self.eps_p = state.eps_p[rows] if plastic else np.zeros(len(rows))
        elements = state.present_element_state()
        N = np.maximum(elements.N[rows], MIN_INITIAL_STRAIN * self.EA)[own]
        limit, yielding = self.limit[own], elements.N[rows] >= REACHED_SHARE * self.limit
        counts = np.array([len(N), np.isfinite(limit).any(), yielding[own].any()], np.int64)
        self.count, can_yield, has_yielded = newton.comm.allreduce(counts)
        if not self.count:
            raise NoConvergence("there are no cables")
        energies = 0.5 * N * N / self.EA[own] * self.L0[own]
        self.energy = exact_sums(newton.comm, energies)[0] / self.count
        self.barrier = (PLASTIC_BARRIER if can_yield and not has_yielded else ELASTIC_BARRIER) * self.energy
        self.size, self.errors = np.inf, (np.inf, np.inf)
        self._initialise(elements.L[rows])

    @np.errstate(divide="ignore", invalid="ignore")
    def _initialise(self, L: np.ndarray) -> None:
        """Set `unknowns` to an initial guess for lengths L (k,) [m].

        The lower bound is treated as if nothing yielded, the upper bound as if nothing were slack.
        """
        a, k = self._elastic_force(L)
        N = 0.5 * (a + np.sqrt(a * a + 4.0 * self.barrier * k))
        yields = np.isfinite(self.limit)
        half = np.where(yields, 0.5 * (self.limit - N), 0.0)
        lowered = N + half - np.sqrt(half * half + self.barrier * k)
        N = np.where(yields, np.maximum(lowered, BARRIER_FACTOR * np.minimum(N, self.limit)), N)
        bounded = np.array([N, self.limit - N])
        self.unknowns = np.concatenate([bounded, self.barrier * k / bounded])

    def _elastic_force(self, L: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compute the forces (k,) [N] as if cables were elastic at lengths L [m], and the stiffness [N/m]."""
        if self.state.features.strain == "logarithmic":
            return self.EA * (log(L / self.L0) - self.eps_p), self.EA / L
        return self.EA * ((L - self.L0) / self.L0 - self.eps_p), self.EA / self.L0

    def iterate(self, size: float, tolerance: float) -> tuple[int, float]:
        """Take steps until the step size or the estimated error is small enough. Collective.

        Returns `gradients` and `size`.

        size : of a step that is small enough; 0: only the error counts, as a step may vanish at any barrier
        parameter.

        Raises NoConvergence, StopRequested, UnboundedDisplacement.
        """
        while (self.size > size or not size) and max(self.errors) > tolerance:
            if self.steps < MOST_STEPS:
                self.step()
            elif max(self.errors) <= NEAR_TOLERANCE * tolerance:
                break
            else:
                raise NoConvergence(f"{MOST_STEPS} steps were not enough")
        return self.gradients, self.size

    @np.errstate(divide="ignore", invalid="ignore")  # a bound may be reached, a length vanish
    def step(self) -> None:
        """Take one step. Collective. Raises as `iterate`."""
        newton, state, rows = self.newton, self.state, self.rows
        if newton.comm.allreduce(int(self.stop.is_set), MPI.MAX):
            raise StopRequested
        newton.begin()
        K, L = newton.tangent(), state.present_element_state().L[rows]
        # the tension that the step aims at with fixed ends, and the stiffness against motion of the ends
        a, k = self._elastic_force(L)
        bounded, dual = self.unknowns[:2], self.unknowns[2:]
        D = 1.0 + dual[0] / bounded[0] + dual[1] / bounded[1]
        aimed = (
            bounded[0] + (a - bounded[0] + self.barrier * k / bounded[0] - self.barrier * k / bounded[1]) / D
        )
        pull, K = np.zeros(state.m), K._replace(across=np.maximum(K.across, 0.0))
        pull[rows], K.axial[rows], K.across[rows] = aimed - K.N[rows], k / D, bounded[0] / L
        newton.net.forces(state.x, newton.f)
        node = np.concatenate([np.arange(len(state.x)), state.ends.ravel()])
        for axis in range(3):  # in the order of the elements
            along = pull * K.direction[:, axis]
            forces = np.concatenate([newton.f[:, axis], np.column_stack([along, -along]).ravel()])
            newton.f[:, axis] = np.bincount(node, forces)
        s, count = newton.solve(K, newton.cycle(K), newton.without_held(newton.f[newton.owned]))
        displacement, changed, change = newton.step_sizes(K, s, state.x_start)
        change = change[rows]
        changes, part = self._changes(aimed - bounded[0] + change, k)
        turns = lengths(newton.u[self.ends[:, 1]] - newton.u[self.ends[:, 0]]) / L
        (most_turn,) = newton.largest(turns)
        longest = max(1.0 / max(most_turn, 1e-300), STEP_SHARES[-1])
        step_share = min(newton.allowed_share(s), self.longest_step(part), longest)
        state.x[:] += step_share * newton.u
        self.unknowns = now = np.maximum(self.unknowns + step_share * changes, BARRIER_FACTOR * self.unknowns)
        lower = now[0] < now[1]
        now[1, lower] = self.limit[lower] - now[0, lower]
        now[0, ~lower] = self.limit[~lower] - now[1, ~lower]
        if newton.net.is_unbounded is not None and newton.net.is_unbounded(newton.comm, newton.u):
            raise UnboundedDisplacement(messages.UNBOUNDED_YIELDING())
        size = max(displacement, changed)
        # the distance that remains if step sizes decrease at the same rate, at least the step itself
        rate = size / self.size if self.size else np.inf
        share_left = 1.0 - step_share + (max(1.0, rate / (1.0 - rate)) if rate < 1.0 else np.inf)
        displacement_error, tension_error = (
            part_size * share_left if part_size else 0.0 for part_size in (displacement, changed)
        )
        off = state.present_element_state().N[rows] - self.unknowns[0]  # deviation of tensions from the law
        deviation, largest_tension = newton.largest(off[self.owned], self.unknowns[0, self.owned])
        self.errors = displacement_error, max(tension_error, deviation / largest_tension)
        self.size, self.steps, self.gradients = size, self.steps + 1, self.gradients + count
        # unsettled: allows less than half a step, or its tension changes much by the motion of the ends
        unsettled = (part < LARGE_SHARE) | (np.abs(change[self.owned]) > LARGE_SHARE * largest_tension)
        is_settled = self.few(np.count_nonzero(unsettled))
        if step_share == 1.0 and displacement < LARGE_SHARE and is_settled:
            self.barrier = max(BARRIER_FACTOR * self.barrier, np.finfo(float).eps * self.energy)

    def _changes(self, tension_change: np.ndarray, k: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the changes (4, k) of `unknowns` in a step, for changes of tension (k,) [N].

        Also returns the share of the step at which the first of the four becomes 0, of each own cable.
        """
        bounded, dual = self.unknowns[:2], self.unknowns[2:]
        changes = np.array([tension_change, -tension_change])
        changes = np.concatenate([changes, self.barrier * k / bounded - dual * (1.0 + changes / bounded)])
        ratios = np.full_like(changes, np.inf)
        np.divide(-self.unknowns, changes, out=ratios, where=changes < 0.0)
        return changes, ratios.min(0)[self.owned]

    def longest_step(self, part: np.ndarray) -> float:
        """Return the largest share of a step that takes only few cables beyond their bounds. Collective.

        part : share of the step at which each own cable reaches a bound
        """
        beyond = [np.count_nonzero(part < trial_share) for trial_share in LARGE_SHARE * STEP_SHARES]
        return float(STEP_SHARES[self.few(np.array(beyond))].max(initial=STEP_SHARES[-1]))

    def few(self, number: Any) -> Any:
        """Return whether numbers of own cables are few of all cables. Collective."""
        return self.newton.comm.allreduce(number) <= ALLOWED_SHARE * self.count
