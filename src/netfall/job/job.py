"""Validated job: its sections and the files that it names."""

import hashlib
import json
import tomllib
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

from netfall.core.errors import InputError
from netfall.job.entries import Case, Combination, Motion, Remove, Slide, Stage, Target, Zone
from netfall.job.models import Cable, Dynamics, FormFinding, Group, Limits, Load, Net, Output, Roof, Wind
from netfall.job.schema import LIST_KEYS, SECTIONS
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
    cable: Cable
    groups: dict[str, Group]  # [cable.GROUP]: the keys that it overrides
    form_finding: FormFinding | None
    load: Load | None
    roof: Roof | None
    wind: Wind | None
    dynamics: Dynamics | None
    output: Output
    zones: list[Zone]  # [[zone]], in order
    limits: Limits | None
    cases: list[Case]  # [[case]]
    combinations: list[Combination]  # [[combination]]
    motions: list[Motion]  # [[motion]]
    slides: list[Slide]  # [[slide]]
    removes: list[Remove]  # [[remove]]
    targets: list[Target]  # [[target]]
    stages: list[Stage]  # [[stage]]

    @property
    def name(self) -> str:
        """Name of the job file without its extension."""
        return self.path.stem

    def files(self) -> list[Path]:
        """Return the files that the job reads, from all keys that are paths: net, cables, loads, wind."""
        names = [getattr(getattr(self, section), key, None) for section, key in PATH_KEYS]
        names += [case.pressure_table for case in self.cases]
        names += [case.set.get("wind.sectors") for case in self.cases]
        entries = [(entry, key) for key in MOTION_PATH_KEYS for entry in self.motions]
        names += [getattr(entry, key) for entry, key in entries]
        return [self.path.parent / name for name in names if name]

    @cached_property
    def contents(self) -> list[bytes]:
        """Fingerprints of `files`, computed at the first access.

        Raises InputError for a file that cannot be read.
        """
        digests = []
        for path in self.files():
            try:
                digests.append(hashlib.sha256(path.read_bytes()).digest())
            except OSError as error:
                raise InputError(
                    f"{path}: {error.strerror or error}; paths are relative to the job file"
                ) from None
        return digests

    def digest(self) -> str:
        """Compute a fingerprint of the job file, the values after overrides, and the files that it reads.

        Raises InputError for a file that cannot be read.
        """
        # Without the location of the file, and without overrides, whose values are in the sections.
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        del values["path"], values["overrides"]
        total = hashlib.sha256(json.dumps(values, default=dict, sort_keys=True).encode())
        for content in self.contents:
            total.update(content)
        return total.hexdigest()

    def given(self) -> set[str]:
        """Return the keys that the job file or an override gives, as "section.key"."""
        data = parse_tables(self.text, self.overrides)
        tables = {name: table for name, table in data.items() if isinstance(table, dict)}
        return {f"{name}.{key}" for name, table in tables.items() for key in table}

    def group_properties(self, name: str) -> Cable:
        """Return [cable] with the keys that a group overrides."""
        return self.cable.replaced(**self.groups[name].given()) if name in self.groups else self.cable

    def loads(self, key: str) -> list:
        """Return every value of a key of [load]: in the section, in zones and in cases."""
        return self.values("load", key)

    def values(self, name: str, key: str) -> list:
        """Return every value of a key of a section with zones: in the section, zones, cases and stages."""
        section = getattr(self, name)
        return (section.all_values(key) if section else []) + [
            value
            for entry in [*self.cases, *self.stages]
            for path, value in entry.set.items()
            if path.startswith(f"{name}.") and path.endswith(f".{key}")
        ]

    def changes_net(self) -> bool:
        """Tell whether an override changes the net, so that files made for the job's own net do not apply."""
        return any(o.startswith("net.") for o in self.overrides)


def parse_tables(text: str, overrides) -> dict:
    """Parse the text of a job, with overrides that are known to be valid."""
    data = tomllib.loads(text)
    apply_overrides(data, list(overrides), [])
    return data


def apply_overrides(data: dict, overrides: list[str], errors: list[str]) -> None:
    """Put the values of --set into the tables of a job; append an error for each invalid one."""
    for override in overrides:
        name, equals, value = override.partition("=")
        *section, key = [part.strip() for part in name.split(".")]
        if not equals or not key or (not section and key != "title"):
            errors.append(f"--set {override}: expected SECTION.KEY=VALUE, for example wind.speed=45")
            continue
        table = data
        for part in section:
            table = table.setdefault(part, {})
            if not isinstance(table, dict):
                kind = f"a list, [[{part}]], which --set does not reach" if part in LIST_KEYS else "a key"
                errors.append(f"--set {override}: {part} is {kind}, not a section")
                break
        else:
            table[key] = parse_toml_or_word(value.strip())
