"""Validation of the tables of a job file: each key by its field, then the keys against each other."""

from typing import Any, TypeVar

from pydantic import ValidationError

from netfall.job import cases, messages
from netfall.job.consistency import combined_errors
from netfall.job.fields import Key, Section, inner_models, keys_of
from netfall.job.models import Group, Top
from netfall.job.schema import CASE_KEYS, GENERATORS, LIST_MODELS, MODELS, STAGE_KEYS
from netfall.job.units import UnitError, to_unit
from netfall.job.values import format_value, suggest

Model = TypeVar("Model", bound=Section)
KNOWN_SECTIONS = (*MODELS, "group", "combinations")
SETTABLE = {"case": CASE_KEYS, "stage": STAGE_KEYS}  # lists whose key `set` sets keys of sections


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
        given = {k: v for k, v in data.items() if isinstance(v, dict) and k not in LIST_MODELS}
        for name in given:
            if name == "" or name not in KNOWN_SECTIONS:
                suggestion = suggest(name, KNOWN_SECTIONS)
                self.wrong("", messages.UNKNOWN_SECTION(name=name, suggestion=suggestion))
        for name in KNOWN_SECTIONS:
            if name in data and name not in given:
                value = format_value(data[name])
                self.wrong("", messages.NOT_A_SECTION(name=name, value=value, section=name))
        known = {*given, *KNOWN_SECTIONS, *LIST_MODELS}
        scalars = {name: value for name, value in data.items() if name not in known}
        title = self.values("", keys_of(Top), scalars).get("title", "")
        for name in ("net", "cable"):
            if name not in data:
                self.wrong("", messages.MISSING_SECTION(name=name))
        sections: dict[str, Any] = dict.fromkeys(MODELS)
        for name in filter(MODELS.__contains__, given):
            table, dimensions = given[name], {}
            if name == "net":
                dimensions = self._dimensions(table)
                table = {key: value for key, value in table.items() if key not in GENERATORS}
            sections[name] = self.table(name, MODELS[name], table).replaced(**dimensions)
        groups = self._inner_tables("", "group", Group, given.get("group", {}))
        sections["output"] = sections["output"] or MODELS["output"]()
        lists = {
            f"{name}s": self.entries(name, model, data.get(name, [])) for name, model in LIST_MODELS.items()
        }
        for place, problem in combined_errors(given, sections, lists):
            self.wrong(place, problem)
        return {"title": title, "groups": groups} | sections | lists

    def _dimensions(self, net: dict[str, Any]) -> dict[str, Section]:
        """Return the dimensions of the chosen generator, [net.GENERATOR], by its name."""
        generator = net.get("generator")
        for name, table in [(name, net[name]) for name in GENERATORS if name in net]:
            if not isinstance(table, dict):
                value = format_value(table)
                self.wrong("net", messages.NOT_A_SECTION(name=name, value=value, section=f"net.{name}"))
            elif name != generator:
                self.wrong(f"net.{name}", messages.OTHER_DIMENSIONS(generator=format_value(name)))
                self.values(f"net.{name}", keys_of(GENERATORS[name]), table)
        if not isinstance(generator, str) or generator not in GENERATORS:
            return {}
        table = net.get(generator, {})
        model = GENERATORS[generator]
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
                settings = cases.read_settings(name, label, table["set"], SETTABLE[name], self)
                table = table | {"set": settings}
            entries.append(self.table(label, model, table))
            if isinstance(entry_name, str) and first_entry.setdefault(entry_name, number) != number:
                self.wrong(label, messages.DUPLICATE_ENTRY(first=first_entry[entry_name]))
        return entries

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
                shown = format_value(name)[1:-1]
                self.wrong(place, messages.UNKNOWN_KEY(name=shown, suggestion=suggest(name, keys)))
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
            shown, expected = format_value(value), key.expected()
            self.wrong(place, messages.INVALID_VALUE(name=name, value=shown, expected=expected))
