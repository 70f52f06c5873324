"""Equilibria of nets with sliding cables.

For positions x the slips s minimise W(x, s) = strain energy + potential of the self weight + sum R |s -
s_old|. A slip point sticks while |Q| <= R and slips with |Q| = R (`physics.slip.law`). When a fifth of a
free segment is left, a stop on the cable ends the slip (a stiff spring, `free_segments.STOP_STIFFNESS`). W is
convex in s, so Newton's method on the slip points that slip finds the minimum. Its steps end where a slip
would reverse. The forces on the nodes are the gradient of the minimum of W. The tangent is that of the net
without slip, reduced by what slips: K_xx - K_xs K_ss^-1 K_sx. So an equilibrium is found as without slip, and
every trial includes the slips.

R is constant within one search for an equilibrium. It is then updated with the tensions, and the search
starts again from the same positions, until R does not change. If R alternates, it goes part of the way.
The effect of friction depends on the path: s_old is the slip of the last equilibrium.

Every rank computes all slips from the same positions, so they have the same bits on any number of ranks.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, final

import numpy as np

from netfall.core.arrays import rows_of
from netfall.core.errors import DivergedError
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.physics.slip.law import MIN_SEGMENT_SHARE
from netfall.physics.state import State
from netfall.statics import free_segments, messages
from netfall.statics.bounds import MOST_STEPS, SETTLED_CHANGE
from netfall.statics.newton import Solution


class SlipTangent(NamedTuple):
    """Reduction of the tangent stiffness by slip, at the positions of construction. slips : `Slips`

    way : (k,) 0 if a slip point sticks; coupling, stiffness : (q,) of `_force_of`; direction : (q, 3)
    k_slip : (g,) of `compute_slip_forces`
    """

    slips: "Slips"
    way: np.ndarray
    coupling: np.ndarray
    stiffness: np.ndarray
    k_slip: np.ndarray
    direction: np.ndarray

    def changes(self, u: np.ndarray) -> np.ndarray:
        """Compute the changes (q,) [m] of unstressed lengths if particles move by u (n, 3) [m].

        Collective.
        """
        slips, chains = self.slips, self.slips.chains
        ends = slips.at_ends(u)
        elongation = ((ends[:, 3:] - ends[:, :3]) * self.direction).sum(1)
        return self._answer(
            self.coupling * elongation - slips.weights * chains.weight * 0.5 * (ends[:, 2] + ends[:, 5])
        )

    def length_changes(self, change: np.ndarray) -> np.ndarray:
        """Compute the changes (m,) [m] of unstressed lengths at fixed nodes, slip included. Collective.

        change : (m,) [m], prescribed
        """
        slips, total = self.slips, change.copy()
        slipped = self._answer(-self.stiffness * slips.shared(change[slips.own_rows]))
        for e, row, _ in slips.local_elements:
            total[row] += slipped[e]
        return total

    def _answer(self, q: np.ndarray) -> np.ndarray:
        """Compute changes (q,) [m] of unstressed lengths from changes q (q,) [N] of the driving forces."""
        chains = self.slips.chains
        drive = chains.by_segment(q)
        forces = drive[chains.segment_after] - drive[chains.segment_before]
        s, (pivot, off_diagonal, border) = np.empty(len(self.way)), np.empty((3, len(self.way)))
        free_segments.solve_chains(chains, self.way, self.k_slip, forces, pivot, off_diagonal, border, s)
        return chains.passed(np.where(self.way != 0, s, 0.0))

    def subtract_slip(self, u: np.ndarray, answer: np.ndarray) -> None:
        """Subtract the effect of slip from forces `answer` (n, 3) [N] of the net without slip. Collective."""
        slips = self.slips
        length_change = self.changes(u)
        tension = -self.coupling * length_change
        weight = 0.5 * slips.weights * slips.chains.weight * length_change
        for e, _, (a, b) in slips.local_elements:
            pull = tension[e] * self.direction[e]
            answer[b] += pull
            answer[a] -= pull
            answer[a, 2] += weight[e]
            answer[b, 2] += weight[e]

    def add_changes(self, u: np.ndarray, change: np.ndarray) -> None:
        """Add the effect of slip to changes of axial forces (m,) [N] if particles move by u (n, 3) [m].

        Collective.
        """
        slips = self.slips
        tension = -self.coupling * self.changes(u)
        for e, row, _ in slips.local_elements:
            change[row] += tension[e]


@final
class Slips:
    """Slips of a net, known to every rank.

    weights : factor of the self weight that follows the unstressed lengths, 0: none acts
    all_stick : whether no slip point slips; residual : force on slips over the largest tension
    """

    def __init__(self, distribution: Distribution, state: State, chains: free_segments.SlipChains):
        self.distribution, self.state, self.chains = distribution, state, chains
        self.comm, self.weights, self.residual = distribution.comm, 0.0, 0.0
        self.all_stick, self.resistance = False, chains.resistance
        d = distribution.subdomain
        row = rows_of(d.element_gid, chains.element)
        self.own = np.flatnonzero(np.isin(row, np.flatnonzero(state.owned)))
        self.own_rows = row[self.own]

        def along(e: int) -> np.ndarray:
            ends = state.ends[row[e]].astype(int)
            return ends[:: int(chains.along[e])]  # from begin to end along the cable

        self.rows = np.flatnonzero(row >= 0), row[row >= 0]
        self.local_elements = [(e, int(row[e]), along(e)) for e in np.flatnonzero(row >= 0).tolist()]
        self.own_ends = np.array([along(e) for e in self.own.tolist()], int).reshape(-1, 2)
        self.work = free_segments.allocate_slip_scratch(
            len(chains.element), len(chains.slip_in), len(chains.node)
        )
        self.old, self.s, self.limit = np.zeros((3, len(chains.node)))
        at = rows_of(d.particle_gid, chains.node)
        self.local_points = np.flatnonzero(at >= 0)
        self.at = at[self.local_points], chains.column[self.local_points]

    def shared(self, values: np.ndarray) -> np.ndarray:
        """Share rows (q, ...) of this rank's own elements with every rank. Collective."""
        rows = np.zeros((len(self.chains.element), *values.shape[1:]))
        rows[self.own] = values + 0.0
        self.comm.Allreduce(MPI.IN_PLACE, rows, MPI.SUM)
        return rows

    def at_ends(self, rows: np.ndarray) -> np.ndarray:
        """Collect rows (n, 3) of the particles at both ends of the elements, (q, 6). Collective."""
        return self.shared(rows[self.own_ends].reshape(-1, 6))

    def open_clamps(self, opened: bool) -> None:
        """Set the slip resistance of the clamps to zero, or restore it."""
        self.chains = self.chains.with_values(resistance=self.resistance * (not opened))

    def begin(self) -> None:
        """Start an equilibrium: slips count from here, slip resistances follow the present tensions.

        Collective.
        """
        state = self.state
        row, column = self.at
        slips, is_owned = np.zeros(len(self.s)), row < state.n_owned
        slips[self.local_points[is_owned]] = state.slip[row[is_owned], column[is_owned]] + 0.0
        self.comm.Allreduce(MPI.IN_PLACE, slips, MPI.SUM)
        carries = (state.broken[self.own_rows] == 0) & (state.EA[self.own_rows] > 0.0)
        values = np.column_stack(
            [np.where(carries, state.EA[self.own_rows], 0.0), state.strand[self.own_rows]]
        )
        self.sections = self.shared(values)
        self.shortest = self.shared(
            MIN_SEGMENT_SHARE * ((1.0 - state.stage_slip[self.own_rows]) * values[:, 1])
        )
        is_torn = np.bincount(self.chains.segment, self.sections[:, 0] == 0.0) > 0
        # a segment carries nothing if one of its elements carries nothing
        self.sections[is_torn[self.chains.segment], 0] = 0.0
        self.stop = free_segments.STOP_STIFFNESS * self.sections[:, 0].max(initial=0.0) / self.sections[:, 1]
        self.old[:] = self.s[:] = slips
        self.update_resistances()

    def numbers(self) -> tuple[np.ndarray, int]:
        """Return indices (points,) of `State.slip_points` among all slip points, and the number of all."""
        row, column = self.at
        order = np.lexsort((column, row))
        return self.local_points[order][row[order] < self.state.n_owned], len(self.s)

    def freeze_weights(self, factor: float) -> None:
        """Convert the self weight and its pull at slip points to constant loads. Collective.

        factor : of the self weight. Serves the dynamic stage, in which weights do not follow slips.
        """
        self.begin()
        state, ends = self.state, self.at_ends(self.state.x)
        carries = self.sections[:, 0] > 0.0
        weight = np.where(carries, factor * self.chains.weight, 0.0)
        pull = self.chains.by_segment(weight * 0.5 * (ends[:, 2] + ends[:, 5]))
        pulls = pull[self.chains.segment_before] - pull[self.chains.segment_after]
        state.slip_load[self.at] = pulls[self.local_points]
        shifted = -0.5 * weight * self.chains.passed(self.s)
        for e, _, pair in self.local_elements:
            state.load[pair, 2] += shifted[e]

    def _elements(self) -> free_segments.SlipElements:
        ends = self.at_ends(self.state.x)
        along = ends[:, 3:] - ends[:, :3]
        L = np.sqrt(along[:, 0] ** 2 + along[:, 1] ** 2 + along[:, 2] ** 2)
        EA, strand = np.ascontiguousarray(self.sections.T)
        return free_segments.SlipElements(
            EA,
            strand,
            self.stop,
            self.shortest,
            L,
            0.5 * (ends[:, 2] + ends[:, 5]),
            along / np.maximum(L, 1e-300)[:, None],
        )

    def update_resistances(self) -> tuple[float, float]:
        """Update slip resistances with the tensions; return the largest change and tension [N]."""
        elements, w, previous = self._elements(), self.work, self.limit.copy()
        law = self.state.law
        free_segments.compute_slip_forces(
            self.s, self.old, self.limit, self.chains, elements, self.weights, law, w
        )
        free_segments.compute_slip_limits(self.chains, elements, w.T, law, self.limit)
        return float(np.abs(self.limit - previous).max(initial=0.0)), float(np.abs(w.T).max(initial=0.0))

    def follow(self) -> free_segments.SlipElements:
        """Update slips and unstressed lengths to the present positions. Collective."""
        elements = self._elements()
        limit = self.limit + np.inf if self.all_stick else self.limit
        self.residual = free_segments.solve_slips(
            self.old, limit, self.chains, elements, self.weights, self.state.law, self.work, self.s
        )
        self.state.slip[self.at] = self.s[self.local_points]
        carries = self.sections[self.rows[0], 0] > 0.0  # torn elements keep their length
        e, row = (rows[carries] for rows in self.rows)
        self.state.L0[row] = self.work.L0[e]
        return elements

    def forces(self, x: np.ndarray, f: np.ndarray) -> None:
        """Update the slips at x (n, 3), the positions of the state; add the shift of self weight to f.

        Collective.
        """
        self.follow()
        self.add_moved_weights(f)

    def add_moved_weights(self, f: np.ndarray) -> None:
        """Add to f (n, 3) [N] the self weight that the present slips move from node to node."""
        if self.weights:
            shifted = -0.5 * self.weights * self.chains.weight * (self.work.L0 - self.sections[:, 1])
            for e, _, ends in self.local_elements:
                f[ends, 2] += shifted[e]

    def tangent(self) -> SlipTangent:
        """Return the reduction of the tangent at the present positions. Collective."""
        direction = self.follow().direction
        return self._tangent(self.work.way.copy(), direction)

    def pulley_tangent(self) -> SlipTangent:
        """Return the reduction of the tangent by frictionless pulleys; all other slip points stick.

        Collective.
        """
        self.begin()
        is_loose = (self.chains.friction == 0.0) & (self.chains.resistance == 0.0)
        return self._tangent(is_loose.astype(np.int64), self._elements().direction)

    def _tangent(self, way: np.ndarray, direction: np.ndarray) -> SlipTangent:
        w = self.work
        coupling = np.where(w.T > 0.0, w.coupling, 0.0)
        return SlipTangent(self, way, coupling, w.stiffness.copy(), w.k_slip.copy(), direction)

    def datasets(self, in_equilibrium: bool = True) -> dict[str, list[float]]:
        """Return slip [m] and the force against slip [N] as datasets (k,); nan: not in equilibrium."""
        drive, chains = self.work.drive, self.chains
        force = drive[chains.segment_after] - drive[chains.segment_before]
        force = force if in_equilibrium else np.full(len(self.s), np.nan)
        return {"slip": self.s.tolist(), "slip_force": force.tolist()}

    def stopped(self) -> tuple[int, ...]:
        """Return the global numbers of elements whose stop is reached, after an equilibrium."""
        return tuple(self.chains.element[self.work.L0 < self.shortest].tolist())


