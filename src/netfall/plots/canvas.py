"""The canvas of all pictures: sizes, fonts, colours; figures opened and saved; the net in space and plan."""

from pathlib import Path
from textwrap import fill

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.text import Text
from matplotlib.ticker import LogFormatter, LogFormatterMathtext, NullLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from netfall.ground.progress import one_line, plain
from netfall.write.locks import whole

matplotlib.use("Agg")
CYCLE = (  # of lines and groups, which the colour-blind tell apart too: Petroff 2021, arXiv 2107.02270
    *("#3f90da", "#ffa90e", "#bd1f01", "#94a4a2", "#832db6"),
    *("#a96b59", "#e76300", "#b9ac70", "#717581", "#92dadd"),
)
SMALL = 8  # points: legends, ticks, notes in a picture
STYLE = {
    "savefig.dpi": 130,
    "text.parse_math": False,  # names may have dollars, which are no formulas
    "figure.titlesize": 11,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "xtick.labelsize": SMALL,
    "ytick.labelsize": SMALL,
    "legend.fontsize": SMALL,
    "legend.frameon": False,
    "grid.alpha": 0.3,
    "axes.prop_cycle": matplotlib.cycler(color=CYCLE),
}
plt.rcParams.update(STYLE)
NOTHING = "#b8b8b8"  # what has no value
BROKEN = "#d62728"  # what is broken, lost or at fault; no group has this red
GUIDED = "#7a4b00"  # supports that are held along some axes
SPRING = "#6a0dad"  # supports on springs
LONGEST_TITLE = 90  # characters
CHARACTERS = 12.0  # of a title in an inch
MOST_DRAWN = 60_000  # elements in a picture; of larger nets every k-th is drawn
ALONE, PANEL, NARROW = (9.0, 4.9), (5.5, 3.4), (4.2, 2.9)  # inches of a panel in space: of one, two, more
IN_TWOS, IN_THREES = 6, 12  # panels in space, up to which two or three stand in a row, else four
PLAN_WIDTH = 6.0  # inches of a panel in plan
SHORTEST, LONGEST = 1.6, 6.8  # inches of its height
HEAD, SECOND_LINE = 0.9, 0.2  # inches for the title, and for titles of two lines of panels
VIEWS = {"space": (28.0, -60.0), "plan": (90.0, -90.0), "front": (0.0, -90.0), "side": (0.0, 0.0)}  # degrees
ROUND = np.outer(10.0 ** np.arange(-3, 7), (1.0, 2.0, 5.0)).ravel()  # numbers of scales
ZOOM = 1.1, 1.2  # of nets in space, and of those that are flat
FLAT, THIN = 0.12, 0.04  # of the largest extent, up to which an axis has room for two ticks, and for none


def save(figure, path: Path) -> Path:
    """Write a picture, whole or not at all, and close it; its path."""
    for axes in figure.axes:  # powers of ten in plain numbers: matplotlib writes them as formulas
        for axis in (axes.xaxis, axes.yaxis):
            if isinstance(axis.get_major_formatter(), LogFormatterMathtext):
                axis.set_major_formatter(LogFormatter())
            if isinstance(axis.get_minor_formatter(), LogFormatterMathtext):
                axis.set_minor_formatter(LogFormatter(labelOnlyBase=False))
    write_out_controls(figure)
    with whole(path) as place:
        figure.savefig(place)
    plt.close(figure)
    return path


def write_out_controls(figure) -> None:
    """Write out characters of names in a figure that are no letters: fonts have none for them."""
    for text in figure.findobj(Text):
        if plain(text.get_text()) != text.get_text():
            text.set_text(plain(text.get_text()))


def heading(figure, title: str, words: str) -> None:
    """The title of a job or study, cut to what fits above a picture, and what is shown, in lines that fit."""
    title = one_line(title)
    title = title if len(title) <= LONGEST_TITLE else title[: LONGEST_TITLE - 3] + "..."
    most = int(CHARACTERS * figure.get_figwidth())
    figure.suptitle("\n".join(fill(line, most) for line in f"{title}{words}".split("\n")))


def unit_of(largest: float, unit: str) -> tuple[float, str]:
    """Factor and name of a unit that keeps numbers readable: N, kN, MN."""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if largest >= 2 * factor:
            return 1 / factor, prefix + unit
    return 1.0, unit


def charts(rows: int, columns: int, width: float, height: float, **more):
    """A figure with charts (rows, columns), each with a grid; width, height : inches; more : of subplots"""
    figure, axes = plt.subplots(
        rows, columns, figsize=(width, height), layout="constrained", squeeze=False, **more
    )
    for each in axes.flat:
        each.grid(True)
        each.set_axisbelow(True)
    return figure, axes


