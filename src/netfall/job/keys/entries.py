"""Entries of the lists of a job file, [[NAME]], and the keys of sections that a static case can set.

Each key has its type, unit, range, default and meaning.
"""

from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import model_validator

from netfall.job import messages
from netfall.job.keys.fields import (
    MAX_INT64,
    Factors,
    Ids,
    Key,
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
    inner_models,
    key,
    keys_of,
)
from netfall.job.keys.models import CaseWind, Load, LoadZone, Wind, WindZone
from netfall.job.units import to_unit
from netfall.job.values import format_value, suggest

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
        "path of a record (.AT2, in g), or of a table time, x, y, z or time, acceleration",
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
    nodes: Ids | None = key(
        "ids of the slip points; absent: nodes with loads, supports or other elements, else all"
    )
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
        "nodes that are held from now on at their current position: ids, groups, zones or all; as a table, "
        "along these axes only"
    )
    move: Moves | None = key(
        "displacement of held nodes from their current position, by ids, groups, zones or all", unit="m"
    )
    clamps: Literal["open", "closed"] | None = key(
        "clamps of [[slide]] from now on; open: without resistance; absent: as before"
    )
    set: Settings = key("loads from now on: dead, snow, ice, pressure, temperature, as in a case", {})
    load_table: TablePath | Literal["none"] | None = key(
        "path of a table of loads from now on, as in a case, instead of that of an earlier stage; none: no "
        "such table any more; absent: as before"
    )


def has_table(section: Load | Case | Stage) -> bool:
    """Return whether a section names a table of loads; only in a stage NO_TABLE is none."""
    return section.load_table not in ((None, NO_TABLE) if isinstance(section, Stage) else (None,))


def axes_by_name(given: str | list[int | str] | dict[str, str] | None) -> dict[str, str]:
    """Return the axes that `release` or `hold` names, by ids of nodes, groups, zones or "all"."""
    if isinstance(given, dict):
        return given
    return {str(name): "xyz" for name in ([given] if isinstance(given, str) else given or ())}


REMOVED_MEMBER_KEYS = ("elements", "group", "cables")  # keys of [[remove]] of which exactly one is given


SectionT = TypeVar("SectionT", Load, Wind, CaseWind)

OF_LOAD = ("permanent", "prestress", "temperature", "load")  # names of factors that are not cases
RESERVED_NAMES = (*OF_LOAD, "kind")  # names that no case bears: those of factors, and a key of [combinations]
# Keys of [wind] that a case can set; gusts do not act in a case.
CASE_WIND_KEYS = (
    *("speed", "direction", "pressure_coefficient", "sectors", "air_density"),
    *("profile_exponent", "base_height", "pressure_factor"),
)
CASE_LOAD_KEYS = ("dead", "snow", "ice", "pressure", "temperature")  # keys of [load] that a case can set


def settable_keys() -> dict[str, Key]:
    """Return the keys that a case can set, by "load.snow", "load.zone.NAME.snow"."""
    rows = {f"load.{name}": keys_of(Load)[name] for name in CASE_LOAD_KEYS}
    rows |= {f"wind.{name}": keys_of(CaseWind)[name] for name in CASE_WIND_KEYS}
    for section, model in (("load", LoadZone), ("wind", WindZone)):
        in_zones = {name: key for name, key in keys_of(model).items() if f"{section}.{name}" in rows}
        rows |= {f"{section}.zone.NAME.{name}": key for name, key in in_zones.items()}
    return rows


def split(name: str) -> tuple[str, str, str]:
    """Split "load.snow" or "wind.zone.edge.pressure_coefficient" into section, zone ("": none) and key."""
    section, _, remainder = name.partition(".zone.")
    zone, _, key = remainder.rpartition(".")
    if not zone:
        section, _, key = name.partition(".")
    return section, zone, key


def apply_settings(section: SectionT, name: str, settings: dict[str, Any]) -> SectionT:
    """Return a section with the values that a case or a stage sets.

    name : of the section, load or wind; settings : values by names like "load.zone.NAME.snow"
    """
    values: dict[str, Any] = {}
    zones: dict[str, Any] = dict(section.zone)
    for setting, value in settings.items():
        table, zone, key = split(setting)
        if table == name and zone:
            zones[zone] = zones.get(zone, inner_models(type(section))["zone"]()).replaced(**{key: value})
        elif table == name:
            values[key] = value
    return section.replaced(**values, zone=zones)


def setting_of(section: Load, name: str) -> Any:
    """Return the value of a section that a setting like "load.zone.NAME.snow" would replace."""
    _, zone, key = split(name)
    value = getattr(section.zone.get(zone), key, None)
    return getattr(section, key) if value is None else value


def flatten_settings(table: dict[str, Any], place: str = "") -> dict[str, Any]:
    """Flatten nested tables to values by dotted names: TOML reads `load.snow` without quotes as nested."""
    return dict(setting_items(table, place))


