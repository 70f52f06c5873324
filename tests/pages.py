"""The pages, or parts of them, that are made from the code, so that they cannot be other than it.

    .venv/bin/python tests/pages.py          writes them anew
    .venv/bin/python tests/pages.py --map    prints a map of the code, from the first sentence of each file

The tables of keys in jobs/KEYS.md; those of options in jobs/RUNNING.md; the columns of /history in
src/netfall/results/README.md. test_readme.py compares them with the code.
"""

import argparse
import ast
import re
import sys
import textwrap
from pathlib import Path

from netfall.cli.parser import parser
from netfall.job.fields import Key
from netfall.job.models import GLOBAL_CABLE_KEYS
from netfall.job.schema import LIST_KEYS, TABLES, ZONE_KEYS

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "src" / "netfall"
WIDEST = 110  # characters of a line of a page
PACKAGES = (  # each imports from those before it
    *("core", "physics", "physics/law", "physics/slip", "job", "geometry", "geometry/generators", "parallel"),
    *("loads", "loads/wind", "model", "explicit", "results", "statics", "statics/multigrid", "statics/form"),
    *("driver", "driver/erection", "driver/removal", "driver/reporting", "study", "study/answers"),
    *("post", "post/checks", "post/plots", "post/plots/study", "post/report", "post/page", "post/accuracy"),
    *("exchange", "exchange/formats", "exchange/drawings", "api", "cli"),
)
HEAD = """# The map of the code

Packages stand in the order in which they import: each from those above it, as `tests/test_imports.py` says in
detail.
"""


def first_sentence(path: Path) -> str:
    """The first sentence of a module's docstring, on one line."""
    text = " ".join((ast.get_docstring(ast.parse(path.read_text())) or "").split("\n\n")[0].split())
    return re.split(r"(?<=[.:;]) (?=[A-Z])", text)[0].rstrip(".:")


def code_map() -> str:
    """A page of all files."""
    parts = [HEAD]
    for room in PACKAGES:
        files = sorted(path for path in (PACKAGE / room).glob("*.py") if path.name != "__init__.py")
        rows = "".join(f"| `{path.name}` | {first_sentence(path)} |\n" for path in files)
        whole = ast.get_docstring(ast.parse((PACKAGE / room / "__init__.py").read_text()))
        about = " ".join(whole.split("\n\n")[0].split())
        parts.append(f"## {room}\n\n{about}\n\n| file | what |\n|---|---|\n{rows}")
    return "\n".join(parts)


# --- the keys of a job file


NOUNS = {  # what a key takes, by its kind
    "number": "number",
    "integer": "integer",
    "flag": "`true`, `false`",
    "text": "text",
    "path": "path",
    "name": "name",
    "vector": "three numbers",
    "band": "two numbers, [low, high]",
    "pressure": "number, or three",
    "points": "list of [x, y]",
    "places": "list of [x, y], [x, y, z] or ids",
    "polygon": "list of [x, y]",
    "words": "list of names",
    "integers": "list of integers",
    "lengths": "table",
    "loads": 'table, `{"load.snow" = 750.0}`',
    "factors": "table, `{permanent = 1.35, NAME = 1.5}`",
    "shifts": "table, `{17 = [0.0, 0.0, -0.05]}`",
}


def takes(key: Key) -> str:
    """What a key takes: its type or the words to choose from, and the words in place of a number."""
    if key.kind == "choice":
        return ", ".join(f'`"{word}"`' for word in key.choices)
    return NOUNS[key.kind] + "".join(f', or `"{word}"`' for word in key.special_words)


def limits(key: Key) -> str:
    """The range of a key's numbers: "> 0", "0 to 1"; empty where there is none."""
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
    """The default of a key as a job file has it."""
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


def table_of_keys(keys: tuple[Key, ...]) -> str:
    """The table of the keys of a section."""
    rows = []
    for key in keys:
        name = f"`{key.name}`" + (f" [{key.unit}]" if key.unit else "")
        rows.append(f"| {name} | {takes(key)} | {limits(key)} | {default(key)} | {key.meaning} |")
    return "\n".join(["| key [unit] | takes | range | default | meaning |", "|---|---|---|---|---|", *rows])


