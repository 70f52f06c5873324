"""Markdown elements of a report's page; text from jobs, tables and results is escaped."""

import re
from collections.abc import Iterable, Sequence

import numpy as np

from netfall.core.messages import kN
from netfall.core.progress import one_line

MOST_LISTED = 15  # largest number of rows of a list on the page; the tables have all rows
INLINE = re.compile(r"[\\`*\[|~$]|(?<!\S)#|<(?=[A-Za-z/!?])|&(?=[#\w]+;)|(?<![^\W_])_|_(?![^\W_])")
AT_START = re.compile(r">|[-+](?!\S)|-+$|=+$|\d+(?=[.)](?!\S))")


class Markup(str):
    """Text in Markdown; any other text is plain, and escaped when a page is assembled."""


def escaped(text: object) -> Markup:
    """Escape a plain text for Markdown, in one line; `Markup` is returned unchanged."""
    if isinstance(text, Markup):
        return text
    line = INLINE.sub(r"\\\g<0>", one_line(str(text)))
    start = AT_START.match(line)
    if start is None:
        return Markup(line)
    cut = start.end() if start[0].isdigit() else 0
    return Markup(f"{line[:cut]}\\{line[cut:]}")


def markup(template: str, *values: object, **named: object) -> Markup:
    """Fill a Markdown template with values, which are escaped."""
    return Markup(
        template.format(*map(escaped, values), **{name: escaped(value) for name, value in named.items()})
    )


def heading(level: int, text: str) -> Markup:
    """Return a heading."""
    return markup("{} {}", Markup("#" * level), text)


def bold(text: str) -> Markup:
    """Return a text in bold type."""
    return markup("**{}**", text)


def item(text: str) -> Markup:
    """Return an item of a list."""
    return markup("- {}", text)


def code(text: str) -> Markup:
    """Return a text as inline code, between more consecutive backticks than it contains."""
    line = one_line(text)
    fence = "`" * (1 + max(map(len, re.findall("`+", line)), default=0))
    space = " " if "`" in line else ""
    return Markup(f"{fence}{space}{line}{space}{fence}")


def page(lines: list[str]) -> str:
    """Return the text of a page."""
    return "\n".join(map(escaped, lines)) + "\n"


def force(N: float) -> str:
    """Return a force with its unit."""
    return kN(N, digits=5) if np.isfinite(N) else "none"


def moment(M: float) -> str:
    """Return a bending moment with its unit."""
    return f"{M / 1e3:.5g} kN m" if np.isfinite(M) else "none"


def plain_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table whose cells are Markdown."""
    head, *lines = (f"| {' | '.join(cells)} |" for cells in (header, *rows))
    return [head, "|" + "---|" * len(header), *lines]


def as_table(header: list[str], lines: Sequence[Sequence[object]], where: str = "") -> list[str]:
    """Return the lines of a table; where : name of the complete table, if a long table is cut."""
    cells = [list(map(escaped, line)) for line in lines[: MOST_LISTED if where else None]]
    table: list[str] = list(map(Markup, plain_table(list(map(escaped, header)), cells)))
    return [*table, "", f"and {len(lines) - len(cells)} more ({where})"] if len(cells) < len(lines) else table


def share(value: float) -> str:
    """Format a utilisation; empty if there is none."""
    return f"{value:.3f}" if np.isfinite(value) else ""


def picture(caption: str, name: str) -> list[str]:
    """Return the lines of a picture in the folder of the page."""
    return ["", markup("![{}]({})", caption, Markup(name))]