def setting_items(table: dict[str, Any], place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted name and the value of each setting; nested and quoted, a name occurs twice."""
    for name, value in table.items():
        if isinstance(value, dict):
            yield from setting_items(value, f"{place}{name}.")
        else:
            yield place + name, value


def has_static_wind(case: Case) -> bool:
    """Return whether a static wind acts in a case."""
    return any(name.startswith("wind.") for name in case.set)


def static_wind(wind: Wind, case: Case) -> CaseWind:
    """Return [wind] with the values of a case, for a mean wind."""
    mean = CaseWind.model_construct(**wind.given() | dict.fromkeys(("file", "points", "pressures", "taps")))
    result = apply_settings(mean, "wind", case.set)
    if "wind.pressure_coefficient" in case.set:
        return result.replaced(sectors=None)
    if "wind.sectors" in case.set:
        return result.replaced(pressure_coefficient=None)
    return result


def share_wind(data: dict[str, Any]) -> None:
    """Move keys of [wind] to the cases with a static wind, which use them, if there is no dynamic stage."""
    wind, cases = data.get("wind"), data.get("case")
    if "dynamics" in data or not isinstance(wind, dict) or not isinstance(cases, list):
        return
    flat = flatten_settings(wind, "wind.")
    shared = {name: value for name, value in flat.items() if split(name)[2] in CASE_WIND_KEYS}
    used: set[str] = set()
    for case in cases:
        given = case.get("set") if isinstance(case, dict) else None
        if not isinstance(given, dict):
            continue
        own = flatten_settings(given)
        if any(name.startswith("wind.") for name in own):
            rivals = ("wind.pressure_coefficient", "wind.sectors")
            replaced = own.keys() | (rivals if own.keys() & {*rivals} else ())
            added = {name: value for name, value in shared.items() if name not in replaced}
            case["set"] = added | given
            used |= added.keys()
    data["wind"] = {
        name: value for name, value in wind.items() if flatten_settings({name: value}, "wind.").keys() - used
    }
    if used and not data["wind"]:
        del data["wind"]


def case_errors(cases: list[Case], wind: Wind, slender: bool) -> Iterator[tuple[str, str]]:
    """Yield place and error of cases whose `set` is checked.

    wind : [wind], or its defaults; slender : whether elements have a diameter
    """
    for case in cases:
        label = f"[[case]] {case.name}:"
        if case.name in RESERVED_NAMES:
            yield label, messages.RESERVED_CASE_NAME(name=format_value(case.name))
        if not (case.set or case.load_table or case.pressure_table or case.settlement):
            yield label, messages.EMPTY_CASE()
        if case.factor is not None and case.pressure_table is None:
            yield label, messages.NEEDS(key="factor", needed="pressure_table")
        if has_static_wind(case):
            acting = static_wind(wind, case)
            if acting.speed is None:
                yield label, messages.NO_CASE_SPEED()
            if not slender and acting.pressure_coefficient is None and acting.sectors is None:
                yield label, messages.NO_CASE_COEFFICIENT()


def combination_errors(combinations: list[Combination], cases: list[Case]) -> Iterator[tuple[str, str]]:
    """Yield place and error of the entries of [[combination]]."""
    names = [case.name for case in cases if case.name is not None]
    for combination in combinations:
        label, factors = f"[[combination]] {combination.name}:", combination.factors or {}
        if combination.name in names or combination.name in OF_LOAD:
            kind = "a case" if combination.name in names else "a factor"
            yield label, messages.NAME_OF_CASE(name=format_value(combination.name), kind=kind)
        for name in factors:
            if name not in names and name not in OF_LOAD:
                suggestion = suggest(name, [*OF_LOAD, *names])
                yield label, messages.UNKNOWN_FACTOR(name=format_value(name)[1:-1], suggestion=suggestion)
        if factors.get("prestress", 1.0) < 0.0:
            yield label, messages.NEGATIVE_PRESTRESS(factor=factors["prestress"])


def action_factor(combination: Combination, name: str) -> float:
    """Return the factor of an action: as given, otherwise 1 for permanent and prestress, 0 for others."""
    default = 1.0 if name in ("permanent", "prestress") else 0.0
    return float(combination.factors.get(name, default))


def expand_combinations(data: dict[str, Any], where: str, errors: list[str]) -> None:
    """Append the rows of [combinations] to the entries of [[combination]]. where : the file, for messages"""
    table, entries = data.get("combinations", {}), data.get("combination", [])
    if not isinstance(table, dict) or not isinstance(entries, list):
        return
    data.pop("combinations", None)
    for name, row in table.items():
        if isinstance(row, dict):
            factors = {key: value for key, value in row.items() if key != "kind"}
            kind = {"kind": row["kind"]} if "kind" in row else {}
            entries = [*entries, {"name": name, "factors": factors} | kind]
        else:
            errors.append(f"{where}: {messages.NOT_FACTORS(name=name, value=format_value(row))}")
    if table:
        data["combination"] = entries
