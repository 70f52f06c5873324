"""Picture of annual failure: annual maxima of wind, fragility curves, probability of each measure."""

import numpy as np
from scipy.special import ndtr

from netfall.post.plots import canvas
from netfall.study.answers.hazard import TARGET_RELIABILITY
from netfall.study.answers.read import Study

LEAST = 1e-7  # lower end of the left axis
FLOOR = 1e-2  # share of the smallest probability; bars of intervals that reach further down end there
ROOM = 8.0  # factor on the right axis, for the text at the marks


def hazard(study: Study):
    """Draw annual maxima and fitted curves over the speed (left), and the annual probabilities (right)."""
    h, g = study.hazard, study.fragility
    rows = np.flatnonzero(np.isfinite(h["annual_probability"]))
    figure, ((left, right),) = canvas.open_charts(1, 2, 13, 3.2 + 0.28 * max(len(rows), 6))
    left.semilogy(h["speed"], h["exceedance"], color="0.2", lw=2, label="annual maximum exceeds the speed")
    for j, k in enumerate(rows):
        z = (np.log(h["speed"]) - np.log(g["median"][k])) / g["dispersion"][k]
        left.semilogy(h["speed"], ndtr(z), color=f"C{j}", lw=1.4)  # named in the right panel
    left.set(ylim=(LEAST, 1.5), xlabel="mean wind speed [m/s]", title=f"hazard: {h['distribution']}")
    left.set_ylabel("probability [-]; colours as on the right")
    _draw_probabilities(right, h, rows)
    canvas.add_legend_below(figure, left)
    subtitle = f": probability of failure in a year (exposure {study.exposure})"
    canvas.set_figure_title(figure, study.title, subtitle)
    return figure


def _draw_probabilities(axes, h, rows: np.ndarray) -> None:
    """Draw a line for each measure, the largest on top, with the interval and the targets of EN 1990."""
    y_ticks = np.arange(len(rows))[::-1]
    annual, interval = h["annual_probability"][rows], h["interval"][rows]
    beyond = ""
    for j, (y, p, (low, high)) in enumerate(zip(y_ticks, annual, interval)):
        if np.isfinite(low):
            end = max(low, FLOOR * annual.min())
            axes.plot([end, high], [y, y], color=f"C{j}", lw=2)
            if low < end:
                axes.plot(end, y, "<", color=f"C{j}", ms=6)
                beyond = ", arrows: they go on"
        axes.plot(p, y, "o", color=f"C{j}", ms=6)
        text = f"{p:.2g}, beta {h['beta'][rows[j]]:.2f}, tail {h['tail_share'][rows[j]]:.0%}"
        axes.annotate(text, (p, y), (0, 7), textcoords="offset points", fontsize=canvas.SMALL, ha="center")
    for name, (beta, _) in TARGET_RELIABILITY.items():
        target = ndtr(np.array(-beta))
        axes.axvline(target, color="0.5", lw=1, ls="--")
        style = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points", "color": "0.4"}
        axes.annotate(name, (target, 1.0), (2, -10), fontsize=canvas.SMALL, **style)
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    names = zip(h["measure"][rows], h["curve"][rows])
    axes.set_yticks(y_ticks, [f"{measure}, {curve}" if curve else str(measure) for measure, curve in names])
    axes.set(xlim=(low, ROOM * high), ylim=(-0.7, len(rows) - 0.2))
    axes.set_xlabel(f"probability in a year [-]; bars: 95 %{beyond}; dashed: targets of EN 1990, 1 year")
