"""Single values of a job file: how a value or a name stands in a message."""

import difflib
import json

MOST_NAMED = 5  # ids in one message


def shown(value) -> str:
    """A value as it would stand in the job file, cut to a readable length."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, str):
        text = json.dumps(value, ensure_ascii=False)
    else:
        text = repr(value)
    text = " ".join(text.split())
    return text if len(text) <= 80 else text[:77] + "..."


def nearest(word: str, known) -> str:
    """Advice that names the nearest known word, or all of them."""
    known = sorted(known)
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f'did you mean "{close[0]}"?' if close else "known: " + ", ".join(known)


def listed(ids) -> str:
    """Ids in words, the first few of them."""
    return ", ".join(map(str, ids[:MOST_NAMED])) + (", ..." if len(ids) > MOST_NAMED else "")


def counted(what: str, ids) -> str:
    """Things by their number and the first few of their ids, each once: "3 nodes (4, 7, 9)", "node 4"."""
    ids = list(dict.fromkeys(ids.tolist()))  # the parts of an element that was subdivided share its id
    return f"{what} {ids[0]}" if len(ids) == 1 else f"{len(ids)} {what}s ({listed(ids)})"


def more_of(what: str, count: int) -> list[str]:
    """A line on how many more things there are than are named."""
    return [f"{count - MOST_NAMED} more {what}"] if count > MOST_NAMED else []
