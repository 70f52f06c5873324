"""Generated parts of the reference pages: keys, commands, datasets and the Python interface.

A part stands in a page between the marks `<!-- generated: NAME -->` and `<!-- end -->`. `PARTS` makes the
text of each NAME from the program. tests/pages.py writes them.
"""

import argparse
import inspect
import re
import textwrap
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from documentation_site import PAGES, PART

import netfall
from netfall.job.keys.fields import Key, keys_of
from netfall.job.keys.models import GLOBAL_CABLE_KEYS
from netfall.job.keys.schema import LIST_KEYS, TABLES, ZONE_KEYS
from netfall.post.report.markdown import plain_table

WIDTH = 108  # characters of a line
NOUNS = {  # value of a key, by its kind
    "number": "number",
    "integer": "integer",
    "flag": "`true`, `false`",
    "text": "text",
    "path": "path",
    "name": "name",
    "vector": "three numbers",
    "band": "two numbers, [low, high]",
    "pressure": "number, or three",
    "deflection": 'number, or `"span/250"`',
    "points": "list of [x, y]",
    "places": "list of [x, y], [x, y, z] or ids",
    "polygon": "list of [x, y]",
    "words": "list of names",
    "integers": "list of integers",
    "lengths": "table",
    "loads": 'table, `{"load.snow" = 750.0}`',
    "factors": "table, `{permanent = 1.35, NAME = 1.5}`",
    "moves": "table, `{17 = [0.0, 0.0, -0.05], ring = [0.0, 0.0, 1.5]}`",
    "supports": 'list of ids and names, or table, `{17 = "xy", ring = "z"}`',
    "shifts": "table, `{17 = [0.0, 0.0, -0.05]}`",
}


def table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """Return a table of Markdown."""
    return "\n".join(plain_table(head, rows))


# --- keys of a job file and of a study file


def takes(key: Key) -> str:
    """Describe the type of a key, or the words to choose from."""
    if key.kind == "choice":
        return ", ".join(f'`"{word}"`' for word in key.choices)
    return NOUNS[key.kind] + "".join(f', or `"{word}"`' for word in key.special_words)


def limits(key: Key) -> str:
    """Describe the range of a key's numbers: "> 0", "0 to 1"; empty if there is none."""
    low, high = key.low, key.high
    if low is None and high is None:
        return ""
    if high is None:
        return f"{'>' if key.low_open else '>='} {low:g}"
    if low is None:
        return f"<= {high:g}"
    above = f"> {low:g}, up to" if key.low_open else f"{low:g} to"
    return f"{above} {high:g}"


def default(key: Key) -> str:
    """Return the default of a key as a job file has it."""
    if key.required:
        return "required"
    if key.default is None:
        return "absent"
    if isinstance(key.default, bool):
        return str(key.default).lower()
    if isinstance(key.default, str):
        return f'"{key.default}"'
    if isinstance(key.default, list) and key.default:
        return "[" + ", ".join(f"{value:g}" for value in key.default) + "]"
    return f"{key.default:g}" if isinstance(key.default, float) else str(key.default)


def key_table(keys: tuple[Key, ...]) -> str:
    """Return the table of the keys of a section."""
    rows = [
        (
            f"`{key.name}`" + (f" [{key.unit}]" if key.unit else ""),
            takes(key),
            limits(key),
            default(key),
            key.meaning,
        )
        for key in keys
    ]
    return table(("key [unit]", "takes", "range", "default", "meaning"), rows)


def section_keys(section: str, keys: tuple[Key, ...]) -> str:
    """Return the table of a section, and a sentence on the inner tables that override some of its keys."""
    text = key_table(keys)
    if section == "cable":
        others = ", ".join(f"`{name}`" for name in GLOBAL_CABLE_KEYS)
        text += f"\n\n`[group.NAME]` takes all keys except {others}."
    if section in ZONE_KEYS:
        names = ", ".join(f"`{key.name}`" for key in ZONE_KEYS[section])
        text += f"\n\n`[{section}.zone.NAME]` takes {names}."
    return text


def study_keys(name: str) -> str:
    """Return the table of a section of the study file."""
    from netfall.study import sections

    return key_table(tuple(keys_of(getattr(sections, name)).values()))


# --- commands


def command_parsers() -> dict[str, argparse.ArgumentParser]:
    """Return the parser of each command by its name."""
    from netfall.cli.parser import parser

    return dict(next(action for action in parser()._actions if action.nargs == argparse.PARSER).choices or {})


def option_table(command: argparse.ArgumentParser) -> str:
    """Return the table of a command's arguments and options."""
    rows = []
    for action in command._actions:
        if action.dest == "help" or not action.help:
            continue
        words = list(action.option_strings) or [str(action.metavar or action.dest)]
        value = action.metavar or "|".join(map(str, action.choices or ()))
        if action.option_strings and action.nargs != 0 and value:
            words = [f"{word} {value}" for word in words]
        shown = "`, `".join(words).replace("|", " or ")
        needed = " (required)" if action.option_strings and action.required else ""
        rows.append((f"`{shown}`", f"{action.help}{needed}"))
    return table(("option", "meaning"), rows) if rows else "It has no options."


