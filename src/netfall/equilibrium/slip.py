"""Equilibria in which cables slip over nodes.

For positions x the slips s make W(x, s) = strain energy + potential of the self weight + sum R |s - s_old|
smallest: each place sticks while |Q| <= R, else |Q| = R (`mechanics.slip`). W is convex in s, so that
Newton's method on the set that slips finds them, with steps that end where one would turn round. The forces
on the nodes are the gradient of that smallest W; its tangent is the net's, less what slips: K_xx - K_xs
K_ss^-1 K_sx. So an equilibrium is found as without slip, the slips of every trial included.

Within an equilibrium R is constant; it is brought up to date with the tensions, from the same start, until it
does not change. What comes of friction depends on the path: s_old is that of the last equilibrium.

Every rank computes all slips from the same positions: so they have the same bits on any number of ranks.
"""

from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from netfall.equilibrium.relaxation import Paused, not_begun
from netfall.ground.compile import kernel, part_of_kernel
from netfall.ground.errors import DivergedError
from netfall.mechanics.slip import LEAST, angle_between, slip_force, slip_limit, slipped_lengths
from netfall.mechanics.state import State
from netfall.numerics.arithmetic import exponential, logarithm
from netfall.parallel.subdomain import Distribution, rows_of

MOST_STEPS = 200  # of Newton's method on the slips at given positions
NEAR_ZERO = 1e-12  # of the largest force on them: what is left of it
ROUNDING = 4e-3  # of EA: what counts as such a force, whose rounding is that of lengths
FLOOR = 1e-9  # of EA / L0: what a slack strand counts as, so that its slip is defined
HALVINGS = 30
SETTLED = 0.1  # of the tolerance: what limits may still change
MOST_ROUNDS = 100  # of limits brought up to date with tensions


class CableChains(NamedTuple):
    """Places where cables may slip, along each cable, and the elements beside them; the same on every rank.

    node, column : (k,) global particle, and which of its cables; before, after : (k,) rows of elements here
    friction : (k,); resistance : (k,) [N]; start : (c + 1,) where the chains begin
    element : (q,) global numbers; into, out : (q,) place at its begin and its end along the cable, -1: none
    along : (q,) 1, -1; weight : (q,) [N/m] of their own
    """

    node: np.ndarray
    column: np.ndarray
    before: np.ndarray
    after: np.ndarray
    friction: np.ndarray
    resistance: np.ndarray
    start: np.ndarray
    element: np.ndarray
    into: np.ndarray
    out: np.ndarray
    along: np.ndarray
    weight: np.ndarray


def cable_chains_of(slides, weight: np.ndarray) -> CableChains:
    """The chains of `net.slides.Slides`. weight : (m,) [N/m] of each element"""
    element, rows = np.unique(np.concatenate([slides.before, slides.after]), return_inverse=True)
    before, after = rows[: slides.count], rows[slides.count :]
    into, out = np.full((2, len(element)), -1)
    into[after], out[before] = np.arange(slides.count), np.arange(slides.count)
    start = np.flatnonzero(np.append(True, before[1:] != after[:-1]))  # else it goes on from the one before
    return CableChains(
        *(slides.node, slides.column, before, after, slides.friction, slides.resistance, start, element),
        *(into, out, slides.along[element].astype(np.int64), weight[element]),
    )


class Strands(NamedTuple):
    """The elements of `CableChains` at some positions (q,), [N] and [m].

    EA : 0 where it carries nothing; strand : [m] unstressed length without slip; L : [m] length
    height : [m] of its middle; direction : (q, 3) from begin to end along the cable
    """

    EA: np.ndarray
    strand: np.ndarray
    L: np.ndarray
    height: np.ndarray
    direction: np.ndarray


