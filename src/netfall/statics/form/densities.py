"""Form finding by force densities: a sparse linear solve (Schek 1974), or several for horizontal forces."""

from typing import NamedTuple

import numpy as np

from netfall.core.errors import DivergedError, InputError
from netfall.core.sparse import Singular, solve_sparse
from netfall.geometry.net import Net
from netfall.job.values import counted
from netfall.statics import messages
from netfall.statics.bounds import MOST_STEPS, SUBSTITUTE_SHARE


class DensityForm(NamedTuple):
    """Form of force densities.

    x : (n, 3) [m]; force_density : (m,) [N/m], as given or that of a horizontal force, nan: neither
    solutions : number of linear systems that were solved
    """

    x: np.ndarray
    force_density: np.ndarray
    solutions: int


def force_density_form(net: Net, load: np.ndarray | None, tolerance: float) -> DensityForm:
    """Find the equilibrium of force densities that are given or follow from horizontal forces. Rank 0.

    Elements without either have prestress / length. An element with a horizontal force H has the density
    H / length in plan. It follows the plan: each solution gives new lengths, until none changes by more than
    `tolerance`. The weighted sum of the lengths in plan decreases in each solution (Weiszfeld 1937).
    load : (n, 3) [N], None: none

    Raises InputError if the densities define no shape, DivergedError if the lengths in plan do not converge.
    """
    q = np.where(np.isfinite(net.force_density), net.force_density, net.prestress / net.lengths())
    if net.horizontal_force is None:
        return DensityForm(_solve(net, q, load), net.force_density, 1)
    rows = np.flatnonzero(np.isfinite(net.horizontal_force))
    H, given = net.horizontal_force[rows], net.plan_lengths(net.x)[rows]
    length = given
    for solution in range(1, MOST_STEPS + 1):
        q[rows] = H / length
        x = _solve(net, q, load)
        before, length = length, net.plan_lengths(x)[rows]
        change = np.abs(length / before - 1.0)
        if change.max() <= tolerance:
            density = net.force_density.copy()
            density[rows] = q[rows]
            return DensityForm(x, density, solution)
        if (length <= SUBSTITUTE_SHARE * given).any():
            break
    k = int(np.argmax(change))
    a, b = net.node_id[net.elements[rows[k]]]
    error = messages.PLAN_NOT_CONVERGED(
        element=net.element_id[rows[k]],
        start=a,
        end=b,
        change=100.0 * change[k],
        solutions=solution,
        length=length[k],
    )
    raise DivergedError(error)


def _solve(net: Net, q: np.ndarray, load: np.ndarray | None) -> np.ndarray:
    """Compute equilibrium positions (n, 3) [m] for force densities q (m,) [N/m].

    The equation on each free axis is sum_e q_e (x_other - x_p) + load_p = 0, a sparse system that is solved
    by factorisation. Raises InputError if the system is singular: the densities then define no shape.
    """
    total, size = np.zeros((2, net.n))
    for end in range(2):
        np.add.at(total, net.elements[:, end], q)
        np.add.at(size, net.elements[:, end], np.abs(q))
    x = net.x.copy()
    groups: dict[bytes, list[int]] = {}  # axes with the same free nodes
    for axis in range(3):
        if not net.held[:, axis].all():
            groups.setdefault(net.held[:, axis].tobytes(), []).append(axis)
    for axes in groups.values():
        held = net.held[:, axes[0]]
        free, place = np.flatnonzero(~held), np.cumsum(~held) - 1
        pull = np.zeros((net.n, 3))  # of the held ends
        for end in range(2):
            neighbour = net.elements[:, 1 - end]
            np.add.at(
                pull, net.elements[:, end], np.where(held[neighbour], q, 0.0)[:, None] * net.x[neighbour]
            )
        within = ~held[net.elements].any(1)
        try:
            if load is not None:
                pull += load
            solution = solve_sparse(
                place[net.elements[within]], -q[within], total[free], pull[free][:, axes], size[free]
            )
        except Singular as error:
            nodes = counted("node", net.node_id[free[error.rows]])
            along = " and ".join("xyz"[axis] for axis in axes)
            raise InputError(messages.NODES_NOT_HELD(nodes=nodes, axes=along)) from None
        x[np.ix_(free, np.array(axes))] = solution
    if not np.isfinite(x).all():
        p = int(np.flatnonzero(~np.isfinite(x).all(1))[0])
        raise InputError(messages.NO_FORM_AT_NODE(node=net.node_id[p]))
    return x
