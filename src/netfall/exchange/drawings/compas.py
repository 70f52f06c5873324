"""Import of COMPAS JSON: graphs, networks and meshes of versions 1 and 2, lines and polylines."""

import json
import re
import reprlib
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from netfall.core.errors import InputError
from netfall.exchange import messages
from netfall.exchange.drawings.drawing import METRES, Drawing, alike

SUPPORTS = ("is_anchor", "is_fixed", "is_support", "fixed", "anchor", "support")
GROUPS = ("group", "layer", "category")
SHOWN = ("visible", "is_visible", "show", "is_edge", "_is_edge")  # of an edge; false: it is not a cable
HIDDEN = ("hidden", "is_hidden")
FORCE_DENSITIES = ("force_density", "q")
LOADS = ("px", "py", "pz")


def read_compas(path: Path, supports: list[str]) -> Drawing:
    """Read the edges of a COMPAS file, in its unit; groups are layers, and supports is not used.

    Raises InputError for a file without edges, other errors as in `reading.READERS`.
    """
    objects = _objects(json.loads(path.read_text(encoding="utf-8-sig")))
    edges = [edge for data in objects for edge in _edges(data)]
    supports_of_file = [support for data in objects for support in _supports(data)]
    loaded = sum(any(map(values.get, LOADS)) for data in objects for values in _nodes(data).values())
    attributes = [data["attributes"] for data in objects if isinstance(data.get("attributes"), dict)]
    units = sorted({each["unit"] for each in attributes if isinstance(each.get("unit"), str)})
    if len(units) > 1:
        raise ValueError(f"attributes: expected one unit, not {' and '.join(units)}")
    if not edges:
        raise InputError(messages.NO_EDGES(path=path))
    hidden = sum(edge["hidden"] for edge in edges)
    edges = [edge for edge in edges if not edge["hidden"]]
    names = sorted({edge["group"] for edge in edges})
    q = np.array([edge["q"] for edge in edges], float)
    keys = [edge["keys"] for edge in edges]
    has_ids = len(objects) == 1 and all(isinstance(key, int) for pair in keys for key in pair)
    unit = units[0] if units else None
    return Drawing(
        lines=np.array([edge["ends"] for edge in edges], float).reshape(-1, 2, 3),
        layer=np.array([names.index(edge["group"]) for edge in edges], np.int64),
        layers=names,
        held=np.array([point for point, _ in supports_of_file], float).reshape(-1, 3),
        held_axes=np.array([axes for _, axes in supports_of_file], bool).reshape(-1, 3),
        keys=np.array(keys, np.int64) if has_ids else None,
        force_density=q if any(edge["q"] is not None for edge in edges) else None,
        unit=unit if unit in METRES else None,
        unit_from="its attributes" if unit in METRES else f'"{unit}" in its attributes' if unit else "",
        read=[f"{len(edges)} edges", *(f"groups {line}" for line in alike(names))],
        left_out=[f"{hidden} edges, which are hidden"] * (hidden > 0)
        + [f"{', '.join(LOADS)} of {loaded} nodes: give load_x, load_y, load_z in nodes.csv"] * (loaded > 0),
    )


def _objects(document: Any) -> list[dict[str, Any]]:
    """Collect the data of graphs, meshes and lines anywhere in a document."""
    if isinstance(document, list):
        return [data for item in document for data in _objects(item)]
    if not isinstance(document, dict):
        return []
    pairs = (("node", "edge"), ("face",), ("start", "end"), ("points",))  # keys of graphs, meshes, lines
    if any(document.keys() >= {*keys} for keys in pairs):
        return [document]
    return [data for item in document.values() for data in _objects(item)]


def _default(data: dict[str, Any], entity: str) -> dict[str, Any]:
    """Return the default attributes of nodes, vertices or edges, which have short names in version 1."""
    name = f"default_{entity}_attributes"
    return _expect(data.get(name) or data.get(f"d{entity[0]}a") or {}, dict, name)


def _expect(value: Any, kind: Any, place: str, meaning: str = "a JSON object") -> Any:
    """Return a value of a type. Raises ValueError with the place if the type is another."""
    if not isinstance(value, kind):
        raise ValueError(f"{place}: expected {meaning}, not {reprlib.repr(value)}")
    return value


def _point(values: Any, place: str) -> list[float]:
    """Return the three coordinates of a point. Raises ValueError with the place for other values."""
    try:
        x, y, z = map(float, values)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{place}: expected three coordinates, not {reprlib.repr(values)}") from None
    return [x, y, z]


