"""Equilibrium of cables with tensions and positions as unknowns, from any start.

Cables may go slack and yield.

Newton's method for positions alone overestimates tensions: a displacement u across an element of length L
stretches it by u^2 / 2 L. That error is large if cables are stiff and their tension is small. In this method
the tension N of a cable is an unknown of its own. Residual forces and geometric stiffness use the tension
that the last correction predicted (Magisano, Leonetti, Garcea 2017), and the constitutive law is linear in
it. So a correction may be large, and the next one squares what remains of its error.

A cable that goes slack and yields has the complementary energy of a bar with bounds on its tension:

    0 <= N <= limit,  N - p + q = a,  p >= 0,  N p = 0,  q >= 0,  q (limit - N) = 0

Here a is the force of a bar without bounds, p belongs to slackening and q to plastic flow. The interior point
method solves N p = q (limit - N) = k gap instead. Here k is the stiffness [N/m] and gap the barrier parameter
[J], which decreases to 0, so no tangent is singular on the way. The method is primal-dual, on tensions alone.
The energy is convex in the positions for any barrier parameter (Kanno and Ohsaki 2003).
"""

from typing import Any

import numpy as np

from netfall.core.arithmetic import logarithm
from netfall.core.kernels import kernel, part_of_kernel
from netfall.core.records import Record, f8, u1, whole
from netfall.core.stop import StopFlag
from netfall.core.types import FloatArray, IntArray
from netfall.parallel.mpi import MPI
from netfall.parallel.sums import exact_sums
from netfall.physics.state import State
from netfall.statics import messages
from netfall.statics.multigrid.tangent import Tangent
from netfall.statics.newton import NEARLY, Newton, NoConvergence, StartPoint, StopRequested, remaining_errors
from netfall.statics.relaxation import UnboundedDisplacement

# steps for one equilibrium: 10 to 30 suffice; 50 near a limit load; 95 for a chain that hangs folded
MOST_STEPS = 150
# lowest strain [-] used to choose the initial barrier parameter: the strain of slack cables is no scale
MIN_INITIAL_STRAIN = 1e-4
# initial barrier parameter over the energy of an element [-]; plastic flow means large strains
ELASTIC_BARRIER, PLASTIC_BARRIER = 0.2, 100.0
MIN_INITIAL_TENSION = (
    0.1  # lower bound of the initial tension, a share of the yield force or of the tension [-]
)
MIN_REMAINING = (
    0.03  # smallest share of a tension or of its distance from the limit that is left after a step [-]
)
# share of the largest displacement and tension [-]; after a larger step the barrier parameter stays
LARGE_STEP = 0.6
BARRIER_FACTOR = (
    0.1  # ratio of successive barrier parameters [-]: 0.04 took 13 % more iterations (jobs/bench)
)
STEP_SHARES = np.sqrt(0.5) ** np.arange(12)  # shares of a step that are tried [-], the largest first
# share of the cables [-] that a step may take beyond zero, or that may be unsettled when the barrier
# parameter is reduced. Otherwise both would wait for the last cable of a large net.
ALLOWED_SHARE = 5e-3
OVERSTEP = 1.5  # share of a step over the share at which the other cables reach zero [-]
# share of the residual left after a correction [-]: 0.1 took more corrections, each as expensive as 3
# iterations
LEFT = 0.02
STEP_SIZES = 1e-4, 1e-6, 0.0  # sizes of the last step [-] after which Newton's method is tried; 0: to the end


class CableProperties(Record):
    """Elements (m,) of one rank: EA [N]; L0 [m]; eps_p; limit [N], inf: none.

    carries : 1 for cables in the net; 0 for bars, which keep their law, and for elements that have left
    logarithmic : 1 if strains are logarithmic
    """

    EA: f8
    L0: f8
    eps_p: f8
    limit: f8
    carries: u1
    logarithmic: whole


