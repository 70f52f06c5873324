"""Pictures of the roof, its elements coloured: by how far they are used, by dynamic factors, by moments."""

from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm, Normalize

from netfall.checks.cables import Checked, only_compressed
from netfall.checks.reactions import held_axes
from netfall.plots.canvas import (
    add_coloured,
    add_lines,
    dot_supports,
    heading,
    in_space,
    line_width,
    save,
    set_plan,
    unit_of,
)
from netfall.plots.force import add_supports, limits
from netfall.results.file import carried_in, title_of
from netfall.results.losses import lost_at
from netfall.results.overload_lines import overloaded
from netfall.results.states import Envelope, start_position

OVER = "#e000c0"  # what is used by more than its resistance
LOST = OVER
TICKS = 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0  # of a logarithmic scale
COLOURS = "viridis_r"
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
    """Write the picture: by the utilisation of the first check, and of the first one of compressed bars; by
    the tension where nothing has one.
    """
    names, over = [checked.checks[0].name], OVER
    names += [check.name for check in checked.checks[1:] if check.compression][:1]
    values, high = np.fmax.reduce([checked.utilisation[name] for name in names]), 1.0
    if np.isfinite(values).any():
        label = f"utilisation, {', '.join(names)}; grey: none; magenta: above 1"
    else:
        factor, unit = unit_of(np.abs(envelope.most).max(), "N")
        values = factor * np.where(only_compressed(f, envelope), np.nan, envelope.most)
        label = f"largest tension [{unit}]; no element has a strength; grey: only compressed"
        over = plt.get_cmap(COLOURS)(1.0)
        high = (limits(values[values > 0.0]) or (0.0, 1e-9))[1]  # not the largest: that is a fragment's
    if "history" in f and (beyond := int(overloaded(carried_in(f)).sum())):
        label += f"; {beyond} beyond strength after a fracture: of the step"
    _draw(f, Shading(values, Normalize(0.0, high), over, "how far elements are used", label), path)


def dynamic_factors(f, factor: np.ndarray, path: Path) -> None:
    """Write the picture of the largest dynamic factors (m,) after losses, nan: none; dashed: lost."""
    known = factor[np.isfinite(factor)]
    high = float(max(2.0, np.percentile(known, 99))) if len(known) else 2.0
    low = float(min(1.0, known.min(initial=1.0)))
    scale = LogNorm(low, high) if high > MUCH and low > 0.0 else Normalize(low, high)
    label = "dynamic factor, (peak - before) / (at rest afterwards - before); grey: none; magenta: lost"
    over = plt.get_cmap(COLOURS)(1.0)
    words = "dynamic factors after losses, the largest of each element"
    _draw(f, Shading(factor, scale, over, words, label), path)


def moments(f, moment: np.ndarray, path: Path) -> None:
    """Write the picture of the largest bending moments (m,) [N m], nan: no bending."""
    factor, unit = unit_of(float(np.nanmax(moment)), "N m")
    label, over = f"largest bending moment [{unit}]; grey: no bending", plt.get_cmap(COLOURS)(1.0)
    scale = Normalize(0.0, max(factor * float(np.nanmax(moment)), 1e-9))
    _draw(
        f, Shading(factor * moment, scale, over, "bending moments, the largest of each element", label), path
    )


def _draw(f, shading: Shading, path: Path) -> None:
    """Write the net in space and in plan, coloured; squares and dots: supports."""
    x, values = start_position(f), shading.values
    figure = plt.figure(figsize=(14, 6.6))
    space, plan = in_space(figure, (1, 2, 1), x), figure.add_subplot(1, 2, 2)
    _add_elements(f, space, x, shading)
    _add_elements(f, plan, x[:, :2], shading)
    add_supports(f, space, x)
    dot_supports(plan, x[:, :2], held_axes(f).any(1))
    set_plan(plan, x[:, :2])
    space.set_position((0.0, 0.2, 0.44, 0.74))
    plan.set_position((0.55, 0.2, 0.42, 0.74))
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
    heading(figure, title_of(f), f": {shading.words}, in space and in plan")
    save(figure, path)


def _add_elements(f, axes, x: np.ndarray, shading: Shading) -> None:
    """Add the elements between places x (n, 2 or 3) [m]; what was lost, and so has no value, is dashed."""
    lines, lost = x[f["net/elements"][:]], np.isfinite(lost_at(f)) & ~np.isfinite(shading.values)
    width = line_width(len(lines), 2.0)
    add_coloured(axes, lines[~lost], shading.values[~lost], shading.scale, _palette(shading), width)
    add_lines(axes, lines[lost], colors=LOST, linewidths=width, linestyles="--")


def _palette(shading: Shading):
    return plt.get_cmap(COLOURS).with_extremes(over=shading.over)