@part_of_kernel
def _force_of(e, L0, strands, law):
    """Tension [N], q [N], -dT/dL0, -dq/dL0 [N/m] of element e at the unstressed length L0 [m]."""
    EA, L = strands.EA[e], strands.L[e]
    if EA == 0.0 or L <= L0:
        return 0.0, 0.0, 0.0, FLOOR * EA / L0
    if law.logarithmic is not None:
        T = EA * logarithm(L / L0)
        return T, slip_force(T, EA, law), EA / L0, EA * L / (L0 * L0)
    T = EA * ((L - L0) / L0)
    return T, slip_force(T, EA, law), EA * L / (L0 * L0), EA * L * L / (L0 * L0 * L0)


@kernel
def strand_forces(s, chains, strands, weights, law, L0, T, q, coupling, stiffness):
    """Forces of the strands at slips s (k,) [m]: of `_force_of`, the weight's in q. All (q,), out."""
    for e in range(L0.shape[0]):
        L0[e] = strands.strand[e]
        if chains.into[e] >= 0:
            L0[e] += s[chains.into[e]]
        if chains.out[e] >= 0:
            L0[e] -= s[chains.out[e]]
        T[e], q[e], coupling[e], stiffness[e] = _force_of(e, L0[e], strands, law)
        q[e] -= weights * chains.weight[e] * strands.height[e]
        if strands.EA[e] == 0.0:
            q[e] = 0.0


@kernel
def limits_of(chains, strands, T, law, limit):
    """R (k,) [N] of the places at tensions T (q,) [N]."""
    for i in range(limit.shape[0]):
        b, a = chains.before[i], chains.after[i]
        turn, d = 1.0, strands.direction
        if chains.friction[i] > 0.0:
            theta = angle_between(d[b, 0], d[b, 1], d[b, 2], d[a, 0], d[a, 1], d[a, 2])
            turn = exponential(-chains.friction[i] * theta)
        EA = max(strands.EA[b], strands.EA[a])
        limit[i] = 0.0
        if EA > 0.0:
            EA_b, EA_a = (
                strands.EA[b] if strands.EA[b] > 0.0 else EA,
                strands.EA[a] if strands.EA[a] > 0.0 else EA,
            )
            limit[i] = slip_limit(T[b], T[a], EA_b, EA_a, chains.friction[i], chains.resistance[i], turn, law)


@kernel
def residuals(s, old, limit, chains, q, r, way):
    """What drives each place (k,) [N], 0 where it sticks, and its way: 1, -1, 0 sticks; the largest."""
    worst = 0.0
    for i in range(s.shape[0]):
        Q = q[chains.after[i]] - q[chains.before[i]]
        moved = s[i] - old[i]
        way[i] = (
            1 if moved > 0.0 else -1 if moved < 0.0 else 1 if Q > limit[i] else -1 if Q < -limit[i] else 0
        )
        r[i] = Q - way[i] * limit[i] if way[i] != 0 else 0.0
        worst = max(worst, abs(r[i]))
    return worst


@kernel
def solve_chains(chains, way, stiffness, b, pivot, beside, border, out):
    """Slips (k,) [m] that answer forces b (k,) [N] of the places that slip: K_ss^-1 b, chain by chain.

    The last place of a chain is a border, for chains that are closed. pivot, beside, border : (k,), scratch
    """
    for c in range(chains.start.shape[0]):
        first = chains.start[c]
        last = (chains.start[c + 1] if c + 1 < chains.start.shape[0] else way.shape[0]) - 1
        for i in range(first, last + 1):
            pivot[i], beside[i], border[i], out[i] = 1.0, 0.0, 0.0, 0.0
            if way[i] != 0:
                pivot[i] = stiffness[chains.before[i]] + stiffness[chains.after[i]]
                out[i] = b[i]
        for i in range(first, last + 1):
            e = chains.after[i]
            j = chains.out[e]
            if j >= 0 and j != i and way[i] != 0 and way[j] != 0:
                if j == last or i == last:
                    border[min(i, j)] -= stiffness[e]
                else:
                    beside[i] -= stiffness[e]
        whole = pivot[last]
        for i in range(first, last):
            pivot[i] = max(pivot[i], FLOOR)
            share = border[i] / pivot[i]
            if i + 1 < last:
                along = beside[i] / pivot[i]
                pivot[i + 1] -= along * beside[i]
                border[i + 1] -= along * border[i]
                out[i + 1] -= along * out[i]
            pivot[last] -= share * border[i]
            out[last] -= share * out[i]
        pivot[last] = max(pivot[last], FLOOR * whole, FLOOR * FLOOR)
        out[last] /= pivot[last]
        for i in range(last - 1, first - 1, -1):
            out[i] -= border[i] * out[last]
            if i + 1 < last:
                out[i] -= beside[i] * out[i + 1]
            out[i] /= pivot[i]


