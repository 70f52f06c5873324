"""Zones of the roof: the nodes of each zone, and its values."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import shapely

from netfall.core.errors import raise_errors
from netfall.geometry import messages
from netfall.geometry.areas import RoofFaces, TributaryAreas, has_half_area, nearer_ends, roof_parts
from netfall.geometry.faces import Faces, corner_quadrilaterals
from netfall.geometry.net import Net, elements_of_group, nearest_group
from netfall.geometry.shares import (
    MAX_FAN_CORNERS,
    FaceShares,
    nearest_areas,
    share_out_faces,
    sum_at_nodes,
)
from netfall.geometry.slender import SlenderElements
from netfall.job.job import Job
from netfall.job.keys.entries import Zone, split
from netfall.job.keys.fields import ZonedSection
from netfall.job.values import format_value, suggest

MAX_OUTSIDE_SHARE = 0.02  # share of a zone's area outside its polygon, above which netfall reports it
SHARE_ROUNDING = 4e-16  # rounding error of the sum of shares of a whole node
NO_AREA = 1e-9  # share of a node's area below which it counts as zero


@dataclass(frozen=True)
class Zones:
    """Zone of each node: one, none, or several with shares of its area.

    names : in order; a node in several whole zones belongs to the last of them
    share : (n, z + 1) of each node's area in each zone, then outside all zones
    corners : zones of `roof_parts`, if polygons cut, or with `[roof] normal`; None: as nodes
    nodes : (n,) bool for each zone, nodes that its name selects; of `subdivide` only those that are in it
    """

    names: list[str]
    share: np.ndarray
    notes: list[str] = field(default_factory=list)
    corners: "Zones | None" = None
    nodes: list[np.ndarray] = field(default_factory=list)

    @property
    def of_parts(self) -> "Zones":
        """Zones of the parts of the roof on which loads act: corners of faces, or nodes."""
        return self.corners or self

    @property
    def mixed(self) -> np.ndarray:
        """(k,) nodes in several zones."""
        return np.flatnonzero(((self.share > 0.0) & (self.share < 1.0)).any(1))

    @property
    def of_node(self) -> np.ndarray:
        """(n,) row of names, -1: none; for a node in several zones, the zone with the largest share."""
        last_first = np.append(np.arange(len(self.names))[::-1], -1)  # among equal shares the last zone wins
        return last_first[np.argmax(self.share[:, last_first], axis=1)]

    def by_node(self, base: float | None, own: dict[str, float]) -> np.ndarray:
        """Return the value (n,) of each node: the value of its zone, otherwise the base; None: 0.

        A node in several zones has the mean weighted by their shares.
        """
        values = [own.get(name, base) for name in self.names] + [base]
        return sum(share * (0.0 if value is None else value) for share, value in zip(self.share.T, values))

    def parts(self, section: ZonedSection, key: str) -> list[tuple[object, np.ndarray]]:
        """Return each distinct value of a key, the section's first, and the share (n,) of nodes with it.

        section : with `zone`, the values that the zones override
        """
        base, own = getattr(section, key), section.zone_values(key)
        values = [base, *(own.get(name, base) for name in self.names)]
        shares = [self.share[:, k] for k in range(-1, len(self.names))]
        distinct = [value for k, value in enumerate(values) if value not in values[:k]]
        pairs: list[tuple[object, Any]] = [
            (v, sum(share for share, other in zip(shares, values) if other == v)) for v in distinct
        ]
        return [(value, share) for value, share in pairs if share.any()]

    def spread(self, section: ZonedSection, key: str) -> np.ndarray:
        """Return the value (n,) of a key at each node; 0 without one."""
        return self.by_node(getattr(section, key), section.zone_values(key))


@dataclass(frozen=True)
class RoofAreas:
    """Areas on which loads act: surface and plan (n,) [m2], upward vector area (n, 3) [m2], and zones.

    centre : (n, 3) [m], of the area of each node; None: of parts
    corners : nodes and areas of `roof_parts`, with zones of their own; None: loads act at the nodes
    slender : elements on which wind and ice act, or None
    """

    area: np.ndarray
    plan_area: np.ndarray
    vector: np.ndarray
    zones: Zones
    corners: "tuple[np.ndarray, RoofAreas] | None" = None
    slender: SlenderElements | None = None
    centre: np.ndarray | None = None

    @property
    def parts(self) -> "RoofAreas":
        """Areas of the parts on which loads act: corners of faces, or nodes."""
        return self.corners[1] if self.corners else self

    def at_nodes(self, values: np.ndarray) -> np.ndarray:
        """Sum values of the parts, (r,) or (r, 3), at their nodes."""
        return sum_at_nodes(self.corners[0], values, len(self.area)) if self.corners else values


def roof_areas(
    net: Net, areas: TributaryAreas, zones: Zones, slender: SlenderElements | None = None
) -> RoofAreas:
    """Return the areas on which loads act, from the areas of the particles."""
    roof = RoofAreas(areas.surface, areas.plan, areas.vector, zones, slender=slender, centre=areas.centre)
    if zones.corners is None:
        return roof
    node, surface, plan, vector = roof_parts(net, areas)
    return replace(roof, corners=(node, RoofAreas(surface, plan, vector, zones.corners)))


def make_zones(job: Job, net: Net, roofing: RoofFaces) -> Zones:
    """Build the zones of a job, by the positions of the nodes at the start. Raises InputError.

    Zones of the column `zone` without an entry in the job follow the entries.
    roofing : polygons with `cut` cut its faces; other polygons use the faces only for notes on the area
    """
    names = [zone.name for zone in job.zones]
    names += [name for name in net.zone_names if name not in names]
    entries = [*job.zones, *(Zone(name=name) for name in names[len(job.zones) :])]
    no_zones = "the job has none: give a [[zone]], or the column zone in nodes.csv"
    unknown = [
        messages.UNKNOWN_ZONE(
            place=place, name=format_value(name), suggestion=suggest(name, names) if names else no_zones
        )
        for name, place in named_zones(job)
        if name not in names
    ]
    raise_errors(f"{job.path}: {line}" for line in (*_wrong_entries(entries, net), *unknown))
    ends, members = nearer_ends(net)[:, : net.n], [_zone_nodes(zone, net) for zone in entries]
    halves = [
        np.broadcast_to(each, ends.shape) if zone.polygon is not None else each[ends]
        for zone, each in zip(entries, members)
    ]
    cutter = None
    if len(roofing.faces) and any(zone.polygon is not None for zone in entries):
        cutter = PolygonCutter(net, roofing.faces, roofing.given.shares)
    given = bool(np.isfinite(net.area).any())  # areas, which cover parts of `subdivide` too
    oriented = net.roof_axes is not None and not (given or np.isfinite(net.normal).any())

    def zones_of(rows: Sequence[int]) -> Zones:
        """Return the zones of some entries, as if there were no others."""
        some, inside = [entries[k] for k in rows], [halves[k] for k in rows]
        zones = Zones([names[k] for k in rows], _shares(net, some, inside, cutter))
        cut = any(cuts_areas(zone) for zone in some) and (given or len(zones.mixed) > 0)
        if some and len(roofing.faces) and net.zone_share is None and (cut or oriented):
            return _zones_of_corners(net, roofing, zones, inside, _regions(some), cutter)
        return zones

    zones = zones_of(range(len(entries)))
    notes = []
    for name, each, share in zip(names, members, zones.share.T):
        if not (share.any() or each.any()):
            notes.append(messages.EMPTY_ZONE(name=format_value(name)))
    area = roofing.given.plan if net.roof_axes is None else roofing.given.surface
    keys: dict[str, set[str]] = {name: set() for name in names}
    for name, _, given in _zone_settings(job):
        keys[name] |= given
    notes += _overlap_notes(zones, zones_of, keys, area)
    for zone, each in zip(entries, members):
        if cutter and zone.polygon is not None and not cuts_areas(zone):
            notes += _mismatch_notes(zone, each, cutter.share_inside(shapely.Polygon(zone.polygon)), area)
        elif zone.cut and not cutter:
            notes.append(messages.CUT_WITHOUT_FACES(name=format_value(zone.name)))
    nodes = [
        (share > 0.0) & (each | (zone.polygon is not None))
        for zone, each, share in zip(entries, members, zones.share.T)
    ]
    return replace(zones, notes=notes, nodes=nodes)


def _overlap_notes(
    zones: Zones, zones_of: Callable[[Sequence[int]], Zones], keys: dict[str, set[str]], area: np.ndarray
) -> Iterator[str]:
    """Yield a warning of each zone that other zones overlap without some of its values.

    zones_of : returns the zones of these rows alone; area : (n,) [m2] of each node
    keys : that the job gives for each zone
    """
    for k, name in enumerate(zones.names):
        before, rest = zones_of([k]).share[:, 0], zones.share[:, k]
        weight = area if (area * before).any() else np.ones(len(area))
        if weight @ (before - rest) <= MAX_OUTSIDE_SHARE * (weight @ before):
            continue

        def lost_to(others: list[int], k: int = k, before: Any = before, weight: Any = weight) -> float:
            rows = sorted([k, *others])
            after = zones_of(rows).share[:, rows.index(k)]
            return float(weight @ (before - after) / (weight @ before))

        # a zone that gives all values of the other loses none of them
        lacking = [keys[name] - keys[other] for other in zones.names]
        others = [m for m in range(len(lacking)) if m != k and (lacking[m] or not rest.any())]
        others = [m for m in others if lost_to([m]) > NO_AREA]
        if others and (lost := lost_to(others)) > MAX_OUTSIDE_SHARE:
            listed = ", ".join(format_value(zones.names[m]) for m in others)
            values = ", ".join(sorted(set[str]().union(*(lacking[m] for m in others)))) or "all"
            yield messages.COVERED_ZONE(name=format_value(name), others=listed, lost=lost, values=values)


def cuts_areas(zone: Zone) -> bool:
    """Return whether an entry of [[zone]] contains the part of each node's area inside its polygon."""
    return zone.polygon is not None and zone.cut is not False


