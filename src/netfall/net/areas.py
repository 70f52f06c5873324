"""Areas of the roof that each particle carries, and the normals that pressure and wind act along."""

from dataclasses import dataclass, field

import numpy as np
import shapely

from netfall.errors import InputError
from netfall.functions import lengths
from netfall.job.read import Job
from netfall.net.faces import Faces, double_area, find_faces, no_faces, turned_triangles
from netfall.net.given_faces import faces_are_given, given_faces
from netfall.net.net import Net
from netfall.net.plan import Plan, draw_plan, listed

REMEDY = (
    "name in [roof] groups the groups of elements whose faces carry the roof, mend the drawing, or give in "
    "nodes.csv `area` and, for wind and for pressure along the normal, normal_x, normal_y, normal_z"
)
PLAIN = (
    "saddle",
    "stadium",
    "ring",
)  # generators of nets of one layer whose elements meet at their ends alone


@dataclass(frozen=True)
class Roofing:
    """The faces of the roof, what share of its outline in plan they cover, and notes on what is odd."""

    faces: Faces
    covered: float = 0.0
    notes: list[str] = field(default_factory=list)


def roof_groups(job: Job) -> list[str]:
    """The groups whose faces carry the roof; none: all do."""
    return list(job.roof.groups or ()) if job.roof else []


