"""Content of a drawing or mesh in any format, lines, points and layers; division of curves into segments.

Curves get a joint wherever a line ends on the curve.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from netfall.core.messages import count_of

METRES = {
    "m": 1.0,
    "cm": 0.01,
    "mm": 0.001,
    "dm": 0.1,
    "km": 1000.0,
    "in": 0.0254,
    "ft": 0.3048,
    "yd": 0.9144,
}
MAX_COORDINATE = 1e12  # in the unit of the drawing; 1e9 m in millimetres; larger coordinates are errors


@dataclass
class Drawing:
    """Drawing of k lines and p points.

    lines : (k, 2, 3), in the unit of the drawing until `scaled`; layer : (k,) rows of `layers`
    curves : splines of ezdxf, with the row of the layer of each; `cut_curves` makes lines of them
    points : (p, 3) that may mark supports; point_layer : (p,) rows of `layers`
    held : (q, 3) supports named in the file; held_axes : (q, 3) bool
    keys : (k, 2) ids of nodes at the ends, None without ids in the file
    force_density : (k,) [N / unit] of the lines, nan: none; None: the file has none
    unit : unit of the coordinates; file_unit : unit named in the file, or None
    unit_from : place of this unit in the file
    read, left_out : texts on the counts of read and omitted objects
    """

    lines: np.ndarray
    layer: np.ndarray
    layers: list[str]
    curves: list[Any] = field(default_factory=list)
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    point_layer: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    held: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    held_axes: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), bool))
    keys: np.ndarray | None = None
    force_density: np.ndarray | None = None
    unit: str | None = None
    file_unit: str | None = None
    unit_from: str = ""
    read: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def select(self, names: list[str]) -> None:
        """Remove the lines, curves and points on other layers, and count them."""
        rows = sorted({row for name in names for row in rows_with_name(name, self.layers)})
        lines, points = np.isin(self.layer, rows), np.isin(self.point_layer, rows)
        others = [
            self.layers[k] for k in (*self.layer[~lines], *(k for k, _ in self.curves if k not in rows))
        ]
        self.left_out += [
            f'{count} lines and curves on layer "{name}", which --layers does not name'
            for name, count in sorted(Counter(others).items())
        ]
        self.curves = [(rows.index(k), spline) for k, spline in self.curves if k in rows]
        self.lines, self.layer = self.lines[lines], np.searchsorted(rows, self.layer[lines])
        self.points, self.point_layer = self.points[points], np.searchsorted(rows, self.point_layer[points])
        self.keys = None if self.keys is None else self.keys[lines]
        self.force_density = None if self.force_density is None else self.force_density[lines]
        self.layers = [self.layers[k] for k in rows]

    def scaled(self, unit: str) -> None:
        """Convert all coordinates to metres, and force densities to N/m."""
        factor = METRES[unit]
        multiplier, divisor = (1.0, round(1.0 / factor)) if factor in (0.1, 0.01, 0.001) else (factor, 1.0)
        for name in ("lines", "points", "held"):  # division makes 2200 mm exactly 2.2 m
            setattr(self, name, getattr(self, name) * multiplier / divisor)
        if self.force_density is not None:
            self.force_density = self.force_density * divisor / multiplier
            self.read += [f"force densities in N/{unit}, written in N/m"] * (unit != "m")


def counted(counts: dict[str, int]) -> str:
    """Format counts by name: "12 LINE, 3 ARC" for {"LINE": 12, "ARC": 3}."""
    return ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))


def largest_offset(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    """Compute the largest distance of points (f, 3) from the segment between two points."""
    direction = end - start
    share = np.clip((points - start) @ direction / max(direction @ direction, np.finfo(float).tiny), 0.0, 1.0)
    return float(np.linalg.norm(start + share[:, None] * direction - points, axis=1).max(initial=0.0))


def rows_with_name(name: str | None, names: list[str]) -> list[int]:
    """Return the rows of the names that equal a name, in upper or lower case."""
    return [] if name is None else [k for k, other in enumerate(names) if other.lower() == name.lower()]


def alike(names: Iterable[str]) -> list[str]:
    """Return a line for each set of names that differ only by upper and lower case."""
    spellings: dict[str, list[str]] = {}
    for name in sorted(names):
        spellings.setdefault(name.lower(), []).append(name)
    return [
        " and ".join(f'"{name}"' for name in variants) + " differ by upper and lower case alone"
        for variants in spellings.values()
        if len(variants) > 1
    ]


MAX_CHORD_ERROR = 1 / 200  # largest distance of segments from their curve / its size
MAX_SHALLOW_ERROR = 1 / 12  # the same / its largest_offset, for shallow curves; an arc gets 4 segments
SAMPLING_SHARE = 0.1  # largest distance of sampled points from their curve / `reach`
KNOT_OFFSET = 1e-4  # share of a span between knots, at which the directions at a knot are measured
MIN_SINE = 0.02  # sine of the angle below which a knot is not a corner
LEAST_CHORDS, MOST_CHORDS = 8, 2**14  # chords of a span between knots, when a curve is sampled


def cut_curves(drawing: Drawing, reach: float) -> None:
    """Add the segments of the curves to the lines of a drawing.

    reach : in the unit of the drawing, largest distance between a curve and a line's end on it

    A curve may be cut anywhere, but chords miss line ends on the arc. Curves are therefore cut at these ends.
    """
    if not drawing.curves:
        return
    pieces = [
        (row, piece)
        for row, spline in drawing.curves
        for piece in _smooth_pieces(spline, SAMPLING_SHARE * reach)
    ]
    lines = [drawing.lines.reshape(-1, 3), *(piece[[0, -1]] for _, piece in pieces)]
    ends = np.unique(np.concatenate(lines), axis=0)
    cut = [_segment_corners(piece, ends, reach) for _, piece in pieces]
    corners, joints = [points for points, _ in cut], sum(count for _, count in cut)
    segments = [np.stack([points[:-1], points[1:]], axis=1) for points in corners]
    drawing.lines = np.concatenate([drawing.lines, *segments])
    rows = [row for row, _ in pieces]
    drawing.layer = np.concatenate([drawing.layer, np.repeat(rows, [len(pairs) for pairs in segments])])
    where = f", with joints at ends of lines that lie on them: {joints}" if joints else ""
    drawing.read.append(f"curves cut into {count_of(sum(map(len, segments)), 'segment')}{where}")


def _smooth_pieces(spline: Any, distance: float) -> list[np.ndarray]:
    """Return points (f, 3) of the pieces of a spline between its corners.

    Chords lie within `distance` of the spline. The parameter covers the inner knots; outer knots of an
    unclamped spline are outside the curve.
    """
    knots = np.unique(np.array(spline.knots()[spline.degree : spline.count + 1]))
    pieces: list[list[np.ndarray]] = []
    for k, (a, b) in enumerate(pairwise(knots)):
        points = _points_between(spline, a, b, distance)
        if k == 0 or _has_corner(spline, *knots[k - 1 : k + 2]):
            pieces.append([points])
        else:
            pieces[-1].append(points[1:])
    return [np.concatenate(piece) for piece in pieces]


def _points_between(spline: Any, a: float, b: float, distance: float) -> np.ndarray:
    """Return points (f, 3) between two knots, equally spaced in the parameter and dense enough."""
    points, count = _points(spline, np.linspace(a, b, LEAST_CHORDS + 1)), LEAST_CHORDS
    while count < MOST_CHORDS:
        count *= 2
        coarse, points = points, _points(spline, np.linspace(a, b, count + 1))
        deviation = points[1::2] - 0.5 * (coarse[:-1] + coarse[1:])
        if np.linalg.norm(deviation, axis=1).max() <= distance:
            break
    return points


def _points(spline: Any, parameters: np.ndarray) -> np.ndarray:
    """Evaluate a spline at parameters (f,); points (f, 3)."""
    return np.array([tuple(point) for point in spline.points(parameters.tolist())])


def _has_corner(spline: Any, before: float, knot: float, after: float) -> bool:
    """Whether a spline has a corner at a knot between two others."""
    steps = KNOT_OFFSET * np.array([knot - before, after - knot])
    a, corner, b = _points(spline, np.array([knot - steps[0], knot, knot + steps[1]]))
    u, v = corner - a, b - corner
    return bool(
        np.linalg.norm(np.cross(u, v)) > MIN_SINE * np.linalg.norm(u) * np.linalg.norm(v) or u @ v < 0.0
    )


def _segment_corners(points: np.ndarray, ends: np.ndarray, reach: float) -> tuple[np.ndarray, int]:
    """Return the corners (c, 3) of the segments of a curve, and the number of joints among them.

    points : (f, 3) of the curve; ends : (k, 3) ends of lines
    """
    size = float(np.ptp(points, axis=0).max())
    offset = largest_offset(points, points[0], points[-1])
    tolerance = max(min(MAX_CHORD_ERROR * size, MAX_SHALLOW_ERROR * offset), SAMPLING_SHARE * reach)
    arc_length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    joint_positions, joints = _find_joints(points, arc_length, ends, reach)
    positions = [0.0, *joint_positions, arc_length[-1]]
    corners = np.stack([points[0], *joints, points[-1]])
    parts = [corners[:1]]
    for k, (a, b) in enumerate(pairwise(positions)):
        parts += [
            _between(points, arc_length, a, b, corners[k], corners[k + 1], tolerance),
            corners[k + 1 : k + 2],
        ]
    return np.concatenate(parts), len(joints)


def _find_joints(
    points: Any, arc_length: Any, ends: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Find the ends of lines on a curve, except at the ends of the curve.

    points : (f, 3) of the curve; arc_length : (f,) length of the curve to each; ends : (k, 3)

    Returns the arc lengths (j,) of these ends in ascending order, and their coordinates (j, 3).
    """
    from scipy.spatial import cKDTree

    start, direction = points[:-1], np.diff(points, axis=0)
    square = np.maximum(np.einsum("ij,ij->i", direction, direction), np.finfo(float).tiny)
    candidates = cKDTree(ends).query_ball_point(points, reach + 0.5 * np.sqrt(square.max()))
    positions, joints = [], []
    for k in sorted({k for indices in candidates for k in indices}):
        share = np.clip(np.einsum("ij,ij->i", ends[k] - start, direction) / square, 0.0, 1.0)
        distance = np.linalg.norm(start + share[:, None] * direction - ends[k], axis=1)
        piece = int(distance.argmin())
        if distance[piece] <= reach < np.linalg.norm(points[[0, -1]] - ends[k], axis=1).min():
            positions.append(arc_length[piece] + share[piece] * (arc_length[piece + 1] - arc_length[piece]))
            joints.append(ends[k])
    order = np.argsort(positions, kind="stable")
    return np.array(positions)[order], np.array(joints).reshape(-1, 3)[order]


def _between(
    points: Any, arc_length: Any, a: float, b: float, start: Any, end: Any, tolerance: float
) -> np.ndarray:
    """Return corners (c, 3) between two arc lengths, halved until segments are within the tolerance."""
    inner = points[np.searchsorted(arc_length, a, "right") : np.searchsorted(arc_length, b, "left")]
    if largest_offset(inner, start, end) <= tolerance:
        return np.zeros((0, 3))
    middle = 0.5 * (a + b)
    midpoint = np.array([np.interp(middle, arc_length, points[:, k]) for k in range(3)])
    before = _between(points, arc_length, a, middle, start, midpoint, tolerance)
    return np.concatenate(
        [before, midpoint[None], _between(points, arc_length, middle, b, midpoint, end, tolerance)]
    )
