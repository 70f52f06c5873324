"""Common parts of all pictures: sizes, fonts, colours; figures; nets in space and in plan."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any, cast

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from adjustText import adjust_text
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colorbar import Colorbar
from matplotlib.colors import Colormap, Normalize
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.rcsetup import cycler
from matplotlib.text import Text
from matplotlib.ticker import FixedLocator, LogFormatter, LogFormatterMathtext, MaxNLocator, NullLocator
from matplotlib.transforms import Bbox
from mpl_toolkits.mplot3d import Axes3D, proj3d
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from numpy.typing import ArrayLike

from netfall.core.functions import MAX_HORIZONTAL_PART
from netfall.core.progress import one_line, plain
from netfall.results.locks import whole

matplotlib.use("Agg")
CYCLE = (  # colours of lines and groups, safe for colour blindness: Petroff 2021, arXiv 2107.02270
    *("#3f90da", "#ffa90e", "#bd1f01", "#94a4a2", "#832db6"),
    *("#a96b59", "#e76300", "#b9ac70", "#717581", "#92dadd"),
)
SMALL = 8  # points: legends, ticks, notes in a picture
STYLE: dict[str, Any] = {
    "savefig.dpi": 130,
    "text.parse_math": False,  # dollar signs in names do not start formulas
    "figure.titlesize": 11,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "xtick.labelsize": SMALL,
    "ytick.labelsize": SMALL,
    "legend.fontsize": SMALL,
    "legend.frameon": False,
    "grid.alpha": 0.3,
    "axes.prop_cycle": cycler(color=CYCLE),
}
plt.style.use(["default", STYLE])  # a matplotlibrc of the user must not change pictures
NO_VALUE_COLOUR = "#b8b8b8"  # elements without a value
BROKEN = "#d62728"  # broken, removed or faulty elements; no group has this red
SUPPORT_COLOUR = "#111111"
GUIDED = "#7a4b00"  # supports that are held along some axes
SPRING_COLOUR = "#6a0dad"  # supports on springs
LONGEST_TITLE = 90  # characters of a title
CHARACTERS = 12.0  # characters per inch of a title
MAX_MARKED = 2_000  # largest number of marked supports of a kind; of more, every k-th is marked
MAX_DRAWN = 60_000  # largest number of elements in a picture; of more, every k-th is drawn
ALONE, PANEL, NARROW = (9.0, 5.0), (5.5, 3.4), (4.2, 3.0)  # inches, of one, two or more panels in a row
MAX_IN_TWO_COLUMNS, MAX_IN_THREE_COLUMNS = 6, 12  # panels in space up to which a row has so many; above, four
PLAN = 6.0  # inches; largest width and height of a panel in plan
HEAD_HEIGHT = 1.4  # inches for the title, scales and legends
VIEWS = {"space": (28.0, -60.0), "plan": (90.0, -90.0), "front": (0.0, -90.0), "side": (0.0, 0.0)}  # degrees
ROUND_NUMBERS = np.outer(10.0 ** np.arange(-3, 7), (1.0, 2.0, 5.0)).ravel()  # round numbers for scales
ZOOM = 1.15  # factor on nets in space, whose box has empty corners
SPACE_GAP = 0.08  # share of the width right of a panel in space, whose label of z is outside it
# Of artists in space, whose x layouts take for pixels.
SPACE_STYLE: dict[str, Any] = {"clip_on": False, "in_layout": False}
THIN_EXTENT = 0.04  # share of the largest extent below which an axis has no space for ticks
BOX = {"boxstyle": "round,pad=0.05", "fc": "white", "ec": "none", "alpha": 0.8}
LEADER = {"arrowstyle": "-", "lw": 0.5, "color": "0.4", "shrinkA": 0, "shrinkB": 0}
ITERATIONS = 500  # about 0.5 s for a picture with 30 labels


SOFTWARE = {"Software": "netfall"}  # text in each picture
MARK, HEAD = b"Software\0netfall", 200  # the same in its file, and the number of bytes that contain it


def remove_earlier(paths: Iterable[Path]) -> None:
    """Remove the files that are pictures of netfall, which an earlier result has left."""
    for path in paths:
        if path.is_file() and MARK in path.read_bytes()[:HEAD]:
            path.unlink()


def save(figure: Figure, path: Path) -> Path:
    """Write a picture completely or not at all, close it, and return its path.

    The picture is cropped equally at the left and right, so that its title stays in the middle.
    """
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):  # matplotlib would write powers of ten as formulas
            if isinstance(axis.get_major_formatter(), LogFormatterMathtext):
                axis.set_major_formatter(LogFormatter())
            if isinstance(axis.get_minor_formatter(), LogFormatterMathtext):
                axis.set_minor_formatter(LogFormatter(labelOnlyBase=False))
    replace_control_characters(figure)
    layout = figure.get_layout_engine()
    if layout is not None:
        layout.execute(figure)
    figure.set_layout_engine(None)  # it has placed everything; to do so again takes a quarter of the time
    box, width = figure.get_tightbbox(), figure.get_figwidth()
    margin = min(box.x0, width - box.x1)
    cropped = Bbox.from_extents(margin, box.y0, width - margin, box.y1).padded(0.2)
    with whole(path) as temporary:
        figure.savefig(temporary, bbox_inches=cropped, metadata=SOFTWARE)
    plt.close(figure)
    return path


def replace_control_characters(figure: Figure) -> None:
    """Replace the control characters of texts in a figure by readable ones, because fonts lack them."""
    for text in figure.findobj(Text):
        if plain(text.get_text()) != text.get_text():
            text.set_text(plain(text.get_text()))


def set_figure_title(figure: Figure, title: str, subtitle: str) -> None:
    """Set the title of a figure: the job's title, shortened, then a subtitle, wrapped to the width."""
    title = one_line(title)
    title = title if len(title) <= LONGEST_TITLE else title[: LONGEST_TITLE - 3] + "..."
    line_length = int(CHARACTERS * figure.get_figwidth())  # matplotlib's wrapping parses dollar signs
    figure.suptitle("\n".join(fill(line, line_length) for line in f"{title}{subtitle}".split("\n")))


