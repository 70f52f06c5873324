"""Random nets: points (n, 3) [m], pairs (m, 2), held (n,); columns of numbers as tables."""

import itertools

import numpy as np

SPACING = 4.0  # m


def grid(rng, crossed=False):
    """Return a jittered grid on a saddle; `crossed`: some cells have both diagonals, without a node."""
    a, b = (int(k) for k in rng.integers(4, 6, 2))
    number = np.arange(a * b).reshape(a, b)
    i, j = np.meshgrid(np.arange(a), np.arange(b), indexing="ij")
    held = ((i == 0) | (i == a - 1) | (j == 0) | (j == b - 1)).ravel()
    plan = 4.0 * np.column_stack([i.ravel(), j.ravel()]) + rng.uniform(-0.3, 0.3, (a * b, 2)) * ~held[:, None]
    middle = plan.mean(0)
    z = 0.02 * (plan[:, 0] - middle[0]) ** 2 - 0.02 * (plan[:, 1] - middle[1]) ** 2
    pairs = [
        *zip(number[:-1].ravel(), number[1:].ravel()),
        *zip(number[:, :-1].ravel(), number[:, 1:].ravel()),
    ]
    if crossed:
        for p, q, r, s in zip(
            *(c.ravel() for c in (number[:-1, :-1], number[1:, 1:], number[1:, :-1], number[:-1, 1:]))
        ):
            if rng.random() < 0.5:
                pairs += [(p, q), (r, s)]
    return np.column_stack([plan, z]), np.array(pairs), held


def triangles(rng):
    """Return a Delaunay net of jittered points; its hull and some inner points are held."""
    from scipy.spatial import Delaunay

    rows, columns = (int(k) for k in rng.integers(4, 8, 2))
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    plan = 4.5 * np.column_stack([(i + 0.5 * (j % 2)).ravel(), 0.87 * j.ravel()])
    plan += rng.uniform(-0.6, 0.6, plan.shape)
    mesh = Delaunay(plan)
    corners = mesh.simplices
    edges = np.unique(
        np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), 1), axis=0
    )
    held = np.zeros(len(plan), bool)
    held[mesh.convex_hull.ravel()] = True
    held |= rng.random(len(plan)) < 0.05
    middle = plan.mean(0)
    z = 4.0 - 0.01 * np.sum((plan - middle) ** 2, axis=1) + rng.uniform(-0.2, 0.2, len(plan))
    return np.column_stack([plan, z]), edges, held


def web(rng):
    """Return spokes and rings around a hub, held at the outermost ring."""
    spokes, rings = int(rng.integers(6, 13)), int(rng.integers(2, 6))
    angle = 2 * np.pi * np.arange(spokes) / spokes
    points, pairs = [[0.0, 0.0, 1.0]], []
    at = lambda ring, k: 1 + (ring - 1) * spokes + k % spokes
    for ring, k in itertools.product(range(1, rings + 1), range(spokes)):
        r = 3.0 + 3.5 * ring
        points.append([r * np.cos(angle[k]), r * np.sin(angle[k]), 0.3 * ring * (-1) ** k])
        pairs += [(at(ring - 1, k) if ring > 1 else 0, at(ring, k)), (at(ring, k), at(ring, k + 1))]
    held = np.arange(len(points)) > (rings - 1) * spokes
    points = np.array(points)
    return points + rng.uniform(-0.2, 0.2, points.shape) * ~held[:, None], np.array(pairs), held


def with_tails(rng, points, pairs, held):
    """Add two chains of three elements that hang from supports, straight outward at first."""
    points, pairs, held = list(points), list(map(tuple, pairs)), list(held)
    middle = np.mean(points, axis=0)
    far = np.argsort([-np.hypot(*(p - middle)[:2]) if h else 0.0 for p, h in zip(points, held)])
    for support in far[:2]:
        outward = (points[support] - middle) * [1, 1, 0]
        last = support
        for _ in range(3):
            points.append(
                points[last] + 4.0 * outward / np.linalg.norm(outward) + [0, 0, rng.uniform(-0.5, 0)]
            )
            held.append(False)
            pairs.append((last, len(points) - 1))
            last = len(points) - 1
    return np.array(points), np.array(pairs), np.array(held)


def line(rng):
    """Return a chain between two supports."""
    n = int(rng.integers(5, 12))
    points = SPACING * np.arange(n)[:, None] * [1.0, 0.0, 0.0] + rng.uniform(-0.1, 0.1, (n, 3))
    held = np.isin(np.arange(n), (0, n - 1))
    return points, np.column_stack([np.arange(n - 1), np.arange(1, n)]), held


def star(rng):
    """Return arms of one or two elements around a node, with held ends."""
    points, pairs, held = [np.zeros(3)], [], [False]
    arms = int(rng.integers(3, 9))
    for angle in 2 * np.pi * np.arange(arms) / arms:
        last = 0
        for k in range(1, 2 + int(rng.integers(0, 2))):
            points.append(
                SPACING * k * np.array([np.cos(angle), np.sin(angle), 0.0]) + rng.uniform(-0.3, 0.3, 3)
            )
            pairs.append((last, len(points) - 1))
            held.append(False)
            last = len(points) - 1
        held[last] = True
    return np.array(points), np.array(pairs), np.array(held)


def apart(rng):
    """Return a separate star and chain."""
    (a, of_a, held_a), (b, of_b, held_b) = star(rng), line(rng)
    pairs = np.concatenate([of_a, of_b + len(a)])
    return np.concatenate([a, b + [0.0, 20.0, 0.0]]), pairs, np.concatenate([held_a, held_b])


NETS = {
    "line": line,
    "star": star,
    "apart": apart,
    "grid": grid,
    "triangles": triangles,
    "web": web,
    "crossed": lambda rng: grid(rng, crossed=True),
}
WITH_FACES = ("grid", "triangles", "web")


# --- tables


def number(value) -> str:
    """Return a number as in a table; nan gives an empty cell."""
    return "" if np.isnan(value) else repr(float(value))


def some(rng, values, share=0.7):
    """Return values with some empty cells."""
    return np.where(rng.random(len(values)) < share, values, np.nan)


def table(columns: dict) -> str:
    """Return columns as CSV text."""
    rows = zip(*(map(str, values) for values in columns.values()))
    return "\n".join([",".join(columns), *map(",".join, rows)]) + "\n"