def _shares(
    net: Net, entries: list[Any], inside: list[np.ndarray], cutter: "PolygonCutter | None"
) -> np.ndarray:
    """Compute the share (n, z + 1) of each node's area in each zone, then in none.

    inside : halves (h, n) bool of nodes in each zone

    The remainder of a node with parts in zones belongs to the zone that contains the whole node, or to no
    zone.
    """
    ends = nearer_ends(net)[:, : net.n]
    parts: dict[int, np.ndarray] = {}  # zones with parts of nodes: share (n,) of each node
    if net.zone_share is not None:
        of_name = dict(zip(net.zone_names, net.zone_share[ends.ravel()].T))
        parts = {k: of_name[zone.name] for k, zone in enumerate(entries) if zone.name in of_name}
    cut = [k for k, zone in enumerate(entries) if cuts_areas(zone) and cutter]
    of_node = np.full(ends.size, -1)  # of halves, as the rows below
    for k, members in enumerate(inside):
        if k not in (*cut, *parts):
            of_node[members.ravel()] = k
    if cutter is not None and cut and not parts:
        in_halves = cutter.parts_of_halves(_regions(entries), cutter.share_inside, np.arange(net.n))
        parts = {k: share.ravel() for k, share in in_halves.items()}
    part = np.column_stack([np.zeros((ends.size, 0)), *(np.where(of_node > k, 0.0, parts[k]) for k in parts)])
    whole_zone = of_node.copy()
    for k, share in zip(parts, part.T):
        whole_zone[share == 1.0] = k
    shares, mixed = np.eye(len(entries) + 1)[whole_zone], np.flatnonzero(((part > 0.0) & (part < 1.0)).any(1))
    shares[mixed] = 0.0
    shares[np.ix_(mixed, np.array(list(parts), int))] = part[mixed]
    remainder = 1.0 - shares[mixed].sum(1)
    shares[mixed, of_node[mixed]] += np.where(remainder > SHARE_ROUNDING, remainder, 0.0)
    shares, middle = shares.reshape(*ends.shape, -1), np.flatnonzero(has_half_area(net))
    shares[:, middle] = shares[np.isfinite(net.area[ends[0, middle]]).astype(int), middle]  # only this half
    return np.asarray(shares.mean(0))


