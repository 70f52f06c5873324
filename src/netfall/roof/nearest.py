"""Faces of many corners, shared by nearest corner in the plane normal to their vector area.

The part of a face that is nearest to one of its corners, its Voronoi cell, is the face clipped by the
half-planes on this side of the perpendicular bisectors to all others (Sutherland, Hodgman 1974). Rings that
are clipped one by one keep the signed area of what is within, so concave faces and holes need no care.
"""

import numpy as np

from netfall.core.kernels import inner_kernel, kernel
from netfall.numerics.functions import lengths

SAME = 1e-12  # of a face's size: corners no farther apart in its plane share what is nearest to them


def nearest_areas(points, rings, vector: np.ndarray, windows: np.ndarray | None = None) -> np.ndarray:
    """Area (c,) [m2] in its face's plane that is nearest to each corner of some faces.

    points : (k, 3) [m]; rings : `Faces` of f faces, all of their rings; vector : (f, 3) [m2], their areas
    windows : (w, 3) half-planes a x + b y <= c in plan; of each area only what lies within all of them
    """
    face = rings.face_of_corner()
    first, second = _axes(vector)
    start = points[rings.corner[rings.start[:-1]]][rings.first_rings()]
    reach = points[rings.corner] - start[face]
    xy = np.column_stack([np.sum(reach * axes[face], axis=1) for axes in (first, second)])
    windows = np.zeros((0, 3)) if windows is None else windows
    slant = [np.sum(windows[:, None, :2] * axes[None, :, :2], axis=2) for axes in (first, second)]
    rest = windows[:, 2:] - np.sum(windows[:, None, :2] * start[None, :, :2], axis=2)
    planes = np.ascontiguousarray(np.stack([*slant, rest], -1).transpose(1, 0, 2))
    area = np.zeros(len(xy))
    of_face = np.append(rings.first_rings(), len(rings))
    near = SAME * SAME * np.maximum(lengths(vector), 1e-300)
    _clip_all(xy, rings.start, of_face, planes, near, area)
    return area


def _axes(vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two axes (f, 3) of the planes normal to vectors (f, 3); without a vector those of the plan."""
    size = lengths(vector)[:, None]
    normal = np.where(size > 0, vector, [0.0, 0.0, 1.0]) / np.where(size > 0, size, 1.0)
    along = np.where(np.abs(normal[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    first = along - np.sum(along * normal, axis=1)[:, None] * normal
    first /= lengths(first)[:, None]
    return first, np.cross(normal, first)


@inner_kernel
def _clip(ring, count, a, b, c, out):
    """Write what of a ring of `count` corners lies in a x + b y <= c; the number of its corners."""
    kept = 0
    for k in range(count):
        m = k + 1 if k + 1 < count else 0
        here = a * ring[k, 0] + b * ring[k, 1] - c
        after = a * ring[m, 0] + b * ring[m, 1] - c
        if here <= 0.0:
            out[kept, 0], out[kept, 1] = ring[k, 0], ring[k, 1]
            kept += 1
        if (here <= 0.0) != (after <= 0.0):
            t = here / (here - after)
            out[kept, 0] = ring[k, 0] + t * (ring[m, 0] - ring[k, 0])
            out[kept, 1] = ring[k, 1] + t * (ring[m, 1] - ring[k, 1])
            kept += 1
    return kept


@inner_kernel
def _bisectors(xy, begin, end, i, near, half):
    """Write the half-planes (h, 3) of what is nearer to corner i than to others of its face, from it.

    Neighbours first: they leave few corners of the ring for all others to look at. Returns their number, and
    how many corners lie where i does.
    """
    total, count, same = end - begin, 0, 1
    for step in range(1, total):
        away = (step + 1) // 2 if step % 2 else total - step // 2
        j = begin + (i - begin + away) % total
        a, b = xy[j, 0] - xy[i, 0], xy[j, 1] - xy[i, 1]
        square = a * a + b * b
        if square <= near:
            same += 1
            continue
        half[count, 0], half[count, 1], half[count, 2] = a, b, 0.5 * square
        count += 1
    return count, same


@inner_kernel
def _signed_area(ring, count):
    """Of a ring of `count` corners, anticlockwise positive."""
    double = 0.0
    for k in range(count):
        m = k + 1 if k + 1 < count else 0
        double += ring[k, 0] * ring[m, 1] - ring[k, 1] * ring[m, 0]
    return 0.5 * double


@kernel
def _clip_all(xy, ring_start, of_face, planes, near, area):
    """Write the area (c,) of each corner's cell; arguments as in `nearest_areas`, in the faces' planes.

    ring_start : (r + 1,) rows of xy; of_face : (f + 1,) rows of rings; planes : (f, w, 3); near : (f,) [m2]
    """
    ring, other, windows = np.empty((64, 2)), np.empty((64, 2)), planes.shape[1]
    for f in range(len(of_face) - 1):
        begin, end = ring_start[of_face[f]], ring_start[of_face[f + 1]]
        half = np.empty((windows + end - begin, 3))
        for i in range(begin, end):
            for w in range(windows):
                a, b = planes[f, w, 0], planes[f, w, 1]
                half[w, 0], half[w, 1], half[w, 2] = a, b, planes[f, w, 2] - a * xy[i, 0] - b * xy[i, 1]
            halves, same = _bisectors(xy, begin, end, i, near[f], half[windows:])
            for r in range(of_face[f], of_face[f + 1]):
                count = ring_start[r + 1] - ring_start[r]
                if count > len(ring):
                    ring, other = np.empty((2 * count, 2)), np.empty((2 * count, 2))
                for k in range(count):
                    ring[k, 0] = xy[ring_start[r] + k, 0] - xy[i, 0]
                    ring[k, 1] = xy[ring_start[r] + k, 1] - xy[i, 1]
                for h in range(windows + halves):
                    if 2 * count > len(other):  # a clip leaves at most twice as many corners
                        other = np.empty((4 * count, 2))
                    count = _clip(ring, count, half[h, 0], half[h, 1], half[h, 2], other)
                    ring, other = other, ring
                area[i] += _signed_area(ring, count)
            area[i] /= same
