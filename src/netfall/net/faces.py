"""Faces of the net in plan, tributary areas and normals. The faces are found by shapely (GEOS polygonize)."""

from dataclasses import dataclass

import numpy as np
import shapely

from netfall.net.net import Net


@dataclass(frozen=True)
class Faces:
    """Corner numbers of the faces, anticlockwise in plan.

    start : (f + 1,) rows of `corner` at which each face begins; corner : numbers, from n on points without a particle
    """

    start: np.ndarray
    corner: np.ndarray

    def __len__(self):
        return len(self.start) - 1

    def next_corner(self) -> np.ndarray:
        """For each corner the row of the next one around its face."""
        after = np.arange(1, len(self.corner) + 1)
        if len(self):
            after[self.start[1:] - 1] = self.start[:-1]
        return after

    def of_corner(self) -> np.ndarray:
        """For each corner the number of its face."""
        return np.repeat(np.arange(len(self)), np.diff(self.start))


def _plan_segments(net: Net):
    points = np.concatenate([net.x, net.corners])
    segments = np.concatenate([net.elements, net.outline])
    ends = points[segments][:, :, :2]
    return points, ends[(ends[:, 0] != ends[:, 1]).any(1)]  # upright masts vanish in plan


def crossing_elements(net: Net) -> int:
    """How many pairs of elements cross in plan without a node, where faces are not defined."""
    _, ends = _plan_segments(net)
    lines = shapely.linestrings(ends)
    first, second = shapely.STRtree(lines).query(lines, predicate="crosses")
    return int((first < second).sum())


def find_faces(net: Net) -> Faces:
    """Faces of the net in plan: the smallest closed rings of elements and outline."""
    points, ends = _plan_segments(net)
    if not len(ends):
        return Faces(np.zeros(1, np.int64), np.zeros(0, np.int64))
    polygons = shapely.get_parts(shapely.polygonize(shapely.linestrings(ends)))
    rings = shapely.get_exterior_ring(shapely.orient_polygons(polygons))
    xy, ring = shapely.get_coordinates(rings, return_index=True)
    last = np.append(ring[1:] != ring[:-1], True) if len(ring) else np.zeros(0, bool)
    xy, ring = xy[~last], ring[~last]  # a ring repeats its first point at its end
    # of particles above one another in plan, the highest one carries the roof
    order = np.lexsort((-points[:, 2], points[:, 1], points[:, 0]))
    key = points[order, 0] + 1j * points[order, 1]
    corner = order[np.searchsorted(key, xy[:, 0] + 1j * xy[:, 1])]
    start = np.concatenate([[0], np.cumsum(np.bincount(ring, minlength=len(rings)))]).astype(np.int64)
    return Faces(start, corner)


def tributary_areas(net: Net, faces: Faces) -> np.ndarray:
    """Plan area (n,) [m2] that each particle carries.

    Each face is cut into triangles from its centroid to its sides; half of each goes to either end of the side.
    Shares of points without a particle go to the rigid boundary.
    """
    if not len(faces):
        return np.zeros(net.n)
    points = np.concatenate([net.x, net.corners])[:, :2]
    of_corner, nxt = faces.of_corner(), faces.next_corner()
    p = points[faces.corner]
    counts = np.diff(faces.start)
    middle = np.stack(
        [np.bincount(of_corner, p[:, k], len(faces)) / np.maximum(counts, 1) for k in range(2)], -1
    )
    u, v = p - middle[of_corner], p[nxt] - middle[of_corner]
    # centroid of the polygon from its triangles about the mean corner
    cross = 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    area = np.bincount(of_corner, cross, len(faces))
    shift = np.stack(
        [np.bincount(of_corner, cross * (u[:, k] + v[:, k]) / 3, len(faces)) for k in range(2)], -1
    )
    centroid = middle + shift / np.where(area == 0, 1, area)[:, None]
    u, v = p - centroid[of_corner], p[nxt] - centroid[of_corner]
    half = 0.25 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    total = np.bincount(faces.corner, half, len(points)) + np.bincount(faces.corner[nxt], half, len(points))
    return total[: net.n]


def normals(x: np.ndarray, net: Net, faces: Faces) -> np.ndarray:
    """Upward unit normals (n, 3) of the particles at positions x (n, 3) [m]; zero where a particle meets no face.

    Sum of the vector areas of the faces around the particle (Newell).
    """
    if not len(faces):
        return np.zeros((net.n, 3))
    points = np.concatenate([x, net.corners])
    p, q = points[faces.corner], points[faces.corner[faces.next_corner()]]
    of_corner = faces.of_corner()
    vector = np.stack([np.bincount(of_corner, c, len(faces)) for c in 0.5 * np.cross(p, q).T], -1)
    total = np.stack([np.bincount(faces.corner, vector[of_corner, k], len(points)) for k in range(3)], -1)[
        : net.n
    ]
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, length, out=np.zeros_like(total), where=length > 0)