def _regions(entries: list[Any]) -> dict[int, Any]:
    """Return the polygon of each zone that cuts areas, without later zones, which take precedence."""
    polygons = {k: shapely.Polygon(zone.polygon) for k, zone in enumerate(entries) if cuts_areas(zone)}
    later = {k: shapely.union_all([polygons[m] for m in polygons if m > k]) for k in polygons}
    return {k: shapely.difference(polygons[k], later[k]) for k in polygons}


def _zones_of_corners(
    net: Net,
    roofing: RoofFaces,
    zones: Zones,
    inside: list[np.ndarray],
    regions: dict[int, Any],
    cutter: "PolygonCutter | None",
) -> Zones:
    """Return zones including the zones of the corners of faces, with their shares at the nodes.

    A corner is in the last zone that has its node; with `[roof] normal`, first in the last zone that has all
    corners of its face. inside : halves (h, n) bool of nodes in each zone
    """
    shares, rings = roofing.given.shares, roofing.faces.rings
    points = np.ones((2 - net.parts % 2, len(net.corners)), bool)
    members = [np.column_stack([each, points]) for each in inside]
    cut = cutter.parts_of_halves(regions, cutter.corner_shares, shares.node) if cutter else {}
    rest = np.ones((len(points), len(shares.node)))
    share = np.zeros((*rest.shape, len(inside) + 1))
    passes = (True, False) if net.roof_axes is not None else (False,)
    for of_whole_face in passes:
        for k in range(len(inside))[::-1]:
            if k in cut:
                part = cut[k] * (of_whole_face == passes[0])
            else:
                whole = np.asarray(members[k].all(0))[rings.corner]
                outside = np.bincount(rings.face_of_corner(), ~whole, rings.count)
                part = members[k][:, shares.node] & ((outside[shares.face] == 0) | (not of_whole_face))
            part = np.minimum(part, rest)
            share[..., k] += part
            rest -= part
    share[..., -1] = rest
    share, (node, surface, *_) = share[:, shares.node < net.n], roof_parts(net, roofing.given)
    share = share.reshape(-1, share.shape[2]) if np.isfinite(net.area).any() else share.mean(0)
    share = np.concatenate([share, zones.share[node[len(share) :]]])
    sums = sum_at_nodes(node, surface[:, None] * share, net.n)
    total = roofing.given.surface[:, None]
    of_nodes = np.where(total > 0, sums / np.where(total > 0, total, 1.0), zones.share)
    of_nodes = np.where(of_nodes > 1.0 - NO_AREA, 1.0, np.where(of_nodes < NO_AREA, 0.0, of_nodes))
    return Zones(zones.names, of_nodes, corners=Zones(zones.names, share))


