"""Tables with a header: named columns of numbers or words, errors with line numbers; tables of loads.

A table of loads is `load_table` of [load], cases and stages, for loads of nodes, elements or zones. Rows of
zones become values of [load.zone.NAME], or of `set`. `loads.loads` reads rows of nodes and elements.
"""

import csv
import difflib
import re
from collections.abc import Iterable, Iterator
from decimal import Decimal
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from netfall.core.errors import InputError, raise_errors
from netfall.job import messages
from netfall.job.job import read_bytes
from netfall.job.keys.fields import keys_of
from netfall.job.keys.models import LoadZone
from netfall.job.units import UnitError, factor
from netfall.job.values import format_value, range_text, suggest

MAX_ERRORS = 20  # largest number of errors reported for one table
BLOCK_ROWS = 4096  # rows that are written at once
MAX_CELL = 1e15  # largest number in a table; far above, products overflow
DELIMITERS = ",;\t"
AXES = ("x", "y", "z")  # columns of positions, and ends of the names of other columns
ZONE_SEPARATOR = "/"  # separator of several zones, or their shares, in one cell; names of zones have none
ESCAPED = re.compile(r"'*[=+\-@\t\r#]")  # start of a formula in a spreadsheet, or a comment, also behind '
COMMENT = re.compile(r"\s*#|sep=.\s*$")  # line that is no row, as the first line of Excel, sep=;
WORDS = ("name", "group", "type", "cable", "zone")  # columns of words; a row may have no other cell
NO_UNIT = ("", "-", "1")  # units of columns without a unit in the row of units
MIN_SIMILARITY = 0.7  # similarity (difflib) from which an unknown column is probably a typing error


