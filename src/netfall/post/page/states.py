"""Content of a page: net, static states and motion of a result, reduced to a size that opens fast.

The numbers are arrays of two-byte integers in one compressed block.
"""

import base64
import zlib
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np

from netfall.post.checks.nodes import held_axes, spring_axes
from netfall.post.plots.net import select_cables
from netfall.results import states
from netfall.results.file import Frames, moves

MAX_CODE = 32_767  # largest value of a two-byte integer
MISSING = -32_768  # code of a missing value


class ArrayBlock:
    """Collector of the arrays of a page; `add` returns the dictionary that refers to an array."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.size = 0

    def add(self, values: np.ndarray) -> dict[str, Any]:
        """Add an array of int16, int32 or float32."""
        kind = {"int16": "Int16Array", "int32": "Int32Array", "float32": "Float32Array"}[values.dtype.name]
        data = np.ascontiguousarray(values, values.dtype.newbyteorder("<")).tobytes()
        reference = {"kind": kind, "from": self.size, "length": values.size}
        self.parts.append(data + bytes(-len(data) % 4))
        self.size += len(self.parts[-1])
        return reference

    def add_series(
        self, values: np.ndarray, largest: float | np.ndarray, nonzero: bool = False
    ) -> dict[str, Any]:
        """Add values (k, ...) of k states as shares of the largest; nan and larger values become missing.

        A state contains the differences from the previous state, which are small; they wrap around.
        largest : of all values, or of each column; nonzero : whether all nonzero values remain nonzero
        """
        unit = np.maximum(largest / MAX_CODE, np.finfo(np.float32).tiny).astype(np.float32)
        with np.errstate(invalid="ignore"):
            rounded = np.round(values / unit)
            rounded = np.where(np.abs(rounded) <= MAX_CODE, rounded, MISSING)
            vanished = (rounded == 0) & (values != 0.0) & nonzero
        rounded = np.where(vanished, np.sign(values), rounded).astype(np.int16)
        return self.add(np.diff(rounded, axis=0, prepend=np.zeros_like(rounded[:1]))) | {
            "unit": self.add(unit)
        }

    def text(self) -> str:
        """Encode all arrays as text."""
        return base64.b64encode(zlib.compress(b"".join(self.parts), 9)).decode()


MOST_VALUES = 3_500_000  # elements x states of a page
MOST_ELEMENTS = 100_000  # elements of a page; of larger nets, only some cables are shown
STATIC_SHARE = 0.4  # share of these values for static states if there is a motion
MIN_SHOWN_STATES = 12  # static states that are always shown


@dataclass(frozen=True)
class DrawnPart:
    """Drawn part of a net: m of its elements, with p points.

    rows : (m,) of /net; every : one cable in `every` is drawn
    start : (p, 3) [m] points in the form; origin : (p,) node of /net for each point, or node from which it
    split off
    ends : (m, 2) points; the last points are ends that split off
    loose : (l, 2), element and end of each point that splits off
    """

    rows: np.ndarray
    every: int
    start: np.ndarray
    origin: np.ndarray
    ends: np.ndarray
    loose: np.ndarray


@dataclass(frozen=True)
class StateSeries:
    """States of a net: one static state, or the k snapshots of its motion.

    time : (k,) [s], empty if static; displacement : (k, p, 3) [m] from the form
    tension : (k, m) [N], nan: broken or removed; strain : (k, m), or None; slack, broken : (k,) of the whole
        net
    away : (m,) bool, elements that are not installed yet
    supports, guided : points held along all axes, and points held along some or on springs
    hanging : (k, m) bool, slack elements with a force, because their parts hang from each other
    """

    name: str
    time: np.ndarray
    displacement: np.ndarray
    tension: np.ndarray
    strain: np.ndarray | None
    slack: np.ndarray
    broken: np.ndarray
    away: np.ndarray
    supports: np.ndarray
    guided: np.ndarray
    hanging: np.ndarray | None = None


def support_points(drawn: DrawnPart, held: np.ndarray, sprung: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Select the points held along all axes, and the points held along some axes or on springs.

    held : (n, 3) bool, axes with a support; sprung : (n,) bool, on springs
    """
    nodes = drawn.origin[: len(drawn.origin) - len(drawn.loose)]
    fully = held.all(1) & ~sprung
    return np.flatnonzero(fully[nodes]), np.flatnonzero((held.any(1) & ~fully)[nodes])


def _support_points(f: h5py.File, drawn: DrawnPart, place: str = "") -> tuple[np.ndarray, np.ndarray]:
    """Return the supports of a state; place : its group, which may have other supports."""
    return support_points(drawn, held_axes(f, place), np.any(spring_axes(f), 1))


