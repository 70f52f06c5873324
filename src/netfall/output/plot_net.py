"""Pictures of the net in space: the form that was found, the stages of a collapse."""

import matplotlib.pyplot as plt
import numpy as np
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from netfall.output.frames import Frames
from netfall.output.plot_style import short_title, unit_of

STAGES = 6  # pictures of the collapse
MOST_READ = 20_000  # elements in the picture of a net that was read
MOST_NAMED = 12  # groups in a legend
MOST_DRAWN = 60_000  # elements in a picture; of larger nets every k-th is drawn
STYLES = (("taut", "#30507a", 0.8), ("slack", "#9ab8d8", 0.6), ("broken", "#d62728", 1.1))


def form(f):
    """The form that was found, its elements coloured by tension."""
    x, N = f["form_finding/position"][:], f["form_finding/tension"][:]
    elements = f["net/elements"][:]
    every = max(1, len(elements) // MOST_DRAWN)
    figure = plt.figure(figsize=(9, 6.2))
    axes = _space(figure, (1, 1, 1), x)
    factor, unit = unit_of(np.abs(N).max(), "N")
    lines = Line3DCollection(x[elements[::every]], array=factor * N[::every], cmap="viridis", linewidths=1.4)
    if np.ptp(N) <= 1e-6 * np.abs(N).max():
        lines.set_clim(factor * N.mean() * 0.99, factor * N.mean() * 1.01)
    axes.add_collection3d(lines)
    figure.subplots_adjust(left=0.0, right=1.0, top=0.98, bottom=0.14)
    bar = figure.colorbar(lines, cax=figure.add_axes((0.3, 0.1, 0.4, 0.025)), orientation="horizontal")
    bar.set_label(f"axial force [{unit}], {factor * N.min():.4g} to {factor * N.max():.4g}")
    figure.suptitle(
        f"{short_title(f)}: form, {f['form_finding/iterations'][()]} iterations, "
        f"residual {f['form_finding/residual'][()]:.1e} of the prestress",
        fontsize=10,
    )
    return figure


def collapse(f):
    """Stages of the collapse: intact elements grey, slack ones pale, broken ones red."""
    frames = Frames(f)
    events = f["events/time"][:]
    steps = stage_steps(frames, events)
    start = frames.lines(0).reshape(-1, 3)
    low, high = start.min(0), start.max(0)
    reach = 0.25 * (high - low).max()
    window = np.array([low - [0, 0, 0.3 * reach], high + [0, 0, reach]])
    rows = -(-len(steps) // 2)
    figure = plt.figure(figsize=(11, 3.6 * rows + 0.7))
    for k, step in enumerate(steps):
        _draw_stage(_space(figure, (rows, 2, k + 1), window), frames, step, window, reach)
    handles = [plt.Line2D([], [], color=colour, lw=2, label=name) for name, colour, _ in STYLES]
    figure.legend(handles=handles, loc="lower center", ncols=3, frameon=False)
    figure.suptitle(f"{short_title(f)}: {'collapse' if len(events) else 'motion'}")
    height = figure.get_figheight()
    margins = {"top": 1 - 0.9 / height, "bottom": 0.5 / height, "hspace": 0.12, "wspace": 0.02}
    figure.subplots_adjust(left=0.02, right=0.98, **margins)
    return figure


def _draw_stage(axes, frames: Frames, step: int, window: np.ndarray, reach: float) -> None:
    """The elements at a step that are within `reach` [m] of the window (2, 3)."""
    every = max(1, frames.cells // MOST_DRAWN)
    lines, N = frames.lines(step)[::every], frames.cell("tension", step)[::every]
    broken = frames.cell("broken", step)[::every].astype(bool)
    inside = ((lines >= window[0] - reach) & (lines <= window[1] + reach)).all((1, 2))
    for (_, colour, width), which in zip(STYLES, (~broken & (N != 0), ~broken & (N == 0), broken)):
        if (which & inside).any():
            axes.add_collection3d(Line3DCollection(lines[which & inside], colors=colour, linewidths=width))
    count, away = int(frames.cell("broken", step).sum()), int((~inside).sum())
    out_of_view = f", {away} out of view" if away else ""
    axes.set_title(f"t = {frames.times[step]:.2f} s: {count} broken{out_of_view}", fontsize=9)


def stage_steps(frames: Frames, events: np.ndarray) -> list[int]:
    """Steps to show: the start, just before the first fracture, then evenly over the fractures.

    Evenly in time where there is no fracture.
    """
    last = len(frames.times) - 1
    if not len(events):
        return sorted(set(np.linspace(0, last, STAGES).astype(int).tolist()))
    after = lambda t: int(min(np.searchsorted(frames.times, t), last))
    shares = np.quantile(events, [0.0, 0.1, 0.35, 0.7])
    chosen = [0, max(0, after(events[0]) - 1)] + [after(t) for t in shares]
    steps = sorted(set(chosen))
    for extra in np.linspace(after(events[0]), last, STAGES + 2).astype(int).tolist():
        if len(steps) >= STAGES:
            break
        steps = sorted(set(steps) | {extra})
    return steps


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


def as_read(lines, group: list[str], held, marks, title: str, path) -> None:
    """Write a picture of a net that was read: lines (m, 2, 3) [m] by group, supports (h, 3), and marks (k, 3)
    where something is wrong with it.
    """
    names = sorted(set(group))
    every = max(1, len(lines) // MOST_READ)
    figure = plt.figure(figsize=(9, 6.2))
    axes = _space(figure, (1, 1, 1), lines.reshape(-1, 3))
    colours = plt.get_cmap("tab10" if len(names) <= 10 else "tab20")
    of = np.array([names.index(name) for name in group])[::every]
    for k, name in enumerate(names):
        shown = lines[::every][of == k]
        label = f"{name or '(none)'}, {int(np.sum(np.array(group) == name))}" if k < MOST_NAMED else None
        axes.add_collection3d(
            Line3DCollection(shown, colors=[colours(k % 20)], linewidths=0.9, label=label, clip_on=False)
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
    figure.savefig(path, dpi=130)
    plt.close(figure)
