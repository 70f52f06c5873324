"""Template of a job for `netfall init`, with every key and its comment from the table of keys."""

from pathlib import Path
from typing import Any

from netfall.core.errors import InputError, raise_errors
from netfall.job import messages
from netfall.job.fields import Key
from netfall.job.schema import LIST_KEYS, TABLES
from netfall.job.toml_text import toml_value

# Active sections and the keys that they set; all other keys are comments.
ACTIVE_KEYS: dict[str, dict[str, object]] = {
    "": {"title": "A roof"},
    "net": {"generator": "saddle"},
    "net.saddle": {"side": 40.0, "rise": 4.0, "cells": 10},
    "cable": {"modulus": 1.6e11, "area": 400e-6, "density": 7850.0, "prestress": 60e3},
    "form_finding": {},
    "load": {"dead": 300.0, "snow": 500.0, "steps": 5},
}
EXAMPLE_VALUES = {
    "name": "edge",
    "duration": 6.0,
    "set": {"load.snow": 750.0},
}  # for keys without a default
HEAD = """\
# A job to start from: a net from a generator, its form, and a static load. SI units.
#
#   netfall check {name}        what it is, and how long it takes
#   netfall run {name}
#
# A section that is absent is a thing that the scene does not have. What begins with # has the default that
# stands there, or none where it says so; take away the # of the section, and of the keys that are to differ.
# Your own net: nodes = "nodes.csv", elements = "elements.csv" in [net] in place of the generator, or netfall
# import. [group.NAME] overrides [cable] for the elements of a group.
"""
SCHEMA_FILE = "netfall.schema.json"  # in the folder of the job
SCHEMA_LINE = f"#:schema ./{SCHEMA_FILE}\n"  # with which editors find the schema
EXAMPLE_FOLDER = Path(__file__).parent / "examples"
COMMENT_COLUMN = 38  # start of the comments


def new_job(path: Path, example: str | None = None) -> str:
    """Return the text of a job for a new file: a template of all keys, or an example.

    Raises InputError if the file exists.
    """
    if path.exists():
        raise InputError(messages.FILE_EXISTS(path=path))
    if not path.parent.is_dir():
        raise InputError(messages.NO_FOLDER(path=path, folder=path.parent))
    if example:
        return SCHEMA_LINE + (EXAMPLE_FOLDER / f"{example}.toml").read_text(encoding="utf-8")
    return SCHEMA_LINE + template(path.name)


def example_tables(folder: Path, example: str | None) -> dict[Path, str]:
    """Return the tables of an example as text, by paths in a folder. Raises InputError if one exists."""
    tables = {folder / path.name: path for path in EXAMPLE_FOLDER.glob(f"{example}_*.csv")}
    raise_errors(messages.FILE_EXISTS(path=path) for path in tables if path.exists())
    return {target: path.read_text(encoding="utf-8") for target, path in tables.items()}


def template(name: str) -> str:
    """Return the text of the job, for the name of its file."""
    lines = [HEAD.format(name=name)]
    heads = {name: f"[{name}]" if name else "" for name in TABLES} | {
        name: f"[[{name}]]" for name in LIST_KEYS
    }
    for section, keys in (TABLES | LIST_KEYS).items():
        mark = "" if section in ACTIVE_KEYS else "# "  # a section without set keys is a comment
        lines += [mark + heads[section]] if section else []
        lines += [*(_line(key, ACTIVE_KEYS.get(section, {})) for key in keys), ""]
    return "\n".join(lines) + "\n"


def _line(key: Key, given: dict[str, Any]) -> str:
    """Return the line of a key: setting and comment."""
    meaning = f"{key.unit}, {key.meaning}" if key.unit else key.meaning
    if any(word not in meaning for word in key.choices):
        meaning += ": " + ", ".join(key.choices)
    if key.name in given:
        setting = f"{key.name} = {_value(given[key.name])}"
    elif key.required:
        example = f" {_value(EXAMPLE_VALUES[key.name])}" if key.name in EXAMPLE_VALUES else ""
        setting = f"# {key.name} ={example}"
        meaning += " (needed)"
    elif key.default is None:
        setting = f"# {key.name} ="
        meaning += "" if "absent" in meaning else " (absent)"
    else:
        setting = f"# {key.name} = {_value(key.default)}"
    return f"{setting:<{COMMENT_COLUMN}}# {meaning}"


def _value(value: object) -> str:
    """Return a value as a user would type it: 1.6e+11, 60000.0."""
    short = f"{value:.12g}" if isinstance(value, float) else ""
    return short if "e" in short else toml_value(value)
