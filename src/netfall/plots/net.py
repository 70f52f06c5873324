"""Groups of elements by colour and name, and the picture of a net that was read."""

import matplotlib.pyplot as plt
import numpy as np

from netfall.plots.canvas import BROKEN, CYCLE, SPRING, add_lines, heading, save, space_panels

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


def as_read(lines, group: list[str], held, sprung, marks, title: str, path) -> None:
    """Write a picture of a net that was read: lines (m, 2, 3) [m] by group, supports (h, 3), elastic ones
    (s, 3), and marks (k, 3) where something is wrong with it.
    """
    names, of = np.unique(group, return_inverse=True)
    every = max(1, len(lines) // MOST_READ)
    figure, (axes,) = space_panels(lines.reshape(-1, 3), 1, 0.8)
    labels = named_groups(names.tolist(), np.bincount(of))
    for k, colour in enumerate(group_colours(len(names))):
        add_lines(axes, lines[::every][of[::every] == k], colors=[colour], linewidths=0.9, label=labels[k])
    for places, marker, colour, label in (
        (held, "s", "#222222", f"supports, {len(held)}"),
        (sprung, "D", SPRING, f"springs, {len(sprung)}"),
        (np.reshape(marks, (-1, 3)), "x", BROKEN, f"faults, {len(marks)}"),
    ):
        if len(places):
            style = dict(marker=marker, color=colour, s=14, depthshade=False, clip_on=False)
            axes.scatter(*places[:MOST_READ].T, label=label, **style)
    figure.legend(loc="lower center", ncols=4)
    heading(figure, title, ", as it was read")
    save(figure, path)
