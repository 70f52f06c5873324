"""The dynamic stage as a film, and the stages of erection: MP4 where there is ffmpeg, else GIF by Pillow.

The axes stay: around the roof where it began, with room for nearly all of what moves out of it. So does the
scale of the colours. Elements that broke or were lost are red.
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import h5py
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FFMpegWriter
from PIL import Image

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
FPS, STAGE_FPS = 15, 1  # frames in a second, of a motion and of stages
MOST_FRAMES = 600  # in a film; of more every k-th is shown
MOST_LINES = 20_000  # elements in a frame; of larger nets every k-th is drawn
MOST_LOOKS = 25  # frames from which the room is found
FASTEST = 50  # frames a second that programs show of a GIF
FARTHEST = 0.6  # of the largest extent of the net: how far beyond it the picture reaches at most
ZOOM = 1.05
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


def animate(
    result: Path, folder: Path, form: str | None, fps: int | None = None, shot: Shot | None = None
) -> list[tuple[Path, str]]:
    """Write RESULT_erection.mp4 or .gif and RESULT_collapse; their paths, and lines that say what they are.

    form : mp4 or gif, None: MP4 where there is ffmpeg; fps : frames shown in a second, None: as FPS
    Raises InputError for a wrong file, for one without frames, and where ffmpeg is asked for and missing.
    """
    form, why = format_of(form, ffmpeg())
    if form == "gif" and (fps or 0) > FASTEST:
        raise InputError(f"--fps {fps}: a GIF shows at most {FASTEST} frames a second; lower it, or take MP4")
    written = []
    with reading(result) as f:
        for reel in _reels(f, result):
            film = Film.of(f, reel, shot or Shot())
            folder.mkdir(parents=True, exist_ok=True)
            path = folder / f"{result.stem}_{reel.name}.{form}"
            with whole(path) as place:
                (_write_mp4 if form == "mp4" else _write_gif)(film, place, fps or reel.fps)
            plt.close(film.figure)
            written.append((path, f"{film.told(fps)}, {path.stat().st_size / 1e6:.2g} MB; {why}"))
    return written


def ffmpeg() -> str | None:
    """The ffmpeg that there is: on the path, or imageio's."""
    found = shutil.which("ffmpeg")
    if found or find_spec("imageio_ffmpeg") is None:
        return found
    import imageio_ffmpeg  # here: it is an extra of the package

    return imageio_ffmpeg.get_ffmpeg_exe()


def format_of(asked: str | None, ffmpeg: str | None) -> tuple[str, str]:
    """The format of the film and why it is that one; ffmpeg : the one that there is."""
    if asked == "mp4" and not ffmpeg:
        raise InputError(
            "--format mp4: needs ffmpeg, which is not there; get it with: pip install 'netfall[view]', "
            "or take --format gif"
        )
    if asked:
        return asked, f"{asked.upper()}, as asked"
    if ffmpeg:
        return "mp4", "MP4, by ffmpeg"
    return "gif", "GIF, since ffmpeg, which MP4 needs, is not there (pip install 'netfall[view]')"


@dataclass(frozen=True)
class Reel:
    """What a film is of: a motion, or stages, which have no times.

    name : of its file; fps : frames in a second; bar : label of the bar below; strokes : red ones in it
    supports(axes, step) : draws them; span(step) : what has passed until then
    words(step, away) : what is said of a frame of which `away` elements are out of view
    """

    frames: Frames | StageFrames
    name: str
    fps: int
    bar: str
    strokes: np.ndarray
    supports: Callable[[plt.Axes, int], None]
    words: Callable[[int, int], str]
    span: Callable[[int], str]

    @property
    def timed(self) -> bool:
        """Whether it is of a motion."""
        return isinstance(self.frames, Frames)


