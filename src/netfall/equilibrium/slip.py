"""Equilibria in which cables slip over nodes.

For positions x the slips s make W(x, s) = strain energy + potential of the self weight + sum R |s - s_old|
smallest: each place sticks while |Q| <= R, else |Q| = R (`mechanics.slip.law`), and where a fifth of a strand
is left an end on the cable stops it (a stiff spring, `strands.STOP`). W is convex in s, so that Newton's
method on the set that slips finds them, with steps that end where one would turn round. The forces on the
nodes are the gradient of that smallest W; its tangent is the net's, less what slips: K_xx - K_xs K_ss^-1
K_sx. So an equilibrium is found as without slip, the slips of every trial included.

Within an equilibrium R is constant; it is brought up to date with the tensions, from the same start, until it
does not change. What comes of friction depends on the path: s_old is that of the last equilibrium.

Every rank computes all slips from the same positions: so they have the same bits on any number of ranks.
"""

from typing import NamedTuple

import numpy as np

from netfall.equilibrium.relaxation import Paused, not_begun
from netfall.equilibrium.strands import (
    STOP,
    CableChains,
    Strands,
    limits_of,
    make_work,
    slips_at,
    solve_chains,
    strand_forces,
)
from netfall.ground.errors import DivergedError
from netfall.mechanics.slip.law import LEAST, slipped_lengths
from netfall.mechanics.state import State
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution, rows_of

INEXACT = 1e-8  # of the largest tension: what may be left of the forces on slips at the end
SETTLED = 0.1  # of the tolerance: what limits may still change
MOST_ROUNDS = 100  # of limits brought up to date with tensions


