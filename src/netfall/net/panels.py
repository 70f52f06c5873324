"""Panels of the cladding: the faces of the roof, the elements that they hang on, what nodes carry of them."""

from typing import NamedTuple

import numpy as np

from netfall.net.areas import corner_areas
from netfall.net.faces import Faces
from netfall.net.net import Net, pair_key


class Panels(NamedTuple):
    """Which panel hangs on which element, and its share of what its corners carry of the roof.

    element, panel : (k,) pairs; of_corner : (c,) panel, ascending; node : (c,); share : (c,), of the node
    count : of panels
    """

    element: np.ndarray
    panel: np.ndarray
    of_corner: np.ndarray
    node: np.ndarray
    share: np.ndarray
    count: int

    def at(self, elements) -> np.ndarray:
        """Panels that hang on any of some elements, ascending."""
        return np.unique(self.panel[np.isin(self.element, elements)])


def panels_of(x: np.ndarray, net: Net, faces: Faces) -> Panels:
    """The panels of a roof in the form x (n, 3) [m]; parts of a face that was cut are panels of their own."""
    points = np.concatenate([x, net.corners])
    area = corner_areas(points, faces)
    total = np.bincount(faces.corner, area, len(points))
    share = area / np.where(total > 0, total, 1.0)[faces.corner]
    sides = pair_key(np.column_stack([faces.corner, faces.corner[faces.next_corner()]]), len(points))
    order = np.argsort(sides, kind="stable")
    edge = pair_key(net.elements, len(points))
    first, last = (np.searchsorted(sides[order], edge, side=side) for side in ("left", "right"))
    rows = np.concatenate([order[a:b] for a, b in zip(first, last)]) if len(edge) else order[:0]
    here = faces.corner < net.n
    return Panels(
        np.repeat(np.arange(net.m), last - first),
        faces.of_corner()[rows],
        faces.of_corner()[here],
        faces.corner[here],
        share[here],
        len(faces),
    )
