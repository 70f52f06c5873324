"""Checking the tables of a job file against the schema, and against one another."""

import difflib
import json
import math
from types import SimpleNamespace

from netfall.job.schema import GENERATOR_KEYS, GROUP_KEYS, REQUIRED, SECTIONS, Key


def shown(value) -> str:
    """A value as it would stand in the job file, cut to a readable length."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, str):
        text = json.dumps(value, ensure_ascii=False)
    else:
        text = repr(value)
    text = " ".join(text.split())
    return text if len(text) <= 80 else text[:77] + "..."


def nearest(word: str, known) -> str:
    """Advice that names the nearest known word, or all of them."""
    known = sorted(known)
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f'did you mean "{close[0]}"?' if close else "known: " + ", ".join(known)


def _is_number(value) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def fits(key: Key, value) -> bool:
    """Whether a value is what the key's row of the table allows."""
    if key.kind == "text":
        return isinstance(value, str) and (value != "" or key.name == "title") and "\x00" not in value
    if key.kind == "choice":
        return isinstance(value, str) and value in key.choices
    if key.kind == "flag":
        return isinstance(value, bool)
    if key.kind == "points":
        return isinstance(value, list) and all(
            isinstance(p, list) and len(p) == 2 and all(map(_is_number, p)) for p in value
        )
    if key.kind == "words":
        return isinstance(value, list) and value != [] and all(isinstance(v, str) and v for v in value)
    if key.kind == "pressure" and _is_number(value):
        return True
    if key.kind in ("vector", "pressure"):
        return (
            isinstance(value, list)
            and len(value) == 3
            and all(_is_number(v) and _in_range(key, v) for v in value)
        )
    if value in key.also:
        return True
    if key.kind == "integer" and not isinstance(value, int):
        return False
    return _is_number(value) and _in_range(key, value)


def _in_range(key: Key, value) -> bool:
    above = key.low is None or value > key.low or (value == key.low and not key.low_open)
    below = key.high is None or value < key.high or (value == key.high and not key.high_open)
    return above and below