def _mismatch_notes(zone: Zone, members: np.ndarray, inside: np.ndarray, plan: np.ndarray) -> Iterator[str]:
    """Yield a warning about a polygon of whole nodes, if their area differs much from its area.

    inside : (n,) share of each node in the polygon; plan : (n,) [m2]
    """
    area = float(plan[members].sum())
    outside = float((plan * (1.0 - inside))[members].sum())
    remaining = float((plan * inside)[~members].sum())
    if max(outside, remaining) > MAX_OUTSIDE_SHARE * area:
        name, share = format_value(zone.name), outside / area if area else 0.0
        yield messages.INEXACT_ZONE(name=name, area=area, outside=outside, share=share, remaining=remaining)


def _zone_nodes(zone: Zone, net: Net) -> np.ndarray:
    """Return which nodes are in a zone, (n,) bool: by polygon, elements of its groups, or the column."""
    if zone.polygon is not None:
        polygon = shapely.Polygon(zone.polygon)
        shapely.prepare(polygon)
        return shapely.dwithin(polygon, shapely.points(net.in_plan(net.x)[:, :2]), net.tolerance)
    if zone.groups is not None:
        members = np.zeros(net.n, bool)
        members[net.elements[net.is_in_groups(zone.groups)]] = True
        return members
    row = net.zone_names.index(zone.name)
    return net.zone == row if net.zone_share is None else net.zone_share[:, row] > 0


