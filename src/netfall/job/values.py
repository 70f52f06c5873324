"""Formatting of single values and names of a job for messages."""

import difflib
import json
from collections.abc import Iterable
from typing import Any

MOST_NAMED = 5  # largest number of ids in one message


def format_value(value: object) -> str:
    """Return a value as written in a job file, cut to a readable length."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, str):
        text = json.dumps(value, ensure_ascii=False)
    elif isinstance(value, list):
        text = f"[{', '.join(map(format_value, value))}]"
    else:
        text = repr(value)
    text = " ".join(text.split())
    return text if len(text) <= 80 else text[:77] + "..."


def range_text(low: float | None, high: float | None, unit: str, low_open: bool = False) -> str:
    """Describe a range after "a number": " from 0 to 2 m", " > 0 m", " in m"; low_open : without `low`."""
    end = f" {unit}" if unit else ""
    if low is None and high is None:
        return f" in {unit}" if unit else ""
    if low is not None and high is not None and not low_open:
        return f" from {low:g} to {high:g}{end}"
    bounds = [] if low is None else [f"{'>' if low_open else '>='} {low:g}"]
    return " " + " and ".join(bounds + ([] if high is None else [f"<= {high:g}"])) + end


def suggest(word: str, known: Iterable[str]) -> str:
    """Suggest the nearest known word, or list all of them."""
    known = sorted(known)
    matches = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f'did you mean "{matches[0]}"?' if matches else "known: " + ", ".join(known)


def format_list(ids: Any, most: int = MOST_NAMED) -> str:
    """List the first few ids."""
    return ", ".join(map(str, ids[:most])) + (", ..." if len(ids) > most else "")


def counted(what: str, ids: Any) -> str:
    """Return the number of things and the first few of their ids: "3 nodes (4, 7, 9)", "node 4"."""
    ids = list(dict.fromkeys(ids.tolist()))  # parts of a subdivided element share its id
    return f"{what} {ids[0]}" if len(ids) == 1 else f"{len(ids)} {what}s ({format_list(ids)})"
