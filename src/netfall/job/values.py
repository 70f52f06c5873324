"""Single values of a job file: what fits a key, and how a value or a name is told in a message."""

import difflib
import json
import math

from netfall.job.keys import Key

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


def _is_number(value) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def _is_whole(value) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def fits(key: Key, value) -> bool:
    """Whether a value is what the key's row of the table allows."""
    number = lambda v: _is_number(v) and _in_range(key, v)
    if key.kind in ("text", "path"):
        return isinstance(value, str) and (value != "" or key.name == "title") and "\x00" not in value
    if key.kind == "choice":
        return isinstance(value, str) and value in key.choices
    if key.kind == "flag":
        return isinstance(value, bool)
    if key.kind == "name":
        return isinstance(value, str) and value not in ("", ".", "..") and not set(value) & set("/\x00")
    if key.kind == "loads":
        return isinstance(value, dict)
    if key.kind in ("points", "polygon"):
        return (
            isinstance(value, list)
            and all(isinstance(p, list) and len(p) == 2 and all(map(number, p)) for p in value)
            and (key.kind == "points" or len(value) >= 3)
        )
    if key.kind == "places":
        place = lambda v: isinstance(v, list) and len(v) in (2, 3) and all(map(number, v))
        return isinstance(value, list) and all(_is_whole(v) or place(v) for v in value)
    if key.kind == "integers":
        return isinstance(value, list) and value != [] and all(map(_is_whole, value))
    if key.kind == "words":
        return isinstance(value, list) and value != [] and all(isinstance(v, str) and v for v in value)
    if key.kind == "pressure" and number(value):
        return True
    if key.kind in ("vector", "pressure"):
        return isinstance(value, list) and len(value) == 3 and all(map(number, value))
    if value in key.also:
        return True
    if key.kind == "integer" and not isinstance(value, int):
        return False
    return number(value)


def _in_range(key: Key, value) -> bool:
    above = key.low is None or value > key.low or (value == key.low and not key.low_open)
    below = key.high is None or value < key.high or (value == key.high and not key.high_open)
    return above and below


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