def _wrong_entries(entries: list[Any], net: Net) -> Iterator[str]:
    """Yield an error for each entry whose nodes are not defined."""
    for zone in entries:
        place, in_column = f"[[zone]] {zone.name}:", zone.name in net.zone_names
        polygon = shapely.Polygon(zone.polygon or ())
        if zone.polygon is not None and not (polygon.is_valid and polygon.area > 0):
            problem = "no area" if polygon.is_valid else shapely.is_valid_reason(polygon)
            yield f"{place} {messages.WRONG_POLYGON(problem=problem)}"
        for name in zone.groups or ():
            if name not in net.group_names:
                shown, suggestion = format_value(name), nearest_group(net, name)
                yield f"{place} {messages.UNKNOWN_GROUP_IN_LIST(name=shown, suggestion=suggestion)}"
        if in_column and (zone.polygon is not None or zone.groups is not None):
            yield f"{place} {messages.ZONE_IN_COLUMN()}"
        elif cuts_areas(zone) and net.zone_share is not None:
            yield f"{place} {messages.CUT_AND_SHARES()}"
        elif not in_column and zone.polygon is None and zone.groups is None:
            known = net.zone_names
            suggestion = suggest(zone.name, known) if known else "the net has no such column"
            yield f"{place} {messages.ZONE_WITHOUT_NODES(suggestion=suggestion)}"


def named_zones(job: Job) -> list[tuple[str, str]]:
    """Return the zones that load tables, sections and cases name, and the places that name them."""
    of_tables = dict(job.zone_rows)  # with values that the sections have too
    named = [(name, place) for name, place, _ in _zone_settings(job) if name not in of_tables]
    return [*job.zone_rows, *named]


def _zone_settings(job: Job) -> Iterator[tuple[str, str, set[str]]]:
    """Yield each zone that sections and cases name, the place that names it, and its keys, as "load.snow"."""
    for section in ("load", "wind"):
        table = getattr(job, section)
        for name, values in (table.zone if table else {}).items():
            yield name, f"[{section}.zone.{name}]", {f"{section}.{key}" for key in values.model_fields_set}
    for kind, case in [("case", case) for case in job.cases] + [("stage", stage) for stage in job.stages]:
        for setting in case.set:
            section, name, key = split(setting)
            if name:
                yield name, f"[[{kind}]] {case.name}: set: {setting}", {f"{section}.{key}"}


def nodes_named(net: Net, zones: Zones, name: str) -> np.ndarray:
    """Select the nodes (n,) bool of an id, of a group's elements, of a zone, or all; none: unknown name."""
    if is_node_id(name):
        return np.asarray(net.node_id == int(name))
    selected = np.full(net.n, name == "all")
    rows, unknown = elements_of_group(net, name)
    selected[net.elements[rows]] = True
    if unknown and name in zones.names:
        selected |= zones.nodes[zones.names.index(name)]
    return selected


def is_node_id(name: str) -> bool:
    """Return whether a name is the id of a node, not a group or zone."""
    return name.removeprefix("-").isdecimal()


# --- parts of the areas of nodes inside polygons, by the same shares of faces


