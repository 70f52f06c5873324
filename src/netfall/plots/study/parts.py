"""What the pictures of a study share: titles, the net in plan coloured by element."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm

from netfall.plots.style import LONGEST_TITLE
from netfall.study.answers.read import Study

NOTHING = "0.8"  # elements without a value
MOST_DRAWN = 60_000  # elements in a picture; of larger nets those with the largest values are drawn
SHORT = 0.015  # share of the picture, of an element that has a dot
COLOURS = "viridis_r"
MOST_NAMED = 5  # elements with their ids
WIDTH = 6.2  # inches of a panel
SHORTEST, LONGEST = 2.4, 7.0  # inches of its height


def suptitle(figure, study: Study, what: str) -> None:
    """The study's title, and what is shown."""
    title = " ".join(study.title.split())
    title = title if len(title) <= LONGEST_TITLE else title[: LONGEST_TITLE - 3] + "..."
    figure.suptitle(f"{title}: {what}", fontsize=11)


def plan_panels(study: Study, count: int):
    """A figure with panels beside each other that show the net in plan."""
    x = study.net["particles"][:, :2]
    extent = np.ptp(x, axis=0)
    height = float(np.clip(0.8 * WIDTH * extent[1] / max(extent[0], 1e-9), SHORTEST, LONGEST))
    figure, panels = plt.subplots(
        1, count, figsize=(count * WIDTH, height + 1.3), layout="constrained", squeeze=False
    )
    margin = 0.04 * extent.max()
    for axes in panels[0]:
        axes.set_aspect("equal")
        axes.set_xlim(x[:, 0].min() - margin, x[:, 0].max() + margin)
        axes.set_ylim(x[:, 1].min() - margin, x[:, 1].max() + margin)
        axes.set_xlabel("x [m]")
        axes.set_ylabel("y [m]")
    return figure, panels[0]


def draw_values(
    study: Study, axes, values: np.ndarray, label: str, low=0.0, percent=False, names=None, log=False
):
    """The elements coloured by values (m,), nan: grey, the largest on top and named: by ids if no names (m,)
    are given.
    """
    x, elements = study.net["particles"][:, :2], study.net["elements"]
    known = np.isfinite(values)
    width = float(np.clip(90.0 / np.sqrt(len(elements)), 0.5, 3.0))
    every = max(1, len(elements) // MOST_DRAWN)
    rest = np.flatnonzero(~known)[::every]
    axes.add_collection(LineCollection(x[elements[rest]], colors=NOTHING, linewidths=0.5 * width, zorder=1))
    rows = np.flatnonzero(known)
    rows = rows[np.argsort(values[rows], kind="stable")][-MOST_DRAWN:]
    high = values[rows[-1]] if len(rows) else 1.0
    palette = plt.get_cmap(COLOURS)
    lines = LineCollection(
        x[elements[rows]], array=values[rows], cmap=palette, linewidths=width, zorder=2, capstyle="round"
    )
    if log:
        lines.set_norm(LogNorm())
    lines.set_clim(low, high if high > low else low + 1.0)
    axes.add_collection(lines)
    _dot_short(axes, x[elements[rows]], values[rows], lines)
    held = study.net["fixed"].any(1)
    axes.plot(*x[held].T, ".", color="k", ms=min(4.0, 40 / len(x) ** 0.4), zorder=3)
    bar = axes.figure.colorbar(lines, ax=axes, orientation="horizontal", shrink=0.8, pad=0.02)
    bar.set_label(label, fontsize=9)
    if percent:
        bar.ax.xaxis.set_major_formatter(plt.matplotlib.ticker.PercentFormatter(1.0, decimals=None))
    names = (study.net["element_id"] if names is None else names).astype(str)
    _, first = np.unique(names[rows[::-1]], return_index=True)  # of those that share a name, the largest
    _name_largest(axes, study, rows[::-1][np.sort(first)][:MOST_NAMED], names)


def _dot_short(axes, ends: np.ndarray, values: np.ndarray, lines) -> None:
    """A dot of the same colour on elements (k, 2, 2) that are too short for a line to be seen."""
    extent = max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()))
    short = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) < SHORT * extent
    middle = ends[short].mean(1)
    axes.scatter(*middle.T, s=14, c=lines.cmap(lines.norm(values[short])), zorder=3.5, lw=0)


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
                fontsize=8,
                zorder=4,
                bbox={"boxstyle": "round,pad=0.05", "fc": "white", "ec": "none", "alpha": 0.75},
            )
