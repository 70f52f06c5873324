"""A result as a drawing: lines in metres, a layer for each group, one for supports, one for what broke."""

from pathlib import Path

from netfall.exchange.state import MARK, State
from netfall.results.result import Result
from netfall.write.locks import whole

HOLDS = ("groups",)
FOLDER, AT_REST = False, False
COLOURS = (5, 3, 30, 6, 4, 140, 40, 200)  # of AutoCAD's table, for groups in turn
RED = 1


def write(result: Result, state: State, path: Path) -> list[str]:
    """Write the drawing."""
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
