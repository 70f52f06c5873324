"""Curves of a drawing to segments, with a joint wherever a line ends on the curve itself."""

import numpy as np

from netfall.exchange.drawings.drawing import Drawing

FLATNESS = 1 / 200  # of a curve's size: how far its segments may be from it
LEAST_SEGMENTS = 4  # of a curve on which nothing ends
FINER = 0.1  # of what is as good as on a curve: how far the points that stand for it may be from it


def cut_curves(drawing: Drawing, reach: float) -> None:
    """Add the segments of its curves to the lines of a drawing.

    reach : in the unit of the drawing, how far from a curve an end of a line may lie and still be on it

    A chord lies beside what ends on the arc, and where a curve is cut is free: so it is cut at these ends.
    """
    if not drawing.curves:
        return
    ways = [way for _, way in drawing.curves]
    lines = [drawing.lines.reshape(-1, 3), *([tuple(way.start), tuple(way.end)] for way in ways)]
    ends = np.unique(np.concatenate(lines), axis=0)
    cut = [_corners(way, ends, reach) for way in ways]
    corners, joints = [points for points, _ in cut], sum(count for _, count in cut)
    pieces = [np.stack([points[:-1], points[1:]], axis=1) for points in corners]
    drawing.lines = np.concatenate([drawing.lines, *pieces])
    rows = [row for row, _ in drawing.curves]
    drawing.layer = np.concatenate([drawing.layer, np.repeat(rows, [len(piece) for piece in pieces])])
    where = f", with joints at {joints} ends of lines that lie on them" if joints else ""
    drawing.read.append(f"curves cut into {sum(map(len, pieces))} segments{where}")


def _corners(way, ends: np.ndarray, reach: float) -> tuple[np.ndarray, int]:
    """Corners (c, 3) of the segments of a curve, and how many of them are ends (k, 3) of lines."""
    size = float(np.ptp([tuple(point) for point in way.control_vertices()], axis=0).max())
    flat = max(size * FLATNESS, 1e-12)
    points = way.flattening(min(flat, FINER * reach), LEAST_SEGMENTS)
    fine = np.array([tuple(point) for point in points])
    at, joint = _ends_on(fine, ends, reach)
    if len(at):
        place, given = [0.0, *at, len(fine) - 1.0], [fine[0], *joint, fine[-1]]
    else:
        place = np.linspace(0.0, len(fine) - 1.0, LEAST_SEGMENTS + 1).tolist()
        given = [_place(fine, at) for at in place]
    corners = [fine[:1]]
    for a, b, start, end in zip(place[:-1], place[1:], given[:-1], given[1:], strict=True):
        corners += [_between(fine, a, b, start, end, flat), end[None]]
    return np.concatenate(corners), len(joint)


def _place(fine: np.ndarray, at: float) -> np.ndarray:
    """The place (3,) so far along the points (f, 3) of a curve, in points of it."""
    row = min(int(at), len(fine) - 2)
    return fine[row] + (at - row) * (fine[row + 1] - fine[row])


def _ends_on(fine: np.ndarray, ends: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Which ends (k, 3) lie on the curve of points (f, 3), but not at an end of it: how far along it (j,), in
    points of it, ascending, and their places (j, 3).
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
            at.append(piece + share[piece])
            joint.append(ends[k])
    order = np.argsort(at, kind="stable")
    return np.array(at)[order], np.array(joint).reshape(-1, 3)[order]


def _between(fine: np.ndarray, a: float, b: float, start, end, flat: float) -> np.ndarray:
    """Corners (c, 3) between places a and b along a curve: halved until segments lie within `flat` of it."""
    inner = fine[int(np.floor(a)) + 1 : int(np.ceil(b))]
    along = end - start
    share = np.clip((inner - start) @ along / max(along @ along, 1e-300), 0.0, 1.0)
    if not len(inner) or np.linalg.norm(start + share[:, None] * along - inner, axis=1).max() <= flat:
        return np.zeros((0, 3))
    middle = 0.5 * (a + b)
    here = _place(fine, middle)
    before = _between(fine, a, middle, start, here, flat)
    return np.concatenate([before, here[None], _between(fine, middle, b, here, end, flat)])