@kernel
def slips_at(old, limit, chains, strands, weights, law, work, s):
    """The slips s (k,) [m] at given positions, from those of `old` (k,); what is left of forces, relative.

    work : `Work`; its strands are then those at s
    """
    for i in range(s.shape[0]):
        s[i] = old[i]
    scale, worst = 0.0, 0.0
    w = work
    for _ in range(MOST_STEPS):
        strand_forces(s, chains, strands, weights, law, w.L0, w.T, w.q, w.coupling, w.stiffness)
        worst = residuals(s, old, limit, chains, w.q, w.r, w.way)
        for e in range(w.q.shape[0]):
            scale = max(scale, abs(w.T[e]), ROUNDING * strands.EA[e])
        if worst <= NEAR_ZERO * scale:
            return 0.0
        solve_chains(chains, w.way, w.stiffness, w.r, w.pivot, w.beside, w.border, w.step)
        share = 1.0
        for e in range(w.L0.shape[0]):
            into = w.step[chains.into[e]] if chains.into[e] >= 0 else 0.0
            out = w.step[chains.out[e]] if chains.out[e] >= 0 else 0.0
            if strands.EA[e] > 0.0 and share * (into - out) < -0.5 * w.L0[e]:
                share = -0.5 * w.L0[e] / (into - out)
        for i in range(s.shape[0]):
            w.start[i], w.way_before[i], w.r_before[i] = s[i], w.way[i], w.r[i]
        for _ in range(HALVINGS):
            before, after = 0.0, 0.0
            for i in range(s.shape[0]):
                s[i] = w.start[i] + share * w.step[i]
                if limit[i] > 0.0 and (s[i] - old[i]) * w.way_before[i] < 0.0:
                    s[i] = old[i]
            strand_forces(s, chains, strands, weights, law, w.L0, w.T, w.q, w.coupling, w.stiffness)
            residuals(s, old, limit, chains, w.q, w.r, w.way)
            for i in range(s.shape[0]):
                before += w.r_before[i] * (s[i] - w.start[i])
                after += w.r[i] * (s[i] - w.start[i])
            if after >= -0.5 * before:
                break
            share *= 0.5
    return worst / scale


class Work(NamedTuple):
    """What `slips_at` fills: of the elements (q,) L0 to stiffness; of the places (k,) the rest."""

    L0: np.ndarray
    T: np.ndarray
    q: np.ndarray
    coupling: np.ndarray
    stiffness: np.ndarray
    r: np.ndarray
    r_before: np.ndarray
    pivot: np.ndarray
    beside: np.ndarray
    border: np.ndarray
    step: np.ndarray
    start: np.ndarray
    way: np.ndarray
    way_before: np.ndarray


def _work(q: int, k: int) -> Work:
    return Work(*np.zeros((5, q)), *np.zeros((7, k)), *np.zeros((2, k), np.int64))


