"""Films of the dynamic stage and of the stages of erection, by matplotlib.animation and ffmpeg.

The axes are fixed around the initial roof, with room for nearly all elements that leave it. The colour scale
is fixed too. Broken and removed elements are red.
"""

from dataclasses import dataclass
from pathlib import Path

import h5py
import matplotlib.pyplot as plt
import numpy as np
from imageio_ffmpeg import get_ffmpeg_exe
from matplotlib.animation import FFMpegWriter

from netfall.core.errors import InputError
from netfall.post import messages
from netfall.post.plots.canvas import BROKEN, VIEWS, add_lines, add_space_axes, line_width, set_figure_title
from netfall.post.plots.collapse import view, within
from netfall.post.plots.force import (
    SLACK,
    ForceScale,
    add_by_force,
    add_force_scales,
    add_supports,
    moving_elements,
)
from netfall.post.plots.states import force_words
from netfall.results.file import open_checked, result_title
from netfall.results.frames import Frames, StageFrames
from netfall.results.locks import whole
from netfall.results.losses import lost_at

DPI = 100  # pixels per inch
MAX_FRAMES = 600  # frames in a film; of more, every k-th is shown
MOST_LINES = 20_000  # elements in a frame; of more, every k-th is drawn
FILM_VIEW_SAMPLES = 25  # frames from which the view is computed
FASTEST = 50  # frames per second that viewers show of a GIF
QUALITY = ["-crf", "24"]  # ffmpeg's constant rate factor of MP4, from 0 (lossless) to 51
MIN_VIEW_COSINE = 0.98  # cosine between an axis and the view, above which the axis is seen as a point


@dataclass(frozen=True)
class FilmView:
    """View and size of a film.

    view : elevation and azimuth of the eye [degrees]; size : (width, height) [pixels], even, as MP4 needs
    zoom : factor on the size that fits; until : [s], end of the film
    """

    view: tuple[float, float] = VIEWS["space"]
    size: tuple[int, int] = (720, 600)
    zoom: float = 1.0
    until: float = np.inf


