"""Picture of the roof in plan: zones, areas of nodes, and loads on them, in the initial geometry."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap, to_rgba

from netfall.post.checks.reactions import held_axes
from netfall.post.plots.canvas import CYCLE, MAX_DRAWN, add_lines, open_plan_panels, set_figure_title, unit_of
from netfall.post.plots.cells import has_faces, roof_polygons
from netfall.results.file import result_title

OUTSIDE = "0.88"  # nodes in no zone, or with a pressure along axes
# Dataset, description, unit, colours, signed (the middle of the colours is then 0).
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
    """Draw a panel for the zones, one for the areas, and one for each load on the roof by node."""
    available = [row for row in VALUES if row[0] in f]
    zoned = len(f["net/zone_names"]) > 0
    x, elements = f["net/particles"][:, :2], f["net/elements"][:]
    margin = 0.0 if has_faces(f) else 0.55 * np.sqrt(f["net/plan_area"][:].max())  # half a square
    figure, panels = open_plan_panels(x, held_axes(f).any(1), len(available) + zoned, margin)
    for axes in panels:
        lines = x[elements[:: max(1, len(elements) // MAX_DRAWN)]]
        add_lines(axes, lines, colors="0.25", linewidths=0.35, zorder=2)
    if zoned:
        _draw_zones(f, panels[0])
    for axes, (name, quantity, unit, colours, signed) in zip(panels[zoned:], available):
        _draw_values(f, axes, name, quantity, unit, colours, signed)
    explanation = "each node its part of the faces" if has_faces(f) else "each node a square of its area"
    legend = f"({explanation}; dots: supports; a positive pressure presses)"
    geometry = " as given, with the areas of the form" if "form_finding" in f else ""
    set_figure_title(figure, result_title(f), f": roof in plan{geometry}\n{legend}")
    return figure


def _draw_zones(f, axes) -> None:
    """Draw the zones by colour, with their names and areas."""
    names, zone = f["net/zone_names"].asstr()[:], f["net/zone"][:]
    palette = ListedColormap(CYCLE) if len(names) <= len(CYCLE) else plt.get_cmap("tab20")
    colours = [OUTSIDE, *(palette(k % palette.N) for k in range(len(names)))]
    cells, rows = roof_polygons(f)
    part = np.eye(len(names) + 1)[zone + 1]  # shares of each node; first column: no zone
    if "net/zone_share" in f:  # a node in several zones has a mixed colour
        part[:, 1:] = f["net/zone_share"][:]
        part[:, 0] = np.clip(1.0 - part[:, 1:].sum(1), 0.0, 1.0)
    cells.set_facecolor(np.clip(part[rows] @ [to_rgba(colour) for colour in colours], 0.0, 1.0))
    axes.add_collection(cells)
    area, listed = f["net/tributary_area"][:], sorted(set(zone[zone < 0])) + list(range(len(names)))
    handles = [plt.Rectangle((0, 0), 1, 1, color=colours[k + 1]) for k in listed]
    labels = [f"{names[k] if k >= 0 else '(none)'}: {area @ part[:, k + 1]:.4g} m2" for k in listed]
    axes.legend(handles, labels, loc="upper left", bbox_to_anchor=(1.02, 1.0))
    axes.set_title("zones, with their area of surface")


def _draw_values(f, axes, name: str, quantity: str, unit: str, colours: str, signed: bool) -> None:
    """Draw a value of each node by colour, with its range."""
    values = f[name][:]
    palette = plt.get_cmap(colours).with_extremes(bad=OUTSIDE)
    cells, rows = roof_polygons(f, cmap=palette)
    finite = values[rows][np.isfinite(values[rows])]
    low, high = (finite.min(), finite.max()) if len(finite) else (0.0, 0.0)
    largest = max(abs(low), abs(high))
    factor, symbol = unit_of(largest, unit) if unit != "m2" else (1.0, unit)
    cells.set_array(np.ma.masked_invalid(factor * values[rows]))
    span = factor * (largest or 1.0)
    cells.set_clim(-span if signed else 0.0, span)
    axes.add_collection(cells)
    bar = axes.figure.colorbar(cells, cax=axes.inset_axes((1.03, 0.0, 0.04, 1.0)))
    bar.set_label(f"[{symbol}]")
    least, most = f"{factor * low:.4g}", f"{factor * high:.4g}"
    along_axes = ", grey: along axes" if len(finite) < len(rows) else ""
    axes.set_title(f"{quantity}: {least if least == most else f'{least} to {most}'} {symbol}{along_axes}")