@dataclass
class Film:
    """What stays from frame to frame, and how one is drawn; `shown` is what goes with the next one.

    steps : frames of the file that are shown; every : each so many-th element is drawn
    window : (2, 3) [m]; moving : the artists of the frame; done : the part of the time bar that has passed
    """

    reel: Reel
    title: str
    steps: np.ndarray
    every: int
    window: np.ndarray
    scale: ForceScale
    figure: plt.Figure
    axes: plt.Axes
    done: plt.Rectangle
    moving: list

    @staticmethod
    def of(f: h5py.File, reel: Reel, shot: Shot) -> "Film":
        """The film of a reel, before its first frame."""
        frames = reel.frames
        count = int(np.searchsorted(frames.times, shot.until if reel.timed else np.inf, side="right"))
        if reel.timed and count < 2:
            raise InputError(f"--until {shot.until:g}: the second frame is at {frames.times[1]:.4g} s")
        steps = np.arange(0, count, -(-count // MOST_FRAMES))
        every = max(1, frames.cells // MOST_LINES)
        looks = np.unique(np.linspace(0, count - 1, MOST_LOOKS).astype(int)).tolist()
        window = view(frames, looks, FARTHEST)
        whole = lambda step: np.where(frames.broken(step), 0.0, frames.tension(step))
        N = np.concatenate([whole(step)[::every] for step in steps])
        scale = ForceScale.of(N, np.tile(moving_elements(f)[::every], len(steps)))
        figure, axes = _stage(f, reel, window, scale, N, shot)
        done = _bar(reel, figure, frames.times[:count])
        return Film(reel, title_of(f), steps, every, window, scale, figure, axes, done, [])

    def show(self, step: int) -> None:
        """Draw a frame of the file in place of the one before."""
        for artist in self.moving:
            artist.remove()
        frames, before = self.reel.frames, {*self.axes.collections, *self.axes.lines}
        rows = np.flatnonzero(frames.present(step))
        rows = rows[rows % self.every == 0]
        lines, N = frames.lines(step)[rows], frames.tension(step)[rows]
        gone, inside = frames.broken(step)[rows], within(self.window, lines)
        whole, torn = inside & ~gone, inside & gone
        width = line_width(len(lines))
        self.reel.supports(self.axes, step)
        add_by_force(self.axes, lines[whole], N[whole], self.scale, width)
        add_lines(self.axes, lines[torn], colors=BROKEN, linewidths=1.4 * width)
        self.moving = [each for each in (*self.axes.collections, *self.axes.lines) if each not in before]
        away = int((~inside).sum()) * self.every
        heading(self.figure, self.title, f"\n{self.reel.words(step, away)}")
        self.done.set_width(frames.times[step] - self.done.get_x())

    def told(self, fps: int | None) -> str:
        """What the film is, in words; fps : as asked for"""
        count, every = len(self.steps), int(np.diff(self.steps).min(initial=MOST_FRAMES))
        fps, more = fps or self.reel.fps, f" (every {every}-th of the file)" * (1 < every < MOST_FRAMES)
        span = self.reel.span(self.steps[-1])
        return f"{count} frames{more} at {fps} a second: {count / fps:.3g} s for {span}"


def _reels(f: h5py.File, result: Path) -> list[Reel]:
    """What there is to show in a file, at least one. Raises InputError where there is nothing."""
    reels = [_erection(f)] if "stages" in f else []
    if "VTKHDF/Steps/Values" in f and "history" in f and len(f["VTKHDF/Steps/Values"]) > 1:
        reels.append(_motion(f))
    if reels:
        return reels
    raise InputError(
        f"{result}: no frames to animate: the job had neither a dynamic stage nor stages of erection; give "
        "it [dynamics] duration (and [output] frames, the states that are written), run it again, or draw "
        "its pictures without --animate"
    )


def _motion(f: h5py.File) -> Reel:
    """The dynamic stage."""
    frames, lost = Frames(f), lost_at(f)
    lost = lost[np.isfinite(lost)]
    word = "broken or lost" if len(lost) else "broken"

    def words(step: int, away: int) -> str:
        gone, out = int(frames.broken(step).sum()), f", {away} out of view" if away else ""
        return f"t = {frames.times[step]:.3f} s: {gone} of {frames.present(step).sum()} {word}{out}"

    supports = lambda axes, step: add_supports(f, axes, frames.positions(step)[: len(f["net/fixed"])])
    strokes = np.unique(np.concatenate([f["events/time"][:], lost]))
    span = lambda step: f"{frames.times[step] - frames.times[0]:.4g} s of the roof"
    label = "time [s]; red: fractures and losses"
    return Reel(frames, "collapse", FPS, label, strokes, supports, words, span)


def _erection(f: h5py.File) -> Reel:
    """The stages of erection, each of which stands for a while."""
    frames = StageFrames(f)
    supports = lambda axes, step: add_supports(f, axes, frames.positions(step), frames.states[step].place)
    words = lambda step, away: force_words(f, frames.states[step])
    span = lambda step: f"{step + 1} stages of erection"
    return Reel(frames, "erection", STAGE_FPS, "stage of erection", np.zeros(0), supports, words, span)


def _stage(f, reel: Reel, window, scale: ForceScale, N, shot: Shot):
    """The figure and its axes with what does not move: supports, scales, legend."""
    figure = plt.figure(figsize=(shot.size[0] / DPI, shot.size[1] / DPI), dpi=DPI)
    axes = in_space(figure, (1, 1, 1), window)
    extent = np.ptp([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()], axis=1)
    axes.set_box_aspect(extent, zoom=ZOOM * shot.zoom)
    axes.view_init(*shot.view)
    _hide_towards_eye(axes, shot.view)
    if shot.zoom > 1.0:  # what is larger than the picture has its axes below the scales
        axes.set_axis_off()
    axes.computed_zorder = False  # supports and broken elements over the others
    reel.supports(axes, 0)
    figure.subplots_adjust(left=0.0, right=1.0, top=0.95, bottom=0.21)
    if N.any():
        force_bars(figure, scale, N, 0.17, 0.018)
    kinds = [(SLACK, "slack"), (BROKEN, "broken")][: 2 if reel.timed else 1]
    lines = [plt.Line2D([], [], color=colour, lw=2, label=name) for colour, name in kinds]
    handles = [*axes.get_legend_handles_labels()[0], *lines]
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, 0.92))
    for line in [*axes.lines]:  # they come anew with each frame
        line.remove()
    return figure, axes


def _hide_towards_eye(axes, view: tuple[float, float]) -> None:
    """Leave out ticks and label of an axis that points to the eye. view : as of `Shot`"""
    up, around = np.radians(view)
    eye = np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)
    for axis, along in zip((axes.xaxis, axes.yaxis, axes.zaxis), eye):
        if abs(along) > ALONG:
            axis.set_ticks([])
            axis.set_label_text("")


