"""Picture of the spread of the collapse: broken elements over the time since the first fracture."""

import matplotlib.pyplot as plt
import numpy as np

from netfall.post.plots.canvas import add_legend_below, open_charts, set_figure_title
from netfall.study.answers.read import Study
from netfall.study.answers.samples import SPEED

MOST_LINES = 300  # samples that are drawn
POINTS = 200  # points in time
SHOWN = 0.995  # share of all fractures within the time range of the picture


def spread(study: Study):
    """Draw a thin line for each sample that broke, with the median and the 5 to 95 % band.

    A sample whose exposure has ended keeps its last count.
    """
    courses = _break_times(study)
    first = study.samples["first_fracture"]
    remaining = np.array([study.samples["duration"][k] - first[k] for k in courses])
    times = np.concatenate(list(courses.values()))
    span = max(1.05 * np.quantile(times, SHOWN), 0.05 * remaining.max(), 1e-3)
    figure, ((axes,),) = open_charts(1, 1, 9, 5.4)
    lines = _lines(study, axes, courses, remaining)
    grid = np.linspace(0.0, span, POINTS)
    count = np.array([np.searchsorted(t, grid, side="right") for t in courses.values()], float)
    low, middle, high = np.quantile(count, (0.05, 0.5, 0.95), axis=0)
    label = f"5 to 95 % of {len(courses)} samples (to the end of the exposure)"
    axes.fill_between(grid, low, high, color="k", alpha=0.12, lw=0, label=label)
    axes.plot(grid, middle, color="k", lw=2.2, label="median")
    axes.set_xlim(0, span)
    axes.set_ylim(bottom=0)
    axes.set_xlabel("time since the first fracture [s]")
    axes.set_ylabel("elements broken")
    if lines is not None:
        figure.colorbar(lines, ax=axes, label="mean wind speed [m/s]")
    add_legend_below(figure, axes, ncols=2)
    set_figure_title(figure, study.title, f": spread of the collapse in {len(courses)} samples that broke")
    return figure


def _break_times(study: Study) -> dict[int, np.ndarray]:
    """Return the times [s] of first breaks of elements since the first fracture, by row of the sample."""
    e = study.events
    _, first = np.unique(np.stack([e["sample"], e["element"]], 1), axis=0, return_index=True)
    first = first[study.finished[e["sample"][first]]]
    sample, time = e["sample"][first], e["time"][first]
    order = np.lexsort((time, sample))
    rows, start = np.unique(sample[order], return_index=True)
    courses = np.split(time[order], start[1:])
    return {int(k): t - t[0] for k, t in zip(rows, courses)}


def _lines(study: Study, axes, courses: dict[int, np.ndarray], remaining: np.ndarray):
    """Draw step curves of some samples, evenly chosen, coloured by wind speed; return the colour mapping."""
    speeds = study.samples.get(SPEED)
    varied = speeds is not None and len(np.unique(speeds)) > 1
    colours = plt.cm.ScalarMappable(plt.Normalize(speeds.min(), speeds.max()), "viridis") if varied else None
    chosen = np.unique(np.linspace(0, len(courses) - 1, MOST_LINES).astype(int))
    rows = list(courses)
    for i in chosen:
        t = np.append(courses[rows[i]], max(remaining[i], courses[rows[i]][-1]))
        count = np.append(np.arange(1, len(t)), len(t) - 1)
        colour = colours.to_rgba(speeds[rows[i]]) if varied else "C0"
        axes.plot(t, count, drawstyle="steps-post", color=colour, lw=0.5, alpha=0.5)
    return colours
