"""Rows of the table of keys: type, unit, range, default and meaning of a key."""

import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from netfall.core.text_tables import table_rows

REQUIRED = object()  # default of a key that must be in the job file if its section is
MAX_SHIFT = 1e6  # m: largest displacement of a support in a job
LENGTHS = ("change", "length", "force")  # keys of a cable in a stage
ABSENT = None  # default of a key without which its feature is absent


class Kind(NamedTuple):
    """Check of a kind of keys, and its text in messages.

    expected : text with {of} the unit, {within} the range, {words}, {choices} and {meaning} of the key
    fits : function of the key and the value
    """

    expected: str
    fits: Callable[["Key", object], bool]


@dataclass(frozen=True)
class Key:
    """Key of a section.

    kind : one of KINDS
    low, high : bounds of a number; low_open : the lower bound is excluded
    """

    name: str
    kind: str
    default: object
    unit: str
    meaning: str
    low: float | None = None
    high: float | None = None
    low_open: bool = False
    choices: tuple[str, ...] = ()
    special_words: tuple[str, ...] = ()  # words allowed instead of a number ("auto")

    def expected(self) -> str:
        """Describe the allowed values: "a number of m/s > 0"."""
        low = [] if self.low is None else [f"{'>' if self.low_open else '>='} {self.low:g}"]
        bounds = low + ([] if self.high is None else [f"<= {self.high:g}"])
        return KINDS[self.kind].expected.format(
            of=f" of {self.unit}" if self.unit else "",
            within=" " * bool(bounds) + " and ".join(bounds),
            words="".join(f' or "{word}"' for word in self.special_words),
            choices="one of " * (len(self.choices) > 1) + ", ".join(f'"{word}"' for word in self.choices),
            meaning=self.meaning,
        )

    def fits(self, value) -> bool:
        """Tell whether the key allows a value."""
        return KINDS[self.kind].fits(self, value)

    def number(self, value) -> bool:
        """Tell whether a value is a finite number in the range."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        try:
            finite = math.isfinite(float(value))
        except OverflowError:
            return False
        above = self.low is None or value > self.low or (value == self.low and not self.low_open)
        below = self.high is None or value <= self.high
        return finite and above and below

    def numbers(self, value, *counts: int) -> bool:
        """Tell whether a value is a list of such numbers, as many as one of counts."""
        return isinstance(value, list) and len(value) in counts and all(map(self.number, value))


def is_whole(value) -> bool:
    """Tell whether a value is an integer; true and false are not."""
    return isinstance(value, int) and not isinstance(value, bool)


def _text(key: Key, value) -> bool:
    """Tell whether a value is a text that the key allows."""
    return isinstance(value, str) and (value != "" or key.default == "") and "\x00" not in value


def _name(_, value) -> bool:
    """Tell whether a value is a name that can be part of a path."""
    return isinstance(value, str) and value not in ("", ".", "..") and not set(value) & set("/\x00")


def _points(key: Key, value) -> bool:
    """Tell whether a value is a list of points in plan."""
    return isinstance(value, list) and all(key.numbers(point, 2) for point in value)


def _places(key: Key, value) -> bool:
    """Tell whether a value is a list of points or node ids."""
    return isinstance(value, list) and all(is_whole(v) or key.numbers(v, 2, 3) for v in value)


def _some(fits: Callable[[object], bool]) -> Callable[[Key, object], bool]:
    """Return a check for non-empty lists whose values all fit."""
    return lambda _, value: isinstance(value, list) and value != [] and all(map(fits, value))


def _tables(key: Key, value) -> bool:
    """Tell whether a value is a list of tables."""
    some = isinstance(value, list) and all(isinstance(table, dict) for table in value)
    return some and (value != [] or key.default is not REQUIRED)


def _factors(key: Key, value) -> bool:
    """Tell whether a value is a table of numbers."""
    return isinstance(value, dict) and all(map(key.number, value.values()))


def _shifts(_, value) -> bool:
    """Tell whether a value is a table of three numbers by id."""
    shift = Key("", "vector", ABSENT, "", "", low=-MAX_SHIFT, high=MAX_SHIFT)

    def is_id(name):
        return name.removeprefix("-").isdecimal() and name.isascii()

    return isinstance(value, dict) and all(is_id(k) and shift.numbers(v, 3) for k, v in value.items())


def _lengths(_, value) -> bool:
    """Tell whether a value is a table of tables with one number each."""
    length = Key("", "number", ABSENT, "", "", low=-1e12, high=1e12)

    def is_entry(entry):
        return isinstance(entry, dict) and len(entry) == 1 and {*entry} <= {*LENGTHS}

    return isinstance(value, dict) and all(
        is_entry(entry) and all(map(length.number, entry.values())) for entry in value.values()
    )


KINDS = {
    "number": Kind("a number{of}{within}{words}", lambda key, v: v in key.special_words or key.number(v)),
    "integer": Kind(
        "an integer{of}{within}{words}",
        lambda key, v: v in key.special_words or (isinstance(v, int) and key.number(v)),
    ),
    "flag": Kind("true or false", lambda _, v: isinstance(v, bool)),
    "text": Kind("a text in quotes ({meaning})", _text),
    "path": Kind("a text in quotes ({meaning})", _text),
    "name": Kind("a name in quotes, without / ({meaning})", _name),
    "choice": Kind("{choices}", lambda key, v: isinstance(v, str) and v in key.choices),
    "vector": Kind("three numbers{of}, [x, y, z]{within}", lambda key, v: key.numbers(v, 3)),
    "band": Kind(
        "two numbers{of}, [low, high], the second larger,{within}",
        lambda key, v: key.numbers(v, 2) and v[0] < v[1],
    ),
    "pressure": Kind(
        "three numbers{of}, [x, y, z], or one number along the normals,{within}",
        lambda key, v: key.number(v) or key.numbers(v, 3),
    ),
    "points": Kind("a list of [x, y] pairs{of}{within}", _points),
    "places": Kind("a list of places [x, y] or [x, y, z]{of}{within}, or of ids of nodes", _places),
    "polygon": Kind(
        "a list of three or more [x, y] corners{of}{within}", lambda key, v: _points(key, v) and len(v) >= 3
    ),
    "words": Kind("a list of names in quotes ({meaning})", _some(lambda v: isinstance(v, str) and v != "")),
    "integers": Kind("a list of integers ({meaning})", _some(is_whole)),
    "factors": Kind("a table of numbers{within}, {{permanent = 1.35, NAME = 1.5}}", _factors),
    "values": Kind("a table of numbers{within} ({meaning})", _factors),
    "tables": Kind("a list of tables ({meaning})", _tables),
    "shifts": Kind("a table of [x, y, z]{of} by ids of nodes, {{17 = [0.0, 0.0, -0.05]}}", _shifts),
    "lengths": Kind(
        'a table of lengths by groups or cables, {{"hoop" = {{change = -0.5}}, "e17" = {{force = 2e5}}}}, '
        "each with one of change [m], length [m], force [N]",
        _lengths,
    ),
    "loads": Kind('a table of loads, {{"load.snow" = 750.0, ...}}', lambda _, v: isinstance(v, dict)),
}


def parse_keys(text: str) -> dict[str, tuple[Key, ...]]:
    """Return the keys of each section of a text table; section names are in brackets.

    The cells of a row: name [unit]; kind, with the words of a choice or in place of a number; range; default,
    empty: absent; meaning.
    """
    sections, section = {}, ""
    for name, *cells in table_rows(text):
        if cells:
            sections[section] = (*sections.get(section, ()), _key(name, *cells))
        else:
            section = name.strip("[]")
    return sections


def _key(name: str, kind: str, within: str, default: str, meaning: str) -> Key:
    """Return the key of a row."""
    name, _, unit = name.rstrip("]").partition(" [")
    kind, *words = kind.split()
    low, _, high = within.lstrip(">= ").partition(" to ")
    number = int if kind == "integer" else float
    value = parse_toml_or_word(default) if default else ABSENT
    value = tuple(value) if isinstance(value, list) else value
    return Key(
        name,
        kind,
        REQUIRED if default == "required" else value,
        unit,
        meaning,
        low=number(low) if low else None,
        high=number(high) if high else None,
        low_open=within.startswith("> "),
        choices=tuple(words) if kind == "choice" else (),
        special_words=() if kind == "choice" else tuple(words),
    )


def parse_toml_or_word(text: str):
    """Parse a text as a TOML value; otherwise return the text, a word without quotes."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, KeyError):
        return text
