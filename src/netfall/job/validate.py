"""Validation of the tables of a job file: each key by its field, then the keys against each other."""

from collections.abc import Iterator
from typing import Any, TypeVar

from pydantic import ValidationError

from netfall.job import messages
from netfall.job.keys import schema
from netfall.job.keys.entries import (
    NO_TABLE,
    REMOVED_MEMBER_KEYS,
    Case,
    Motion,
    Remove,
    case_errors,
    combination_errors,
    has_static_wind,
    setting_items,
    split,
    static_wind,
)
from netfall.job.keys.fields import Key, Section, inner_models, keys_of
from netfall.job.keys.models import Cable, Group, Limits, Load, Top, Wind
from netfall.job.renames import renamed_key_error, renamed_value_error
from netfall.job.units import UnitError, to_unit
from netfall.job.values import format_value, suggest


def combined_errors(
    given: dict[str, Any], checked: dict[str, Any], lists: dict[str, Any]
) -> Iterator[tuple[str, str]]:
    """Yield place and error for everything that depends on more than one key.

    given : sections as written; checked, lists : checked sections and entries
    """
    wind, dynamics, net = given.get("wind", {}), given.get("dynamics", {}), checked["net"]
    form, of_elements = checked["form_finding"], (given.get("cable", {}), *_groups(given).values())
    slender = any(table.get("diameter") for table in of_elements)
    if "net" in given:
        yield from (("net", what) for what in _net_key_errors(given["net"]))
    if "wind" in given and "dynamics" not in given:
        yield "", messages.NEEDS(key=f"[wind] {', '.join(wind)}", needed="[dynamics]")
    elif "wind" in given:
        may_break = bool(lists["removes"]) or any(
            table.keys() & schema.BREAKING_KEYS for table in of_elements
        )
        detaches = may_break and wind.get("after_fracture", "detached") == "detached"
        yield from (("wind", what) for what in _wind_errors(wind, checked["wind"], detaches, slender))
    if "cable" in given:
        tables, by_density = "elements" in given.get("net", {}), bool(form and form.method == "force_density")
        yield from _cable_errors(given["cable"], _groups(given), tables, by_density)
    if form and form.method == "given_geometry" and form.loads == "permanent" and net and net.subdivide > 1:
        yield "net", messages.SUBDIVIDED_GIVEN_GEOMETRY(parts=net.subdivide)
    if checked["roof"] and checked["roof"].normal and not any(checked["roof"].normal):
        yield "roof", messages.NO_DIRECTION(name="normal")
    yield from _entry_errors(lists)
    yield from case_errors(lists["cases"], checked["wind"] or Wind(), slender)
    iced = {"load": checked["load"].ice} if checked["load"] else {}
    iced |= {f"[[case]] {case.name}: set:": case.set.get("load.ice") for case in lists["cases"]}
    iced |= {f"[[stage]] {stage.name}: set:": stage.set.get("load.ice") for stage in lists["stages"]}
    for place in (place for place, ice in iced.items() if ice and not slender):
        yield place, messages.NEEDS(key="ice", needed="[group.NAME] diameter")
    yield from combination_errors(lists["combinations"], lists["cases"])
    yield from _base_height_errors(wind, checked["wind"], lists["cases"])
    yield from _removal_errors(given, checked["load"], lists["removes"])
    for number, entry in enumerate(lists["motions"], 1):
        yield from ((f"[[motion]] {number}:", what) for what in _motion_errors(entry, "dynamics" in given))
    yield from _limit_errors(checked["limits"], "span" in given.get("limits", {}))
    for what in _missing_partner(dynamics, "axial_damping_ratio", "axial_damping_band"):
        yield "dynamics", what


def _limit_errors(limits: Limits | None, has_span: bool) -> Iterator[tuple[str, str]]:
    """Yield place and error for each limit that is a share of a span that is not given.

    has_span : whether the span of all groups is given, right or wrong
    """
    if limits is None:
        return
    tables = {"limits": limits, **{f"limits.group.{name}": table for name, table in limits.group.items()}}
    for place, table in tables.items():
        if isinstance(table.displacement, str) and table.span is None and not has_span:
            yield place, messages.NO_SPAN(limit=table.displacement)


