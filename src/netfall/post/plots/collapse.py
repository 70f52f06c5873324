"""Picture of the dynamic stage in space, at the times of notable events."""

import matplotlib.pyplot as plt
import numpy as np

from netfall.post.plots.canvas import BROKEN, MAX_DRAWN, add_lines, open_space_panels, set_figure_title
from netfall.post.plots.force import TRACE, add_supports
from netfall.results.file import result_title
from netfall.results.frames import Frames
from netfall.results.losses import lost_at

STAGES = 6  # panels
FRACTURE_SHARES = (0.0, 0.1, 0.35, 0.7, 1.0)  # shares of all fractures, at which a panel is drawn
VIEW_PERCENTILES = 2.0, 98.0  # percentiles of element positions that the view contains
FARTHEST = 0.35  # share of the net's largest extent, by which the view exceeds the net at most
STYLES = (
    ("taut", "#30507a", 0.8),
    ("compressed", "#c77700", 0.9),
    ("slack", "#9ab8d8", 0.6),
    ("broken; dashed: lost", BROKEN, 1.5),
)


def collapse(f):
    """Draw stages of the motion: taut, compressed, slack and broken elements by colour; and supports."""
    frames = Frames(f)
    steps = select_snapshots(frames.times, *_notable_times(f))
    window = view(frames, steps)
    figure, panels = open_space_panels(window, len(steps))
    start, elements = frames.positions(0)[: len(f["net/fixed"])], f["net/elements"][:]
    lost = lost_at(f)
    trace = TRACE * float(np.abs(f["envelope/tension_max"][:]).max())
    for axes, step in zip(panels, steps):
        _draw_stage(axes, frames, step, window, trace)
        removed_lines = start[elements[lost <= frames.times[step]]]
        add_lines(axes, removed_lines, colors=BROKEN, linewidths=1.1, linestyles="--")
        add_supports(f, axes, frames.positions(step)[: len(start)])
    handles = [plt.Line2D([], [], color=colour, lw=2, label=name) for name, colour, _ in STYLES]
    handles += axes.get_legend_handles_labels()[0]
    figure.legend(handles=handles, loc="outside lower center", ncols=6)
    event = "collapse" if len(f["events/time"]) else "motion"
    set_figure_title(
        figure, result_title(f), f": {'loss of members, ' * bool(np.isfinite(lost).any())}{event}"
    )
    return figure


def view(frames: Frames, steps: list[int]) -> np.ndarray:
    """Compute the box (2, 3) [m] of the view: the initial net, and nearly all elements that leave it."""
    start = frames.lines(0).reshape(-1, 3)
    low, high = start.min(0), start.max(0)
    reach = FARTHEST * (high - low).max()
    ranges = [np.percentile(frames.lines(step).reshape(-1, 3), VIEW_PERCENTILES, axis=0) for step in steps]
    lowest, highest = np.min(ranges, axis=0)[0], np.max(ranges, axis=0)[1]
    return np.array([np.clip(lowest, low - reach, low), np.clip(highest, high, high + reach)])


def within(window: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Select the lines (m, 2, 3) [m] that lie in the box (2, 3) [m], with a small margin."""
    margin = 0.02 * np.ptp(window, axis=0).max()
    return ((lines >= window[0] - margin) & (lines <= window[1] + margin)).all((1, 2))


def _draw_stage(axes, frames: Frames, step: int, window: np.ndarray, trace: float) -> None:
    """Draw the elements at a step in the window (2, 3); smaller compressions than `trace` [N] are ignored."""
    stride = max(1, frames.cells // MAX_DRAWN)
    present = frames.present(step)[::stride]
    lines, N = frames.lines(step)[::stride][present], frames.tension(step)[::stride][present]
    broken = frames.broken(step)[::stride][present]
    inside = within(window, lines)
    unloaded = (N <= 0) & (N >= -trace)
    kinds = (~broken & (N > 0), ~broken & (N < -trace), ~broken & unloaded, broken)
    for (_, colour, width), rows in zip(STYLES, kinds):
        add_lines(axes, lines[rows & inside], colors=colour, linewidths=width)
    failed, outside = int(frames.broken(step).sum()), int((~inside).sum()) * stride
    out_of_view = f", {outside} out of view" if outside else ""
    slack = int(kinds[2].sum()) * stride
    axes.set_title(f"t = {frames.times[step]:.4g} s: {failed} broken or lost, {slack} slack{out_of_view}")


def _notable_times(f) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Return the times [s] of fractures, of removals, and of other events, the most notable first."""
    h, losses = f["history"], np.unique(lost_at(f))
    largest_displacement = f["envelope/displacement_max"][:]
    moments = [float(f["envelope/displacement_max_time"][int(np.argmax(largest_displacement))])]
    t, kinetic, slack = h["time"][:], h["kinetic_energy"][:], h["slack"][:]
    peaks = np.flatnonzero((kinetic[1:-1] > kinetic[:-2]) & (kinetic[1:-1] >= kinetic[2:])) + 1
    moments += [float(t[np.argmax(slack)])] * bool(slack.any())
    moments += t[peaks[np.argsort(-kinetic[peaks], kind="stable")]].tolist()
    return f["events/time"][:], losses[~np.isnan(losses)], moments


def select_snapshots(times: np.ndarray, fractures, losses, moments: list[float]) -> list[int]:
    """Select the snapshots to show, at most STAGES, in this order of priority.

    The initial state, the snapshots around the first event, further fractures, and removals come first. Then
    follow the other moments in their order, the end, and evenly spaced snapshots.
    times : of the snapshots [s]; fractures, losses : their times [s]
    """
    last = len(times) - 1

    def before(t: float) -> int:
        return max(int(np.searchsorted(times, t)) - 1, 0)

    def after(t: float) -> int:
        return int(min(np.searchsorted(times, t, side="right"), last))

    events, steps = np.concatenate([fractures, losses]), [0]
    if len(events):
        steps += [before(events.min()), after(events.min())]
    if len(fractures):
        steps += [after(t) for t in np.quantile(fractures, FRACTURE_SHARES, method="higher")]
    steps += [after(t) for t in losses] + [after(t) for t in moments] + [last]
    steps += np.linspace(0, last, STAGES).astype(int).tolist()
    return sorted(list(dict.fromkeys(steps))[:STAGES])
