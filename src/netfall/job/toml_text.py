"""A job from a dict to the text of a job file: the standard library reads TOML, but does not write it."""

import json

from netfall.ground.errors import InputError


def toml_text(job: dict) -> str:
    """The text of a job file that says what nested dicts say; a list of dicts gives entries, [[name]]."""
    plain = {name: value for name, value in job.items() if not _is_section(value)}
    lines = [f"{toml_name(name)} = {toml_value(value)}" for name, value in plain.items() if value is not None]
    for name, value in job.items():
        if isinstance(value, dict):
            lines += _section(toml_name(name), value)
        elif _is_section(value):
            for entry in value:
                lines += _section(toml_name(name), entry, "[[{}]]")
    return "\n".join(lines) + "\n"


def toml_value(value) -> str:
    """A value as TOML writes it. Numbers of numpy and arrays count as numbers and lists; None is no value.

    Raises InputError for what a job file cannot hold.
    """
    if hasattr(value, "tolist"):  # numpy's numbers and arrays, without loading it here
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
    raise InputError(
        f"{value!r}: a {type(value).__name__} cannot stand in a job; expected a number, a text, "
        "true or false, or a list or dict of these"
    )


def _is_section(value) -> bool:
    entries = isinstance(value, list) and value != [] and all(isinstance(item, dict) for item in value)
    return isinstance(value, dict) or entries


def _section(name: str, table: dict, head: str = "[{}]") -> list[str]:
    """A table with its own values first, then those inside; within an entry these stand in one line."""
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


def toml_name(name) -> str:
    """A name as a key of TOML."""
    bare = str(name).replace("_", "").replace("-", "")
    return str(name) if bare.isascii() and bare.isalnum() else toml_value(str(name))