def _missing_partner(table: dict[str, Any], one: str, other: str) -> Iterator[str]:
    """Yield an error if only one key of a pair is given."""
    for given, missing in ((one, other), (other, one)):
        if table.get(given) is not None and table.get(missing) is None:
            yield messages.MISSING_PARTNER(missing=missing, given=given)


def _entry_errors(lists: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield errors of zones, stages, slip points and targets."""
    for zone in lists["zones"]:
        if zone.polygon is not None and zone.groups is not None:
            yield f"[[zone]] {zone.name}:", messages.EXCLUSIVE(keys="polygon and groups")
        if zone.cut and zone.polygon is None:
            yield f"[[zone]] {zone.name}:", messages.NEEDS(key="cut = true", needed="polygon")
    for stage in lists["stages"]:
        if stage.clamps and not lists["slides"]:
            yield f"[[stage]] {stage.name}:", messages.NEEDS(key="clamps", needed="[[slide]]")
    tables = [stage.load_table for stage in lists["stages"]]
    if NO_TABLE in tables and not any(tables[: tables.index(NO_TABLE)]):
        place = f"[[stage]] {lists['stages'][tables.index(NO_TABLE)].name}:"
        yield place, messages.NEEDS(key='load_table = "none"', needed="one in an earlier stage")
    for number, entry in enumerate(lists["slides"], 1):
        yield from ((f"[[slide]] {number}:", what) for what in _not_one_of(entry, "group", "cables"))
    for number, target in enumerate(lists["targets"], 1):
        given = [key for key in ("group", "force", "node", "height") if getattr(target, key) is not None]
        if given not in (["group", "force"], ["node", "height"]):
            yield f"[[target]] {number}:", messages.WRONG_TARGET()


def _not_one_of(entry: Section, *keys: str) -> Iterator[str]:
    """Yield an error unless an entry has exactly one of some keys."""
    given = [key for key in keys if getattr(entry, key) is not None]
    if not given:
        yield messages.MISSING_ONE_OF(keys=" or ".join(keys))
    elif len(given) > 1:
        yield messages.EXCLUSIVE(keys=" and ".join(given))


def _removal_errors(
    given: dict[str, Any], load: Load | None, removes: list[Remove]
) -> Iterator[tuple[str, str]]:
    """Yield errors of the entries of [[remove]]."""
    for number, entry in enumerate(removes, 1):
        yield from ((f"[[remove]] {number}:", what) for what in _not_one_of(entry, *REMOVED_MEMBER_KEYS))
    if removes and "dynamics" not in given:
        yield "", messages.NEEDS(key="[[remove]]", needed="[dynamics]")
    if removes and "wind" not in given and load and load.ramp:
        yield "load", messages.RAMP_WITH_REMOVAL()


def _motion_errors(entry: Motion, moves: bool) -> Iterator[str]:
    """Yield errors of an entry of [[motion]]; moves : whether there is a dynamic stage."""
    yield from _not_one_of(entry, "displacement", "acceleration")
    if entry.direction is not None and entry.displacement is not None:
        yield messages.EXCLUSIVE(keys="direction and displacement")
    if is_record(entry) and entry.direction is None:
        yield messages.RECORD_WITHOUT_DIRECTION()
    if entry.baseline is not None and not is_record(entry):
        yield messages.BASELINE_OF_TABLE()
    yield from _missing_partner(dict(entry), "speed", "travel")
    for name in ("direction", "travel"):
        if getattr(entry, name) is not None and not any(getattr(entry, name)):
            yield messages.NO_DIRECTION(name=name)
    if not moves:
        key = "displacement" if entry.displacement else "acceleration"
        yield messages.NEEDS(key=key, needed="[dynamics]")


def _net_key_errors(net: dict[str, Any]) -> Iterator[str]:
    """Yield errors of the source of the net."""
    tables = "nodes" in net or "elements" in net
    if "generator" in net and tables:
        yield messages.EXCLUSIVE(keys="generator and tables (nodes, elements)")
    elif tables:
        yield from _missing_partner(net, "nodes", "elements")
    elif "generator" not in net:
        yield messages.NO_NET_SOURCE(generators=", ".join(map(format_value, schema.GENERATORS)))
    if net.get("unit", "m") != "m" and not tables:
        yield messages.UNIT_OF_GENERATOR(value=format_value(net["unit"]))


def _wind_errors(wind: dict[str, Any], section: Wind, detaches: bool, slender: bool) -> Iterator[str]:
    """Yield errors of sources, coefficients and gusts.

    wind, section : as written and checked
    detaches : whether fragments can detach and drag; slender : whether elements have a diameter, so that wind
        acts on them without a coefficient of the roof
    """
    sources = [key for key in ("speed", "file", "pressures") if key in wind]
    damps = any(section.all_values("aerodynamic_damping"))
    if sources == ["pressures"] and damps:
        yield messages.NO_DAMPING_SPEED()
    elif sources == ["speed", "pressures"] and (damps or detaches):
        pass  # damping and drag are for that mean speed
    elif len(sources) > 1:
        yield messages.EXCLUSIVE(keys=" and ".join(sources))
    elif not sources:
        yield messages.NO_WIND_SPEED()
    yield from _missing_partner(wind, "pressures", "taps")
    if "points" in wind and "file" not in wind:
        yield messages.NEEDS(key="points", needed="file")
    names = ("pressure_coefficient", "sectors")
    given: list[str] = [key for key in names if key in wind]
    if "pressures" in wind:
        given += ["zone"] * bool(section.zone_values("pressure_coefficient"))
        if given:
            yield messages.EXCLUSIVE(keys=" and ".join(["pressures", *given]))
    elif len(given) == 2:
        yield messages.EXCLUSIVE(keys=" and ".join(names))
    elif not (given or slender):
        yield messages.NO_PRESSURE_COEFFICIENT()
    if "surface_drag" in wind and "turbulence_intensity" in wind:
        yield messages.EXCLUSIVE(keys="surface_drag and turbulence_intensity")
    elif not {"surface_drag", "turbulence_intensity"} & set(wind) and sources == ["speed"]:
        yield messages.NO_TURBULENCE()


def _base_height_errors(
    wind: dict[str, Any], section: Wind | None, all_cases: list[Case]
) -> Iterator[tuple[str, str]]:
    """Yield errors of a wind with a profile without the height of z = 0; all_cases : of [[case]]."""
    if "base_height" in wind:
        return
    if wind.keys() & {"speed", "file"} and section is not None and section.profile_exponent > 0.0:
        yield "wind", messages.NO_BASE_HEIGHT(key="base_height")
        return
    for case in filter(has_static_wind, all_cases):
        acting = static_wind(section or Wind(), case)
        if acting.profile_exponent > 0.0 and "wind.base_height" not in case.set:
            yield f"[[case]] {case.name}:", messages.NO_BASE_HEIGHT(key="set: wind.base_height")


def is_record(motion: Motion) -> bool:
    """Return whether an entry of [[motion]] names a record of PEER."""
    return motion.acceleration is not None and motion.acceleration.lower().endswith(".at2")


def missing_key_error(name: str, element: str = "") -> str:
    """Return the error for a missing key of [cable]; element : that lacks it, " for element 7"."""
    return messages.MISSING_SECTION_KEY(
        name=name,
        element=element,
        expected=keys_of(Cable)[name].expected(),
        alternative=next(other for other in schema.REQUIRED_ALTERNATIVES[name] if other != name),
    )


def _groups(given: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the tables of the groups as written."""
    groups = given.get("group", {})
    return {name: table for name, table in groups.items() if isinstance(table, dict)}


def _cable_errors(
    cable: dict[str, Any], groups: dict[str, dict[str, Any]], tables: bool, by_density: bool
) -> Iterator[tuple[str, str]]:
    """Yield errors of [cable] and the groups as written.

    tables : whether table rows may add keys; by_density : whether there is form finding by force density
    """
    everywhere = {f"group.{name}": table for name, table in groups.items()} | {"cable": cable}
    for place, table in everywhere.items():
        for one, other in schema.EXCLUSIVE_KEYS:
            if one in table and other in table:
                yield place, messages.EXCLUSIVE(keys=f"{one} and {other}")
        if "type" in table and "catalogue" not in cable:
            yield place, messages.NEEDS(key="type", needed="[cable] catalogue")
        if "horizontal_force" in table and not by_density:
            yield place, messages.NO_FORM_BY_DENSITY()
    given = {key for table in everywhere.values() for key in table}
    for name, alternatives in schema.REQUIRED_ALTERNATIVES.items():
        if not tables and not given & {*alternatives, "type"}:
            yield "cable", missing_key_error(name)


Model = TypeVar("Model", bound=Section)
KNOWN_SECTIONS = (*schema.MODELS, "group", "combinations")
SETTABLE = {"case": schema.CASE_KEYS, "stage": schema.STAGE_KEYS}  # lists with a key `set`


class Validator:
    """Checker of tables, which appends a line for each error to `errors`."""

    def __init__(self, where: str, errors: list[str]):
        """where : name of the file, for messages"""
        self.where = where
        self.errors = errors

    def wrong(self, section: str, what: str) -> None:
        """Append an error. section : its name, or a place in brackets as written"""
        place = section if section.startswith("[") else f"[{section}]"
        self.errors.append(f"{self.where}: {place + ' ' if section else ''}{what}")

    def sections(self, data: dict[str, Any]) -> dict[str, Any]:
        """Return the fields of a `Job` by name; a key that is wrong has its default, or None."""
        given = {k: v for k, v in data.items() if isinstance(v, dict) and k not in schema.LIST_MODELS}
        for name in given:
            if name == "" or name not in KNOWN_SECTIONS:
                suggestion = suggest(name, KNOWN_SECTIONS)
                self.wrong("", messages.UNKNOWN_SECTION(name=name, suggestion=suggestion))
        for name in KNOWN_SECTIONS:
            if name in data and name not in given:
                value = format_value(data[name])
                self.wrong("", messages.NOT_A_SECTION(name=name, value=value, section=name))
        known = {*given, *KNOWN_SECTIONS, *schema.LIST_MODELS}
        scalars = {name: value for name, value in data.items() if name not in known}
        title = self.values("", keys_of(Top), scalars).get("title", "")
        for name in schema.REQUIRED_SECTIONS:
            if name not in data:
                self.wrong("", messages.MISSING_SECTION(name=name))
        sections: dict[str, Any] = dict.fromkeys(schema.MODELS)
        for name in filter(schema.MODELS.__contains__, given):
            table, dimensions = given[name], {}
            if name == "net":
                dimensions = self._dimensions(table)
                table = {key: value for key, value in table.items() if key not in schema.GENERATORS}
            sections[name] = self.table(name, schema.MODELS[name], table).replaced(**dimensions)
        groups = self._inner_tables("", "group", Group, given.get("group", {}))
        sections["output"] = sections["output"] or schema.MODELS["output"]()
        lists = {
            f"{name}s": self.entries(name, model, data.get(name, []))
            for name, model in schema.LIST_MODELS.items()
        }
        faults = "\n".join(self.errors)
        for place, problem in combined_errors(given, sections, lists):
            if not (place.startswith("[[") and f": {place}" in faults):  # it may lack what was wrong
                self.wrong(place, problem)
        return {"title": title, "groups": groups} | sections | lists

    def _dimensions(self, net: dict[str, Any]) -> dict[str, Section]:
        """Return the dimensions of the chosen generator, [net.GENERATOR], by its name."""
        generator = net.get("generator")
        for name, table in [(name, net[name]) for name in schema.GENERATORS if name in net]:
            if not isinstance(table, dict):
                value = format_value(table)
                self.wrong("net", messages.NOT_A_SECTION(name=name, value=value, section=f"net.{name}"))
            elif name != generator:
                self.wrong(f"net.{name}", messages.OTHER_DIMENSIONS(generator=format_value(name)))
                self.values(f"net.{name}", keys_of(schema.GENERATORS[name]), table)
        if not isinstance(generator, str) or generator not in schema.GENERATORS:
            return {}
        table = net.get(generator, {})
        model = schema.GENERATORS[generator]
        return {generator: self.table(f"net.{generator}", model, table if isinstance(table, dict) else {})}

    def entries(self, name: str, model: type[Model], given: object) -> list[Model]:
        """Return the entries of a list of tables, whose names must be unique."""
        if not isinstance(given, list) or not all(isinstance(table, dict) for table in given):
            self.wrong("", messages.NOT_ENTRIES(name=name, value=format_value(given)))
            return []
        entries: list[Model] = []
        first_entry: dict[str, int] = {}
        for number, table in enumerate(given, 1):
            entry_name = table.get("name")
            label = f"[[{name}]] {entry_name if isinstance(entry_name, str) and entry_name else number}:"
            if name in SETTABLE and isinstance(table.get("set"), dict):
                table = table | {"set": self._settings(name, label, table["set"])}
            entries.append(self.table(label, model, table))
            if isinstance(entry_name, str) and first_entry.setdefault(entry_name, number) != number:
                self.wrong(label, messages.DUPLICATE_ENTRY(first=first_entry[entry_name]))
        return entries

    def _settings(self, kind: str, label: str, given: dict[str, Any]) -> dict[str, Any]:
        """Return the values that a case or a stage sets, by names like "load.snow", "load.zone.NAME.snow".

        kind : case or stage; label : prefix of errors; given : `set` as written, also nested
        """
        label, settable = f"{label} set:", SETTABLE[kind]
        values: dict[str, Any] = {}
        for name, value in setting_items(given):
            if name in values:
                self.wrong(label, messages.EXCLUSIVE(keys=f'{name} and "{name}"'))
            section, zone, key = split(name)
            row = settable.get(f"{section}.zone.NAME.{key}" if zone else name)
            if row is None:
                shown, suggestion = format_value(name)[1:-1], suggest(name, settable)
                error = messages.NOT_SETTABLE(name=shown, kind=kind, suggestion=suggestion)
                self.wrong(label, renamed_key_error(label, name, given) or error)
            else:
                self.put(label, name, row, value, values)
        if {"wind.pressure_coefficient", "wind.sectors"} <= set(values):
            self.wrong(label, messages.EXCLUSIVE(keys="wind.pressure_coefficient and wind.sectors"))
        return values

    def table(self, place: str, model: type[Model], table: dict[str, Any]) -> Model:
        """Return a section with its inner tables; a key that is wrong has its default, or None.

        place : as in `wrong`
        """
        inner = {}
        for name, inner_model in inner_models(model).items():
            if name in table:
                inner[name] = self._inner_tables(place, name, inner_model, table[name])
        keys = keys_of(model)
        values = self.values(place, keys, {k: v for k, v in table.items() if k not in inner}) | inner
        absent = [name for name, key in keys.items() if key.required and name not in values]
        for name in absent:
            if name not in table:
                self.wrong(place, messages.MISSING_KEY(name=name, expected=keys[name].expected()))
        return model.model_construct(**dict.fromkeys(absent), **values)

    def _inner_tables(self, place: str, name: str, model: type[Section], given: object) -> dict[str, Section]:
        """Return the tables [SECTION.zone.NAME] or [group.NAME] by their names."""
        path = f"{place}.{name}" if place else name
        if not isinstance(given, dict) or not all(isinstance(table, dict) for table in given.values()):
            self.wrong(place, messages.NOT_TABLES(name=name, value=format_value(given), section=path))
            return {}
        return {inner: self.table(f"{path}.{inner}", model, table) for inner, table in given.items()}

    def values(self, place: str, keys: dict[str, Key], table: dict[str, Any]) -> dict[str, Any]:
        """Return the valid values of a table, as the types of their keys."""
        values: dict[str, Any] = {}
        for name, value in table.items():
            if name not in keys:
                error = messages.UNKNOWN_KEY(name=format_value(name)[1:-1], suggestion=suggest(name, keys))
                self.wrong(place, renamed_key_error(place, name, table) or error)
            else:
                self.put(place, name, keys[name], value, values)
        return values

    def put(self, place: str, name: str, key: Key, value: object, values: dict[str, Any]) -> None:
        """Put a value into `values` if it is valid."""
        try:
            values[name] = key.checked(to_unit(value, key.unit) if key.takes_units else value)
        except UnitError as error:
            self.wrong(place, f"{name} = {format_value(value)}: {error}")
        except ValidationError:
            error = messages.INVALID_VALUE(name=name, value=format_value(value), expected=key.expected())
            self.wrong(place, renamed_value_error(place, name, value) or error)
