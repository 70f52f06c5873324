"""Picture of the net of a job, in space and in plan: supports, zones, probes, members to be removed.

In plan each zone is the area of its nodes. The area of a node in a face extends to the middles of the
adjoining sides and to the centroid, as for loads and wind.
"""

from dataclasses import dataclass, field
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D

from netfall.geometry.areas import areas_are_given
from netfall.geometry.faces import Faces, corner_quadrilaterals
from netfall.geometry.net import Net
from netfall.post.plots import canvas
from netfall.post.plots.net import add_groups, select_cables

MOST_DRAWN = 30_000  # elements that stay apart; of larger nets, every k-th cable is drawn
MOST_CELLS = 400_000  # node areas in faces; in larger nets each node is a dot
MOST_NORMALS = 150
MOST_ZONES = 10  # zones in the legend
ROOF, OUTSIDE = "#dfe8f0", "0.93"  # colours of a roof without zones; of nodes in no zone
FOLLOWED, WIND = "#111111", "#0b5d7a"


@dataclass(frozen=True)
class JobNet:
    """Content of the picture, by rows of the net.

    of_zone : (n,) row of zone_names, -1: none; zone_area : (z + 1,) [m2] in plan, last: area in no zone
    polygons : corners in plan of the zones that have some
    area : (n,) [m2] in plan; normal : (n, 3) of nodes with wind or pressure, zero or None: no such load
    lost, followed : elements to be removed, and of [output] elements; probes : particles
    wind : direction to which it blows [degrees], and its description
    """

    title: str
    net: Net
    faces: Faces
    area: np.ndarray
    zone_names: list[str]
    of_zone: np.ndarray
    zone_area: np.ndarray
    polygons: list = field(default_factory=list)
    normal: np.ndarray | None = None
    lost: np.ndarray = ()
    followed: np.ndarray = ()
    probes: np.ndarray = ()
    wind: tuple[float, str] | None = None


def draw_job(job: JobNet, path: Path) -> None:
    """Write the picture: in space by groups, in plan by zones."""
    net, x = job.net, job.net.x[:, :2]
    rows, stride = select_cables(net.x, net.elements, net.cable, net.group, MOST_DRAWN)
    figure, width = plt.figure(figsize=(13, 7.2), layout="constrained"), canvas.line_width(len(rows))
    left, right = figure.subfigures(1, 2, wspace=0.14)  # labels of axes in space extend beyond the panel
    space, plan = canvas.add_space_axes(left, (1, 1, 1), net.x), right.add_subplot()
    space.computed_zorder = False
    add_groups(space, net.x[net.elements[rows]], net.group[rows], net.group_names, width, net.bar[rows])
    _draw_zones(plan, job)
    canvas.add_lines(plan, x[net.elements[rows]], colors="0.3", linewidths=0.6 * width, zorder=2)
    for corners in job.polygons:
        plan.plot(*np.array([*corners, corners[0]]).T, color="k", lw=0.9, ls="--", zorder=3)
    _draw_marks(space, job, net.x)
    _draw_marks(plan, job, x)
    _draw_normals(space, job)
    canvas.set_plan(plan, np.vstack([x, _draw_wind(plan, job.wind, x)]) if job.wind else x)
    for half, axes in ((left, space), (right, plan)):
        handles = axes.get_legend_handles_labels()[0]
        legend = half.legend(handles=handles, loc="outside lower center", ncols=2)
        for line in legend.legend_handles:  # thick enough to be distinguished
            if isinstance(line, Line2D | LineCollection):
                line.set_linewidth(np.maximum(line.get_linewidth(), 1.5))
    size = " x ".join(f"{side:.4g}" for side in np.ptp(net.x, axis=0))
    left_out = f"; one of {stride} cables is drawn" if stride > 1 else ""
    words = f": the net as it is read\n{net.n} nodes, {net.m} elements, {size} m{left_out}"
    canvas.set_figure_title(figure, job.title, words)
    canvas.save(figure, path)


