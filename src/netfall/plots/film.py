"""The dynamic stage as a film: MP4 where there is ffmpeg, the system's or imageio's, else GIF by Pillow.

The axes stay: around the roof where it began, with room for nearly all of what moves out of it. So does the
scale of the colours. Elements that broke or were lost are red.
"""

import shutil
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
from netfall.plots.force import SLACK, ForceScale, add_by_force, add_supports, force_bars
from netfall.results.file import reading, title_of
from netfall.results.frames import Frames
from netfall.results.losses import lost_at
from netfall.write.locks import whole

DPI = 100  # pixels of an inch
MOST_FRAMES = 600  # in a film; of more every k-th is shown
MOST_LINES = 20_000  # elements in a frame; of larger nets every k-th is drawn
MOST_LOOKS = 25  # frames from which the room is found
FASTEST = 50  # frames a second that programs show of a GIF
FARTHEST = 0.6  # of the largest extent of the net: how far beyond it the picture reaches at most
ZOOM = 1.05
ALONG = 0.98  # cosine between an axis and the eye, from which on it is seen as a point
FORMATS = ("mp4", "gif")


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
    result: Path, folder: Path, form: str | None, fps: int, shot: Shot | None = None
) -> tuple[Path, str]:
    """Write RESULT_collapse.mp4 or .gif; its path, and a line that says what it is.

    form : of FORMATS, None: MP4 where there is ffmpeg; fps : frames shown in a second
    Raises InputError for a wrong file, for one without frames, and where ffmpeg is asked for and missing.
    """
    form, why = format_of(form, ffmpeg())
    if form == "gif" and fps > FASTEST:
        raise InputError(f"--fps {fps}: a GIF shows at most {FASTEST} frames a second; lower it, or take MP4")
    with reading(result) as f:
        film = Film.of(f, result, shot or Shot())
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{result.stem}_collapse.{form}"
        with whole(path) as place:
            (_write_mp4 if form == "mp4" else _write_gif)(film, place, fps)
    plt.close(film.figure)
    return path, f"{film.told(fps)}, {path.stat().st_size / 1e6:.2g} MB; {why}"


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


