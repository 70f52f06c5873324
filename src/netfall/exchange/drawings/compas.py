"""Import of COMPAS JSON: graphs, networks and meshes of versions 1 and 2, lines and polylines."""

import ast
import json
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from netfall.core.errors import InputError
from netfall.exchange import messages
from netfall.exchange.drawings.drawing import Drawing, alike, edges_of, is_among

SUPPORTS = ("is_anchor", "is_fixed", "is_support", "fixed", "anchor", "support")
GROUPS = ("group", "layer", "category")
VISIBILITY_ATTRIBUTES = (
    "visible",
    "is_visible",
    "show",
    "is_edge",
    "_is_edge",
)  # attributes of an edge; false: the edge is no cable
HIDDEN_KEYS = ("hidden", "is_hidden")
FORCE_DENSITIES = ("force_density", "q")


def read_compas(path: Path, supports: list[str], layers: list[str] | None) -> Drawing:
    """Read the edges of a COMPAS file, in its unit.

    supports, layers : as in `read_dxf`; layers are groups here

    Raises InputError for a file without edges.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(
            messages.UNREADABLE_DRAWING(
                path=path, reason=error.strerror or error, kind="a JSON file of COMPAS"
            )
        ) from None
    except ValueError as error:
        raise InputError(messages.DAMAGED_DRAWING(path=path, kind="a JSON file", error=error)) from None
    objects = _objects(document)
    edges = [edge for data in objects for edge in _edges(data)]
    if not edges:
        raise InputError(messages.NO_EDGES(path=path))
    hidden = sum(edge["hidden"] for edge in edges)
    edges = [edge for edge in edges if not edge["hidden"]]
    edges = [edge for edge in edges if layers is None or is_among(edge["group"], (*layers, *supports))]
    names = sorted({edge["group"] for edge in edges})
    held, in_part = (list(chain(*points)) for points in zip(*map(_supported_points, objects)))
    q = np.array([edge["q"] for edge in edges], float)
    keys = [edge["keys"] for edge in edges]
    has_ids = len(objects) == 1 and all(isinstance(key, int) for pair in keys for key in pair)
    return Drawing(
        lines=np.array([edge["ends"] for edge in edges], float).reshape(-1, 2, 3),
        layer=np.array([names.index(edge["group"]) for edge in edges], np.int64),
        layers=names,
        held=np.array(held, float).reshape(-1, 3),
        in_part=np.array(in_part, float).reshape(-1, 3),
        keys=np.array(keys, np.int64) if has_ids else None,
        columns={"force_density": q} if any(edge["q"] is not None for edge in edges) else {},
        unit=next((data["attributes"]["unit"] for data in objects if _has_unit(data)), None),
        unit_from="its attributes",
        read=[f"{len(edges)} edges", *(f"groups {line}" for line in alike(names))],
        left_out=[f"{hidden} edges, which are hidden"] if hidden else [],
    )


def _has_unit(data: dict[str, Any]) -> bool:
    """Whether an object names its unit."""
    return isinstance(data.get("attributes"), dict) and isinstance(data["attributes"].get("unit"), str)


def _objects(document: Any) -> list[dict[str, Any]]:
    """Collect the data of graphs, meshes and lines anywhere in a document."""
    if isinstance(document, list):
        return [data for item in document for data in _objects(item)]
    if not isinstance(document, dict):
        return []
    if ("node" in document and "edge" in document) or "face" in document:
        return [document]
    if ("start" in document and "end" in document) or "points" in document:
        return [document]
    return [data for item in document.values() for data in _objects(item)]


def _default(data: dict[str, Any], entity: str) -> dict[str, Any]:
    """Return the default attributes of nodes, vertices or edges; version 1 has short names for them."""
    return data.get(f"default_{entity}_attributes") or data.get(f"d{entity[0]}a") or {}


def _coordinates(data: dict[str, Any]) -> dict[str, Any]:
    """Return the coordinates of the nodes or vertices by their keys."""
    entity = "node" if "node" in data else "vertex"
    default = _default(data, entity)
    return {
        key: [(default | values).get(axis, 0.0) for axis in "xyz"] for key, values in data[entity].items()
    }


def _edges(data: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the ends, keys, group and force density of each edge, and whether it is hidden."""
    if "points" in data or "start" in data:
        points = data["points"] if "points" in data else [data["start"], data["end"]]
        return [_edge((a, b), (None, None), {}) for a, b in pairwise(points)]
    positions = _coordinates(data)
    if "edge" in data and "node" in data:
        pairs: dict[Any, Any] = {
            (a, b): values or {} for a, ends in data["edge"].items() for b, values in ends.items()
        }
    else:
        pairs = _sides(data)
    default = _default(data, "edge")
    return [
        _edge((positions[a], positions[b]), (_key(a), _key(b)), default | values)
        for (a, b), values in pairs.items()
    ]


def _edge(ends: Any, keys: Any, values: dict[str, Any]) -> dict[str, Any]:
    """Return an edge as a record of its ends, keys, group, force density and visibility."""
    group = next((str(values[name]) for name in GROUPS if values.get(name)), "cables")
    force_densities = (values[name] for name in FORCE_DENSITIES if isinstance(values.get(name), (int, float)))
    hidden = any(values.get(name, True) in (False, 0) for name in VISIBILITY_ATTRIBUTES)
    hidden = hidden or any(values.get(name, False) in (True, 1) for name in HIDDEN_KEYS)
    return {"ends": ends, "keys": keys, "group": group, "q": next(force_densities, None), "hidden": hidden}


def _sides(data: dict[str, Any]) -> dict[Any, Any]:
    """Return the edges of a mesh by the keys of their vertices, with their attributes."""
    keys = list(data["vertex"])
    row = {key: k for k, key in enumerate(keys)}
    faces = [face if isinstance(face, list) else list(face) for face in data["face"].values()]
    sides, _ = edges_of([[row[str(key)] for key in face] for face in faces])
    attributes = {}
    for name, values in (data.get("edgedata") or {}).items():
        pair = ast.literal_eval(name) if name.startswith("(") else name.split("-")
        attributes[frozenset(str(key) for key in pair)] = values or {}
    return {(keys[a], keys[b]): attributes.get(frozenset((keys[a], keys[b])), {}) for a, b in sides.tolist()}


def _key(text: str) -> Any:
    """Convert a key to an integer if it is one."""
    try:
        return int(text)
    except ValueError:
        return text


def _supported_points(data: dict[str, Any]) -> tuple[list[Any], list[Any]]:
    """Return the coordinates of supported nodes, and of those supported along some axes alone."""
    held, in_part = [], []
    if "node" in data or "vertex" in data:
        positions, entity = _coordinates(data), "node" if "node" in data else "vertex"
        default = _default(data, entity)
        for key, values in data[entity].items():
            flags = [np.array({**default, **values}.get(name, False), bool) for name in SUPPORTS]
            if any(axes.size and axes.all() for axes in flags):
                held.append(positions[key])
            elif any(map(np.any, flags)):
                in_part.append(positions[key])
    return held, in_part