class SlipTangent(NamedTuple):
    """What slip takes from the tangent stiffness. slips : `Slips`; the others of the positions it is for

    way : (k,) 0 where a place sticks; coupling, stiffness : (q,) of `_force_of`; direction : (q, 3)
    """

    slips: "Slips"
    way: np.ndarray
    coupling: np.ndarray
    stiffness: np.ndarray
    direction: np.ndarray

    def changes(self, u: np.ndarray) -> np.ndarray:
        """Changes (q,) [m] of unstressed lengths as particles move by u (n, 3) [m]. Collective."""
        slips, chains = self.slips, self.slips.chains
        ends = slips.at_ends(u)
        longer = ((ends[:, 3:] - ends[:, :3]) * self.direction).sum(1)
        q = self.coupling * longer - slips.weights * chains.weight * 0.5 * (ends[:, 2] + ends[:, 5])
        forces = q[chains.after] - q[chains.before]
        s, (pivot, beside, border) = np.empty(len(self.way)), np.empty((3, len(self.way)))
        solve_chains(chains, self.way, self.stiffness, forces, pivot, beside, border, s)
        s = np.append(np.where(self.way != 0, s, 0.0), 0.0)
        return s[chains.into] - s[chains.out]

    def soften(self, u: np.ndarray, answer: np.ndarray) -> None:
        """Take from the forces `answer` (n, 3) [N], of the net without slip, what slip takes. Collective."""
        slips = self.slips
        change = self.changes(u)
        tension, weight = -self.coupling * change, 0.5 * slips.weights * slips.chains.weight * change
        for e, _, (a, b) in slips.here:
            pull = tension[e] * self.direction[e]
            answer[b] += pull
            answer[a] -= pull
            answer[a, 2] += weight[e]
            answer[b, 2] += weight[e]

    def add_changes(self, u: np.ndarray, change: np.ndarray) -> None:
        """Add to changes of axial forces (m,) [N] what slip does as particles move by u (n, 3) [m]."""
        slips = self.slips
        tension = -self.coupling * self.changes(u)
        for e, row, _ in slips.here:
            change[row] += tension[e]