@dataclass
class Film:
    """What stays from frame to frame, and how one is drawn; `shown` is what goes with the next one.

    steps : frames of the file that are shown; every : each so many-th element is drawn
    window : (2, 3) [m]; moving : the artists of the frame; done : the part of the time bar that has passed
    """

    frames: Frames
    title: str
    steps: np.ndarray
    every: int
    window: np.ndarray
    scale: ForceScale
    figure: plt.Figure
    axes: plt.Axes
    done: plt.Rectangle
    word: str
    moving: list

    @staticmethod
    def of(f: h5py.File, result: Path, shot: Shot) -> "Film":
        """The film of a result file with frames, before its first frame."""
        frames = _frames(f, result)
        count = int(np.searchsorted(frames.times, shot.until, side="right"))
        if count < 2:
            raise InputError(f"--until {shot.until:g}: the second frame is at {frames.times[1]:.4g} s")
        steps = np.arange(0, count, -(-count // MOST_FRAMES))
        every = max(1, frames.cells // MOST_LINES)
        looks = np.unique(np.linspace(0, count - 1, MOST_LOOKS).astype(int)).tolist()
        window = view(frames, looks, FARTHEST)
        N = np.concatenate([_whole_forces(frames, step)[::every] for step in steps])
        scale = ForceScale.of(N)
        figure, axes = _stage(f, frames, window, scale, N, shot)
        done = _time_bar(f, figure, frames.times[:count])
        word = "broken or lost" if np.isfinite(lost_at(f)).any() else "broken"
        return Film(frames, title_of(f), steps, every, window, scale, figure, axes, done, word, [])

    def show(self, step: int) -> None:
        """Draw a frame of the file in place of the one before."""
        for artist in self.moving:
            artist.remove()
        before = set(self.axes.collections)
        lines, N = self.frames.lines(step)[:: self.every], self.frames.cell("tension", step)[:: self.every]
        broken = self.frames.cell("broken", step).astype(bool)
        gone, inside = broken[:: self.every], within(self.window, lines)
        whole, torn = inside & ~gone, inside & gone
        width = line_width(len(lines))
        add_by_force(self.axes, lines[whole], N[whole], self.scale, width)
        add_lines(self.axes, lines[torn], colors=BROKEN, linewidths=1.4 * width)
        self.moving = [artist for artist in self.axes.collections if artist not in before]
        t, away = self.frames.times[step], int((~inside).sum()) * self.every
        told = f"{int(broken.sum())} of {len(broken)} {self.word}" + (f", {away} out of view" if away else "")
        heading(self.figure, self.title, f"\nt = {t:.3f} s: {told}")
        self.done.set_width(t - self.frames.times[0])

    def told(self, fps: int) -> str:
        """What the film is, in words."""
        count, every = len(self.steps), int(self.steps[1] - self.steps[0])
        span = self.frames.times[self.steps[-1]] - self.frames.times[0]
        more = f" (every {every}-th of the file)" if every > 1 else ""
        return f"{count} frames{more} at {fps} a second: {count / fps:.3g} s for {span:.4g} s of the roof"


def _frames(f: h5py.File, result: Path) -> Frames:
    """The frames of a file that has at least two."""
    if "VTKHDF/Steps/Values" in f and "history" in f and len(f["VTKHDF/Steps/Values"]) > 1:
        return Frames(f)
    raise InputError(
        f"{result}: no frames to animate: the job had no dynamic stage; give it [dynamics] duration "
        "(and [output] frames, the states that are written), run it again, or draw its pictures without "
        "--animate"
    )


def _whole_forces(frames: Frames, step: int) -> np.ndarray:
    """Axial forces (m,) [N] at a step, 0 in what is broken."""
    return np.where(frames.cell("broken", step).astype(bool), 0.0, frames.cell("tension", step))


def _stage(f, frames: Frames, window, scale: ForceScale, N, shot: Shot):
    """The figure and its axes with what does not move: supports, scales, legend."""
    figure = plt.figure(figsize=(shot.size[0] / DPI, shot.size[1] / DPI), dpi=DPI)
    axes = in_space(figure, (1, 1, 1), window)
    axes.set_box_aspect(
        np.ptp([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()], axis=1), zoom=ZOOM * shot.zoom
    )
    axes.view_init(*shot.view)
    _hide_towards_eye(axes, shot.view)
    axes.computed_zorder = False  # supports and broken elements over the others
    add_supports(f, axes, frames.positions(0)[: len(f["net/fixed"])])
    figure.subplots_adjust(left=0.0, right=1.0, top=0.95, bottom=0.21)
    if N.any():
        force_bars(figure, scale, N, 0.17, 0.018)
    lines = [
        plt.Line2D([], [], color=c, lw=2, label=name) for c, name in ((SLACK, "slack"), (BROKEN, "broken"))
    ]
    handles = [*axes.get_legend_handles_labels()[0], *lines]
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, 0.92))
    return figure, axes


def _hide_towards_eye(axes, view: tuple[float, float]) -> None:
    """Leave out ticks and label of an axis that points to the eye. view : as of `Shot`"""
    up, around = np.radians(view)
    eye = np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)
    for axis, along in zip((axes.xaxis, axes.yaxis, axes.zaxis), eye):
        if abs(along) > ALONG:
            axis.set_ticks([])
            axis.set_label_text("")


def _time_bar(f, figure, times: np.ndarray):
    """A bar of the time below the picture, with a stroke at each fracture and loss; the part that grows."""
    axes = figure.add_axes((0.1, 0.068, 0.8, 0.018))
    axes.set_xlim(times[0], times[-1])
    axes.set_yticks([])
    axes.tick_params(labelsize=7, pad=1)
    axes.set_xlabel("time [s]; red: fractures and losses", labelpad=1)
    done = plt.Rectangle((times[0], 0.0), 0.0, 1.0, color="0.75", lw=0)
    axes.add_patch(done)
    lost = lost_at(f)
    axes.vlines(
        np.unique(np.concatenate([f["events/time"][:], lost[np.isfinite(lost)]])), 0, 1, BROKEN, lw=0.7
    )
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
