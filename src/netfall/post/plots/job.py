"""Picture of the net of a job, in space and in plan: supports, zones, probes, members to be removed.

In plan each zone is the area of its nodes. The area of a node in a face extends to the middles of the
adjacent sides and to the centroid, as for loads and wind.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from netfall.core.messages import count_of
from netfall.geometry.areas import areas_are_given, normals
from netfall.geometry.faces import corner_quadrilaterals
from netfall.job.derived import has_normal_loads
from netfall.job.job import Job
from netfall.job.keys.models import Wind
from netfall.loads.wind.sectors import describe_direction
from netfall.model.layout import Layout
from netfall.post.plots import canvas
from netfall.post.plots.net import add_groups, select_cables

MOST_DRAWN = 30_000  # elements that stay apart; of larger nets, every k-th cable is drawn
MOST_CELLS = 400_000  # node areas in faces; in larger nets each node is a dot
MOST_NORMALS = 150
MOST_ZONES = 10  # zones in the legend
ROOF, OUTSIDE = "#dfe8f0", "0.93"  # colours of a roof without zones; of nodes in no zone
FOLLOWED, WIND = "#111111", "#0b5d7a"


def draw_job(job: Job, layout: Layout, path: Path) -> None:
    """Write the picture, before form finding: in space by groups, in plan by zones."""
    net, x = layout.net, layout.net.in_plan(layout.net.x)[:, :2]
    rows, stride = select_cables(net.cable, net.group, MOST_DRAWN)
    figure, width = plt.figure(figsize=(13, 7.2), layout="constrained"), canvas.line_width(len(rows))
    # the gap: labels of axes in space extend beyond the panel
    ((left, right),) = figure.subfigures(1, 2, squeeze=False, wspace=0.14)
    space, plan = canvas.add_space_axes(left, (1, 1, 1), net.x), right.add_subplot()
    space.computed_zorder = False
    add_groups(space, net.x[net.elements[rows]], net.group[rows], net.group_names, width, net.bar[rows])
    _draw_zones(plan, layout)
    canvas.add_lines(plan, x[net.elements[rows]], colors="0.3", linewidths=0.6 * width, zorder=2)
    for corners in (zone.polygon for zone in job.zones if zone.polygon is not None):
        plan.plot(*np.array([*corners, corners[0]]).T, color="k", lw=0.9, ls="--", zorder=3)
    _draw_marks(space, layout, net.x)
    _draw_marks(plan, layout, x)
    if has_normal_loads(job):
        _draw_normals(space, net.x, normals(net, layout.roofing.given.vector))
    if job.wind is not None and job.wind.pressures is None:  # taps give pressures
        x = np.vstack([x, _draw_wind(plan, job.wind, x, in_plan=net.roof_axes is None)])
    canvas.set_plan(plan, x, roof_axes=net.roof_axes)
    for half, axes in ((left, space), (right, plan)):
        handles = axes.get_legend_handles_labels()[0]
        legend = half.legend(handles=handles, loc="outside lower center", ncols=2)
        for line in legend.legend_handles:  # thick enough to be distinguished
            if isinstance(line, Line2D):
                line.set_linewidth(max(line.get_linewidth(), 1.5))
            elif isinstance(line, LineCollection):
                line.set_linewidth(np.maximum(line.get_linewidth(), 1.5).tolist())
    size = " x ".join(f"{side:.4g}" for side in np.ptp(net.x, axis=0))
    left_out = f"; one of {stride} cables is drawn" if stride > 1 else ""
    words = f": the net as it is read\n{net.n} nodes, {count_of(net.m, 'element')}, {size} m{left_out}"
    canvas.set_figure_title(figure, job.title or job.name, words)
    canvas.save(figure, path)


def _draw_marks(axes: Axes, layout: Layout, x: np.ndarray) -> None:
    """Draw members to be removed, recorded members, supports and probes; nodes at x (n, 2 or 3) [m]."""
    net, lost = layout.net, np.unique(np.concatenate([np.zeros(0, np.int64), *layout.lost]))
    followed, probes = np.unique(layout.probes.named), np.unique(layout.probes.particles)
    for rows, colour, style, word in (
        (lost, canvas.BROKEN, "-", "to be removed"),
        (followed, FOLLOWED, ":", "[output] elements"),
    ):
        lines = x[net.elements[rows]]
        look = {"colors": colour, "linewidths": 2.0, "linestyles": style, "zorder": 4}
        canvas.add_lines(axes, lines, label=f"{word}, {len(rows)}", **look)
        if style == "-" and 0 < len(rows) <= canvas.MAX_MARKED:  # makes short members visible
            canvas.add_marks(axes, lines.mean(1), "x", ms=4, color=colour, zorder=5)
    canvas.mark_supports(axes, x, net.fixed, net.spring > 0, net.angle)
    if len(probes):
        label, colours = f"probes, {len(probes)}", {"mfc": "#ffd400", "mec": "k"}
        canvas.add_marks(axes, x[probes], "*", ms=10, mew=0.6, zorder=6, label=label, **colours)


def _draw_normals(axes: Axes, x: np.ndarray, normal: np.ndarray) -> None:
    """Draw some of the outward normals (n, 3) along which wind or pressure acts, at nodes x (n, 3) [m]."""
    rows = np.flatnonzero(normal.any(1))
    if len(rows):
        shown = rows[np.unique(np.linspace(0, len(rows) - 1, MOST_NORMALS).astype(int))]
        lines = np.stack([x[shown], x[shown] + 0.05 * np.ptp(x, axis=0).max() * normal[shown]], 1)
        label = f"outward normals, {len(shown)} of {len(rows)}"
        canvas.add_lines(axes, lines, colors="#444444", linewidths=0.6, zorder=3, label=label)


def _draw_zones(axes: Axes, layout: Layout) -> None:
    """Draw the roof area of each node in the colour of its zone, with the areas in the legend."""
    net, zones, faces, given = layout.net, layout.zones, layout.roofing.faces, layout.roofing.given
    areas, unit = (given.plan, "m2 in plan") if net.roof_axes is None else (given.surface, "m2")
    names, area = zones.names, f"{areas.sum():.5g} {unit}"
    palette = [plt.get_cmap("Set3")(k % 12) for k in range(len(names))] if names else [ROOF]
    tints = np.array([to_rgba(colour) for colour in [OUTSIDE if names else ROOF, *palette]])
    zone = np.append(zones.of_node, np.full(len(net.corners), -1)) + 1
    if len(faces.corner) > MOST_CELLS:
        x, y, *_ = net.in_plan(net.x).T
        axes.scatter(x, y, s=0.6, c=tints[zone[: net.n]], lw=0, zorder=1)
    elif len(faces):
        points, colours = net.in_plan(np.concatenate([net.x, net.corners]))[:, :2], tints[zone[faces.corner]]
        style = {"facecolors": colours, "edgecolors": colours, "lw": 0.2, "zorder": 1}
        axes.add_collection(canvas.polygons(corner_quadrilaterals(points, faces), **style))
    entries = []  # colour and text
    if not names and len(faces):
        entries = [(ROOF, f"roof, {count_of(faces.count, 'face')}, {area}")]
    elif not names:
        of_table = f"roof, areas of nodes.csv, {area}"
        entries = [("none", of_table if areas_are_given(net) else "no closed faces, so no roof")]
    for k in [*range(min(len(names), MOST_ZONES)), *[-1] * bool(names)]:
        if count := int((zones.of_node == k).sum()):
            name, zone_area = f"zone {names[k]}" if k >= 0 else "no zone", areas @ zones.share[:, k]
            entries.append((tints[k + 1], f"{name}, {count_of(count, 'node')}, {zone_area:.4g} {unit}"))
    for colour, label in entries:
        axes.add_patch(Rectangle((0, 0), 0, 0, color=colour, label=label))
    if len(names) > MOST_ZONES:
        axes.plot([], [], ls="", label=f"and {len(names) - MOST_ZONES} more zones")


def _draw_wind(axes: Axes, wind: Wind, x: np.ndarray, in_plan: bool) -> np.ndarray:
    """Name the wind, and draw an arrow in plan, windward of x (n, 2) [m]; return its start (1, 2) [m]."""
    what = f"wind of {wind.speed:g} m/s" if wind.speed else f"wind of {wind.file}"
    look = {"color": WIND, "lw": 2.2} if in_plan else {"ls": ""}
    axes.plot([], [], label=f"{what} {describe_direction(wind.direction)}", **look)
    if not in_plan:
        return np.zeros((0, 2))
    angle, middle = np.radians(wind.direction), 0.5 * (x.min(0) + x.max(0))
    direction = np.array([np.cos(angle), np.sin(angle)])
    windward = ((x - middle) @ direction).min()
    length = 0.14 * np.ptp(x, axis=0).max()
    tip = middle + (windward - 0.15 * length) * direction
    start = tip - length * direction
    arrow = {"arrowstyle": "-|>", "color": WIND, "lw": 2.2, "mutation_scale": 16}
    axes.annotate("", tip, start, arrowprops=arrow, zorder=5, annotation_clip=False)
    return start[None]