def unit_of(largest: float, unit: str) -> tuple[float, str]:
    """Return the factor and the name of a unit that keeps numbers readable: N, kN, MN."""
    for factor, prefix in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if largest >= 2 * factor:
            return 1 / factor, prefix + unit
    return 1.0, unit


def open_charts(
    rows: int, columns: int, width: float, height: float, **more: Any
) -> tuple[Figure, np.ndarray]:
    """Open a figure of charts (rows, columns) with grids; width, height : [inch]; more : of subplots."""
    figure, axes = plt.subplots(
        rows, columns, figsize=(width, height), layout="constrained", squeeze=False, **more
    )
    for chart in axes.flat:
        chart.grid(True)
        chart.set_axisbelow(True)
    return figure, axes


def add_legend_below(figure: Figure, *axes: Axes, ncols: int = 4) -> None:
    """Add a legend of the lines of some charts, below all charts; lines with the same label are one entry."""
    entries = {label: line for chart in axes for line, label in zip(*chart.get_legend_handles_labels())}
    figure.legend(handles=list(entries.values()), loc="outside lower center", ncols=ncols)


def add_scale(
    axes: Axes | Sequence[Axes], norm: Normalize, palette: Colormap | str, label: str, **more: Any
) -> Colorbar:
    """Add a colour scale below one or several axes; more : arguments of matplotlib's colorbar."""
    figure = (axes if isinstance(axes, Axes) else axes[0]).figure
    colours = plt.cm.ScalarMappable(norm, palette)
    style: dict[str, Any] = {"location": "bottom", "shrink": 0.5, "aspect": 30, "fraction": 0.08, "pad": 0.01}
    return figure.colorbar(colours, ax=axes, label=label, **style | more)


def line_width(elements: int, largest: float = 1.4) -> float:
    """Return the width of lines [pt] that separates this number of elements."""
    return float(np.clip(60.0 / np.sqrt(max(elements, 1)), 0.4, largest))