def roof_of(job: Job, net: Net) -> Roofing:
    """The faces that carry loads and wind. Raises InputError where loads need faces that there are not."""
    groups = roof_groups(job)
    chosen = np.isin(net.group, [g for g, name in enumerate(net.group_names) if name in groups])
    carries = chosen[:: net.parts] if groups else np.ones(net.m // net.parts, bool)
    if faces_are_given(job):
        faces, plan = given_faces(job, net)
        notes = _notes(job, net, plan, faces, carries) if loads_the_roof(job) else []
        return Roofing(faces, _covered(plan, faces), notes)
    plan = draw_plan(net, carries, checked=job.net.generator not in PLAIN)
    if plan.errors:
        if _needs_faces(job, net):
            raise InputError([f"{job.path}: {error}; {REMEDY}" for error in plan.errors])
        return Roofing(no_faces(), 0.0, [f"the net has no faces: {error}" for error in plan.errors])
    faces = _faces_but_openings(job, net, plan)
    notes = _notes(job, net, plan, faces, carries) if loads_the_roof(job) else []
    return Roofing(faces, _covered(plan, faces), notes)


def _faces_but_openings(job: Job, net: Net, plan: Plan) -> Faces:
    """The faces but those that [roof] openings lie in. Raises InputError for a point that is in none."""
    try:
        return find_faces(net, plan, list(job.roof.openings) if job.roof else [])
    except ValueError as error:
        raise InputError(
            f"{job.path}: [roof] openings: [{x:g}, {y:g}] lies in no face of the net in plan; expected "
            "points [x, y] in m within the closed rings of elements that are to be left out"
            for x, y in error.args
        ) from None


def largest_face(x: np.ndarray, net: Net, faces: Faces) -> tuple[float, float, np.ndarray] | None:
    """Area in plan [m2] of the largest face and of the usual one, and where the largest lies [m].

    None where there is no face.

    x : (n, 3) [m]
    """
    if not len(faces):
        return None
    points = np.concatenate([x, net.corners])[:, :2]
    area = np.bincount(faces.of_corner(), 0.5 * turned_triangles(points, faces, double_area))
    f = int(np.argmax(area))
    ring = faces.corner[faces.start[f] : faces.start[f + 1]]
    within = shapely.point_on_surface(shapely.Polygon(points[ring]))
    return float(area[f]), float(np.median(area)), np.array([within.x, within.y])


def loads_the_roof(job: Job) -> bool:
    """Whether something acts on the areas of the roof."""
    weighs = any(job.loads("dead") + job.loads("snow"))
    return job.wind is not None or weighs or any(value is not None for value in job.loads("pressure"))


def along_normals(job: Job) -> bool:
    """Whether something acts along the normals of the roof."""
    return job.wind is not None or any(isinstance(value, int | float) for value in job.loads("pressure"))


def _needs_faces(job: Job, net: Net) -> bool:
    """Whether something acts on areas, or along normals, that the tables do not give."""
    bare = (net.area > 0) & ~np.isfinite(net.normal[:, 0])
    return loads_the_roof(job) and bool(np.isnan(net.area).any() or (along_normals(job) and bare.any()))


def _notes(job: Job, net: Net, plan: Plan, faces: Faces, carries: np.ndarray) -> list[str]:
    """What a user should know of the areas that loads act on. Raises InputError if there are none."""
    area, notes = tributary_areas(net.x, net, faces)[0], list(plan.notes)
    if not (area > 0).any():
        raise InputError(
            f"{job.path}: the net has no closed face in plan, so wind, dead load and pressure have nothing "
            "to act on; close the outline with elements between the supports, or give `area` in nodes.csv"
        )
    free = ~net.fixed.all(1)
    in_roof = np.zeros(net.n, bool)
    in_roof[net.elements[np.repeat(carries, net.parts)]] = True
    bare = np.flatnonzero((area == 0) & free & in_roof & ~np.isfinite(net.area))
    if len(bare):
        notes.append(
            f"{len(bare)} free nodes carry no roof area: {listed(net.node_id[bare])}; "
            "`area` in nodes.csv would give it"
        )
    rim = faces.open_rim[faces.open_rim < net.n]
    rim = rim[free[rim] & np.isnan(net.area[rim])]
    if len(rim):
        notes.append(
            f"at {len(rim)} free nodes on the edge of the faces elements go on without closing a face: "
            f"{listed(net.node_id[rim])}; closed faces cover {_covered(plan, faces):.1%} of the outline "
            "in plan; if the roof goes on to the supports, close it with elements between these"
        )
    return notes


def _covered(plan: Plan, faces: Faces) -> float:
    """Area of the faces over that of the convex outline of the plan."""
    if not len(faces):
        return 0.0
    outline = shapely.convex_hull(shapely.multipoints(plan.points[np.unique(plan.segment)]))
    return float(0.5 * turned_triangles(plan.points, faces, double_area).sum() / outline.area)


def tributary_areas(x: np.ndarray, net: Net, faces: Faces) -> tuple[np.ndarray, np.ndarray]:
    """Area of surface (n,) and in plan (n,) [m2], both >= 0, that each particle carries at x (n, 3) [m].

    Each face is cut into triangles from its centroid to its sides; half of each goes to either end of a side.
    Shares of points without a particle go to the rigid boundary. A given `area` is one of surface.
    """
    points = np.concatenate([x, net.corners])
    surface = _shares(points, faces, lambda u, v: lengths(np.cross(u, v)))[: net.n]
    plan = _shares(points[:, :2], faces, double_area)[: net.n]
    given = np.isfinite(net.area)
    if not given.any():
        return surface, plan
    normal = normals(x, net, faces)
    slope = np.where(normal.any(1), np.abs(normal[:, 2]), 1.0)
    return np.where(given, net.area, surface), np.where(given, net.area * slope, plan)


def _shares(points: np.ndarray, faces: Faces, double) -> np.ndarray:
    """What each point has of the faces around it; double : as in `turned_triangles`."""
    if not len(faces):
        return np.zeros(len(points))
    half = 0.25 * np.abs(turned_triangles(points, faces, double))
    return sum(
        np.bincount(end, half, len(points)) for end in (faces.corner, faces.corner[faces.next_corner()])
    )


def corner_areas(points: np.ndarray, faces: Faces) -> np.ndarray:
    """Area of surface (c,) [m2] that each corner of each face has of it; points : (k, 3) [m]."""
    half = 0.25 * turned_triangles(points, faces, lambda u, v: lengths(np.cross(u, v)))
    area = half.copy()
    area[faces.next_corner()] += half
    return area


def normals(x: np.ndarray, net: Net, faces: Faces) -> np.ndarray:
    """Upward unit normals (n, 3) of the particles at x (n, 3) [m]; zero where a particle meets no face.

    Those of the tables where they are given; else the sum of the vector areas of the faces around (Newell).
    """
    found = np.zeros((net.n, 3))
    if len(faces):
        points = np.concatenate([x, net.corners])
        p, q = points[faces.corner], points[faces.corner[faces.next_corner()]]
        of_corner = faces.of_corner()
        vector = np.stack([np.bincount(of_corner, c, len(faces)) for c in 0.5 * np.cross(p, q).T], -1)
        around = [np.bincount(faces.corner, vector[of_corner, k], len(points)) for k in range(3)]
        total = np.stack(around, -1)[: net.n]
        length = lengths(total)[:, None]
        found = np.divide(total, length, out=found, where=length > 0)
    return np.where(np.isfinite(net.normal), net.normal, found)