class MotionFilm(Frames):
    """Film of the dynamic stage. Raises InputError if it ends before the second frame."""

    name, fps, bar = "collapse", 15, "time [s]; red: fractures and losses"

    def __init__(self, f: h5py.File, until: float):
        super().__init__(f)
        self.f, lost = f, lost_at(f)
        self.lost = lost[np.isfinite(lost)]
        count = int(np.searchsorted(self.times, until, side="right"))
        if count < 2:
            raise InputError(messages.UNTIL_TOO_EARLY(until=until, time=self.times[1]))
        self.steps, self.begin = np.arange(0, count, -(-count // MAX_FRAMES)), self.times[0]
        self.strokes = np.unique(np.concatenate([f["events/time"][:], self.lost]))

    def mark_supports(self, axes, step: int) -> None:
        """Mark the supports of a frame."""
        add_supports(self.f, axes, self.positions(step)[: len(self.f["net/fixed"])])

    def words(self, step: int, outside: int) -> str:
        """Describe a frame; outside : elements out of view."""
        word, out = (
            "broken or lost" if len(self.lost) else "broken",
            f", {outside} out of view" if outside else "",
        )
        broken_count, present_count = int(self.broken(step).sum()), self.present(step).sum()
        return f"t = {self.times[step]:.3f} s: {broken_count} of {present_count} {word}{out}"

    def span_words(self, step: int) -> str:
        """Describe the time up to a frame."""
        return f"{self.times[step] - self.times[0]:.4g} s of the roof"


class ErectionFilm(StageFrames):
    """Film of the stages of erection, each of which is shown for a while."""

    name, fps, bar, begin, strokes = "erection", 1, "stage of erection", 0.0, ()

    def __init__(self, f: h5py.File):
        super().__init__(f)
        self.f, self.steps = f, np.arange(len(self.times))

    def mark_supports(self, axes, step: int) -> None:
        """Mark the supports of a stage."""
        add_supports(self.f, axes, self.positions(step), self.states[step].place)

    def words(self, step: int, outside: int) -> str:
        """Describe a stage."""
        return force_words(self.f, self.states[step])

    def span_words(self, step: int) -> str:
        """Describe the stages up to this one."""
        return f"{step + 1} stages of erection"


def animate(
    result: Path, folder: Path, form: str | None, fps: int | None = None, shot: FilmView | None = None
) -> list[tuple[Path, str]]:
    """Write RESULT_erection and RESULT_collapse; return their paths and lines that describe them.

    form : mp4 or gif, None: mp4; fps : frames per second, None: default of the film

    Raises InputError for a wrong file, and for one without snapshots.
    """
    form, shot, written = form or "mp4", shot or FilmView(), []
    if form == "gif" and (fps or 0) > FASTEST:
        raise InputError(messages.GIF_TOO_FAST(fps=fps, most=FASTEST))
    with open_checked(result) as f, plt.rc_context({"animation.ffmpeg_path": get_ffmpeg_exe()}):
        for reel in _films(f, result, shot.until):
            folder.mkdir(parents=True, exist_ok=True)
            path = folder / f"{result.stem}_{reel.name}.{form}"
            with whole(path) as temporary:
                _write(f, reel, shot, temporary, fps or reel.fps)
            written.append((path, f"{_film_line(reel, fps or reel.fps)}, {path.stat().st_size / 1e6:.2g} MB"))
    return written


def _write(f: h5py.File, reel: MotionFilm | ErectionFilm, shot: FilmView, path: Path, fps: int) -> None:
    """Write a film."""
    writer = FFMpegWriter(fps, codec="h264", extra_args=QUALITY if path.suffix == ".mp4" else None)
    film = _Film(f, reel, shot)
    with writer.saving(film.figure, str(path), DPI):
        for step in reel.steps:
            film.draw_frame(step)
            writer.grab_frame()
    plt.close(film.figure)


def _film_line(reel: MotionFilm | ErectionFilm, fps: int) -> str:
    """Return the line that describes a film."""
    count, stride = len(reel.steps), int(np.diff(reel.steps).min(initial=MAX_FRAMES))
    thinning = f" (every {stride}-th of the file)" * (1 < stride < MAX_FRAMES)
    span = reel.span_words(reel.steps[-1])
    return f"{count} frames{thinning} at {fps} a second: {count / fps:.3g} s for {span}"


def _films(f: h5py.File, result: Path, until: float) -> list[MotionFilm | ErectionFilm]:
    """Return the films that a file has data for, at least one. Raises InputError if there is none."""
    reels = [ErectionFilm(f)] if "stages" in f else []
    if "VTKHDF/Steps/Values" in f and "history" in f and len(f["VTKHDF/Steps/Values"]) > 1:
        reels.append(MotionFilm(f, until))
    if reels:
        return reels
    raise InputError(messages.NOTHING_TO_ANIMATE(path=result))


class _Film:
    """Figure with the net, scales, legend and time bar, which is drawn again for each frame.

    reel : the film to draw; shot : view and size
    """

    def __init__(self, f: h5py.File, reel: MotionFilm | ErectionFilm, shot: FilmView):
        self.reel, self.title = reel, result_title(f)
        self.every = max(1, reel.cells // MOST_LINES)
        samples = np.unique(np.linspace(0, len(reel.steps) - 1, FILM_VIEW_SAMPLES).astype(int))
        self.window = view(reel, reel.steps[samples].tolist())
        N = [np.where(reel.broken(step), 0.0, reel.tension(step))[:: self.every] for step in reel.steps]
        N, moving = np.concatenate(N), moving_elements(f)[:: self.every]
        self.scale = ForceScale.of(N, np.tile(moving, len(reel.steps)))
        size = (shot.size[0] / DPI, shot.size[1] / DPI)
        self.figure = plt.figure(figsize=size, dpi=DPI, layout="constrained")
        grid = self.figure.add_gridspec(2, 1, height_ratios=(30, 1))
        self.axes = _add_axes(self.figure, grid[0], self.window, shot)
        add_force_scales(self.axes, self.scale, N)
        self.done = _add_time_bar(self.figure.add_subplot(grid[1]), reel)
        self.draw_frame(reel.steps[0])
        kinds = [(SLACK, "slack"), (BROKEN, "broken")][: 1 + isinstance(reel, MotionFilm)]
        lines = [plt.Line2D([], [], color=colour, lw=2, label=name) for colour, name in kinds]
        handles = [*self.axes.get_legend_handles_labels()[0], *lines]
        self.axes.legend(handles=handles, loc="upper left")
        self.figure.draw_without_rendering()
        self.figure.set_layout_engine("none")  # the layout of the first frame stays

    def draw_frame(self, step: int) -> None:
        """Draw a frame of the file in place of the previous one."""
        for artist in (*self.axes.collections, *self.axes.lines):
            artist.remove()
        reel = self.reel
        rows = np.flatnonzero(reel.present(step))
        rows = rows[rows % self.every == 0]
        lines, N = reel.lines(step)[rows], reel.tension(step)[rows]
        broken, inside = reel.broken(step)[rows], within(self.window, lines)
        intact_shown, broken_shown = inside & ~broken, inside & broken
        width = line_width(len(lines))
        reel.mark_supports(self.axes, step)
        add_by_force(self.axes, lines[intact_shown], N[intact_shown], self.scale, width)
        add_lines(self.axes, lines[broken_shown], colors=BROKEN, linewidths=1.4 * width)
        outside_count = int((~inside).sum()) * self.every
        set_figure_title(self.figure, self.title, f"\n{reel.words(step, outside_count)}")
        self.done.set_width(reel.times[step] - reel.begin)


def _add_axes(figure, position, window: np.ndarray, shot: FilmView):
    """Add axes in space around a window (2, 3) [m] with the view of a shot."""
    axes = add_space_axes(figure, (position,), window, shot.zoom)
    axes.view_init(*shot.view)
    elevation, azimuth = np.radians(shot.view)
    eye = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
    for axis, component in zip((axes.xaxis, axes.yaxis, axes.zaxis), eye):
        if abs(component) > MIN_VIEW_COSINE:  # seen as a point, its ticks would overlap
            axis.set_ticks([])
            axis.set_label_text("")
    if shot.zoom > 1.0:  # axes of an enlarged net would be hidden by the scales
        axes.set_axis_off()
    axes.computed_zorder = False  # draws supports and broken elements on top
    return axes


def _add_time_bar(axes, reel: MotionFilm | ErectionFilm):
    """Draw a bar of time or stages, with strokes at fractures and losses; return the part that grows."""
    axes.set_xlim(reel.begin, reel.times[reel.steps[-1]])
    axes.set_yticks([])
    axes.set_xlabel(reel.bar)
    axes.vlines(reel.strokes, 0, 1, BROKEN, lw=0.7)
    return axes.add_patch(plt.Rectangle((reel.begin, 0.0), 0.0, 1.0, color="0.75", lw=0))
