"""A net in space: the axes of such pictures, and a net that was read."""

import matplotlib.pyplot as plt
import numpy as np
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from netfall.write.locks import whole

MOST_READ = 20_000  # elements in the picture of a net that was read
MOST_DRAWN = 60_000  # elements in a picture; of larger nets every k-th is drawn
MOST_NAMED = 12  # groups in a legend


def _space(figure, place, points):
    """Axes in space with equal scales around the points (n, 3), labelled in metres."""
    axes = figure.add_subplot(*place, projection="3d")
    low, high = points.min(0), points.max(0)
    extent = np.maximum(high - low, 0.02 * (high - low).max() + 1e-9)
    middle = 0.5 * (low + high)
    for k, limits in enumerate((axes.set_xlim, axes.set_ylim, axes.set_zlim)):
        limits(middle[k] - 0.5 * extent[k], middle[k] + 0.5 * extent[k])
    axes.set_box_aspect(extent, zoom=1.1)
    axes.view_init(elev=28, azim=-60)
    axes.set_xlabel("x [m]", labelpad=6)
    axes.set_ylabel("y [m]", labelpad=6)
    axes.set_zlabel("z [m]", labelpad=0)
    axes.xaxis.set_major_locator(plt.MaxNLocator(5))
    axes.yaxis.set_major_locator(plt.MaxNLocator(4))
    axes.zaxis.set_major_locator(plt.MaxNLocator(3))
    axes.tick_params(labelsize=7, pad=1)
    return axes


def group_colours(count: int) -> list:
    """A colour for each of some groups; none is red, which means faults, loss and fracture."""
    tab = plt.get_cmap("tab10" if count <= 9 else "tab20").colors
    red = {plt.get_cmap("tab20").colors[k] for k in (6, 7)}
    plain = [colour for colour in tab if colour not in red]
    return [plain[k % len(plain)] for k in range(count)]


def named_groups(names: list[str], count) -> list[str | None]:
    """What a legend says of each group, with its number of elements; of many the last says the rest."""
    labels: list[str | None] = [f"{name or '(no group)'}, {k}" for name, k in zip(names, count)]
    if len(names) > MOST_NAMED:
        rest = int(sum(count[MOST_NAMED - 1 :]))
        labels[MOST_NAMED - 1 :] = [None] * (len(names) - MOST_NAMED + 1)
        labels[MOST_NAMED - 1] = f"{len(names) - MOST_NAMED + 1} more groups, {rest}"
    return labels


def as_read(lines, group: list[str], held, marks, title: str, path) -> None:
    """Write a picture of a net that was read: lines (m, 2, 3) [m] by group, supports (h, 3), and marks (k, 3)
    where something is wrong with it.
    """
    names = sorted(set(group))
    every = max(1, len(lines) // MOST_READ)
    figure = plt.figure(figsize=(9, 6.2))
    axes = _space(figure, (1, 1, 1), lines.reshape(-1, 3))
    row = {name: k for k, name in enumerate(names)}
    of = np.array([row[name] for name in group])
    labels = named_groups(names, np.bincount(of))
    for k, colour in enumerate(group_colours(len(names))):
        shown = lines[::every][of[::every] == k]
        axes.add_collection3d(
            Line3DCollection(shown, colors=[colour], linewidths=0.9, label=labels[k], clip_on=False)
        )
    for places, marker, colour, label in (
        (held, "s", "#222222", f"supports, {len(held)}"),
        (np.reshape(marks, (-1, 3)), "x", "#d62728", f"faults, {len(marks)}"),
    ):
        if len(places):
            style = dict(marker=marker, color=colour, s=14, depthshade=False, clip_on=False)
            axes.scatter(*places[:MOST_READ].T, label=label, **style)
    figure.subplots_adjust(left=0.0, right=1.0, top=0.96, bottom=0.12)
    figure.legend(loc="lower center", ncols=4, frameon=False, fontsize=8)
    figure.suptitle(f"{title}, as it was read", fontsize=10)
    with whole(path) as place:
        figure.savefig(place, dpi=130)
    plt.close(figure)
