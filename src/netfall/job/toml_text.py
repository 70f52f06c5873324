"""Writing of a job as TOML, and the template of a job for `netfall init`, with every key and its comment."""

import json
import tomllib
from pathlib import Path
from typing import Any

from netfall.core.errors import InputError, raise_errors
from netfall.job import messages
from netfall.job.keys.fields import Key
from netfall.job.keys.schema import LIST_KEYS, TABLES


def toml_text(job: dict[str, Any]) -> str:
    """Return the text of a job file for nested dicts; a list of dicts gives entries, [[name]]."""
    plain = {name: value for name, value in job.items() if not _is_section(value)}
    lines = [_key_line(name, value) for name, value in plain.items()]
    for name, value in job.items():
        if isinstance(value, dict):
            lines += _section(toml_name(name), value)
        elif _is_section(value):
            for entry in value:
                lines += _section(toml_name(name), entry, "[[{}]]")
    return "\n".join(lines) + "\n"


def toml_value(value: Any, place: str = "") -> str:
    """Return a value in TOML. Numbers and arrays of numpy count as numbers and lists.

    Raises InputError for a value that a job file cannot hold, such as None; place : of it, for the message
    """
    if hasattr(value, "tolist"):  # numbers and arrays of numpy, without importing numpy
        value = value.tolist()
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml_value(item, place) for item in value) + "]"
    if isinstance(value, dict):
        inside = place.replace(" = ", ".")
        return "{" + ", ".join(_key_line(key, item, inside) for key, item in value.items()) + "}"
    if isinstance(value, str) or hasattr(value, "__fspath__"):
        return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
    raise InputError(messages.UNSUPPORTED_TYPE(place=place, value=value, type=type(value).__name__))


def _is_section(value: object) -> bool:
    """Return whether a value is a section, or a list of entries."""
    entries = isinstance(value, list) and value != [] and all(isinstance(item, dict) for item in value)
    return isinstance(value, dict) or entries


def _section(name: str, table: dict[str, Any], head: str = "[{}]") -> list[str]:
    """Return the lines of a table: its own values, then its inner tables; those of an entry in one line."""
    entry = head != "[{}]"
    inner = {} if entry else {key: value for key, value in table.items() if isinstance(value, dict)}
    own = [_key_line(key, value, f"{head.format(name)} ") for key, value in table.items() if key not in inner]
    lines = ["", head.format(name), *own]
    for key, value in inner.items():
        lines += _section(f"{name}.{toml_name(key)}", value)
    return lines


def _key_line(key: object, value: Any, place: str = "") -> str:
    """Return a key with its value; place : in the job, for a message."""
    return f"{toml_name(key)} = {toml_value(value, f'{place}{key} = ')}"


def toml_name(name: object) -> str:
    """Return a name as a key of TOML, quoted if necessary."""
    bare = str(name).replace("_", "").replace("-", "")
    return str(name) if bare.isascii() and bare.isalnum() else toml_value(str(name))


def parse_toml_or_word(text: str) -> Any:
    """Parse a text as a TOML value; otherwise return the text, a word without quotes."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, KeyError):
        return text


# Active sections and the keys that they set; all other keys are comments.
ACTIVE_KEYS: dict[str, dict[str, object]] = {
    "": {"title": "A roof"},
    "net": {"generator": "saddle"},
    "net.saddle": {"side": 40.0, "rise": 4.0, "cells": 10},
    "cable": {"modulus": 1.6e11, "area": 400e-6, "density": 7850.0, "prestress": 60e3},
    "form_finding": {},
    "load": {"self_weight": True, "dead": 300.0, "snow": 500.0, "steps": 5},
}
EXAMPLE_VALUES: dict[str, object] = {"name": "edge", "duration": 6.0}  # for keys without a default
HEAD = """\
# A new job: a generated net, its form, and a static load. SI units.
#
#   netfall check {name}        sizes, time steps and expected run time
#   netfall run {name}
#
# An absent section disables its feature. Lines that begin with # show the default of a key, or that it has
# none. To change a key, remove the # in front of it and in front of its section.
# For your own net replace the generator in [net] by nodes = "nodes.csv", elements = "elements.csv", or use
# netfall import. [group.NAME] overrides [cable] for the elements of a group.
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
    for section, keys in (TABLES | LIST_KEYS).items():
        mark = "" if section in ACTIVE_KEYS else "# "  # a section without set keys is a comment
        head = f"[[{section}]]" if section in LIST_KEYS else f"[{section}]"
        lines += [mark + head] if section else []
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
        meaning += " (required)"
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
