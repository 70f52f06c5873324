"""Form finding by force densities: one sparse linear solve (Schek 1974)."""

import numpy as np

from netfall.core.errors import InputError
from netfall.core.sparse import Singular, solve_sparse
from netfall.geometry.net import Net
from netfall.job.values import counted


def force_density_form(net: Net, load: np.ndarray | None = None) -> np.ndarray:
    """Compute equilibrium positions (n, 3) [m] for given force densities. Only on rank 0.

    Elements without a given density have prestress / length. The equation on each free axis is sum_e q_e
    (x_other - x_p) + load_p = 0, a sparse system that is solved by factorisation.
    load : (n, 3) [N], None: none

    Raises InputError if the system is singular: the densities then define no shape.
    """
    q = np.where(np.isfinite(net.force_density), net.force_density, net.prestress / net.lengths())
    total, size = np.zeros((2, net.n))
    pull = np.zeros((net.n, 3))  # of the held ends
    for end in range(2):
        np.add.at(total, net.elements[:, end], q)
        np.add.at(size, net.elements[:, end], np.abs(q))
    x = net.x.copy()
    for axes in _axis_groups(net):
        held = net.held[:, axes[0]]
        free, place = np.flatnonzero(~held), np.cumsum(~held) - 1
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
            raise _unsupported_error(net, free[error.rows], axes) from None
        x[np.ix_(free, np.array(axes))] = solution
        pull[:] = 0.0
    if not np.isfinite(x).all():
        p = int(np.flatnonzero(~np.isfinite(x).all(1))[0])
        raise InputError(
            f"form finding by force density has no solution around node {net.node_id[p]}: "
            "give force densities (or prestress) that hold every free node"
        )
    return x


def _unsupported_error(net: Net, rows: np.ndarray, axes: list[int]) -> InputError:
    """Return the error that the nodes in these rows have no position along these axes.

    The matrix of force densities is singular.
    """
    ids = net.node_id[rows]
    one, along = len(ids) == 1, " and ".join("xyz"[axis] for axis in axes)
    return InputError(
        "form finding by force density has no solution: the force densities do not hold "
        f"{counted('node', ids)} along {along}, which could stand anywhere; hold "
        f"{'it' if one else 'one of them'}, join {'it' if one else 'them'} to supports, or give force "
        "densities (or prestress) that do not cancel"
    )


def _axis_groups(net: Net) -> list[list[int]]:
    """Group the axes with free nodes so that all axes of a group have the same free nodes."""
    groups: dict[bytes, list[int]] = {}
    for axis in range(3):
        if not net.held[:, axis].all():
            groups.setdefault(net.held[:, axis].tobytes(), []).append(axis)
    return list(groups.values())
