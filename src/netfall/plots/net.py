"""Groups of elements by colour and name, and the picture of a net that was read."""

import matplotlib.pyplot as plt
import numpy as np

from netfall.plots.canvas import BROKEN, CYCLE, OVER, add_lines, heading, mark_supports, save, space_panels

MOST_READ = 20_000  # elements in the picture of a net that was read
MOST_NAMED = 12  # groups in a legend


def group_colours(count: int) -> list:
    """A colour for each of some groups; none is red, which means faults, loss and fracture."""
    red = {CYCLE[2], plt.get_cmap("tab20").colors[6], plt.get_cmap("tab20").colors[7]}
    many = CYCLE if count < len(CYCLE) else plt.get_cmap("tab20").colors
    plain = [colour for colour in many if colour not in red]
    return [plain[k % len(plain)] for k in range(count)]


def named_groups(names: list[str], count) -> list[str | None]:
    """What a legend says of each group, with its number of elements; of many the last says the rest."""
    labels: list[str | None] = [f"{name or '(no group)'}, {k}" for name, k in zip(names, count)]
    if len(names) > MOST_NAMED:
        rest = int(sum(count[MOST_NAMED - 1 :]))
        labels[MOST_NAMED - 1 :] = [None] * (len(names) - MOST_NAMED + 1)
        labels[MOST_NAMED - 1] = f"{len(names) - MOST_NAMED + 1} more groups, {rest}"
    return labels


def whole_cables(x, elements, cable, group, most: int) -> tuple[np.ndarray, int]:
    """Rows of the elements that are drawn, whole cables, evenly over each group; one of how many is.

    x : (n, 3) [m]; elements : (m, 2); cable, group : (m,) numbers; most : elements that are drawn
    """
    every = max(1, -(-len(elements) // most))
    if every == 1:
        return np.arange(len(elements)), 1
    name, first, row = np.unique(cable, return_index=True, return_inverse=True)
    middle = x[elements, :2].mean(1)
    place = np.stack([np.bincount(row, values) for values in middle.T], -1) / np.bincount(row)[:, None]
    chosen, group = np.zeros(len(name), bool), group[first]
    for g in np.unique(group):
        mine = np.flatnonzero(group == g)
        chosen[mine[in_turn(place[mine])][::every]] = True
    return np.flatnonzero(chosen[row]), every


def in_turn(places: np.ndarray) -> np.ndarray:
    """An order of places (k, 2) in which neighbours follow one another: of Morton's curve."""
    box = places - places.min(0)
    cell = (1023 * box / max(box.max(), 1e-9)).astype(np.int64)
    code = sum(((cell[:, axis] >> bit) & 1) << (2 * bit + axis) for bit in range(10) for axis in (0, 1))
    return np.argsort(code, kind="stable")


def add_groups(axes, lines: np.ndarray, group: np.ndarray, names: list[str], width: float, bar=None) -> None:
    """Add elements by colour of their group, groups of bars thicker.

    lines : (m, 2, 3) [m]; group : (m,) rows of names; bar : (m,) bool, None: all are cables
    """
    labels = named_groups(names, np.bincount(group, minlength=len(names)))
    for g, colour in enumerate(group_colours(len(names))):
        mine = group == g
        bars = bar is not None and mine.any() and bool(bar[mine].all())
        label, times = labels[g] and labels[g] + " bars" * bars, 1.8 if bars else 1.0
        add_lines(axes, lines[mine], colors=[colour], linewidths=times * width, label=label, zorder=2)


def as_read(x, ends, group: list[str], fixed, spring, marks, title: str, path) -> None:
    """Write a picture of a net that was read: its elements by group, supports, and marks where it is faulty.

    x : (n, 3) [m]; ends : (m, 2); group : (m,) names; fixed, spring : (n, 3) bool, axes; marks : (k, 3) [m]
    """
    names, of = np.unique(group, return_inverse=True)
    figure, (axes,) = space_panels(x, 1)
    every = max(1, len(ends) // MOST_READ)
    add_groups(axes, x[ends][::every], of[::every], names.tolist(), 0.9)
    mark_supports(axes, x, fixed, spring)
    if len(marks):
        style = {"ls": "", "marker": "x", "ms": 4, "color": BROKEN, **OVER}
        axes.plot(*np.array(marks)[:MOST_READ].T, label=f"faults, {len(marks)}", **style)
    figure.legend(loc="outside lower center", ncols=4)
    heading(figure, title, ", as it was read")
    save(figure, path)
