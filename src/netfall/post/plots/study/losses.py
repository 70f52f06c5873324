"""Pictures of member removals: dynamic factors and lost share of the roof, as a map and as a chart."""

import numpy as np

from netfall.post.plots.canvas import BROKEN, SMALL, open_charts, set_figure_title
from netfall.post.plots.study.parts import draw_values, roof_panels
from netfall.study.answers.losses import TELLING, losses_of, removal_of_element
from netfall.study.answers.read import Study

MOST_ROWS = 50  # removals in the chart
LEAST_ON_LOG = 0.1  # factor: a logarithmic scale shows lower ones, also negative ones, at this one


def loss_map(study: Study):
    """Draw two maps of the elements, coloured by the consequences of their removal.

    Left: largest dynamic factor. Right: lost share of the roof, or further fractures if no removal affects
    the roof.
    """
    losses = losses_of(study)
    row = removal_of_element(study, losses)

    def by_element(values: np.ndarray) -> np.ndarray:
        return np.where(row >= 0, values[row], np.nan)

    figure, (left, right) = roof_panels(study)
    set_figure_title(figure, study.title, ": after the loss of each (the largest on top; dots: supports)")
    factor = by_element(losses.dynamic_factor)
    is_log = _has_dominant(factor)
    if is_log:
        factor = np.maximum(factor, LEAST_ON_LOG)
    low = float(min(1.0, np.nanmin(factor))) if np.isfinite(factor).any() else 1.0
    names = np.where(row >= 0, losses.name[row], "")
    label = "largest dynamic factor (grey: none)"
    draw_values(study, left, factor, label, low=low, names=names, log=is_log)
    lost = (losses.detached_area > 0).any()
    consequence = losses.detached_area if lost else losses.broken
    label = "share of the roof lost (grey: nothing)" if lost else "elements that broke besides (grey: none)"
    plotted = by_element(np.where(consequence > 0, consequence, np.nan))
    draw_values(study, right, plotted, label, percent=lost, names=names)
    return figure


def removal_chart(study: Study):
    """Draw a dot for each sample in a row for each removal, and the further fractures.

    Removals without an equilibrium come first, then those with the largest lost roof, fractures and dynamic
    factor.
    """
    losses = losses_of(study)
    factor = np.where(study.finished, study.samples.get("dynamic_factor_max", np.nan), np.nan)
    severity = (losses.no_equilibrium > 0, losses.detached_area, losses.broken, losses.dynamic_factor)
    order = np.lexsort([-np.nan_to_num(1.0 * values) for values in reversed(severity)])
    rows = order[:MOST_ROWS]
    row_of = np.full(len(losses.name), -1)
    row_of[rows] = np.arange(len(rows))
    y = row_of[losses.place]
    height = 1.8 + 0.19 * len(rows)
    figure, ((left, right),) = open_charts(1, 2, 11, height, sharey=True, width_ratios=(3, 2))
    drawn = (y >= 0) & np.isfinite(factor)
    is_log = _has_dominant(factor)
    if is_log:
        factor = np.maximum(factor, LEAST_ON_LOG)
    left.plot(factor[drawn], y[drawn], "o", color="C0", ms=4, alpha=0.8)
    if is_log:
        left.set_xscale("log")
        left.xaxis.set_major_formatter("{x:g}")
    for row in np.flatnonzero(np.isnan(losses.dynamic_factor[rows])):
        text = " no factor: more broke" if losses.broken[rows[row]] > 0 else " no factor"
        left.text(1.0, row, text, va="center", fontsize=SMALL, color="0.5")
    left.axvline(1.0, color="0.6", lw=0.8)
    left.axvline(2.0, color="0.6", lw=0.8, ls=":")
    left.set_xlabel("largest dynamic factor of each sample in which no more broke [-]; dotted: 2")
    _draw_consequences(right, losses, rows)
    left.set_yticks(np.arange(len(rows)), losses.name[rows])
    left.set_ylabel("what is lost")
    left.set_ylim(len(rows) - 0.5, -0.5)
    extent = f" (the worst {len(rows)} of {len(order)})" if len(rows) < len(order) else ""
    set_figure_title(figure, study.title, f": after each loss{extent}")
    return figure


def _has_dominant(factor: np.ndarray) -> bool:
    """Whether some factors are so large that they would hide the others."""
    return bool((factor[np.isfinite(factor)] > TELLING).any())


def _draw_consequences(axes, losses, rows: np.ndarray) -> None:
    """Draw the lost share of the roof, with the number of further fractures or a remark on no equilibrium."""
    lost = 100 * np.nan_to_num(losses.detached_area[rows])
    axis_end = max(10.0, 1.25 * lost.max(initial=0.0))
    no_equilibrium = losses.no_equilibrium[rows] > 0
    axes.barh(np.arange(len(rows)), lost, color=np.where(no_equilibrium, BROKEN, "C0"), height=0.7)
    for y, k in enumerate(rows):
        broken = losses.broken[k]
        text = "no rest" if no_equilibrium[y] else f"{broken:.0f} broke" if broken > 0 else ""
        colour = BROKEN if no_equilibrium[y] else "0.3"
        axes.text(lost[y] + 0.015 * axis_end, y, text, va="center", fontsize=SMALL, color=colour)
    axes.set_xlim(0, axis_end)
    axes.set_xlabel("largest share of the roof lost [%], and what broke besides")
