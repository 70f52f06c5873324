"""States of self-stress of a given geometry, with one axial force per group of elements.

Each group has one unknown t. With the unit vector d_e from start to end of element e, equilibrium of node p
is

sum over groups  t_g  sum over e of g at p  (+-) d_e  +  load_p  =  0        on each free axis

(Pellegrino and Calladine 1986, with groups as unknowns: Yuan and Dong 2003). The states without load are the
null space of this matrix. The axial forces are the state closest to the required prestress: least sum of
squares over the elements that have a prestress. If that leaves freedom, the sum of squares of all forces is
least.
"""

from typing import Any, NamedTuple

import numpy as np

from netfall.core.errors import DivergedError, InputError
from netfall.core.functions import from_rotated_axes, lengths, to_rotated_axes
from netfall.core.linear import least_squares, times
from netfall.geometry.net import Net
from netfall.job.values import counted
from netfall.statics import messages
from netfall.statics.bounds import NEGLIGIBLE

MAX_MATRIX_ENTRIES = 2e8  # entries of the matrix, 8 bytes each


class SelfStress(NamedTuple):
    """Prestress of a geometry: N (m,) [N]; residual : (n, 3) [N] on the free axes

    states : (k, m) axial forces of each state of self-stress, the largest of each is 1
    """

    N: np.ndarray
    residual: np.ndarray
    states: np.ndarray


class Equations(NamedTuple):
    """Equilibrium equations with one force per group.

    matrix : (r, c) a row for each free axis. Unknowns are t sqrt(count), so that their sum of squares is that
        of the elements.
    of : (m,) column of each element, -1: none, as its ends are held
    count : (c,) elements of each column
    """

    matrix: np.ndarray
    of: np.ndarray
    count: np.ndarray  # type: ignore[assignment] # hides the method of tuples


def self_stress(net: Net, load: np.ndarray | None, tolerance: float) -> SelfStress:
    """Compute the prestress closest to that of `net`, in equilibrium with a load (n, 3) [N].

    load : None: none; tolerance : largest residual over the largest force at which a set of forces is a state

    Raises InputError if there is no state of self-stress, DivergedError if the load is not carried.
    """
    equations = equations_of(net)
    free = ~net.held
    right_side = np.zeros(free.sum()) if load is None else -to_rotated_axes(load, net.angle)[free]
    fit = least_squares(equations.matrix, right_side, tolerance, scale=1.0)  # of sums of unit vectors
    has_prestress = (equations.of >= 0) & (net.prestress != 0.0)
    if load is None and not fit.null.shape[1]:
        raise InputError(_no_state_message(net, equations, fit.least))
    if load is None and not has_prestress.any():
        raise InputError(messages.NO_PRESTRESS())
    u = fit.x + times(fit.null, _nearest(net.prestress, equations, fit, has_prestress))
    N = np.where(equations.of >= 0, (u / np.sqrt(equations.count))[equations.of], net.prestress)
    if (
        load is None
        and np.abs(N[has_prestress]).max() <= NEGLIGIBLE * np.abs(net.prestress[has_prestress]).max()
    ):
        raise InputError(_not_in_states_message(net, equations, fit, has_prestress))
    residual = _residual(net, N, load)
    size, allowed = lengths(residual), tolerance * np.abs(N).max(initial=0.0)
    over = np.flatnonzero(~(size <= allowed))
    if len(over):
        worst = over[np.argsort(-size[over], kind="stable")][: messages.MAX_LISTED_NODES]
        first = ", ".join(
            f"node {net.node_id[p]} by [{', '.join(f'{value / 1e3:.4g}' for value in residual[p])}] kN"
            for p in worst
        )
        nodes = counted("node", net.node_id[over])
        raise DivergedError(
            messages.GEOMETRY_NOT_IN_EQUILIBRIUM(nodes=nodes, allowed=allowed, residuals=first)
        )
    return SelfStress(N, residual, _states(equations, fit.null))


