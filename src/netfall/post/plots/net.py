"""Groups of elements by colour and name; picture of an imported net."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from netfall.post.plots import canvas

MOST_READ = 20_000  # elements in the picture of an imported net
MOST_NAMED = 12  # groups in a legend


def select_cables(cable: np.ndarray, group: np.ndarray, limit: int) -> tuple[np.ndarray, int]:
    """Select the elements to draw: of many, every k-th cable of each group; also return k.

    cable, group : (m,) numbers; limit : elements that are drawn
    """
    stride = max(1, -(-len(cable) // limit))
    names, first, row = np.unique(cable, return_index=True, return_inverse=True)
    selected = np.zeros(len(names), bool)
    for g in np.unique(group):
        selected[np.flatnonzero(group[first] == g)[::stride]] = True
    return np.flatnonzero(selected[row]), stride


def add_groups(
    axes: Axes,
    lines: np.ndarray,
    group: np.ndarray,
    names: list[str],
    width: float,
    bar: np.ndarray | None = None,
) -> None:
    """Add elements in the colours of their groups, with their numbers in the legend; bars are thicker.

    No colour is red, which marks faults, removal and fracture. Of many groups, the smallest are one entry.
    lines : (m, 2, 3) [m]; group : (m,) rows of names; bar : (m,) bool, None: all are cables
    """
    count = np.bincount(group, minlength=len(names))
    labels, entry = [f"{name or '(no group)'}, {k}" for name, k in zip(names, count)], np.arange(len(names))
    if len(names) > MOST_NAMED:
        named, smallest = np.split(np.argsort(-count, kind="stable"), [MOST_NAMED - 1])
        labels = [labels[g] for g in sorted(named)] + [
            f"{len(smallest)} more groups, {count[smallest].sum()}"
        ]
        entry[np.sort(named)], entry[smallest] = np.arange(len(named)), len(named)
    tab20 = [plt.get_cmap("tab20")(k) for k in range(20)]
    red = {canvas.CYCLE[2], tab20[6], tab20[7]}
    palette = [
        colour for colour in (canvas.CYCLE if len(names) < len(canvas.CYCLE) else tab20) if colour not in red
    ]
    for k, label in enumerate(labels):
        of_entry = entry[group] == k
        is_bars = bar is not None and of_entry.any() and bool(bar[of_entry].all())
        style = {"colors": [palette[k]], "linewidths": (1.8 if is_bars else 1.0) * width}
        canvas.add_lines(axes, lines[of_entry], label=label + " bars" * is_bars, zorder=2, **style)


def draw_imported_net(
    x: np.ndarray,
    ends: np.ndarray,
    group: list[str],
    fixed: np.ndarray,
    spring: np.ndarray,
    marks: list[np.ndarray],
    title: str,
    path: Path,
) -> None:
    """Write the picture of an imported net: elements by group, supports, marks at faults.

    x : (n, 3) [m]; ends : (m, 2); group : (m,) names; fixed, spring : (n, 3) bool, axes; marks : (k, 3) [m]
    """
    names, rows = np.unique(group, return_inverse=True)
    figure, (axes,) = canvas.open_space_panels(x, 1)
    stride = max(1, len(ends) // MOST_READ)
    add_groups(axes, x[ends][::stride], rows[::stride], names.tolist(), 0.9)
    canvas.mark_supports(axes, x, fixed, spring)
    if len(marks):
        style = {"color": canvas.BROKEN, "label": f"faults, {len(marks)}"}
        canvas.add_marks(axes, np.array(marks)[:MOST_READ], "x", ms=6, zorder=4, **style)  # supports have 3
    canvas.add_legend_below(figure, axes)
    canvas.set_figure_title(figure, title, ", as it was read")
    canvas.save(figure, path)
