"""Panels of the cladding: the faces of the roof, the elements that they hang on, what nodes carry of them."""

from typing import NamedTuple

import numpy as np

from netfall.net.net import Net, pair_key
from netfall.roof.faces import Faces
from netfall.roof.shares import Shares


class Panels(NamedTuple):
    """Which panel hangs on which element, and what its corners carry.

    element, panel : (k,) pairs; of_corner : (c,) panel; node : (c,); count : of panels
    area, plan_area, vector : of c corners as in `areas.Areas`, which at a node sum up to its own
    mass : (c,) [kg]; pressure : (c, 3) [N]; wind : (c, 3) [N s2/m2], what goes with the panel
    air : (c, 3) [kg/m], kappa rho A; air_mass : (c,) [kg], of air that moves along
    """

    element: np.ndarray
    panel: np.ndarray
    of_corner: np.ndarray
    node: np.ndarray
    count: int
    area: np.ndarray
    plan_area: np.ndarray
    vector: np.ndarray
    mass: np.ndarray = None
    pressure: np.ndarray = None
    wind: np.ndarray = None
    air: np.ndarray = None
    air_mass: np.ndarray = None

    def at(self, elements) -> np.ndarray:
        """Panels that hang on any of some elements, ascending."""
        return np.unique(self.panel[np.isin(self.element, elements)])


def panels_of(net: Net, faces: Faces, shares: Shares) -> Panels:
    """The panels of a roof whose faces are shared out so, without what they carry."""
    here = shares.node < net.n
    node, surface, vector = shares.node[here], shares.surfaces()[here], shares.vectors()[here]
    given = np.isfinite(net.normal[node])
    vector = np.where(given, surface[:, None] * net.normal[node], vector)
    areas = surface, shares.plans()[here], vector
    return Panels(*_hung(net, faces.rings), shares.face[here], node, faces.count, *areas)


def _hung(net: Net, rings: Faces) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of an element and a panel that has it as a side."""
    points = net.n + len(net.corners)
    sides = pair_key(rings.sides(), points)
    order = np.argsort(sides, kind="stable")
    edge = pair_key(net.elements, points)
    first, last = (np.searchsorted(sides[order], edge, side=side) for side in ("left", "right"))
    rows = np.concatenate([order[a:b] for a, b in zip(first, last)]) if len(edge) else order[:0]
    return np.repeat(np.arange(net.m), last - first), rings.face_of_corner()[rows]
