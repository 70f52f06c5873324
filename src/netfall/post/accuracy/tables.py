"""Output of measurements: tables as text and CSV, plots of two panels."""

import csv
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from netfall.job.csv_table import escape_formula
from netfall.results.locks import whole


def as_text(head: list[str], rows: list[list[str]]) -> list[str]:
    """Return a table in Markdown from the names of the columns and a list of cells for each row."""
    return [_line(head), "|" + "---|" * len(head), *map(_line, rows)]


def _line(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def write_csv(rows: list[dict], path: Path) -> Path:
    """Write rows with the names of their columns."""
    with whole(path) as place, open(place, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(_cells(rows[0]))
        writer.writerows(_cells(row.values()) for row in rows)
    return path


def _cells(values: Iterable) -> list:
    """Return values as CSV cells; a spreadsheet must not take a text for a formula."""
    return [escape_formula(value) if isinstance(value, str) else value for value in values]


@contextmanager
def two_panels(path: Path, width: float, height: float, **more) -> Iterator[tuple]:
    """Yield a figure and its two axes side by side, and write it at the end of the block.

    width, height : inches; more : as of `open_charts`
    """
    from netfall.post.plots.canvas import open_charts, save  # a slow import, only needed here

    figure, ((left, right),) = open_charts(1, 2, width, height, **more)
    yield figure, left, right
    save(figure, path)