class PolygonCutter:
    """Intersection of polygons with the areas of nodes in the faces of a net."""

    def __init__(self, net: Net, faces: Faces, shares: FaceShares):
        """shares : of the faces in the given geometry"""
        self.net, self.faces = net, faces
        self.points = net.in_plan(np.concatenate([net.x, net.corners]))
        self.shares = shares if net.roof_axes is None else share_out_faces(self.points, faces)
        self.few = np.bincount(self.faces.rings.face_of_corner()) <= MAX_FAN_CORNERS
        rings, xy = faces.rings, self.points[:, :2]
        first = rings.start[rings.first_rings()]
        low, high = (f.reduceat(xy[rings.corner], first) for f in (np.minimum, np.maximum))
        self.boxes = shapely.STRtree(shapely.box(*low.T, *high.T))  # around each face in plan

    def parts_of_halves(self, regions: dict[int, Any], cut: Any, node: np.ndarray) -> dict[int, np.ndarray]:
        """Return the shares (h, c) of halves of nodes or corners in regions that do not overlap, by region.

        A region that contains one of two ends fills the half of this end first.
        cut : function that returns the shares (c,) in a region; node : (c,) of each share
        """
        ends, position = nearer_ends(self.net)[:, node], shapely.points(self.points[:, :2])
        parts, rest = {}, np.ones(ends.shape)
        for k, region in regions.items():
            share = cut(region)
            parts[k] = share[None]
            if len(ends) == 2:
                inside = shapely.dwithin(region, position, self.net.tolerance)[ends]
                evenly = 2.0 * share * rest / np.maximum(rest.sum(0), NO_AREA)
                first = np.minimum(2.0 * share, rest)
                filled = np.where(inside, first, 2.0 * share - first[::-1])
                parts[k] = np.where(inside[0] == inside[1], evenly, filled)
                rest = np.maximum(rest - parts[k], 0.0)
        return parts

    def share_inside(self, region: Any) -> np.ndarray:
        """Return the share (n,) of each node's area in plan inside a polygon, or several.

        A node without a face is inside or outside as a whole, by its position.
        """
        net, plans = self.net, self.shares.plan_areas()
        areas = (plans, self.corner_shares(region) * plans)
        total, area_inside = (self.shares.at_nodes(area, net.n) for area in areas)
        position = shapely.points(self.points[: net.n, :2])
        at_position = shapely.dwithin(region, position, net.tolerance).astype(float)
        result = np.where(total > 0, area_inside / np.where(total > 0, total, 1.0), at_position)
        return np.where(result > 1.0 - NO_AREA, 1.0, np.where(result < NO_AREA, 0.0, result))

    def corner_shares(self, region: Any) -> np.ndarray:
        """Return the share (c,) of each corner's area in plan inside a polygon, or several."""
        shapely.prepare(region)
        corner = self.shares.node
        share = shapely.contains_xy(region, self.points[corner, :2]).astype(float)
        crossed = np.zeros(self.faces.count, bool)
        crossed[self.boxes.query(shapely.boundary(region), "intersects")] = True
        few, many = crossed & self.few, crossed & ~self.few  # `shares` has faces with few corners first
        parts = shapely.polygons(
            corner_quadrilaterals(self.points[:, :2], self.faces)[few[self.faces.face_of_corner()]]
        )
        area_inside, size = shapely.area(shapely.intersection(parts, region)), shapely.area(parts)
        if many.any():
            rings, vector = self.faces.rings.select_faces(many), self.shares.vector[many]
            size = np.append(size, nearest_areas(self.points, rings, vector))
            # triangles that fill the region, each as three half-planes a x + b y <= c
            triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(region))
            xy = shapely.get_coordinates(shapely.orient_polygons(triangles)).reshape(-1, 4, 2)
            along = np.diff(xy, axis=1)
            outward = np.stack([along[:, :, 1], -along[:, :, 0]], -1)
            planes = np.concatenate([outward, np.sum(outward * xy[:, :3], axis=2, keepdims=True)], 2)
            windows = (nearest_areas(self.points, rings, vector, window) for window in planes)
            area_inside = np.append(area_inside, sum(windows))
        in_crossed = crossed[self.shares.face]
        share[in_crossed] = np.divide(area_inside, size, out=np.zeros(len(size)), where=size > 0)
        return share