def _bar(reel: Reel, figure, times: np.ndarray):
    """A bar of the time, or of the stages, below the picture, with strokes; the part of it that grows."""
    axes, begin = figure.add_axes((0.1, 0.068, 0.8, 0.018)), times[0] - float(not reel.timed)
    axes.set_xlim(begin, times[-1])
    axes.set_yticks([])
    axes.tick_params(labelsize=7, pad=1)
    axes.set_xlabel(reel.bar, labelpad=1)
    done = plt.Rectangle((begin, 0.0), 0.0, 1.0, color="0.75", lw=0)
    axes.add_patch(done)
    axes.vlines(reel.strokes, 0, 1, BROKEN, lw=0.7)
    return done


def _write_mp4(film: Film, path: Path, fps: int) -> None:
    plt.rcParams["animation.ffmpeg_path"] = ffmpeg()
    writer = FFMpegWriter(fps=fps, codec="h264", extra_args=["-crf", "24"])
    with writer.saving(film.figure, str(path), DPI):
        for step in film.steps:
            film.show(step)
            writer.grab_frame()


def _write_gif(film: Film, path: Path, fps: int) -> None:
    """All frames with the same colours, undithered: what stays has the same pixels."""
    ends = [_of_step(film, step) for step in film.steps[[0, len(film.steps) // 2, -1]]]
    palette = Image.fromarray(np.concatenate(ends)).quantize(256)
    pictures = (
        Image.fromarray(_of_step(film, step)).quantize(palette=palette, dither=Image.Dither.NONE)
        for step in film.steps
    )
    hundredths = np.diff(np.round(100.0 / fps * np.arange(len(film.steps) + 1)))  # as a GIF counts them
    shown = {"append_images": pictures, "duration": (10 * hundredths).astype(int).tolist(), "loop": 0}
    next(pictures).save(path, format="GIF", save_all=True, **shown)


def _of_step(film: Film, step: int) -> np.ndarray:
    """A frame (height, width, 3) in pixels."""
    film.show(step)
    film.figure.canvas.draw()
    return np.asarray(film.figure.canvas.buffer_rgba())[..., :3].copy()
