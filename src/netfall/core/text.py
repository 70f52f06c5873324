"""Values in JSON, and tables that the code contains as text."""

import json
import math
from typing import Any

import numpy as np


def json_text(value: Any) -> str:
    """Return a value as JSON. Numbers and arrays of numpy are allowed; nan and infinity are null."""
    return json.dumps(_plain(value), indent=2, allow_nan=False)


def _plain(value: Any) -> Any:
    """Return a value with the numbers and arrays of numpy as types of JSON; nan and infinity are null."""
    if isinstance(value, dict):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def table_rows(text: str) -> list[list[str]]:
    """Return the cells of each row; an indented line continues the last cell of the row above."""
    rows: list[str] = []
    for line in filter(None, text.split("\n")):
        if line.startswith(" "):
            rows[-1] += " " + line.strip()
        else:
            rows.append(line)
    return [[cell.strip() for cell in row.split("|")] for row in rows]
