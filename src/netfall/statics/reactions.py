"""Reactions of an equilibrium, and whether they balance its loads.

Loads P, forces on the foundation R and residual forces r of free nodes satisfy sum P = sum R + sum r, along
each axis and in moments about any point. An element pulls equally at both ends and along its line, also where
its cable slips over a node. Springs and turned supports act at their node. Only bending can violate the
balance, and only that of moments: the torsion of a bending chain is not modelled (`physics.bending`).

Branches of axial damping carry no force in an equilibrium, so the element forces are the tensions.
"""

from typing import Any, NamedTuple

import numpy as np

from netfall.core.arrays import padded_copy
from netfall.core.functions import lengths
from netfall.explicit.energy import Snapshot
from netfall.geometry.turned import support_forces
from netfall.model.model import Model
from netfall.parallel.mpi import MPI
from netfall.parallel.sums import exact_sums
from netfall.physics.bending import add_bending_forces, joint_moments
from netfall.physics.elements import add_axial_forces
from netfall.physics.state import State
from netfall.physics.supports import add_spring_forces, project_on_guides
from netfall.statics.bounds import NEGLIGIBLE, SUM_ROUNDING


class Balance(NamedTuple):
    """Reactions of an equilibrium, and how they balance its loads.

    reaction : (r, 3) [N] on the support of each owned particle: the pull of the elements and the load on the
        node; along an axis with a spring the spring force; 0 along a free axis
    residual_sum : three [N], of all residual forces
    error : |sum P - sum R| along the axis where it is largest, relative to the scale, which is the larger of
        the sum of |R| and the largest tension
    unexplained : share of the scale that neither residual forces nor the tolerance explain, 0.0: nothing
    load : (r, 3) [N] on each owned particle, with the self weight that has slipped to it
    """

    reaction: np.ndarray
    residual_sum: list[float]
    error: float
    unexplained: float
    load: np.ndarray

    def numbers(self) -> dict[str, Any]:
        """Return the scalar fields that a result file records."""
        return {"residual_sum": self.residual_sum, "force_balance_error": self.error}


class BalanceTerms(NamedTuple):
    """Contributions of one rank to a balance.

    x, load, reaction, residual : (r, 3) [m], [N]; moves : (r,) bool; N : (k,) [N] of the owned elements
    hold : (j,) [N m] moments that support the sections, see `bending.joint_moments`
    """

    x: np.ndarray
    load: np.ndarray
    reaction: np.ndarray
    residual: np.ndarray
    moves: np.ndarray
    N: np.ndarray
    hold: np.ndarray


def unknown(state: State) -> Balance:
    """Return the balance of a state that is not an equilibrium, with nan."""
    nan = np.full((len(state.owned_rows()), 3), np.nan)
    return Balance(nan, [np.nan] * 3, np.nan, 0.0, nan)


def compute_balance(
    comm: MPI.Comm,
    state: State,
    snapshot: Snapshot,
    load: np.ndarray,
    residual: float,
    tolerance: float,
    slips: Any = None,
) -> Balance:
    """Compute the balance of an equilibrium under loads (n, 3) [N]. Collective.

    residual : [N], the largest that the equilibrium search reports; tolerance : of that search
    slips : `statics.slip.Slips`, whose weights have moved between nodes; None: no sliding cables
    """
    rows, joints = snapshot.rows, state.joints
    if slips is not None:
        load = load.copy()
        slips.add_moved_weights(load)
    pull, hold = np.zeros_like(state.x), np.zeros(0)
    add_axial_forces(state.x, state.ends, snapshot.N, snapshot.observation.now.L, pull)
    if joints is not None:
        add_bending_forces(state.x, joints, pull)
        moment, all_hold = np.empty((2, len(joints.stiffness)))
        joint_moments(state.x, joints, moment, all_hold)
        hold = all_hold[joints.owned != 0]
    total, free = pull[rows] + load[rows], state.free[rows] != 0
    reaction = np.where(free, 0.0, total)
    if state.turned is not None:
        guided = total.copy()
        project_on_guides(state.turned[rows], guided)
        reaction[:, :2] += np.where(free, total - guided, 0.0)[:, :2]
    if state.features.springs:
        turned, force = np.zeros((0, 3)) if state.turned is None else state.turned, np.zeros_like(state.x)
        add_spring_forces(state.x, state.x_start, state.spring, state.spring_rest, turned, force)
        reaction -= np.where(free, force[rows], 0.0)
    N = snapshot.N[state.owned != 0]
    parts = BalanceTerms(state.x[rows], load[rows], reaction, total - reaction, free.any(1), N, hold)
    return sum_balance(comm, parts, residual, tolerance)


def compute_form_balance(model: Model, residual: float, tolerance: float) -> Balance:
    """Compute the balance of the form of a model, as `compute_balance` does. Rank 0.

    Axes with springs are fixed in the form: the reaction becomes the initial spring force.
    """
    net, x, load, hold = model.net, model.x, model.form_load, np.zeros(0)
    start, end = net.elements.T
    chord, pull = x[end] - x[start], np.zeros_like(x)
    force = (model.N / lengths(chord))[:, None] * chord
    np.add.at(pull, start, force)
    np.subtract.at(pull, end, force)
    if model.joints is not None:
        pull = np.asfortranarray(pull)  # memory order of the arrays of a State
        add_bending_forces(padded_copy(x), model.joints, pull)
        pull, (moment, hold) = np.ascontiguousarray(pull), np.empty((2, len(model.joints.stiffness)))
        joint_moments(padded_copy(x), model.joints, moment, hold)
    total, held = pull + load, net.held
    reaction = support_forces(net, held, total)
    parts = BalanceTerms(x, load, reaction, total - reaction, np.asarray(~held.all(1)), model.N, hold)
    return sum_balance(MPI.COMM_SELF, parts, residual, tolerance)


def sum_balance(comm: MPI.Comm, parts: BalanceTerms, residual: float, tolerance: float) -> Balance:
    """Combine the contributions of all ranks; bitwise the same on any number of ranks. Collective."""
    x, P, R, r, moves, N, hold = parts
    corners = np.concatenate([x, -x], axis=1).max(0, initial=-np.inf)
    extremes = np.append(corners, np.abs(N).max(initial=0.0))
    comm.Allreduce(MPI.IN_PLACE, extremes, MPI.MAX)
    centre, extent, tension = 0.5 * (extremes[:3] - extremes[3:6]), extremes[:3] + extremes[3:6], extremes[6]
    moments = np.cross(x - centre, P - R - r)
    columns = *P.T, *R.T, *r.T, *moments.T, lengths(R), np.abs(N), moves, hold
    sums = np.array(exact_sums(comm, *columns))
    load_sum, reaction_sum, residual_sum, moment_sum = sums[:12].reshape(4, 3)
    absolute, tensions, moving, held = sums[12:]
    scale, reach = max(absolute, tension), float(extent.max())
    if not scale > 0.0:
        return Balance(R, residual_sum.tolist(), 0.0, 0.0, P)
    rounded = NEGLIGIBLE * scale + SUM_ROUNDING * tensions
    error = np.abs(load_sum - reaction_sum).max()
    excess = [
        (np.abs(load_sum - reaction_sum - residual_sum).max() - rounded) / scale,
        (error - rounded - moving * residual - tolerance * scale) / scale,
        (np.abs(moment_sum).max() - rounded * reach - held) / (scale * reach) if reach > 0.0 else 0.0,
    ]
    return Balance(R, residual_sum.tolist(), float(error / scale), max(0.0, *map(float, excess)), P)
