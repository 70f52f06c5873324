"""Text of single values and names of a job in messages."""

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
    else:
        text = repr(value)
    text = " ".join(text.split())
    return text if len(text) <= 80 else text[:77] + "..."


def suggest(word: str, known: Iterable[str]) -> str:
    """Suggest the nearest known word, or list all of them."""
    known = sorted(known)
    matches = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f'did you mean "{matches[0]}"?' if matches else "known: " + ", ".join(known)


def format_list(ids: Any) -> str:
    """List the first few ids."""
    return ", ".join(map(str, ids[:MOST_NAMED])) + (", ..." if len(ids) > MOST_NAMED else "")


def counted(what: str, ids: Any) -> str:
    """Return the number of things and the first few of their ids: "3 nodes (4, 7, 9)", "node 4"."""
    ids = list(dict.fromkeys(ids.tolist()))  # parts of a subdivided element share its id
    return f"{what} {ids[0]}" if len(ids) == 1 else f"{len(ids)} {what}s ({format_list(ids)})"


def more_lines(what: str, count: int) -> list[str]:
    """Return a line with the number of things beyond the named ones."""
    return [f"{count - MOST_NAMED} more {what}"] if count > MOST_NAMED else []