def equations_of(net: Net) -> Equations:
    """Build the equations of a net from its geometry as given. Raises InputError if they are too many."""
    movable = (~net.held[net.elements]).any((1, 2))
    pairs = net.group * (int(net.tier.max(initial=0)) + 1) + net.tier
    _, column = np.unique(pairs[movable], return_inverse=True)
    of = np.full(net.m, -1)
    of[movable] = column
    count = np.bincount(column)
    if 3.0 * net.n * len(count) > MAX_MATRIX_ENTRIES:
        raise InputError(
            messages.TOO_MANY_GROUPS(
                groups=len(count), nodes=net.n, entries=3.0 * net.n * len(count), most=MAX_MATRIX_ENTRIES
            )
        )
    matrix = np.zeros((net.n, 3, len(count)))
    unit = _directions(net)[movable] / np.sqrt(count)[column, None]
    for end, sign in ((0, 1.0), (1, -1.0)):
        nodes = net.elements[movable, end]
        along = to_rotated_axes(unit, None if net.angle is None else net.angle[nodes])
        index: Any = (nodes, slice(None), column)
        np.add.at(matrix, index, sign * along)
    return Equations(matrix[~net.held], of, count)


def _directions(net: Net) -> np.ndarray:
    """Compute unit vectors (m, 3) from start to end."""
    along = net.x[net.elements[:, 1]] - net.x[net.elements[:, 0]]
    return along / lengths(along)[:, None]


def _nearest(prestress: np.ndarray, equations: Equations, fit: Any, has_prestress: np.ndarray) -> np.ndarray:
    """Compute the shares (k,) of the states whose forces are closest to the prestress.

    has_prestress : (m,) bool, elements whose prestress counts
    """
    columns = len(equations.count)
    requested = np.bincount(equations.of[has_prestress], minlength=columns)
    total = np.bincount(equations.of[has_prestress], prestress[has_prestress], columns)
    is_required = requested > 0
    # the misfit of t is scaled by sqrt(requested), and u is t sqrt(count)
    weight = np.sqrt(requested[is_required] / equations.count[is_required])
    target = total[is_required] / np.sqrt(requested[is_required])
    rows = weight[:, None] * fit.null[is_required]
    return least_squares(rows, target - weight * fit.x[is_required], NEGLIGIBLE, scale=1.0).x


def _residual(net: Net, N: np.ndarray, load: np.ndarray | None) -> np.ndarray:
    """Compute the residual forces (n, 3) [N] on the free axes."""
    force = np.zeros((net.n, 3)) if load is None else load.copy()
    pull = N[:, None] * _directions(net)
    np.add.at(force, net.elements[:, 0], pull)
    np.subtract.at(force, net.elements[:, 1], pull)
    return from_rotated_axes(np.where(net.held, 0.0, to_rotated_axes(force, net.angle)), net.angle)


def _states(equations: Equations, null: np.ndarray) -> np.ndarray:
    """Compute the states as forces of elements (k, m), the largest of each 1."""
    forces = (null / np.sqrt(equations.count)[:, None]).T
    largest = np.abs(forces).argmax(1) if forces.size else np.zeros(0, int)
    forces = forces / forces[np.arange(len(forces)), largest][:, None]
    return np.where(equations.of >= 0, forces[:, equations.of], 0.0)


def _not_in_states_message(net: Net, equations: Equations, fit: Any, has_prestress: np.ndarray) -> str:
    """Return the message that no state of self-stress contains the prestress, with the groups that do."""
    states = _states(equations, fit.null)

    def named(rows: np.ndarray) -> str:
        names = [net.group_names[g] for g in np.unique(net.group[rows])]
        return ", ".join(name or "(without a name)" for name in names)

    takes_part = (np.abs(states) > NEGLIGIBLE).any(0)
    members = named(takes_part)
    return messages.PRESTRESS_NOT_IN_STATES(groups=named(has_prestress), count=len(states), members=members)


def _no_state_message(net: Net, equations: Equations, least: float) -> str:
    """Return the message that there is no state of self-stress, with the node where the best forces fail."""
    best = least_squares(equations.matrix, np.zeros(len(equations.matrix)), least * (1.0 + 1e-9)).null[:, 0]
    t = best / np.sqrt(equations.count)
    N = np.where(equations.of >= 0, t[equations.of], 0.0)
    misfit = lengths(_residual(net, N, None)) / np.abs(N).max()
    p = int(np.argmax(misfit))
    groups = len(equations.count)
    return messages.NO_SELF_STRESS(groups=groups, misfit=misfit[p], node=net.node_id[p])
