"""Pictures of failure over the mean wind speed: fragility curves, and annual probabilities from them."""

import textwrap
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator
from scipy.special import ndtr

from netfall.core.messages import count_of
from netfall.post.plots import canvas
from netfall.study.answers.fragility import is_judged
from netfall.study.answers.hazard import TARGET_RELIABILITY
from netfall.study.answers.read import Study
from netfall.study.answers.statistics import bin_speeds, interval_text, wilson

COLUMNS = 3  # panels in a row
POINTS = 200  # points of a curve
WRAPPED = 44  # characters per line in a panel
MIN_PROBABILITY = 1e-7  # lower end of the axis of probabilities
FLOOR = 1e-2  # share of the smallest probability, at which lower bars of intervals end
TEXT_ROOM_FACTOR = 8.0  # factor on the axis of annual probabilities, for the text at the marks


def fragility(study: Study) -> Figure:
    """Draw a panel for each measure: curves with their bands, observed shares with their intervals."""
    g = study.fragility
    measures, names = (list(dict.fromkeys(g[key])) for key in ("measure", "curve"))
    rows = -(-len(measures) // COLUMNS)
    figure, panels = canvas.open_charts(rows, COLUMNS, 13, 3.7 * rows + 1.0, sharex=True, sharey=True)
    for axes, measure in zip(panels.ravel(), measures):
        for j, name in enumerate(names):
            _draw(axes, g, np.flatnonzero((g["measure"] == measure) & (g["curve"] == name))[0], j, len(names))
        axes.set_title(measure)
        axes.tick_params(labelbottom=True)
    for unused in panels.ravel()[len(measures) :]:
        unused.remove()
    panels[0, 0].set(xlim=(g["band_speed"][0], g["band_speed"][-1]), ylim=(-0.02, 1.02))
    panels[0, 0].xaxis.set_major_locator(MaxNLocator(8, steps=[1, 2, 5, 10]))
    for axes in panels[:, 0]:
        axes.set_ylabel("fraction of runs that fail [-]")
    for axes in panels.ravel()[: len(measures)][-COLUMNS:]:
        axes.set_xlabel(f"mean wind speed [m/s], {study.exposure}")
    figure.legend(handles=_handles(g, names), loc="outside lower center", ncols=4)
    subtitle = f": runs that fail, {study.exposure}{_left_out(study)}"
    canvas.set_figure_title(figure, study.title, subtitle)
    return figure


def _left_out(study: Study) -> str:
    """Return how many samples the curves exclude, for a title."""
    count = int((~is_judged(study.samples)).sum())
    return f"; {count_of(count, 'sample')} left out" if count else ""


def _draw(axes: Axes, g: dict[str, np.ndarray], k: int, j: int, curves: int) -> None:
    """Draw one curve in colour j."""
    colour, speed, band = f"C{j}", g["band_speed"], g["band"][k]
    if np.isfinite(band).all():
        axes.fill_between(speed, band[:, 0], band[:, 1], color=colour, alpha=0.18, lw=0)
    median, dispersion = g["median"][k], g["dispersion"][k]
    if np.isfinite(median):
        speeds = np.linspace(speed[0], speed[-1], POINTS)
        axes.plot(speeds, ndtr((np.log(speeds) - np.log(median)) / dispersion), color=colour, lw=1.6)
    centre, runs, failed = bin_speeds(g["speed"], g["runs"][k], g["failed"][k])
    centre = centre + (j - 0.5 * (curves - 1)) * 0.006 * (speed[-1] - speed[0])  # separates the curves
    share, (low, high) = failed / runs, wilson(runs, failed)
    style: dict[str, Any] = {"fmt": "o", "color": colour, "ms": 4, "lw": 1, "capsize": 2, "alpha": 0.9}
    axes.errorbar(centre, share, [share - low, high - share], **style)
    text_style: dict[str, Any] = {"transform": axes.transAxes, "va": "top", "fontsize": canvas.SMALL}
    axes.text(0.02, 0.97 - 0.07 * j, _text(g, k, curves == 1), color=colour, **text_style)


def _text(g: dict[str, np.ndarray], k: int, long: bool) -> str:
    """Return the median and, in long texts, the dispersion, with intervals; or why there is no curve."""
    median = interval_text(g["median"][k], g["median_interval"][k], 4)
    if np.isfinite(g["median"][k]):
        dispersion = interval_text(g["dispersion"][k], g["dispersion_interval"][k], 3)
        return f"median {median} m/s\ndispersion {dispersion}" if long else f"{median} m/s"
    if long:
        return textwrap.fill(f"no curve: {g['note'][k]}", WRAPPED)
    low, high = g["median_bounds"][k]
    bounds = f"{low:g}" if low == high else f"{low:g} to {high:g}".replace(" to inf", " or more")
    return f"no curve; median {bounds} m/s"


def _handles(g: dict[str, np.ndarray], names: list[str]) -> list[Artist]:
    """Return the legend entries of marks and curves."""
    several, k = len(names) > 1, int(np.argmax(g["samples"]))
    curves = [(f"C{j}", name) for j, name in enumerate(names)] if several else []
    neutral = "0.4" if several else "C0"
    resampled = f"{g['samples'][k]} samples, {g['resampled'][k]} resampled"
    return [
        *(Line2D([], [], color=colour, lw=2, label=name) for colour, name in curves),
        Line2D([], [], color=neutral, lw=1.6, label="lognormal curve of maximum likelihood"),
        Rectangle((0, 0), 1, 1, color=neutral, alpha=0.18, label=f"{g['level']:.0%} band: {resampled}"),
        Line2D(
            [], [], color=neutral, marker="o", ms=4, lw=1, label="observed; bars: 95% interval of each speed"
        ),
    ]


def hazard(study: Study) -> Figure:
    """Draw annual maxima and fitted curves over the speed (left), and the annual probabilities (right)."""
    h, g = study.hazard, study.fragility
    rows = np.flatnonzero(np.isfinite(h["annual_probability"]) | np.isfinite(h["interval"][:, 0]))
    figure, ((left, right),) = canvas.open_charts(1, 2, 13, 3.2 + 0.28 * max(len(rows), 6))
    left.semilogy(h["speed"], h["exceedance"], color="0.2", lw=2, label="annual maximum exceeds the speed")
    for j, k in enumerate(rows):
        z = (np.log(h["speed"]) - np.log(g["median"][k])) / g["dispersion"][k]
        left.semilogy(h["speed"], ndtr(z), color=f"C{j}", lw=1.4)  # named in the right panel
    left.set(xlabel="mean wind speed [m/s]", ylabel="probability [-]; colours as on the right")
    left.set(ylim=(MIN_PROBABILITY, 1.5), title=f"hazard: {h['distribution']}")
    _draw_probabilities(right, h, rows)
    canvas.add_legend_below(figure, left)
    subtitle = f": probability of failure in a year ({study.exposure}){_left_out(study)}"
    canvas.set_figure_title(figure, study.title, subtitle)
    return figure


def _draw_probabilities(axes: Axes, h: dict[str, np.ndarray], rows: np.ndarray) -> None:
    """Draw a line for each measure, the largest on top, with the interval and the targets of EN 1990."""
    y_ticks = np.arange(len(rows))[::-1]
    annual, interval = h["annual_probability"][rows], h["interval"][rows]
    beyond, floor = "", FLOOR * np.nanmin(np.fmin(annual, interval[:, 1]))
    for j, (y, p, (low, high)) in enumerate(zip(y_ticks, annual, interval)):
        if np.isfinite(low):
            end = max(low, floor)
            axes.plot([end, high], [y, y], color=f"C{j}", lw=2)
            if low < end:
                axes.plot(end, y, "<", color=f"C{j}", ms=6)
                beyond = ", arrows: they go on"
        axes.plot(p, y, "o", color=f"C{j}", ms=6)
        text = f"{p:.2g}, beta {h['beta'][rows[j]]:.2f}, tail {h['tail_share'][rows[j]]:.0%}"
        if np.isnan(p):
            text, p = f"no curve, {low:.2g} to {high:.2g}", high
        axes.annotate(text, (p, y), (0, 7), textcoords="offset points", fontsize=canvas.SMALL, ha="center")
    for name, (beta, _) in TARGET_RELIABILITY.items():
        target = ndtr(np.array(-beta))
        axes.axvline(target, color="0.5", lw=1, ls="--")
        style: dict[str, Any] = {
            "xycoords": ("data", "axes fraction"),
            "textcoords": "offset points",
            "color": "0.4",
        }
        axes.annotate(name, (target, 1.0), (2, -10), fontsize=canvas.SMALL, **style)
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    names = zip(h["measure"][rows], h["curve"][rows])
    axes.set_yticks(y_ticks, [f"{measure}, {curve}" if curve else str(measure) for measure, curve in names])
    axes.set(xlim=(low, TEXT_ROOM_FACTOR * high), ylim=(-0.7, len(rows) - 0.2))
    axes.set_xlabel(f"probability in a year [-]; bars: 95 %{beyond}; dashed: targets of EN 1990, 1 year")
