"""Writing of a job as TOML, and the examples of `netfall init`."""

import json
import tomllib
from pathlib import Path
from typing import Any

from netfall.core.errors import InputError, raise_errors
from netfall.job import messages


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


SCHEMA_FILE = "netfall.schema.json"  # in the folder of the job
SCHEMA_LINE = f"#:schema ./{SCHEMA_FILE}\n"  # with which editors find the schema
EXAMPLE_FOLDER = Path(__file__).parent / "examples"


def new_job(path: Path, example: str) -> str:
    """Return the text of a job for a new file: an example. Raises InputError if the file exists."""
    if path.exists():
        raise InputError(messages.FILE_EXISTS(path=path))
    if not path.parent.is_dir():
        raise InputError(messages.NO_FOLDER(path=path, folder=path.parent))
    return SCHEMA_LINE + (EXAMPLE_FOLDER / f"{example}.toml").read_text(encoding="utf-8")


def example_tables(folder: Path, example: str) -> dict[Path, str]:
    """Return the tables of an example as text, by paths in a folder. Raises InputError if one exists."""
    tables = {folder / path.name: path for path in EXAMPLE_FOLDER.glob(f"{example}_*.csv")}
    raise_errors(messages.FILE_EXISTS(path=path) for path in tables if path.exists())
    return {target: path.read_text(encoding="utf-8") for target, path in tables.items()}
