"""`netfall export`: a result in the format that a file's ending names."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from netfall.exchange.lacking import lacking
from netfall.exchange.opensees import write_tcl
from netfall.exchange.state import AXES, MARK, State, lengths, state_of
from netfall.exchange.tables import write_tables
from netfall.exchange.vtu import write_vtu
from netfall.ground.errors import InputError
from netfall.results.file import telling_what_lacks
from netfall.results.result import Result
from netfall.write.locks import whole

COLOURS = (5, 3, 30, 6, 4, 140, 40, 200)  # of AutoCAD's table, for groups in turn
RED = 1


def export(source: Path, target: Path, time: float | None, say: Callable[[str], None]) -> None:
    """Write a result to a file, in the format of its ending. time : [s], None: the form; inf: the last frame

    Raises InputError for another ending, a time that there is not, or a file that is no result.
    """
    writers = {".dxf": _dxf, ".csv": write_tables, ".tcl": write_tcl, ".json": _compas, ".vtu": _vtu}
    write = writers.get(target.suffix.lower(), write_tables if target.suffix == "" else None)
    if write is None:
        raise InputError(f"-o {target}: the ending names the format; expected one of {', '.join(writers)}")
    if not target.parent.is_dir():
        raise InputError(f"-o {target}: the folder {target.parent} does not exist; make it")
    if target.is_dir() != (write is write_tables) and target.exists():
        kind = "a folder" if target.is_dir() else "a file"
        raise InputError(f"-o {target}: is {kind} already; give another name")
    if target.is_file() and MARK.encode() not in target.read_bytes():
        raise InputError(f"-o {target}: exists, and is not what netfall exported; give another name")
    if write is write_tcl and time is not None:
        raise InputError("--time: a .tcl holds an equilibrium, not a state in motion; leave --time out")
    with Result(source) as result, telling_what_lacks(source):
        lines = write(result, state_of(result, time), target)
        if write is not write_tables:
            lines += lacking(result, target.suffix.lower())
    for line in lines:
        say(line)


def _compas(result: Result, state: State, path: Path) -> list[str]:
    """A Graph of COMPAS 2, `compas.json_load` reads it: nodes and edges with their attributes."""
    length, there = lengths(state.position, state.ends), ~state.out()
    force_density = np.divide(state.tension, length, out=np.zeros_like(length), where=length > 0)
    node = {
        str(number): {**dict(zip(AXES, x)), "is_anchor": any(fixed), "fixed": fixed}
        for number, x, fixed in zip(
            state.node_id.tolist(), state.position.tolist(), state.fixed.tolist(), strict=True
        )
    }
    edge: dict[str, dict] = {number: {} for number in node}
    doubled, unstressed = 0, state.unstressed()
    for e in np.flatnonzero(there).tolist():
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
    with whole(path) as place:
        place.write_text(json.dumps({"dtype": "compas.datastructures/Graph", "data": data}), encoding="utf-8")
    told = [f"{path}: {state.name}, {len(node)} nodes, {there.sum()} edges; m, N, N/m"]
    told += state.told_out("edges")
    if doubled:
        told.append(f"note: {doubled} elements join nodes that another one joins: a Graph holds one of them")
    return told


def _vtu(result: Result, state: State, path: Path) -> list[str]:
    """An UnstructuredGrid of lines, for ParaView."""
    names = sorted(set(state.group.tolist()))
    points = {
        "node_id": state.node_id,
        "fixed": state.fixed.any(1).astype(np.uint8),
        "displacement": state.displacement,
    }
    cells = {
        "element_id": state.element_id,
        "group": np.array([names.index(name) for name in state.group.tolist()], np.int32),
        "tension": state.tension,
        **state.unstressed(),
        "broken": state.broken.astype(np.uint8),
    }
    with whole(path) as place:
        write_vtu(place, state.position, state.ends, points, cells, MARK)
    groups = ", ".join(f"{k} {name or '(none)'}" for k, name in enumerate(names))
    return [f"{path}: {state.name}, {len(state.position)} points, {len(state.ends)} lines; groups: {groups}"]


def _dxf(result: Result, state: State, path: Path) -> list[str]:
    """Lines in metres, a layer for each group; broken elements and supports on layers of their own."""
    import ezdxf

    drawing = ezdxf.new("R2010", units=ezdxf.units.M)
    space = drawing.modelspace()
    layers = _layers(sorted(set(state.group.tolist())))
    for k, layer in enumerate(layers.values()):
        known = drawing.layers.get(layer) if layer in drawing.layers else drawing.layers.add(layer)
        known.color = COLOURS[k % len(COLOURS)]
    drawing.layers.add("supports", color=RED)
    torn = int((state.broken & ~state.out()).sum())
    if torn:
        drawing.layers.add("broken", color=RED)
    there = ~state.out()
    for (a, b), group, broken in zip(
        state.position[state.ends][there].tolist(),
        state.group[there].tolist(),
        state.broken[there].tolist(),
        strict=True,
    ):
        space.add_line(a, b, dxfattribs={"layer": "broken" if broken else layers[group]})
    for x in state.position[state.fixed.any(1)].tolist():
        space.add_point(x, dxfattribs={"layer": "supports"})
    drawing.header.custom_vars.append("made", MARK)
    with whole(path) as place:
        drawing.saveas(place)
    shown = ", ".join(layers.values())
    broken = f", {torn} on layer broken" if torn else ""
    held = f"{int(state.fixed.any(1).sum())} points on layer supports"
    told = [f"{path}: {state.name}, {there.sum()} lines in m on layers {shown}{broken}; {held}"]
    return told + state.told_out("lines")


def _layers(groups: list[str]) -> dict[str, str]:
    """A layer for each group, of its name without what DXF forbids in one; with a number if it is taken.

    DXF makes no difference between upper and lower case.
    """
    found: dict[str, str] = {}
    taken = {"supports", "broken", "defpoints"}  # the last one is never printed
    for group in groups:
        plain = "".join("_" if letter in '<>/\\":;?*|=`' else letter for letter in group or "cables")
        layer, k = plain, 2
        while layer.casefold() in taken:
            layer, k = f"{plain}_{k}", k + 1
        taken.add(layer.casefold())
        found[group] = layer
    return found
