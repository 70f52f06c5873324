"""Groups of elements by colour and name; picture of an imported net."""

import matplotlib.pyplot as plt
import numpy as np

from netfall.post.plots.canvas import (
    BROKEN,
    CYCLE,
    SPACE_STYLE,
    add_lines,
    mark_supports,
    open_space_panels,
    save,
    set_figure_title,
)

MOST_READ = 20_000  # elements in the picture of an imported net
MOST_NAMED = 12  # groups in a legend


def group_colours(count: int) -> list:
    """Return a colour for each of some groups; none is red, which marks faults, removal and fracture."""
    red = {CYCLE[2], plt.get_cmap("tab20").colors[6], plt.get_cmap("tab20").colors[7]}
    palette = CYCLE if count < len(CYCLE) else plt.get_cmap("tab20").colors
    usable = [colour for colour in palette if colour not in red]
    return [usable[k % len(usable)] for k in range(count)]


def group_legend(names: list[str], count) -> list[str | None]:
    """Return the legend text of each group with its number of elements; of many, the last counts the rest."""
    labels: list[str | None] = [f"{name or '(no group)'}, {k}" for name, k in zip(names, count)]
    if len(names) > MOST_NAMED:
        remainder = int(sum(count[MOST_NAMED - 1 :]))
        labels[MOST_NAMED - 1 :] = [None] * (len(names) - MOST_NAMED + 1)
        labels[MOST_NAMED - 1] = f"{len(names) - MOST_NAMED + 1} more groups, {remainder}"
    return labels


def select_cables(x, elements, cable, group, limit: int) -> tuple[np.ndarray, int]:
    """Select the elements that are drawn, as complete cables evenly over each group; and their stride.

    x : (n, 3) [m]; elements : (m, 2); cable, group : (m,) numbers; limit : elements that are drawn
    """
    stride = max(1, -(-len(elements) // limit))
    if stride == 1:
        return np.arange(len(elements)), 1
    name, first, row = np.unique(cable, return_index=True, return_inverse=True)
    middle = x[elements, :2].mean(1)
    centre = np.stack([np.bincount(row, values) for values in middle.T], -1) / np.bincount(row)[:, None]
    selected, group = np.zeros(len(name), bool), group[first]
    for g in np.unique(group):
        rows = np.flatnonzero(group == g)
        selected[rows[morton_order(centre[rows])][::stride]] = True
    return np.flatnonzero(selected[row]), stride


def morton_order(points: np.ndarray) -> np.ndarray:
    """Sort points (k, 2) so that neighbours follow one another, by Morton's curve."""
    box = points - points.min(0)
    cell = (1023 * box / max(box.max(), 1e-9)).astype(np.int64)
    code = sum(((cell[:, axis] >> bit) & 1) << (2 * bit + axis) for bit in range(10) for axis in (0, 1))
    return np.argsort(code, kind="stable")


def add_groups(axes, lines: np.ndarray, group: np.ndarray, names: list[str], width: float, bar=None) -> None:
    """Add elements in the colours of their groups; groups of bars are thicker.

    lines : (m, 2, 3) [m]; group : (m,) rows of names; bar : (m,) bool, None: all are cables
    """
    labels = group_legend(names, np.bincount(group, minlength=len(names)))
    for g, colour in enumerate(group_colours(len(names))):
        in_group = group == g
        is_bars = bar is not None and in_group.any() and bool(bar[in_group].all())
        label, thickness = labels[g] and labels[g] + " bars" * is_bars, 1.8 if is_bars else 1.0
        add_lines(axes, lines[in_group], colors=[colour], linewidths=thickness * width, label=label, zorder=2)


def draw_imported_net(x, ends, group: list[str], fixed, spring, marks, title: str, path) -> None:
    """Write the picture of an imported net: elements by group, supports, marks at faults.

    x : (n, 3) [m]; ends : (m, 2); group : (m,) names; fixed, spring : (n, 3) bool, axes; marks : (k, 3) [m]
    """
    names, rows = np.unique(group, return_inverse=True)
    figure, (axes,) = open_space_panels(x, 1)
    stride = max(1, len(ends) // MOST_READ)
    add_groups(axes, x[ends][::stride], rows[::stride], names.tolist(), 0.9)
    mark_supports(axes, x, fixed, spring)
    if len(marks):
        style = {"ls": "", "marker": "x", "ms": 4, "color": BROKEN, **SPACE_STYLE}
        axes.plot(*np.array(marks)[:MOST_READ].T, label=f"faults, {len(marks)}", **style)
    figure.legend(loc="outside lower center", ncols=4)
    set_figure_title(figure, title, ", as it was read")
    save(figure, path)
