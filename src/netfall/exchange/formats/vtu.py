"""Export of a result as an UnstructuredGrid of lines, for ParaView."""

from pathlib import Path

import numpy as np

from netfall.exchange.state import MARK, ExportState, held_axes
from netfall.exchange.vtu import write_vtu
from netfall.results.locks import whole
from netfall.results.reader import Result

CONTENTS = ("groups", "ids", "tensions", "unstressed lengths", "axes of supports")
FOLDER, STATIC_ONLY, UNITS = False, False, False


def write(result: Result, state: ExportState, path: Path, unit: str) -> list[str]:
    """Write the grid."""
    names, present = sorted(set(state.group.tolist())), ~state.out()
    held = held_axes(result, state)
    points = {
        "node_id": state.node_id,
        "fixed": held.all(1).astype(np.uint8),
        "held": held.astype(np.uint8),
        "displacement": state.displacement,
    }
    cells = {
        "element_id": state.element_id,
        "group": np.array([names.index(name) for name in state.group.tolist()], np.int32),
        "tension": state.tension,
        **state.unstressed(),
        "broken": state.broken.astype(np.uint8),
    }
    cells = {name: values[present] for name, values in cells.items()}
    with whole(path) as temporary:
        write_vtu(temporary, state.position, state.ends[present], points, cells, MARK)
    groups = ", ".join(f"{k} {name or '(none)'}" for k, name in enumerate(names))
    lines = [f"{path}: {state.name}, {len(state.position)} points, {present.sum()} lines; groups: {groups}"]
    return lines + state.removed_element_lines("lines")