class SlipTangent(NamedTuple):
    """What slip takes from the tangent stiffness. slips : `Slips`; the others of the positions it is for

    way : (k,) 0 where a place sticks; coupling, stiffness : (q,) of `_force_of`; direction : (q, 3)
    hold : (g,) of `strand_forces`
    """

    slips: "Slips"
    way: np.ndarray
    coupling: np.ndarray
    stiffness: np.ndarray
    hold: np.ndarray
    direction: np.ndarray

    def changes(self, u: np.ndarray) -> np.ndarray:
        """Changes (q,) [m] of unstressed lengths as particles move by u (n, 3) [m]. Collective."""
        slips, chains = self.slips, self.slips.chains
        ends = slips.at_ends(u)
        longer = ((ends[:, 3:] - ends[:, :3]) * self.direction).sum(1)
        return self._answer(
            self.coupling * longer - slips.weights * chains.weight * 0.5 * (ends[:, 2] + ends[:, 5])
        )

    def of_strands(self, change: np.ndarray) -> np.ndarray:
        """Changes (m,) [m] of unstressed lengths, at fixed nodes: `change`, and what slips. Collective."""
        slips, found = self.slips, change.copy()
        answer = self._answer(-self.stiffness * slips.shared(change[slips.my_rows]))
        for e, row, _ in slips.here:
            found[row] += answer[e]
        return found

    def _answer(self, q: np.ndarray) -> np.ndarray:
        """Changes (q,) [m] of unstressed lengths that answer changes (q,) [N] of what drives slips."""
        chains = self.slips.chains
        drive = chains.by_segment(q)
        forces = drive[chains.segment_after] - drive[chains.segment_before]
        s, (pivot, beside, border) = np.empty(len(self.way)), np.empty((3, len(self.way)))
        solve_chains(chains, self.way, self.hold, forces, pivot, beside, border, s)
        return chains.passed(np.where(self.way != 0, s, 0.0))

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
    held : whether everything sticks; left : of the forces on slips, a share of the largest tension
    """

    def __init__(self, distribution: Distribution, state: State, chains: CableChains):
        self.distribution, self.state, self.chains = distribution, state, chains
        self.comm, self.weights, self.left = distribution.comm, 0.0, 0.0
        self.held, self.resistance = False, chains.resistance
        d = distribution.subdomain
        row = rows_of(d.element_gid, chains.element)
        self.mine = np.flatnonzero(np.isin(row, np.flatnonzero(state.owned)))
        self.my_rows = row[self.mine]
        along = lambda e: state.ends[row[e]].astype(int)[
            :: int(chains.along[e])
        ]  # begin and end on the cable
        self.rows = np.flatnonzero(row >= 0), row[row >= 0]
        self.here = [(e, int(row[e]), along(e)) for e in np.flatnonzero(row >= 0).tolist()]
        self.my_ends = np.array([along(e) for e in self.mine.tolist()], int).reshape(-1, 2)
        self.work = make_work(len(chains.element), len(chains.into), len(chains.node))
        self.old, self.s, self.limit = np.zeros((3, len(chains.node)))
        at = rows_of(d.particle_gid, chains.node)
        self.places = np.flatnonzero(at >= 0)
        self.at = at[self.places], chains.column[self.places]

    def shared(self, values: np.ndarray) -> np.ndarray:
        """Rows (q, ...) on every rank from those of this rank's own elements. Collective."""
        found = np.zeros((len(self.chains.element), *values.shape[1:]))
        found[self.mine] = values + 0.0
        self.comm.Allreduce(MPI.IN_PLACE, found, MPI.SUM)
        return found

    def at_ends(self, rows: np.ndarray) -> np.ndarray:
        """Rows (n, 3) of particles at both ends of the elements, (q, 6). Collective."""
        return self.shared(rows[self.my_ends].reshape(-1, 6))

    def open_clamps(self, opened: bool) -> None:
        """Leave clamps of the net without resistance, or close them."""
        self.chains = self.chains.replaced(resistance=self.resistance * (not opened))

    def begin(self) -> None:
        """An equilibrium begins: slips count from here, with limits of the present tensions. Collective."""
        state = self.state
        row, column = self.at
        old, own = np.zeros(len(self.s)), row < state.n_owned
        old[self.places[own]] = state.slip[row[own], column[own]] + 0.0
        self.comm.Allreduce(MPI.IN_PLACE, old, MPI.SUM)
        carries = (state.broken[self.my_rows] == 0) & (state.EA[self.my_rows] > 0.0)
        values = np.column_stack([np.where(carries, state.EA[self.my_rows], 0.0), state.strand[self.my_rows]])
        self.sections = self.shared(values)
        torn = np.bincount(self.chains.segment, self.sections[:, 0] == 0.0) > 0
        self.sections[torn[self.chains.segment], 0] = 0.0  # with one element the segment carries nothing
        self.stop = STOP * self.sections[:, 0].max(initial=0.0) / self.sections[:, 1]
        self.old[:] = self.s[:] = old
        self.renew_limits()

    def numbers(self) -> tuple[np.ndarray, int]:
        """Which of all places each of `State.places` is, (places,); how many there are."""
        row, column = self.at
        order = np.lexsort((column, row))
        return self.places[order][row[order] < self.state.n_owned], len(self.s)

    def weigh(self, factor: float) -> None:
        """Leave to particles and slips, as constant loads, what weighs at present, and its pull at slips.

        factor : of the self weight. For the dynamic stage, in which weights follow slips no more. Collective.
        """
        self.begin()
        state, ends = self.state, self.at_ends(self.state.x)
        there = self.sections[:, 0] > 0.0
        weight = np.where(there, factor * self.chains.weight, 0.0)
        pull = self.chains.by_segment(weight * 0.5 * (ends[:, 2] + ends[:, 5]))
        pulls = pull[self.chains.segment_before] - pull[self.chains.segment_after]
        state.slip_load[self.at] = pulls[self.places]
        moved = -0.5 * weight * self.chains.passed(self.s)
        for e, _, both in self.here:
            state.load[both, 2] += moved[e]

    def _strands(self) -> Strands:
        ends = self.at_ends(self.state.x)
        along = ends[:, 3:] - ends[:, :3]
        L = np.sqrt(along[:, 0] ** 2 + along[:, 1] ** 2 + along[:, 2] ** 2)
        EA, strand = np.ascontiguousarray(self.sections.T)
        return Strands(
            EA, strand, self.stop, L, 0.5 * (ends[:, 2] + ends[:, 5]), along / np.maximum(L, 1e-300)[:, None]
        )

    def renew_limits(self) -> float:
        """Bring limits up to date with tensions; the largest change, a share of the largest tension."""
        strands, w, before = self._strands(), self.work, self.limit.copy()
        law, of_strands = self.state.law, (w.L0, w.T, w.q, w.coupling, w.stiffness)
        strand_forces(self.s, self.chains, strands, self.weights, law, *of_strands, w.drive, w.hold)
        limits_of(self.chains, strands, w.T, law, self.limit)
        largest = np.abs(w.T).max(initial=0.0)
        return float(np.abs(self.limit - before).max(initial=0.0) / largest) if largest > 0.0 else 0.0

    def follow(self) -> Strands:
        """Bring slips and unstressed lengths to the present positions. Collective."""
        strands = self._strands()
        limit = self.limit + np.inf if self.held else self.limit
        self.left = slips_at(
            *(self.old, limit, self.chains, strands, self.weights, self.state.law, self.work, self.s)
        )
        self.state.slip[self.at] = self.s[self.places]
        carries = self.sections[self.rows[0], 0] > 0.0  # what is torn keeps its length
        e, row = (each[carries] for each in self.rows)
        self.state.L0[row] = self.work.L0[e]
        return strands

    def forces(self, x: np.ndarray, f: np.ndarray) -> None:
        """Let slip at x (n, 3), which is the state's own; add to f what weighs more or less. Collective."""
        self.follow()
        self.add_moved_weights(f)

    def add_moved_weights(self, f: np.ndarray) -> None:
        """Add to f (n, 3) [N] the self weight that the slips, as they are now, move from node to node."""
        if self.weights:
            moved = -0.5 * self.weights * self.chains.weight * (self.work.L0 - self.sections[:, 1])
            for e, _, ends in self.here:
                f[ends, 2] += moved[e]

    def tangent(self) -> SlipTangent:
        """At the present positions. Collective."""
        strands, w = self.follow(), self.work
        taut = w.T > 0.0
        return SlipTangent(
            *(self, w.way.copy(), np.where(taut, w.coupling, 0.0), w.stiffness.copy(), w.hold.copy()),
            strands.direction,
        )

    def tangent_at_rest(self) -> SlipTangent:
        """Where the net is, with what pulleys let pass; what has friction or a clamp sticks. Collective."""
        self.begin()
        w, loose = self.work, (self.chains.friction == 0.0) & (self.chains.resistance == 0.0)
        coupling = np.where(w.T > 0.0, w.coupling, 0.0)
        return SlipTangent(
            *(self, loose.astype(np.int64), coupling, w.stiffness.copy(), w.hold.copy()),
            self._strands().direction,
        )

    def stopped(self) -> tuple[int, ...]:
        """Global numbers of elements that their end stops, after an equilibrium."""
        return tuple(self.chains.element[self.work.L0 < LEAST * self.sections[:, 1]].tolist())


