"""Supports with axes rotated about z by the column `angle`, expressed along x, y and z.

With c and s, cosine and sine of the angle, springs k1 and k2 along the rotated axes in plan have the
stiffness c^2 k1 + s^2 k2 in x, s^2 k1 + c^2 k2 in y, and c s (k1 - k2) between the two. A node that is held
along one rotated axis in plan and free along the other is guided: it moves along a line, and is not held
along x or y.
"""

import numpy as np

from netfall.core.functions import directions, from_rotated_axes, to_rotated_axes
from netfall.geometry.net import Net

NEGLIGIBLE = 1e-9  # component of a unit vector below which it is rounding


def is_rotated(net: Net) -> np.ndarray:
    """Return which supports would be different without their angle, (n,) bool."""
    if net.angle is None:
        return np.zeros(net.n, bool)
    anisotropic = (net.fixed[:, 0] != net.fixed[:, 1]) | (net.spring[:, 0] != net.spring[:, 1])
    return (net.angle != 0.0) & anisotropic


def is_guided(net: Net, held: np.ndarray) -> np.ndarray:
    """Return which nodes are guided along a line, (n,) bool; held : (n, 3) bool, in the rotated axes."""
    if net.angle is None:
        return np.zeros(net.n, bool)
    return (net.angle != 0.0) & (held[:, 0] != held[:, 1])


def global_held_axes(net: Net, held: np.ndarray) -> np.ndarray:
    """Return which nodes are held along x, y and z, (n, 3) bool; held : as in `is_guided`."""
    along = held.copy()
    along[is_guided(net, held), :2] = False
    return along


def reaction_axes(net: Net) -> np.ndarray:
    """Return which of x, y and z have reactions of rigid, elastic or guided supports, (n, 3) bool."""
    along = net.held.copy()
    if net.angle is not None:
        first, second = net.held[:, 0], net.held[:, 1]
        c, s = (np.abs(directions(net.angle)) > NEGLIGIBLE).T
        along[:, 0], along[:, 1] = first & c | second & s, first & s | second & c
    return along


def settlement_axes(net: Net, fixed: np.ndarray) -> np.ndarray:
    """Return which axes of a support, or of the foot of its springs, can settle, (n, 3) bool.

    fixed : as `held` in `is_guided`
    """
    return global_held_axes(net, fixed) | global_held_axes(net, net.spring > 0.0)


def global_spring_stiffness(net: Net) -> np.ndarray:
    """Compute the stiffness (n, 3) [N/m] of the springs along x, y and z."""
    rows, k = np.flatnonzero(is_rotated(net)), net.spring.copy()
    if net.angle is not None and len(rows):
        c2, s2 = (directions(net.angle[rows]) ** 2).T
        first, second = net.spring[rows, 0], net.spring[rows, 1]
        k[rows, 0], k[rows, 1] = c2 * first + s2 * second, s2 * first + c2 * second
    return k


def rotation_column(net: Net, held: np.ndarray) -> np.ndarray:
    """Compute the field `turned` (n, 3) of `physics.fields`; held : as in `is_guided`."""
    column, rows = np.zeros((net.n, 3)), np.flatnonzero(is_rotated(net))
    if net.angle is None:
        return column
    c, s = directions(net.angle[rows]).T
    guided, first = is_guided(net, held)[rows], held[rows, 0]
    column[rows, 0] = np.where(guided, np.where(first, c, -s), 0.0)
    column[rows, 1] = np.where(guided, np.where(first, s, c), 0.0)
    column[rows, 2] = c * s * (net.spring[rows, 0] - net.spring[rows, 1])
    return column


def support_forces(net: Net, held: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return the forces (n, 3) on supports, 0 along free rotated axes; held : as in `is_guided`."""
    return from_rotated_axes(np.where(held, to_rotated_axes(force, net.angle), 0.0), net.angle)
