"""Names of the job file that version 0.5 changed. The old ones are accepted, each with a warning.

Every reader of a job renames its tables by these rules first: the job file, --set, `set` of cases and stages,
and the keys that a study varies. All other code knows the new names alone.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

from netfall.job import messages
from netfall.job.keys.entries import flatten_settings, split
from netfall.job.keys.schema import GENERATOR_KEYS, LIST_KEYS
from netfall.job.values import SINCE, format_value

GROUP_RULE = "cable.GROUP"  # [cable.GROUP] is [group.GROUP]
DIMENSION_RULE = "net.DIMENSION"  # dimensions in [net] are in [net.GENERATOR]
# Old and new names as --set has them. Keys of [cable] stand in groups too, keys of [load] and [wind] in zones
# and in `set`.
RENAMED_KEYS = {
    "cable.expansion": "cable.thermal_expansion",
    "cable.strain": "cable.strain_measure",
    "cable.strength_deviation": "cable.strength_cov",
    "cable.length_deviation": "cable.length_std",
    "load.air_mass": "load.added_mass",
    "load.breaking": "load.stop_at_strength",
    "wind.shape_coefficient": "wind.pressure_coefficient",
    "wind.turbulence": "wind.turbulence_intensity",
    "wind.roughness": "wind.surface_drag",
    "wind.gusts": "wind.gust_field",
    "wind.air_damping": "wind.aerodynamic_damping",
    "dynamics.damping": "dynamics.mass_damping",
    "dynamics.damping_ratio": "dynamics.axial_damping_ratio",
    "dynamics.damping_band": "dynamics.axial_damping_band",
    "output.history": "output.history_interval",
    "output.checkpoint": "output.checkpoint_interval",
    "output.modes": "modes.count",
    "slide.resistance": "slide.slip_resistance",
    "target.by": "target.adjust",
}
RENAMED_VALUES = {  # by the new name of the key: new values by old ones
    "form_finding.method": {"keep": "given_geometry"},
    "wind.gust_field": {"means": "area_mean", "points": "point"},
    "combination.kind": {"ultimate": "ULS", "service": "SLS"},
}
# Removed keys: the value that is still accepted with a warning, and the reason for the removal.
REMOVED_KEYS = {"dynamics.precision": ("double", "numbers have double precision (jobs/trade/README.md)")}

Path = tuple[str, ...]  # of a key: ("wind", "zone", "edge", "speed")


class Change(NamedTuple):
    """Change of a key by a rule: of its path, or of its value if `values` has the old and the new text.

    new : empty for a removed key
    """

    rule: str
    old: Path
    new: Path
    values: tuple[str, str] | None = None


def rename_setting(path: Path, value: Any, generator: str) -> tuple[Path, Any, list[Change]]:
    """Return the new path and value of a key, and the changes; the path of a removed key is empty.

    generator : of the net, for its dimensions
    """
    changes, given = [], path
    if path[0] == "cable" and (len(path) > 2 or (len(path) == 2 and value == {})):
        changes.append(Change(GROUP_RULE, path, ("group", *path[1:])))
    elif path[0] == "net" and len(path) == 2 and path[1] in GENERATOR_KEYS.get(generator, ()):
        changes.append(Change(DIMENSION_RULE, path, ("net", generator, path[1])))
    path = changes[0].new if changes else path
    rule = _rule_of(path)
    if rule in REMOVED_KEYS:
        return (), value, [Change(rule, given, ())]
    if rule in RENAMED_KEYS:
        section, _, key = RENAMED_KEYS[rule].partition(".")
        new = (*path[:-1], key) if rule.startswith(f"{section}.") else (section, key)
        changes.append(Change(rule, given, new))
        path = new
    new_values = RENAMED_VALUES.get(_rule_of(path), {})
    items = value if isinstance(value, list) else [value]
    for item in [item for item in items if isinstance(item, str) and item in new_values]:
        texts = format_value(item), format_value(new_values[item])
        changes.append(Change(f"{_rule_of(path)} = {item}", given, path, texts))
        items = [new_values[item] if other == item else other for other in items]
    return path, items if isinstance(value, list) else items[0], changes


def _rule_of(path: Path) -> str:
    """Return the name of a key in the rules; a key of a zone or group has that of its section."""
    if path[0] in ("group", "combinations") and len(path) == 3:
        return f"{'cable' if path[0] == 'group' else 'combination'}.{path[2]}"
    in_zone = len(path) == 4 and path[1] == "zone"
    return f"{path[0]}.{path[-1]}" if len(path) == 2 or in_zone else ""


class Renaming:
    """Renaming of the keys of one file, with its warnings.

    where : name of the file, for messages; errors : receives a line for each error
    """

    def __init__(self, where: str, errors: list[str]):
        self.where, self.errors = where, errors
        self.generator = ""  # of the net
        self.places: dict[str, list[tuple[str, str]]] = {}  # by rule: old and new texts

    def set_generator(self, name: object) -> None:
        """Set the generator whose dimensions [net] has. name : as given, whatever it is"""
        self.generator = name if isinstance(name, str) else ""

    def rename_tables(self, data: dict[str, Any]) -> None:
        """Rename the keys of a job's tables in place, and note a warning for each; after `set_generator`."""
        given = dict(data)
        data.clear()
        data.update({name: {} if isinstance(value, dict) else value for name, value in given.items()})
        for path, value in self._renamed(_leaves(given), _section_text).items():
            if path[0] in LIST_KEYS and isinstance(value, list):
                value = [self._entry(path[0], entry) if isinstance(entry, dict) else entry for entry in value]
            _insert(data, path, value)

    def _entry(self, name: str, entry: dict[str, Any]) -> dict[str, Any]:
        """Return an entry of a list of tables, renamed."""
        items = (((name, key), value) for key, value in entry.items())
        result = {path[-1]: value for path, value in self._renamed(items, _entry_text).items()}
        if name in ("case", "stage") and isinstance(result.get("set"), dict):
            result["set"] = self.rename_settings(flatten_settings(result["set"]), f"[[{name}]] set:")
        return result

    def rename_overrides(self, settings: dict[Path, Any]) -> dict[Path, Any]:
        """Return the paths and values of --set, renamed."""
        return self._renamed(settings.items(), lambda path: f"--set {'.'.join(path)}")

    def rename_settings(self, table: dict[str, Any], place: str) -> dict[str, Any]:
        """Return a table of values by dotted names, renamed. place : of the table, for messages"""
        items = ((_split(name), value) for name, value in table.items())
        renamed = self._renamed(items, lambda path: f"{place} {'.'.join(path)}")
        return {".".join(path): value for path, value in renamed.items()}

    def _renamed(self, items: Iterable[tuple[Path, Any]], text: Callable[[Path], str]) -> dict[Path, Any]:
        """Return the renamed paths and values of keys. text : function that names a path in messages"""
        result: dict[Path, Any] = {}
        given_as: dict[Path, Path] = {}
        for old, value in items:
            if self._is_foreign_dimension(old, value, text):
                continue
            path, new_value, changes = rename_setting(old, value, self.generator)
            of_table = len(changes) > 1 and changes[0].rule == GROUP_RULE and text is not _section_text
            for change in changes[of_table:]:  # a dotted name changes once
                self._note(change, text)
            if changes and changes[-1].rule in REMOVED_KEYS:
                accepted, reason = REMOVED_KEYS[changes[-1].rule]
                if value != accepted:
                    key, shown = text(old), format_value(value)
                    self._wrong(messages.REMOVED_VALUE(key=key, value=shown, since=SINCE, reason=reason))
            elif path in result:
                self._wrong(messages.TWO_NAMES(old=text(given_as[path]), new=text(old)))
            else:
                result[path], given_as[path] = new_value, old
        return result

    def _is_foreign_dimension(self, path: Path, value: object, text: Callable[[Path], str]) -> bool:
        """Tell whether a key of [net] is a dimension of other generators, which is an error."""
        owners = [name for name, keys in GENERATOR_KEYS.items() if path[-1] in keys]
        if path[0] != "net" or len(path) != 2 or not owners or self.generator in owners:
            return False
        if self.generator in ("", *GENERATOR_KEYS):
            generators = " or ".join(map(format_value, owners))
            key, shown = text(path), format_value(value)
            self._wrong(messages.OTHER_GENERATOR(key=key, value=shown, generators=generators))
        return True

    def _wrong(self, what: str) -> None:
        """Append an error."""
        self.errors.append(f"{self.where}: {what}")

    def _note(self, change: Change, text: Callable[[Path], str]) -> None:
        """Remember a change for the warnings. text : function that names a path in messages"""
        rule, old, new, values = change
        if not new:
            names = text(old), ""
        elif values:
            names = f"{text(old)} = {values[0]}", values[1]
        elif rule == GROUP_RULE and text is _section_text:
            names = f"[{'.'.join(old[:2])}]", f"[{'.'.join(new[:2])}]"
        elif text is not _section_text and text is not _entry_text:
            names = text(old), ".".join(new)
        else:
            names = text(old), new[-1] if old[:-1] == new[:-1] else _section_text(new)
        places = self.places.setdefault(rule + old[-1] * (rule == DIMENSION_RULE), [])
        if names not in places:
            places.append(names)

    def warnings(self) -> list[str]:
        """Return a warning for each old name, with its first place and the number of others."""
        lines = []
        for rule, places in self.places.items():
            (old, new), others = places[0], len(places) - 1
            more = f" (and {others} more)" if others else ""
            if rule in REMOVED_KEYS:
                reason = REMOVED_KEYS[rule][1]
                line = messages.REMOVED_KEY(path=self.where, old=old, more=more, since=SINCE, reason=reason)
            else:
                line = messages.RENAMED_KEY(path=self.where, old=old, more=more, since=SINCE, new=new)
            lines.append(line)
        return lines


def _leaves(table: dict[str, Any], path: Path = ()) -> Iterator[tuple[Path, Any]]:
    """Yield the path and value of each key in nested tables; an empty table is a value."""
    for name, value in table.items():
        if isinstance(value, dict) and value:
            yield from _leaves(value, (*path, name))
        else:
            yield (*path, name), value


def _insert(tables: dict[str, Any], path: Path, value: object) -> None:
    """Put a value into nested tables; a value in place of a table on its way stays."""
    for part in path[:-1]:
        tables = tables.setdefault(part, {})
        if not isinstance(tables, dict):
            return
    tables[path[-1]] = value if value != {} else tables.get(path[-1], {})


def _split(name: str) -> Path:
    """Return the path of a dotted name; the name of a zone may have dots."""
    section, zone, key = split(name)
    return (section, "zone", zone, key) if zone else tuple(name.split("."))


def _section_text(path: Path) -> str:
    """Return the name of a key of a section in messages: "[wind] speed"."""
    return f"[{'.'.join(path[:-1])}] {path[-1]}" if len(path) > 1 else path[0]


def _entry_text(path: Path) -> str:
    """Return the name of a key of a list of tables in messages: "[[zone]] cut"."""
    return f"[[{path[0]}]] {path[1]}"
