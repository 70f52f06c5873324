"""Words of a report in Markdown: tables, forces with their unit."""

import numpy as np

MOST_LISTED = 15  # rows of a list; the rest is in the tables


def force(N: float) -> str:
    """A force with its unit."""
    return f"{N / 1e3:.5g} kN" if np.isfinite(N) else "none"


def as_table(header: list[str], lines: list[list]) -> list[str]:
    """A table of Markdown."""
    every = [header, ["---"] * len(header), *lines]
    return ["| " + " | ".join(str(cell).replace("|", "/") for cell in line) + " |" for line in every]


def more(lines, where: str) -> list[str]:
    """What is said below a list that was cut; where : the table that has all."""
    return ["", f"and {len(lines) - MOST_LISTED} more ({where})"] if len(lines) > MOST_LISTED else []


def share(value: float) -> str:
    """A utilisation; empty where there is none."""
    return f"{value:.3f}" if np.isfinite(value) else ""


def picture(words: str, name: str) -> list[str]:
    """A picture that lies beside the page."""
    return ["", f"![{words}]({name})"]
