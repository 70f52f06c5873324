"""Curves of a drawing to segments, with a joint wherever a line ends on the curve itself."""

from itertools import pairwise

import numpy as np

from netfall.exchange.drawings.drawing import Drawing, depth

FLATNESS = 1 / 200  # of a curve's size: how far its segments may be from it
SHARE = 1 / 12  # of its depth: likewise, for the sag of a shallow curve; an arc gets 4 segments
FINER = 0.1  # of what is as good as on a curve: how far the points that stand for it may be from it
BESIDE = 1e-4  # of a span between knots: how far beside a knot a curve's direction is looked for
CORNER = 0.02  # sine of an angle: less is no corner
LEAST_CHORDS, MOST_CHORDS = 8, 2**14  # of a span between knots, for the points that stand for a curve


def cut_curves(drawing: Drawing, reach: float) -> None:
    """Add the segments of its curves to the lines of a drawing.

    reach : in the unit of the drawing, how far from a curve an end of a line may lie and still be on it

    A chord lies beside what ends on the arc, and where a curve is cut is free: so it is cut at these ends.
    """
    if not drawing.curves:
        return
    found = [
        (row, piece) for row, spline in drawing.curves for piece in _smooth_pieces(spline, FINER * reach)
    ]
    lines = [drawing.lines.reshape(-1, 3), *(piece[[0, -1]] for _, piece in found)]
    ends = np.unique(np.concatenate(lines), axis=0)
    cut = [_corners(piece, ends, reach) for _, piece in found]
    corners, joints = [points for points, _ in cut], sum(count for _, count in cut)
    segments = [np.stack([points[:-1], points[1:]], axis=1) for points in corners]
    drawing.lines = np.concatenate([drawing.lines, *segments])
    rows = [row for row, _ in found]
    drawing.layer = np.concatenate([drawing.layer, np.repeat(rows, [len(each) for each in segments])])
    where = f", with joints at {joints} ends of lines that lie on them" if joints else ""
    drawing.read.append(f"curves cut into {sum(map(len, segments))} segments{where}")


def _smooth_pieces(spline, distance: float) -> list[np.ndarray]:
    """Return points (f, 3) of the pieces of a spline between its corners; chords lie within `distance` of it.

    The parameter runs over the inner knots: an unclamped spline has others that only lead to it.
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


def _points_between(spline, a: float, b: float, distance: float) -> np.ndarray:
    """Return points (f, 3) between two knots, equally spaced in the parameter and dense enough."""
    points, count = _points(spline, np.linspace(a, b, LEAST_CHORDS + 1)), LEAST_CHORDS
    while count < MOST_CHORDS:
        count *= 2
        coarse, points = points, _points(spline, np.linspace(a, b, count + 1))
        beside = points[1::2] - 0.5 * (coarse[:-1] + coarse[1:])
        if np.linalg.norm(beside, axis=1).max() <= distance:
            break
    return points


def _points(spline, parameters: np.ndarray) -> np.ndarray:
    return np.array([tuple(point) for point in spline.points(parameters.tolist())])


def _has_corner(spline, before: float, knot: float, after: float) -> bool:
    """Whether a spline turns at a knot between two others."""
    steps = BESIDE * np.array([knot - before, after - knot])
    a, at, b = _points(spline, np.array([knot - steps[0], knot, knot + steps[1]]))
    u, v = at - a, b - at
    return bool(
        np.linalg.norm(np.cross(u, v)) > CORNER * np.linalg.norm(u) * np.linalg.norm(v) or u @ v < 0.0
    )


def _corners(fine: np.ndarray, ends: np.ndarray, reach: float) -> tuple[np.ndarray, int]:
    """Return corners (c, 3) of the segments of a curve, points (f, 3); and how many lie at ends (k, 3)."""
    size = float(np.ptp(fine, axis=0).max())
    flat = max(min(FLATNESS * size, SHARE * depth(fine, fine[0], fine[-1])), FINER * reach)
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1)))
    at, joint = _ends_on(fine, way, ends, reach)
    places = [0.0, *at, way[-1]]
    corners = np.stack([fine[0], *joint, fine[-1]])
    found = [corners[:1]]
    for k, (a, b) in enumerate(pairwise(places)):
        found += [_between(fine, way, a, b, corners[k], corners[k + 1], flat), corners[k + 1 : k + 2]]
    return np.concatenate(found), len(joint)


def _ends_on(fine, way, ends: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Return which ends (k, 3) lie on the curve of points (f, 3), but not at an end of it: how far along it
    (j,), ascending, and their places (j, 3). way : (f,) length of the curve to each point
    """
    from scipy.spatial import cKDTree

    start, along = fine[:-1], np.diff(fine, axis=0)
    square = np.maximum(np.einsum("ij,ij->i", along, along), np.finfo(float).tiny)
    near = cKDTree(ends).query_ball_point(fine, reach + 0.5 * np.sqrt(square.max()))
    at, joint = [], []
    for k in sorted({k for some in near for k in some}):
        share = np.clip(np.einsum("ij,ij->i", ends[k] - start, along) / square, 0.0, 1.0)
        apart = np.linalg.norm(start + share[:, None] * along - ends[k], axis=1)
        piece = int(apart.argmin())
        if apart[piece] <= reach < np.linalg.norm(fine[[0, -1]] - ends[k], axis=1).min():
            at.append(way[piece] + share[piece] * (way[piece + 1] - way[piece]))
            joint.append(ends[k])
    order = np.argsort(at, kind="stable")
    return np.array(at)[order], np.array(joint).reshape(-1, 3)[order]


def _between(fine, way, a: float, b: float, start, end, flat: float) -> np.ndarray:
    """Return corners (c, 3) between two places along a curve, halved until segments are that flat."""
    inner = fine[np.searchsorted(way, a, "right") : np.searchsorted(way, b, "left")]
    if depth(inner, start, end) <= flat:
        return np.zeros((0, 3))
    middle = 0.5 * (a + b)
    here = np.array([np.interp(middle, way, fine[:, k]) for k in range(3)])
    before = _between(fine, way, a, middle, start, here, flat)
    return np.concatenate([before, here[None], _between(fine, way, middle, b, here, end, flat)])
