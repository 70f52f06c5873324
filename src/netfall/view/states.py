"""What a page shows of a result: its net, its states at rest and in motion, thinned to what opens at once."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from netfall.plots.net import whole_cables
from netfall.results.frames import Frames
from netfall.results.states import ShownState, absent, equilibria, shown_name, start_position

MOST_VALUES = 3_500_000  # elements times states of a page
MOST_ELEMENTS = 100_000  # of larger nets some of the cables are shown
AT_REST = 0.4  # of these values, that states at rest take at most if there are frames
FEWEST = 12  # states at rest that are always shown


@dataclass(frozen=True)
class Drawn:
    """The part of a net that is drawn: m of its elements, with p points.

    rows : (m,) of /net; every : one cable in how many is drawn
    start : (p, 3) [m] points in the form; origin : (p,) nodes of /net that the points are, or have left
    ends : (m, 2) points; the last points are ends that split off: loose (l, 2), of which element which end
    """

    rows: np.ndarray
    every: int
    start: np.ndarray
    origin: np.ndarray
    ends: np.ndarray
    loose: np.ndarray


@dataclass(frozen=True)
class States:
    """States of a net: one at rest, or the k frames of its motion.

    time : (k,) [s], empty at rest; displacement : (k, p, 3) [m] from the form
    tension : (k, m) [N], nan: broken or lost; strain : (k, m), or None; slack, broken : (k,) of the whole net
    away : (m,) bool, what the erection has not in the net
    """

    name: str
    time: np.ndarray
    displacement: np.ndarray
    tension: np.ndarray
    strain: np.ndarray | None
    slack: np.ndarray
    broken: np.ndarray
    away: np.ndarray


def drawn_part(f) -> Drawn:
    """What is drawn of the net of a result file."""
    x, elements = start_position(f), f["net/elements"][:]
    rows, every = whole_cables(x, elements, f["net/cable"][:], f["net/group"][:], MOST_ELEMENTS)
    nodes, ends = np.unique(elements[rows], return_inverse=True)
    ends, loose = ends.reshape(-1, 2), np.zeros((0, 2), int)
    if moves(f):
        frames = Frames(f)
        loose = np.argwhere(frames.ends(len(frames.times) - 1)[rows] >= len(x))
        ends[tuple(loose.T)] = len(nodes) + np.arange(len(loose))
    origin = np.concatenate([nodes, elements[rows][tuple(loose.T)]])
    return Drawn(rows, every, x[origin], origin, ends, loose)


def moves(f) -> bool:
    """Whether there are frames of a motion."""
    return "history" in f and len(f["VTKHDF/Steps/Values"]) > 1


def states_shown(f, drawn: Drawn) -> tuple[list[States], list[str]]:
    """The states that a page shows, the motion first, and what it leaves out, in words."""
    found, words = list(equilibria(f)), []
    room = max(FEWEST, int(MOST_VALUES * (AT_REST if moves(f) else 1.0)) // len(drawn.rows))
    if len(found) > room:
        words.append(f"the first {room} of {len(found)} states at rest")
    shown = [_at_rest(f, drawn, state) for state in found[:room]]
    if moves(f):
        room = max(2, (MOST_VALUES // len(drawn.rows)) - len(shown))
        every = -(-len(f["VTKHDF/Steps/Values"]) // room)
        if every > 1:
            words.append(f"one in {every} of the frames")
        shown.insert(0, _motion(f, drawn, every))
    if drawn.every > 1:
        words.append(f"one in {drawn.every} of the cables")
    return shown, words


def _at_rest(f, drawn: Drawn, state: ShownState) -> States:
    """An equilibrium."""
    N, bar, away = state.tension(), f["net/bar"][:].astype(bool), absent(f, state.place)
    moved = state.position()[drawn.origin] - drawn.start
    slack = np.array([((N == 0.0) & ~bar & ~away).sum()])
    none = np.zeros(1, int)
    name, N, away = shown_name(f, state), N[drawn.rows], away[drawn.rows]
    return States(name, np.zeros(0), moved[None], N[None], None, slack, none, away)


def _motion(f, drawn: Drawn, every: int) -> States:
    """The frames of the dynamic stage, each so many-th of them."""
    frames, bar = Frames(f), f["net/bar"][:].astype(bool)
    steps = np.arange(0, len(frames.times), every)
    moved = np.empty((len(steps), *drawn.start.shape), np.float32)
    tension, strain = (np.empty((len(steps), len(drawn.rows)), np.float32) for _ in range(2))
    slack, broken = (np.empty(len(steps), int) for _ in range(2))
    for k, (points, N, eps, gone) in enumerate(_read(frames, drawn, steps)):
        moved[k] = points - drawn.start
        slack[k], broken[k] = ((N == 0.0) & ~bar & ~gone & frames.there).sum(), gone.sum()
        tension[k], strain[k] = np.where(gone, np.nan, N)[drawn.rows], eps[drawn.rows]
    away = ~frames.there[drawn.rows]
    return States("motion", frames.times[steps], moved, tension, strain, slack, broken, away)


def _read(frames: Frames, drawn: Drawn, steps: np.ndarray) -> Iterator[tuple[np.ndarray, ...]]:
    """Of each frame: where the points are (p, 3) [m], tensions [N], strains and what is broken (m,)."""
    whole = drawn.origin[: len(drawn.origin) - len(drawn.loose)]
    for step in steps:
        x = frames.positions(step)
        split = frames.ends(step)[drawn.rows][tuple(drawn.loose.T)]
        fields = [frames.cell(name, step) for name in ("tension", "strain")]
        yield x[np.concatenate([whole, split])], *fields, frames.broken(step)
