"""Pictures of a study by element: break frequency, and effects of the removal of each element."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from netfall.core.functions import along_axes
from netfall.post.plots import canvas
from netfall.study.answers.losses import MAX_DYNAMIC_FACTOR, Losses, losses_of, removal_of_element
from netfall.study.answers.read import Study

DOT_LENGTH = 0.015  # length / size of the picture; shorter elements get a dot
COLOURS = "viridis_r"
MOST_NAMED = 5  # elements labelled with their ids
MAX_STRUT_SLOPE = 0.1  # horizontal / vertical length, below which an element is a strut between layers
MOST_ROWS = 50  # removals in the chart
LEAST_ON_LOG = 0.1  # factor; a logarithmic scale shows smaller and negative factors at this one


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
    losses = losses_of(study)
    assert losses is not None  # see `pictures_of`
    row = removal_of_element(study, losses)
    fails = (row >= 0) & (losses.no_equilibrium[row] > 0)
    lost = bool((losses.detached_area > 0).any())
    consequence = losses.detached_area if lost else losses.broken
    factor = np.where(row >= 0, losses.dynamic_factor[row], np.nan)
    consequence = np.where((row >= 0) & (consequence[row] > 0), consequence[row], np.nan)
    names = np.where(row >= 0, losses.name[row], "")
    red = f"red: no equilibrium afterwards, {fails.sum()}; " * bool(fails.any())
    subtitle = f": after the removal of each ({red}the largest on top; dots: supports)"
    figure, (left, right) = _open_maps(study, subtitle)
    is_log = _has_dominant(factor)
    if is_log:
        factor = np.maximum(factor, LEAST_ON_LOG)
    low = float(min(1.0, np.nanmin(factor, initial=1.0)))
    _draw_map(study, left, factor, "largest dynamic factor (grey: none)", low=low, names=names, log=is_log)
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
    percent: bool = False,
    names: np.ndarray | None = None,
    log: bool = False,
) -> None:
    """Colour the elements of a map by values (m,), nan: grey, with the largest on top and labelled.

    panels : axes of the map; names : labels (m,), None: ids
    """
    x, elements = study.net["particles"], study.net["elements"]
    lines, flat = x[elements], along_axes(x, study.net.get("roof_axes"))[elements][..., :2]
    high = np.nanmax(values) if np.isfinite(values).any() else 1.0
    norm = (LogNorm if log else Normalize)(low, high if high > low else low + 1.0)
    names = (study.net["element_id"] if names is None else names).astype(str)
    for axes in panels:
        projected, width = lines if axes.name == "3d" else flat, canvas.line_width(len(lines), 3.0)
        rows = canvas.add_coloured(axes, projected, values, norm, COLOURS, width)
    plan, ends = panels[0], flat[rows]
    extent = max(np.ptp(plan.get_xlim()), np.ptp(plan.get_ylim()))
    short = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) < DOT_LENGTH * extent
    dots = {"s": 14, "c": values[rows][short], "norm": norm, "cmap": COLOURS, "zorder": 3.5, "lw": 0}
    plan.scatter(*ends[short].mean(1).T, **dots)
    bar = canvas.add_scale(plan, norm, COLOURS, label, shrink=0.8)
    if log:
        ticks = canvas.round_ticks(norm).tolist()
        bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
        bar.minorticks_off()
    if percent:
        bar.ax.xaxis.set_major_formatter(PercentFormatter(1.0, decimals=None))
    _, first = np.unique(names[rows[::-1]], return_index=True)  # the largest value of each name
    labelled = rows[::-1][np.sort(first)][:MOST_NAMED]
    canvas.add_labels(plan, flat[labelled].mean(1), names[labelled].tolist())


def removal_chart(study: Study) -> Figure:
    """Draw a dot for each sample in a row for each removal, and the further fractures.

    Removals without an equilibrium come first, then removals with excluded samples, then by the largest lost
    roof, fractures and dynamic factor.
    """
    losses = losses_of(study)
    assert losses is not None  # see `pictures_of`
    factor = np.where(study.finished, study.samples.get("dynamic_factor_max", np.nan), np.nan)
    worst = losses.no_equilibrium > 0, losses.left_out > 0
    severity = (*worst, losses.detached_area, losses.broken, losses.dynamic_factor)
    order = np.lexsort([-np.nan_to_num(1.0 * values) for values in reversed(severity)])
    rows = order[:MOST_ROWS]
    row_of = np.full(len(losses.name), -1)
    row_of[rows] = np.arange(len(rows))
    y = row_of[losses.place]
    height = 1.8 + 0.19 * len(rows)
    figure, ((left, right),) = canvas.open_charts(1, 2, 11, height, sharey=True, width_ratios=(3, 2))
    drawn, is_log = (y >= 0) & np.isfinite(factor), _has_dominant(factor)
    if is_log:
        factor = np.maximum(factor, LEAST_ON_LOG)
    left.plot(factor[drawn], y[drawn], "o", color="C0", ms=4, alpha=0.8)
    if is_log:
        left.set_xscale("log")
        left.xaxis.set_major_formatter("{x:g}")
    for row in np.flatnonzero(np.isnan(losses.dynamic_factor[rows])):
        text = " no factor: more broke" if losses.broken[rows[row]] > 0 else " no factor"
        left.text(1.0, row, text, va="center", fontsize=canvas.SMALL, color="0.5")
    left.axvline(1.0, color="0.6", lw=0.8)
    left.axvline(2.0, color="0.6", lw=0.8, ls=":")
    left.set_xlabel("largest dynamic factor of each sample in which no more broke [-]; dotted: 2")
    _draw_consequences(right, losses, rows)
    left.set_yticks(np.arange(len(rows)), losses.name[rows])
    left.set(ylabel="removed", ylim=(len(rows) - 0.5, -0.5))
    extent = f" (the worst {len(rows)} of {len(order)})" if len(rows) < len(order) else ""
    canvas.set_figure_title(figure, study.title, f": after each removal{extent}")
    return figure


def _has_dominant(factor: np.ndarray) -> bool:
    """Whether some factors are so large that they would hide the others."""
    return bool((factor[np.isfinite(factor)] > MAX_DYNAMIC_FACTOR).any())


def _draw_consequences(axes: Axes, losses: Losses, rows: np.ndarray) -> None:
    """Draw the lost share of the roof, with the number of further fractures or a remark on no equilibrium."""
    lost = 100 * np.nan_to_num(losses.detached_area[rows])
    axis_end = max(10.0, 1.25 * lost.max(initial=0.0))
    no_equilibrium = losses.no_equilibrium[rows] > 0
    colours = np.where(no_equilibrium, canvas.BROKEN, "C0")
    axes.barh(np.arange(len(rows)), lost, color=colours, height=0.7)
    for y, k in enumerate(rows):
        broken = losses.broken[k]
        text = "no equilibrium" if no_equilibrium[y] else f"{broken:.0f} broke" if broken > 0 else ""
        text += f" ({losses.left_out[k]} left out)" * bool(losses.left_out[k])
        colour = canvas.BROKEN if no_equilibrium[y] else "0.3"
        axes.text(lost[y] + 0.015 * axis_end, y, text, va="center", fontsize=canvas.SMALL, color=colour)
    axes.set(xlim=(0, axis_end), xlabel="largest detached part of the roof [%], and further broken elements")
