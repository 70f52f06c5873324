"""Reactions of an equilibrium, and whether they balance its loads.

Loads P, forces on the foundation R and residual forces r of what can move satisfy sum P = sum R + sum r, both
along each axis and in moments about any point. An element pulls at both ends alike and along its line, also
where its cable slips over a node. Springs and turned supports act at their node. Only bending may miss, and
in moments alone: torsion, which would hold the sections of a chain, is left out (`mechanics.bending`).

Branches of axial damping carry nothing in an equilibrium, so the forces of the elements are their tensions.
"""

from typing import NamedTuple

import numpy as np

from netfall.ground.columns import placed
from netfall.mechanics.bending import add_bending_forces, joint_moments
from netfall.mechanics.elements import add_tensions
from netfall.mechanics.state import State
from netfall.mechanics.supports import keep_on_guides, spring_forces
from netfall.model.model import Model
from netfall.net.turned import on_held
from netfall.numerics.functions import lengths
from netfall.parallel.mpi import MPI
from netfall.parallel.sums import exact_sums
from netfall.record.energy import Snapshot

ROUNDED = 1e-9  # of the scale of `Balance`: what rounding of reactions and residuals may leave of a sum
ROUNDED_TENSION = 1e-12  # of the sum of tensions: the same of forces that cancel within the net


class Balance(NamedTuple):
    """Reactions of an equilibrium, and how they balance its loads.

    reaction : (r, 3) [N] on what holds each owned particle: the pull of the elements and the load on the
        node, along an axis with a spring what the spring carries; 0 along an axis that nothing holds
    residual_sum : three [N], of all residual forces
    error : |sum P - sum R| along the axis where it is largest, as a share of the scale, which is the sum of
        |R|, or the largest tension if that is more
    unexplained : share of the scale that neither residual forces nor the tolerance explain, 0.0: nothing
    """

    reaction: np.ndarray
    residual_sum: list[float]
    error: float
    unexplained: float

    def numbers(self) -> dict:
        """What a result file keeps of it besides the reactions."""
        return {"residual_sum": self.residual_sum, "force_balance_error": self.error}


class Parts(NamedTuple):
    """What takes part in a balance, on one rank.

    x, load, reaction, residual : (r, 3) [m], [N]; moves : (r,) bool; N : (k,) [N] of elements that it owns
    hold : (j,) [N m] moments that hold sections, see `bending.joint_moments`
    """

    x: np.ndarray
    load: np.ndarray
    reaction: np.ndarray
    residual: np.ndarray
    moves: np.ndarray
    N: np.ndarray
    hold: np.ndarray


def unknown(state: State) -> Balance:
    """The balance of a state that is no equilibrium."""
    nan = np.full((len(state.owned_rows()), 3), np.nan)
    return Balance(nan, [np.nan] * 3, np.nan, 0.0)


def balance_of(
    comm: MPI.Comm, state: State, snapshot: Snapshot, load: np.ndarray, residual: float, tolerance, slips=None
) -> Balance:
    """The balance of an equilibrium under loads (n, 3) [N]. Collective.

    residual : [N], the largest that its search reports; tolerance : that it was found with
    slips : `equilibrium.slip.Slips`, whose weights have moved from node to node; None: nothing slips
    """
    rows, joints = snapshot.rows, state.joints
    if slips is not None:
        load = load.copy()
        slips.add_moved_weights(load)
    pull, hold = np.zeros_like(state.x), np.zeros(0)
    add_tensions(state.x, state.ends, snapshot.N, snapshot.room.now.L, pull)
    if joints is not None:
        add_bending_forces(state.x, joints, pull)
        moment, every = np.empty((2, len(joints.stiffness)))
        joint_moments(state.x, joints, moment, every)
        hold = every[joints.owned != 0]
    total, free = pull[rows] + load[rows], state.free[rows] != 0
    reaction = np.where(free, 0.0, total)
    if state.turned is not None:
        left = total.copy()
        keep_on_guides(state.turned[rows], left)
        reaction[:, :2] += np.where(free, total - left, 0.0)[:, :2]
    if state.features.springs:
        springs = (array[rows] for array in (state.x, state.x_start, state.spring, state.spring_rest))
        turned = None if state.turned is None else state.turned[rows]
        reaction -= np.where(free, spring_forces(*springs, turned), 0.0)
    N = snapshot.N[state.owned != 0]
    parts = state.x[rows], load[rows], reaction, total - reaction, free.any(1), N, hold
    return summed(comm, Parts(*parts), residual, tolerance)


def balance_in_form(model: Model, load: np.ndarray, residual: float, tolerance: float) -> Balance:
    """The balance of the form of a model under loads (n, 3) [N], as of `balance_of`. Rank 0.

    Axes with springs are held in it: the springs then begin with the reaction.
    """
    net, x, hold = model.net, model.x, np.zeros(0)
    start, end = net.elements.T
    along, pull = x[end] - x[start], np.zeros_like(x)
    each = (model.N / lengths(along))[:, None] * along
    np.add.at(pull, start, each)
    np.subtract.at(pull, end, each)
    if model.joints is not None:
        pull = np.asfortranarray(pull)  # as in a state
        add_bending_forces(placed(x), model.joints, pull)
        pull, (moment, hold) = np.ascontiguousarray(pull), np.empty((2, len(model.joints.stiffness)))
        joint_moments(placed(x), model.joints, moment, hold)
    total, held = pull + load, net.fixed | (net.spring > 0)
    reaction = on_held(net, held, total)
    parts = Parts(x, load, reaction, total - reaction, ~held.all(1), model.N, hold)
    return summed(MPI.COMM_SELF, parts, residual, tolerance)


def summed(comm: MPI.Comm, parts: Parts, residual: float, tolerance: float) -> Balance:
    """Return the balance of the parts of all ranks; the same bits on any number of ranks. Collective."""
    x, P, R, r, moves, N, hold = parts
    corners = np.concatenate([x, -x], axis=1).max(0, initial=-np.inf)
    most = np.append(corners, np.abs(N).max(initial=0.0))
    comm.Allreduce(MPI.IN_PLACE, most, MPI.MAX)
    middle, extent, tension = 0.5 * (most[:3] - most[3:6]), most[:3] + most[3:6], most[6]
    moments = np.cross(x - middle, P - R - r)
    terms = *P.T, *R.T, *r.T, *moments.T, lengths(R), np.abs(N), moves, hold
    sums = np.array(exact_sums(comm, *terms))
    of_loads, of_reactions, of_residuals, of_moments = sums[:12].reshape(4, 3)
    absolute, tensions, moving, held = sums[12:]
    scale, far = max(absolute, tension), float(extent.max())
    if not scale > 0.0:
        return Balance(R, of_residuals.tolist(), 0.0, 0.0)
    rounded = ROUNDED * scale + ROUNDED_TENSION * tensions
    off = np.abs(of_loads - of_reactions).max()
    beyond = [
        (np.abs(of_loads - of_reactions - of_residuals).max() - rounded) / scale,
        (off - rounded - moving * residual - tolerance * scale) / scale,
        (np.abs(of_moments).max() - rounded * far - held) / (scale * far) if far > 0.0 else 0.0,
    ]
    return Balance(R, of_residuals.tolist(), float(off / scale), max(0.0, *map(float, beyond)))
