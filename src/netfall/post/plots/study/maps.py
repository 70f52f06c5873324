"""Pictures of a study by element: break frequency, and effects of the removal of each element."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from netfall.core.functions import along_axes
from netfall.post.plots import canvas
from netfall.study.answers.read import Study
from netfall.study.answers.removals import MAX_DYNAMIC_FACTOR, removal_of_element, removals_of

DOT_LENGTH = 0.015  # length / size of the picture; shorter elements get a dot
COLOURS = "viridis_r"
MOST_NAMED = 5  # elements labelled with their ids
MAX_STRUT_SLOPE = 0.1  # horizontal / vertical length, below which an element is a strut between layers


def breaks(study: Study) -> Figure:
    """Draw two maps of how often elements break.

    Left: first to break, as a share of the samples that broke. Right: breaks, as a share of the finished
    samples.
    """
    figure, maps = _open_maps(study, ": where it breaks (grey: never; dots: supports; numbers: ids)")
    for axes, (label, shares) in zip(maps, study.break_shares()):
        _draw_map(study, axes, shares, label, percent=True)
    return figure


def loss_map(study: Study) -> Figure:
    """Draw two maps of the elements, coloured by the effects of their removal.

    Left: largest dynamic factor. Right: lost share of the roof, or further fractures if no removal affects
    the roof. Removals without an equilibrium are red in both.
    """
    removals = removals_of(study)
    assert removals is not None  # see `pictures_of`
    row = removal_of_element(study, removals)
    fails = (row >= 0) & (removals.no_equilibrium[row] > 0)
    lost = bool((removals.detached_area > 0).any())
    consequence = removals.detached_area if lost else removals.broken
    factor = np.where(row >= 0, removals.dynamic_factor[row], np.nan)
    consequence = np.where((row >= 0) & (consequence[row] > 0), consequence[row], np.nan)
    names = np.where(row >= 0, removals.name[row], "")
    red = f"red: no equilibrium afterwards, {fails.sum()}; " * bool(fails.any())
    subtitle = f": after the removal of each ({red}the largest on top; dots: supports)"
    figure, (left, right) = _open_maps(study, subtitle)
    low = float(min(1.0, np.nanmin(factor, initial=1.0)))
    label = "largest dynamic factor (grey: none)"
    _draw_map(study, left, factor, label, low=low, most=MAX_DYNAMIC_FACTOR, names=names)
    label = "detached fraction of the roof (grey: none)" if lost else "further broken elements (grey: none)"
    _draw_map(study, right, consequence, label, percent=lost, names=names)
    for axes in (*left, *right) if fails.any() else ():
        lines = study.net["particles"][study.net["elements"][fails]]
        if axes.name != "3d":
            lines = along_axes(lines, study.net.get("roof_axes"))[..., :2]
        width = canvas.line_width(len(fails), 3.0)
        canvas.add_lines(axes, lines, colors=canvas.BROKEN, linewidths=width, zorder=4)
    return figure


def _open_maps(study: Study, subtitle: str) -> tuple[Figure, list[tuple[Axes, ...]]]:
    """Open a figure with two maps of the net, in plan or from outside, and in space if it has layers."""
    x, held = study.net["particles"], np.any(study.net["fixed"], 1)
    seen = study.net.get("roof_axes")
    drawn = along_axes(x, seen)
    run, rise = np.hsplit(np.abs(np.diff(drawn[study.net["elements"]], axis=1)[:, 0]), [2])
    layered = (np.hypot(*run.T) < MAX_STRUT_SLOPE * rise[:, 0]).any()  # upright elements connect layers
    figure, panels = canvas.open_plan_panels(drawn[:, :2], held, 4 if layered else 2, roof_axes=seen)
    for unused in panels[2:]:
        unused.remove()
    spaces = [(canvas.add_space_axes(figure, (2, 2, 3 + k), x),) if layered else () for k in range(2)]
    canvas.set_figure_title(figure, study.title, subtitle)
    return figure, [(plan, *space) for plan, space in zip(panels, spaces)]


def _draw_map(
    study: Study,
    panels: tuple[Axes, ...],
    values: np.ndarray,
    label: str,
    low: float = 0.0,
    most: float = np.inf,
    percent: bool = False,
    names: np.ndarray | None = None,
) -> None:
    """Colour the elements of a map by values (m,), nan: grey, with the largest on top and labelled.

    panels : axes of the map; most : largest end of the scale; names : labels (m,), None: ids
    """
    x, elements = study.net["particles"], study.net["elements"]
    lines, flat = x[elements], along_axes(x, study.net.get("roof_axes"))[elements][..., :2]
    largest = np.nanmax(values) if np.isfinite(values).any() else 1.0
    high, extend = min(largest, most), "max" if largest > most else "neither"
    norm = Normalize(low, high if high > low else low + 1.0)
    names = (study.net["element_id"] if names is None else names).astype(str)
    for axes in panels:
        projected, width = lines if axes.name == "3d" else flat, canvas.line_width(len(lines), 3.0)
        rows = canvas.add_coloured(axes, projected, values, norm, COLOURS, width)
    plan, ends = panels[0], flat[rows]
    extent = max(np.ptp(plan.get_xlim()), np.ptp(plan.get_ylim()))
    short = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) < DOT_LENGTH * extent
    dots = {"s": 14, "c": values[rows][short], "norm": norm, "cmap": COLOURS, "zorder": 3.5, "lw": 0}
    plan.scatter(*ends[short].mean(1).T, **dots)
    bar = canvas.add_scale(plan, norm, COLOURS, label, shrink=0.8, extend=extend)
    if percent:
        bar.ax.xaxis.set_major_formatter(PercentFormatter(1.0, decimals=None))
    _, first = np.unique(names[rows[::-1]], return_index=True)  # the largest value of each name
    labelled = rows[::-1][np.sort(first)][:MOST_NAMED]
    canvas.add_labels(plan, flat[labelled].mean(1), names[labelled].tolist())
