"""Static cases and combinations: the keys that a case can set, and their checks."""

from collections.abc import Iterator
from typing import Any, Protocol, TypeVar

from netfall.job import messages
from netfall.job.keys.entries import Case, Combination
from netfall.job.keys.fields import Key, inner_models, keys_of
from netfall.job.keys.models import CaseWind, Load, Wind
from netfall.job.values import format_value, suggest


class Checker(Protocol):
    """Checker of values, as `validate.Validator`."""

    def wrong(self, section: str, what: str) -> None:
        """Append an error."""

    def put(self, place: str, name: str, key: Key, value: object, values: dict[str, Any]) -> None:
        """Put a value into `values` if it is valid."""


SectionT = TypeVar("SectionT", Load, Wind, CaseWind)

OF_LOAD = ("permanent", "prestress", "temperature", "load")  # names of factors that are not cases
RESERVED_NAMES = (*OF_LOAD, "kind")  # names that no case bears: those of factors, and a key of [combinations]
# Keys of [wind] that a case can set; gusts do not act in a case.
CASE_WIND_KEYS = (
    *("speed", "direction", "pressure_coefficient", "sectors", "air_density"),
    *("profile_exponent", "base_height", "pressure_factor"),
)
CASE_LOAD_KEYS = ("dead", "snow", "ice", "pressure", "temperature")  # keys of [load] that a case can set


def settable_keys(sections: dict[str, Any], zone_keys: dict[str, Any]) -> dict[str, Key]:
    """Return the keys that a case can set, by "load.snow", "load.zone.NAME.snow".

    sections, zone_keys : of the schema
    """
    of_load = {key.name: key for key in sections["load"]}
    rows = {f"load.{name}": of_load[name] for name in CASE_LOAD_KEYS}
    rows |= {f"wind.{name}": keys_of(CaseWind)[name] for name in CASE_WIND_KEYS}
    for section in ("load", "wind"):
        zone_rows = {f"{section}.zone.NAME.{key.name}": key for key in zone_keys[section]}
        rows |= {name: key for name, key in zone_rows.items() if f"{section}.{key.name}" in rows}
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


def read_settings(
    kind: str, label: str, given: dict[str, Any], settable: dict[str, Key], validator: Checker
) -> dict[str, Any]:
    """Return the values that a case or a stage sets, by names like "load.snow", "load.zone.NAME.snow".

    kind : case or stage; label : prefix of errors; given : `set` as written, also nested
    settable : of `settable_keys`
    """
    label = f"{label} set:"
    values: dict[str, Any] = {}
    for name, value in flatten_settings(given).items():
        section, zone, key = split(name)
        row = settable.get(f"{section}.zone.NAME.{key}" if zone else name)
        if row is None:
            suggestion = suggest(name, settable)
            shown = format_value(name)[1:-1]
            validator.wrong(label, messages.NOT_SETTABLE(name=shown, kind=kind, suggestion=suggestion))
        else:
            validator.put(label, name, row, value, values)
    if {"wind.pressure_coefficient", "wind.sectors"} <= set(values):
        validator.wrong(label, messages.EXCLUSIVE(keys="wind.pressure_coefficient and wind.sectors"))
    return values


def flatten_settings(table: dict[str, Any], place: str = "") -> dict[str, Any]:
    """Flatten nested tables to values by dotted names: TOML reads `load.snow` without quotes as nested."""
    flat: dict[str, Any] = {}
    for name, value in table.items():
        flat |= (
            flatten_settings(value, f"{place}{name}.") if isinstance(value, dict) else {place + name: value}
        )
    return flat


def has_static_wind(case: Case) -> bool:
    """Tell whether a static wind acts in a case."""
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
