"""Export of a result as a drawing: lines, with layers for groups, kinds of supports and broken elements."""

from pathlib import Path

import numpy as np

from netfall.core.messages import count_of
from netfall.exchange.drawings.drawing import METRES
from netfall.exchange.state import MARK, ExportState
from netfall.results.locks import whole
from netfall.results.reader import Result
from netfall.results.states import read_springs

CONTENTS = ("groups",)
FOLDER, STATIC_ONLY, UNITS = False, False, True
COLOURS = (5, 3, 30, 6, 4, 140, 40, 200)  # AutoCAD colour indices, used in turn for the groups
RED = 1
SUPPORTS, IN_PART, SPRINGS, BROKEN = MARKS = ("supports", "held in part", "springs", "broken")  # layers


def write(result: Result, state: ExportState, path: Path, unit: str) -> list[str]:
    """Write the drawing."""
    import ezdxf

    per = round(1.0 / METRES[unit])
    drawing = ezdxf.new("R2010", units=getattr(ezdxf.units, unit.upper()))
    space = drawing.modelspace()
    layers = _layers(sorted(set(state.group.tolist())))
    for k, layer in enumerate(layers.values()):
        entry = drawing.layers.get(layer) if layer in drawing.layers else drawing.layers.add(layer)
        entry.color = COLOURS[k % len(COLOURS)]
    present, held = ~state.out(), state.fixed & state.connected()[:, None]
    partly_held, fully_held = held.any(1), held.all(1)
    marks = {SUPPORTS: np.flatnonzero(fully_held), IN_PART: np.flatnonzero(partly_held & ~fully_held)}
    marks[SPRINGS] = np.intersect1d(read_springs(result.file).nodes, np.flatnonzero(state.connected()))
    counts = {layer: len(nodes) for layer, nodes in marks.items()} | {
        BROKEN: int(state.broken[present].sum())
    }
    for layer, count in counts.items():
        if count or layer == SUPPORTS:
            drawing.layers.add(layer, color=RED)
    for (a, b), group, broken in zip(
        (per * state.position)[state.ends][present].tolist(),
        state.group[present].tolist(),
        state.broken[present].tolist(),
        strict=True,
    ):
        space.add_line(a, b, dxfattribs={"layer": BROKEN if broken else layers[group]})
    for layer, nodes in marks.items():
        for x in (per * state.position[nodes]).tolist():
            space.add_point(x, dxfattribs={"layer": layer})
    drawing.header.custom_vars.append("made", MARK)
    with whole(path) as temporary:
        drawing.saveas(temporary)
    names = ", ".join(layers.values())
    broken = f", {counts[BROKEN]} on layer {BROKEN}" if counts[BROKEN] else ""
    points = f"{count_of(counts[SUPPORTS], 'point')} on layer {SUPPORTS}"
    points += "".join(f", {counts[k]} on layer {k}" for k in (IN_PART, SPRINGS) if counts[k])
    lines = [f"{path}: {state.name}, {present.sum()} lines in {unit} on layers {names}{broken}; {points}"]
    return lines + state.removed_element_lines("lines")


def _layers(groups: list[str]) -> dict[str, str]:
    """Return a layer for each group, named after it without characters that DXF forbids.

    A name that is in use gets a number; DXF does not distinguish upper and lower case.
    """
    layers: dict[str, str] = {}
    used = {*MARKS, "defpoints"}  # entities on defpoints are never printed
    for group in groups:
        base = "".join("_" if letter in '<>/\\":;?*|=`' else letter for letter in group or "cables")
        layer, k = base, 2
        while layer.casefold() in used:
            layer, k = f"{base}_{k}", k + 1
        used.add(layer.casefold())
        layers[group] = layer
    return layers