def _nodes(data: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the attributes of the nodes or vertices by their keys, with their coordinates as "point"."""
    if "points" in data or "start" in data:  # a line has no keys
        return {}
    entity = "node" if "node" in data else "vertex"
    default, nodes = _default(data, entity), {}
    for key, values in _expect(data.get(entity), dict, entity).items():
        place = f"{entity} {key}"
        attributes = default | _expect(values or {}, dict, place)
        point = _point([attributes.get(axis, 0.0) for axis in "xyz"], place)
        nodes[key] = attributes | {"point": point}
    return nodes


def _edges(data: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the ends, keys, group and force density of each edge, and whether it is hidden."""
    if "points" in data or "start" in data:
        points = data["points"] if "points" in data else [data["start"], data["end"]]
        _expect(points, list, "points", "a list")
        ends = pairwise(_point(point, "a point of a line") for point in points)
        return [_edge(pair, (None, None), {}, "a line") for pair in ends]
    nodes = _nodes(data)
    if "edge" in data and "node" in data:
        pairs: dict[Any, Any] = {
            (a, b): values or {}
            for a, ends in _expect(data["edge"], dict, "edge").items()
            for b, values in _expect(ends, dict, f"edge {a}").items()
        }
    else:
        pairs = _sides(data, list(nodes))
    default = _default(data, "edge")
    edges = []
    for (a, b), values in pairs.items():
        place = f"edge {a}-{b}"
        if not (a in nodes and b in nodes):
            raise ValueError(f"{place}: there is no node {a if b in nodes else b}")
        ends = (nodes[a]["point"], nodes[b]["point"])
        edges.append(_edge(ends, (_key(a), _key(b)), default | _expect(values, dict, place), place))
    return edges


def _edge(ends: Any, keys: Any, values: dict[str, Any], place: str) -> dict[str, Any]:
    """Return an edge as a record of its ends, keys, group, force density and visibility."""
    group = next((str(values[name]) for name in GROUPS if values.get(name)), "cables")
    numbers = {
        name: _number(values.get(name), f"{place}, {name}") for name in (*FORCE_DENSITIES, *SHOWN, *HIDDEN)
    }
    q = next((numbers[name] for name in FORCE_DENSITIES if numbers[name] is not None), None)
    hidden = any(numbers[name] in (False, 0) for name in SHOWN) or any(numbers[name] for name in HIDDEN)
    return {"ends": ends, "keys": keys, "group": group, "q": q, "hidden": hidden}


def _number(value: Any, place: str) -> Any:
    """Return a number or truth value, or None. Raises ValueError with the place for other values."""
    return _expect(value, (int, float, type(None)), place, "a number, true or false")


def _sides(data: dict[str, Any], keys: list[str]) -> dict[Any, Any]:
    """Return the edges of a mesh by the keys of their vertices, with their attributes."""
    row, sides = {key: k for k, key in enumerate(keys)}, set()
    for name, face in _expect(data["face"], dict, "face").items():
        vertices = [str(key) for key in _expect(face or None, list, f"face {name}", "a list of vertices")]
        if unknown := [key for key in vertices if key not in row]:
            raise ValueError(f"face {name}: there is no vertex {unknown[0]}")
        corners = [row[key] for key in vertices]
        sides |= {(min(side), max(side)) for side in zip(corners, [*corners[1:], corners[0]])}
    edgedata = _expect(data.get("edgedata") or {}, dict, "edgedata")
    attributes = {re.sub(r"[() ]", "", name).replace(",", "-"): values for name, values in edgedata.items()}
    pairs = [(keys[a], keys[b]) for a, b in sorted(sides)]
    return {(a, b): attributes.get(f"{a}-{b}") or attributes.get(f"{b}-{a}") or {} for a, b in pairs}


def _key(text: str) -> Any:
    """Convert a key to an integer if it is one that fits 64 bits."""
    try:
        return int(np.int64(text))
    except (ValueError, OverflowError):
        return text


def _supports(data: dict[str, Any]) -> list[tuple[list[float], list[bool]]]:
    """Return the coordinates of supported nodes, and the axes along which they are held."""
    supports = []
    for key, values in _nodes(data).items():
        held = [False] * 3
        for name in SUPPORTS:
            flag = values.get(name)
            axes = flag if isinstance(flag, list) else [flag] * 3
            if len(axes) != 3:
                raise ValueError(
                    f"node {key}, {name}: expected one flag or three (x, y, z), not {flag!r:.60}"
                )
            held = [a or bool(_number(axis, f"node {key}, {name}")) for a, axis in zip(held, axes)]
        if any(held):
            supports.append((values["point"], held))
    return supports
