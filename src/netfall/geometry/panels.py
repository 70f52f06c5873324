"""Panels of the cladding: faces of the roof, elements that support them, and loads of their corners."""

from typing import NamedTuple

import numpy as np

from netfall.core.arrays import IntArray
from netfall.geometry.faces import Faces
from netfall.geometry.net import Net, pair_key
from netfall.geometry.shares import FaceShares


class Panels(NamedTuple):
    """Panels, the elements that support them, and the areas and loads of their corners.

    element, panel : (k,) pairs; of_corner : (c,) panel; node : (c,); count : of panels
    area, plan_area, vector : of c corners as in `areas.TributaryAreas`, which at a node sum up to its own
    mass : (c,) [kg]; pressure : (c, 3) [N]; wind : (c, 3) [N s2/m2], lost with the panel
    air : (c, 3) [kg/m], kappa rho A; air_mass : (c,) [kg], added mass of the air
    """

    element: np.ndarray
    panel: np.ndarray
    of_corner: np.ndarray
    node: np.ndarray
    count: int  # type: ignore[assignment] # hides the method of tuples
    area: np.ndarray
    plan_area: np.ndarray
    vector: np.ndarray
    mass: np.ndarray | None = None
    pressure: np.ndarray | None = None
    wind: np.ndarray | None = None
    air: np.ndarray | None = None
    air_mass: np.ndarray | None = None

    def at(self, elements: IntArray) -> np.ndarray:
        """Return the panels that any of some elements supports, ascending."""
        return np.unique(self.panel[np.isin(self.element, elements)])


def make_panels(net: Net, faces: Faces, shares: FaceShares) -> Panels:
    """Build the panels of a roof from the shares of its faces, without their loads."""
    on_node = shares.node < net.n
    node, surface, vector = (
        shares.node[on_node],
        shares.surface_areas()[on_node],
        shares.vector_areas()[on_node],
    )
    given = np.isfinite(net.normal[node])
    vector = np.where(given, surface[:, None] * net.normal[node], vector)
    # pairs of an element and a panel that has it as a side
    points, rings = net.n + len(net.corners), faces.rings
    sides, edge = pair_key(rings.sides(), points), pair_key(net.elements, points)
    order = np.argsort(sides, kind="stable")
    first, last = (np.searchsorted(sides[order], edge, side=side) for side in ("left", "right"))
    rows = np.concatenate([order[a:b] for a, b in zip(first, last)]) if len(edge) else order[:0]
    element, panel = np.repeat(np.arange(net.m), last - first), rings.face_of_corner()[rows]
    plan_area, of_corner = shares.plan_areas()[on_node], shares.face[on_node]
    return Panels(element, panel, of_corner, node, faces.count, surface, plan_area, vector)
