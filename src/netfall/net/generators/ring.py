"""An orthogonal cable net in a rigid elliptic ring that rises and falls like a saddle."""

import numpy as np

from netfall.net.net import Net

SNAP = 1e-3  # of the spacing: a grid point this close to the ellipse is a support on it


def ring(length: float, width: float, rise: float, spacing: float) -> Net:
    """Cables along x and y at multiples of `spacing`, each from the ring to the ring, z = rise (u^2 - v^2).

    u = x / a, v = y / b, with a and b half of length and width: so the ring stands `rise` above the middle at
    the ends of the long axis, and as far below it at those of the short one.
    """
    a, b = 0.5 * length, 0.5 * width
    column, row = (np.arange(-int(h / spacing) - 1, int(h / spacing) + 2) * spacing for h in (a, b))
    X, Y = np.meshgrid(column, row, indexing="ij")
    to_edge_y, to_edge_x = _chord(X / a) * b, _chord(Y / b) * a
    gap = np.minimum(to_edge_x - np.abs(X), to_edge_y - np.abs(Y))
    inside, on_edge = gap > SNAP * spacing, np.abs(gap) <= SNAP * spacing
    number = np.where(inside, np.cumsum(inside).reshape(inside.shape) - 1, -1)
    first, last, of_y = _ends(X, Y, to_edge_y, inside, on_edge)
    left, right, of_x = _ends(X.T, Y.T, to_edge_x.T, inside.T, on_edge.T, swapped=True)
    held, end = np.unique(np.concatenate([first, last, left, right]), axis=0, return_inverse=True)
    ends = np.split(int(inside.sum()) + end.ravel(), np.cumsum([len(first), len(last), len(left)]))
    along_y, along_x = _chains(number, of_y, ends[:2]), _chains(number.T, of_x, ends[2:])
    plan = np.concatenate([np.column_stack([X[inside], Y[inside]]), held])
    return _net(plan, np.arange(len(plan)) >= inside.sum(), along_x, along_y, (a, b, rise))


def _chord(share: np.ndarray) -> np.ndarray:
    """Half of a chord of the unit circle, from its distance to the middle; negative beyond the circle."""
    return np.where(np.abs(share) <= 1.0, np.sqrt(np.maximum(0.0, 1.0 - share**2)), -np.inf)


def _ends(X, Y, to_edge, inside, on_edge, swapped=False):
    """Where the cables along the second axis of the grid end, (k, 2) [m] each, and which rows have one.

    A cable ends on the ellipse, or in a point of the grid that lies on it.
    """
    of = np.flatnonzero(inside.any(1))
    low = inside[of].argmax(1) - 1
    high = inside.shape[1] - inside[of, ::-1].argmax(1)
    along, across, chord = (X, Y, to_edge) if swapped else (Y, X, to_edge)
    ends = []
    for sign, beyond in ((-1.0, low), (1.0, high)):
        reach = np.where(on_edge[of, beyond], along[of, beyond], sign * chord[of, 0])
        ends.append(np.column_stack([reach, across[of, 0]] if swapped else [across[of, 0], reach]))
    return *ends, of


def _chains(number: np.ndarray, of: np.ndarray, ends) -> np.ndarray:
    """Elements (k, 2) of the cables along the second axis of the grid."""
    pairs = np.stack([number[:, :-1], number[:, 1:]], -1).reshape(-1, 2)
    rows = number[of]
    inside = rows >= 0
    k, count = np.arange(len(of)), rows.shape[1]
    first, last = rows[k, inside.argmax(1)], rows[k, count - 1 - inside[:, ::-1].argmax(1)]
    inner = pairs[(pairs >= 0).all(1)]
    return np.concatenate([np.column_stack([ends[0], first]), inner, np.column_stack([last, ends[1]])])


def _net(plan, held, along_x, along_y, shape) -> Net:
    """The net with its nodes in rows along x; plan : (n, 2) [m]; held : (n,) bool; shape : a, b, rise [m]"""
    a, b, rise = shape
    order = np.lexsort((plan[:, 0], plan[:, 1]))
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    plan, held = plan[order], held[order]
    elements = rank[np.concatenate([along_x, along_y])]
    group = np.repeat([0, 1], [len(along_x), len(along_y)])
    sort = np.lexsort((elements[:, 1], elements[:, 0]))
    x = np.column_stack([plan, rise * ((plan[:, 0] / a) ** 2 - (plan[:, 1] / b) ** 2)])
    edge = np.flatnonzero(held)
    edge = edge[np.argsort(np.arctan2(plan[edge, 1] / b, plan[edge, 0] / a))]
    fixed = np.repeat(held[:, None], 3, 1)
    outline = np.column_stack([edge, np.roll(edge, -1)])
    return Net(x, fixed, elements[sort], group[sort], ["x", "y"], outline=outline)
