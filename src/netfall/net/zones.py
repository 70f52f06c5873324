"""Zones of the roof: which node belongs to which, and the values that hold there."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import shapely

from netfall.errors import InputError
from netfall.job.read import Job
from netfall.job.values import nearest, shown
from netfall.net.net import Net

NOBODY = "no node lies in it; the polygon is in metres, in plan"


@dataclass(frozen=True)
class Zones:
    """Each node in one zone or none.

    names : in order, of which the last that a node lies in has it
    of_node : (n,) row of names, -1: none
    """

    names: list[str]
    of_node: np.ndarray
    notes: list[str] = field(default_factory=list)

    def at(self, rows: np.ndarray) -> "Zones":
        """The zones of the nodes in some rows."""
        return Zones(self.names, self.of_node[rows])

    def by_node(self, base: float | None, own: dict[str, float]) -> np.ndarray:
        """The number (n,) of each node: of its zone, where that has its own, else the base; None: 0."""
        each = [own.get(name, base) for name in self.names] + [base]  # the last for row -1
        return np.array([0.0 if value is None else value for value in each], float)[self.of_node]

    def parts(self, section: SimpleNamespace, key: str) -> list[tuple[object, np.ndarray]]:
        """Each distinct value of a key, with the nodes (n,) bool that have it; the section's own first.

        section : with `zone`, what the zones override
        """
        base, own = getattr(section, key), _own(section, key)
        found: list[tuple[object, np.ndarray]] = []
        for number, value in enumerate([base, *(own.get(name, base) for name in self.names)], -1):
            mine = self.of_node == number
            same = [nodes for other, nodes in found if other == value]
            if same:
                same[0][mine] = True
            else:
                found.append((value, mine))
        return [(value, nodes) for value, nodes in found if nodes.any()]

    def spread(self, section: SimpleNamespace, key: str) -> np.ndarray:
        """The number (n,) that each node has of a key; 0 where there is none."""
        return self.by_node(getattr(section, key), _own(section, key))


def _own(section: SimpleNamespace, key: str) -> dict:
    """The values of zones that have one of their own."""
    return {name: values[key] for name, values in section.zone.items() if key in values}


def zones_of(job: Job, net: Net) -> Zones:
    """The zones of a job, by where the nodes lie at the start. Raises InputError with all that is wrong.

    Those of the column `zone` that have no entry in the job stand after the entries.
    """
    entries = [*job.zones, *(_of_column(name) for name in net.zone_names if name not in _names(job.zones))]
    names = _names(entries)
    errors = [f"{job.path}: {line}" for line in _wrong_entries(entries, net) + _unknown_names(job, names)]
    if errors:
        raise InputError(errors)
    inside = [_members(zone, net) for zone in entries]
    of_node = np.full(net.n, -1)
    for number, members in enumerate(inside):
        of_node[members] = number
    notes = [
        f"zone {shown(names[k])}: "
        + ("all of its nodes lie in zones after it too, and belong to these" if inside[k].any() else NOBODY)
        for k in np.flatnonzero(np.bincount(of_node + 1, minlength=len(names) + 1)[1:] == 0)
    ]
    return Zones(names, of_node, notes)


def _names(zones: list) -> list[str]:
    return [zone.name for zone in zones]


def _of_column(name: str) -> SimpleNamespace:
    return SimpleNamespace(name=name, polygon=None, groups=None)


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
    return net.zone == net.zone_names.index(zone.name)


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
                    f"{place} groups: no element is of group {shown(name)}; {_known_groups(net, name)}"
                )
        if in_column and (zone.polygon is not None or zone.groups is not None):
            lines.append(f"{place} the column zone of nodes.csv has nodes of it already; give the name alone")
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


def _known_groups(net: Net, name: str) -> str:
    known = [group for group in net.group_names if group]
    return nearest(name, known) if known else "the net has no groups"


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
    for case in job.cases:
        of_zones = [key for key in case.set if key.startswith("load.zone.")]
        found += [
            (key.removeprefix("load.zone.").rpartition(".")[0], f"[[case]] {case.name}: set: {key}")
            for key in of_zones
        ]
    return found