def find_with_slip(finder: Any, find: Callable[[], Solution], tolerance: float, name: str) -> Solution:
    """Find the equilibrium of a net with sliding cables, with slip resistances consistent with tensions.

    Collective. find() : calls `EquilibriumFinder.find` for the load; tolerance, name : as given to that

    Raises as `find` does, and DivergedError if friction does not converge.
    """
    slips, state = finder.slips, finder.state
    start = state.x.copy(order="K")
    slips.begin()
    if slips.chains.friction.any() or slips.limit.any():
        slips.all_stick = True  # the equilibrium in which everything sticks is a better start
        try:
            find()
        except DivergedError:
            state.x[:] = start
        slips.all_stick = False
        if not slips.limit.any():  # a straight cable has no friction before a load bends it
            slips.update_resistances()
    rises, last_change, largest = 0, np.inf, 0.0
    for _ in range(MOST_STEPS):
        solution = find()
        slips.follow()
        if not slips.residual <= SETTLED_CHANGE * tolerance:
            raise DivergedError(messages.SLIPS_NOT_CONVERGED(name=name))
        slips_before, limit = slips.s.copy(), slips.limit.copy()
        change, tension = slips.update_resistances()
        largest = max(largest, tension)  # a cable that becomes slack loses its tension with its resistance
        allowed = SETTLED_CHANGE * tolerance * largest
        if change <= allowed:
            return solution
        slips.follow()
        if np.array_equal(slips.s, slips_before):  # resistances of points that stick do not matter
            return solution
        rises, last_change = rises + (change >= last_change), change
        if rises > 1:  # they alternate
            slips.limit[:] = limit + 0.5 ** (rises - 1) * (slips.limit - limit)
    raise DivergedError(
        messages.FRICTION_NOT_CONVERGED(name=name, change=change, rounds=MOST_STEPS, allowed=allowed)
    )
