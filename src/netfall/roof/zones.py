"""Zones of the roof: which node belongs to which, and the values that hold there."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import shapely

from netfall.ground.errors import InputError
from netfall.job.cases import in_zone
from netfall.job.job import Job
from netfall.job.values import nearest, shown
from netfall.net.net import Net, nearest_group
from netfall.roof.areas import Roofing
from netfall.roof.cutter import Cutter

MUCH = 0.02  # of a zone's area: so much that lies outside its polygon is reported
NOBODY = "no node lies in it; the polygon is in metres, in plan"
LAST_BITS = 4e-16  # what the sum of shares of a whole node may lack


@dataclass(frozen=True)
class Zones:
    """Each node in one zone or none, or in several with a share of its area each.

    names : in order, of which the last that a node lies in has it
    of_node : (n,) row of names, -1: none; of a node in several the one with the largest share
    mixed : (k,) nodes in several; share : (k, z + 1), of each zone, then of none
    """

    names: list[str]
    of_node: np.ndarray
    notes: list[str] = field(default_factory=list)
    mixed: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    share: np.ndarray | None = None

    def at(self, rows: np.ndarray) -> "Zones":
        """The zones of the nodes in some rows."""
        place = np.full(len(self.of_node), -1)
        place[self.mixed] = np.arange(len(self.mixed))
        mixed = np.flatnonzero(place[rows] >= 0)
        share = None if self.share is None else self.share[place[rows[mixed]]]
        return Zones(self.names, self.of_node[rows], mixed=mixed, share=share)

    def of_zone(self, number: int) -> np.ndarray:
        """Share (n,) of each node's area that lies in a zone, by its row of names; -1: in none."""
        share = (self.of_node == number).astype(float)
        if self.share is not None:
            share[self.mixed] = self.share[:, number]
        return share

    def shares(self) -> np.ndarray:
        """(n, z) share of each node's area that lies in each zone."""
        return np.column_stack([self.of_zone(k) for k in range(len(self.names))])

    def by_node(self, base: float | None, own: dict[str, float]) -> np.ndarray:
        """The number (n,) of each node: of its zone, where that has its own, else the base; None: 0.

        Of a node in several zones the mean by their shares.
        """
        each = [own.get(name, base) for name in self.names] + [base]  # the last for row -1
        each = np.array([0.0 if value is None else value for value in each], float)
        found = each[self.of_node]
        if self.share is not None:
            found[self.mixed] = sum(share * value for share, value in zip(self.share.T, each))
        return found

    def parts(self, section: SimpleNamespace, key: str) -> list[tuple[object, np.ndarray]]:
        """Each distinct value of a key, with the share (n,) of nodes that have it; the section's own first.

        section : with `zone`, what the zones override
        """
        base, own = getattr(section, key), _own(section, key)
        found: list[tuple[object, np.ndarray]] = []
        for number, value in enumerate([base, *(own.get(name, base) for name in self.names)], -1):
            mine = self.of_zone(number)
            same = [share for other, share in found if other == value]
            if same:
                same[0][:] += mine
            else:
                found.append((value, mine))
        return [(value, share) for value, share in found if share.any()]

    def spread(self, section: SimpleNamespace, key: str) -> np.ndarray:
        """The number (n,) that each node has of a key; 0 where there is none."""
        return self.by_node(getattr(section, key), _own(section, key))


@dataclass(frozen=True)
class Roof:
    """What loads act on: area of surface and in plan (n,) [m2], vector area (n, 3) [m2], upward, zones."""

    area: np.ndarray
    plan_area: np.ndarray
    vector: np.ndarray
    zones: Zones


def _own(section: SimpleNamespace, key: str) -> dict:
    """The values of zones that have one of their own."""
    return {name: values[key] for name, values in section.zone.items() if key in values}