def add_space_axes(
    figure: Figure, position: tuple[SubplotSpec] | tuple[int, int, int], points: np.ndarray, zoom: float = 1.0
) -> Axes3D:
    """Add axes in space with equal scales around points (n, 3), labelled in metres.

    zoom : factor on the size that fits. A net in an upright plane along x is seen from the front.
    """
    axes = figure.add_subplot(*position, projection="3d")
    low, high = points.min(0), points.max(0)
    extent = np.maximum(high - low, 0.02 * (high - low).max() + 1e-9)
    middle, share = 0.5 * (low + high), extent / extent.max()
    limits = zip(middle - 0.5 * extent, middle + 0.5 * extent)
    axes.set(**{f"{name}lim": limit for name, limit in zip("xyz", limits)})
    axes.set_box_aspect(extent, zoom=ZOOM * zoom)
    view = "front" if share[1] <= THIN_EXTENT < share[2] else "space"
    axes.view_init(*VIEWS[view])
    for k, axis in enumerate((axes.xaxis, axes.yaxis, axes.zaxis)):
        count, (start, end) = max(1, round(5 * share[k])), axis.get_view_interval()
        ticks = [tick for tick in MaxNLocator(count).tick_values(start, end) if start <= tick <= end]
        ticks = ticks if count > 1 else [ticks[0], ticks[-1]]  # three have no room where one interval fits
        axis.set_major_locator(FixedLocator(ticks) if share[k] > THIN_EXTENT else NullLocator())
        formatter = axis.get_major_formatter()
        formatter.format_ticks(ticks)
        offset = formatter.get_offset().replace("+", ", +")  # of national grids; its own text has no room
        axis.offsetText.set_visible(False)
        axis.set_label_text(f"{'xyz'[k]} [m]{offset}" if share[k] > THIN_EXTENT else "")
        # points; labels also move away with the height, in space so far that they would reach the next panel
        pad = 3.7 / share[2] if view == "front" else 8.0 - 12.0 * share[2]
        axis.labelpad = pad if k < 2 else -4.0
    axes.tick_params(labelsize=7, pad=1)
    return axes


def open_space_panels(points: np.ndarray, count: int) -> tuple[Figure, list[Axes3D]]:
    """Open a figure with panels in space around the same points (n, 3) [m], at most four in a row."""
    columns = min(2, count) if count <= MAX_IN_TWO_COLUMNS else 3 if count <= MAX_IN_THREE_COLUMNS else 4
    rows, (width, height) = -(-count // columns), {1: ALONE, 2: PANEL}.get(columns, NARROW)
    figure = plt.figure(figsize=(columns * width, rows * height + HEAD_HEIGHT), layout="constrained")
    return figure, [add_space_axes(figure, (rows, columns, k + 1), points) for k in range(count)]


def open_space_and_plan(points: np.ndarray) -> tuple[Figure, Axes3D, Axes]:
    """Open a figure with a panel in space around points (n, 3) [m] and a panel for the plan."""
    figure = plt.figure(figsize=(14, 6.6), layout=ConstrainedLayoutEngine(wspace=SPACE_GAP))
    return figure, add_space_axes(figure, (1, 2, 1), points), figure.add_subplot(1, 2, 2)


def set_plan(
    axes: Axes, points: np.ndarray, margin: float = 0.0, roof_axes: np.ndarray | None = None
) -> None:
    """Make axes a plan with equal scales around points (n, 2) [m], with a margin [m] of at least 4 %.

    roof_axes : (3, 3) axes of the points, from `[roof] normal`; None: x, y, z
    """
    low, high = points.min(0), points.max(0)
    margin = max(margin, 0.04 * (high - low).max() + 1e-9)
    axes.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin))
    axes.set_aspect("equal")
    along, up = "x [m]", "y [m]"
    if roof_axes is not None:
        is_upright = abs(roof_axes[2, 2]) < MAX_HORIZONTAL_PART
        along, up = "along the facade [m]", "height [m]" if is_upright else "up the surface [m]"
    axes.set_xlabel(along)
    axes.set_ylabel(up)


