"""Supports in axes of their own, turned about z by the column `angle`: what they are along x, y and z.

With c and s, cosine and sine of the angle, springs k1 and k2 along the own axes in plan have in x and y the
stiffness c^2 k1 + s^2 k2, s^2 k1 + c^2 k2, and c s (k1 - k2) between the two. A node that is held along one
of the own axes and not along the other moves along a line: it is guided, and along neither x nor y held.
"""

import numpy as np

from netfall.net.net import Net
from netfall.numerics.rotation import directions, from_own, to_own

NIL = 1e-9  # of a unit vector: a part along an axis below that is rounding


def is_turned(net: Net) -> np.ndarray:
    """(n,) bool, supports that would be others without their angle."""
    if net.angle is None:
        return np.zeros(net.n, bool)
    unlike = (net.fixed[:, 0] != net.fixed[:, 1]) | (net.spring[:, 0] != net.spring[:, 1])
    return (net.angle != 0.0) & unlike


def is_guided(net: Net, held: np.ndarray) -> np.ndarray:
    """(n,) bool, nodes that move along a line of their own; held : (n, 3) bool, in the own axes."""
    if net.angle is None:
        return np.zeros(net.n, bool)
    return (net.angle != 0.0) & (held[:, 0] != held[:, 1])


def held_along(net: Net, held: np.ndarray) -> np.ndarray:
    """(n, 3) bool, whether a node is held along x, y and z; held : as of `is_guided`."""
    along = held.copy()
    along[is_guided(net, held), :2] = False
    return along


def borne_along(net: Net) -> np.ndarray:
    """(n, 3) bool, along which of x, y and z supports of either kind bear anything, a guided one too."""
    along = net.held.copy()
    if net.angle is not None:
        first, second = net.held[:, 0], net.held[:, 1]
        c, s = (np.abs(directions(net.angle)) > NIL).T
        along[:, 0], along[:, 1] = first & c | second & s, first & s | second & c
    return along


def settles_along(net: Net, fixed: np.ndarray) -> np.ndarray:
    """(n, 3) bool, along which axes a support, or the foot of its springs, can settle; fixed : as `held`."""
    return held_along(net, fixed) | held_along(net, net.spring > 0.0)


def springs_along(net: Net) -> np.ndarray:
    """Stiffness (n, 3) [N/m] of the springs along x, y and z."""
    at, k = np.flatnonzero(is_turned(net)), net.spring.copy()
    if len(at):
        c2, s2 = (directions(net.angle[at]) ** 2).T
        first, second = net.spring[at, 0], net.spring[at, 1]
        k[at, 0], k[at, 1] = c2 * first + s2 * second, s2 * first + c2 * second
    return k


def turned_column(net: Net, held: np.ndarray) -> np.ndarray:
    """(n, 3) as the field `turned` of `mechanics.fields`; held : as of `is_guided`."""
    column, at = np.zeros((net.n, 3)), np.flatnonzero(is_turned(net))
    c, s = directions(net.angle[at]).T
    guided, first = is_guided(net, held)[at], held[at, 0]
    column[at, 0] = np.where(guided, np.where(first, c, -s), 0.0)
    column[at, 1] = np.where(guided, np.where(first, s, c), 0.0)
    column[at, 2] = c * s * (net.spring[at, 0] - net.spring[at, 1])
    return column


def on_held(net: Net, held: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Of forces (n, 3) on nodes what supports take, 0 along free own axes; held : as of `is_guided`."""
    return from_own(np.where(held, to_own(force, net.angle), 0.0), net.angle)
