"""Pictures of the roof, its elements coloured: by how far they are used, and by their dynamic factors."""

from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm, Normalize
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from netfall.checks.cables import Checked, only_compressed
from netfall.checks.reactions import held_axes
from netfall.plots.force import MOST_DRAWN, add_supports, limits
from netfall.plots.net import _space
from netfall.plots.style import short_title, unit_of
from netfall.results.file import carried_in
from netfall.results.losses import lost_at
from netfall.results.overload_lines import overloaded
from netfall.results.states import Envelope, start_position
from netfall.write.locks import whole

NOTHING = "#b8b8b8"  # what has no value: no strength, only compressed, no factor
OVER = "#e000c0"  # what is used by more than its resistance
LOST = OVER
TICKS = 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0  # of a logarithmic scale
COLOURS = "turbo"
MUCH = 10.0  # a factor from which on the scale is logarithmic


@dataclass(frozen=True)
class Shading:
    """Values (m,) of the elements, nan: none, and their scale.

    over : colour of what is beyond its end; words : what the picture shows; label : of the scale
    """

    values: np.ndarray
    scale: Normalize
    over: str
    words: str
    label: str


def utilisation(f, envelope: Envelope, checked: Checked, path: Path) -> None:
    """Write the picture: by the utilisation of the first check; by the tension where nothing has one."""
    name, over = checked.checks[0].name, OVER
    values, high = checked.utilisation[name], 1.0
    if np.isfinite(values).any():
        label = f"utilisation, {name}; grey: none; magenta: above 1"
    else:
        factor, unit = unit_of(np.abs(envelope.most).max(), "N")
        values = factor * np.where(only_compressed(f, envelope), np.nan, envelope.most)
        label = f"largest tension [{unit}]; no element has a strength; grey: only compressed"
        over = plt.get_cmap(COLOURS)(1.0)
        high = (limits(values[values > 0.0]) or (0.0, 1e-9))[1]  # not the largest: that is a fragment's
    if "events" in f and "envelope" in f and (beyond := int(overloaded(carried_in(f)).sum())):
        label += f"; {beyond} beyond strength after a fracture: of the step"
    _write(f, Shading(values, Normalize(0.0, high), over, "how far elements are used", label), path)


def dynamic_factors(f, factor: np.ndarray, path: Path) -> None:
    """Write the picture of the largest dynamic factors (m,) after losses, nan: none; dashed: lost."""
    known = factor[np.isfinite(factor)]
    high = float(max(2.0, np.percentile(known, 99))) if len(known) else 2.0
    low = float(min(1.0, known.min(initial=1.0)))
    scale = LogNorm(low, high) if high > MUCH and low > 0.0 else Normalize(low, high)
    label = "dynamic factor, (peak - before) / (at rest afterwards - before); grey: none; magenta: lost"
    over = plt.get_cmap(COLOURS)(1.0)
    words = "dynamic factors after losses, the largest of each element"
    _write(f, Shading(factor, scale, over, words, label), path)


def _write(f, shading: Shading, path: Path) -> None:
    figure = _draw(f, shading)
    with whole(path) as place:
        figure.savefig(place, dpi=130)
    plt.close(figure)


def _draw(f, shading: Shading):
    """The net in space and in plan, coloured; squares and dots: supports."""
    x, values = start_position(f), shading.values
    figure = plt.figure(figsize=(14, 6.6))
    space, plan = _space(figure, (1, 2, 1), x), figure.add_subplot(1, 2, 2)
    _add_lines(f, space.add_collection3d, Line3DCollection, x, shading)
    _add_lines(f, plan.add_collection, LineCollection, x[:, :2], shading)
    held = held_axes(f).any(1)
    size = min(4.0, 40 / len(x) ** 0.4)
    add_supports(f, space, x)
    plan.plot(*x[held, :2].T, ".", color="k", ms=size)
    plan.autoscale_view()
    plan.set_aspect("equal")
    plan.set_xlabel("x [m]")
    plan.set_ylabel("y [m]")
    figure.subplots_adjust(left=0.02, right=0.97, top=0.94, bottom=0.2, wspace=0.22)
    most = float(np.nanmax(values)) if np.isfinite(values).any() else np.nan
    bar = figure.colorbar(
        plt.cm.ScalarMappable(shading.scale, _palette(shading)),
        cax=figure.add_axes((0.3, 0.09, 0.4, 0.028)),
        orientation="horizontal",
        extend="max" if most > shading.scale.vmax else "neither",
        format="{x:g}",
    )
    if isinstance(shading.scale, LogNorm):
        bar.set_ticks([tick for tick in TICKS if shading.scale.vmin <= tick <= shading.scale.vmax])
    bar.set_label(
        f"{shading.label}; largest {most:.4g}" if np.isfinite(most) else f"{shading.label}; no values"
    )
    figure.suptitle(f"{short_title(f)}: {shading.words}, in space and in plan", fontsize=11)
    return figure


def _add_lines(f, add, kind, x: np.ndarray, shading: Shading) -> None:
    """Add the elements between places x (n, 2 or 3), the largest values on top; those that have a colour.

    Where it is a picture of what a loss did, what was lost is dashed.
    """
    elements, values = f["net/elements"][:], shading.values
    order = np.argsort(np.where(np.isfinite(values), values, -np.inf), kind="stable")
    order = order[::-1][:: max(1, len(order) // MOST_DRAWN)][::-1]
    known = np.isfinite(values[order])
    none = order[~known]
    lost = np.isfinite(lost_at(f)[none])
    width = float(np.clip(60.0 / np.sqrt(len(elements)), 0.6, 2.0))
    if (~lost).any():
        add(kind(x[elements[none[~lost]]], colors=NOTHING, linewidths=0.7, clip_on=False))
    if lost.any():
        add(kind(x[elements[none[lost]]], colors=LOST, linewidths=width, linestyles="--", clip_on=False))
    rows = order[known]
    if len(rows):
        colours = dict(cmap=_palette(shading), norm=shading.scale)
        add(kind(x[elements[rows]], array=values[rows], linewidths=width, clip_on=False, **colours))


def _palette(shading: Shading):
    return plt.get_cmap(COLOURS).with_extremes(over=shading.over)
