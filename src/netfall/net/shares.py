"""What each corner of a face has of it: of its surface, of its area in plan and of its vector area."""

from typing import NamedTuple

import numpy as np

from netfall.functions import lengths
from netfall.net.faces import Faces, turned_triangles


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
    """How the faces between points (k, 3) [m] are shared out."""
    corner_area = corner_areas(points, faces)
    face = faces.of_corner()
    surface = np.bincount(face, corner_area, len(faces))
    count = np.bincount(face, minlength=len(faces))
    bare = surface == 0
    share = np.where(bare[face], 1.0 / count[face], corner_area / np.where(bare, 1.0, surface)[face])
    return Shares(face, faces.corner, share, surface, vector_areas(points, faces))


def corner_areas(points: np.ndarray, faces: Faces) -> np.ndarray:
    """Area of surface (c,) [m2] that each corner of each cell has of it; points : (k, 3) [m].

    A cell is cut into triangles from its centroid to its sides; half of each goes to either end of a side.
    """
    half = 0.25 * turned_triangles(points, faces, lambda u, v: lengths(np.cross(u, v)))
    area = half.copy()
    area[faces.next_corner()] += half
    return area


def vector_areas(points: np.ndarray, faces: Faces) -> np.ndarray:
    """Vector areas (f, 3) [m2] of the faces, half the sum of x_k x x_(k+1) from a corner of their own."""
    face = faces.of_corner()
    start = points[faces.corner[faces.start[:-1]]][face]
    p, q = points[faces.corner] - start, points[faces.corner[faces.next_corner()]] - start
    return np.stack([np.bincount(face, part, len(faces)) for part in 0.5 * np.cross(p, q).T], -1)
