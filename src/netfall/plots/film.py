"""The dynamic stage as a film, and the stages of erection, by matplotlib.animation and ffmpeg.

The axes stay: around the roof where it began, with room for nearly all of what moves out of it. So does the
scale of the colours. Elements that broke or were lost are red.
"""

from dataclasses import dataclass
from pathlib import Path

import h5py
import matplotlib.pyplot as plt
import numpy as np
from imageio_ffmpeg import get_ffmpeg_exe
from matplotlib.animation import FFMpegWriter

from netfall.ground.errors import InputError
from netfall.plots.canvas import BROKEN, VIEWS, add_lines, heading, in_space, line_width
from netfall.plots.collapse import view, within
from netfall.plots.force import SLACK, ForceScale, add_by_force, add_supports, force_bars, moving_elements
from netfall.plots.states import force_words
from netfall.results.file import reading, title_of
from netfall.results.frames import Frames, StageFrames
from netfall.results.losses import lost_at
from netfall.write.locks import whole

DPI = 100  # pixels of an inch
MOST_FRAMES = 600  # in a film; of more every k-th is shown
MOST_LINES = 20_000  # elements in a frame; of larger nets every k-th is drawn
MOST_LOOKS = 25  # frames from which the room is found
FASTEST = 50  # frames a second that programs show of a GIF
QUALITY = ["-crf", "24"]  # of MP4: ffmpeg's constant rate factor, 0 without loss to 51
ALONG = 0.98  # cosine between an axis and the eye, from which on it is seen as a point


@dataclass(frozen=True)
class Shot:
    """How a film is taken.

    view : elevation and azimuth of the eye [degrees]; size : (width, height) [pixels], even, as MP4 needs
    zoom : how much larger than what fits; until : [s], where it ends
    """

    view: tuple[float, float] = VIEWS["space"]
    size: tuple[int, int] = (720, 600)
    zoom: float = 1.0
    until: float = np.inf


