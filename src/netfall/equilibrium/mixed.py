"""The equilibrium of elastic cables with tensions as unknowns beside positions, from any start.

Newton's method for positions alone turns an element and finds it stretched, by u^2 / 2 L of what it moved
across: a tension that is wrong by far, where cables are stiff and their tension is small. Here the tension N
of a cable is an unknown of its own: residual forces and geometric stiffness have that which the last
correction foresaw (Magisano, Leonetti, Garcea 2017), and the law is linear in it. So a correction may be
large, and what is left of it is squared by the next one.

A cable's law is N - p = a, a its force were it a bar, N >= 0, p >= 0 and N p = 0. On the way N p = k gap, k
its stiffness [N/m] and gap an energy [J] that is made smaller, so that no tangent is singular: an interior
point method, primal and dual, on tensions alone. Cables that yield are for `equilibrium.interior`.
"""

import numpy as np
from mpi4py import MPI

from netfall.equilibrium.cones import STRETCHED, add_pulls, cables_of, trial, with_gap
from netfall.equilibrium.newton import Newton, NoConvergence, StartPoint, Stopped, Yields, still_missing
from netfall.ground.compile import kernel
from netfall.ground.stop import StopRequest
from netfall.mechanics.state import State
from netfall.parallel.sums import exact_sums

MOST_STEPS = 40
WIDE = 0.2  # times the energy of an element: the gap to begin with
NARROWER = 0.04  # times: the gap after a step that is not `LARGE`, twice if it is `SMALL`
LARGE, SMALL = 0.3, 0.01  # steps, as shares of the largest displacement and tension
LEAST = 1e-12  # of that energy: the last gap
KEPT = 0.03  # of N and p: what a step leaves of them at least
OFF = 1e-5  # of the largest tension: what tensions may be off by at last
LEFT = 5e-3  # of the residual, that a correction leaves: what is soft has little of it and moves far


class Mixed:
    """The elements on the way: now (m, 2), N and p [N]; gap [J].

    size : of the last step, the larger share as of `NewtonResult`; missing : estimated errors after it
    """

    def __init__(self, newton: Newton, state: State, stop: StopRequest):
        """Begin where the net is. Collective. Raises NoConvergence where this is no way for the net."""
        self.newton, self.state, self.stop = newton, state, stop
        self.cables, self.steps, self.gradients = cables_of(state), 0, 0
        self.owned = np.flatnonzero(newton.distribution.subdomain.element_owned & (self.cables.carries == 1))
        N = np.maximum(state.elements_now().N, STRETCHED * state.EA)[self.owned]
        energy = 0.5 * N * N / state.EA[self.owned] * state.L0[self.owned]
        count = newton.comm.allreduce(len(self.owned))
        if not count:
            raise NoConvergence("there are no cables")
        self.energy = exact_sums(newton.comm, energy)[0] / count
        self.gap, self.size, self.missing = WIDE * self.energy, np.inf, (np.inf, np.inf)
        self.now, self.aimed = np.zeros((2, state.m, 2))
        begin_tensions(self.cables, state.elements_now().L, self.gap, self.now)

    def narrow(self, size: float, tolerance: float) -> StartPoint:
        """Move the net until a step is so small, or what is missing. Collective.

        Raises NoConvergence, Yields where cables do, Stopped.
        """
        self.newton.begin()
        while self.size > size and max(self.missing) > tolerance:
            if self.steps >= MOST_STEPS:
                raise NoConvergence(f"{MOST_STEPS} steps were not enough")
            self.step()
        return StartPoint(self.gradients, self.size)

    def errors(self) -> tuple[float, float]:
        """`missing`, or what tensions are off the law at the positions. Collective.

        Raises NoConvergence where that is much.
        """
        N, own = self.state.elements_now().N, self.owned
        off, most = self.newton.largest(N[own] - self.now[own, 0], N[own])
        if not off <= OFF * most:
            raise NoConvergence("tensions are not those of the law")
        return self.missing[0], max(self.missing[1], off / most if most > 0.0 else 0.0)

    def step(self) -> None:
        """One step. Collective. Raises as `narrow`."""
        newton, state = self.newton, self.state
        if newton.comm.allreduce(int(self.stop.wanted), MPI.MAX):
            raise Stopped
        K = newton.tangent()
        L = state.elements_now().L
        aim_tensions(self.cables, L, self.now, self.gap, K.axial, K.across, self.aimed)
        newton.net.forces(state.x, newton.f)
        more = np.where(self.cables.carries == 1, self.aimed[:, 0] - K.N, 0.0)
        add_pulls(state.ends, more[:, None] * K.direction, newton.f)
        r = newton.not_held(newton.f[newton.owned])
        s, count = newton.solve(K, newton.cycle(K), r, LEFT)
        self.gradients += count
        moved, changed, change = newton.sizes(K, s, state.x_start)
        share = newton.most_of(s)
        state.x[:] += share * newton.spread
        change_tensions(self.cables, self.gap, self.aimed, change, share, self.now)
        size = max(moved, changed)
        self.missing = still_missing((moved, changed), share, self.size)
        self.size, self.steps = size, self.steps + 1
        yields = bool((self.now[self.owned, 0] > self.cables.limit[self.owned]).any())
        if newton.comm.allreduce(yields, MPI.LOR):
            raise Yields("cables yield")
        if size < LARGE:
            self.gap *= NARROWER * (NARROWER if size < SMALL else 1.0)
            self.gap = max(self.gap, LEAST * self.energy)


@kernel
def begin_tensions(cables, L, gap, now):
    """Fill now (m, 2) for lengths L (m,) [m]."""
    for e in range(now.shape[0]):
        if cables.carries[e]:
            a, k = trial(e, L[e], cables)
            now[e, 0] = with_gap(a, k, gap)
            now[e, 1] = gap * k / now[e, 0]


@kernel
def aim_tensions(cables, L, now, gap, axial, across, aimed):
    """Fill aimed (m, 2): the tension [N] at fixed ends, and N p [N^2]; stiffness in arrays of a `Tangent`."""
    for e in range(now.shape[0]):
        if not cables.carries[e]:
            across[e] = max(across[e], 0.0)
            continue
        a, k = trial(e, L[e], cables)
        N, D = now[e, 0], 1.0 + now[e, 1] / now[e, 0]
        aimed[e, 0], aimed[e, 1] = N + (a - N + gap * k / N) / D, gap * k
        axial[e], across[e] = k / D, N / L[e]


@kernel
def change_tensions(cables, gap, aimed, change, share, now):
    """Change now (m, 2) by a share of what is aimed at and the change (m,) [N] by what ends move."""
    for e in range(now.shape[0]):
        if not cables.carries[e]:
            continue
        N, p = now[e, 0], now[e, 1]
        more = aimed[e, 0] - N + change[e]
        now[e, 0] = max(N + share * more, KEPT * N)
        now[e, 1] = max(p + share * (aimed[e, 1] / N - p - p / N * more), KEPT * p)
