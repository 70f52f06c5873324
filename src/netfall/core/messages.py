"""Text for people: messages with a severity and a code, and quantities in kN, mm and kN/m2. Files keep SI.

The page `docs/pages/reference/messages.md` holds the texts of all messages. A file `messages.py` in each
package names its messages; this one names those of the package `core`.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from string import Formatter
from typing import Any


def count_of(count: int, what: str) -> str:
    """Return a number of things in words: "1 element", "3 elements"."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


NEGLIGIBLE_DISPLACEMENT = 1e-9  # m: rounding errors of positions


def kN(*forces: float, digits: int = 4) -> str:
    """Return the text of a force [N], or of a range from two: "12.5 to 80 kN"."""
    return f"{_numbers(forces, 1e-3, digits)} kN"


def mm(*lengths: float, digits: int = 4) -> str:
    """Return the text of a displacement [m], or of a range from two; "0 mm" for rounding errors."""
    rounded = tuple(0.0 if abs(length) < NEGLIGIBLE_DISPLACEMENT else length for length in lengths)
    return f"{_numbers(rounded, 1e3, digits)} mm"


def kN_m2(*pressures: float, digits: int = 4) -> str:
    """Return the text of a pressure [Pa], or of a range from two."""
    return f"{_numbers(pressures, 1e-3, digits)} kN/m2"


def _numbers(values: tuple[float, ...], factor: float, digits: int) -> str:
    """Return numbers with significant digits, those up to 1e12 without an exponent."""
    scaled = [factor * value for value in values]
    return " to ".join(
        f"{value:.0f}" if 10.0**digits <= abs(value) < 1e12 else f"{value:.{digits}g}" for value in scaled
    )


UNITS: dict[str, Callable[..., str]] = {"kN": kN, "mm": mm, "kN/m2": kN_m2}  # formats of quantities in SI
COUNTED = "cable", "element", "node", "sample"  # formats of counts: "1 cable", "2 cables"
SEPARATOR = re.compile(r"\|[-:| ]+\|")  # line of a page between the head of a table and its rows
SEVERITIES = {"E": "error", "W": "warning", "N": "note"}


class _Formatter(Formatter):
    """Formatter of templates; a format is a unit or the thing that is counted: {force:kN}, {count:node}."""

    def format_field(self, value: Any, format_spec: str) -> str:
        """Return the text of a value."""
        if format_spec in COUNTED:
            return count_of(value, format_spec)
        return UNITS[format_spec](value) if format_spec in UNITS else super().format_field(value, format_spec)


def tables_of(text: str) -> list[list[list[str]]]:
    """Return the tables of a page, each with its head as the first row of cells."""
    tables = []
    for lines in re.findall(r"(?:^\|.*\n?)+", text, re.M):
        rows = [line for line in lines.splitlines() if not SEPARATOR.fullmatch(line)]
        tables.append([[cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]] for row in rows])
    return tables


@cache
def _texts() -> dict[str, str]:
    """Return the texts of all messages by code, the last cells of the rows of their page."""
    page = Path(__file__).parents[1] / "docs" / "pages" / "reference" / "messages.md"
    _, table = tables_of(page.read_text(encoding="utf-8"))
    return {code.strip("`"): text[1:-1].replace("\\|", "|") for code, *_, text in table[1:]}


@dataclass(frozen=True)
class Message:
    """Message of netfall.

    code : letter of the severity and three digits; the first digit is that of the package
    """

    code: str

    @property
    def text(self) -> str:
        """Template of the printed line, with names in braces as in `str.format`.

        {name:kN}, {name:mm} and {name:kN/m2} convert from SI, and {name:node} counts nodes, see `COUNTED`.
        """
        return _texts()[self.code]

    @property
    def severity(self) -> str:
        """The severity: "error", "warning" or "note"."""
        return SEVERITIES[self.code[0]]

    def __call__(self, **values: object) -> str:
        """Return the line that netfall prints. values : those of the names in `text`

        Only warnings and notes begin with their severity. The command line prints that of errors, because the
        file and the section often precede the text.
        """
        prefix = "" if self.severity == "error" else f"{self.severity}: "
        return f"{prefix}{_Formatter().format(self.text, **values)} [{self.code}]"


def is_warning(line: str) -> bool:
    """Return whether a line is a warning."""
    return line.startswith("warning: ")


def is_note(line: str) -> bool:
    """Return whether a line is a note."""
    return line.startswith("note: ")


def is_error(line: str) -> bool:
    """Return whether a line of an exception is an error, not a warning or note that explains it."""
    return not (is_warning(line) or is_note(line))


def code_of(line: str) -> str:
    """Return the code at the end of a line, "W612" of "... [W612]"; empty if it has none."""
    code = line[-5:-1]
    return code if line.endswith("]") and code[:1] in SEVERITIES and code[1:].isdigit() else ""


def without_code(line: str) -> str:
    """Return a line without the code at its end."""
    return line.removesuffix(f" [{code_of(line)}]")


def with_sentence(line: str, sentence: str) -> str:
    """Return a line with a further sentence before the code at its end."""
    code = code_of(line)
    return f"{without_code(line).rstrip('.')}. {sentence}" + (f" [{code}]" if code else "")


def warning_count(warnings: list[str]) -> str:
    """Return the line that ends a command: the number of its warnings, with their codes."""
    codes = ", ".join(sorted({code_of(line) for line in warnings} - {""}))
    return count_of(len(warnings), "warning") + (f" ({codes}; netfall docs CODE explains)" if codes else "")


def say_counted(report: Callable[[Callable[[str], None]], object], say: Callable[[str], None]) -> None:
    """Pass `report` a function that prints its lines, then print the number of warnings."""
    warnings = []

    def counting(line: str) -> None:
        say(line)
        warnings.extend([line] * is_warning(line))

    report(counting)
    say(warning_count(warnings))


NO_LAUNCHER = Message("E001")
WRONG_LAUNCHER = Message("E002")
MISSING_PACKAGE = Message("E003")
LAUNCHER_MISMATCH = Message("E004")
OTHER_VERSION = Message("E005")
INTERRUPTED = Message("N006")
