"""Labels in a picture, none on top of another."""

import itertools

import numpy as np
from mpl_toolkits.mplot3d import proj3d

from netfall.plots.canvas import SMALL, write_out_controls

DIRECTIONS = ((1, 1), (-1, 1), (1, -1), (-1, -1), (0, 1), (0, -1), (1, 0), (-1, 0))
REACHES = (6, 16, 30, 48, 70, 100, 140, 190)  # points from the place to the nearest corner of its label
WIDE, HIGH = 0.66, 1.7  # of the size of the font: a character, a line
BOX = {"boxstyle": "round,pad=0.05", "fc": "white", "ec": "none", "alpha": 0.8}
LEADER = {"arrowstyle": "-", "lw": 0.5, "color": "0.4", "shrinkA": 0, "shrinkB": 0}


def add_labels(axes, places: np.ndarray, texts: list[str]) -> list[str]:
    """Add texts at places (k, 2 or 3) [m], the first ones first; those for which there was room.

    Each goes where it covers no other label, nor numbers and names of the axes, near its place and within the
    axes, above or below if it is too long for either side, with a line to the place.
    """
    write_out_controls(axes.figure)
    axes.figure.canvas.draw()  # places on the page are known from now on
    if places.shape[1] == 3:
        places = np.stack(proj3d.proj_transform(*places.T, axes.get_proj())[:2], 1)
    points, taken, added = axes.figure.dpi / 72.0, _of_axes(axes), []
    frame = axes.get_window_extent()
    for place, text in zip(places, texts):
        at = axes.transData.transform(place)
        lines = text.split("\n")
        size = points * SMALL * np.array([WIDE * max(map(len, lines)), HIGH * len(lines)])
        # of a corner, the nearest first; then as far to the side as the axes go
        free = itertools.product((False,), REACHES, DIRECTIONS)
        for moved, reach, direction in (*free, *itertools.product((True,), REACHES, ((0, 1), (0, -1)))):
            offset = points * reach * np.array(direction, float)
            low = at + offset - np.where(offset < 0, size, np.where(offset == 0, 0.5 * size, 0.0))
            if moved:
                low[0] = min(max(low[0], frame.x0), frame.x1 - size[0])
            box = np.array([low, low + size])
            inside = (box[0] >= (frame.x0, frame.y0)).all() and (box[1] <= (frame.x1, frame.y1)).all()
            covers = ((box[0] < other[1]).all() and (other[0] < box[1]).all() for other in taken)
            if inside and not any(covers):
                taken.append(box)
                added.append(text)
                axes.annotate(
                    text,
                    place,
                    xytext=(low - at) / points,
                    textcoords="offset points",
                    fontsize=SMALL,
                    zorder=1000,
                    bbox=BOX,
                    arrowprops=LEADER,
                )
                break
    return added


def _of_axes(axes) -> list[np.ndarray]:
    """Where numbers and names of the axes are on the page [pixels]."""
    each = [getattr(axes, f"{name}axis", None) for name in "xyz"]
    texts = [text for axis in each if axis for text in (axis.label, *axis.get_ticklabels())]
    return [text.get_window_extent().get_points() for text in texts if text.get_text()]