class Slips:
    """The slips of a net, known to every rank.

    weights : factor of the self weight that follows the unstressed lengths, 0: none acts
    """

    def __init__(self, distribution: Distribution, state: State, chains: CableChains):
        self.distribution, self.state, self.chains = distribution, state, chains
        self.comm, self.weights = distribution.comm, 0.0
        d = distribution.subdomain
        row = rows_of(d.element_gid, chains.element)
        self.mine = np.flatnonzero((row >= 0) & state.owned.astype(bool)[row])
        self.my_rows = row[self.mine]
        along = lambda e: state.ends[row[e]].astype(int)[
            :: int(chains.along[e])
        ]  # begin and end on the cable
        self.here = [(e, int(row[e]), along(e)) for e in np.flatnonzero(row >= 0).tolist()]
        self.my_ends = np.array([along(e) for e in self.mine.tolist()], int).reshape(-1, 2)
        self.work = _work(len(chains.element), len(chains.node))
        self.old, self.s, self.limit = np.zeros((3, len(chains.node)))
        at = rows_of(d.particle_gid, chains.node)
        self.places = np.flatnonzero(at >= 0)
        self.at = at[self.places], chains.column[self.places]

    def _shared(self, values: np.ndarray) -> np.ndarray:
        """Rows (q, ...) on every rank from those of this rank's own elements. Collective."""
        found = np.zeros((len(self.chains.element), *values.shape[1:]))
        found[self.mine] = values + 0.0
        self.comm.Allreduce(MPI.IN_PLACE, found, MPI.SUM)
        return found

    def at_ends(self, rows: np.ndarray) -> np.ndarray:
        """Rows (n, 3) of particles at both ends of the elements, (q, 6). Collective."""
        return self._shared(rows[self.my_ends].reshape(-1, 6))

    def begin(self) -> None:
        """An equilibrium begins: slips count from here, with limits of the present tensions. Collective."""
        state = self.state
        row = rows_of(self.distribution.subdomain.particle_gid[: state.n_owned], self.chains.node)
        old = np.where(row >= 0, state.slip[row, self.chains.column], 0.0) + 0.0
        self.comm.Allreduce(MPI.IN_PLACE, old, MPI.SUM)
        carries = (state.broken[self.my_rows] == 0) & (state.EA[self.my_rows] > 0.0)
        values = np.column_stack([np.where(carries, state.EA[self.my_rows], 0.0), state.strand[self.my_rows]])
        self.sections = self._shared(values)
        self.old[:] = self.s[:] = old
        self.renew_limits()

    def _strands(self) -> Strands:
        ends = self.at_ends(self.state.x)
        along = ends[:, 3:] - ends[:, :3]
        L = np.sqrt(along[:, 0] ** 2 + along[:, 1] ** 2 + along[:, 2] ** 2)
        EA, strand = np.ascontiguousarray(self.sections.T)
        return Strands(EA, strand, L, 0.5 * (ends[:, 2] + ends[:, 5]), along / np.maximum(L, 1e-300)[:, None])

    def renew_limits(self) -> float:
        """Bring limits up to date with tensions; the largest change, a share of the largest tension."""
        strands, w, before = self._strands(), self.work, self.limit.copy()
        law = self.state.law
        strand_forces(self.s, self.chains, strands, self.weights, law, *w[:5])
        limits_of(self.chains, strands, w.T, law, self.limit)
        largest = np.abs(w.T).max(initial=0.0)
        return float(np.abs(self.limit - before).max(initial=0.0) / largest) if largest > 0.0 else 0.0

    def follow(self) -> Strands:
        """Bring slips and unstressed lengths to the present positions. Collective."""
        strands = self._strands()
        slips_at(
            *(self.old, self.limit, self.chains, strands, self.weights, self.state.law, self.work, self.s)
        )
        self.state.slip[self.at] = self.s[self.places]
        slipped_lengths(self.state.slip, self.state.elements)
        return strands

    def forces(self, x: np.ndarray, f: np.ndarray) -> None:
        """Let slip at x (n, 3), which is the state's own; add to f what weighs more or less. Collective."""
        self.follow()
        if self.weights:
            moved = -0.5 * self.weights * self.chains.weight * (self.work.L0 - self.sections[:, 1])
            for e, _, ends in self.here:
                f[ends, 2] += moved[e]

    def tangent(self) -> SlipTangent:
        """At the present positions. Collective."""
        strands, w = self.follow(), self.work
        taut = w.T > 0.0
        return SlipTangent(
            self, w.way.copy(), np.where(taut, w.coupling, 0.0), w.stiffness.copy(), strands.direction
        )

    def used_up(self) -> np.ndarray:
        """Global numbers of elements of which less than `LEAST` is left, after an equilibrium."""
        return self.chains.element[self.work.L0 < LEAST * self.sections[:, 1]]


def find_slipping(finder, *arguments, **more):
    """`Finder.find` of a net with slips, limits brought up to date until they are those of its tensions.

    Collective. Raises as that, and DivergedError where a strand is used up or friction comes to no end; where
    it is asked to stop, the equilibrium begins anew.
    """
    slips, state = finder.slips, finder.state
    start, slip = state.x.copy(order="K"), state.slip.copy(order="K")
    _, tolerance, _, _, what, *_ = arguments
    slips.begin()
    for _ in range(MOST_ROUNDS):
        try:
            found = finder.find(*arguments, **more)
        except Paused:
            state.x[:], state.slip[:] = start, slip
            slipped_lengths(state.slip, state.elements)
            raise Paused(not_begun(start)) from None
        slips.follow()
        passed = slips.s.copy()
        if slips.renew_limits() <= SETTLED * tolerance:
            return found
        slips.follow()
        if np.array_equal(slips.s, passed):  # limits that are not reached
            return found
    raise DivergedError(f"{what}: friction of what slips did not settle in {MOST_ROUNDS} rounds")
