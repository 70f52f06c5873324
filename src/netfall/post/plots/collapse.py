"""Picture of the dynamic stage in space, at the times of notable events."""

from collections.abc import Iterable

import h5py
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from netfall.post.plots import canvas
from netfall.post.plots.force import NEGLIGIBLE_COMPRESSION, add_supports, shown_forces
from netfall.results.file import Frames, result_title
from netfall.results.removals import removal_times
from netfall.results.states import count_elements, count_slack

STAGES = 6  # panels
FRACTURE_SHARES = (0.0, 0.1, 0.35, 0.7, 1.0)  # shares of all fractures, at which a panel is drawn
VIEW_PERCENTILES = 2.0, 98.0  # percentiles of element positions that the view contains
MAX_VIEW_MARGIN = 0.35  # share of the net's largest extent, by which the view exceeds the net at most
BROKEN = "broken; dashed: out of the net"
STYLES = (
    ("taut", "#30507a", 0.8),
    ("compressed", "#c77700", 0.9),
    ("slack", "#9ab8d8", 0.6),
    (BROKEN, canvas.BROKEN, 1.5),
)


def collapse(f: h5py.File) -> Figure:
    """Draw stages of the motion: taut, compressed, slack and broken elements by colour; and supports."""
    frames, removal_time = Frames(f), removal_times(f)
    removals = np.unique(removal_time[np.isfinite(removal_time)])
    farthest = float(f["envelope/displacement_max_time"][np.argmax(f["envelope/displacement_max"][:])])
    steps = select_snapshots(frames.times, f["events/time"][:], removals, farthest)
    window = view(frames.lines(0), [frames.lines(step) for step in steps])
    figure, panels = canvas.open_space_panels(window, len(steps))
    start, elements = frames.positions(0)[: len(f["net/fixed"])], f["net/elements"][:]
    trace = NEGLIGIBLE_COMPRESSION * float(np.abs(f["envelope/tension_max"][:]).max())
    for axes, step in zip(panels, steps):
        _draw_stage(f, axes, frames, step, window, trace)
        removed = frames.broken(step) & (np.diff(frames.ends(step))[:, 0] == 0)
        removed_lines = start[elements[removed]]
        canvas.add_lines(axes, removed_lines, colors=canvas.BROKEN, linewidths=1.1, linestyles="--")
        add_supports(f, axes, frames.positions(step)[: len(start)])
    handles = [Line2D([], [], color=colour, lw=2, label=name) for name, colour, _ in STYLES]
    handles += axes.get_legend_handles_labels()[0]
    figure.legend(handles=handles, loc="outside lower center", ncols=6)
    event = "member removal, " * bool(len(removals)) + ("collapse" if len(f["events/time"]) else "motion")
    canvas.set_figure_title(figure, result_title(f), f": {event}")
    return figure


def view(start: np.ndarray, later: Iterable[np.ndarray]) -> np.ndarray:
    """Compute the box (2, 3) [m] of the view: the initial net, and nearly all elements that leave it.

    start, later : lines (k, 2, 3) [m] of the initial net, and of the elements to show
    """
    low, high = start.min((0, 1)), start.max((0, 1))
    reach = MAX_VIEW_MARGIN * (high - low).max()
    ranges = [np.percentile(lines.reshape(-1, 3), VIEW_PERCENTILES, axis=0) for lines in later]
    lowest, highest = np.min(ranges, axis=0)[0], np.max(ranges, axis=0)[1]
    return np.array([np.clip(lowest, low - reach, low), np.clip(highest, high, high + reach)])


def within(window: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Select the lines (m, 2, 3) [m] that lie in the box (2, 3) [m], with a small margin."""
    margin = 0.02 * np.ptp(window, axis=0).max()
    return ((lines >= window[0] - margin) & (lines <= window[1] + margin)).all((1, 2))


def _draw_stage(
    f: h5py.File, axes: Axes, frames: Frames, step: int, window: np.ndarray, trace: float
) -> None:
    """Draw the elements at a step in the window (2, 3); smaller compressions than `trace` [N] are ignored."""
    stride = max(1, frames.cells // canvas.MAX_DRAWN)
    present, forces = frames.present(step), shown_forces(f, frames.tension(step))
    fields = frames.lines(step), forces, frames.broken(step)
    in_view = within(window, fields[0])
    lines, N, broken, inside = (values[::stride][present[::stride]] for values in (*fields, in_view))
    kinds = (~broken & (N > 0), ~broken & (N < -trace), ~broken & (N <= 0) & (N >= -trace), broken)
    for (_, colour, width), rows in zip(STYLES, kinds):
        canvas.add_lines(axes, lines[rows & inside], colors=colour, linewidths=width)
    failed, slack = frames.broken_count(step), count_slack(f, fields[1], present & ~fields[2])
    outside = count_elements(f, present & ~in_view)
    out_of_view = f", {outside} out of view" if outside else ""
    axes.set_title(f"t = {frames.times[step]:.4g} s: {failed} broken or removed, {slack} slack{out_of_view}")


def select_snapshots(
    times: np.ndarray, fractures: np.ndarray, removals: np.ndarray, farthest: float
) -> list[int]:
    """Select the snapshots to show, at most STAGES, in this order of priority.

    First come the initial state, the snapshots around the first event, further fractures, and removals. The
    largest displacement follows, then the end, and evenly spaced snapshots.
    times : of the snapshots [s]; fractures, removals : their times [s]; farthest : of the displacement [s]
    """
    last, first = len(times) - 1, min([*fractures, *removals], default=None)
    steps = [0] if first is None else [0, max(int(np.searchsorted(times, first)) - 1, 0)]
    shown = [] if first is None else [first]
    if len(fractures):
        shown += np.quantile(fractures, FRACTURE_SHARES, method="inverted_cdf").tolist()
    after = np.searchsorted(times, [*shown, *removals, farthest], side="right")
    steps += np.minimum(after, last).tolist()
    steps += [last, *np.linspace(0, last, STAGES).astype(int).tolist()]
    return sorted(list(dict.fromkeys(steps))[:STAGES])
