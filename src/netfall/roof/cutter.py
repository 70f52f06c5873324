"""What polygons cut out of the areas of nodes, exactly as the faces are shared out."""

import numpy as np
import shapely

from netfall.net.net import Net
from netfall.roof.faces import Faces, quarters
from netfall.roof.nearest import nearest_areas
from netfall.roof.shares import FEW, Shares

ROUNDING = 1e-9  # of a node's area


class Cutter:
    """Cuts what the nodes of a net have of its faces."""

    def __init__(self, net: Net, faces: Faces, shares: Shares):
        """shares : of the faces in the geometry that is given"""
        self.net, self.faces, self.shares = net, faces, shares
        self.points = np.concatenate([net.x, net.corners])
        self.few = np.bincount(self.faces.rings.face_of_corner()) <= FEW
        rings, xy = faces.rings, self.points[:, :2]
        first = rings.start[rings.first_rings()]
        low, high = (f.reduceat(xy[rings.corner], first) for f in (np.minimum, np.maximum))
        self.boxes = shapely.STRtree(shapely.box(*low.T, *high.T))  # around each face in plan

    def inside(self, region) -> np.ndarray:
        """(n,) the share of each node's area in plan that lies in a polygon, or in several.

        Of a node without a face all of it or nothing, by its place.
        """
        shapely.prepare(region)
        net, corner, plans = self.net, self.shares.node, self.shares.plans()
        share = shapely.contains_xy(region, self.points[corner, :2]).astype(float)
        crossed = np.zeros(self.faces.count, bool)
        crossed[self.boxes.query(shapely.boundary(region), "intersects")] = True
        here = crossed[self.shares.face]
        share[here] = np.concatenate([self._of_few(region, crossed), self._of_many(region, crossed)])
        total, within = (np.bincount(corner, w, len(self.points))[: net.n] for w in (plans, share * plans))
        alone = shapely.dwithin(region, shapely.points(net.x[:, :2]), net.tolerance).astype(float)
        found = np.where(total > 0, within / np.where(total > 0, total, 1.0), alone)
        return np.where(found > 1.0 - ROUNDING, 1.0, np.where(found < ROUNDING, 0.0, found))

    def _of_few(self, region, crossed) -> np.ndarray:
        """What lies in a region of the corners of crossed faces of three or four, in the order of shares."""
        rows = (crossed & self.few)[self.faces.face_of_corner()]
        parts = shapely.polygons(quarters(self.points[:, :2], self.faces)[rows])
        size, within = shapely.area(parts), shapely.area(shapely.intersection(parts, region))
        return np.divide(within, size, out=np.zeros(len(size)), where=size > 0)

    def _of_many(self, region, crossed) -> np.ndarray:
        """The same for faces of more corners."""
        chosen = crossed & ~self.few
        if not chosen.any():
            return np.zeros(0)
        rings = self.faces.rings.of_faces(chosen)
        vector = self.shares.vector[chosen]
        size, within = nearest_areas(self.points, rings, vector), 0.0
        for window in _windows(region):
            within = within + nearest_areas(self.points, rings, vector, window)
        return np.divide(within, size, out=np.zeros(len(size)), where=size > 0)


def _windows(region) -> np.ndarray:
    """Triangles that fill a region, each as three half-planes a x + b y <= c: (t, 3, 3)."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(region))
    corner = shapely.get_coordinates(shapely.orient_polygons(triangles)).reshape(-1, 4, 2)
    start, along = corner[:, :3], np.diff(corner, axis=1)
    outward = np.stack([along[:, :, 1], -along[:, :, 0]], -1)
    return np.concatenate([outward, np.sum(outward * start, axis=2, keepdims=True)], 2)