class Table:
    """Columns of a table by name, separated by commas, semicolons or tabs; lines with # are comments.

    A row below the header may give the units of the columns: "id,x,y,z" then "-,mm,mm,mm".

    `numbers` and `integers` convert a column and record the cells that are invalid.
    known : names of columns with a meaning, others are named in `notes`; required : columns that must exist

    Raises InputError for a file that is not a table; `finish` raises all other errors.
    """

    def __init__(self, path: Path, known: tuple[str, ...], required: tuple[str, ...]):
        self.path = path
        self.errors: list[str] = []
        self.notes: list[str] = []
        rows = _rows_of(path)
        if not rows:
            raise InputError(messages.EMPTY_TABLE(path=path, columns=", ".join(required or known)))
        header = [unescape(name.strip()).lower() for name in rows[0][1]]
        self.units: dict[str, str] = {}
        if len(rows) > 1 and _is_unit_row(header, rows[1][1]):
            self.units = {name: cell.strip() for name, cell in zip(header, rows.pop(1)[1])}
        self.header_line, self.lines = rows[0][0], [line for line, _ in rows[1:]]
        self._check_header(header, rows[0][0], known, required)
        for line, row in rows[1:]:
            if len(row) != len(header):
                self.wrong(messages.ROW_LENGTH(line=line, count=len(row), columns=len(header)))
        if not self.lines:
            self.errors.append(messages.NO_ROWS(path=path))
        self.finish()
        self.columns = {
            name: [unescape(row[k].strip()) for _, row in rows[1:]] for k, name in enumerate(header)
        }

    def _check_header(
        self, header: list[str], line: int, known: tuple[str, ...], required: tuple[str, ...]
    ) -> None:
        """Record errors of the header, and notes on unknown columns."""
        unknown = [name for name in dict.fromkeys(header) if name not in known]
        for name in unknown:
            if difflib.get_close_matches(name, known, n=1, cutoff=MIN_SIMILARITY):
                suggestion = suggest(name, known)
                self.wrong(messages.UNKNOWN_COLUMN(line=line, name=name[:40], suggestion=suggestion))
        if unknown:
            names = [f'"{name[:40]}"' if name else "one without a name" for name in unknown[:MAX_ERRORS]]
            self.notes.append(
                messages.IGNORED_COLUMNS(path=self.path, names=", ".join(names), known=", ".join(known))
            )
        for name in [name for name in dict.fromkeys(header) if name in known and header.count(name) > 1]:
            self.wrong(messages.DUPLICATE_COLUMN(name=name))
        if missing := [name for name in required if name not in header]:
            columns, names = ", ".join(required), ", ".join(header)[:80]
            self.wrong(messages.MISSING_COLUMN(name=missing[0], columns=columns, line=line, names=names))

    def __len__(self) -> int:
        return len(self.lines)

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def wrong(self, what: str) -> None:
        """Record an error; only the first few are reported."""
        self.errors.append(f"{self.path}: {what}")

    def at(self, row: int) -> str:
        """Name a row in a message."""
        return f"line {self.lines[row]}"

    def words(self, name: str) -> list[str]:
        """Return a column as written; empty cells if the table does not have it."""
        return self.columns.get(name, [""] * len(self))

    def numbers(
        self,
        name: str,
        default: Any = np.nan,
        low: float = -MAX_CELL,
        unit: str = "",
        high: float = MAX_CELL,
    ) -> np.ndarray:
        """Return a column of numbers from low to high; an empty cell gives `default`, also an array."""
        defaults = np.broadcast_to(np.asarray(default, float), len(self)).copy()
        if name not in self.columns:
            return defaults
        words = self.columns[name]
        values = np.array([parse_number(word) for word in words])
        if self.units.get(name, "-") not in NO_UNIT:
            values = self._converted(name, values, unit)
        empty = np.array([word == "" for word in words])
        invalid = ~empty & ~((values >= low) & (values <= high))
        for row in np.flatnonzero(invalid)[:MAX_ERRORS]:
            place, cell = self.at(row), words[row][:40]
            if cell.count(",") == 1 and np.isfinite(parse_number(cell.replace(",", "."))):
                self.wrong(messages.DECIMAL_COMMA(row=place, name=name, cell=cell))
                continue
            least = low if low > -MAX_CELL or values[row] < low else None
            most = high if high < MAX_CELL or values[row] > high else None
            expected = "a number" + range_text(least, most, unit)
            self.wrong(messages.INVALID_CELL(row=place, name=name, cell=cell, expected=expected))
        return np.where(empty, defaults, values)

    def _converted(self, name: str, values: np.ndarray, unit: str) -> np.ndarray:
        """Return the values of a column with a unit in `unit`. Decimal numbers are converted exactly."""
        given = self.units[name]
        if not unit:
            self.wrong(messages.COLUMN_WITHOUT_UNIT(name=name, unit=given[:40]))
            return values
        try:
            number = factor(given, unit)
        except UnitError as error:
            self.wrong(f"column {name}: unit {error}")
            return values
        is_number = np.isfinite(values)
        words = np.array(self.columns[name])[is_number]
        values[is_number] = [float(Decimal(word) * number) for word in words]
        return values

    def stacked(
        self, names: Iterable[str], default: Any = np.nan, low: float = -MAX_CELL, unit: str = ""
    ) -> np.ndarray:
        """Return columns of numbers side by side; arguments as in `numbers`."""
        return np.column_stack([self.numbers(name, default, low, unit) for name in names])

    def full(self, name: str, most: int | None = None) -> None:
        """Record the first empty cells of a column, all of them by default."""
        for row in [row for row, word in enumerate(self.words(name)) if word == ""][:most]:
            self.wrong(messages.EMPTY_CELL(row=self.at(row), name=name))

    def check_no_gaps(self, *columns: np.ndarray) -> None:
        """Raise all recorded errors, with one for empty cells in columns that were read."""
        if any(np.isnan(values).any() for values in columns):
            self.wrong(messages.EMPTY_CELLS())
        self.finish()

    def integers(self, name: str) -> np.ndarray:
        """Return a column of integers up to MAX_CELL, as 64-bit numbers with room for more ids above them.

        Each invalid cell has another number below -MAX_CELL.
        """
        if self.units.get(name, "-") not in NO_UNIT:
            self.wrong(messages.COLUMN_WITHOUT_UNIT(name=name, unit=self.units[name][:40]))
        values = -int(2 * MAX_CELL) - np.arange(len(self))
        for row, word in enumerate(self.columns[name]):
            number, expected = _parse_integer(word), "an integer"
            if number is not None and abs(number) <= MAX_CELL:
                values[row] = number
                continue
            expected += "" if number is None else range_text(-MAX_CELL, MAX_CELL, "")
            place, cell = self.at(row), word[:40]
            self.wrong(messages.INVALID_CELL(row=place, name=name, cell=cell, expected=expected))
        return values

    def ascending(self, name: str, values: np.ndarray) -> None:
        """Record errors for values of a column that do not ascend."""
        for row in np.flatnonzero(np.diff(values) <= 0)[:3]:
            previous, value = values[row : row + 2]
            error = messages.NOT_ASCENDING(row=self.at(row + 1), name=name, value=value, previous=previous)
            self.wrong(error)

    def finish(self, *others: "Table") -> None:
        """Raise all recorded errors, of other tables too."""
        lines = []
        for table in (self, *others):
            excess = len(table.errors) - MAX_ERRORS
            lines += table.errors[:MAX_ERRORS]
            lines += [messages.MORE_ERRORS(path=table.path, count=excess)] * (excess > 0)
        raise_errors(lines)


