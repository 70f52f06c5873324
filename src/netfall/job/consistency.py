"""Errors of a job that depend on more than one key."""

from collections.abc import Iterator
from typing import Any

from netfall.job import cases
from netfall.job.entries import REMOVED_MEMBER_KEYS, Case, Motion, Remove
from netfall.job.models import Load, Wind
from netfall.job.schema import (
    BREAKING_KEYS,
    EXCLUSIVE_KEYS,
    GENERATORS,
    REQUIRED_ALTERNATIVES,
    find_key,
)
from netfall.job.values import format_value


def combined_errors(
    given: dict[str, Any], checked: dict[str, Any], lists: dict[str, Any]
) -> Iterator[tuple[str, str]]:
    """Yield place and error for everything that depends on more than one key.

    given : sections as written; checked, lists : checked sections and entries
    """
    wind, dynamics, net = given.get("wind", {}), given.get("dynamics", {}), checked["net"]
    if "net" in given:
        yield from (("net", what) for what in _net_key_errors(given["net"]))
    if "wind" in given:
        yield from (("wind", what) for what in _wind_errors(given["wind"], _may_detach(given, lists)))
    if "cable" in given:
        yield from _cable_errors(given["cable"], _groups(given), "elements" in given.get("net", {}))
    if "wind" in given and "dynamics" not in given:
        yield "wind", "there is no [dynamics] that the wind could act in; add it or remove [wind]"
    form = checked["form_finding"]
    if form and form.method == "given_geometry" and form.loads == "permanent" and net and net.subdivide > 1:
        what = f"subdivide = {net.subdivide}: nodes between those given sag under permanent loads"
        yield "net", f'{what}; with method = "given_geometry" expected subdivide = 1, or loads = "none"'
    yield from _entry_errors(lists)
    yield from cases.case_errors(lists["cases"], checked["wind"] or Wind())
    yield from cases.combination_errors(lists["combinations"], lists["cases"])
    yield from _base_height_errors(wind, checked["wind"], lists["cases"])
    yield from _removal_errors(given, checked["load"], lists["removes"])
    for number, entry in enumerate(lists["motions"], 1):
        yield from ((f"[[motion]] {number}:", what) for what in _motion_errors(entry, "dynamics" in given))
    for missing in _missing_partner(dynamics, "axial_damping_ratio", "axial_damping_band"):
        yield "dynamics", f"{missing}: missing; a ratio and the band in which it holds go together"


def _missing_partner(table: dict[str, Any], *pair: str) -> list[str]:
    """Return the missing key if only the other key of a pair is given."""
    missing = [name for name in pair if table.get(name) is None]
    return missing if len(missing) == 1 else []


