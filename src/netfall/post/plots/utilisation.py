"""Pictures of utilisation, dynamic factors and moments, in space and in plan."""

import h5py
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from netfall.core.functions import along_axes
from netfall.post.checks.cables import FAILED_UTILISATION, ElementCheck, is_only_compressed
from netfall.post.checks.nodes import held_axes
from netfall.post.plots import canvas
from netfall.post.plots.force import OF_MOTION, add_supports, limits
from netfall.results.file import result_title, roof_axes
from netfall.results.removals import removal_times
from netfall.results.states import Envelope, start_position
from netfall.results.warning_text import exceeds_strength
from netfall.study.answers.removals import MAX_DYNAMIC_FACTOR

OVERUSED_COLOUR = "#e000c0"  # elements with a utilisation above 1, and removed ones
COLOURS = "viridis_r"


def utilisation(f: h5py.File, envelope: Envelope, checked: list[ElementCheck]) -> Figure:
    """Draw the utilisation by the first check, the first of compression and those with bending.

    Elements that fail any check have one colour, and the largest utilisation of all checks.
    If no element has a utilisation, the picture shows the tension.
    """
    bars = [one for one in checked[1:] if one.check.compression or one.check.with_moment]
    shown = [checked[0], *bars[:1], *(one for one in bars[1:] if one.check.with_moment)]
    title, over, high = "how far elements are used", OVERUSED_COLOUR, 1.0
    values: np.ndarray = np.fmax.reduce([one.utilisation for one in shown])
    fails = np.logical_or.reduce([one.fails for one in checked])
    of_any = np.fmax.reduce([one.utilisation for one in checked])
    values = np.where(fails, np.fmax(of_any, FAILED_UTILISATION), values)
    if np.isfinite(values).any():
        failed = [one for one in checked if one.fails.any() and one not in shown]
        others = ", ".join(f"{one.fails.sum()} fail {one.name}" for one in failed)
        remark = f" (besides, {others})" if others else ""
        label = (
            f"utilisation, {', '.join(one.name for one in shown)}{remark}; grey: none; magenta: fails a check"
        )
        reasons = sorted({one.reason for one in shown if one.reason})
        title += f" (NOT VERIFIED: {', '.join(reasons)})" * bool(reasons)
    else:
        factor, unit = canvas.unit_of(np.nanmax(np.abs(envelope.most)), "N")
        every = np.ones(len(envelope.names), bool)
        values = factor * np.where(is_only_compressed(f, envelope, every), np.nan, envelope.most)
        label = f"largest tension [{unit}]; no element has a strength; grey: only compressed"
        over = None
        ends = limits(values[values > 0.0], OF_MOTION)  # the largest value can be that of a fragment
        high = ends[1] if ends else 1e-9
    if "history" in f and (beyond := int(exceeds_strength(f).sum())):
        label += f"; {beyond} beyond strength after a fracture: of the step"
    return _draw(f, values, Normalize(0.0, high), title, label, over)


def dynamic_factors(f: h5py.File, factor: np.ndarray) -> Figure:
    """Draw the largest dynamic factors (m,) after removals, nan: none; dashed: removed."""
    finite = factor[np.isfinite(factor)]
    high = float(np.clip(np.percentile(finite, 99), 2.0, MAX_DYNAMIC_FACTOR)) if len(finite) else 2.0
    scale = Normalize(float(min(1.0, finite.min(initial=1.0))), high)
    label = "dynamic factor, (peak - before) / (afterwards - before); grey: none; magenta: removed"
    return _draw(f, factor, scale, "dynamic factors after removals, the largest of each element", label)


def moments(f: h5py.File, moment: np.ndarray) -> Figure:
    """Draw the largest bending moments (m,) [N m], nan: no bending."""
    factor, unit = canvas.unit_of(float(np.nanmax(moment)), "N m")
    scale = Normalize(0.0, max(factor * float(np.nanmax(moment)), 1e-9))
    label = f"largest bending moment [{unit}]; grey: no bending"
    return _draw(f, factor * moment, scale, "bending moments, the largest of each element", label)


def _draw(
    f: h5py.File, values: np.ndarray, scale: Normalize, title: str, label: str, over: str | None = None
) -> Figure:
    """Draw the net in space and in plan, coloured by values; squares and dots are supports.

    values : (m,) of the elements, nan: none; title : of the picture; label : of the scale
    over : colour of values beyond the scale
    """
    x, palette = start_position(f), plt.get_cmap(COLOURS).with_extremes(over=over)
    seen = roof_axes(f)
    x_plan = along_axes(x, seen)[:, :2]
    figure, space, plan = canvas.open_space_and_plan(x)
    for axes, nodes in ((space, x), (plan, x_plan)):
        lines, removed = nodes[f["net/elements"][:]], np.isfinite(removal_times(f)) & ~np.isfinite(values)
        width = canvas.line_width(len(lines), 2.0)
        canvas.add_coloured(axes, lines[~removed], values[~removed], scale, palette, width)
        canvas.add_lines(axes, lines[removed], colors=OVERUSED_COLOUR, linewidths=width, linestyles="--")
    add_supports(f, space, x)
    canvas.add_support_dots(plan, x_plan, np.any(held_axes(f), 1))
    canvas.set_plan(plan, x_plan, roof_axes=seen)
    largest = float(np.nanmax(values)) if np.isfinite(values).any() else np.nan
    label += f"; largest {largest:.4g}" if np.isfinite(largest) else "; no values"
    extend = "max" if scale.vmax is not None and largest > scale.vmax else "neither"
    canvas.add_scale([space, plan], scale, palette, label, extend=extend, format="{x:g}")
    canvas.set_figure_title(
        figure, result_title(f), f": {title}, in space and {'in plan' if seen is None else 'from outside'}"
    )
    return figure