def _is_unit_row(header: list[str], cells: list[str]) -> bool:
    """Return whether the row below the header gives units: no number, but cells in columns of numbers."""
    has_number = any(np.isfinite(parse_number(cell.strip())) for cell in cells)
    return not has_number and any(cell for name, cell in zip(header, cells) if name not in WORDS)


def parse_number(word: str) -> float:
    """Parse a number; nan if the word is not a number."""
    try:
        return float(_plain(word))
    except ValueError:
        return np.nan


def _parse_integer(word: str) -> int | None:
    """Parse an integer; None if the word is not an integer."""
    try:
        return int(_plain(word))
    except ValueError:
        return None


def _plain(word: str) -> str:
    """Return a word that Python parses only if other programs do; Python reads 1_0 as ten."""
    return word.replace("_", "?")


def _rows_of(path: Path) -> list[tuple[int, list[str]]]:
    """Return the rows that are neither empty nor comments, with their lines. Raises InputError."""
    data = read_bytes(path)
    try:
        text = data.decode("utf-8-sig")
        if "\0" in text:  # UTF-16 without a mark of byte order
            raise UnicodeDecodeError("utf-8", data, data.index(0), len(data), "NUL")
        file = StringIO(text, newline="")
        lines = ["\n" if COMMENT.match(line) else line.rstrip("\r\n") + "\n" for line in file]
        header = next((line for line in lines if line.strip()), "")
        rows = _numbered_rows(path, lines, max(DELIMITERS, key=header.count))
        return [(number, row) for number, row in rows if any(cell.strip() for cell in row)]
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise InputError(messages.TABLE_NOT_UTF8(path=path, line=line)) from None
    except csv.Error as error:
        raise InputError(messages.NOT_CSV(path=path, reason=error)) from None


