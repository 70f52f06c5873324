"""Picture of the roof in plan, or of a facade from outside: zones, areas of nodes, and loads on them.

It shows the initial geometry. The area of a node in a face extends to the middles of the adjacent sides and
to the centroid, even for faces with more than four corners, where loads act on the nearest corner.
"""

import h5py
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import ListedColormap, to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from netfall.core.functions import along_axes
from netfall.geometry.faces import Faces, corner_quadrilaterals, faces_of_rings
from netfall.post.checks.nodes import held_axes
from netfall.post.plots import canvas
from netfall.results.file import result_title, roof_axes

OUTSIDE = "0.88"  # nodes in no zone, or with a pressure along axes
# Dataset, description, unit, colours, signed (the middle of the colours is then 0).
VALUES = (
    ("net/tributary_area", "tributary area, of the surface", "m2", "viridis", False),
    ("wind/mean_pressure", "pressure of the mean wind", "N/m2", "RdBu_r", True),
    ("load/pressure", "static pressure", "N/m2", "RdBu_r", True),
    ("load/snow", "snow, in plan", "N/m2", "Blues", False),
)


def roof(f: h5py.File) -> Figure | None:
    """Draw a panel for the zones, one for the areas, and one for each load on the roof by node.

    None if no node has a roof area.
    """
    if not f["net/tributary_area"][:].any():
        return None
    available = [row for row in VALUES if row[0] in f]
    zoned = len(f["net/zone_names"]) > 0
    seen, elements = roof_axes(f), f["net/elements"][:]
    points = along_axes(np.vstack([f["net/particles"][:], f["provenance/net/corners"][:]]), seen)[:, :2]
    x = points[: len(f["net/particles"])]
    area = f["net/plan_area" if seen is None else "net/tributary_area"][:]
    shapes, node = _node_areas(f, points, area)
    margin = 0.0 if _has_faces(f) else 0.55 * np.sqrt(area.max())  # half a square
    figure, panels = canvas.open_plan_panels(x, np.any(held_axes(f), 1), len(available) + zoned, margin, seen)
    for axes in panels:
        lines = x[elements[:: max(1, len(elements) // canvas.MAX_DRAWN)]]
        canvas.add_lines(axes, lines, colors="0.25", linewidths=0.35, zorder=2)
    if zoned:
        _draw_zones(f, panels[0], canvas.polygons(shapes, edgecolors="face", lw=0.3), node)
    for axes, (name, quantity, unit, colours, signed) in zip(panels[zoned:], available):
        palette = plt.get_cmap(colours).with_extremes(bad=OUTSIDE)
        cells = canvas.polygons(shapes, edgecolors="face", lw=0.3, cmap=palette)
        _draw_values(axes, cells, f[name][:][node], quantity, unit, signed)
    explanation = "each node its part of the faces" if _has_faces(f) else "each node a square of its area"
    legend = f"({explanation}; dots: supports; a positive pressure presses)"
    geometry = " as given, with the areas of the form" if "form_finding" in f else ""
    view = "in plan" if seen is None else "from outside"
    canvas.set_figure_title(figure, result_title(f), f": roof {view}{geometry}\n{legend}")
    return figure


def _has_faces(f: h5py.File) -> bool:
    """Whether the net of a result file has faces, from which its areas are computed."""
    return f["provenance/net/ring_start"].shape[0] > 1 and bool(f["provenance/net/ring_corner"].shape[0] > 2)


def _node_areas(f: h5py.File, points: np.ndarray, area: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the roof areas (c, 4, 2) [m] and the node (c,) of each; areas without faces are squares.

    points : (k, 2) [m] nodes and corners in the picture; area : (n,) [m2] of the nodes in it
    """
    x = points[: len(area)]
    shapes, node = np.zeros((0, 4, 2)), np.zeros(0, int)
    if _has_faces(f):
        rings = Faces(f["provenance/net/ring_start"][:], f["provenance/net/ring_corner"][:])
        faces = faces_of_rings(rings, f["provenance/net/ring_face"][:], points)
        is_node = faces.corner < len(x)
        shapes, node = corner_quadrilaterals(points, faces)[is_node], faces.corner[is_node]
    alone = np.setdiff1d(np.flatnonzero((area > 0) & (f["net/tributary_area"][:] > 0)), node)
    corner = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    squares = x[alone][:, None] + np.sqrt(area[alone])[:, None, None] * corner
    return np.concatenate([shapes, squares]), np.concatenate([node, alone])


def _draw_zones(f: h5py.File, axes: Axes, cells: PolyCollection, node: np.ndarray) -> None:
    """Draw the zones by colour, with their names and areas; cells : areas of the nodes (c,)."""
    names, zone = f["net/zone_names"].asstr()[:], f["net/zone"][:]
    palette = ListedColormap(canvas.CYCLE) if len(names) <= len(canvas.CYCLE) else plt.get_cmap("tab20")
    colours: list[str | tuple[float, float, float, float]] = [
        OUTSIDE,
        *(palette(k % palette.N) for k in range(len(names))),
    ]
    part = np.eye(len(names) + 1)[zone + 1]  # shares of each node; first column: no zone
    if "net/zone_share" in f:  # a node in several zones has a mixed colour
        part[:, 1:] = f["net/zone_share"][:]
        part[:, 0] = np.clip(1.0 - part[:, 1:].sum(1), 0.0, 1.0)
    cells.set_facecolor(np.clip(part[node] @ [to_rgba(colour) for colour in colours], 0.0, 1.0))
    axes.add_collection(cells)
    area = f["net/tributary_area"][:] @ part
    for k in [*sorted(set(zone[zone < 0])), *range(len(names))]:
        label = f"{names[k] if k >= 0 else '(none)'}: {area[k + 1]:.4g} m2"
        axes.add_patch(Rectangle((0, 0), 0, 0, color=colours[k + 1], label=label))
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0))
    axes.set_title("zones, with their area of surface")


def _draw_values(
    axes: Axes, cells: PolyCollection, values: np.ndarray, quantity: str, unit: str, signed: bool
) -> None:
    """Draw the values (c,) of cells by colour, with their range; nan: a pressure along axes."""
    finite = values[np.isfinite(values)]
    low, high = (finite.min(), finite.max()) if len(finite) else (0.0, 0.0)
    largest = max(abs(low), abs(high))
    factor, symbol = canvas.unit_of(largest, unit) if unit != "m2" else (1.0, unit)
    span = factor * (largest or 1.0)
    cells.set(array=np.ma.masked_invalid(factor * values), clim=(-span if signed else 0.0, span))
    axes.add_collection(cells)
    axes.figure.colorbar(cells, cax=axes.inset_axes((1.03, 0.0, 0.04, 1.0)), label=f"[{symbol}]")
    least, most = f"{factor * low:.4g}", f"{factor * high:.4g}"
    along_axes = ", grey: along axes" if len(finite) < len(values) else ""
    axes.set_title(f"{quantity}: {least if least == most else f'{least} to {most}'} {symbol}{along_axes}")
