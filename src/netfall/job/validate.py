"""Checking the tables of a job file against the schema, and against one another."""

from collections.abc import Sequence
from types import SimpleNamespace

from netfall.job import cases
from netfall.job.entries import LISTS, LOST
from netfall.job.keys import REQUIRED, Key
from netfall.job.schema import (
    EITHER,
    GENERATOR_KEYS,
    IN_CASES,
    IN_STAGES,
    NEEDED,
    OVERRIDES,
    REMOVED,
    SECTIONS,
    SINCE,
    defaults,
    may_break,
    row_of,
)
from netfall.job.values import nearest, shown


class Validation:
    """Checks a job's tables, and notes a line for each error in `errors`."""

    def __init__(self, where: str, errors: list[str]):
        """where : the file, for the messages"""
        self.where = where
        self.errors = errors

    def wrong(self, section: str, what: str) -> None:
        """Note an error. section : its name, or a place in brackets as it stands"""
        place = section if section.startswith("[") else f"[{section}]"
        self.errors.append(f"{self.where}: {place + ' ' if section else ''}{what}")

    def sections(self, data: dict) -> dict:
        """The fields of a job: the title, sections, groups as dicts, entries of lists as namespaces.

        A section is a namespace of its keys, or None where it is absent. `zone` of one that has zones is a
        dict of what each overrides.
        """
        given = {k: v for k, v in data.items() if isinstance(v, dict) and k not in LISTS}
        self._names(data, given)
        loose = {k: v for k, v in data.items() if k not in given and k not in SECTIONS and k not in LISTS}
        title = self.table("", SECTIONS[""], loose).title
        for name in ("net", "cable"):
            if name not in data:
                self.wrong("", f"[{name}]: the section is missing; a job needs it")
        found, groups = dict.fromkeys(filter(None, SECTIONS)), {}
        for name in filter(found.__contains__, given):
            own, within = self._overrides(name, given[name])
            found[name] = self.table(name, SECTIONS[name], own)
            if name == "cable":
                groups = within
            elif name in OVERRIDES:
                found[name].zone = within
        found["output"] = found["output"] or self.table("output", SECTIONS["output"], {})
        lists = {f"{name}s": self.entries(name, keys, data.get(name, [])) for name, keys in LISTS.items()}
        self._combinations(given, found, lists)
        return found | lists | {"title": title, "groups": groups}

    def _names(self, data: dict, given: dict) -> None:
        """The names of the sections."""
        for name in given:
            if name == "" or name not in SECTIONS:
                self.wrong("", f"[{name}]: unknown section; {nearest(name, filter(None, SECTIONS))}")
        for name in SECTIONS:
            if name and name in data and name not in given:
                self.wrong("", f"{name} = {shown(data[name])}: expected a section, [{name}]")

    def _overrides(self, name: str, table: dict) -> tuple[dict, dict[str, dict]]:
        """What a section says of itself, and what the tables inside override, by their names."""
        if name not in OVERRIDES:
            return table, {}
        under, keys = OVERRIDES[name]
        inner = table.get(under, {}) if under else {k: v for k, v in table.items() if isinstance(v, dict)}
        own = {k: v for k, v in table.items() if k != under and (under or k not in inner)}
        place = f"{name}.{under}" if under else name
        if not isinstance(inner, dict) or not all(isinstance(v, dict) for v in inner.values()):
            self.wrong(name, f"{under} = {shown(inner)}: expected tables, [{place}.NAME]")
            return own, {}
        found: dict[str, dict] = {called: {} for called in inner}
        for called, values in inner.items():
            self._check(f"{place}.{called}", keys, values, found[called])
        return own, found

    def entries(self, name: str, keys: Sequence[Key], given) -> list[SimpleNamespace]:
        """The entries of a list of tables, whose names are unique."""
        if not isinstance(given, list) or not all(isinstance(table, dict) for table in given):
            self.wrong("", f"{name} = {shown(given)}: expected entries, [[{name}]], each with its keys")
            return []
        entries, places = [], {}
        for number, table in enumerate(given, 1):
            called = table.get("name")
            place = f"[[{name}]] {called if isinstance(called, str) and called else number}:"
            entries.append(self.table(place, keys, table))
            if isinstance(called, str) and places.setdefault(called, number) != number:
                self.wrong(place, f"name: stands in entry {places[called]} already; names are unique")
        return entries

    def table(self, place: str, keys: Sequence[Key], table: dict) -> SimpleNamespace:
        """The values of all keys, given or by default."""
        values = {key.name: None if key.default is REQUIRED else key.default for key in keys}
        self._check(place, keys, table, values)
        for key in keys:
            if key.default is REQUIRED and key.name not in table:
                self.wrong(place, f"{key.name}: missing; expected {key.expected()}")
        return SimpleNamespace(**values)

    def _check(self, place: str, keys: Sequence[Key], table: dict, values: dict) -> None:
        """Put what is given, and right, into `values`."""
        rows = {key.name: key for key in keys}
        for name, value in table.items():
            if name in REMOVED.get(place, {}):
                self._removed(place, name, value)
            elif name not in rows:
                self.wrong(place, f"{shown(name)[1:-1]}: unknown key; {nearest(name, rows)}")
            else:
                self._value(place, name, rows[name], value, values)

    def _removed(self, place: str, name: str, value) -> None:
        """Note an error for a removed key unless it has the value that changes nothing."""
        accepted, why = REMOVED[place][name]
        if value != accepted:
            self.wrong(place, f"{name} = {shown(value)}: removed in version {SINCE}, {why}; remove the key")

    def _value(self, place: str, name: str, key: Key, value, values: dict) -> None:
        if not key.fits(value):
            self.wrong(place, f"{name} = {shown(value)}: expected {key.expected()}")
        else:
            number = key.kind == "number" and not isinstance(value, str)
            values[name] = float(value) if number else value

    # --- what depends on more than one key; `given` : tables as they stand, `found` : checked sections

    def _combinations(self, given: dict, found: dict, lists: dict) -> None:
        if "net" in given:
            self._source_of_the_net(given["net"])
            self._dimensions(given["net"])
        if "wind" in given:
            self._source_of_the_wind(given["wind"], _may_detach(given, lists))
            self._coefficients_of_the_wind(given["wind"])
            self._gusts_of_the_wind(given["wind"])
        if "cable" in given:
            for place, what in wrong_combinations(given["cable"], "elements" in given.get("net", {})):
                self.wrong(place, what)
        if "wind" in given and "dynamics" not in given:
            self.wrong("wind", "there is no [dynamics] that the wind could act in; add it or remove [wind]")
        form, net = found["form_finding"], found["net"]
        if form and form.method == "keep" and form.loads == "permanent" and net and net.subdivide > 1:
            what = f"subdivide = {net.subdivide}: nodes between those given sag under permanent loads"
            self.wrong("net", f'{what}; with method = "keep" expected subdivide = 1, or loads = "none"')
        self._zones(lists)
        self._cases(found, lists)
        self._height_of_the_wind(given.get("wind", {}), found["wind"], lists["cases"])
        self._losses(given, found, lists)
        self._motions(given, lists["motions"])
        moves = given.get("dynamics", {})
        if ("damping_ratio" in moves) != ("damping_band" in moves):
            missing = "damping_band" if "damping_ratio" in moves else "damping_ratio"
            self.wrong("dynamics", f"{missing}: missing; a ratio and the band in which it holds go together")

    def _zones(self, lists: dict) -> None:
        for zone in lists["zones"]:
            if zone.polygon is not None and zone.groups is not None:
                place = f"[[zone]] {zone.name}:"
                self.wrong(place, "polygon and groups exclude each other; keep one of the two")
            if zone.cut and zone.polygon is None:
                self.wrong(f"[[zone]] {zone.name}:", "cut = true: only with polygon, which cuts; remove it")
        for stage in lists["stages"]:
            stage.set = cases.values_of_set(stage, IN_STAGES, self._value, self.wrong, "stage")
            if stage.clamps and not lists["slides"]:
                self.wrong(f"[[stage]] {stage.name}:", "clamps: nothing slips; add [[slide]], or remove it")
        for number, entry in enumerate(lists["slides"], 1):
            if (entry.group is None) == (entry.cables is None):
                what = "missing; say what slips" if entry.group is None else "exclude each other"
                self.wrong(f"[[slide]] {number}:", f"group or cables: {what}; expected one of the two")
        for number, target in enumerate(lists["targets"], 1):
            given = [key for key in ("group", "force", "node", "height") if getattr(target, key) is not None]
            if given not in (["group", "force"], ["node", "height"]):
                what = "expected group and force, or node and height; give one of these pairs"
                self.wrong(f"[[target]] {number}:", what)

    def _losses(self, given: dict, found: dict, lists: dict) -> None:
        for number, entry in enumerate(lists["removes"], 1):
            place, there = f"[[remove]] {number}:", [key for key in LOST if getattr(entry, key) is not None]
            if len(there) != 1:
                two = f"{' and '.join(there)} exclude each other; keep one of them"
                self.wrong(place, two if there else f"{' or '.join(LOST)}: missing; say what is lost")
        if lists["removes"] and "dynamics" not in given:
            self.wrong("[[remove]]", "there is no [dynamics] in which something could be lost; add it")
        if lists["removes"] and "wind" not in given and found["load"] and found["load"].ramp:
            self.wrong(
                "load", "ramp: a job with [[remove]] starts at rest under all loads; remove one of them"
            )

    def _cases(self, found: dict, lists: dict) -> None:
        wind = found["wind"] or defaults("wind")
        for case in lists["cases"]:
            case.set = cases.values_of_set(case, IN_CASES, self._value, self.wrong)
        for place, what in cases.wrong_cases(lists["cases"], wind):
            self.wrong(place, what)
        for place, what in cases.wrong_combinations(lists["combinations"], lists["cases"]):
            self.wrong(place, what)

    def _motions(self, given: dict, motions: list) -> None:
        for number, entry in enumerate(motions, 1):
            place, key = f"[[motion]] {number}:", "displacement" if entry.displacement else "acceleration"
            if (entry.displacement is None) == (entry.acceleration is None):
                what = "missing" if entry.displacement is None else "exclude each other"
                self.wrong(place, f"displacement or acceleration: {what}; expected one of the two")
            if entry.direction is not None and entry.displacement is not None:
                self.wrong(place, "direction: a displacement has x, y and z in its table; remove it")
            if is_record(entry) and entry.direction is None:
                self.wrong(place, "direction: missing; a record has one component: [x, y, z] of it")
            if entry.baseline is not None and not is_record(entry):
                self.wrong(place, "baseline: is of records (.AT2); a table is taken as it stands: remove it")
            if (entry.speed is None) != (entry.travel is None):
                missing = "travel" if entry.travel is None else "speed"
                self.wrong(place, f"{missing}: missing; a wave has a speed and a travel = [x, y, z]")
            for name in ("direction", "travel"):
                if getattr(entry, name) is not None and not any(getattr(entry, name)):
                    self.wrong(place, f"{name} = [0, 0, 0]: has no direction; expected another")
            if "dynamics" not in given:
                self.wrong(place, f"{key}: there is no [dynamics] in which supports could move; add it")

    def _source_of_the_net(self, net: dict) -> None:
        tables = "nodes" in net or "elements" in net
        if "generator" in net and tables:
            self.wrong(
                "net", "generator and tables (nodes, elements) exclude each other; keep one of the two"
            )
        elif tables and not ("nodes" in net and "elements" in net):
            missing = "elements" if "nodes" in net else "nodes"
            self.wrong("net", f"{missing}: missing; tables come as a pair, nodes and elements")
        elif "generator" not in net and not tables:
            names = ", ".join(map(shown, GENERATOR_KEYS))
            self.wrong("net", f"generator: missing; expected one of {names}, or nodes and elements")
        if net.get("unit", "m") != "m" and not tables:
            self.wrong("net", f"unit = {shown(net['unit'])}: only for tables; dimensions are in m")

    def _dimensions(self, net: dict) -> None:
        """Dimensions of a generator that is not the net's."""
        tables = "nodes" in net or "elements" in net
        generator = net.get("generator")
        if not tables and not (isinstance(generator, str) and generator in GENERATOR_KEYS):
            return
        own = () if tables else GENERATOR_KEYS[generator]
        for name in dict.fromkeys(name for names in GENERATOR_KEYS.values() for name in names):
            if name in net and name not in own:
                others = " or ".join(shown(other) for other, keys in GENERATOR_KEYS.items() if name in keys)
                self.wrong("net", f"{name} = {shown(net[name])}: only for generator = {others}; remove it")

    def _source_of_the_wind(self, wind: dict, detaches: bool) -> None:
        """detaches : whether parts may be cut free that the wind drags along"""
        sources = [key for key in ("speed", "file", "pressures") if key in wind]
        if sources == ["speed", "pressures"] and (_air_damping(wind) or detaches):
            pass  # damping and drag are for that mean speed
        elif sources == ["pressures"] and _air_damping(wind):
            self.wrong(
                "wind", "speed: missing; with pressures, air_damping needs the mean speed at 10 m, in m/s"
            )
        elif len(sources) > 1:
            self.wrong("wind", f"{' and '.join(sources)} exclude each other; keep one of them")
        elif not sources:
            expected = "a number of m/s > 0, or file = a table of time, speed"
            self.wrong("wind", f"speed: missing; expected {expected}, or pressures = one of time and taps")
        if ("pressures" in wind) != ("taps" in wind):
            missing = "taps" if "pressures" in wind else "pressures"
            self.wrong(
                "wind", f"{missing}: missing; pressures in time and the places of their taps go together"
            )
        if "points" in wind and "file" not in wind:
            self.wrong("wind", "points: only with file, whose speeds were measured there; add it")

    def _gusts_of_the_wind(self, wind: dict) -> None:
        """Check that a generated wind says how strong its gusts are, in one way."""
        given = [key for key in ("roughness", "turbulence") if key in wind]
        if len(given) == 2:
            self.wrong(
                "wind", "roughness and turbulence exclude each other (k = I^2 / 6); keep one of the two"
            )
        elif not given and _is_generated(wind):
            self.wrong(
                "wind",
                "turbulence: missing; expected the intensity of the gusts at 10 m (codes give 0.15 to 0.2 in "
                "open terrain; 0: no gusts), or roughness, k of Davenport's spectrum",
            )

    def _height_of_the_wind(self, wind: dict, found: SimpleNamespace | None, each: list) -> None:
        """Check that a generated or static wind on a profile says how high above ground z = 0 is.

        wind, found : [wind] as it stands, and with its defaults; each : case
        """
        if "base_height" in wind:
            return
        missing = (
            "base_height: missing; expected the height of z = 0 above ground in m (0 if z counts from the "
            "ground), or profile_exponent = 0 for the same speed at every height"
        )
        if _is_generated(wind) and found.profile_exponent > 0.0:
            self.wrong("wind", missing)
            return
        for case in filter(cases.blows, each):
            acting = cases.static_wind(found or defaults("wind"), case)
            if acting.profile_exponent > 0.0 and "wind.base_height" not in case.set:
                self.wrong(f"[[case]] {case.name}:", f"set: wind.{missing}")

    def _coefficients_of_the_wind(self, wind: dict) -> None:
        if "pressures" in wind:
            own = [key for key in ("shape_coefficient", "sectors") if key in wind]
            if any("shape_coefficient" in zone for zone in _zones(wind)):
                own.append("zone")
            if own:
                self.wrong("wind", f"{', '.join(own)}: pressures at taps need no coefficients; remove it")
        elif "shape_coefficient" in wind and "sectors" in wind:
            self.wrong("wind", "shape_coefficient and sectors exclude each other; keep one of the two")
        elif "shape_coefficient" not in wind and "sectors" not in wind:
            expected = "a number, or sectors = a table of them by the wind's direction"
            self.wrong("wind", f"shape_coefficient: missing; expected {expected}")


