"""Rows of the validation table: netfall's value and a reference value, with a tolerance from theory."""

import csv
import math
import re
from collections import Counter
from dataclasses import astuple, dataclass, fields
from pathlib import Path


@dataclass(frozen=True)
class Row:
    """One comparison. difference and within: relative values, unless a unit is given."""

    theme: str
    case: str
    source: str
    ours: str
    theirs: str
    difference: float
    within: float
    unit: str
    because: str

    @property
    def kind(self) -> str:
        """Return the kind of reference, according to the words of its source."""
        if re.search("OpenSees|LAMMPS|PyConTurb|PETSc", self.source):
            return "another program"
        return "a publication" if re.search(r"\b(18|19|20)\d\d\b|published|paper", self.source) else "theory"

    @property
    def met(self) -> bool:
        """Return whether the difference is within the tolerance."""
        return abs(self.difference) <= self.within


@dataclass(frozen=True)
class Comparison:
    """Case and source of comparisons, for rows of a table."""

    table: "Table"
    theme: str
    case: str
    source: str

    def figures(
        self,
        ours: float,
        theirs: float,
        within: float,
        because: str,
        unit: str = "",
        scale: float | None = None,
    ) -> None:
        """Add the row and assert it.

        unit : of the figures; difference : (ours - theirs) / scale; scale : |theirs| unless given, needed
            where theirs is zero (1: absolute, with the unit)
        """
        ours, theirs = float(ours), float(theirs)
        with_unit = lambda value: f"{value:.6g}" + (f" {unit}" if unit else "")
        words = self.theme, self.case, self.source, with_unit(ours), with_unit(theirs)
        difference = float((ours - theirs) / (abs(theirs) if scale is None else scale))
        self.table.add(Row(*words, difference, float(within), unit if scale == 1.0 else "", because))

    def error(self, size: float, within: float, because: str, unit: str = "", scale: float = 1.0) -> None:
        """Add and assert the row of an error: a share of a scale; 1: absolute, with the unit."""
        self.figures(size, 0.0, within, because, unit, scale)


class Table:
    """Rows in the order in which the tests made them."""

    def __init__(self, rows: list[list] = ()):
        """rows : as `plain` gives them"""
        self.rows = [Row(*row) for row in rows]

    def plain(self) -> list[list]:
        """Return the rows as lists of words and numbers, which another process can read."""
        return [list(astuple(row)) for row in self.rows]

    def add(self, row: Row) -> None:
        """Add a row and assert it."""
        self.rows.append(row)
        assert math.isfinite(row.difference) and row.met, row

    def write(self, path: Path) -> None:
        """Write the table as CSV; print the number of rows by kind."""
        print(
            "\ncomparisons with", *(f"{kind}: {n};" for kind, n in Counter(r.kind for r in self.rows).items())
        )
        with path.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([[field.name for field in fields(Row)], *self.plain()])
