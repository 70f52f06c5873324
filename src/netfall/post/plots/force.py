"""Elements coloured by axial force, with scales for tension and compression; supports and their edge.

Slack elements are pale. The scales end at percentiles, since after fractures the largest force is that of a
fragment.
"""

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.path import Path

from netfall.post.checks.reactions import held_axes
from netfall.post.plots.canvas import (
    MAX_DRAWN,
    SPACE_STYLE,
    SUPPORT_COLOUR,
    add_coloured,
    add_lines,
    add_scale,
    mark_supports,
    unit_of,
)

PERCENTILES = 1.0, 99.0  # percentiles of the forces, at which the colour scale ends
MIN_FORCE_RATIO = 0.5  # smallest / largest force, above which a scale begins at the smallest, not at 0
LONGEST_GAP = 4.0  # largest / median distance of neighbouring supports on an edge
MOST_TURNS = 1.6  # full turns, left and right, along an edge: an L has 1.5; mast feet and anchors zigzag
TRACE = 1e-6  # share of the largest force; smaller compressions count as none
SLACK = "#c9c9c9"


def part_of_palette(name: str, low: float, high: float):
    """Return a part of a matplotlib palette."""
    return LinearSegmentedColormap.from_list(name, plt.get_cmap(name)(np.linspace(low, high, 64)))


TENSION, COMPRESSION = part_of_palette("viridis_r", 0.12, 1.0), part_of_palette("YlOrRd", 0.45, 1.0)


@dataclass(frozen=True)
class ForceScale:
    """Colour scales of axial forces [N], in tension and in compression; None: there is none.

    trace : [N], compressions below this count as none
    """

    tension: tuple[float, float] | None
    compression: tuple[float, float] | None
    trace: float

    @staticmethod
    def of(N: np.ndarray, counts: np.ndarray | None = None) -> "ForceScale":
        """Compute the scale for the forces N (k,) [N] of a picture.

        counts : (k,) bool, forces that set the scale, None: all
        """
        trace = TRACE * float(np.abs(N).max(initial=0.0))
        taut, pressed = N > 0.0, N < -trace

        def chosen(rows: np.ndarray) -> np.ndarray:
            return rows & counts if counts is not None and (rows & counts).any() else rows

        return ForceScale(limits(N[chosen(taut)]), limits(-N[chosen(pressed)]), trace)


def moving_elements(f) -> np.ndarray:
    """Select the elements (m,) with an end that can move; the forces of the others do not matter."""
    rigid = f["net/fixed"][:].astype(bool).all(1)
    return ~rigid[f["net/elements"][:]].all(1)


def limits(sizes: np.ndarray) -> tuple[float, float] | None:
    """Return the ends of a scale for sizes (k,) > 0."""
    if not len(sizes):
        return None
    low, high = np.percentile(sizes, PERCENTILES)
    if high - low <= 1e-6 * high:
        return 0.99 * low, 1.01 * high
    return (low, high) if low >= MIN_FORCE_RATIO * high else (0.0, high)


def add_by_force(axes, lines: np.ndarray, N: np.ndarray, scale: ForceScale, width: float) -> None:
    """Add elements (m, 2, 3) [m] coloured by axial forces N (m,) [N]; the largest forces are on top."""
    stride = max(1, len(lines) // MAX_DRAWN)
    lines, N = lines[::stride], N[::stride]
    N = np.where((N < 0.0) & (N >= -scale.trace), 0.0, N)
    add_lines(axes, lines[N == 0.0], colors=SLACK, linewidths=0.7 * width)
    for sign, ends, palette in ((1, scale.tension, TENSION), (-1, scale.compression, COMPRESSION)):
        rows = np.flatnonzero(sign * N > 0.0)
        if len(rows):
            add_coloured(axes, lines[rows], sign * N[rows], plt.Normalize(*ends), palette, width)


def add_force_scales(axes, scale: ForceScale, N: np.ndarray) -> None:
    """Add the scales below one or several axes, with the extremes of their forces N (k,) [N]."""
    for word, sign, ends, palette in (
        ("tension", 1, scale.tension, TENSION),
        ("compression", -1, scale.compression, COMPRESSION),
    ):
        if ends is None:
            continue
        factor, unit = unit_of(ends[1], "N")
        values = factor * sign * N[sign * N > (0.0 if sign > 0 else scale.trace)]
        low, high = factor * ends[0], factor * ends[1]
        label = f"{word} [{unit}], {values.min():.4g} to {values.max():.4g}"
        extend, ticks = extended_ends(values, low, high), plt.MaxNLocator(4)
        add_scale(axes, plt.Normalize(low, high), palette, label, extend=extend, ticks=ticks)


def extended_ends(values: np.ndarray, low: float, high: float) -> str:
    """Return the ends at which values (k,) leave a scale, as matplotlib's `extend`."""
    ends = bool(values.min() < low * (1.0 - 1e-9)), bool(values.max() > high * (1.0 + 1e-9))
    return {(True, True): "both", (True, False): "min", (False, True): "max"}.get(ends, "neither")


def add_supports(f, axes, x: np.ndarray, place: str = "") -> None:
    """Mark the supports at x (n, 3) [m], and the edge that they form, if any; place : group of the state."""
    held = held_axes(f, place)
    rows = np.flatnonzero(held.any(1))
    edge = support_edge(x, rows) if not place.startswith("stages/") else ()  # temporary supports form no edge
    if len(edge):
        dashed = {"color": SUPPORT_COLOUR, "lw": 0.8, "ls": (0, (3, 2)), **SPACE_STYLE}
        axes.plot(*x[edge].T, label="edge through the supports", **dashed)
    spring = f["net/spring"][:] > 0 if "spring" in f["net"] else np.zeros_like(held)
    mark_supports(axes, x, held & ~spring, spring)


def has_spring(f) -> np.ndarray:
    """Select the nodes (n,) with springs along any axis."""
    return (f["net/spring"][:] > 0).any(1) if "spring" in f["net"] else np.zeros(len(f["net/fixed"]), bool)


def support_edge(x: np.ndarray, supports: np.ndarray) -> np.ndarray:
    """Return the supports in order around the net, closed, if they enclose it in plan; otherwise none.

    x : (n, 3) [m]; supports : rows (k,)
    """
    if len(supports) < 4:
        return np.zeros(0, int)
    plan = x[supports, :2] - x[supports, :2].mean(0)
    order = supports[np.argsort(np.arctan2(plan[:, 1], plan[:, 0]), kind="stable")]
    closed = np.append(order, order[0])
    gaps = np.linalg.norm(np.diff(x[closed, :2], axis=0), axis=1)
    inside = Path(x[closed, :2]).contains_points(x[:, :2], radius=1e-3 * np.ptp(x[:, :2]))
    inside |= Path(x[closed, :2]).contains_points(x[:, :2], radius=-1e-3 * np.ptp(x[:, :2]))
    encloses = inside.all() and gaps.max() <= LONGEST_GAP * max(np.median(gaps), 1e-9)
    return closed if encloses and count_turns(x[order, :2]) <= MOST_TURNS else np.zeros(0, int)


def count_turns(plan: np.ndarray) -> float:
    """Count the full turns, left and right, once around the polygon with corners (k, 2) [m]."""
    sides = np.roll(plan, -1, axis=0) - plan
    heading = np.arctan2(sides[:, 1], sides[:, 0])
    turn = np.remainder(np.roll(heading, -1) - heading + np.pi, 2.0 * np.pi) - np.pi
    return float(np.abs(turn).sum() / (2.0 * np.pi))