def _entry_errors(lists: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield errors of zones, stages, slip points and targets."""
    for zone in lists["zones"]:
        if zone.polygon is not None and zone.groups is not None:
            yield f"[[zone]] {zone.name}:", "polygon and groups exclude each other; keep one of the two"
        if zone.cut and zone.polygon is None:
            yield f"[[zone]] {zone.name}:", "cut = true: only with polygon, which cuts; remove it"
    for stage in lists["stages"]:
        if stage.clamps and not lists["slides"]:
            yield f"[[stage]] {stage.name}:", "clamps: nothing slips; add [[slide]], or remove it"
    for number, entry in enumerate(lists["slides"], 1):
        if (entry.group is None) == (entry.cables is None):
            problem = "missing; say what slips" if entry.group is None else "exclude each other"
            yield f"[[slide]] {number}:", f"group or cables: {problem}; expected one of the two"
    for number, target in enumerate(lists["targets"], 1):
        given = [key for key in ("group", "force", "node", "height") if getattr(target, key) is not None]
        if given not in (["group", "force"], ["node", "height"]):
            problem = "expected group and force, or node and height; give one of these pairs"
            yield f"[[target]] {number}:", problem


def _removal_errors(
    given: dict[str, Any], load: Load | None, removes: list[Remove]
) -> Iterator[tuple[str, str]]:
    """Yield errors of the entries of [[remove]]."""
    for number, entry in enumerate(removes, 1):
        present = [key for key in REMOVED_MEMBER_KEYS if getattr(entry, key) is not None]
        if len(present) != 1:
            conflict = f"{' and '.join(present)} exclude each other; keep one of them"
            yield (
                f"[[remove]] {number}:",
                conflict if present else f"{' or '.join(REMOVED_MEMBER_KEYS)}: missing; say what is lost",
            )
    if removes and "dynamics" not in given:
        yield "[[remove]]", "there is no [dynamics] in which something could be lost; add it"
    if removes and "wind" not in given and load and load.ramp:
        yield "load", "ramp: a job with [[remove]] starts at rest under all loads; remove one of them"


def _motion_errors(entry: Motion, moves: bool) -> Iterator[str]:
    """Yield errors of an entry of [[motion]]; moves : whether there is a dynamic stage."""
    if (entry.displacement is None) == (entry.acceleration is None):
        problem = "missing" if entry.displacement is None else "exclude each other"
        yield f"displacement or acceleration: {problem}; expected one of the two"
    if entry.direction is not None and entry.displacement is not None:
        yield "direction: a displacement has x, y and z in its table; remove it"
    if is_record(entry) and entry.direction is None:
        yield "direction: missing; a record has one component: [x, y, z] of it"
    if entry.baseline is not None and not is_record(entry):
        yield "baseline: is of records (.AT2); a table is taken as it stands: remove it"
    for missing in _missing_partner(dict(entry), "speed", "travel"):
        yield f"{missing}: missing; a wave has a speed and a travel = [x, y, z]"
    for name in ("direction", "travel"):
        if getattr(entry, name) is not None and not any(getattr(entry, name)):
            yield f"{name} = [0, 0, 0]: has no direction; expected another"
    if not moves:
        key = "displacement" if entry.displacement else "acceleration"
        yield f"{key}: there is no [dynamics] in which supports could move; add it"


def _net_key_errors(net: dict[str, Any]) -> Iterator[str]:
    """Yield errors of the source of the net."""
    tables = "nodes" in net or "elements" in net
    if "generator" in net and tables:
        yield "generator and tables (nodes, elements) exclude each other; keep one of the two"
    elif tables:
        yield from (
            f"{missing}: missing; tables come as a pair, nodes and elements"
            for missing in _missing_partner(net, "nodes", "elements")
        )
    elif "generator" not in net:
        names = ", ".join(map(format_value, GENERATORS))
        yield f"generator: missing; expected one of {names}, or nodes and elements"
    if net.get("unit", "m") != "m" and not tables:
        yield f"unit = {format_value(net['unit'])}: only for tables; dimensions are in m"


def _wind_errors(wind: dict[str, Any], detaches: bool) -> Iterator[str]:
    """Yield errors of sources, coefficients and gusts; detaches : whether fragments can detach and drag."""
    sources = [key for key in ("speed", "file", "pressures") if key in wind]
    if sources == ["pressures"] and _has_aerodynamic_damping(wind):
        yield "speed: missing; with pressures, aerodynamic_damping needs the mean speed at 10 m, in m/s"
    elif sources == ["speed", "pressures"] and (_has_aerodynamic_damping(wind) or detaches):
        pass  # damping and drag are for that mean speed
    elif len(sources) > 1:
        yield f"{' and '.join(sources)} exclude each other; keep one of them"
    elif not sources:
        expected = "a number of m/s > 0, or file = a table of time, speed"
        yield f"speed: missing; expected {expected}, or pressures = one of time and taps"
    for missing in _missing_partner(wind, "pressures", "taps"):
        yield f"{missing}: missing; pressures in time and the places of their taps go together"
    if "points" in wind and "file" not in wind:
        yield "points: only with file, whose speeds were measured there; add it"
    names = ("pressure_coefficient", "sectors")
    given: list[str] = [key for key in names if key in wind]
    if "pressures" in wind:
        given += ["zone"] * any("pressure_coefficient" in zone for zone in _zones(wind))
        if given:
            yield f"{', '.join(given)}: pressures at taps need no coefficients; remove it"
    elif len(given) == 2:
        yield "pressure_coefficient and sectors exclude each other; keep one of the two"
    elif not given:
        expected = "a number, or sectors = a table of them by the wind's direction"
        yield f"pressure_coefficient: missing; expected {expected}"
    if "surface_drag" in wind and "turbulence_intensity" in wind:
        yield "surface_drag and turbulence_intensity exclude each other (k = I^2 / 6); keep one of the two"
    elif not {"surface_drag", "turbulence_intensity"} & set(wind) and _is_generated(wind):
        yield (
            "turbulence_intensity: missing; expected that of the gusts at 10 m (codes give 0.15 to 0.2 in "
            "open terrain; 0: no gusts), or surface_drag, k of Davenport's spectrum"
        )


def _base_height_errors(
    wind: dict[str, Any], section: Wind | None, all_cases: list[Case]
) -> Iterator[tuple[str, str]]:
    """Yield errors of a generated or static wind without the height of z = 0; all_cases : of [[case]]."""
    missing = (
        "base_height: missing; expected the height of z = 0 above ground in m (0 if z counts from the "
        "ground), or profile_exponent = 0 for the same speed at every height"
    )
    if "base_height" in wind:
        return
    if _is_generated(wind) and section is not None and section.profile_exponent > 0.0:
        yield "wind", missing
        return
    for case in filter(cases.has_static_wind, all_cases):
        acting = cases.static_wind(section or Wind(), case)
        if acting.profile_exponent > 0.0 and "wind.base_height" not in case.set:
            yield f"[[case]] {case.name}:", f"set: wind.{missing}"


def is_record(motion: Motion) -> bool:
    """Tell whether an entry of [[motion]] names a record of PEER."""
    return motion.acceleration is not None and motion.acceleration.lower().endswith(".at2")


def _zones(table: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the tables of the zones of a section as written."""
    zones = table.get("zone")
    return [zone for zone in zones.values() if isinstance(zone, dict)] if isinstance(zones, dict) else []


def _is_generated(wind: dict[str, Any]) -> bool:
    """Tell whether [wind], as written, is a speed from which the wind is generated."""
    return "speed" in wind and "file" not in wind and "pressures" not in wind


def _has_aerodynamic_damping(wind: dict[str, Any]) -> bool:
    """Tell whether [wind], as written, has aerodynamic damping anywhere."""
    return any(table.get("aerodynamic_damping") for table in (wind, *_zones(wind)))


def _may_detach(given: dict[str, Any], lists: dict[str, Any]) -> bool:
    """Tell whether a job, as written, may detach fragments that the wind drags."""
    tables = (given.get("cable", {}), *_groups(given).values())
    cut = any(table.keys() & BREAKING_KEYS for table in tables) or bool(lists["removes"])
    return cut and given["wind"].get("after_fracture", "detached") == "detached"


def missing_key_message(name: str) -> str:
    """Return the message for a missing key."""
    key = find_key("cable", name)
    alternative = next(other for other in REQUIRED_ALTERNATIVES[name] if other != name)
    return f"{name}: missing; expected {key.expected()}, or {alternative}, or a type of the catalogue"


def _groups(given: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the tables of the groups as written."""
    groups = given.get("group", {})
    return {name: table for name, table in groups.items() if isinstance(table, dict)}


def _cable_errors(
    cable: dict[str, Any], groups: dict[str, dict[str, Any]], tables: bool
) -> Iterator[tuple[str, str]]:
    """Yield errors of [cable] and the groups as written; tables : whether table rows may add keys."""
    everywhere = {f"group.{name}": table for name, table in groups.items()} | {"cable": cable}
    for place, table in everywhere.items():
        for one, other in EXCLUSIVE_KEYS:
            if one in table and other in table:
                yield place, f"{one} and {other} exclude each other; keep one of the two"
        if "type" in table and "catalogue" not in cable:
            yield place, "type: needs the table that it stands in; add catalogue = a path to [cable]"
    given = {key for table in everywhere.values() for key in table}
    for name, other in REQUIRED_ALTERNATIVES.items():
        if not tables and not given & {*other, "type"}:
            yield "cable", missing_key_message(name)
