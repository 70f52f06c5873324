"""Films of the dynamic stage, by matplotlib.animation and ffmpeg.

The axes are fixed around the initial roof, with space for nearly all elements that leave it. The colour scale
is fixed too. Broken and removed elements are red; those out of the net are dashed, at their initial places.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import matplotlib.pyplot as plt
import numpy as np
from imageio_ffmpeg import get_ffmpeg_exe
from matplotlib.animation import FFMpegWriter
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from mpl_toolkits.mplot3d import Axes3D

from netfall.core.errors import InputError
from netfall.post import messages
from netfall.post.plots import canvas, collapse, force
from netfall.results.file import Frames, moves, open_checked, result_title
from netfall.results.locks import whole
from netfall.results.removals import removal_times

DPI = 100  # pixels per inch
FRAME_RATE = 15  # frames per second by default
MAX_FRAMES = 600  # frames in a film; of more, every k-th is shown
LATE = 0.1  # share of the interval by which a frame may follow the end; frames are at whole time steps
MOST_LINES = 20_000  # elements in a frame; of more, every k-th is drawn
FILM_VIEW_SAMPLES = 25  # frames from which the view is computed
MAX_GIF_FRAME_RATE = 50  # frames per second that viewers show of a GIF
QUALITY = ["-crf", "24"]  # ffmpeg's constant rate factor of MP4, from 0 (lossless) to 51
MIN_VIEW_COSINE = 0.98  # cosine between an axis and the view, above which the axis is seen as a point


@dataclass(frozen=True)
class FilmView:
    """View and size of a film.

    view : elevation and azimuth of the eye [degrees]; size : (width, height) [pixels], even, as MP4 needs
    zoom : factor on the size that fits; until : [s], end of the film
    """

    view: tuple[float, float] = canvas.VIEWS["space"]
    size: tuple[int, int] = (720, 600)
    zoom: float = 1.0
    until: float = np.inf


def animate(
    result: Path, folder: Path, form: str | None, fps: int | None = None, shot: FilmView | None = None
) -> tuple[Path, str]:
    """Write RESULT_collapse, and return its path and a line that describes it.

    form : mp4 or gif, None: mp4; fps : frames per second, None: FRAME_RATE

    Raises InputError for a wrong file, a file without snapshots, or an end before the second frame.
    """
    form, shot, rate = form or "mp4", shot or FilmView(), fps or FRAME_RATE
    if form == "gif" and rate > MAX_GIF_FRAME_RATE:
        raise InputError(messages.GIF_TOO_FAST(fps=fps, most=MAX_GIF_FRAME_RATE))
    with open_checked(result) as f, plt.rc_context({"animation.ffmpeg_path": get_ffmpeg_exe()}):
        if not moves(f):
            raise InputError(messages.NOTHING_TO_ANIMATE(path=result))
        frames, path = Frames(f), folder / f"{result.stem}_collapse.{form}"
        times = frames.times
        count = int(np.searchsorted(times, shot.until + LATE * (times[1] - times[0])))
        if count < 2:
            raise InputError(messages.UNTIL_TOO_EARLY(until=shot.until, time=times[1]))
        stride = -(-(count - 1) // (MAX_FRAMES - 1))  # the last frame is shown in addition
        steps = np.append(np.arange(0, count - 1, stride), count - 1)
        writer = FFMpegWriter(rate, codec="h264", extra_args=QUALITY if form == "mp4" else None)
        figure, draw_frame = _open_film(f, frames, steps, shot)
        with whole(path) as temporary, writer.saving(figure, str(temporary), DPI):
            for step in steps:
                draw_frame(step)
                writer.grab_frame()
        plt.close(figure)
    thinning = f" (every {stride}-th of the file)" if stride > 1 else ""
    span = f"{times[steps[-1]] - times[0]:.4g} s of the roof"
    line = f"{len(steps)} frames{thinning} at {rate} a second: {len(steps) / rate:.3g} s for {span}"
    return path, f"{line}, {path.stat().st_size / 1e6:.2g} MB"


def _open_film(
    f: h5py.File, frames: Frames, steps: np.ndarray, shot: FilmView
) -> tuple[Figure, Callable[[int], None]]:
    """Open the figure of a film with scales, legend and time bar; return it and a function to draw a step."""
    every, removals, times = max(1, frames.cells // MOST_LINES), removal_times(f), frames.times
    removals = removals[np.isfinite(removals)]
    total, failed = len(np.unique(frames.element_id[frames.there])), "broken"
    failed += " or removed" * bool(len(removals))
    initial_lines = frames.positions(0)[f["net/elements"][:]]
    samples = np.unique(np.linspace(0, len(steps) - 1, FILM_VIEW_SAMPLES).astype(int))
    window = collapse.view(frames.lines(0), [frames.lines(step) for step in steps[samples]])
    N = [np.where(frames.broken(step), 0.0, frames.tension(step))[::every] for step in steps]
    N, moving = np.concatenate(N), force.moving_elements(f)[::every]
    scale = force.ForceScale.of(N, np.tile(moving, len(steps)), force.OF_MOTION)
    figure = plt.figure(figsize=(shot.size[0] / DPI, shot.size[1] / DPI), dpi=DPI, layout="constrained")
    grid = figure.add_gridspec(2, 1, height_ratios=(30, 1))
    axes, bar = _add_axes(figure, grid[0], window, shot), figure.add_subplot(grid[1])
    force.add_force_scales(axes, scale, N)
    bar.set(xlim=times[steps[[0, -1]]], yticks=[], xlabel="time [s]; red: fractures and removals")
    bar.vlines(np.unique(np.append(f["events/time"][:], removals)), 0, 1, canvas.BROKEN, lw=0.7)
    done = Rectangle((times[0], 0.0), 0.0, 1.0, color="0.75", lw=0)
    bar.add_patch(done)

    def draw_frame(step: int) -> None:
        for artist in (*axes.collections, *axes.lines):
            artist.remove()
        rows = np.flatnonzero(frames.present(step))
        rows = rows[rows % every == 0]
        lines, broken = frames.lines(step)[rows], frames.broken(step)[rows]
        N = force.shown_forces(f, frames.tension(step))[rows]
        inside, width = collapse.within(window, lines), canvas.line_width(len(lines))
        intact = inside & ~broken
        force.add_supports(f, axes, frames.positions(step)[: len(f["net/fixed"])])
        force.add_by_force(axes, lines[intact], N[intact], scale, width)
        canvas.add_lines(axes, lines[inside & broken], colors=canvas.BROKEN, linewidths=1.4 * width)
        removed = broken & (lines[:, 0] == lines[:, 1]).all(axis=1)
        canvas.add_lines(
            axes, initial_lines[rows][removed], colors=canvas.BROKEN, linewidths=1.4 * width, linestyles="--"
        )
        outside = int((~inside).sum()) * every
        words = f"t = {times[step]:.3f} s: {frames.broken_count(step)} of {total} {failed}"
        words += f", {outside} out of view" if outside else ""
        canvas.set_figure_title(figure, result_title(f), f"\n{words}")
        done.set_width(times[step] - times[0])

    draw_frame(steps[0])
    kinds = (force.SLACK, "slack"), (canvas.BROKEN, collapse.BROKEN)
    lines = [Line2D([], [], color=colour, lw=2, label=name) for colour, name in kinds]
    axes.legend(handles=[*axes.get_legend_handles_labels()[0], *lines], loc="upper left")
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # keep the layout of the first frame
    return figure, draw_frame


def _add_axes(figure: Figure, position: SubplotSpec, window: np.ndarray, shot: FilmView) -> Axes3D:
    """Add axes in space around a window (2, 3) [m] with the view of a shot."""
    axes = canvas.add_space_axes(figure, (position,), window, shot.zoom)
    axes.view_init(*shot.view)
    elevation, azimuth = np.radians(shot.view)
    eye = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
    for axis, component in zip((axes.xaxis, axes.yaxis, axes.zaxis), eye):
        if abs(component) > MIN_VIEW_COSINE:  # an axis seen as a point would have overlapping ticks
            axis.set_ticks([])
            axis.set_label_text("")
    if shot.zoom > 1.0:  # axes of an enlarged net would be hidden by the scales
        axes.set_axis_off()
    axes.computed_zorder = False  # draws supports and broken elements on top
    return axes