class Validation:
    """Checks a job's tables, and notes a line for each error in `errors`."""

    def __init__(self, where: str, errors: list[str]):
        """where : the file, for the messages"""
        self.where = where
        self.errors = errors

    def wrong(self, section: str, what: str) -> None:
        """Note an error."""
        place = f"[{section}] " if section else ""
        self.errors.append(f"{self.where}: {place}{what}")

    def sections(self, data: dict) -> dict:
        """The title, each section as a namespace of its keys or None where it is absent, groups as dicts."""
        given = {name: data[name] for name in data if isinstance(data[name], dict)}
        self._names(data, given)
        top = self._section("", {k: v for k, v in data.items() if k not in given and k not in SECTIONS})
        for name in ("net", "cable"):
            if name not in data:
                self.wrong("", f"[{name}]: the section is missing; a job needs it")
        cable = given.get("cable", {})
        groups = {k: v for k, v in cable.items() if isinstance(v, dict)}
        known = [name for name in given if name in SECTIONS and name != "cable"]
        found = {name: self._section(name, given[name]) for name in known}
        if "cable" in given:
            found["cable"] = self._section("cable", {k: v for k, v in cable.items() if k not in groups})
        groups = {name: self._group(name, table) for name, table in groups.items()}
        output = found.get("output") or self._section("output", {})
        self._combinations(given, found)
        every = {name: found.get(name) for name in SECTIONS if name}
        return every | {"title": top.title, "groups": groups, "output": output}

    def _names(self, data: dict, given: dict) -> None:
        """The names of the sections."""
        for name in given:
            if name not in SECTIONS:
                self.wrong("", f"[{name}]: unknown section; {nearest(name, filter(None, SECTIONS))}")
        for name in SECTIONS:
            if name and name in data and name not in given:
                self.wrong("", f"{name} = {shown(data[name])}: expected a section, [{name}]")

    def _section(self, name: str, table: dict) -> SimpleNamespace:
        keys = {key.name: key for key in SECTIONS[name]}
        values = {key.name: key.default for key in SECTIONS[name]}
        self._check(name, keys, table, values)
        for key in keys.values():
            if key.default is REQUIRED and key.name not in table:
                self.wrong(name, f"{key.name}: missing; expected {key.expected()}")
        return SimpleNamespace(**values)

    def _group(self, name: str, table: dict) -> dict:
        values: dict = {}
        self._check(f"cable.{name}", {key.name: key for key in GROUP_KEYS}, table, values)
        return values

    def _check(self, section: str, keys: dict[str, Key], table: dict, values: dict) -> None:
        for name, value in table.items():
            if name not in keys:
                self.wrong(section, f"{shown(name)[1:-1]}: unknown key; {nearest(name, keys)}")
            elif not fits(keys[name], value):
                self.wrong(section, f"{name} = {shown(value)}: expected {keys[name].expected()}")
            else:
                number = keys[name].kind == "number" and not isinstance(value, str)
                values[name] = float(value) if number else value

    # --- what depends on more than one key; `given` : tables as they stand, `found` : checked sections

    def _combinations(self, given: dict, found: dict) -> None:
        if "net" in given:
            self._source_of_the_net(given["net"])
            self._dimensions(given["net"])
        if "wind" in given:
            self._source_of_the_wind(given["wind"])
        self._mass_scaling(given, found)
        if "wind" in given and "dynamics" not in given:
            self.wrong("wind", "there is no [dynamics] that the wind could act in; add it or remove [wind]")
        self._prestress(given, found)

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
            expected = 'generator = "saddle" or "stadium", or nodes and elements'
            self.wrong("net", f"generator: missing; expected {expected}")
        if net.get("unit", "m") != "m" and not tables:
            self.wrong("net", f"unit = {shown(net['unit'])}: only for tables; dimensions are in m")

    def _dimensions(self, net: dict) -> None:
        """Dimensions of a generator that is not the net's."""
        tables = "nodes" in net or "elements" in net
        generator = net.get("generator")
        if not tables and not (isinstance(generator, str) and generator in GENERATOR_KEYS):
            return
        own = () if tables else GENERATOR_KEYS[generator]
        for other, names in GENERATOR_KEYS.items():
            for name in names:
                if name in net and name not in own:
                    only = f'only for generator = "{other}"; remove it'
                    self.wrong("net", f"{name} = {shown(net[name])}: {only}")

    def _source_of_the_wind(self, wind: dict) -> None:
        if "speed" in wind and "file" in wind:
            self.wrong("wind", "speed and file exclude each other; keep one of the two")
        elif "speed" not in wind and "file" not in wind:
            expected = "a number of m/s > 0, or file = a table of time, speed"
            self.wrong("wind", f"speed: missing; expected {expected}")
        if "roughness" in wind and "turbulence" in wind:
            self.wrong(
                "wind",
                "roughness and turbulence exclude each other (k = I^2 / 6); keep one of the two",
            )
        if "points" in wind and "file" not in wind:
            self.wrong("wind", "points: only with file, whose speeds were measured there; add it")

    def _mass_scaling(self, given: dict, found: dict) -> None:
        moves, cable = found.get("dynamics"), given.get("cable", {})
        tables = [table for table in (cable, *cable.values()) if isinstance(table, dict)]
        breaks = any("fracture_strain" in table for table in tables)
        if moves is not None and moves.mass_scaling and moves.fragments and breaks:
            self.wrong(
                "dynamics",
                f"mass_scaling = {shown(moves.mass_scaling)}: a fragment would take the added inertia along "
                "as mass; allowed with fragments = false, or where nothing can break",
            )

    def _prestress(self, given: dict, found: dict) -> None:
        relaxes = "form_finding" in given and given["form_finding"].get("method", "fpm") == "fpm"
        if not relaxes or "cable" not in found:
            return
        of_groups = (table for table in given["cable"].values() if isinstance(table, dict))
        taut = found["cable"].prestress or any("prestress" in table for table in of_groups)
        if not taut and not given.get("net", {}).get("elements"):
            self.wrong(
                "cable",
                "prestress: missing or 0; form finding needs the tension to find the form with, "
                "a number of N > 0",
            )
