"""A picture of the roof, its elements coloured by how far they are used."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from netfall.output.place import writing
from netfall.output.plot_force import MOST_DRAWN, add_supports, limits
from netfall.output.plot_net import _space
from netfall.output.plot_style import short_title, unit_of
from netfall.output.reactions import held_axes
from netfall.output.report_cables import Checked
from netfall.output.report_stages import Envelope, start_position

NOTHING = "#b8b8b8"  # what has no strength, or is only compressed
OVER = "#e000c0"  # what is used by more than its resistance
COLOURS = "turbo"


def utilisation(f, envelope: Envelope, checked: Checked, path: Path) -> None:
    """Write the picture: by the utilisation of the first check; by the tension where nothing has one."""
    name, over = checked.checks[0].name, OVER
    values, high = checked.utilisation[name], 1.0
    if np.isfinite(values).any():
        label = f"utilisation, {name}; grey: none; magenta: above 1"
    else:
        factor, unit = unit_of(np.abs(envelope.most).max(), "N")
        values, label = factor * envelope.most, f"largest tension [{unit}]; no element has a strength"
        over = plt.get_cmap(COLOURS)(1.0)
        high = (limits(values[values > 0.0]) or (0.0, 1e-9))[1]  # not the largest: that is a fragment's
    figure = _draw(f, values, high, label, over)
    with writing(path):
        figure.savefig(path, dpi=130)
    plt.close(figure)


def _draw(f, values: np.ndarray, high: float, label: str, over):
    """The net in space and in plan, coloured by values (m,) from 0 to high, nan: grey; dots: supports.

    over : colour of what is beyond
    """
    x = start_position(f)
    figure = plt.figure(figsize=(14, 6.6))
    space, plan = _space(figure, (1, 2, 1), x), figure.add_subplot(1, 2, 2)
    _add_lines(f, space.add_collection3d, Line3DCollection, x, values, (high, over))
    drawn = _add_lines(f, plan.add_collection, LineCollection, x[:, :2], values, (high, over))
    held = held_axes(f).any(1)
    size = min(4.0, 40 / len(x) ** 0.4)
    add_supports(f, space, x)
    plan.plot(*x[held, :2].T, ".", color="k", ms=size)
    plan.autoscale_view()
    plan.set_aspect("equal")
    plan.set_xlabel("x [m]")
    plan.set_ylabel("y [m]")
    figure.subplots_adjust(left=0.02, right=0.97, top=0.94, bottom=0.2, wspace=0.12)
    most = float(np.nanmax(values))
    bar = figure.colorbar(
        drawn,
        cax=figure.add_axes((0.3, 0.09, 0.4, 0.028)),
        orientation="horizontal",
        extend="max" if most > high else "neither",
    )
    bar.set_label(f"{label}; largest {most:.4g}")
    figure.suptitle(f"{short_title(f)}: how far elements are used, in space and in plan", fontsize=11)
    return figure


def _add_lines(f, add, kind, x: np.ndarray, values: np.ndarray, scale: tuple):
    """Add the elements between places x (n, 2 or 3), the most used on top; those that have a colour.

    scale : the value at its end, and the colour beyond
    """
    elements = f["net/elements"][:]
    order = np.argsort(np.where(np.isfinite(values), values, -np.inf), kind="stable")
    order = order[::-1][:: max(1, len(order) // MOST_DRAWN)][::-1]
    known = np.isfinite(values[order])
    if not known.all():
        add(kind(x[elements[order[~known]]], colors=NOTHING, linewidths=0.7))
    width = float(np.clip(60.0 / np.sqrt(len(elements)), 0.6, 2.0))
    palette = plt.get_cmap(COLOURS).with_extremes(over=scale[1])
    rows = order[known]
    lines = kind(x[elements[rows]], array=values[rows], cmap=palette, linewidths=width)
    lines.set_clim(0.0, scale[0])
    add(lines)
    return lines
