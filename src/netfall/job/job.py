"""Validated job: its sections and the files that it names."""

import hashlib
import json
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

from netfall.core.errors import InputError
from netfall.job import messages
from netfall.job.keys import entries, models
from netfall.job.keys.fields import Section
from netfall.job.keys.groups import group_values
from netfall.job.keys.net import Net
from netfall.job.keys.schema import LIST_KEYS, SECTIONS
from netfall.job.toml_text import parse_toml_or_word

PATH_KEYS = [(section, key.name) for section, keys in SECTIONS.items() for key in keys if key.kind == "path"]
MOTION_PATH_KEYS = [key.name for key in LIST_KEYS["motion"] if key.kind == "path"]


@dataclass(frozen=True)
class Job:
    """Validated job. A section is None if the job does not have it."""

    path: Path
    text: str  # the file as it stands
    overrides: tuple[str, ...]  # the --set of the command line
    title: str
    net: Net
    cable: models.Cable
    groups: dict[str, Section]  # [group.NAME]: the keys that it overrides; NAME may be a pattern
    form_finding: models.FormFinding | None
    load: models.Load | None
    roof: models.Roof | None
    wind: models.Wind | None
    dynamics: models.Dynamics | None
    output: models.Output
    modes: models.Modes | None
    zones: list[entries.Zone]  # [[zone]], in order
    limits: models.Limits | None
    cases: list[entries.Case]  # [[case]]
    combinations: list[entries.Combination]  # [[combination]]
    motions: list[entries.Motion]  # [[motion]]
    slides: list[entries.Slide]  # [[slide]]
    removes: list[entries.Remove]  # [[remove]]
    targets: list[entries.Target]  # [[target]]
    stages: list[entries.Stage]  # [[stage]]
    zone_rows: tuple[tuple[str, str], ...] = ()  # zones of load tables, and the place of each

    @property
    def name(self) -> str:
        """Name of the job file without its extension."""
        return self.path.stem

    def files(self) -> list[Path]:
        """Return the files that the job reads, from all keys that are paths: net, cables, loads, wind."""
        names = [getattr(getattr(self, section), key, None) for section, key in PATH_KEYS]
        names += [case.pressure_table for case in self.cases]
        names += [name for place, name in self.load_tables() if place != "[load]"]
        names += [case.set.get("wind.sectors") for case in self.cases]
        names += [getattr(motion, key) for key in MOTION_PATH_KEYS for motion in self.motions]
        return [self.path.parent / name for name in names if name]

    def load_tables(self) -> list[tuple[str, str]]:
        """Return the tables of loads, with the places that name them."""
        sections: list[tuple[str, Any]] = [("[load]", self.load)]
        sections += [(f"[[case]] {case.name}", case) for case in self.cases]
        sections += [(f"[[stage]] {stage.name}", stage) for stage in self.stages]
        return [
            (place, str(section.load_table))
            for place, section in sections
            if section and entries.has_table(section)
        ]

    @cached_property
    def contents(self) -> list[bytes]:
        """Fingerprints of `files`, computed at the first access.

        Raises InputError for a file that cannot be read.
        """
        return [hashlib.sha256(read_bytes(path)).digest() for path in self.files()]

    def digest(self) -> str:
        """Compute a fingerprint of the values of the job, after overrides, and of the files that it reads.

        Raises InputError for a file that cannot be read.
        """
        # Without the location and the text of the file and the overrides: their values are in the sections.
        ignored = ("path", "text", "overrides", "zone_rows")
        names = [field.name for field in fields(self) if field.name not in ignored]
        values = {name: getattr(self, name) for name in names}
        total = hashlib.sha256(json.dumps(values, default=dict, sort_keys=True).encode())
        for content in self.contents:
            total.update(content)
        return total.hexdigest()

    def given(self) -> set[str]:
        """Return the keys that the job file or an override gives, as "section.key"."""
        data = parse_tables(self.text, self.overrides)
        tables = {name: table for name, table in data.items() if isinstance(table, dict)}
        return {f"{name}.{key}" for name, table in tables.items() for key in table}

    def group_properties(self, name: str) -> models.Cable:
        """Return [cable] with the keys that [group.NAME] and patterns override."""
        return self.cable.replaced(**group_values(self.groups, name))

    def loads(self, key: str) -> list[Any]:
        """Return every value of a key of [load]: in the section, in zones and in cases."""
        return self.values("load", key)

    def values(self, name: str, key: str) -> list[Any]:
        """Return every value of a key of a section with zones: in the section, zones, cases and stages."""
        section = getattr(self, name)
        return (section.all_values(key) if section else []) + [
            value
            for settings in [entry.set for entry in self.cases] + [entry.set for entry in self.stages]
            for path, value in settings.items()
            if path.startswith(f"{name}.") and path.endswith(f".{key}")
        ]

    def changes_net(self) -> bool:
        """Return whether an override changes the net, so that files for the net of the job do not apply."""
        return any(o.startswith("net.") for o in self.overrides)


def read_bytes(path: Path) -> bytes:
    """Return the content of a file that a job names. Raises InputError."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(messages.UNREADABLE_FILE(path=path, reason=error.strerror or error)) from None


def parse_tables(text: str, overrides: Iterable[str]) -> dict[str, Any]:
    """Parse the text of a job, with overrides; both are known to be valid."""
    data = tomllib.loads(text)
    apply_overrides(data, list(overrides), "", [])
    return data


def apply_overrides(data: dict[str, Any], overrides: list[str], where: str, errors: list[str]) -> None:
    """Put the values of --set into the tables of a job, and what its lists share into their entries.

    Appends a line for each error. where : the file, for messages
    """
    for override in overrides:
        name, equals, value = override.partition("=")
        path = tuple(part.strip().strip('"') for part in name.split("."))
        if not equals or not path[-1] or (len(path) == 1 and path != ("title",)):
            errors.append(messages.INVALID_OVERRIDE(override=override))
        else:
            _put(data, path, parse_toml_or_word(value.strip()), errors)
    entries.expand_combinations(data, where, errors)
    entries.share_wind(data)


def _put(data: dict[str, Any], path: tuple[str, ...], value: object, errors: list[str]) -> None:
    """Put the value of an override into the tables of a job."""
    table = data
    for part in path[:-1]:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            error = messages.OVERRIDE_OF_LIST if part in LIST_KEYS else messages.OVERRIDE_OF_KEY
            errors.append(error(name=".".join(path), value=value, part=part))
            return
    table[path[-1]] = value
