"""What the pictures of a study share: the net in plan coloured by element, the largest values named."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.ticker import PercentFormatter

from netfall.plots.canvas import SMALL, add_coloured, line_width, plan_panels
from netfall.study.answers.read import Study

SHORT = 0.015  # share of the picture, of an element that has a dot
COLOURS = "viridis_r"
MOST_NAMED = 5  # elements with their ids


def roof_panels(study: Study):
    """A figure with two panels that show the net in plan."""
    return plan_panels(study.net["particles"][:, :2], study.net["fixed"].any(1), 2)


def draw_values(
    study: Study, axes, values: np.ndarray, label: str, low=0.0, percent=False, names=None, log=False
):
    """The elements coloured by values (m,), nan: grey, the largest on top and named: by ids if no names (m,)
    are given.
    """
    lines = study.net["particles"][:, :2][study.net["elements"]]
    high = np.nanmax(values) if np.isfinite(values).any() else 1.0
    norm = (LogNorm if log else plt.Normalize)(low, high if high > low else low + 1.0)
    colours = plt.cm.ScalarMappable(norm, COLOURS)
    rows = add_coloured(axes, lines, values, norm, COLOURS, line_width(len(lines), 3.0))
    _dot_short(axes, lines[rows], colours.to_rgba(values[rows]))
    bar = axes.figure.colorbar(colours, ax=axes, orientation="horizontal", shrink=0.8, pad=0.02)
    bar.set_label(label)
    if percent:
        bar.ax.xaxis.set_major_formatter(PercentFormatter(1.0, decimals=None))
    names = (study.net["element_id"] if names is None else names).astype(str)
    _, first = np.unique(names[rows[::-1]], return_index=True)  # of those that share a name, the largest
    _name_largest(axes, study, rows[::-1][np.sort(first)][:MOST_NAMED], names)


def _dot_short(axes, ends: np.ndarray, colours: np.ndarray) -> None:
    """A dot of the same colour (k, 4) on elements (k, 2, 2) that are too short for a line to be seen."""
    extent = max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()))
    short = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) < SHORT * extent
    middle = ends[short].mean(1)
    axes.scatter(*middle.T, s=14, c=colours[short], zorder=3.5, lw=0)


def _name_largest(axes, study: Study, rows: np.ndarray, names: np.ndarray) -> None:
    """Names of elements at their middles, but none on top of another."""
    x = study.net["particles"][:, :2]
    apart, placed = 0.05 * np.ptp(x, axis=0).max(), []
    for e in rows:
        middle = x[study.net["elements"][e]].mean(0)
        if all(np.linalg.norm(middle - other) > apart for other in placed):
            placed.append(middle)
            axes.annotate(
                names[e],
                middle,
                xytext=(4, 6),
                textcoords="offset points",
                fontsize=SMALL,
                zorder=4,
                bbox={"boxstyle": "round,pad=0.05", "fc": "white", "ec": "none", "alpha": 0.75},
            )
