"""Entries of the lists of a job file, [[NAME]]: type, unit, range, default and meaning of each key."""

from typing import Annotated, Any, Literal, Self

from pydantic import model_validator

from netfall.job.keys.fields import (
    MAX_INT64,
    Factors,
    Ids,
    Kind,
    Moves,
    Name,
    Polygon,
    Section,
    Settings,
    Shifts,
    Supports,
    TablePath,
    Text,
    Vector,
    Words,
    key,
    keys_of,
)
from netfall.job.units import to_unit

NO_TABLE = "none"  # load_table of a stage in which none acts any more


class LengthChange(Section):
    """Change of the unstressed length of a cable in a stage: one of three keys."""

    change: float | None = key("added to the unstressed length of each cable", unit="m", ge=-1e12, le=1e12)
    length: float | None = key("unstressed length of each cable", unit="m", ge=-1e12, le=1e12)
    force: float | None = key("force to which each cable is pulled", unit="N", ge=-1e12, le=1e12)

    @model_validator(mode="before")
    @classmethod
    def _units(cls, table: Any) -> Any:
        """Convert texts with a unit."""
        keys = keys_of(cls)
        if not isinstance(table, dict):
            return table
        return {
            name: to_unit(value, keys[name].unit) if name in keys else value for name, value in table.items()
        }

    @model_validator(mode="after")
    def _one_key(self) -> Self:
        """Refuse none or several of the keys."""
        if len(self.model_fields_set) != 1:
            raise ValueError("expected one of change, length, force")
        return self


Lengths = Annotated[
    dict[str, LengthChange],
    Kind(
        "lengths",
        'a table of lengths by groups or cables, {{"hoop" = {{change = -0.5}}, "e17" = {{force = 2e5}}}}, '
        "each with one of change [m], length [m], force [N]",
    ),
]


class Zone(Section):
    """Part of the roof."""

    name: Name = key("name by which [wind.zone.NAME] and [load.zone.NAME] refer to it", ...)
    polygon: Polygon | None = key("corners in plan of the start geometry, in order around it", unit="m")
    groups: Words | None = key("groups of elements whose nodes belong to it")
    cut: bool | None = key(
        "true: a polygon takes the part of each node's area that lies inside it; false: it takes the "
        "whole area of the nodes inside; absent: true"
    )


class Case(Section):
    """Static case."""

    name: Name = key("name of the static case; not permanent, prestress, temperature, load, kind", ...)
    set: Settings = key(
        "loads of the case: keys of [load] and its zones (snow, ice, pressure, dead, temperature), and keys "
        "of [wind] for a static mean wind",
        {},
    )
    load_table: TablePath | None = key(
        "path of a table of loads of nodes (node, load_x, ...), elements (element, line_x, ...) or zones "
        "(zone, snow, ...), in addition to those of the net and of [load]"
    )
    pressure_table: TablePath | None = key(
        "path of a table x, y, z (optional), pressure or coefficient, in the axes of the net",
        unit="N/m2",
    )
    factor: float | None = key(
        "factor on the table: a pressure for coefficients, otherwise a number", unit="N/m2", ge=-1e9, le=1e9
    )
    settlement: Shifts = key(
        "displacement of supports or of the feet of springs, by ids, from the form or the last stage "
        "of erection; z upwards",
        {},
        unit="m",
    )


class Combination(Section):
    """Combination of actions."""

    name: Name = key("name of the combination; no case bears it", ...)
    factors: Factors = key(
        "factors of permanent, prestress (default 1), temperature, load and cases by name (default 0)", ...
    )
    kind: Literal["ULS", "SLS"] = key("limit state, which selects the checks", "ULS")


class Motion(Section):
    """Motion of supports in the dynamic stage."""

    nodes: Ids | None = key("ids of the supports that move; absent: all")
    displacement: TablePath | None = key("path of a table time, x, y, z, linear between its rows", unit="m")
    acceleration: TablePath | None = key(
        "path of a record (.AT2, in the unit of its head), or of a table time, x, y, z or time, acceleration",
        unit="m/s2",
    )
    direction: Vector | None = key("direction of an acceleration of one component")
    scale: float = key("factor on the displacement or acceleration", 1.0, ge=-1e6, le=1e6)
    speed: float | None = key(
        "speed of a travelling wave; absent: all supports move at once", unit="m/s", gt=0.0, le=1e6
    )
    travel: Vector | None = key("direction in which the wave travels")
    baseline: bool | None = key("baseline correction of a record (.AT2); absent: true")


class Slide(Section):
    """Nodes over which cables may slip."""

    group: Text | None = key("group whose cables slide over nodes")
    cables: Words | None = key("or the names of the cables that slide")
    nodes: Ids | None = key("ids of the slip points; absent: every node inside these cables")
    friction: float = key("coefficient of friction of a saddle", 0.0, ge=0.0, le=10.0)
    slip_resistance: float = key("slip resistance of a clamp", 0.0, unit="N", ge=0.0, le=1e12)


class Remove(Section):
    """Removal of members in the dynamic stage."""

    elements: Ids | None = key("ids of the removed elements")
    group: Text | None = key("or the removed group")
    cables: Words | None = key("or the names of the removed cables")
    time: float = key(
        "time in the dynamic stage at which the elements lose their stiffness", ..., unit="s", ge=0.0, le=1e9
    )
    duration: float = key(
        "time over which their tension then decreases to zero; 0: at once", 0.0, unit="s", ge=0.0, le=1e9
    )


class Target(Section):
    """Target of an adjustment of unstressed lengths."""

    group: Text | None = key("group or cable with a target of its mean axial force")
    force: float | None = key("target of the mean axial force, tension positive", unit="N", ge=-1e12, le=1e12)
    node: int | None = key("or the id of a node with a target of its height", ge=-MAX_INT64 - 1, le=MAX_INT64)
    height: float | None = key("target of the z coordinate", unit="m", ge=-1e6, le=1e6)
    adjust: Text = key("group or cable whose unstressed lengths change, each cable by the same amount", ...)


class Stage(Section):
    """Stage of erection."""

    name: Name = key("name of the stage of erection", ...)
    lengths: Lengths | None = key("unstressed lengths of groups or cables: by a change, a length, or a force")
    active: Words | None = key("groups that are active from now on; absent: as before")
    release: Supports | None = key(
        "nodes that are released: ids, groups, zones or all; as a table, along these axes only"
    )
    hold: Supports | None = key(
        "nodes that are held from now on at their present position: ids, groups, zones or all; as a table, "
        "along these axes only"
    )
    move: Moves | None = key(
        "displacement of held nodes from their present position, by ids, groups, zones or all", unit="m"
    )
    clamps: Literal["open", "closed"] | None = key(
        "clamps of [[slide]] from now on; open: without resistance; absent: as before"
    )
    set: Settings = key("loads from now on: dead, snow, ice, pressure, temperature, as in a case", {})
    load_table: TablePath | Literal["none"] | None = key(
        "path of a table of loads from now on, as in a case, instead of that of an earlier stage; none: no "
        "such table any more; absent: as before"
    )


def axes_by_name(given: str | list[int | str] | dict[str, str] | None) -> dict[str, str]:
    """Return the axes that `release` or `hold` names, by ids of nodes, groups, zones or "all"."""
    if isinstance(given, dict):
        return given
    return {str(name): "xyz" for name in ([given] if isinstance(given, str) else given or ())}


REMOVED_MEMBER_KEYS = ("elements", "group", "cables")  # keys of [[remove]] of which exactly one is given