class Motion(Frames):
    """The dynamic stage as a film. Raises InputError where it ends before the second frame."""

    name, fps, bar = "collapse", 15, "time [s]; red: fractures and losses"

    def __init__(self, f: h5py.File, until: float):
        super().__init__(f)
        self.f, lost = f, lost_at(f)
        self.lost = lost[np.isfinite(lost)]
        count = int(np.searchsorted(self.times, until, side="right"))
        if count < 2:
            raise InputError(f"--until {until:g}: the second frame is at {self.times[1]:.4g} s")
        self.steps, self.begin = np.arange(0, count, -(-count // MOST_FRAMES)), self.times[0]
        self.strokes = np.unique(np.concatenate([f["events/time"][:], self.lost]))

    def add_supports(self, axes, step: int) -> None:
        """Mark the supports of a frame."""
        add_supports(self.f, axes, self.positions(step)[: len(self.f["net/fixed"])])

    def words(self, step: int, away: int) -> str:
        """Say what a frame shows; away : elements out of view"""
        word, out = "broken or lost" if len(self.lost) else "broken", f", {away} out of view" if away else ""
        gone, there = int(self.broken(step).sum()), self.present(step).sum()
        return f"t = {self.times[step]:.3f} s: {gone} of {there} {word}{out}"

    def span(self, step: int) -> str:
        """Say what has passed up to a frame."""
        return f"{self.times[step] - self.times[0]:.4g} s of the roof"


class Erection(StageFrames):
    """The stages of erection as a film, each of which stands for a while."""

    name, fps, bar, begin, strokes = "erection", 1, "stage of erection", 0.0, ()

    def __init__(self, f: h5py.File):
        super().__init__(f)
        self.f, self.steps = f, np.arange(len(self.times))

    def add_supports(self, axes, step: int) -> None:
        """Mark the supports of a stage."""
        add_supports(self.f, axes, self.positions(step), self.states[step].place)

    def words(self, step: int, away: int) -> str:
        """Say what a stage is."""
        return force_words(self.f, self.states[step])

    def span(self, step: int) -> str:
        """Say what has passed up to a stage."""
        return f"{step + 1} stages of erection"


def animate(
    result: Path, folder: Path, form: str | None, fps: int | None = None, shot: Shot | None = None
) -> list[tuple[Path, str]]:
    """Write RESULT_erection and RESULT_collapse; their paths, and lines that say what they are.

    form : mp4 or gif, None: mp4; fps : frames shown in a second, None: those of the reel
    Raises InputError for a wrong file, and for one without frames.
    """
    form, shot, written = form or "mp4", shot or Shot(), []
    if form == "gif" and (fps or 0) > FASTEST:
        raise InputError(f"--fps {fps}: a GIF shows at most {FASTEST} frames a second; lower it, or take MP4")
    with reading(result) as f, plt.rc_context({"animation.ffmpeg_path": get_ffmpeg_exe()}):
        for reel in _reels(f, result, shot.until):
            folder.mkdir(parents=True, exist_ok=True)
            path = folder / f"{result.stem}_{reel.name}.{form}"
            with whole(path) as place:
                _write(f, reel, shot, place, fps or reel.fps)
            written.append((path, f"{_told(reel, fps or reel.fps)}, {path.stat().st_size / 1e6:.2g} MB"))
    return written


def _write(f: h5py.File, reel: Motion | Erection, shot: Shot, path: Path, fps: int) -> None:
    """Write a film."""
    writer = FFMpegWriter(fps, codec="h264", extra_args=QUALITY if path.suffix == ".mp4" else None)
    film = _Film(f, reel, shot)
    with writer.saving(film.figure, str(path), DPI):
        for step in reel.steps:
            film.show(step)
            writer.grab_frame()
    plt.close(film.figure)


def _told(reel: Motion | Erection, fps: int) -> str:
    """Say what a film is."""
    count, every = len(reel.steps), int(np.diff(reel.steps).min(initial=MOST_FRAMES))
    more = f" (every {every}-th of the file)" * (1 < every < MOST_FRAMES)
    return f"{count} frames{more} at {fps} a second: {count / fps:.3g} s for {reel.span(reel.steps[-1])}"


def _reels(f: h5py.File, result: Path, until: float) -> list[Motion | Erection]:
    """What there is to show in a file, at least one. Raises InputError where there is nothing."""
    reels = [Erection(f)] if "stages" in f else []
    if "VTKHDF/Steps/Values" in f and "history" in f and len(f["VTKHDF/Steps/Values"]) > 1:
        reels.append(Motion(f, until))
    if reels:
        return reels
    raise InputError(
        f"{result}: no frames to animate: the job had neither a dynamic stage nor stages of erection; give "
        "it [dynamics] duration (and [output] frames, the states that are written), run it again, or draw "
        "its pictures without --animate"
    )


class _Film:
    """A figure with the net, scales, legend and a bar of the time, and what goes with the next frame."""

    def __init__(self, f: h5py.File, reel: Motion | Erection, shot: Shot):
        self.reel, self.title = reel, title_of(f)
        self.every = max(1, reel.cells // MOST_LINES)
        looks = np.unique(np.linspace(0, len(reel.steps) - 1, MOST_LOOKS).astype(int))
        self.window = view(reel, reel.steps[looks].tolist())
        N = [np.where(reel.broken(step), 0.0, reel.tension(step))[:: self.every] for step in reel.steps]
        N, moving = np.concatenate(N), moving_elements(f)[:: self.every]
        self.scale = ForceScale.of(N, np.tile(moving, len(reel.steps)))
        size = (shot.size[0] / DPI, shot.size[1] / DPI)
        self.figure = plt.figure(figsize=size, dpi=DPI, layout="constrained")
        grid = self.figure.add_gridspec(2, 1, height_ratios=(30, 1))
        self.axes = _axes(self.figure, grid[0], self.window, shot)
        force_bars(self.axes, self.scale, N)
        self.done = _bar(self.figure.add_subplot(grid[1]), reel)
        self.show(reel.steps[0])
        kinds = [(SLACK, "slack"), (BROKEN, "broken")][: 1 + isinstance(reel, Motion)]
        lines = [plt.Line2D([], [], color=colour, lw=2, label=name) for colour, name in kinds]
        handles = [*self.axes.get_legend_handles_labels()[0], *lines]
        self.axes.legend(handles=handles, loc="upper left")
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")  # places stay from the first frame on

    def show(self, step: int) -> None:
        """Draw a frame of the file in place of the one before."""
        for artist in (*self.axes.collections, *self.axes.lines):
            artist.remove()
        reel = self.reel
        rows = np.flatnonzero(reel.present(step))
        rows = rows[rows % self.every == 0]
        lines, N = reel.lines(step)[rows], reel.tension(step)[rows]
        gone, inside = reel.broken(step)[rows], within(self.window, lines)
        whole, torn = inside & ~gone, inside & gone
        width = line_width(len(lines))
        reel.add_supports(self.axes, step)
        add_by_force(self.axes, lines[whole], N[whole], self.scale, width)
        add_lines(self.axes, lines[torn], colors=BROKEN, linewidths=1.4 * width)
        away = int((~inside).sum()) * self.every
        heading(self.figure, self.title, f"\n{reel.words(step, away)}")
        self.done.set_width(reel.times[step] - reel.begin)


def _axes(figure, place, window: np.ndarray, shot: Shot):
    """Axes in space around a window (2, 3) [m], seen as a shot says."""
    axes = in_space(figure, (place,), window, shot.zoom)
    axes.view_init(*shot.view)
    up, around = np.radians(shot.view)
    eye = np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)
    for axis, along in zip((axes.xaxis, axes.yaxis, axes.zaxis), eye):
        if abs(along) > ALONG:  # it points to the eye: its ticks would be on top of one another
            axis.set_ticks([])
            axis.set_label_text("")
    if shot.zoom > 1.0:  # what is larger than the picture has its axes below the scales
        axes.set_axis_off()
    axes.computed_zorder = False  # supports and broken elements over the others
    return axes


def _bar(axes, reel: Motion | Erection):
    """A bar of the time, or of the stages, with strokes; the part of it that grows."""
    axes.set_xlim(reel.begin, reel.times[reel.steps[-1]])
    axes.set_yticks([])
    axes.set_xlabel(reel.bar)
    axes.vlines(reel.strokes, 0, 1, BROKEN, lw=0.7)
    return axes.add_patch(plt.Rectangle((reel.begin, 0.0), 0.0, 1.0, color="0.75", lw=0))
