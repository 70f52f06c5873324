"""Shares of the corners of a face in its surface area, plan area and vector area; cladding panels.

Faces of three or four corners are divided by triangles from their centroids. Faces of more corners are
divided by nearest corner, in the plane normal to their vector area. The part of a face nearest to a corner,
the Voronoi cell of the corner, is the face clipped by half-planes (Sutherland, Hodgman 1974). These are
bounded by the perpendicular bisectors to all other corners. Clipping ring by ring keeps signed areas, so
concave faces and holes need no special treatment.
"""

from typing import Any, NamedTuple

import numpy as np

from netfall.core.arrays import BoolArray, FloatArray, IntArray
from netfall.core.functions import lengths
from netfall.core.kernels import inner_kernel, kernel
from netfall.geometry.faces import Faces, centroid_triangle_areas, vector_areas
from netfall.geometry.net import Net, pair_key

COINCIDENT_CORNERS = 1e-12  # share of a face's size: closer corners coincide and split their nearest area


def nearest_areas(
    points: Any, rings: Any, vector: np.ndarray, windows: np.ndarray | None = None
) -> np.ndarray:
    """Compute the area (c,) [m2], in the plane of its face, that is nearest to each corner of some faces.

    points : (k, 3) [m]; rings : `Faces` of f faces with all rings; vector : (f, 3) [m2], their areas
    windows : (w, 3) half-planes a x + b y <= c in plan; only the area inside all of them counts
    """
    face = rings.face_of_corner()
    size = lengths(vector)[:, None]
    # two axes of the plane normal to each vector; x and y for a zero vector
    normal = np.where(size > 0, vector, [0.0, 0.0, 1.0]) / np.where(size > 0, size, 1.0)
    along = np.where(np.abs(normal[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    first = along - np.sum(along * normal, axis=1)[:, None] * normal
    first /= lengths(first)[:, None]
    second = np.cross(normal, first)
    start = points[rings.first_corners()]
    relative = points[rings.corner] - start[face]
    xy = np.column_stack([np.sum(relative * axes[face], axis=1) for axes in (first, second)])
    windows = np.zeros((0, 3)) if windows is None else windows
    slant = [np.sum(windows[:, None, :2] * axes[None, :, :2], axis=2) for axes in (first, second)]
    # the plane contains the mean of the corners; a plane through a corner would depend on their order
    height = np.bincount(face, np.sum(relative * normal[face], axis=1)) / np.bincount(face)
    origin = start + height[:, None] * normal
    offset = windows[:, 2:] - np.sum(windows[:, None, :2] * origin[None, :, :2], axis=2)
    planes = np.ascontiguousarray(np.stack([*slant, offset], -1).transpose(1, 0, 2))
    area = np.zeros(len(xy))
    of_face = np.append(rings.first_rings(), len(rings))
    coincident = COINCIDENT_CORNERS * COINCIDENT_CORNERS * np.maximum(size[:, 0], 1e-300)
    _clip_all(xy, rings.start, of_face, planes, coincident, area)
    return area


@inner_kernel
def _clip(ring: FloatArray, count: int, a: float, b: float, c: float, out: FloatArray) -> int:
    """Write the part of a ring of `count` corners in a x + b y <= c; return the number of its corners."""
    written = 0
    for k in range(count):
        m = k + 1 if k + 1 < count else 0
        at_k = a * ring[k, 0] + b * ring[k, 1] - c
        at_m = a * ring[m, 0] + b * ring[m, 1] - c
        if at_k <= 0.0:
            out[written, 0], out[written, 1] = ring[k, 0], ring[k, 1]
            written += 1
        if (at_k <= 0.0) != (at_m <= 0.0):
            t = at_k / (at_k - at_m)
            out[written, 0] = ring[k, 0] + t * (ring[m, 0] - ring[k, 0])
            out[written, 1] = ring[k, 1] + t * (ring[m, 1] - ring[k, 1])
            written += 1
    return written


@inner_kernel
def _bisectors(
    xy: FloatArray, begin: int, end: int, i: int, near: float, half: FloatArray
) -> tuple[int, int]:
    """Write the half-planes (h, 3) closer to corner i than to others of its face; corner i is the origin.

    Neighbours come first, because few corners of the ring remain after these clips. Returns the number of
    half-planes, and the number of corners at the position of corner i.
    """
    total, count, coincident = end - begin, 0, 1
    for step in range(1, total):
        away = (step + 1) // 2 if step % 2 else total - step // 2
        j = begin + (i - begin + away) % total
        a, b = xy[j, 0] - xy[i, 0], xy[j, 1] - xy[i, 1]
        square = a * a + b * b
        if square <= near:
            coincident += 1
            continue
        half[count, 0], half[count, 1], half[count, 2] = a, b, 0.5 * square
        count += 1
    return count, coincident


@kernel
def _clip_all(
    xy: FloatArray,
    ring_start: IntArray,
    of_face: IntArray,
    planes: FloatArray,
    near: FloatArray,
    area: FloatArray,
) -> None:
    """Write the area (c,) of each corner's cell; arguments as in `nearest_areas`, in the faces' planes.

    ring_start : (r + 1,) rows of xy; of_face : (f + 1,) rows of rings; planes : (f, w, 3); near : (f,) [m2]
    """
    ring, other, windows = np.empty((64, 2)), np.empty((64, 2)), planes.shape[1]
    for f in range(len(of_face) - 1):
        begin, end = ring_start[of_face[f]], ring_start[of_face[f + 1]]
        half = np.empty((windows + end - begin, 3))
        for i in range(begin, end):
            for w in range(windows):
                a, b = planes[f, w, 0], planes[f, w, 1]
                half[w, 0], half[w, 1], half[w, 2] = a, b, planes[f, w, 2] - a * xy[i, 0] - b * xy[i, 1]
            halves, coincident = _bisectors(xy, begin, end, i, near[f], half[windows:])
            for r in range(of_face[f], of_face[f + 1]):
                count = ring_start[r + 1] - ring_start[r]
                if count > len(ring):
                    ring, other = np.empty((2 * count, 2)), np.empty((2 * count, 2))
                for k in range(count):
                    ring[k, 0] = xy[ring_start[r] + k, 0] - xy[i, 0]
                    ring[k, 1] = xy[ring_start[r] + k, 1] - xy[i, 1]
                for h in range(windows + halves):
                    if 2 * count > len(other):  # a clip leaves at most twice as many corners
                        other = np.empty((4 * count, 2))
                    count = _clip(ring, count, half[h, 0], half[h, 1], half[h, 2], other)
                    ring, other = other, ring
                double = 0.0
                for k in range(count):
                    m = k + 1 if k + 1 < count else 0
                    double += ring[k, 0] * ring[m, 1] - ring[k, 1] * ring[m, 0]
                area[i] += 0.5 * double  # anticlockwise positive
            area[i] /= coincident


MAX_FAN_CORNERS = 4  # largest number of corners of a face that is divided by triangles from its centroid


class FaceShares(NamedTuple):
    """Shares of c corners of faces; a corner may occur more than once. The shares of a face have the sum 1.

    face, node : (c,), nodes from n on are points without a particle; share : (c,)
    surface : (f,) [m2]; vector : (f, 3) [m2], half the sum of x_k x x_(k+1); upward, its z is the area in
    plan
    """

    face: np.ndarray
    node: np.ndarray
    share: np.ndarray
    surface: np.ndarray
    vector: np.ndarray

    def surface_areas(self) -> np.ndarray:
        """Return the surface areas (c,) [m2]."""
        return self.share * self.surface[self.face]

    def plan_areas(self) -> np.ndarray:
        """Return the areas in plan (c,) [m2]; zero on the outer side of a facade that faces downwards."""
        return self.share * np.maximum(0.0, self.vector[self.face, 2])

    def vector_areas(self) -> np.ndarray:
        """Return the vector areas (c, 3) [m2]."""
        return self.share[:, None] * self.vector[self.face]

    def at_nodes(self, values: np.ndarray, n: int) -> np.ndarray:
        """Sum values (c, ...) of the corners at the nodes (n, ...), without other points."""
        return sum_at_nodes(self.node, values, n)

    def centres(self, points: np.ndarray, n: int) -> np.ndarray:
        """Return the centres (n, 3) [m] of the areas of the nodes; points : (k, 3) [m], the nodes first.

        The share of a corner has its centre midway between the corner and the mean of its face.
        """
        corner = points[self.node]
        columns = [np.bincount(self.face, self.share * x, len(self.surface)) for x in corner.T]
        middle = 0.5 * (corner + np.column_stack(columns)[self.face])
        area, moment = self.surface_areas(), self.surface_areas()[:, None] * middle
        area, moment = self.at_nodes(area, n)[:, None], self.at_nodes(moment, n)
        return np.divide(moment, area, out=points[:n].copy(), where=area > 0.0)

    def on_nodes(self, n: int) -> "FaceShares":
        """Return the shares of the corners that are nodes, of n nodes."""
        on_node = self.node < n
        return self._replace(face=self.face[on_node], node=self.node[on_node], share=self.share[on_node])


def sum_at_nodes(node: IntArray, values: np.ndarray, n: int) -> np.ndarray:
    """Sum values (c, ...) of parts at nodes (c,) at the nodes (n, ...), without points from n on."""
    columns = [np.bincount(node, part, n)[:n] for part in np.atleast_2d(values.T)]
    return np.stack(columns, -1).reshape(n, *values.shape[1:]).astype(float)


def share_out_faces(points: np.ndarray, faces: Faces) -> FaceShares:
    """Divide the faces among their corners, points (k, 3) [m].

    Faces of three or four corners use the triangles of their cells (`corner_areas`), others the nearest
    corner.
    """
    rings, surface, vector = faces.rings, np.zeros(0), np.zeros((0, 3))
    if not len(faces):
        return FaceShares(faces.corner, faces.corner, surface, surface, vector)
    corner_area, face = corner_areas(points, faces), faces.face_of_corner()
    surface, vector = np.bincount(face, corner_area), vector_areas(points, rings)
    corners = np.bincount(rings.face_of_corner())
    has_few = corners <= MAX_FAN_CORNERS
    parts = [_in_proportion(corner_area, face, faces.corner, has_few)]
    if not has_few.all():
        of_many = rings.select_faces(~has_few)
        nearest = nearest_areas(points, of_many, vector[~has_few])
        face_of_corner = np.flatnonzero(~has_few)[of_many.face_of_corner()]
        parts.append(_in_proportion(nearest, face_of_corner, of_many.corner, ~has_few))
    face, node, share = (np.concatenate(column) for column in zip(*parts))
    return FaceShares(face, node, share, surface, vector)


def _in_proportion(
    area: FloatArray, face: IntArray, node: IntArray, chosen: BoolArray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return face, node and share of the corners of chosen faces, in proportion to areas (c,).

    The corners of a face without area have equal shares. Negative areas count as 0.
    chosen : (f,) faces whose corners are returned
    """
    is_chosen = chosen[face]
    area, face, node = np.maximum(area[is_chosen], 0.0), face[is_chosen], node[is_chosen]
    total, count = np.bincount(face, area), np.bincount(face)
    without_area = total == 0
    share = np.where(without_area[face], 1.0 / count[face], area / np.where(without_area, 1.0, total)[face])
    return face, node, share


def corner_areas(points: np.ndarray, faces: Faces) -> np.ndarray:
    """Compute the surface area (c,) [m2] of each corner of each cell; points : (k, 3) [m].

    A cell is cut into triangles from its centroid to its sides; each end of a side has half of its triangle.
    """
    upward = vector_areas(points, Faces(faces.start, faces.corner))[faces.of_corner()]

    def turned(u: FloatArray, v: FloatArray) -> FloatArray:
        cross = np.cross(u, v)
        return np.copysign(lengths(cross), np.sum(cross * upward, axis=1))

    half = 0.25 * centroid_triangle_areas(points, faces, lambda u, v: lengths(np.cross(u, v)), turned)
    area = half.copy()
    area[faces.next_corner()] += half
    return area


class Panels(NamedTuple):
    """Panels, the elements that support them, and the areas and loads of their corners.

    element, panel : (k,) pairs; of_corner : (c,) panel; node : (c,); count : of panels
    area, plan_area, vector : of c corners as in `areas.TributaryAreas`, with the area of each node as their
    sum
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
    shares = shares.on_nodes(net.n)
    node, surface = shares.node, shares.surface_areas()
    given = np.isfinite(net.normal[node])
    vector = np.where(given, surface[:, None] * net.normal[node], shares.vector_areas())
    # pairs of an element and a panel that has it as a side
    points, rings = net.n + len(net.corners), faces.rings
    sides, edge = pair_key(rings.sides(), points), pair_key(net.elements, points)
    order = np.argsort(sides, kind="stable")
    first, last = (np.searchsorted(sides[order], edge, side=side) for side in ("left", "right"))
    rows = np.concatenate([order[a:b] for a, b in zip(first, last)]) if len(edge) else order[:0]
    element, panel = np.repeat(np.arange(net.m), last - first), rings.face_of_corner()[rows]
    return Panels(element, panel, shares.face, node, faces.count, surface, shares.plan_areas(), vector)
