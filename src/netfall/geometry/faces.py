"""Faces of the net: the smallest closed rings of elements and outline in plan, or rows of a table.

A table gives the faces if they do not follow from the plan.

A face with holes, or one that is not star-shaped about its centroid, is cut into cells.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from netfall.core.arrays import AnyArray, BoolArray, FloatArray, IntArray, distinct, is_one_of, rows_of
from netfall.core.errors import InputError
from netfall.core.functions import lengths
from netfall.geometry import messages
from netfall.geometry.net import Net, pair_key
from netfall.geometry.plan import Plan, draw_plan
from netfall.job import messages as job_messages
from netfall.job.csv_table import AXES, Table
from netfall.job.job import Job
from netfall.job.values import format_value

FLAT = 1e-12  # share of a face's area; a smaller inverted triangle at the centroid is rounding
COCIRCULAR = 1e-6  # sum of two cotangents below which four corners lie on one circle


@dataclass(frozen=True)
class Faces:
    """Corner numbers of the cells of faces, anticlockwise in plan, each star-shaped about its centroid.

    A face that is not star-shaped about its centroid, or has holes, has several cells; any other is one cell.

    start : (k + 1,) rows of `corner` at which each cell starts
    corner : numbers of points; from n on without a particle
    open_rim : points at the edge of the faces from which an element of the roof continues
    face : (k,) the face of each cell, ascending; None: each cell is a face
    whole : the rings of the faces, holes clockwise; None: as the cells
    """

    start: np.ndarray = field(default_factory=lambda: np.zeros(1, np.int64))
    corner: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    open_rim: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    face: np.ndarray | None = None
    whole: "Faces | None" = None

    def __len__(self) -> int:
        return len(self.start) - 1

    @property
    def count(self) -> int:
        """Number of faces."""
        return len(self) if self.face is None else int(self.face[-1]) + 1

    @property
    def rings(self) -> "Faces":
        """Rings of the faces, the outer ring of each face first."""
        return self if self.whole is None else self.whole

    def next_corner(self) -> np.ndarray:
        """Return for each corner the row of the next corner of its ring."""
        after = np.arange(1, len(self.corner) + 1)
        after[self.start[1:] - 1] = self.start[:-1]
        return after

    def sides(self) -> np.ndarray:
        """Return both ends (c, 2) of the side that starts at each corner."""
        return np.column_stack([self.corner, self.corner[self.next_corner()]])

    def of_corner(self) -> np.ndarray:
        """Return for each corner the number of its ring."""
        return np.repeat(np.arange(len(self)), np.diff(self.start))

    def face_of_corner(self) -> np.ndarray:
        """Return for each corner the number of its face."""
        return self.of_corner() if self.face is None else self.face[self.of_corner()]

    def first_rings(self) -> np.ndarray:
        """Return the first ring (f,) of each face."""
        number = np.arange(self.count)
        return number if self.face is None else np.searchsorted(self.face, number)

    def first_corners(self) -> np.ndarray:
        """Return the first corner (f,) of each face."""
        return self.corner[self.start[self.first_rings()]]

    def select_faces(self, mask: np.ndarray) -> "Faces":
        """Return the rings of some faces, mask (f,), renumbered."""
        selected = mask if self.face is None else mask[self.face]
        face = None if self.face is None else (np.cumsum(mask) - 1)[self.face[selected]]
        return replace(_selected(self, selected), face=face)


def find_faces(net: Net, plan: Plan | None = None, openings: Sequence[Any] = ()) -> Faces:
    """Find the faces of the net in plan: the smallest closed rings of elements and outline, less their holes.

    A face that is not star-shaped about its centroid, or has holes, gets the cells of its constrained
    Delaunay tessellation. The cells do not depend on the order of nodes and elements.

    openings : points (k, 2) [m] in faces to exclude

    Raises ValueError with the points outside all faces.
    """
    plan = plan or draw_plan(net)
    if not len(plan.segment):
        return Faces()
    polygons = shapely.get_parts(shapely.polygonize(shapely.linestrings(plan.points[plan.segment])))
    rings, polygon = _rings(polygons, plan.points, distinct(plan.segment))
    # the rim: points where segments that bound no face meet sides with a face on only one side
    sides, count = rings.sides(), len(plan.points)
    values, row, times = np.unique(pair_key(sides, count), return_inverse=True, return_counts=True)
    unbounded = plan.segment[~is_one_of(pair_key(plan.segment, count), values)]
    open_rim = np.intersect1d(sides[times[row.ravel()] == 1], unbounded)
    opening_points = shapely.points(np.reshape(openings, (-1, 2)))
    hit, opened = shapely.STRtree(polygons).query(opening_points, predicate="within")
    if len(outside := np.setdiff1d(np.arange(len(opening_points)), hit)):
        raise ValueError(*(openings[k] for k in outside))
    closed = ~np.isin(polygon, opened)
    rings, polygon = _selected(rings, closed), polygon[closed]
    faces = faces_of_rings(insert_side_particles(rings, plan, net), polygon, plan.points)
    return replace(faces, open_rim=open_rim)


def faces_of_rings(rings: Faces, polygon: np.ndarray, points: np.ndarray) -> Faces:
    """Build the faces bounded by rings, star-shaped faces with a single ring first.

    polygon : (r,) number of the face that each ring bounds, its outer ring first; points : (k, 2) [m]
    """
    single = np.bincount(polygon, minlength=polygon.max(initial=-1) + 1) == 1
    plain = single[polygon] & _is_star_shaped(rings, points)
    simple = _selected(rings, plain)
    if plain.all():
        return simple
    corners = np.split(rings.corner, rings.start[1:-1])
    cut = [[corners[r] for r in np.flatnonzero(polygon == f)] for f in np.unique(polygon[~plain])]
    rings_of = [Faces(np.cumsum([0, *map(len, shapes)]), np.concatenate(shapes)) for shapes in cut]
    whole = _joined(simple, rings_of)
    return replace(_joined(simple, [_delaunay_cells(points, shapes) for shapes in cut]), whole=whole)


def _joined(plain: Faces, others: list[Faces]) -> Faces:
    """Join the rings of faces with one ring and of faces with several."""
    parts = [plain, *others]
    sizes = np.concatenate([np.diff(part.start) for part in parts])
    number = np.repeat(np.arange(len(others)), [len(other) for other in others])
    face = np.concatenate([np.arange(len(plain)), len(plain) + number])
    start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    return Faces(start, np.concatenate([part.corner for part in parts]), face=face.astype(np.int64))


def _rings(polygons: AnyArray, points: FloatArray, used: IntArray) -> tuple[Faces, np.ndarray]:
    """Return the rings of polygons between points `used`, each polygon's outer one first, and their polygons.

    Holes run clockwise.
    """
    rings, polygon = shapely.get_rings(shapely.orient_polygons(polygons), return_index=True)
    xy, ring = shapely.get_coordinates(rings, return_index=True)
    last = np.append(ring[1:] != ring[:-1], True) if len(ring) else np.zeros(0, bool)
    xy, ring = xy[~last], ring[~last]  # the last point of a ring repeats the first
    order = used[np.lexsort((points[used, 1], points[used, 0]))]
    key = points[order, 0] + 1j * points[order, 1]
    corner = order[np.searchsorted(key, xy[:, 0] + 1j * xy[:, 1])]
    start = np.concatenate([[0], np.cumsum(np.bincount(ring, minlength=len(rings)))]).astype(np.int64)
    return Faces(start, corner), polygon


def _selected(faces: Faces, mask: BoolArray) -> Faces:
    """Return the rings in mask."""
    sizes = np.diff(faces.start)
    start = np.concatenate([[0], np.cumsum(sizes[mask])]).astype(np.int64)
    return Faces(start, faces.corner[np.repeat(mask, sizes)])


def insert_side_particles(rings: Faces, plan: Plan, net: Net) -> Faces:
    """Return the rings with the particles of subdivision on their sides as additional corners."""
    if net.parts == 1 or not len(rings):
        return rings
    sides, key = rings.sides(), pair_key(plan.segment, len(plan.points))
    row = rows_of(key, pair_key(sides, len(plan.points)))
    turned = plan.segment[row, 0] != sides[:, 0]
    element, span = plan.element[row], plan.span[row]
    inner = net.inner_particles()[element]  # wrong for segments of the outline, which `on_side` excludes
    ends = plan.points[net.undivided()[element]]
    t, distance = np.arange(1, net.parts) / net.parts, lengths(ends[:, 1] - ends[:, 0])
    margin = np.where(np.ptp(span, axis=1) < 1.0, net.tolerance / np.maximum(distance, 1e-300), 0.0)[:, None]
    on_side = (element >= 0)[:, None] & (t > span[:, :1] + margin) & (t < span[:, 1:] - margin)

    def flip(values: Any) -> Any:
        return np.where(turned[:, None], values[:, ::-1], values)

    keep = np.column_stack([np.ones(len(sides), bool), flip(on_side)])
    corner = np.column_stack([rings.corner, flip(inner)])[keep]
    return Faces(np.concatenate([[0], np.cumsum(keep.sum(1))])[rings.start], corner)


def _is_star_shaped(rings: Faces, points: FloatArray) -> np.ndarray:
    """Return whether each ring is star-shaped about its centroid; holes are not."""
    if not len(rings):
        return np.zeros(0, bool)
    double = centroid_triangle_areas(points, rings)
    total = np.bincount(rings.of_corner(), double, len(rings))
    return (total > 0) & (np.minimum.reduceat(double, rings.start[:-1]) >= -FLAT * np.abs(total))


def double_area(u: FloatArray, v: FloatArray) -> np.ndarray:
    """Compute twice the signed area of triangles in plan with sides u, v (k, 2)."""
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def centroid_triangle_areas(
    points: FloatArray,
    faces: Faces,
    double: Callable[..., Any] = double_area,
    weigh: Callable[..., Any] | None = None,
) -> np.ndarray:
    """Compute twice the areas (c,) of the triangles from the centroids to the sides, by `double`.

    weigh : twice the areas, inverted ones negative, that weight the centroid; default: `double`
    """
    p, middle = points[faces.corner], centroids(points, faces, weigh or double)[faces.of_corner()]
    return double(p - middle, points[faces.corner[faces.next_corner()]] - middle)


def centroids(points: FloatArray, faces: Faces, double: Callable[..., Any]) -> np.ndarray:
    """Compute the centroids (k, d) of the cells, from triangles about their mean corner, by `double`."""
    of_corner, nxt, counts = faces.of_corner(), faces.next_corner(), np.diff(faces.start)

    def mean_by_cell(values: Any, weight: AnyArray) -> FloatArray:
        return np.stack(
            [np.bincount(of_corner, values[:, k], len(faces)) / weight for k in range(values.shape[1])], -1
        )

    p = points[faces.corner]
    middle = mean_by_cell(p, np.maximum(counts, 1))
    u, v = p - middle[of_corner], p[nxt] - middle[of_corner]
    cross = 0.5 * double(u, v)
    area = np.bincount(of_corner, cross, len(faces))
    return middle + mean_by_cell(cross[:, None] * (u + v) / 3, np.where(area == 0, 1, area))


def corner_quadrilaterals(points: FloatArray, faces: Faces) -> np.ndarray:
    """Return the quarters (c, 4, 2) [m] of the cells in plan: corner, side midpoints and centroid."""
    corner, after = points[faces.corner], faces.next_corner()
    middle = centroids(points, faces, double_area)[faces.of_corner()]
    side = 0.5 * (corner + corner[after])
    before = np.empty_like(side)
    before[after] = side
    return np.stack([corner, side, middle, before], 1)


def vector_areas(points: np.ndarray, rings: Faces) -> np.ndarray:
    """Compute the vector areas (f, 3) [m2] of the faces, half the sum of x_k x x_(k+1) from one corner."""
    face = rings.face_of_corner()
    start = points[rings.first_corners()][face]
    p, q = points[rings.corner] - start, points[rings.corner[rings.next_corner()]] - start
    return np.stack([np.bincount(face, part, rings.count) for part in 0.5 * np.cross(p, q).T], -1)


def _delaunay_cells(points: Any, shapes: list[np.ndarray]) -> Faces:
    """Build the cells of the constrained Delaunay tessellation of a polygon.

    shapes : outer ring and holes as corner numbers

    Triangles with corners on one circle form one cell, because the diagonal between them is arbitrary.
    """
    polygon = shapely.Polygon(points[shapes[0]], [points[ring] for ring in shapes[1:]])
    used = np.unique(np.concatenate(shapes))
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    triangles = _rings(parts, points, used)[0].corner.reshape(-1, 3)
    a, b, c = (points[np.roll(triangles, -k, axis=1)] for k in range(3))  # c: opposite the side from a to b
    u, v = (a - c).reshape(-1, 2), (b - c).reshape(-1, 2)
    cotangent = np.sum(u * v, axis=1) / np.maximum(double_area(u, v), 1e-300)
    sides = np.column_stack([triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()])
    pairs, row, times = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True)
    arbitrary = (times == 2) & (np.abs(np.bincount(row.ravel(), cotangent)) < COCIRCULAR)
    cells = shapely.get_parts(shapely.polygonize(shapely.linestrings(points[pairs[~arbitrary]])))
    cells = cells[shapely.contains(polygon, shapely.point_on_surface(cells))]  # drops cells in holes
    return _rings(cells, points, used)[0]


MIN_OVERLAP = 1e-6  # share of the smaller of two faces below which their overlap is rounding
SAME_SURFACE = 0.25  # distance of two planes / size of their overlap, below which they may be one surface
SAME_SLOPE = 0.7  # cosine of the angle between two planes, above which they may be one surface
MIN_PLAN_RATIO = 1e-6  # ratio of plan to surface area below which a face has no orientation in plan


def read_faces(job: Job, net: Net) -> tuple[Faces, Plan]:
    """Read the faces of the table `[roof] faces`, and their sides as a plan. Sets `net.corners`.

    Rows of one face are consecutive: its corners in order, anticlockwise as seen from `[roof] normal` or
    from above, then those around each of its holes, clockwise; `ring` counts the rings, 0 for the outer one.
    The normals of the faces follow from this order by the right-hand rule. A corner is the id of a node, or
    the position [m] of a point without a node. Raises InputError; faces are checked after all cells are
    correct.
    """
    roof: Any = job.roof
    if keys := [key for key in ("groups", "openings", "lines") if getattr(roof, key)]:
        raise InputError(messages.FACES_AND_OTHERS(path=job.path, keys=" and ".join(keys)))
    table = Table(job.path.parent / roof.faces, ("face", "ring", "node", *AXES), ("face", "node"))
    corner, net.corners = _corners(table, net)
    face = table.integers("face")
    ring = table.integers("ring") if "ring" in table else np.zeros(len(table), np.int64)
    start = np.flatnonzero(np.append(True, (face[1:] != face[:-1]) | (ring[1:] != ring[:-1])))
    space = net.in_plan(np.concatenate([net.x, net.corners]))
    rings, points = Faces(np.append(start, len(face)), corner), space[:, :2]
    side = f"[roof] normal = {format_value(roof.normal)}" if roof.normal else "above"
    table.finish()  # faces with wrong ids have no geometry to check
    _check(table, face[start], ring[start], rings, space, side)
    table.finish()
    sides = rings.sides()  # each side once, with the undivided element on it
    sides = sides[np.unique(pair_key(sides, len(points)), return_index=True)[1]]
    element = rows_of(pair_key(net.undivided(), len(points)), pair_key(sides, len(points)))
    sides = np.where((element >= 0)[:, None], net.undivided()[element], sides)  # in its direction
    plan = Plan(points, sides, element, np.tile([0.0, 1.0], (len(sides), 1)), table.notes)
    polygon = np.cumsum(np.append(False, face[start][1:] != face[start][:-1]))
    return faces_of_rings(insert_side_particles(rings, plan, net), polygon, points), plan


def _corners(table: Table, net: Net) -> tuple[np.ndarray, np.ndarray]:
    """Return the point (c,) of each row, from n on without a node, and positions (k, 3) [m] of the others."""
    ids = net.node_id[: net.given]  # nodes of `subdivide` are added later
    rows = {str(number): row for row, number in enumerate(ids.tolist())}
    place = table.stacked(AXES, unit="m")
    corner = np.zeros(len(table), np.int64)
    extra: dict[tuple[float, ...], int] = {}
    for row, word in enumerate(table.words("node")):
        if word:
            corner[row] = rows.get(word, 0)
            if word not in rows:
                at, number = table.at(row), word[:40]
                table.wrong(messages.NO_SUCH_NODE(row=at, name="node", number=number, nodes="the net"))
        elif np.isnan(place[row]).any():
            table.wrong(messages.FACE_POINT_MISSING(row=table.at(row)))
        else:
            corner[row] = net.n + extra.setdefault(tuple(place[row].tolist()), len(extra))
    return corner, np.array(list(extra)).reshape(-1, 3)


def _check(
    table: Table, number: np.ndarray, ring: np.ndarray, faces: Faces, points: np.ndarray, side: str
) -> None:
    """Report faces that are not consecutive, have too few corners or the wrong direction, or occur twice.

    number, ring : (r,) of the rings `faces`; points : (k, 3) [m], as seen from above; side : name of this
    side
    """
    first = np.append(True, number[1:] != number[:-1])
    values, times = np.unique(number[first], return_counts=True)
    for value in values[times > 1]:
        table.wrong(messages.SCATTERED_FACE(face=value))
    expected = np.arange(len(ring)) - np.maximum.accumulate(np.where(first, np.arange(len(ring)), 0))
    for f in np.flatnonzero(ring != expected):
        table.wrong(messages.WRONG_RING(face=number[f], ring=ring[f]))
    vector = vector_areas(points, faces)
    area, upright = vector[:, 2], np.abs(vector[:, 2]) < MIN_PLAN_RATIO * lengths(vector)
    for f in np.flatnonzero(upright)[:1]:
        surface = lengths(vector[f])
        error = messages.UPRIGHT_FACES(
            count=upright.sum(), side=side, face=number[f], plan=area[f], surface=surface
        )
        table.wrong(error)
    for f, corners in enumerate(np.split(faces.corner, faces.start[1:-1])):
        if len(np.unique(corners)) < max(3, len(corners)):
            table.wrong(messages.WRONG_CORNERS(face=number[f], problem=f"{len(np.unique(corners))} corners"))
        elif not (upright[f] or (area[f] < 0.0 if ring[f] else area[f] > 0.0)):
            corners = "the corners of a hole clockwise" if ring[f] else "its corners anticlockwise"
            table.wrong(messages.WRONG_TURN(face=number[f], area=area[f], corners=corners, side=side))
    table.finish()
    _check_order(table, number, faces, points)
    first_row: dict[frozenset[int], str] = {}
    for f in np.flatnonzero(ring == 0):
        row, corners = table.at(faces.start[f]), frozenset(faces.corner[faces.start[f] : faces.start[f + 1]])
        if first_row.setdefault(corners, row) != row:
            expected = f"other corners than those of the face at {first_row[corners]}"
            cell = str(number[f])
            table.wrong(job_messages.INVALID_CELL(row=row, name="face", cell=cell, expected=expected))


def _check_order(table: Table, number: np.ndarray, faces: Faces, points: np.ndarray) -> None:
    """Report faces whose sides cross in plan, whose holes are not inside, and faces that overlap.

    Arguments as for `_check`.
    """
    rings = [points[corners] for corners in np.split(faces.corner, faces.start[1:-1])]
    first = np.flatnonzero(np.append(True, number[1:] != number[:-1])).tolist()
    polygons = []
    for f, end in pairwise([*first, len(rings)]):
        polygon = shapely.Polygon(rings[f][:, :2], [ring[:, :2] for ring in rings[f + 1 : end]])
        if not polygon.is_valid:
            table.wrong(messages.WRONG_CORNERS(face=number[f], problem=shapely.is_valid_reason(polygon)))
        polygons.append(polygon)
    table.finish()
    if shapely.coverage_is_valid(polygons):
        return
    pairs = np.sort(shapely.STRtree(polygons).query(polygons, predicate="intersects").T, axis=1)
    pairs = np.unique(pairs[pairs[:, 0] < pairs[:, 1]], axis=0)
    common = shapely.intersection(*np.array(polygons)[pairs].T)
    area, size = shapely.area(common), shapely.area(polygons)[pairs].min(1)
    pairs, common, area = (values[area > MIN_OVERLAP * size] for values in (pairs, common, area))
    at, row = shapely.get_coordinates(shapely.centroid(common)), np.array(first)[pairs]
    vector, middle = vector_areas(points, faces)[row], np.array([ring.mean(0) for ring in rings])[row]
    # height of the plane of each face of a pair
    rise = np.sum(vector[:, :, :2] * (at[:, None] - middle[:, :, :2]), axis=2) / vector[:, :, 2]
    distance = np.abs(np.diff(middle[:, :, 2] - rise, axis=1)[:, 0])
    cosine = np.sum(vector[:, 0] * vector[:, 1], axis=1) / (lengths(vector[:, 0]) * lengths(vector[:, 1]))
    same = (distance < SAME_SURFACE * np.sqrt(area)) & (cosine > SAME_SLOPE)
    if same.any():
        k = int(np.argmax(same))
        a, b = number[row[k]]
        overlap = messages.OVERLAPPING_FACES(
            table=table.path, count=same.sum(), first=a, second=b, area=area[k]
        )
        table.notes.append(overlap)
