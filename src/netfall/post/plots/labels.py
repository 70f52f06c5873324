"""Labels in a picture without overlaps, by adjustText."""

import numpy as np
from adjustText import adjust_text
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d import proj3d

from netfall.post.plots.canvas import SMALL, replace_control_characters

BOX = {"boxstyle": "round,pad=0.05", "fc": "white", "ec": "none", "alpha": 0.8}
LEADER = {"arrowstyle": "-", "lw": 0.5, "color": "0.4", "shrinkA": 0, "shrinkB": 0}
ITERATIONS = 500  # about 0.5 s for a picture with 30 labels


def add_labels(axes, points: np.ndarray, texts: list[str]) -> None:
    """Add texts near points (k, 2 or 3) [m], with lines to them. Must be the last addition to the picture."""
    if not texts:
        return
    if points.shape[1] == 3:
        points = np.stack(proj3d.proj_transform(*points.T, axes.get_proj())[:2], 1)
    style = {"fontsize": SMALL, "zorder": 1000, "bbox": BOX, "in_layout": False}
    added = [Axes.text(axes, *point, text, **style) for point, text in zip(points, texts)]
    replace_control_characters(axes.figure)
    axes.figure.draw_without_rendering()  # computes the positions on the page
    adjust_text(added, ax=axes, iter_lim=ITERATIONS)
    for point, text in zip(points, added):  # axes in space cannot draw adjustText's arrows
        axes.annotate("", point, text.get_position(), arrowprops=LEADER, zorder=999)