def command_text(name: str, command: argparse.ArgumentParser) -> str:
    """Return the part of one command: description, options, examples."""
    arguments = [str(a.metavar or a.dest) for a in command._actions if not a.option_strings]
    about = (command.description or "").strip().rstrip(".")
    parts = [f"## netfall {name}", f"`{' '.join(['netfall', name, *arguments])}`"]
    about = textwrap.fill(about[:1].upper() + about[1:] + ".", WIDTH, break_on_hyphens=False)
    parts += [about, option_table(command)]
    examples = [line.strip() for line in (command.epilog or "").splitlines()[1:] if line.strip()]
    if examples:
        parts.append("\n".join(["```text", *examples, "```"]))
    return "\n\n".join(parts)


def commands() -> str:
    """Return the parts of all commands."""
    return "\n\n".join(command_text(name, command) for name, command in command_parsers().items())


# --- datasets


def datasets() -> str:
    """Return the tables of the datasets of a result file."""
    from netfall.results.datasets import GROUPS

    parts = []
    for group in GROUPS:
        rows = [
            (f"`{one.name}`" + (f" ({one.shape})" if one.shape else ""), one.unit, one.meaning)
            for one in group.datasets
        ]
        written = f" Written for a job with: {group.lacking}." if group.lacking else ""
        about = textwrap.fill(group.meaning + written, WIDTH, break_on_hyphens=False)
        parts.append(f"### /{group.name.replace('*', 'NAME')}\n\n{about}")
        parts.append(table(("dataset", "unit", "meaning"), rows))
    return "\n\n".join(parts)


# --- the Python interface


def documentation(public: Any) -> str:
    """Return the docstring of an object, without its indentation."""
    return inspect.getdoc(public) or ""


def function_text(name: str, function: Any) -> str:
    """Return the part of a function: signature and docstring."""
    signature = inspect.signature(function)
    arguments = [f"    {str(argument).replace(chr(39), '')},\n" for argument in signature.parameters.values()]
    returned = str(signature.return_annotation).strip("'")
    call = f"{name}(\n{''.join(arguments)}) -> {returned}"
    return f"### {name}\n\n```text\n{call}\n\n{documentation(function)}\n```"


def member_rows(owner: type) -> list[tuple[str, str]]:
    """Return a row for each public property and method of a class."""
    rows = []
    for name, member in vars(owner).items():
        if name.startswith("_") or not (isinstance(member, property) or inspect.isfunction(member)):
            continue
        call = f"({', '.join(list(inspect.signature(member).parameters)[1:])})" if callable(member) else ""
        first = " ".join(documentation(member).split("\n\n")[0].split()).replace("|", "\\|")
        rows.append((f"`{name}{call}`", first))
    return rows


def class_text(name: str, owner: type) -> str:
    """Return the part of a class: docstring and members."""
    parts = [f"### {name}", f"```text\n{documentation(owner)}\n```"]
    if rows := member_rows(owner):
        parts.append(table(("member", "meaning"), rows))
    return "\n\n".join(parts)


def python_interface() -> str:
    """Return the parts of the public names of netfall."""
    parts = []
    for name in sorted(netfall.__all__, key=str.lower):
        public = getattr(netfall, name)
        make = class_text if inspect.isclass(public) else function_text
        parts.append(make(f"netfall.{name}", public))
    return "\n\n".join(parts)


PARTS: dict[str, Callable[[], str]] = {
    **{
        f"keys of {name or 'the job'}": partial(section_keys, name, keys)
        for name, keys in (TABLES | LIST_KEYS).items()
    },
    **{
        f"study keys of {place}": partial(study_keys, model)
        for place, model in {
            "run": "RunSettings",
            "sampling": "DrawSettings",
            "failure": "FailureCriterion",
            "hazard gumbel": "Gumbel",
            "hazard weibull": "Weibull",
            "hazard en1991": "EN1991",
        }.items()
    },
    "commands": commands,
    "datasets": datasets,
    "python": python_interface,
}


def part_names(text: str) -> list[str]:
    """Return the names of the parts that a page holds."""
    return [match[2] for match in PART.finditer(text)]


def renewed(text: str) -> str:
    """Return a page with its generated parts renewed. Raises KeyError for an unknown part."""

    def part(match: re.Match[str]) -> str:
        made = PARTS[match[2]]().rstrip()
        return f"{match[1]}\n{made}\n\n{match[3]}" if made else f"{match[1]}{match[3]}"

    return PART.sub(part, text)


def write_pages() -> None:
    """Write the generated parts into all pages."""
    for page in sorted(PAGES.rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        if (new := renewed(text)) != text:
            page.write_text(new, encoding="utf-8")