def overridden(section: str) -> str:
    """The sentence on the tables inside a section that override some of its keys; empty without them."""
    if section == "cable":
        others = ", ".join(f"`{name}`" for name in GLOBAL_CABLE_KEYS)
        return f"\n\n`[group.NAME]` may give every key but {others}."
    if section in ZONE_KEYS:
        names = ", ".join(f"`{key.name}`" for key in ZONE_KEYS[section])
        return f"\n\n`[{section}.zone.NAME]` may give {names}."
    return ""


def keys_of(section: str, keys: tuple[Key, ...]) -> str:
    """What jobs/KEYS.md has of a section or of the entries of a list."""
    return table_of_keys(keys) + overridden(section)


# --- the options of the commands


def table_of_options(verb: argparse.ArgumentParser) -> str:
    """The table of a command's arguments and options, with their meaning."""
    rows = []
    for action in verb._actions:
        if action.dest == "help" or not action.help:
            continue
        words = [action.metavar or ""] if not action.option_strings else action.option_strings
        value = action.metavar or "|".join(action.choices or ())
        if action.option_strings and action.nargs != 0 and value:
            words = [f"{word} {value}" for word in words]
        shown = "`, `".join(words).replace("|", " or ")
        rows.append(f"| `{shown}` | {action.help}{' (required)' * is_needed(action)} |")
    return "\n".join(["| option | meaning |", "|---|---|", *rows]) if rows else "No options."


def is_needed(action: argparse.Action) -> bool:
    """Whether an option must be given."""
    return bool(action.option_strings) and action.required


def options() -> str:
    """What jobs/RUNNING.md has of the commands."""
    verbs = next(action for action in parser()._actions if action.dest == "command").choices
    return "\n\n".join(
        textwrap.fill(f"**`{usage(name, verb)}`**: {verb.description}", WIDEST, break_on_hyphens=False)
        + f"\n\n{table_of_options(verb)}"
        for name, verb in verbs.items()
    )


def usage(name: str, verb: argparse.ArgumentParser) -> str:
    """A command with its positional arguments."""
    return " ".join(["netfall", name, *(a.metavar for a in verb._actions if not a.option_strings)])


# --- pages with parts


def with_parts(page: Path, parts: dict[str, str]) -> str:
    """A page with each part between its marks `<!-- name: ... -->` and `<!-- end -->` anew."""
    text = page.read_text()
    for name, part in parts.items():
        marks = rf"(<!-- {re.escape(name)}: [^\n]*-->\n).*?(<!-- end -->)"
        made = lambda found, part=part: f"{found[1]}\n{part.rstrip()}\n\n{found[2]}"
        text, places = re.subn(marks, made, text, flags=re.S)
        if places != 1:
            raise ValueError(
                f"{page}: {places} places for <!-- {name}: ... --> ... <!-- end -->, expected one"
            )
    return text


# of /history: the rows of its columns, (t) each, which stand first in its table
HISTORY_ROWS = re.compile(r"(?s)(### /history\n.*?\|---\|---\|---\|\n)(?:\| `\w+` \(t\) \|[^\n]*\n)+")


def with_history_rows(page: Path) -> str:
    """A page with the rows of the columns of /history anew."""
    from netfall.explicit.history import COLUMNS  # loads MPI, which not every user of this module wants

    rows = "".join(f"| `{c.name}` (t) | {c.unit} | {c.meaning} |\n" for c in COLUMNS)
    text, places = HISTORY_ROWS.subn(lambda found: found[1] + rows, page.read_text())
    if places != 1:
        raise ValueError(f"{page}: {places} tables of /history, expected one")
    return text


KEYS = ROOT / "jobs" / "KEYS.md"
RESULTS = PACKAGE / "results" / "README.md"
RUNNING = ROOT / "jobs" / "RUNNING.md"
PAGES = {  # page: its text as the code says it
    KEYS: lambda: with_parts(
        KEYS,
        {f"keys of {name or 'the job'}": keys_of(name, keys) for name, keys in (TABLES | LIST_KEYS).items()},
    ),
    RESULTS: lambda: with_history_rows(RESULTS),
    RUNNING: lambda: with_parts(RUNNING, {"options": options()}),
}

if __name__ == "__main__":
    if "--map" in sys.argv:
        print(code_map())
        sys.exit()
    for path, text in PAGES.items():
        path.write_text(text())
