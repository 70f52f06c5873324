"""Output of measurements: tables as text and CSV, plots of two panels."""

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from netfall.job.table import guarded
from netfall.write.locks import whole


def as_text(head: list[str], rows: list[list[str]]) -> list[str]:
    """Return a table in Markdown from the names of the columns and a list of cells for each row."""
    line = lambda cells: f"| {' | '.join(cells)} |"
    return [line(head), "|" + "---|" * len(head), *map(line, rows)]


def write_csv(rows: list[dict], path: Path) -> Path:
    """Write rows with the names of their columns."""
    cells = lambda values: [guarded(each) if isinstance(each, str) else each for each in values]
    with whole(path) as place, open(place, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(cells(rows[0]))
        writer.writerows(cells(row.values()) for row in rows)
    return path


@contextmanager
def two_panels(path: Path, width: float, height: float, **more) -> Iterator[tuple]:
    """Yield a figure and its two axes side by side, and write it at the end of the block.

    width, height : inches; more : as of `charts`
    """
    from netfall.plots.canvas import charts, save  # a slow import, only needed here

    figure, ((left, right),) = charts(1, 2, width, height, **more)
    yield figure, left, right
    save(figure, path)
