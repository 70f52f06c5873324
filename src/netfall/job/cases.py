"""Static cases and combinations: what a case can set, and their checks."""

from collections.abc import Callable
from types import SimpleNamespace

from netfall.job.keys import Key
from netfall.job.values import nearest, shown

OF_LOAD = ("permanent", "prestress", "temperature", "load")  # factors that bear no case's name
# What a case sets of [wind], as in its section; gusts do not act in it.
PRESSURE_FACTOR = Key(
    "pressure_factor", "number", 1.0, "", "of the pressure of a static wind", low=-1e3, high=1e3
)
OF_WIND = (
    *("speed", "direction", "shape_coefficient", "sectors", "air_density"),
    *("profile_exponent", "base_height"),
)
LOAD_KEYS = ("dead", "snow", "pressure", "temperature")  # and of [load]


def rows_of_set(sections: dict, overrides: dict) -> dict[str, Key]:
    """Rows of what a case can set, by "load.snow", "load.zone.NAME.snow"; arguments : of the schema."""
    of_load = {key.name: key for key in sections["load"]}
    rows = {f"load.{name}": of_load[name] for name in LOAD_KEYS}
    rows |= {f"wind.{key.name}": key for key in sections["wind"] if key.name in OF_WIND}
    rows["wind.pressure_factor"] = PRESSURE_FACTOR
    for section in ("load", "wind"):
        own = {f"{section}.zone.NAME.{key.name}": key for key in overrides[section][1]}
        rows |= {name: key for name, key in own.items() if f"{section}.{key.name}" in rows}
    return rows


def split(name: str) -> tuple[str, str, str]:
    """Section, zone ("": none) and key of "load.snow" or "wind.zone.edge.shape_coefficient"."""
    section, _, rest = name.partition(".zone.")
    zone, _, key = rest.rpartition(".")
    if not zone:
        section, _, key = name.partition(".")
    return section, zone, key


def with_set(section: SimpleNamespace, name: str, case: SimpleNamespace) -> SimpleNamespace:
    """A section, [load] or [wind] by its name, with what a case or a stage sets of it."""
    found = SimpleNamespace(**vars(section))
    found.zone = {zone: dict(values) for zone, values in section.zone.items()}
    for setting, value in case.set.items():
        of, zone, key = split(setting)
        if of == name and zone:
            found.zone.setdefault(zone, {})[key] = value
        elif of == name:
            setattr(found, key, value)
    return found


def values_of_set(
    case: SimpleNamespace, rows: dict[str, Key], put: Callable, wrong: Callable, kind: str = "case"
) -> dict:
    """What a case, or a stage, sets, by names such as "load.snow" and "load.zone.NAME.snow".

    rows : of `rows_of_set`; put(place, name, row, value, values) takes what is right, wrong(place, what) not
    """
    place, values = f"[[{kind}]] {case.name}: set:", {}
    for name, value in _flat(case.set).items():
        section, zone, key = split(name)
        row = rows.get(f"{section}.zone.NAME.{key}" if zone else name)
        if row is None:
            wrong(place, f"{shown(name)[1:-1]}: not what a {kind} can set; {nearest(name, rows)}")
        else:
            put(place, name, row, value, values)
    if {"wind.shape_coefficient", "wind.sectors"} <= set(values):
        wrong(place, "wind.shape_coefficient and wind.sectors exclude each other; keep one of the two")
    return values


def _flat(table: dict, place: str = "") -> dict:
    """The values of nested tables by their names with dots: as `load.snow` without quotes is read."""
    found = {}
    for name, value in table.items():
        found |= _flat(value, f"{place}{name}.") if isinstance(value, dict) else {place + name: value}
    return found


def blows(case: SimpleNamespace) -> bool:
    """Whether a static wind acts in a case."""
    return any(name.startswith("wind.") for name in case.set)


def static_wind(wind: SimpleNamespace, case: SimpleNamespace) -> SimpleNamespace:
    """[wind] with what a case sets, for a mean wind; wind : the section, or its defaults."""
    found = with_set(SimpleNamespace(**(vars(wind) | {"pressure_factor": 1.0})), "wind", case)
    found.file = found.points = found.pressures = found.taps = None
    if "wind.shape_coefficient" in case.set:
        found.sectors = None
    if "wind.sectors" in case.set:
        found.shape_coefficient = None
    return found


def wrong_cases(cases: list, wind: SimpleNamespace):
    """Place and what is wrong, of cases whose `set` is checked; wind : [wind], or its defaults."""
    for case in cases:
        place = f"[[case]] {case.name}:"
        if case.name in OF_LOAD:
            yield place, f"name: {shown(case.name)} is what a factor of [[combination]] means; take another"
        if not case.set and case.pressure_table is None and not case.settlement:
            yield place, "set, pressure_table or settlement: missing; say what acts in it"
        if case.factor is not None and case.pressure_table is None:
            what = "only with pressure_table, whose values it multiplies; add it or remove factor"
            yield place, f"factor: {what}"
        if blows(case):
            acting = static_wind(wind, case)
            if acting.speed is None:
                yield place, "set: wind.speed: missing; expected a number of m/s > 0 here or in [wind]"
            if acting.shape_coefficient is None and acting.sectors is None:
                expected = "expected it, or wind.sectors, here or in [wind]"
                yield place, f"set: wind.shape_coefficient: missing; {expected}"


def wrong_combinations(combinations: list, cases: list):
    """Place and what is wrong, of the entries of [[combination]]."""
    names = [case.name for case in cases if case.name is not None]
    for each in combinations:
        place, factors = f"[[combination]] {each.name}:", each.factors or {}
        if each.name in names or each.name in OF_LOAD:
            what = "a case" if each.name in names else "a factor"
            yield place, f"name: {shown(each.name)} is the name of {what} already; names are unique"
        for name in factors:
            if name not in names and name not in OF_LOAD:
                known = [*OF_LOAD, *names]
                yield place, f"factors: {shown(name)[1:-1]}: no case bears this name; {nearest(name, known)}"
        if factors.get("prestress", 1.0) < 0.0:
            yield place, f"factors: prestress = {factors['prestress']:g}: expected a number >= 0"


def factor_of(combination: SimpleNamespace, name: str) -> float:
    """The factor of an action: as given, else 1 of permanent and prestress, 0 of all others."""
    default = 1.0 if name in ("permanent", "prestress") else 0.0
    return float(combination.factors.get(name, default))
