"""The plain lines of a DXF text: most of what a net is drawn with, and read here by columns."""

import numpy as np

PLACES = {10: (0, 0), 20: (0, 1), 30: (0, 2), 11: (1, 0), 21: (1, 1), 31: (1, 2)}  # group code: end, axis
LAYER, PAPER, INVISIBLE = 8, 67, 60


def split_lines(text: str) -> tuple[np.ndarray, list[str], str]:
    """The LINE entities of the model space, their ends (k, 2, 3) and layers, and the text without them.

    A DXF file is pairs of lines, a group code and a value; an entity begins with the code 0. (DXF Reference,
    Autodesk, "ENTITIES section".)
    """
    words = text.split("\n")
    words = words[: len(words) // 2 * 2]
    codes = np.array([int(word) for word in words[0::2]], np.int64)
    values = np.array(words[1::2], dtype=object)
    starts = np.flatnonzero(codes == 0)
    inside = _entities(codes, values, starts)
    kinds = np.array([value.strip() == "LINE" for value in values[starts].tolist()], bool) & inside
    entity = np.searchsorted(starts, np.arange(len(codes)), "right") - 1  # of each pair
    hidden = np.isin(codes, (PAPER, INVISIBLE)) & (entity >= 0)
    hidden[hidden] = [int(value) != 0 for value in values[hidden].tolist()]
    kinds[entity[hidden]] = False
    of_line = (entity >= 0) & kinds[entity]
    number = np.cumsum(kinds) - 1
    lines = np.zeros((int(kinds.sum()), 2, 3))
    for code, (end, axis) in PLACES.items():
        here = of_line & (codes == code)
        lines[number[entity[here]], end, axis] = values[here].astype(float)
    layers = np.full(len(lines), "0", dtype=object)
    here = of_line & (codes == LAYER)
    layers[number[entity[here]]] = values[here]
    return lines, layers.tolist(), _without(words, of_line)


def _entities(codes: np.ndarray, values: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Which of the starts stand in the section ENTITIES."""
    inside = np.zeros(len(starts), bool)
    named = np.flatnonzero((codes == 2) & (values == "ENTITIES"))
    if len(named):
        ends = starts[np.array([value.strip() == "ENDSEC" for value in values[starts].tolist()], bool)]
        end = ends[ends > named[0]]
        inside = (starts > named[0]) & (starts < (end[0] if len(end) else len(codes)))
    return inside


def _without(words: list[str], of_line: np.ndarray) -> str:
    kept = np.repeat(~of_line, 2)
    return "\n".join(np.array(words, dtype=object)[kept].tolist()) + "\n"
