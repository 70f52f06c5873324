"""What a row of the table of keys says of a key: type, unit, range, default, meaning."""

from dataclasses import dataclass

REQUIRED = object()  # the key must stand in the job file if its section does
ABSENT = None  # the key may be missing: the thing that it describes is then not there


@dataclass(frozen=True)
class Key:
    """One key of a section.

    kind : "number" | "integer" | "flag" | "text" | "path" | "name" | "choice" | "vector" | "pressure" |
        "points" | "places" | "polygon" | "words" | "integers" | "loads"
    low, high : bounds of a number; low_open, high_open : the bound itself is excluded
    gone : values that the key once had, each with the reason why it went
    """

    name: str
    kind: str
    default: object
    unit: str
    meaning: str
    low: float | None = None
    high: float | None = None
    low_open: bool = False
    high_open: bool = False
    choices: tuple[str, ...] = ()
    also: tuple[str, ...] = ()  # words that stand in place of a number ("auto")
    gone: tuple[tuple[str, str], ...] = ()

    def expected(self) -> str:
        """What is allowed, in words: "a number of m/s > 0"."""
        if self.kind == "choice":
            return ("one of " if len(self.choices) > 1 else "") + ", ".join(f'"{c}"' for c in self.choices)
        if self.kind == "flag":
            return "true or false"
        if self.kind in ("text", "path"):
            return f"a text in quotes ({self.meaning})"
        if self.kind == "name":
            return f"a name in quotes, without / ({self.meaning})"
        if self.kind == "loads":
            return 'a table of loads, {"load.snow" = 750.0, ...}'
        of = f" of {self.unit}" if self.unit else ""
        if self.kind == "vector":
            return f"three numbers{of}, [x, y, z]" + self._range()
        if self.kind == "pressure":
            return f"three numbers{of}, [x, y, z], or one number along the normals,{self._range()}"
        if self.kind == "points":
            return f"a list of [x, y] pairs{of}{self._range()}"
        if self.kind == "places":
            return f"a list of places [x, y] or [x, y, z]{of}{self._range()}, or of ids of nodes"
        if self.kind == "polygon":
            return f"a list of three or more [x, y] corners{of}{self._range()}"
        if self.kind == "integers":
            return f"a list of integers ({self.meaning})"
        if self.kind == "words":
            return f"a list of names in quotes ({self.meaning})"
        noun = "an integer" if self.kind == "integer" else "a number"
        words = "".join(f' or "{w}"' for w in self.also)
        return f"{noun}{of}{self._range()}{words}"

    def why_gone(self, value) -> str:
        """The end of a message on a value that went; "" for any other value."""
        return next((f'; "{word}" went: {why}' for word, why in self.gone if word == value), "")

    def _range(self) -> str:
        parts = []
        if self.low is not None:
            parts.append(f"{'>' if self.low_open else '>='} {self.low:g}")
        if self.high is not None:
            parts.append(f"{'<' if self.high_open else '<='} {self.high:g}")
        return (" " if parts else "") + " and ".join(parts)


def between(low, high, name, unit, default, meaning):
    """Row of a number within what is physically possible; far beyond, products overflow."""
    return Key(name, "number", default, unit, meaning, low=low, high=high)


def positive(name, unit, default, meaning, high=None, also=()):
    """Row of a number > 0."""
    return Key(name, "number", default, unit, meaning, low=0.0, low_open=True, high=high, also=also)


def not_negative(name, unit, default, meaning, high=None):
    """Row of a number >= 0."""
    return Key(name, "number", default, unit, meaning, low=0.0, high=high)


def count(name, default, meaning, low=1, high=None):
    """Row of an integer."""
    return Key(name, "integer", default, "", meaning, low=low, high=high)


def choice(name, choices, default, meaning, gone=()):
    """Row of one of several words."""
    return Key(name, "choice", default, "", meaning, choices=choices, gone=gone)


def flag(name, default, meaning):
    """Row of true or false."""
    return Key(name, "flag", default, "", meaning)