def open_plan_panels(
    x: np.ndarray,
    held: np.ndarray,
    count: int,
    margin: float = 0.0,
    roof_axes: np.ndarray | None = None,
) -> tuple[Figure, list[Axes]]:
    """Open a figure with panels in plan, two in a row.

    x : (n, 2) [m] nodes; held : (n,) bool, supports, drawn as dots; margin, roof_axes : see `set_plan`
    """
    columns, rows = min(2, count), -(-count // 2)
    figure = plt.figure(figsize=(columns * PLAN, rows * PLAN), layout="compressed")
    panels = [figure.add_subplot(rows, columns, k + 1) for k in range(count)]
    for axes in panels:
        set_plan(axes, x, margin, roof_axes)
        add_support_dots(axes, x, held)
    return figure, panels


def mark_supports(
    axes: Axes, x: np.ndarray, fixed: np.ndarray, spring: np.ndarray, angle: np.ndarray | None = None
) -> None:
    """Mark the supports of each kind, and count them in the legend.

    x : (n, 2 or 3) [m]; fixed, spring : (n, 3) bool, axes, rotated about z by angle (n,), None: by none
    """
    fully_fixed = fixed.all(1)
    for selected, kind, marker, colour, word in (
        (fully_fixed, None, "s", SUPPORT_COLOUR, "supports"),
        (fixed.any(1) & ~fully_fixed, fixed, "^", GUIDED, "held in part"),
        (spring.any(1), spring, "D", SPRING_COLOUR, "springs"),
    ):
        rows = np.flatnonzero(selected)
        if len(rows):
            label = f"{word}, {len(rows)}"
            if kind is not None:
                counts = kind[rows].sum(0)
                own = "own axes, " if angle is not None and angle[rows].any() else ""
                held = ", ".join(f"{axis}: {count}" for axis, count in zip("xyz", counts) if count)
                label += f" ({own}{held})"
            size = float(np.clip(30.0 / np.sqrt(len(rows)), 1.2, 4.0))
            shown = x[rows[:: max(1, len(rows) // MAX_MARKED)]]
            add_marks(axes, shown, marker, color=colour, ms=size, mew=0, zorder=3, label=label)


def add_marks(axes: Axes, points: np.ndarray, marker: str, **style: Any) -> None:
    """Add marks without lines at points (k, 2 or 3) [m] to axes in plan or in space."""
    axes.plot(*points.T, ls="", marker=marker, **SPACE_STYLE, **style)


def add_support_dots(axes: Axes, x: np.ndarray, held: np.ndarray) -> None:
    """Draw dots at the supports in plan; x : (n, 2) [m]; held : (n,) bool."""
    axes.plot(*x[held].T, ".", color="k", ms=min(4.0, 40 / len(x) ** 0.4), zorder=3)


def add_lines(axes: Axes, lines: np.ndarray, **style: Any) -> None:
    """Add lines (k, 2, 2 or 3) [m], if there are any, to axes in plan or in space."""
    if isinstance(axes, Axes3D) and len(lines):
        axes.add_collection3d(Line3DCollection(lines, **SPACE_STYLE | style))
    elif len(lines):
        axes.add_collection(LineCollection(list(lines), **SPACE_STYLE | style))


def polygons(corners: np.ndarray, **style: Any) -> PolyCollection:
    """Create polygons with corners (k, c, 2) [m] in plan."""
    return PolyCollection(cast(Sequence[ArrayLike], corners), **style)  # the type annotations exclude arrays


def add_coloured(
    axes: Axes, lines: np.ndarray, values: np.ndarray, norm: Normalize, palette: Colormap | str, width: float
) -> np.ndarray:
    """Add lines (k, 2, 2 or 3) [m] coloured by values (k,), the largest on top; nan: pale, below all.

    Returns the drawn rows that have a value. Of many lines every k-th is drawn, the largest among them.
    """
    order = np.argsort(np.where(np.isfinite(values), values, -np.inf), kind="stable")
    order = order[::-1][:: max(1, len(order) // MAX_DRAWN)][::-1]
    has_value = np.isfinite(values[order])
    pale, rows = order[~has_value], order[has_value]
    add_lines(axes, lines[pale], colors=NO_VALUE_COLOUR, linewidths=0.5 * width)
    add_lines(axes, lines[rows], array=values[rows], norm=norm, cmap=palette, linewidths=width)
    return rows


def add_labels(axes: Axes, points: np.ndarray, texts: list[str]) -> None:
    """Add texts near points (k, 2 or 3) [m], with lines to them. Call this last for a picture."""
    if not texts:
        return
    if isinstance(axes, Axes3D):
        points = np.stack(proj3d.proj_transform(*points.T, axes.get_proj())[:2], 1)
    style: dict[str, Any] = {"fontsize": SMALL, "zorder": 1000, "bbox": BOX, "in_layout": False}
    added = [Axes.text(axes, x, y, text, **style) for (x, y), text in zip(points, texts)]
    figure = axes.figure
    assert isinstance(figure, Figure)  # no picture has labels in a part of a figure
    replace_control_characters(figure)
    figure.draw_without_rendering()  # computes the positions on the page
    adjust_text(added, ax=axes, iter_lim=ITERATIONS)
    for point, text in zip(points, added):  # axes in space cannot draw adjustText's arrows
        axes.annotate("", point, text.get_position(), arrowprops=LEADER, zorder=999)
