"""Form finding by force densities: one sparse linear solve (Schek 1974)."""

import numpy as np

from netfall.core.errors import InputError
from netfall.core.sparse import Singular, solve_sparse
from netfall.geometry.net import Net
from netfall.job.values import counted
from netfall.statics import messages


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
    groups: dict[bytes, list[int]] = {}  # axes with the same free nodes
    for axis in range(3):
        if not net.held[:, axis].all():
            groups.setdefault(net.held[:, axis].tobytes(), []).append(axis)
    for axes in groups.values():
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
            nodes = counted("node", net.node_id[free[error.rows]])
            along = " and ".join("xyz"[axis] for axis in axes)
            raise InputError(messages.NODES_NOT_HELD(nodes=nodes, axes=along)) from None
        x[np.ix_(free, np.array(axes))] = solution
        pull[:] = 0.0
    if not np.isfinite(x).all():
        p = int(np.flatnonzero(~np.isfinite(x).all(1))[0])
        raise InputError(messages.NO_FORM_AT_NODE(node=net.node_id[p]))
    return x
