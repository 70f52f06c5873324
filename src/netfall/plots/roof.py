"""The roof in plan: its zones, the areas of its nodes, and what acts on them.

Each node is a square as large as its area in plan, at its place at the start.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PolyCollection

from netfall.checks.reactions import held_axes
from netfall.plots.canvas import MOST_DRAWN, add_lines, heading, plan_panels, unit_of
from netfall.results.file import title_of

OUTSIDE = "0.88"  # what is in no zone, or has a pressure along axes
# Dataset, what it is, unit, colours; with two signs the middle of the colours is 0.
VALUES = (
    ("net/tributary_area", "tributary area, of the surface", "m2", "viridis", False),
    ("wind/mean_pressure", "pressure of the mean wind", "N/m2", "RdBu_r", True),
    ("load/pressure", "static pressure", "N/m2", "RdBu_r", True),
    ("load/snow", "snow, in plan", "N/m2", "Blues", False),
)


def has_roof(f) -> bool:
    """Whether any node carries a part of a roof."""
    return bool(f["net/tributary_area"][:].any())


def roof(f):
    """A panel for the zones, one for the areas, and one for each thing that acts on the roof by node."""
    there = [row for row in VALUES if row[0] in f]
    zoned = len(f["net/zone_names"]) > 0
    x, elements = f["net/particles"][:, :2], f["net/elements"][:]
    largest = 0.55 * np.sqrt(f["net/plan_area"][:].max())  # of the squares
    figure, panels = plan_panels(x, held_axes(f).any(1), len(there) + zoned, largest)
    for axes in panels:
        lines = x[elements[:: max(1, len(elements) // MOST_DRAWN)]]
        add_lines(axes, lines, colors="0.25", linewidths=0.35, zorder=2)
    if zoned:
        _draw_zones(f, panels[0])
    for axes, row in zip(panels[zoned:], there):
        _draw_values(f, axes, *row)
    words = "(each node a square of its area; dots: supports; a positive pressure presses)"
    heading(figure, title_of(f), f": roof in plan\n{words}")
    return figure


def _squares(f, **style) -> tuple[PolyCollection, np.ndarray]:
    """Squares of the nodes that have an area, and the rows of these."""
    area = f["net/plan_area"][:]
    rows = np.flatnonzero((area > 0) & (f["net/tributary_area"][:] > 0))
    corner = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    x = f["net/particles"][:, :2][rows]
    return PolyCollection(
        x[:, None] + np.sqrt(area[rows])[:, None, None] * corner, edgecolors="face", lw=0.6, **style
    ), rows


def _draw_zones(f, axes) -> None:
    """The zones by colour, with their names and areas."""
    names, zone = f["net/zone_names"].asstr()[:], f["net/zone"][:]
    palette = plt.get_cmap("tab10" if len(names) <= 10 else "tab20")
    colours = [OUTSIDE, *(palette(k % palette.N) for k in range(len(names)))]
    squares, rows = _squares(f)
    squares.set_facecolor([colours[k + 1] for k in zone[rows]])
    axes.add_collection(squares)
    area, shown = f["net/tributary_area"][:], sorted(set(zone[zone < 0])) + list(range(len(names)))
    handles = [plt.Rectangle((0, 0), 1, 1, color=colours[k + 1]) for k in shown]
    own = lambda k: area[zone == k].sum()
    if "net/zone_share" in f:
        part = f["net/zone_share"][:]
        own = lambda k: (area * (part[:, k] if k >= 0 else 1.0 - part.sum(1))).sum()
    labels = [f"{names[k] if k >= 0 else '(none)'}: {own(k):.4g} m2" for k in shown]
    axes.legend(handles, labels, loc="upper left", bbox_to_anchor=(1.02, 1.0))
    axes.set_title("zones, with their area of surface")


def _draw_values(f, axes, name: str, what: str, unit: str, colours: str, signed: bool) -> None:
    """A value of each node by colour, with its range."""
    values = f[name][:]
    palette = plt.get_cmap(colours).with_extremes(bad=OUTSIDE)
    squares, rows = _squares(f, cmap=palette)
    known = values[rows][np.isfinite(values[rows])]
    low, high = (known.min(), known.max()) if len(known) else (0.0, 0.0)
    largest = max(abs(low), abs(high))
    factor, named = unit_of(largest, unit) if unit != "m2" else (1.0, unit)
    squares.set_array(np.ma.masked_invalid(factor * values[rows]))
    span = factor * (largest or 1.0)
    squares.set_clim(-span if signed else 0.0, span)
    axes.add_collection(squares)
    bar = axes.figure.colorbar(squares, cax=axes.inset_axes((1.03, 0.0, 0.04, 1.0)))
    bar.set_label(f"[{named}]")
    least, most = f"{factor * low:.4g}", f"{factor * high:.4g}"
    along_axes = ", grey: along axes" if len(known) < len(rows) else ""
    axes.set_title(f"{what}: {least if least == most else f'{least} to {most}'} {named}{along_axes}")