def _numbered_rows(path: Path, lines: list[str], delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number and the cells of each line. Raises InputError for a quote not closed on its line."""
    finished = 0  # rows

    def closed_lines() -> Iterator[str]:
        for number, line in enumerate(lines, 1):
            yield line
            if finished < number:  # the reader goes on although the row of this line is not finished
                raise InputError(messages.OPEN_QUOTE(path=path, line=number))

    for row in csv.reader(closed_lines(), delimiter=delimiter, skipinitialspace=True):
        finished += 1
        yield finished, row


def write_table(path: Path, columns: dict[str, Any], note: str = "", digits: int | None = None) -> None:
    """Write columns of one length by name as a table that `Table` reads; nan is an empty cell.

    note : a comment above the header; digits : of numbers, None: all, so that they are read back exactly
    """
    arrays = [np.asarray(values) for values in columns.values()]
    with open(path, "w", newline="", encoding="utf-8") as file:
        file.write(f"# {note}\n" if note else "")
        # csv quotes cells with characters of its line terminator, here both \r and \n
        ended = SimpleNamespace(write=lambda line: file.write(line.removesuffix("\r\n") + "\n"))
        writer = csv.writer(ended, lineterminator="\r\n")
        writer.writerow([escape(name) for name in columns])
        for first in range(0, max(map(len, arrays), default=0), BLOCK_ROWS):
            blocks = [values[first : first + BLOCK_ROWS].tolist() for values in arrays]
            writer.writerows(zip(*([_cell(value, digits) for value in block] for block in blocks)))


def escape(text: str) -> str:
    """Return a text for a cell, with a ' before text that would be read as a formula or a comment."""
    return f"'{text}" if ESCAPED.match(text) and not np.isfinite(parse_number(text)) else text


def unescape(text: str) -> str:
    """Return the text of a cell that `escape` wrote."""
    return text[1:] if text.startswith("'") and ESCAPED.match(text) else text


def _cell(value: Any, digits: int | None) -> Any:
    """Return the text of a value in a cell."""
    if isinstance(value, str):
        return escape(value)
    if not isinstance(value, float):
        return value
    if value != value:
        return ""
    return f"{value + 0.0:.{digits}g}" if digits else value


ZONE_KEYS = ("dead", "snow", "pressure")  # keys of [load.zone.NAME] that are columns
PRESSURES = tuple(f"pressure_{axis}" for axis in AXES)  # components of a pressure [x, y, z]
COLUMNS = {  # columns of the loads of each kind of row
    "node": tuple(f"load_{axis}" for axis in AXES),
    "element": tuple(f"line_{axis}" for axis in AXES),
    "zone": (*ZONE_KEYS, *PRESSURES),
}
UNITS = {"node": "N", "element": "N/m", "zone": "N/m2"}  # of these columns; m of unstressed length


def open_load_table(path: Path) -> tuple[Table, str]:
    """Open a table of loads; return it and what its rows name: node, element or zone. Raises InputError."""
    known = (*COLUMNS, *(name for columns in COLUMNS.values() for name in columns))
    table = Table(path, known, ())
    given = [name for name in known if name in table]
    of_rows = [name for name in COLUMNS if name in table]
    loads = [name for name in given if name not in COLUMNS]
    if len(of_rows) != 1 or not loads or set(loads) - {*COLUMNS[of_rows[0]]}:
        table.wrong(messages.LOAD_COLUMNS(given=", ".join(given) or "none of them"))
        table.finish()
    return table, of_rows[0]


def zone_values(path: Path, zone_rows: dict[str, str]) -> dict[str, Any]:
    """Return the values of a table by names like "load.zone.NAME.snow"; none if it has no zones.

    zone_rows : place of the first row of each zone, which this adds to. Raises InputError.
    """
    table, of_rows = open_load_table(path)
    if of_rows != "zone":
        return {}
    columns = {name: table.numbers(name, unit=UNITS["zone"]).tolist() for name in ZONE_KEYS}
    vectors = table.stacked(PRESSURES, unit=UNITS["zone"])
    if "pressure" in table and np.isfinite(vectors).any():
        table.wrong(messages.EXCLUSIVE(keys=f"columns pressure and {', '.join(PRESSURES)}"))
    table.full("zone")
    values: dict[str, Any] = {}
    first: dict[str, str] = {}
    for row, zone in enumerate(table.words("zone")):
        if first.setdefault(zone, table.at(row)) != table.at(row):
            table.wrong(messages.ZONE_TWICE(row=table.at(row), name=format_value(zone), first=first[zone]))
        zone_rows.setdefault(zone, f"{path}: {table.at(row)}: zone")
        given = {name: column[row] for name, column in columns.items() if np.isfinite(column[row])}
        if np.isfinite(vectors[row]).any():
            given["pressure"] = np.nan_to_num(vectors[row]).tolist()
        for name, value in given.items():
            if not keys_of(LoadZone)[name].fits(value):
                expected, cell = keys_of(LoadZone)[name].expected(), format_value(value)
                table.wrong(messages.INVALID_CELL(row=table.at(row), name=name, cell=cell, expected=expected))
            values[f"load.zone.{zone}.{name}"] = value
    table.finish()
    return values