def cable_properties(state: State) -> CableProperties:
    """Collect the properties of the elements of a state."""
    plastic, m = state.features.plastic, state.m
    limit = state.yield_force if plastic else np.full(m, np.inf)
    eps_p = state.eps_p if plastic else np.zeros(m)
    carries = ((state.EA > 0.0) & (state.bar == 0)).astype(np.uint8)
    return CableProperties(state.EA, state.L0, eps_p, limit, carries, state.features.strain == "logarithmic")


class InteriorPoint:
    """Primal-dual interior point method for the elements of one state.

    now : (m, 4), the tension N, its distance from the limit, p and q, all [N]
    gap : barrier parameter [J]
    work : `work_control.Work`, controls the load, None: the load is given
    watch() : called when the barrier parameter has been reduced at least twice, may raise
    gradients : iterations so far
    size : of the last step, the larger of the shares of `Newton.sizes`
    missing : estimated errors after that step, at least the deviation of tensions from the law
    """

    def __init__(
        self, newton: Newton, state: State, stop: StopFlag, work: Any | None = None, watch: Any = None
    ):
        """Start from the present positions. Collective. Raises NoConvergence if the net has no cables."""
        self.newton, self.state, self.stop, self.work, self.watch = newton, state, stop, work, watch
        self.cables, self.steps, self.gradients = cable_properties(state), 0, 0
        is_own = newton.distribution.subdomain.element_owned & (self.cables.carries == 1)
        self.owned = np.flatnonzero(is_own)
        elements = state.present_element_state()
        N = np.maximum(elements.N, MIN_INITIAL_STRAIN * state.EA)[is_own]
        yields = int(np.isfinite(self.cables.limit[is_own]).any())
        self.count, yields = newton.comm.allreduce(np.array([len(N), yields]))
        if not self.count:
            raise NoConvergence("there are no cables")
        self.energy = (
            exact_sums(newton.comm, 0.5 * N * N / state.EA[is_own] * state.L0[is_own])[0] / self.count
        )
        self.gap = self.begun = (PLASTIC_BARRIER if yields else ELASTIC_BARRIER) * self.energy
        self.size, self.missing = np.inf, (np.inf, np.inf)
        self.now, self.changes = np.zeros((2, state.m, 4))
        self.aimed, self.part = np.zeros(state.m), np.full(state.m, np.inf)
        initialise_tensions(self.cables, elements.L, self.gap, self.now)

    def restart_near_equilibrium(self) -> None:
        """Restart with a small barrier parameter from present positions that are close to an equilibrium."""
        self.gap, self.steps, self.size, self.missing = (
            BARRIER_FACTOR**3 * self.energy,
            0,
            np.inf,
            (np.inf, np.inf),
        )
        initialise_tensions(self.cables, self.state.present_element_state().L, self.gap, self.now)

    def iterate(self, size: float, tolerance: float) -> StartPoint:
        """Take steps until the step size or the estimated error is small enough. Collective.

        size : of a step that is small enough; 0: only the error counts, as a step may vanish at any barrier
        parameter.

        Raises NoConvergence, StopRequested, UnboundedDisplacement.
        """
        while (self.size > size or not size) and max(self.missing) > tolerance:
            if self.steps < MOST_STEPS:
                self.step()
            elif max(self.missing) <= NEARLY * tolerance:
                break
            else:
                raise NoConvergence(f"{MOST_STEPS} steps were not enough")
        return StartPoint(self.gradients, self.size)

    def off(self) -> float:
        """Return the largest deviation of tensions from the law, a share of the largest tension.

        Collective.
        """
        N, rows = self.state.present_element_state().N, self.owned
        deviation, largest = self.newton.largest(N[rows] - self.now[rows, 0], self.now[rows, 0])
        return deviation / largest

    def step(self) -> None:
        """Take one step. Collective. Raises as `iterate`."""
        newton, state = self.newton, self.state
        if newton.comm.allreduce(int(self.stop.wanted), MPI.MAX):
            raise StopRequested
        newton.begin()
        K, L = newton.tangent(), state.present_element_state().L
        compute_target_tensions(self.cables, L, self.gap, self.now, K.axial, K.across, self.aimed)
        newton.net.forces(state.x, newton.f)
        pull = np.where(self.cables.carries == 1, self.aimed - K.N, 0.0)
        add_element_pulls(state.ends, pull[:, None] * K.direction, newton.f)
        s, factor_change, count = self.answer(K, newton.without_held(newton.f[newton.owned]))
        displacement, changed, change = newton.sizes(K, s, state.x_start)
        compute_tension_changes(
            self.cables, L, self.gap, self.now, self.aimed, change, self.changes, self.part
        )
        step_share = self.longest_step()
        (most_turn,) = newton.largest(largest_rotation(newton.spread, self.cables, L, state.ends))
        step_share = min(newton.allowed_share(s), step_share, max(1.0 / most_turn, STEP_SHARES[-1]))
        state.x[:] += step_share * newton.spread
        apply_tension_changes(self.cables, step_share, self.changes, self.now)
        if self.work is not None:
            self.work.factor += step_share * factor_change
        elif newton.net.lost is not None and newton.net.lost(newton.comm, newton.spread):
            raise UnboundedDisplacement(messages.UNBOUNDED_YIELDING())
        size = max(displacement, changed)
        displacement_error, tension_error = remaining_errors((displacement, changed), step_share, self.size)
        self.missing = displacement_error, max(tension_error, self.off())
        self.size, self.steps, self.gradients = size, self.steps + 1, self.gradients + count
        (largest_tension,) = newton.largest(self.now[self.owned, 0])
        if step_share == 1.0 and displacement < LARGE_STEP and self.is_settled(change, largest_tension):
            self.gap = max(BARRIER_FACTOR * self.gap, np.finfo(float).eps * self.energy)
            if self.watch is not None and self.gap < 2.0 * BARRIER_FACTOR**2 * self.begun:
                self.watch()

    def answer(self, K: Tangent, r: np.ndarray) -> tuple[np.ndarray, float, int]:
        """Return the correction (n_owned, 3) [m], the change of `work.factor`, and the iterations.

        Collective.
        """
        if self.work is not None:
            return self.work.solve(K, self.newton.cycle(K), r, LEFT)
        s, count = self.newton.solve(K, self.newton.cycle(K), r, LEFT)
        return s, 0.0, count

    def longest_step(self) -> float:
        """Return the largest share of a step that takes only few cables beyond their bounds. Collective."""
        shares = self.part[self.owned]
        beyond = [np.count_nonzero(shares < trial_share) for trial_share in STEP_SHARES / OVERSTEP]
        allowed = STEP_SHARES[self.newton.comm.allreduce(np.array(beyond)) <= ALLOWED_SHARE * self.count]
        return float(allowed.max(initial=STEP_SHARES[-1]))

    def is_settled(self, change: np.ndarray, largest_tension: float) -> bool:
        """Return whether only few cables are unsettled, so that the barrier parameter may be reduced.

        Collective.

        A cable is unsettled if it allows less than half a step or if its tension changes much.
        change : (m,) [N] by the motion of the ends; largest_tension : [N]
        """
        unsettled = (self.part[self.owned] < 0.5) | (
            np.abs(change[self.owned]) > LARGE_STEP * largest_tension
        )
        return self.newton.comm.allreduce(np.count_nonzero(unsettled)) <= ALLOWED_SHARE * self.count