def _draw_marks(axes, job: JobNet, x: np.ndarray) -> None:
    """Draw members to be removed, recorded members, supports and probes; nodes at x (n, 2 or 3) [m]."""
    for rows, colour, style, word in (
        (job.lost, canvas.BROKEN, "-", "to be removed"),
        (job.followed, FOLLOWED, ":", "[output] elements"),
    ):
        lines = x[job.net.elements[rows]] if len(rows) else x[:0]
        look = {"colors": colour, "linewidths": 2.0, "linestyles": style, "zorder": 4}
        canvas.add_lines(axes, lines, label=f"{word}, {len(rows)}", **look)
        if style == "-" and 0 < len(rows) <= canvas.MAX_MARKED:  # makes short members visible
            cross = {"ls": "", "marker": "x", "ms": 4, "color": colour, "zorder": 5, **canvas.SPACE_STYLE}
            axes.plot(*lines.mean(1).T, **cross)
    canvas.mark_supports(axes, x, job.net.fixed, job.net.spring > 0)
    if len(job.probes):
        star = {"ls": "", "marker": "*", "ms": 10, "mfc": "#ffd400", "mec": "k", "mew": 0.6, "zorder": 6}
        axes.plot(*x[job.probes].T, label=f"probes, {len(job.probes)}", **star, **canvas.SPACE_STYLE)


def _draw_normals(axes, job: JobNet) -> None:
    """Draw some of the upward normals along which wind or pressure acts."""
    rows = np.flatnonzero(job.normal.any(1)) if job.normal is not None else []
    if len(rows):
        shown = rows[np.unique(np.linspace(0, len(rows) - 1, MOST_NORMALS).astype(int))]
        start, reach = job.net.x[shown], 0.05 * np.ptp(job.net.x, axis=0).max()
        lines = np.stack([start, start + reach * job.normal[shown]], 1)
        label = f"upward normals, {len(shown)} of {len(rows)}"
        canvas.add_lines(axes, lines, colors="#444444", linewidths=0.6, zorder=3, label=label)


def _draw_zones(axes, job: JobNet) -> None:
    """Draw the roof area of each node in the colour of its zone, with the areas in the legend."""
    names, faces, area = job.zone_names, job.faces, f"{job.area.sum():.5g} m2 in plan"
    palette = [plt.get_cmap("Set3")(k % 12) for k in range(len(names))] if names else [ROOF]
    tints = np.array([to_rgba(colour) for colour in [OUTSIDE if names else ROOF, *palette]])
    zone = np.append(job.of_zone, np.full(len(job.net.corners), -1)) + 1
    if len(faces.corner) > MOST_CELLS:
        axes.scatter(*job.net.x[:, :2].T, s=0.6, c=tints[zone[: job.net.n]], lw=0, zorder=1)
    elif len(faces):
        points, colours = np.concatenate([job.net.x, job.net.corners])[:, :2], tints[zone[faces.corner]]
        style = {"facecolors": colours, "edgecolors": colours, "lw": 0.2, "zorder": 1}
        axes.add_collection(PolyCollection(corner_quadrilaterals(points, faces), **style))
    entries = []  # colour and text
    if not names and len(faces):
        entries = [(ROOF, f"roof, {faces.count} faces, {area}")]
    elif not names:
        given = areas_are_given(job.net)
        entries = [("none", f"roof, areas of nodes.csv, {area}" if given else "no closed faces, so no roof")]
    for k in [*range(min(len(names), MOST_ZONES)), *[-1] * bool(names)]:
        if count := int((job.of_zone == k).sum()):
            name = f"zone {names[k]}" if k >= 0 else "no zone"
            entries.append((tints[k + 1], f"{name}, {count} nodes, {job.zone_area[k]:.4g} m2 in plan"))
    for colour, label in entries:
        axes.add_patch(plt.Rectangle((0, 0), 0, 0, color=colour, label=label))
    if len(names) > MOST_ZONES:
        axes.plot([], [], ls="", label=f"and {len(names) - MOST_ZONES} more zones")


def _draw_wind(axes, wind: tuple[float, str], x: np.ndarray) -> np.ndarray:
    """Draw an arrow on the windward side of the net x (n, 2) [m]; return its start (2,) [m]."""
    angle, middle = np.radians(wind[0]), 0.5 * (x.min(0) + x.max(0))
    direction = np.array([np.cos(angle), np.sin(angle)])
    windward = ((x - middle) @ direction).min()
    length = 0.14 * np.ptp(x, axis=0).max()
    tip = middle + (windward - 0.15 * length) * direction
    start = tip - length * direction
    arrow = {"arrowstyle": "-|>", "color": WIND, "lw": 2.2, "mutation_scale": 16}
    axes.annotate("", tip, start, arrowprops=arrow, zorder=5, annotation_clip=False)
    axes.plot([], [], color=WIND, lw=2.2, label=wind[1])
    return start
