"""Roof areas of the nodes, in plan.

The area of a node in a face extends to the middles of the adjoining sides and to the centroid. This also
holds for faces with more than four corners, although their loads go to the nearest corner.
"""

import numpy as np
from matplotlib.collections import PolyCollection

from netfall.geometry.faces import Faces, corner_quadrilaterals, faces_of_rings

MOST_CELLS = 400_000  # node areas in faces; in larger nets each node is a dot


def roof_polygons(f, **style) -> tuple[PolyCollection, np.ndarray]:
    """Return the roof areas of a result file and the node (c,) of each; areas without faces are squares."""
    x, area = f["net/particles"][:, :2], f["net/plan_area"][:]
    points = np.vstack([x, f["provenance/net/corners"][:, :2]])
    rings = Faces(f["provenance/net/ring_start"][:], f["provenance/net/ring_corner"][:])
    faces = faces_of_rings(rings, f["provenance/net/ring_face"][:], points) if has_faces(f) else rings
    cells, node = np.zeros((0, 4, 2)), np.zeros(0, int)
    if has_faces(f):
        is_node = faces.corner < len(x)
        cells, node = corner_quadrilaterals(points, faces)[is_node], faces.corner[is_node]
    alone = np.setdiff1d(np.flatnonzero((area > 0) & (f["net/tributary_area"][:] > 0)), node)
    corner = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    squares = x[alone][:, None] + np.sqrt(area[alone])[:, None, None] * corner
    shapes = np.concatenate([cells, squares])
    return PolyCollection(shapes, edgecolors="face", lw=0.3, **style), np.concatenate([node, alone])


def has_faces(f) -> bool:
    """Whether the net of a result file has faces, from which its areas are computed."""
    return f["provenance/net/ring_start"].shape[0] > 1 and bool(f["provenance/net/ring_corner"].shape[0] > 2)
