"""Unstressed lengths that are changed: which elements belong to what a job names, and what each share is.

Rank 0, global order. A change by a [m] makes each cable longer by a, each of its elements in proportion to
its unstressed length.
"""

from typing import NamedTuple

import numpy as np

from netfall.job.values import nearest, shown
from netfall.net.net import Net, elements_of_cables, elements_of_group
from netfall.numerics.least_squares import least_squares

WEAK = 1e-9  # of the largest influence of a target: less is none
SLIGHTEST = 1e-6  # of EA: the force with which a slack cable becomes taut


class Jack(NamedTuple):
    """An amount [m] by which unstressed lengths are changed.

    name : of the group or cable; rows : (r,) elements; cable : (r,) number of the cable of each, from 0
    """

    name: str
    rows: np.ndarray
    cable: np.ndarray

    def shares(self, L0: np.ndarray) -> np.ndarray:
        """What each of its elements (r,) has of the amount, at unstressed lengths L0 (m,) [m]."""
        return L0[self.rows] / np.bincount(self.cable, L0[self.rows])[self.cable]

    def changed(self, L0: np.ndarray, amount: float) -> np.ndarray:
        """Unstressed lengths (m,) [m] after a change by an amount [m]."""
        L0 = L0.copy()
        L0[self.rows] += amount * self.shares(L0)
        return L0


class Wanted(NamedTuple):
    """A quantity that is wanted: the mean force [N] of elements `rows`, or the height [m] of a node.

    words : for messages; node : its row, -1: a force; own : number of the jack at which it is measured, -1
    """

    words: str
    value: float
    rows: np.ndarray
    node: int = -1
    own: int = -1

    def now(self, x: np.ndarray, N: np.ndarray) -> float:
        """Its value with nodes at x (n, 3) [m] and axial forces N (m,) [N]."""
        if self.node >= 0:
            return float(x[self.node, 2])
        return float(np.bincount(np.zeros(len(self.rows), int), N[self.rows])[0] / len(self.rows))


def rows_named(net: Net, name: str) -> np.ndarray:
    """The elements of a group, or of a piece of cable; none where nothing is called so."""
    rows, wrong = elements_of_group(net, name)
    return elements_of_cables(net, [name])[0] if wrong else rows


def jack_of(net: Net, name: str) -> Jack:
    """All cables of what is called so, by one amount each."""
    rows = rows_named(net, name)
    return Jack(name, rows, np.unique(net.cable[rows], return_inverse=True)[1])


def jacks_of(net: Net, name: str) -> list[Jack]:
    """Each cable of what is called so, by an amount of its own."""
    rows = rows_named(net, name)
    cables = [rows[net.cable[rows] == cable] for cable in dict.fromkeys(net.cable[rows].tolist())]
    return [Jack(net.cable_names[net.cable[own[0]]], own, np.zeros(len(own), int)) for own in cables]


def unknown_name(net: Net, name: str) -> str:
    """What is wrong with the name of a group or a cable, in words; "": nothing."""
    if len(rows_named(net, name)):
        return ""
    known = [*(group for group in net.group_names if group), *net.cable_names]
    return f"{shown(name)}: neither a group nor a cable; {nearest(name, known)}"


def amounts(misses: np.ndarray, influence: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Amounts (k,) [m] by Newton's method that take away what is missing (t,), the smallest that do.

    influence : (t, k) of the amounts on what is wanted; scale : (t,) sizes of these
    """
    return least_squares(influence / scale[:, None], -misses / scale, WEAK).x


def until_taut(jack: Jack, L: np.ndarray, L0: np.ndarray, EA: np.ndarray, force: float) -> float:
    """The amount [m] after which a slack cable would carry a force [N] where its nodes are now.

    L, L0 : (m,) [m] lengths, unstressed lengths; EA : (m,) [N]
    """
    rows = jack.rows
    least = max(force, SLIGHTEST * float(EA[rows].min()))
    return float((L[rows] / (1.0 + least / EA[rows]) - L0[rows]).sum()) / (1 + int(jack.cable.max()))


def missed(wanted: list[Wanted], values: np.ndarray) -> list[str]:
    """What is wanted and what it came to, in words."""
    unit = lambda each: "m" if each.node >= 0 else "N"
    return [
        f"{each.words} = {each.value:.6g} {unit(each)}: came to {value:.6g} {unit(each)}"
        for each, value in zip(wanted, values)
    ]
