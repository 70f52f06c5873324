"""What each corner of a face has of it: of its surface, of its area in plan and of its vector area."""

from typing import NamedTuple

import numpy as np

from netfall.numerics.functions import lengths
from netfall.roof.faces import Faces, turned_triangles, vector_areas
from netfall.roof.nearest import nearest_areas

FEW = 4  # corners, at most, of a face that triangles from its centroid share out


class Shares(NamedTuple):
    """Of c corners of faces; a corner may stand more than once. Those of a face have all of it.

    face, node : (c,), node from n on points without a particle; share : (c,)
    surface : (f,) [m2]; vector : (f, 3) [m2], half the sum of x_k x x_(k+1): upward, its z the area in plan
    """

    face: np.ndarray
    node: np.ndarray
    share: np.ndarray
    surface: np.ndarray
    vector: np.ndarray

    def surfaces(self) -> np.ndarray:
        """(c,) [m2] of surface."""
        return self.share * self.surface[self.face]

    def plans(self) -> np.ndarray:
        """(c,) [m2] in plan."""
        return self.share * np.abs(self.vector[self.face, 2])

    def vectors(self) -> np.ndarray:
        """(c, 3) [m2] of vector area."""
        return self.share[:, None] * self.vector[self.face]


def shares_of(points: np.ndarray, faces: Faces) -> Shares:
    """How the faces between points (k, 3) [m] are shared out.

    One of three or four corners by its cells' triangles (`corner_areas`); of more by nearest corner.
    """
    rings, surface, vector = faces.rings, np.zeros(0), np.zeros((0, 3))
    if not len(faces):
        return Shares(faces.corner, faces.corner, surface, surface, vector)
    corner_area, face = corner_areas(points, faces), faces.face_of_corner()
    surface, vector = np.bincount(face, corner_area), vector_areas(points, rings)
    corners = np.bincount(rings.face_of_corner())
    few = corners <= FEW
    parts = [_in_proportion(corner_area, face, faces.corner, few)]
    if not few.all():
        of_many = rings.of_faces(~few)
        near = nearest_areas(points, of_many, vector[~few])
        many = np.flatnonzero(~few)[of_many.face_of_corner()]
        parts.append(_in_proportion(near, many, of_many.corner, ~few))
    face, node, share = (np.concatenate(column) for column in zip(*parts))
    return Shares(face, node, share, surface, vector)


def _in_proportion(area, face, node, chosen) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Face, node and share of the corners of chosen faces, by areas (c,); alike where there are none."""
    kept = chosen[face]
    area, face, node = np.maximum(area[kept], 0.0), face[kept], node[kept]
    total, count = np.bincount(face, area), np.bincount(face)
    bare = total == 0
    share = np.where(bare[face], 1.0 / count[face], area / np.where(bare, 1.0, total)[face])
    return face, node, share


def corner_areas(points: np.ndarray, faces: Faces) -> np.ndarray:
    """Area of surface (c,) [m2] that each corner of each cell has of it; points : (k, 3) [m].

    A cell is cut into triangles from its centroid to its sides; half of each goes to either end of a side.
    """
    upward = vector_areas(points, Faces(faces.start, faces.corner))[faces.of_corner()]

    def turned(u, v):
        cross = np.cross(u, v)
        return np.copysign(lengths(cross), np.sum(cross * upward, axis=1))

    half = 0.25 * turned_triangles(points, faces, lambda u, v: lengths(np.cross(u, v)), turned)
    area = half.copy()
    area[faces.next_corner()] += half
    return area