def legend_below(figure, *axes, ncols: int = 4) -> None:
    """What the lines of some charts are, below all charts."""
    handles = [handle for each in axes for handle in each.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside lower center", ncols=ncols)


def add_scale(figure, place, norm, palette, label: str, **more):
    """A horizontal scale of colours; place : left, bottom, width, height as shares of the figure."""
    colours = plt.cm.ScalarMappable(norm, palette)
    bar = figure.colorbar(colours, cax=figure.add_axes(place), orientation="horizontal", **more)
    bar.set_label(label)
    return bar


def line_width(elements: int, most: float = 1.4) -> float:
    """Width of lines [points] that leaves as many elements apart."""
    return float(np.clip(60.0 / np.sqrt(max(elements, 1)), 0.4, most))


def in_space(figure, place, points, zoom: float | None = None):
    """Axes in space with equal scales around the points (n, 3), labelled in metres; zoom : default ZOOM

    A net in an upright plane along x is seen from the front.
    """
    axes = figure.add_subplot(*place, projection="3d")
    low, high = points.min(0), points.max(0)
    extent = np.maximum(high - low, 0.02 * (high - low).max() + 1e-9)
    middle = 0.5 * (low + high)
    for k, limits in enumerate((axes.set_xlim, axes.set_ylim, axes.set_zlim)):
        limits(middle[k] - 0.5 * extent[k], middle[k] + 0.5 * extent[k])
    axes.set_box_aspect(extent, zoom=zoom or ZOOM[0 if extent[2] > 3 * FLAT * extent.max() else 1])
    upright = extent[1] <= THIN * extent.max() < extent[2]
    axes.view_init(*VIEWS["front" if upright else "space"])
    for k, (axis, ticks, pad) in enumerate(((axes.xaxis, 5, 6), (axes.yaxis, 4, 6), (axes.zaxis, 3, 0))):
        share = extent[k] / extent.max()
        ticks = min(ticks, round(8 * share)) if k == 1 else ticks
        axis.set_major_locator(
            plt.MaxNLocator(ticks if share > FLAT else 1) if share > THIN else NullLocator()
        )
        axis.set_label_text(f"{'xyz'[k]} [m]" if share > THIN else "")
        axis.labelpad = pad
    if upright:  # matplotlib measures the distance of names by the height of the axes
        axes.xaxis.labelpad = 6.0 * extent.max() / extent[2] - 21.0
    axes.tick_params(labelsize=7, pad=1)
    return axes


def space_panels(points, count: int, below: float):
    """A figure with panels in space, at most four in a row, around the same points (n, 3) [m]; the panels.

    below : inches that are left below them, for scales and legends
    """
    columns = min(2, count) if count <= IN_TWOS else 3 if count <= IN_THREES else 4
    rows, (width, height) = -(-count // columns), {1: ALONE, 2: PANEL}.get(columns, NARROW)
    head = HEAD + SECOND_LINE * (columns > 2)
    figure = plt.figure(figsize=(columns * width, rows * height + head + below))
    high = figure.get_figheight()
    panels = [in_space(figure, (rows, columns, k + 1), points) for k in range(count)]
    margins = {"top": 1.0 - head / high, "bottom": below / high, "hspace": 0.2, "wspace": 0.02}
    figure.subplots_adjust(left=0.02, right=0.98 - 0.02 * (columns > 2), **margins)
    return figure, panels


def set_plan(axes, points: np.ndarray, margin: float = 0.0) -> None:
    """Make axes a plan with equal scales around points (n, 2) [m]; margin : [m], at least a little"""
    low, high = points.min(0), points.max(0)
    margin = max(margin, 0.04 * (high - low).max() + 1e-9)
    axes.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin))
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")


def plan_panels(x: np.ndarray, held: np.ndarray, count: int, margin: float = 0.0):
    """A figure with panels in plan, two beside each other; the panels.

    x : (n, 2) [m] nodes; held : (n,) bool, supports, which are dots; margin : as of `set_plan`
    """
    columns, rows = min(2, count), -(-count // 2)
    extent = np.ptp(x, axis=0)
    height = float(np.clip(0.76 * PLAN_WIDTH * extent[1] / max(extent[0], 1e-9), SHORTEST, LONGEST))
    size = (columns * PLAN_WIDTH, rows * (height + 0.9) + 0.4)
    figure, grid = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
    panels = list(grid.flat)
    for unused in panels[count:]:
        unused.remove()
    for axes in panels[:count]:
        set_plan(axes, x, margin)
        dot_supports(axes, x, held)
    return figure, panels[:count]


def dot_supports(axes, x: np.ndarray, held: np.ndarray) -> None:
    """Dots at the supports in plan. x : (n, 2) [m]; held : (n,) bool"""
    axes.plot(*x[held].T, ".", color="k", ms=min(4.0, 40 / len(x) ** 0.4), zorder=3)


def add_lines(axes, lines: np.ndarray, **style):
    """Add lines (k, 2, 2 or 3) [m], none if there is none, to axes in plan or in space."""
    in_plan = lines.shape[-1] == 2
    kind = LineCollection if in_plan else Line3DCollection
    add = axes.add_collection if in_plan else axes.add_collection3d
    return add(kind(lines, **{"clip_on": False} | style)) if len(lines) else None


def add_coloured(axes, lines: np.ndarray, values: np.ndarray, norm, palette, width: float) -> np.ndarray:
    """Add lines (k, 2, 2 or 3) [m] coloured by values (k,), the largest on top; nan: pale, below all.

    The rows that have a value, as they are drawn: of many lines every k-th, the largest among them.
    """
    order = np.argsort(np.where(np.isfinite(values), values, -np.inf), kind="stable")
    order = order[::-1][:: max(1, len(order) // MOST_DRAWN)][::-1]
    known = np.isfinite(values[order])
    pale, rows = order[~known], order[known]
    add_lines(axes, lines[pale], colors=NOTHING, linewidths=0.5 * width)
    add_lines(axes, lines[rows], array=values[rows], norm=norm, cmap=palette, linewidths=width)
    return rows