@part_of_kernel
def elastic_force(e: int, length: float, cables: CableProperties) -> tuple[float, float]:
    """Compute the force [N] of element e as if it were elastic at a length [m], and its stiffness [N/m]."""
    EA, L0 = cables.EA[e], cables.L0[e]
    if cables.logarithmic:
        return EA * (logarithm(length / L0) - cables.eps_p[e]), EA / length
    return EA * ((length - L0) / L0 - cables.eps_p[e]), EA / L0


@kernel
def initialise_tensions(cables: CableProperties, L: FloatArray, gap: float, now: FloatArray) -> None:
    """Fill now (m, 4) for lengths L (m,) [m] with an initial guess.

    The lower bound is treated as if nothing yielded, the upper bound as if nothing were slack.
    """
    for e in range(now.shape[0]):
        if not cables.carries[e]:
            continue
        a, k = elastic_force(e, L[e], cables)
        N, limit = 0.5 * (a + np.sqrt(a * a + 4.0 * gap * k)), cables.limit[e]
        if limit < np.inf:
            half = 0.5 * (limit - N)
            N = max(N + half - np.sqrt(half * half + gap * k), MIN_INITIAL_TENSION * min(N, limit))
        now[e, 0], now[e, 1] = N, limit - N
        now[e, 2], now[e, 3] = gap * k / N, gap * k / (limit - N)


