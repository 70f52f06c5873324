"""What is wrong with a net that was drawn: near misses, crossings without a joint, loose ends and parts."""

import numpy as np
import shapely

from netfall.net.parts import unjoined_pairs

NEAR_SHARE, NEAR_TIMES = 0.01, 10.0  # of the usual length, of the tolerance: so near was meant as one
AT_ONCE = 4096  # elements whose neighbours are looked for together, for the memory that long ones take
PARALLEL = 1e-9  # squared sine of an angle below which elements do not cross, but lie on each other


def reach_of(x: np.ndarray, ends: np.ndarray, tolerance: float) -> float:
    """How far apart [m] a near miss may be."""
    length = np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1)
    return max(NEAR_TIMES * tolerance, NEAR_SHARE * float(np.median(length)))


def near_nodes(x: np.ndarray, ends: np.ndarray, reach: float):
    """Pairs of nodes (k, 2) no farther apart than `reach` that no element joins, and how far [m]."""
    pairs = unjoined_pairs(x, ends, reach)
    apart = np.linalg.norm(x[pairs[:, 0]] - x[pairs[:, 1]], axis=1)
    order = np.argsort(apart, kind="stable")
    return pairs[order], apart[order]


def touches(x: np.ndarray, ends: np.ndarray, reach: float):
    """Nodes (k,) within `reach` of elements (k,) between these elements' ends, and the distances [m]."""
    tree = shapely.STRtree(_in_plan(x, ends))
    node, element = tree.query(shapely.points(x[:, :2]), predicate="dwithin", distance=reach)
    free = (ends[element] != node[:, None]).all(1)
    node, element = node[free], element[free]
    start, along = x[ends[element, 0]], x[ends[element, 1]] - x[ends[element, 0]]
    share = np.einsum("ij,ij->i", x[node] - start, along) / np.einsum("ij,ij->i", along, along)
    place = start + np.clip(share, 0.0, 1.0)[:, None] * along
    apart = np.linalg.norm(x[node] - place, axis=1)
    to_ends = np.linalg.norm(x[node][:, None] - x[ends[element]], axis=2).min(1)
    found = (apart <= reach) & (share > 0) & (share < 1) & (to_ends > reach)
    return node[found], element[found], apart[found]


def crossings(x: np.ndarray, ends: np.ndarray, tolerance: float):
    """Pairs of elements (k, 2) that come within the tolerance [m] of each other between their ends, and where
    (k, 3). (Ericson, Real-Time Collision Detection, 5.1.9: closest points of two segments.)
    """
    pairs = _near_pairs(x, ends, tolerance)
    a, b = ends[pairs[:, 0]], ends[pairs[:, 1]]
    p, d, q, e = x[a[:, 0]], x[a[:, 1]] - x[a[:, 0]], x[b[:, 0]], x[b[:, 1]] - x[b[:, 0]]
    dot = lambda u, v: np.einsum("ij,ij->i", u, v)
    dd, ee, de = dot(d, d), dot(e, e), dot(d, e)
    sine = dd * ee - de * de
    good = sine > PARALLEL * dd * ee
    s, t = np.full((2, len(pairs)), -1.0)
    r, det = q - p, np.where(good, sine, 1.0)
    s[good] = ((dot(r, d) * ee - dot(r, e) * de) / det)[good]
    t[good] = ((dot(r, d) * de - dot(r, e) * dd) / det)[good]
    on_a, on_b = p + s[:, None] * d, q + t[:, None] * e
    inside = _between(s, dd, tolerance) & _between(t, ee, tolerance)
    found = good & inside & (np.linalg.norm(on_a - on_b, axis=1) <= tolerance)
    return pairs[found], on_a[found]


def _near_pairs(x: np.ndarray, ends: np.ndarray, tolerance: float) -> np.ndarray:
    """Pairs of elements (k, 2) without a common node whose boxes in space are no farther apart."""
    low, high = x[ends].min(1) - tolerance, x[ends].max(1) + tolerance
    boxes = shapely.box(*low[:, :2].T, *high[:, :2].T)
    tree, found = shapely.STRtree(boxes), [np.zeros((0, 2), np.int64)]
    for start in range(0, len(ends), AT_ONCE):
        first, second = tree.query(boxes[start : start + AT_ONCE])
        pairs = np.column_stack([start + first, second])[start + first < second]
        one, other = pairs.T
        apart = (ends[one][:, :, None] != ends[other][:, None, :]).all((1, 2))
        level = (low[one, 2] <= high[other, 2]) & (low[other, 2] <= high[one, 2])
        found.append(pairs[apart & level])
    return np.concatenate(found)


def _between(share: np.ndarray, square: np.ndarray, tolerance: float) -> np.ndarray:
    """Whether places are farther than the tolerance from both ends of elements of this length squared."""
    margin = tolerance / np.sqrt(square)
    return (share > margin) & (share < 1.0 - margin)


def _in_plan(x: np.ndarray, ends: np.ndarray):
    return shapely.linestrings(x[ends][:, :, :2])


def outline(x: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, bool]:
    """Whether nodes (n,) are the ends of single elements, or lie on the outer boundary of the faces in plan;
    and whether there are faces.

    Where most of the boundary is joined to such ends, as in a net without edge cables, only these.
    """
    single = np.bincount(ends.ravel(), minlength=len(x)) == 1
    faces = shapely.get_parts(shapely.polygonize(_in_plan(x, ends)))
    if not len(faces):
        return single, False
    corners = shapely.get_coordinates(shapely.get_exterior_ring(shapely.get_parts(_union(faces))))
    number = lambda xy: xy[:, 0] + 1j * xy[:, 1]
    inner = np.zeros(len(x), bool)
    inner[ends[single[ends].any(1)]] = True
    used = np.bincount(ends.ravel(), minlength=len(x)) > 0
    around = used & np.isin(number(x), number(corners))
    return single | (around & ~inner if inner[around].mean() > 0.5 else around), True


def _union(faces):
    """The union of faces, quickly where they do not overlap; they do where elements cross without a joint."""
    if shapely.coverage_is_valid(faces):
        return shapely.coverage_union_all(faces)
    return shapely.union_all(faces)
