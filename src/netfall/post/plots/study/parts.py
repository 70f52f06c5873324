"""Common parts of study pictures: the net in plan coloured by element, with the largest values labelled."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.ticker import PercentFormatter

from netfall.post.plots.canvas import (
    ROUND_NUMBERS,
    add_coloured,
    add_scale,
    add_space_axes,
    line_width,
    open_plan_panels,
)
from netfall.post.plots.labels import add_labels
from netfall.study.answers.read import Study

SHORT = 0.015  # length / size of the picture; shorter elements get a dot
COLOURS = "viridis_r"
MOST_NAMED = 5  # elements labelled with their ids
UPRIGHT = 0.1  # horizontal / vertical length, below which an element is a strut between layers


def roof_panels(study: Study):
    """Open a figure with two maps of the net, each in plan, and also in space if the net has layers."""
    x, held = study.net["particles"], study.net["fixed"].any(1)
    run, rise = np.hsplit(np.abs(np.diff(x[study.net["elements"]], axis=1)[:, 0]), [2])
    layered = (np.hypot(*run.T) < UPRIGHT * rise[:, 0]).any()  # upright elements connect layers
    figure, panels = open_plan_panels(x[:, :2], held, 4 if layered else 2)
    for unused in panels[2:]:
        unused.remove()
    spaces = [(add_space_axes(figure, (2, 2, 3 + k), x),) if layered else () for k in range(2)]
    return figure, [(plan, *space) for plan, space in zip(panels, spaces)]


def draw_values(
    study: Study, panels, values: np.ndarray, label: str, low=0.0, percent=False, names=None, log=False
):
    """Colour the elements of a map by values (m,), nan: grey, with the largest on top and labelled.

    panels : axes of the map; names : labels (m,), None: ids
    """
    lines = study.net["particles"][study.net["elements"]]
    high = np.nanmax(values) if np.isfinite(values).any() else 1.0
    norm = (LogNorm if log else plt.Normalize)(low, high if high > low else low + 1.0)
    colours = plt.cm.ScalarMappable(norm, COLOURS)
    names = (study.net["element_id"] if names is None else names).astype(str)
    for axes in panels:
        projected = lines[..., : 3 if axes.name == "3d" else 2]
        rows = add_coloured(axes, projected, values, norm, COLOURS, line_width(len(lines), 3.0))
    plan = panels[0]
    _dot_short(plan, lines[rows][..., :2], colours.to_rgba(values[rows]))
    bar = add_scale(plan, norm, COLOURS, label, shrink=0.8)
    if log:
        ticks = ROUND_NUMBERS[(ROUND_NUMBERS >= norm.vmin) & (ROUND_NUMBERS <= norm.vmax)]
        bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
        bar.minorticks_off()
    if percent:
        bar.ax.xaxis.set_major_formatter(PercentFormatter(1.0, decimals=None))
    _, first = np.unique(names[rows[::-1]], return_index=True)  # the largest value of each name
    labelled = rows[::-1][np.sort(first)][:MOST_NAMED]
    add_labels(plan, lines[labelled].mean(1)[:, :2], names[labelled].tolist())


def _dot_short(axes, ends: np.ndarray, colours: np.ndarray) -> None:
    """Add dots in colours (k, 4) on elements (k, 2, 2) that are too short to be seen as lines."""
    extent = max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()))
    short = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) < SHORT * extent
    middle = ends[short].mean(1)
    axes.scatter(*middle.T, s=14, c=colours[short], zorder=3.5, lw=0)
