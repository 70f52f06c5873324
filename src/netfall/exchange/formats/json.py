"""Export of a result as a COMPAS 2 Graph, which `compas.json_load` reads: nodes and edges with attributes."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from netfall.exchange import messages
from netfall.exchange.state import MARK, ExportState, held_axes, lengths
from netfall.job.csv_table import AXES
from netfall.results.locks import whole
from netfall.results.reader import Result

CONTENTS = ("groups", "ids", "tensions", "unstressed lengths", "axes of supports")
FOLDER, STATIC_ONLY, UNITS = False, False, False


def write(result: Result, state: ExportState, path: Path, unit: str) -> list[str]:
    """Write the Graph."""
    length, present = lengths(state.position, state.ends), ~state.out()
    force_density = np.divide(state.tension, length, out=np.zeros_like(length), where=length > 0)
    columns = (c.tolist() for c in (state.node_id, state.position, held_axes(result, state)))
    node = {
        str(number): {**dict(zip(AXES, x)), "is_anchor": all(fixed), "fixed": fixed}
        for number, x, fixed in zip(*columns, strict=True)
    }
    edge: dict[str, dict[str, Any]] = {number: {} for number in node}
    doubled, unstressed = 0, state.unstressed()
    for e in np.flatnonzero(present).tolist():
        a, b = state.node_id[state.ends[e]].tolist()
        doubled += str(b) in edge[str(a)] or str(a) in edge[str(b)]
        edge[str(a)][str(b)] = {
            "id": int(state.element_id[e]),
            "group": str(state.group[e]),
            "tension": float(state.tension[e]),
            "q": float(force_density[e]),
            **{name: float(values[e]) for name, values in unstressed.items()},
            "broken": bool(state.broken[e]),
        }
    data = {
        "attributes": {"name": result.title, "state": state.name, "made": MARK, "unit": "m"},
        "default_node_attributes": {"x": 0.0, "y": 0.0, "z": 0.0, "is_anchor": False},
        "default_edge_attributes": {},
        "node": node,
        "edge": edge,
        "max_node": int(state.node_id.max()),
    }
    with whole(path) as temporary:
        temporary.write_text(
            json.dumps({"dtype": "compas.datastructures/Graph", "data": data}), encoding="utf-8"
        )
    lines = [f"{path}: {state.name}, {len(node)} nodes, {present.sum()} edges; m, N, N/m"]
    lines += state.removed_element_lines("edges")
    if doubled:
        lines.append(messages.DOUBLE_EDGES(path=path, count=doubled))
    return lines
