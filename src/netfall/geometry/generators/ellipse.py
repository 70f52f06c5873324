"""Cables along x and y inside an ellipse, at multiples of a spacing, each from edge to edge."""

from typing import Any

import numpy as np

SNAP_DISTANCE = 1e-3  # share of the spacing: a grid point this close to the ellipse is a support on it


def cables_in_ellipse(a: float, b: float, spacing: float, whole: bool = True) -> Any:
    """Lay out the nodes and elements of a cable grid inside an ellipse.

    a, b : half axes [m]; whole : False: only y > 0, where the cables along y start in supports on y = 0

    Returns points (n, 2) [m] in rows along x, whether each is a support (n,), and elements (k, 2) along x and
    along y. Each cable ends in its own support, or in a grid point on the ellipse.
    """
    across, away = (np.arange(-int(h / spacing) - 1, int(h / spacing) + 2) * spacing for h in (a, b))
    X, Y = np.meshgrid(across, away if whole else away[away > 0.0], indexing="ij")
    to_edge_y, to_edge_x = _chord(X / a) * b, _chord(Y / b) * a
    gap = np.minimum(to_edge_x - np.abs(X), to_edge_y - np.abs(Y))
    inside, on_edge = gap > SNAP_DISTANCE * spacing, np.abs(gap) <= SNAP_DISTANCE * spacing
    number = np.where(inside, np.cumsum(inside).reshape(inside.shape) - 1, -1)
    first, last, of_y = _ends(X, Y, to_edge_y, inside, on_edge)
    if not whole:
        first[:, 1] = 0.0
    left, right, of_x = _ends(Y.T, X.T, to_edge_x.T, inside.T, on_edge.T)
    left, right = left[:, ::-1], right[:, ::-1]
    held, end = np.unique(np.concatenate([first, last, left, right]), axis=0, return_inverse=True)
    ends = np.split(int(inside.sum()) + end.ravel(), np.cumsum([len(first), len(last), len(left)]))
    along_y, along_x = _chains(number, of_y, ends[:2]), _chains(number.T, of_x, ends[2:])
    xy = np.concatenate([np.column_stack([X[inside], Y[inside]]), held])
    order = np.lexsort((xy[:, 0], xy[:, 1]))
    rank = np.argsort(order)
    return xy[order], order >= inside.sum(), rank[along_x], rank[along_y]


def _chord(share: np.ndarray) -> np.ndarray:
    """Return half a chord of the unit circle at a distance from the centre; -inf outside the circle."""
    return np.where(np.abs(share) <= 1.0, np.sqrt(np.maximum(0.0, 1.0 - share**2)), -np.inf)


def _ends(across: Any, along: Any, chord: Any, inside: Any, on_edge: Any) -> Any:
    """Return both ends (k, 2) [m] of the cables along the second axis of the grid, and their rows.

    across, along, chord : coordinates on the axes of the grid, and half chords of the ellipse [m]

    A cable ends on the ellipse, or in a grid point on it.
    """
    rows = np.flatnonzero(inside.any(1))
    low = inside[rows].argmax(1) - 1
    high = inside.shape[1] - inside[rows, ::-1].argmax(1)
    ends = []
    for sign, column in ((-1.0, low), (1.0, high)):
        reach = np.where(on_edge[rows, column], along[rows, column], sign * chord[rows, 0])
        ends.append(np.column_stack([across[rows, 0], reach]))
    return *ends, rows


def _chains(number: np.ndarray, cables: np.ndarray, ends: Any) -> np.ndarray:
    """Return the elements (k, 2) of the cables along the second axis of the grid."""
    pairs = np.stack([number[:, :-1], number[:, 1:]], -1).reshape(-1, 2)
    rows = number[cables]
    inside = rows >= 0
    k, count = np.arange(len(cables)), rows.shape[1]
    first, last = rows[k, inside.argmax(1)], rows[k, count - 1 - inside[:, ::-1].argmax(1)]
    inner = pairs[(pairs >= 0).all(1)]
    return np.concatenate([np.column_stack([ends[0], first]), inner, np.column_stack([last, ends[1]])])


def sort_around_ellipse(edge: np.ndarray, xy: np.ndarray, a: float, b: float) -> np.ndarray:
    """Sort the nodes `edge` on an ellipse at xy (n, 2) [m] around it, by the angle from -x on."""
    return edge[np.argsort(np.arctan2(xy[edge, 1] / b, xy[edge, 0] / a))]
