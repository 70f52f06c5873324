"""Roof areas of the particles; pressure and wind act on the vector areas."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import shapely

from netfall.core.arrays import distinct, is_one_of
from netfall.core.errors import InputError
from netfall.core.functions import lengths
from netfall.geometry import messages
from netfall.geometry.faces import Faces, centroid_triangle_areas, find_faces, read_faces
from netfall.geometry.net import Net, connected_parts, pair_key
from netfall.geometry.plan import Plan, draw_plan
from netfall.geometry.shares import FaceShares, share_out_faces
from netfall.job.derived import has_area_loads, has_normal_loads, roof_groups
from netfall.job.job import Job
from netfall.job.values import format_list

# generators of single-layer nets with elements that meet only at their ends
PLANAR_GENERATORS = ("saddle", "stadium", "ring")
MAX_COSINE = 0.17  # cosine of 80 degrees: a steeper plane is upright


class TributaryAreas(NamedTuple):
    """Roof areas of the particles, as sums of shares of faces.

    surface, plan : (n,) [m2], both >= 0; vector : (n, 3) [m2], upward: pressure p gives the force -p vector
    centre : (n, 3) [m], of the shares of a node; a node without one is its own centre
    """

    surface: np.ndarray
    plan: np.ndarray
    vector: np.ndarray
    centre: np.ndarray
    shares: FaceShares


@dataclass(frozen=True)
class RoofFaces:
    """Faces of the roof, the share of the roof outline in plan that they cover, and notes.

    given : the areas in the given geometry
    """

    faces: Faces
    given: TributaryAreas
    covered_share: float = 0.0
    notes: list[str] = field(default_factory=list)


def find_roof(job: Job, net: Net) -> RoofFaces:
    """Find the faces that carry loads and wind. Raises InputError if faces needed by loads do not exist."""
    groups = roof_groups(job)
    carries = net.is_in_groups(groups)[:: net.parts] if groups else np.ones(net.m // net.parts, bool)
    if job.roof and job.roof.faces is not None:
        faces, plan = read_faces(job, net)
        return _roofing(job, net, faces, plan, carries)
    lines = bool(job.roof and job.roof.lines)
    planar = job.net.generator in PLANAR_GENERATORS and net.roof_axes is None
    plan = draw_plan(net, carries, checked=lines or not planar)
    if plan.error and _needs_faces(job, net):
        error = messages.UNCLEAR_FACES(reason=_with_upright_plane(net, plan.error))
        raise InputError([f"{job.path}: {error}"])
    if plan.error:
        notes = [messages.NO_FACES(reason=plan.error)]
        if areas_are_given(net):
            notes = [messages.GIVEN_AREAS()] * has_area_loads(job)
        return RoofFaces(Faces(), tributary_areas(net.x, net, Faces()), notes=notes)
    try:
        faces = find_faces(net, plan, list(job.roof.openings) if job.roof else [])
    except ValueError as error:  # points in no face
        raise InputError(f"{job.path}: {messages.WRONG_OPENING(x=x, y=y)}" for x, y in error.args) from None
    unconnected = _unconnected(net, plan, faces)
    if unconnected and _needs_faces(job, net):
        lines = [messages.UNCONNECTED_RING(outside=a, inside=b) for a, b in unconnected]
        raise InputError([f"{job.path}: {line}" for line in lines])
    loose = [messages.LOOSE_RING_NOTE(outside=a, inside=b) for a, b in unconnected]
    return _roofing(job, net, faces, plan, carries, loose)


def _with_upright_plane(net: Net, reason: str) -> str:
    """Add to a reason for missing faces the normal of an upright plane through all nodes, if any."""
    spread, directions = np.linalg.eigh(np.cov(net.x.T))  # variances ascend
    normal = directions[:, 0]
    if net.roof_axes is not None or spread[0] > MAX_COSINE**2 * spread[1] or abs(normal[2]) > MAX_COSINE:
        return reason
    x, y, z = normal.round(3) + 0.0
    return messages.UPRIGHT_PLANE.format(reason=reason, x=x, y=y, z=z)


def _roofing(
    job: Job, net: Net, faces: Faces, plan: Plan, carries: np.ndarray, loose: Sequence[str] = ()
) -> RoofFaces:
    """Build the roof of known faces; carries : (m / parts,) bool; loose : notes to append."""
    covered = 0.0
    if len(faces):  # relative to the area of the convex outline of the net and its faces
        ends = net.elements[np.repeat(carries, net.parts)]
        outline = shapely.MultiPoint(plan.points[distinct(np.concatenate([plan.segment, ends]))]).convex_hull
        covered = float(0.5 * centroid_triangle_areas(plan.points, faces).sum() / outline.area)
    roofing = RoofFaces(faces, tributary_areas(net.x, net, faces), covered)
    notes = [*_notes(job, net, plan, roofing, carries)] if has_area_loads(job) else []
    surface, in_plan = roofing.given.surface.sum(), roofing.given.plan.sum()
    if has_normal_loads(job) and net.roof_axes is None and in_plan < MAX_COSINE * surface:
        notes.append(messages.STEEP_ROOF(plan=in_plan, surface=surface))
    return replace(roofing, notes=[*notes, *loose])


def _unconnected(net: Net, plan: Plan, faces: Faces) -> list[tuple[str, str]]:
    """Return the nodes of the outer ring and of each inner ring without a connection to it."""
    rings = faces.rings
    if len(rings) == faces.count:
        return []
    label = connected_parts(np.concatenate([net.elements, plan.segment]), len(plan.points))
    of_ring = label[rings.corner[rings.start[:-1]]]
    outer = rings.first_rings()[rings.face]

    def names(ring: Any) -> str:
        nodes = rings.corner[rings.start[ring] : rings.start[ring + 1]]
        return format_list(np.sort(net.node_id[nodes[nodes < net.n]]))

    return [(names(outer[r]), names(r)) for r in np.flatnonzero(of_ring != of_ring[outer])]


def largest_face(net: Net, faces: Faces) -> tuple[float, float, np.ndarray] | None:
    """Return the plan areas [m2] of the largest and the median face, and a point [m] in the largest.

    All are of the given geometry, as `[roof] openings` are. None without faces.
    """
    if not len(faces):
        return None
    points = net.in_plan(np.concatenate([net.x, net.corners]))[:, :2]
    area = np.bincount(faces.face_of_corner(), 0.5 * centroid_triangle_areas(points, faces))
    f, rings = int(np.argmax(area)), faces.rings
    first = rings.first_rings()
    around = range(first[f], first[f + 1] if f + 1 < len(first) else len(rings))
    outer, *holes = (points[rings.corner[rings.start[r] : rings.start[r + 1]]] for r in around)
    point = shapely.point_on_surface(shapely.Polygon(outer, holes))
    return float(area[f]), float(np.median(area)), np.array([point.x, point.y])


def areas_are_given(net: Net) -> bool:
    """Return whether nodes.csv gives the area of every node, so that no area is computed from faces."""
    return bool(np.isfinite(net.area).all())


def _needs_faces(job: Job, net: Net) -> bool:
    """Return whether a load needs areas or normals that the tables do not give."""
    bare = (net.area > 0) & ~np.isfinite(net.normal[:, 0])
    return has_area_loads(job) and bool(not areas_are_given(net) or (has_normal_loads(job) and bare.any()))


def _notes(job: Job, net: Net, plan: Plan, roofing: RoofFaces, carries: np.ndarray) -> Iterator[str]:
    """Yield warnings about the areas on which loads act. Raises InputError without any area."""
    faces, area = roofing.faces, roofing.given.surface
    if not (area > 0).any():
        raise InputError(messages.NO_CLOSED_FACE(path=job.path))
    yield from plan.notes
    free = net.moves
    in_roof = np.zeros(net.n, bool)
    in_roof[net.elements[np.repeat(carries, net.parts)]] = True
    without_area = net.node_id[(area == 0) & free & in_roof & ~np.isfinite(net.area)]
    if len(without_area):
        yield messages.NODES_WITHOUT_AREA(count=len(without_area), nodes=format_list(without_area))
    lines, points = plan.segment[plan.element < 0], len(plan.points)
    unused_lines = lines[~is_one_of(pair_key(lines, points), pair_key(faces.rings.sides(), points))]
    unused_lines = [f"{a} to {b}" for a, b in net.node_id[unused_lines[(unused_lines < net.n).all(1)]]]
    if unused_lines:
        yield messages.UNUSED_LINES(count=len(unused_lines), lines=format_list(unused_lines))
    rim = faces.open_rim[faces.open_rim < net.n]
    rim = rim[free[rim] & np.isnan(net.area[rim])]
    if len(rim):
        nodes, share = format_list(net.node_id[rim]), roofing.covered_share
        yield messages.OPEN_RIM(count=len(rim), nodes=nodes, share=share)


def tributary_areas(x: np.ndarray, net: Net, faces: Faces) -> TributaryAreas:
    """Compute the areas of the particles at x (n, 3) [m], by the shares of the faces (`geometry.shares`).

    Shares of points without a particle go to the rigid boundary. A given `area` is the surface area. Without
    a normal, plan and vector areas are scaled in proportion; with one, the vector is surface times unit
    normal.
    """
    points = np.concatenate([x, net.corners])
    shares = share_out_faces(points, faces)
    centre = shares.centres(points, net.n)
    areas = (shares.surface_areas(), shares.plan_areas(), shares.vector_areas())
    surface, plan, vector = (shares.at_nodes(area, net.n) for area in areas)
    area = np.where(has_half_area(net), 0.5 * surface, net.area)
    of_area, of_normal = np.isfinite(area), np.isfinite(net.normal[:, 0])
    # if slopes of faces differ, plan and vector are less than the surface along the mean normal
    of_faces = np.where(surface > 0.0, surface, 1.0)
    plan_share = np.where(
        of_normal, np.maximum(0.0, net.normal[:, 2]), np.where(surface > 0.0, plan / of_faces, 1.0)
    )
    vector_share = np.where(of_normal[:, None], net.normal, vector / of_faces[:, None])
    surface, plan = np.where(of_area, area, surface), np.where(of_area, area * plan_share, plan)
    vector = np.where((of_area | of_normal)[:, None], surface[:, None] * vector_share, vector)
    return TributaryAreas(surface, plan, vector, centre, shares)


def roof_parts(net: Net, areas: TributaryAreas) -> tuple[np.ndarray, ...]:
    """Return node (r,), surface and plan area (r,) [m2], and vector area (r, 3) [m2] of the parts of a roof.

    The parts are the corners of the faces. If nodes.csv gives areas, halves of the corners belong to the
    nearer ends of `subdivide`, and the last parts are the given areas of nodes without a face.
    """
    shares, given = areas.shares.on_nodes(net.n), np.isfinite(net.area)
    halves, last = shares.node[None], np.flatnonzero(given)
    if len(last):
        ends = nearer_ends(net)[:, shares.node]
        halves = np.where(given[ends], ends, shares.node)
    node = np.append(halves, last)

    def of_parts(values: np.ndarray) -> np.ndarray:
        padding = np.zeros((len(last), *values.shape[1:]))
        return np.concatenate([*[values / len(halves)] * len(halves), padding])

    surface, plan, vector = map(
        of_parts, (shares.surface_areas(), shares.plan_areas(), shares.vector_areas())
    )
    total = np.bincount(node, surface, net.n)
    scale = np.divide(areas.surface, total, out=np.ones(net.n), where=total > 0.0)[node]
    surface, plan, vector = scale * surface, scale * plan, scale[:, None] * vector
    bare, end = total[last] == 0.0, slice(halves.size, None)
    surface[end], plan[end] = np.where(bare, areas.surface[last], 0.0), np.where(bare, areas.plan[last], 0.0)
    normal = net.normal[node]
    of_normal = np.isfinite(normal[:, 0])
    plan = np.where(of_normal, surface * np.maximum(0.0, normal[:, 2]), plan)
    return node, surface, plan, np.where(of_normal[:, None], surface[:, None] * normal, vector)


def nearer_ends(net: Net) -> np.ndarray:
    """Return the nearer end (h, k) of the table's element around each particle; other points are their own.

    With an even number of parts (h = 2), the halves of a middle particle have different ends.
    """
    ends = np.tile(np.arange(net.n + len(net.corners)), (2 - net.parts % 2, 1))
    start, end = net.undivided().T[:, :, None]
    for half, of_half in enumerate(ends):
        of_half[net.inner_particles()] = np.where(2 * np.arange(1, net.parts) > net.parts - half, end, start)
    return ends


def has_half_area(net: Net) -> np.ndarray:
    """Return which nodes (n,) are in the middle of a subdivided element and next to a given area of one end.

    The given area already covers the other half of their area.
    """
    is_half = np.zeros(net.n, bool)
    if net.parts % 2 == 0:
        middle = net.inner_particles()[:, net.parts // 2 - 1]
        is_half[middle] = np.isfinite(net.area)[net.undivided()].any(1) & np.isnan(net.area[middle])
    return is_half


def outer_side_line(vector: np.ndarray) -> str:
    """Describe the outer side of vector areas (n, 3) [m2] by the resultant of a pressure."""
    along = ", ".join(f"{-component + 0.0:.5g}" for component in vector.sum(0).round(6))
    return f"outer side: a pressure of 1 kN/m2 on all faces has the resultant {along} kN along x, y, z"


def normals(net: Net, vector: np.ndarray) -> np.ndarray:
    """Return the upward unit normals (n, 3) of the particles; zero without a face.

    Normals of the tables take precedence over those of the vector areas (n, 3).
    """
    length = lengths(vector)[:, None]
    unit_normals = np.divide(vector, length, out=np.zeros_like(vector), where=length > 0)
    return np.where(np.isfinite(net.normal), net.normal, unit_normals)
