"""The dynamic stage in space, at moments when something happens."""

import matplotlib.pyplot as plt
import numpy as np

from netfall.plots.canvas import BROKEN, MOST_DRAWN, add_lines, heading, space_panels
from netfall.plots.force import TRACE, add_supports
from netfall.results.file import title_of
from netfall.results.frames import Frames
from netfall.results.losses import lost_at

STAGES = 6  # pictures
OF_FRACTURES = (0.0, 0.1, 0.35, 0.7, 1.0)  # shares of them at which a picture is due
IN_VIEW = 2.0, 98.0  # percentiles of where elements are in the pictures
FARTHEST = 0.35  # of the largest extent of the net, beyond it, that the view reaches at most
STYLES = (
    ("taut", "#30507a", 0.8),
    ("compressed", "#c77700", 0.9),
    ("slack", "#9ab8d8", 0.6),
    ("broken; dashed: lost", BROKEN, 1.5),
)


def collapse(f):
    """Stages of the motion: taut, compressed, slack and broken elements by colour, supports as squares."""
    frames = Frames(f)
    steps = stage_steps(frames.times, *_happenings(f))
    window = view(frames, steps)
    figure, panels = space_panels(window, len(steps))
    start, elements = frames.positions(0)[: len(f["net/fixed"])], f["net/elements"][:]
    lost = lost_at(f)
    trace = TRACE * float(np.abs(f["envelope/tension_max"][:]).max())
    for axes, step in zip(panels, steps):
        _draw_stage(axes, frames, step, window, trace)
        gone = start[elements[lost <= frames.times[step]]]
        add_lines(axes, gone, colors=BROKEN, linewidths=1.1, linestyles="--")
        add_supports(f, axes, frames.positions(step)[: len(start)])
    handles = [plt.Line2D([], [], color=colour, lw=2, label=name) for name, colour, _ in STYLES]
    handles += axes.get_legend_handles_labels()[0]
    figure.legend(handles=handles, loc="outside lower center", ncols=6)
    what = "collapse" if len(f["events/time"]) else "motion"
    heading(figure, title_of(f), f": {'loss of members, ' * bool(np.isfinite(lost).any())}{what}")
    return figure


def view(frames: Frames, steps: list[int]) -> np.ndarray:
    """The box (2, 3) [m] of the pictures: the net at the start, and nearly all of what moves out of it."""
    start = frames.lines(0).reshape(-1, 3)
    low, high = start.min(0), start.max(0)
    reach = FARTHEST * (high - low).max()
    there = [np.percentile(frames.lines(step).reshape(-1, 3), IN_VIEW, axis=0) for step in steps]
    lowest, highest = np.min(there, axis=0)[0], np.max(there, axis=0)[1]
    return np.array([np.clip(lowest, low - reach, low), np.clip(highest, high, high + reach)])


def within(window: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Which lines (m, 2, 3) [m] are in the box (2, 3) [m], or hardly beyond it."""
    margin = 0.02 * np.ptp(window, axis=0).max()
    return ((lines >= window[0] - margin) & (lines <= window[1] + margin)).all((1, 2))


def _draw_stage(axes, frames: Frames, step: int, window: np.ndarray, trace: float) -> None:
    """The elements at a step that are within the window (2, 3); trace : compression [N] that is none"""
    every = max(1, frames.cells // MOST_DRAWN)
    there = frames.present(step)[::every]
    lines, N = frames.lines(step)[::every][there], frames.tension(step)[::every][there]
    broken = frames.broken(step)[::every][there]
    inside = within(window, lines)
    idle = (N <= 0) & (N >= -trace)
    which = (~broken & (N > 0), ~broken & (N < -trace), ~broken & idle, broken)
    for (_, colour, width), rows in zip(STYLES, which):
        add_lines(axes, lines[rows & inside], colors=colour, linewidths=width)
    gone, away = int(frames.broken(step).sum()), int((~inside).sum()) * every
    out_of_view = f", {away} out of view" if away else ""
    slack = int(which[2].sum()) * every
    axes.set_title(f"t = {frames.times[step]:.4g} s: {gone} broken or lost, {slack} slack{out_of_view}")


def _happenings(f) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Times [s] of fractures, of losses, and of what else is remarkable, the most remarkable first."""
    h, losses = f["history"], np.unique(lost_at(f))
    far = f["envelope/displacement_max"][:]
    moments = [float(f["envelope/displacement_max_time"][int(np.argmax(far))])]
    t, kinetic, slack = h["time"][:], h["kinetic_energy"][:], h["slack"][:]
    peaks = np.flatnonzero((kinetic[1:-1] > kinetic[:-2]) & (kinetic[1:-1] >= kinetic[2:])) + 1
    moments += [float(t[np.argmax(slack)])] * bool(slack.any())
    moments += t[peaks[np.argsort(-kinetic[peaks], kind="stable")]].tolist()
    return f["events/time"][:], losses[~np.isnan(losses)], moments


def stage_steps(times: np.ndarray, fractures, losses, moments: list[float]) -> list[int]:
    """Frames to show, at most STAGES: the start, around the first event, as fractures go on, after losses.

    What is left goes to the other moments in their order, to the end, then evenly to the times between.
    times : of the frames [s]; fractures, losses : their times [s]
    """
    last = len(times) - 1
    before = lambda t: max(int(np.searchsorted(times, t)) - 1, 0)
    after = lambda t: int(min(np.searchsorted(times, t, side="right"), last))
    events, wanted = np.concatenate([fractures, losses]), [0]
    if len(events):
        wanted += [before(events.min()), after(events.min())]
    if len(fractures):
        wanted += [after(t) for t in np.quantile(fractures, OF_FRACTURES, method="higher")]
    wanted += [after(t) for t in losses] + [after(t) for t in moments] + [last]
    wanted += np.linspace(0, last, STAGES).astype(int).tolist()
    return sorted(list(dict.fromkeys(wanted))[:STAGES])