def zones_of(job: Job, net: Net, roofing: Roofing) -> Zones:
    """The zones of a job, by where the nodes lie at the start. Raises InputError with all that is wrong.

    Those of the column `zone` that have no entry in the job stand after the entries.
    roofing : whose faces polygons with `cut` cut, and of which others take more than lies inside
    """
    entries = [*job.zones, *(_of_column(name) for name in net.zone_names if name not in _names(job.zones))]
    names = _names(entries)
    errors = [f"{job.path}: {line}" for line in _wrong_entries(entries, net) + _unknown_names(job, names)]
    if errors:
        raise InputError(errors)
    inside = [_members(zone, net) for zone in entries]
    drawn = any(zone.polygon is not None for zone in entries)
    cutter = Cutter(net, roofing.faces, roofing.given.shares) if drawn and len(roofing.faces) else None
    cut = [k for k, zone in enumerate(entries) if is_cut(zone) and cutter]
    given = [] if net.zone_share is None else [k for k, name in enumerate(names) if name in net.zone_names]
    of_node = np.full(net.n, -1)
    for number, members in enumerate(inside):
        if number not in (*cut, *given):
            of_node[members] = number
    found = Zones(names, of_node)
    if given:
        found = _cut(found, given, [net.zone_share[:, net.zone_names.index(names[k])] for k in given])
    elif cut:
        polygons = [shapely.Polygon(entries[k].polygon) for k in cut]
        later = [shapely.union_all(polygons[k + 1 :]) for k in range(len(polygons))]  # which take precedence
        regions = map(shapely.difference, polygons, later)
        found = _cut(found, cut, [cutter.inside(region) for region in regions])
    notes = [
        f"zone {shown(names[k])}: "
        + ("all of its nodes lie in zones after it too, and belong to these" if inside[k].any() else NOBODY)
        for k in range(len(names))
        if not found.of_zone(k).any()
    ]
    for zone, members in zip(entries, inside):
        if cutter and zone.polygon is not None and not is_cut(zone):
            notes += _astray(zone, members, cutter.inside(shapely.Polygon(zone.polygon)), roofing.given.plan)
        elif zone.cut and not cutter:
            notes.append(f"zone {shown(zone.name)}: cut: no effect: the net has no faces")
    return replace(found, notes=notes)


def is_cut(zone: SimpleNamespace) -> bool:
    """Whether an entry of [[zone]] takes the part of each node's area that lies inside its polygon."""
    return zone.polygon is not None and zone.cut is not False


def _cut(whole: Zones, cut: list[int], inside: list[np.ndarray]) -> Zones:
    """The zones `cut` with the shares (n,) of nodes `inside`, but where a later zone has the node whole.

    What these leave of a node is of the zone that has it whole otherwise, or of none.
    """
    of_node = whole.of_node.copy()
    inside = [np.where(whole.of_node > k, 0.0, share) for k, share in zip(cut, inside)]
    for k, share in zip(cut, inside):
        of_node[share == 1.0] = k
    mixed = np.flatnonzero(np.any([(share > 0.0) & (share < 1.0) for share in inside], axis=0))
    if not len(mixed):
        return Zones(whole.names, of_node)
    share = np.zeros((len(mixed), len(whole.names) + 1))
    for k, part in zip(cut, inside):
        share[:, k] = part[mixed]
    rest = 1.0 - share.sum(1)
    share[np.arange(len(mixed)), whole.of_node[mixed]] += np.where(rest > LAST_BITS, rest, 0.0)
    last_first = np.append(np.arange(len(whole.names))[::-1], -1)  # of equal shares the last zone's
    of_node[mixed] = last_first[np.argmax(share[:, last_first], axis=1)]
    return Zones(whole.names, of_node, mixed=mixed, share=share)


def _astray(zone: SimpleNamespace, members: np.ndarray, inside: np.ndarray, plan: np.ndarray) -> list[str]:
    """A note on a polygon that takes nodes whole, if much of these lies outside, or is left inside.

    inside : (n,) share of each node that lies in the polygon; plan : (n,) [m2]
    """
    area = float(plan[members].sum())
    outside = float((plan * (1.0 - inside))[members].sum())
    left = float((plan * inside)[~members].sum())
    if max(outside, left) <= MUCH * area:
        return []
    return [
        f"zone {shown(zone.name)}: nodes belong to it whole: of its {area:.4g} m2 in plan {outside:.4g} m2 "
        f"({outside / area if area else 0.0:.1%}) lie outside its polygon, and {left:.4g} m2 inside the "
        "polygon are not in it; cut = true in its [[zone]] takes what lies inside"
    ]


