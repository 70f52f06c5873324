"""Writing of a job as TOML, which the standard library reads but does not write."""

import json
import tomllib
from typing import Any

from netfall.core.errors import InputError
from netfall.job import messages


def toml_text(job: dict[str, Any]) -> str:
    """Return the text of a job file for nested dicts; a list of dicts gives entries, [[name]]."""
    plain = {name: value for name, value in job.items() if not _is_section(value)}
    lines = [f"{toml_name(name)} = {toml_value(value)}" for name, value in plain.items() if value is not None]
    for name, value in job.items():
        if isinstance(value, dict):
            lines += _section(toml_name(name), value)
        elif _is_section(value):
            for entry in value:
                lines += _section(toml_name(name), entry, "[[{}]]")
    return "\n".join(lines) + "\n"


def toml_value(value: Any) -> str:
    """Return a value in TOML. Numbers and arrays of numpy count as numbers and lists; None is no value.

    Raises InputError for a value that a job file cannot hold.
    """
    if hasattr(value, "tolist"):  # numbers and arrays of numpy, without importing numpy
        value = value.tolist()
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{toml_name(key)} = {toml_value(item)}" for key, item in value.items()) + "}"
    if isinstance(value, str) or hasattr(value, "__fspath__"):
        return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
    raise InputError(messages.UNSUPPORTED_TYPE(value=value, type=type(value).__name__))


def _is_section(value: object) -> bool:
    """Tell whether a value is a section, or a list of entries."""
    entries = isinstance(value, list) and value != [] and all(isinstance(item, dict) for item in value)
    return isinstance(value, dict) or entries


def _section(name: str, table: dict[str, Any], head: str = "[{}]") -> list[str]:
    """Return the lines of a table: its own values, then its inner tables; those of an entry in one line."""
    entry = head != "[{}]"
    inner = {} if entry else {key: value for key, value in table.items() if isinstance(value, dict)}
    own = [
        f"{toml_name(key)} = {toml_value(value)}"
        for key, value in table.items()
        if key not in inner and value is not None
    ]
    lines = ["", head.format(name), *own]
    for key, value in inner.items():
        lines += _section(f"{name}.{toml_name(key)}", value)
    return lines


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