def _near(slips: Slips, finder, arguments: tuple, more: dict) -> None:
    """Bring the net to the equilibrium in which everything sticks, from where friction is easier to find.

    Where there is none, or a stop is asked for, it stays where it is. Collective.
    """
    before, slips.held = finder.state.x.copy(order="K"), True
    try:
        finder.find(*arguments, **more)
    except (DivergedError, Paused):
        finder.state.x[:] = before
    slips.held = False


def find_slipping(finder, *arguments, **more):
    """`Finder.find` of a net with slips, limits brought up to date until they are those of its tensions.

    Collective. Raises as that, and DivergedError where friction comes to no end; where it is asked to stop,
    the equilibrium begins anew.
    """
    slips, state = finder.slips, finder.state
    start, slip = state.x.copy(order="K"), state.slip.copy(order="K")
    _, tolerance, _, _, what, *_ = arguments
    slips.begin()
    if slips.limit.any():
        _near(slips, finder, arguments, more)
    for _ in range(MOST_ROUNDS):
        try:
            found = finder.find(*arguments, **more)
        except Paused:
            state.x[:], state.slip[:] = start, slip
            slipped_lengths(state.particles.slip, state.elements)
            raise Paused(not_begun(start)) from None
        slips.follow()
        if not slips.left <= INEXACT:
            raise DivergedError(f"{what}: the slips of cables over nodes were not found")
        passed = slips.s.copy()
        if slips.renew_limits() <= SETTLED * tolerance:
            return found
        slips.follow()
        if np.array_equal(slips.s, passed):  # limits that are not reached
            return found
    raise DivergedError(f"{what}: friction of what slips did not settle in {MOST_ROUNDS} rounds")
