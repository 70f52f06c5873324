"""The equilibrium of cables with tensions as unknowns beside positions, from any start: slack, yielding.

Newton's method for positions alone turns an element and finds it stretched, by u^2 / 2 L of what it moved
across: a tension that is wrong by far, where cables are stiff and their tension is small. Here the tension N
of a cable is an unknown of its own: residual forces and geometric stiffness have that which the last
correction foresaw (Magisano, Leonetti, Garcea 2017), and the law is linear in it. So a correction may be
large, and what is left of it is squared by the next one.

The complementary energy of a cable that goes slack and yields is that of a bar with a box about its tension:
0 <= N <= limit, N - p + q = a, the force of a bar that did neither, with p >= 0, N p = 0 and, for the flow,
q >= 0, q (limit - N) = 0. On the way N p = q (limit - N) = k gap, k its stiffness [N/m] and gap an energy [J]
that is made smaller, so that no tangent is singular: an interior point method, primal and dual, on tensions
alone. The energy is convex in the positions for any gap (Kanno and Ohsaki 2003).
"""

import numpy as np

from netfall.core.kernels import kernel, part_of_kernel
from netfall.core.records import Record, f8, u1, whole
from netfall.equilibrium.newton import NEARLY, Newton, NoConvergence, StartPoint, Stopped, still_missing
from netfall.equilibrium.relaxation import RunsAway
from netfall.ground.stop import StopRequest
from netfall.mechanics.state import State
from netfall.multigrid.tangent import Tangent
from netfall.numerics.arithmetic import logarithm
from netfall.parallel.mpi import MPI
from netfall.parallel.sums import exact_sums

MOST_STEPS = (
    150  # for an equilibrium: 10 to 30 are enough, 50 near a limit load, 95 for a chain that hangs folded
)
STRETCHED = 1e-4  # strain to begin with, at least, in choosing the gap: that of slack cables tells nothing
ELASTIC, YIELDING = 0.2, 100.0  # gap to begin with, over the energy of an element; flow is many strains
BEGUN = 0.1  # of a limit or a tension [-]: tension to begin with, at least
KEPT = 0.03  # of a tension or room [-]: what is left of what a step would make 0
LARGE = 0.6  # of the largest displacement and tension [-]: no smaller gap after a step so large
NARROWER = 0.1  # gap after a step over that before: 0.04 took 13 % more iterations (jobs/bench)
PARTS = np.sqrt(0.5) ** np.arange(12)  # of a step [-] that are tried, the largest first
FEW = 5e-3  # of all cables [-]: so many may be taken beyond zero, or be unsettled where the gap gets smaller;
# else both would wait for the last cable of a large net
BEYOND = 1.5  # part of a step over that with which the others reach zero
LEFT = 0.02  # of a residual [-], after a correction: 0.1 took more corrections, each as dear as 3 iterations
NARROWED = 1e-4, 1e-6, 0.0  # last step [-], as `size`: Newton's method is tried from there; 0: to the end


class Cables(Record):
    """Elements (m,) of one rank: EA [N]; L0 [m]; eps_p; limit [N], inf: none.

    carries : 1 for cables in the net, 0 for bars, which stay as they are, and for what has left
    logarithmic : 1 where strains are
    """

    EA: f8
    L0: f8
    eps_p: f8
    limit: f8
    carries: u1
    logarithmic: whole


def cables_of(state: State) -> Cables:
    """The elements of a state."""
    plastic, m = state.features.plastic, state.m
    limit = state.yield_force if plastic else np.full(m, np.inf)
    eps_p = state.eps_p if plastic else np.zeros(m)
    carries = ((state.EA > 0.0) & (state.bar == 0)).astype(np.uint8)
    return Cables(state.EA, state.L0, eps_p, limit, carries, state.features.strain == "logarithmic")


