"""Rings of a plan in which every face has one: those of shapely's polygonize, in its order, traced faster.

Each segment has two sides, (a, b) and (b, a). The ring on the right of one goes on, where it ends, along the
segment that turns sharpest to the right. Segments with a free end bound nothing, nor do those that they leave
with one.
"""

import numpy as np

from netfall.core.kernels import kernel, part_of_kernel


def traced_rings(points: np.ndarray, segment: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Start (r + 1,) of each ring in the corners, anticlockwise ones; None: a face may have several rings.

    points : (n, 2) [m], no two alike; segment : (s, 2) points, which meet at their ends alone
    """
    points = np.ascontiguousarray(points)
    tail = np.ascontiguousarray(segment, np.int64).ravel()
    begin = np.append(0, np.cumsum(np.bincount(tail, minlength=len(points))))
    around, valence = np.argsort(tail, kind="stable"), np.diff(begin)
    leave_free_ends(tail, begin, around, valence)
    place = np.full(len(tail), -1)
    turn_sides(points, tail, begin, around, valence, place)
    corner, size = np.empty(len(tail), np.int64), np.empty(len(tail), np.int64)
    count = trace_rings(points, tail, begin, around, valence, place, corner, size)
    if count < 0:
        return None
    start = np.append(0, np.cumsum(size[:count]))
    return start, corner[: start[-1]]


@kernel
def leave_free_ends(tail, begin, around, valence):
    """Sides (2 s,) around each point, those left out behind the others, of which there are `valence` (n,).

    tail : where each side begins, 2 k and 2 k + 1 are those of segment k; begin : (n + 1,) rows of `around`
    """
    left_out = np.zeros(len(tail), np.bool_)
    for end in range(len(valence)):
        p = end
        while valence[p] == 1:
            side = 0
            for k in range(begin[p], begin[p + 1]):
                if not left_out[around[k]]:
                    side = around[k]
            left_out[side] = left_out[side ^ 1] = True
            valence[p] -= 1
            p = tail[side ^ 1]
            valence[p] -= 1
    for p in range(len(valence)):
        row = begin[p]
        for k in range(begin[p], begin[p + 1]):
            if not left_out[around[k]]:
                around[row], around[k] = around[k], around[row]
                row += 1


@part_of_kernel
def _before(u, v, other_u, other_v):
    """Whether a direction comes before another one, anticlockwise from x."""
    below = v < 0.0 or (v == 0.0 and u < 0.0)
    other_below = other_v < 0.0 or (other_v == 0.0 and other_u < 0.0)
    if below != other_below:
        return other_below
    return u * other_v - v * other_u > 0.0


@kernel
def turn_sides(points, tail, begin, around, valence, place):
    """Sides around each point in anticlockwise order, and the row (2 s,) of each side that is used."""
    for p in range(len(valence)):
        for row in range(begin[p], begin[p] + valence[p]):
            side, k = around[row], row
            q = tail[side ^ 1]
            u, v = points[q, 0] - points[p, 0], points[q, 1] - points[p, 1]
            while k > begin[p]:
                q = tail[around[k - 1] ^ 1]
                if not _before(u, v, points[q, 0] - points[p, 0], points[q, 1] - points[p, 1]):
                    break
                around[k] = around[k - 1]
                k -= 1
            around[k] = side
        for row in range(begin[p], begin[p] + valence[p]):
            place[around[row]] = row


@kernel
def trace_rings(points, tail, begin, around, valence, place, corner, size):
    """How many rings; corners (2 s,), out, ring after ring, and sizes (2 s,), out; -1: see `traced_rings`.

    In the order of their first sides, each from where that begins.
    """
    ring, seen = np.full(len(tail), -1, np.int64), np.full(len(valence), -1, np.int64)
    count, rows, outer = 0, 0, 0
    for first in range(len(tail)):
        if place[first] < 0 or ring[first] >= 0:
            continue
        side, end, area, twice = first, rows, 0.0, False
        x, y = points[tail[first], 0], points[tail[first], 1]
        while ring[side] < 0:
            p, q = tail[side], tail[side ^ 1]
            if ring[side ^ 1] == first:
                return -1
            twice |= seen[p] == first
            ring[side] = seen[p] = first
            corner[end] = p
            end += 1
            area += (points[p, 0] - x) * (points[q, 1] - y) - (points[p, 1] - y) * (points[q, 0] - x)
            row = place[side ^ 1] + 1
            side = around[row if row < begin[q] + valence[q] else begin[q]]
        if area >= 0.0:  # round the outside
            outer += 1
        elif twice:
            return -1
        else:
            low, high = rows + 1, end - 1
            while low < high:
                corner[low], corner[high] = corner[high], corner[low]
                low, high = low + 1, high - 1
            size[count] = end - rows
            count, rows = count + 1, end
    return count if outer == 1 else -1