def is_record(motion: SimpleNamespace) -> bool:
    """Whether an entry of [[motion]] names a record of PEER's."""
    return bool(motion.acceleration) and motion.acceleration.lower().endswith(".at2")


def _zones(table: dict) -> list[dict]:
    """The tables of the zones of a section as it stands."""
    zones = table.get("zone")
    return [zone for zone in zones.values() if isinstance(zone, dict)] if isinstance(zones, dict) else []


def _is_generated(wind: dict) -> bool:
    """Whether [wind], as it stands, is a speed from which the wind is generated."""
    return "speed" in wind and "file" not in wind and "pressures" not in wind


def _air_damping(wind: dict) -> bool:
    """Whether [wind], as it stands, asks for air damping anywhere."""
    return any(table.get("air_damping") for table in (wind, *_zones(wind)))


def _may_detach(given: dict, lists: dict) -> bool:
    """Whether a job, as it stands, may cut parts free that the wind drags along."""
    cut = may_break(given.get("cable", {})) or bool(lists["removes"])
    return cut and given["wind"].get("after_fracture", "detached") == "detached"


def wanted(name: str) -> str:
    """What is said of a key that is missing."""
    key = row_of("cable", name)
    instead = next(other for other in NEEDED[name] if other != name)
    return f"{name}: missing; expected {key.expected()}, or {instead}, or a type of the catalogue"


def wrong_combinations(cable: dict, tables: bool):
    """Sections and what is wrong in them, of [cable] as it stands; tables : rows of a table may say more."""
    groups = {name: table for name, table in cable.items() if isinstance(table, dict)}
    everywhere = {f"cable.{name}": table for name, table in groups.items()} | {"cable": cable}
    for place, table in everywhere.items():
        for one, other in EITHER:
            if one in table and other in table:
                yield place, f"{one} and {other} exclude each other; keep one of the two"
        if "type" in table and "catalogue" not in cable:
            yield place, "type: needs the table that it stands in; add catalogue = a path to [cable]"
    given = {key for table in everywhere.values() for key in table}
    for name, other in NEEDED.items():
        if not tables and not given & {*other, "type"}:
            yield "cable", wanted(name)