@kernel
def compute_target_tensions(
    cables: CableProperties,
    L: FloatArray,
    gap: float,
    now: FloatArray,
    axial: FloatArray,
    across: FloatArray,
    aimed: FloatArray,
) -> None:
    """Fill aimed (m,) with the tension [N] that the next step aims at with fixed ends.

    axial, across : filled with the stiffness, in the arrays of a `Tangent`
    """
    for e in range(now.shape[0]):
        if not cables.carries[e]:
            across[e] = max(across[e], 0.0)
            continue
        a, k = elastic_force(e, L[e], cables)
        N, reserve = now[e, 0], now[e, 1]
        D = 1.0 + now[e, 2] / N + now[e, 3] / reserve
        aimed[e] = N + (a - N + gap * k / N - gap * k / reserve) / D
        axial[e], across[e] = k / D, N / L[e]


@kernel
def add_element_pulls(ends: IntArray, pull: FloatArray, f: FloatArray) -> None:
    """Add forces (m, 3) [N] to the first ends and subtract them from the second ends, in f (n, 3) [N]."""
    for e in range(ends.shape[0]):
        for i in range(3):
            f[ends[e, 0], i] += pull[e, i]
            f[ends[e, 1], i] -= pull[e, i]


@kernel
def compute_tension_changes(
    cables: CableProperties,
    L: FloatArray,
    gap: float,
    now: FloatArray,
    aimed: FloatArray,
    by_motion: FloatArray,
    changes: FloatArray,
    step_limit: FloatArray,
) -> None:
    """Fill changes (m, 4) of `now` for a step to the tension aimed at and for moving ends.

    by_motion : (m,) [N], the effect of moving ends
    step_limit : (m,), filled with the share of the change at which the first of the four becomes 0; inf: none
        does
    """
    for e in range(now.shape[0]):
        if not cables.carries[e]:
            continue
        _, k = elastic_force(e, L[e], cables)
        step_limit[e] = np.inf
        tension_change = aimed[e] - now[e, 0] + by_motion[e]
        changes[e, 0], changes[e, 1] = tension_change, -tension_change
        for i in range(2):
            value = now[e, i]
            changes[e, 2 + i] = gap * k / value - now[e, 2 + i] * (1.0 + changes[e, i] / value)
        for i in range(4):
            if changes[e, i] < 0.0:
                step_limit[e] = min(step_limit[e], -now[e, i] / changes[e, i])


@kernel
def largest_rotation(u: FloatArray, cables: CableProperties, L: FloatArray, ends: IntArray) -> float:
    """Return the largest relative displacement of the ends of a cable, over its length L (m,) [m].

    u : displacements (n, 3) [m]
    """
    largest = np.float64(1e-300)
    for e in range(ends.shape[0]):
        if cables.carries[e]:
            square = 0.0
            for i in range(3):
                difference = u[ends[e, 1], i] - u[ends[e, 0], i]
                square += difference * difference
            largest = max(largest, np.sqrt(square) / L[e])
    return largest


@kernel
def apply_tension_changes(
    cables: CableProperties, share: float, changes: FloatArray, now: FloatArray
) -> None:
    """Change now (m, 4) by a share of its changes, but leave at least `MIN_REMAINING` of each value."""
    for e in range(now.shape[0]):
        if not cables.carries[e]:
            continue
        for i in range(4):
            now[e, i] = max(now[e, i] + share * changes[e, i], MIN_REMAINING * now[e, i])
        if now[e, 0] < now[e, 1]:
            now[e, 1] = cables.limit[e] - now[e, 0]
        else:
            now[e, 0] = cables.limit[e] - now[e, 1]