class Mixed:
    """The elements on the way: now (m, 4), N, room for more, p and q [N]; gap [J].

    work : `limit.Work`, what the load goes with, None: it is given; watch() : called when the gap has been
        made smaller twice or more, may raise; gradients : iterations until now
    size : of the last step, the larger share as of `NewtonResult`; missing : estimated errors after it,
        or what tensions are off the law
    """

    def __init__(self, newton: Newton, state: State, stop: StopRequest, work=None, watch=None):
        """Begin where the net is. Collective. Raises NoConvergence where this is no way for the net."""
        self.newton, self.state, self.stop, self.work, self.watch = newton, state, stop, work, watch
        self.cables, self.steps, self.gradients = cables_of(state), 0, 0
        own = newton.distribution.subdomain.element_owned & (self.cables.carries == 1)
        self.owned = np.flatnonzero(own)
        there = state.elements_now()
        N = np.maximum(there.N, STRETCHED * state.EA)[own]
        yields = int(np.isfinite(self.cables.limit[own]).any())
        self.count, yields = newton.comm.allreduce(np.array([len(N), yields]))
        if not self.count:
            raise NoConvergence("there are no cables")
        self.energy = exact_sums(newton.comm, 0.5 * N * N / state.EA[own] * state.L0[own])[0] / self.count
        self.gap = self.begun = (YIELDING if yields else ELASTIC) * self.energy
        self.size, self.missing = np.inf, (np.inf, np.inf)
        self.now, self.changes = np.zeros((2, state.m, 4))
        self.aimed, self.part = np.zeros(state.m), np.full(state.m, np.inf)
        begin_tensions(self.cables, there.L, self.gap, self.now)

    def begin_again(self) -> None:
        """Begin near an equilibrium, where the net is."""
        self.gap, self.steps, self.size, self.missing = NARROWER**3 * self.energy, 0, np.inf, (np.inf, np.inf)
        begin_tensions(self.cables, self.state.elements_now().L, self.gap, self.now)

    def narrow(self, size: float, tolerance: float) -> StartPoint:
        """Move the net until a step is so small, or what is missing; size 0: until nothing is. Collective.

        Raises NoConvergence, Stopped, RunsAway.
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
        """How far tensions are off the law at the positions, a share of the largest. Collective."""
        N, own = self.state.elements_now().N, self.owned
        off, most = self.newton.largest(N[own] - self.now[own, 0], self.now[own, 0])
        return off / most

    def step(self) -> None:
        """One step. Collective. Raises as `narrow`."""
        newton, state = self.newton, self.state
        if newton.comm.allreduce(int(self.stop.wanted), MPI.MAX):
            raise Stopped
        newton.begin()
        K, L = newton.tangent(), state.elements_now().L
        of_law = self.cables, L, self.gap
        aim_tensions(*of_law, self.now, K.axial, K.across, self.aimed)
        newton.net.forces(state.x, newton.f)
        pull = np.where(self.cables.carries == 1, self.aimed - K.N, 0.0)
        add_pulls(state.ends, pull[:, None] * K.direction, newton.f)
        s, more, count = self.answer(K, newton.not_held(newton.f[newton.owned]))
        moved, changed, change = newton.sizes(K, s, state.x_start)
        change_of_tensions(*of_law, self.now, self.aimed, change, self.changes, self.part)
        share = self.longest()
        (turned,) = newton.largest(most_turned(newton.spread, self.cables, L, state.ends))
        share = min(newton.most_of(s), share, max(1.0 / turned, PARTS[-1]))
        state.x[:] += share * newton.spread
        change_tensions(self.cables, share, self.changes, self.now)
        if self.work is not None:
            self.work.factor += share * more
        elif newton.net.lost is not None and newton.net.lost(newton.comm, newton.spread):
            raise RunsAway("what yields stretches without end")
        size = max(moved, changed)
        in_place, of_tensions = still_missing((moved, changed), share, self.size)
        self.missing = in_place, max(of_tensions, self.off())
        self.size, self.steps, self.gradients = size, self.steps + 1, self.gradients + count
        (most,) = newton.largest(self.now[self.owned, 0])
        if share == 1.0 and moved < LARGE and self.settled(change, most):
            self.gap = max(NARROWER * self.gap, np.finfo(float).eps * self.energy)
            if self.watch is not None and self.gap < 2.0 * NARROWER**2 * self.begun:
                self.watch()

    def answer(self, K: Tangent, r: np.ndarray) -> tuple[np.ndarray, float, int]:
        """Correction (n_owned, 3) [m] of a residual, of the factor of `work`, iterations. Collective."""
        if self.work is not None:
            return self.work.solve(K, self.newton.cycle(K), r, LEFT)
        s, count = self.newton.solve(K, self.newton.cycle(K), r, LEFT)
        return s, 0.0, count

    def longest(self) -> float:
        """The part of a step that few cables keep from. Collective."""
        until = self.part[self.owned]
        beyond = [np.count_nonzero(until < part) for part in PARTS / BEYOND]
        few = PARTS[self.newton.comm.allreduce(np.array(beyond)) <= FEW * self.count]
        return float(few.max(initial=PARTS[-1]))

    def settled(self, change: np.ndarray, most: float) -> bool:
        """Whether few cables are unsettled: kept from half a step, or tensions change much. Collective.

        change : (m,) [N] by what ends move; most : largest tension [N]
        """
        unsettled = (self.part[self.owned] < 0.5) | (np.abs(change[self.owned]) > LARGE * most)
        return self.newton.comm.allreduce(np.count_nonzero(unsettled)) <= FEW * self.count


@part_of_kernel
def trial(e, length, cables):
    """Force [N] of element e, were it elastic, at a length [m], and its stiffness [N/m]."""
    EA, L0 = cables.EA[e], cables.L0[e]
    if cables.logarithmic:
        return EA * (logarithm(length / L0) - cables.eps_p[e]), EA / length
    return EA * ((length - L0) / L0 - cables.eps_p[e]), EA / L0


@kernel
def begin_tensions(cables, L, gap, now):
    """Fill now (m, 4) for lengths L (m,) [m]: slack as if nothing yielded, flow as if nothing were slack."""
    for e in range(now.shape[0]):
        if not cables.carries[e]:
            continue
        a, k = trial(e, L[e], cables)
        N, limit = 0.5 * (a + np.sqrt(a * a + 4.0 * gap * k)), cables.limit[e]
        if limit < np.inf:
            half = 0.5 * (limit - N)
            N = max(N + half - np.sqrt(half * half + gap * k), BEGUN * min(N, limit))
        now[e, 0], now[e, 1] = N, limit - N
        now[e, 2], now[e, 3] = gap * k / N, gap * k / (limit - N)


@kernel
def aim_tensions(cables, L, gap, now, axial, across, aimed):
    """Fill aimed (m,): the tension [N] at fixed ends; stiffness in arrays of a `Tangent`."""
    for e in range(now.shape[0]):
        if not cables.carries[e]:
            across[e] = max(across[e], 0.0)
            continue
        a, k = trial(e, L[e], cables)
        N, room = now[e, 0], now[e, 1]
        D = 1.0 + now[e, 2] / N + now[e, 3] / room
        aimed[e] = N + (a - N + gap * k / N - gap * k / room) / D
        axial[e], across[e] = k / D, N / L[e]


@kernel
def add_pulls(ends, pull, f):
    """Add pulls (m, 3) [N] on the first ends, and against them on the second ones, to f (n, 3) [N]."""
    for e in range(ends.shape[0]):
        for i in range(3):
            f[ends[e, 0], i] += pull[e, i]
            f[ends[e, 1], i] -= pull[e, i]


@kernel
def change_of_tensions(cables, L, gap, now, aimed, moved, changes, part):
    """Fill changes (m, 4) of `now` to what is aimed at, and by moved (m,) [N], what ends move.

    part : (m,), filled with the part of it until the first of the four would be 0; inf: none would
    """
    for e in range(now.shape[0]):
        if not cables.carries[e]:
            continue
        _, k = trial(e, L[e], cables)
        part[e] = np.inf
        more = aimed[e] - now[e, 0] + moved[e]
        changes[e, 0], changes[e, 1] = more, -more
        for i in range(2):
            value = now[e, i]
            changes[e, 2 + i] = gap * k / value - now[e, 2 + i] * (1.0 + changes[e, i] / value)
        for i in range(4):
            if changes[e, i] < 0.0:
                part[e] = min(part[e], -now[e, i] / changes[e, i])


@kernel
def most_turned(u, cables, L, ends):
    """Most that displacements u (n, 3) [m] move one end of a cable past the other, in its lengths L (m,)."""
    most = np.float64(1e-300)
    for e in range(ends.shape[0]):
        if cables.carries[e]:
            square = 0.0
            for i in range(3):
                difference = u[ends[e, 1], i] - u[ends[e, 0], i]
                square += difference * difference
            most = max(most, np.sqrt(square) / L[e])
    return most


@kernel
def change_tensions(cables, share, changes, now):
    """Change now (m, 4) by a share of its changes; of what would be 0 so much is kept."""
    for e in range(now.shape[0]):
        if not cables.carries[e]:
            continue
        for i in range(4):
            now[e, i] = max(now[e, i] + share * changes[e, i], KEPT * now[e, i])
        if now[e, 0] < now[e, 1]:
            now[e, 1] = cables.limit[e] - now[e, 0]
        else:
            now[e, 0] = cables.limit[e] - now[e, 1]