def _names(zones: list) -> list[str]:
    return [zone.name for zone in zones]


def _of_column(name: str) -> SimpleNamespace:
    return SimpleNamespace(name=name, polygon=None, groups=None, cut=None)


def _members(zone: SimpleNamespace, net: Net) -> np.ndarray:
    """(n,) bool, the nodes of a zone: in or on its polygon, at elements of its groups, or by the column."""
    if zone.polygon is not None:
        polygon = shapely.Polygon(zone.polygon)
        shapely.prepare(polygon)
        return shapely.dwithin(polygon, shapely.points(net.x[:, :2]), net.tolerance)
    if zone.groups is not None:
        rows = [g for g, name in enumerate(net.group_names) if name in zone.groups]
        members = np.zeros(net.n, bool)
        members[net.elements[np.isin(net.group, rows)]] = True
        return members
    row = net.zone_names.index(zone.name)
    return net.zone == row if net.zone_share is None else net.zone_share[:, row] > 0


def _wrong_entries(entries: list, net: Net) -> list[str]:
    """A line for each entry whose nodes are not known."""
    lines = []
    for zone in entries:
        place, in_column = f"[[zone]] {zone.name}:", zone.name in net.zone_names
        if zone.polygon is not None:
            lines += [f"{place} polygon: {why}" for why in _not_simple(zone.polygon)]
        for name in zone.groups or ():
            if name not in net.group_names:
                lines.append(
                    f"{place} groups: no element is of group {shown(name)}; {nearest_group(net, name)}"
                )
        if in_column and (zone.polygon is not None or zone.groups is not None):
            lines.append(f"{place} the column zone of nodes.csv has nodes of it already; give the name alone")
        elif is_cut(zone) and net.zone_share is not None:
            lines.append(
                f"{place} cut = true (the default) and the column zone_share of nodes.csv exclude each "
                "other; set cut = false, with which the polygon takes whole nodes, or remove the column"
            )
        elif not in_column and zone.polygon is None and zone.groups is None:
            advice = f"; {nearest(zone.name, net.zone_names)}" if net.zone_names else ""
            lines.append(
                f"{place} polygon or groups: missing; a name alone is for a zone of the column zone of "
                f"nodes.csv, which does not have it{advice}"
            )
    return lines


def _not_simple(corners: list) -> list[str]:
    """Why corners bound no area, if they do not."""
    polygon = shapely.Polygon(corners)
    if polygon.is_valid and polygon.area > 0:
        return []
    why = shapely.is_valid_reason(polygon) if not polygon.is_valid else "no area"
    return [f"{why}; expected corners in order around an area, without sides that cross"]


def _unknown_names(job: Job, names: list[str]) -> list[str]:
    """A line for each place that names a zone that there is not."""
    advice = "the job has none: give a [[zone]], or the column zone in nodes.csv"
    return [
        f"{place}: there is no zone {shown(name)}; {nearest(name, names) if names else advice}"
        for name, place in named_zones(job)
        if name not in names
    ]


def named_zones(job: Job) -> list[tuple[str, str]]:
    """The zones that sections and cases name, and where."""
    found = []
    for section in ("load", "wind"):
        table = getattr(job, section)
        found += [(name, f"[{section}.zone.{name}]") for name in (table.zone if table else ())]
    for kind, case in [("case", case) for case in job.cases] + [("stage", stage) for stage in job.stages]:
        of_zones = [(in_zone(key), key) for key in case.set]
        found += [(zone[1], f"[[{kind}]] {case.name}: set: {key}") for zone, key in of_zones if zone]
    return found
