"""Elements coloured by axial force, with scales for tension and compression; supports.

Slack elements are pale. Scales of equilibria end at the extremes. Scales of motion end at percentiles,
because after fractures the largest force is that of a fragment.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import h5py
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.ticker import MaxNLocator

from netfall.post.checks.nodes import held_axes, spring_axes
from netfall.post.plots import canvas
from netfall.results.states import slack_elements

OF_MOTION, OF_EQUILIBRIA = (1.0, 99.0), (0.0, 100.0)  # percentiles of the forces, at which the scale ends
MIN_FORCE_RATIO = 0.5  # smallest / largest force, above which a scale begins at the smallest, not at 0
NEGLIGIBLE_COMPRESSION = 1e-6  # share of the largest force; smaller compressions count as zero
SLACK = "#c9c9c9"
TENSION, COMPRESSION = (
    LinearSegmentedColormap.from_list(name, plt.get_cmap(name)(np.linspace(low, 1.0, 64)))
    for name, low in (("viridis_r", 0.12), ("YlOrRd", 0.45))
)


@dataclass(frozen=True)
class ForceScale:
    """Colour scales of axial forces [N], in tension and in compression; None: there is none.

    trace : [N], smaller compressions count as zero
    """

    tension: tuple[float, float] | None
    compression: tuple[float, float] | None
    trace: float

    @staticmethod
    def of(
        N: np.ndarray, counts: np.ndarray | None = None, percentiles: tuple[float, float] = OF_EQUILIBRIA
    ) -> "ForceScale":
        """Compute the scale for the forces N (k,) [N] of a picture.

        counts : (k,) bool, forces that set the scale, None: all; percentiles : at which it ends
        """
        trace = NEGLIGIBLE_COMPRESSION * float(np.abs(N).max(initial=0.0))
        taut, pressed = (
            rows & counts if counts is not None and (rows & counts).any() else rows
            for rows in (N > 0.0, N < -trace)
        )
        return ForceScale(limits(N[taut], percentiles), limits(-N[pressed], percentiles), trace)

    def parts(self) -> list[tuple[str, int, tuple[float, float], LinearSegmentedColormap]]:
        """Return name, sign, ends and colours of each existing scale."""
        both = ("tension", 1, self.tension, TENSION), ("compression", -1, self.compression, COMPRESSION)
        return [(word, sign, ends, colours) for word, sign, ends, colours in both if ends]


def moving_elements(f: h5py.File) -> np.ndarray:
    """Select the elements (m,) with an end that can move; other forces are irrelevant."""
    rigid = f["net/fixed"][:].astype(bool).all(1)
    return ~rigid[f["net/elements"][:]].all(1)


def limits(sizes: np.ndarray, percentiles: tuple[float, float]) -> tuple[float, float] | None:
    """Return the ends of a scale for sizes (k,) > 0."""
    if not len(sizes):
        return None
    low, high = np.percentile(sizes, percentiles)
    if high - low <= 1e-6 * high:
        return 0.99 * low, 1.01 * high
    return widest([(low, high)])


def widest(ends: Sequence[tuple[float, float] | None]) -> tuple[float, float] | None:
    """Return the ends of a scale that spans several scales; None: there is none."""
    pairs = [pair for pair in ends if pair]
    if not pairs:
        return None
    low, high = min(pair[0] for pair in pairs), max(pair[1] for pair in pairs)
    return (low, high) if low >= MIN_FORCE_RATIO * high else (0.0, high)


def shown_forces(f: h5py.File, N: np.ndarray) -> np.ndarray:
    """Return the axial forces N (m,) [N], with 0 in slack elements, whose parts hang from each other."""
    return np.where(slack_elements(f, N), 0.0, N)


def add_by_force(axes: Axes, lines: np.ndarray, N: np.ndarray, scale: ForceScale, width: float) -> None:
    """Add elements (m, 2, 3) [m] coloured by axial forces N (m,) [N]; the largest forces are on top."""
    stride = max(1, len(lines) // canvas.MAX_DRAWN)
    lines, N = lines[::stride], N[::stride]
    N = np.where((N < 0.0) & (N >= -scale.trace), 0.0, N)
    canvas.add_lines(axes, lines[N == 0.0], colors=SLACK, linewidths=0.7 * width)
    for _, sign, ends, colours in scale.parts():
        rows = sign * N > 0.0
        canvas.add_coloured(axes, lines[rows], sign * N[rows], Normalize(*ends), colours, width)


def add_force_scales(axes: Axes | Sequence[Axes], scale: ForceScale, N: np.ndarray) -> None:
    """Add the scales below one or several axes, in one unit, with the extremes of their forces N (k,) [N]."""
    factor, unit = canvas.unit_of(max((ends[1] for *_, ends, _ in scale.parts()), default=0.0), "N")
    for word, sign, ends, colours in scale.parts():
        values = factor * sign * N[sign * N > (0.0 if sign > 0 else scale.trace)]
        low, high, least, most = factor * ends[0], factor * ends[1], values.min(), values.max()
        beyond = bool(least < low * (1.0 - 1e-9)), bool(most > high * (1.0 + 1e-9))
        extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get(beyond, "neither")
        label = f"{word} [{unit}], {least:.4g} to {most:.4g}"
        ticks = MaxNLocator(4)
        canvas.add_scale(axes, Normalize(low, high), colours, label, extend=extend, ticks=ticks)


def add_supports(f: h5py.File, axes: Axes, x: np.ndarray, place: str = "") -> None:
    """Mark the supports at x (n, 3) [m]; place : group of the state."""
    held = held_axes(f, place)
    spring = spring_axes(f)
    canvas.mark_supports(axes, x, held & ~spring, spring, f["net/angle"][:] if "net/angle" in f else None)