def select_drawn(f: h5py.File) -> DrawnPart:
    """Select the part of the net of a result file that is drawn."""
    x, elements = states.start_position(f), f["net/elements"][:]
    return drawn_part(x, elements, f["net/cable"][:], f["net/group"][:], Frames(f) if moves(f) else None)


def drawn_part(
    x: np.ndarray, elements: np.ndarray, cable: np.ndarray, group: np.ndarray, frames: Frames | None = None
) -> DrawnPart:
    """Select the part of a net that is drawn.

    x : (n, 3) [m]; elements : (m, 2); cable, group : (m,) numbers; frames : of the motion, if there is one
    """
    rows, stride = select_cables(cable, group, MOST_ELEMENTS)
    nodes, ends = np.unique(elements[rows], return_inverse=True)
    ends, loose = ends.reshape(-1, 2), np.zeros((0, 2), int)
    if frames is not None:
        loose = np.argwhere(frames.ends(len(frames.times) - 1)[rows] >= len(x))
        ends[tuple(loose.T)] = len(nodes) + np.arange(len(loose))
    origin = np.concatenate([nodes, elements[rows][tuple(loose.T)]])
    return DrawnPart(rows, stride, x[origin], origin, ends, loose)


def shown_series(f: h5py.File, drawn: DrawnPart) -> tuple[list[StateSeries], list[str]]:
    """Return the states that a page shows, the motion first, and the omissions as text."""
    static_states, omissions = list(states.equilibria(f)), []
    capacity = max(
        MIN_SHOWN_STATES, int(MOST_VALUES * (STATIC_SHARE if moves(f) else 1.0)) // len(drawn.rows)
    )
    if len(static_states) > capacity:
        omissions.append(f"the first {capacity} of {len(static_states)} equilibria")
    shown = [_static_series(f, drawn, state) for state in static_states[:capacity]]
    if moves(f):
        capacity = max(2, (MOST_VALUES // len(drawn.rows)) - len(shown))
        stride = -(-len(f["VTKHDF/Steps/Values"]) // capacity)
        if stride > 1:
            omissions.append(f"one in {stride} of the frames")
        shown.insert(0, _motion(f, drawn, stride))
    if drawn.every > 1:
        omissions.append(f"one in {drawn.every} of the cables")
    return shown, omissions


def _static_series(f: h5py.File, drawn: DrawnPart, state: states.StateView) -> StateSeries:
    """Return an equilibrium for the page."""
    N, missing = state.tension(), states.absent(f, state.place)
    displacement = state.position()[drawn.origin] - drawn.start
    slack = np.array([states.count_slack(f, N, ~missing)])
    name, time, none = states.state_title(f, state), np.zeros(0), np.zeros(1, int)
    hanging = (states.slack_elements(f, N) & (N > 0.0))[drawn.rows][None]
    N, missing = N[drawn.rows], missing[drawn.rows]
    marks = _support_points(f, drawn, state.place)
    return StateSeries(name, time, displacement[None], N[None], None, slack, none, missing, *marks, hanging)


def _motion(f: h5py.File, drawn: DrawnPart, stride: int) -> StateSeries:
    """Return every `stride`-th snapshot of the dynamic stage for the page."""
    frames = Frames(f)
    nodes = drawn.origin[: len(drawn.origin) - len(drawn.loose)]
    steps = np.arange(0, len(frames.times), stride)
    displacement = np.empty((len(steps), *drawn.start.shape), np.float32)
    tension, strain = np.empty((2, len(steps), len(drawn.rows)), np.float32)
    slack, broken = np.empty((2, len(steps)), int)
    hanging = np.empty(tension.shape, bool)
    for k, step in enumerate(steps):
        split_ends = frames.ends(step)[drawn.rows][tuple(drawn.loose.T)]
        N, failed = frames.tension(step), frames.broken(step)
        displacement[k] = frames.positions(step)[np.concatenate([nodes, split_ends])] - drawn.start
        slack[k] = states.count_slack(f, N, ~failed & frames.there)
        broken[k], hanging[k] = frames.broken_count(step), states.slack_elements(f, N)[drawn.rows]
        tension[k] = np.where(failed, np.nan, N)[drawn.rows]
        strain[k] = frames.cell("strain", step)[drawn.rows]
    missing = ~frames.there[drawn.rows]
    series = frames.times[steps], displacement, tension, strain, slack, broken, missing
    return StateSeries("motion", *series, *_support_points(f, drawn), hanging & (tension > 0.0))
