"""Cables as second-order cones: the element's part of the interior point method of `equilibrium.interior`.

A cable that is stretched over d, three [m], has a length l >= |d|, slack if it is longer. Its tension N is at
least the pull on its ends: |v| <= N. Both hold as inequalities; at equilibrium l N = d v. Of a cable that
yields, N <= its limit, and what its trial force EA (eps - eps_p) has beyond N, the flow p, is at least 0: at
equilibrium p (limit - N) = 0. On the way all these products are `gap` [J], and the energy is convex in d and
l: cables that are slack, or yield, or lie far from their equilibrium, are nothing special (Kanno and Ohsaki
2003). The scaling between (l, d) and (N, -v) is that of Nesterov and Todd (1997).
"""

from typing import NamedTuple

import numpy as np

from netfall.ground.compile import kernel, part_of_kernel
from netfall.mechanics.state import State
from netfall.numerics.arithmetic import logarithm

STRETCHED = 1e-4  # strain to begin with, at least, in choosing the gap
LEAST = 0.1  # of a limit or a force: tension to begin with


class Cables(NamedTuple):
    """Elements (m,) of one rank: `ends` (m, 2); EA [N]; L0 [m]; eps_p; limit [N], inf: none.

    carries : 1 for cables in the net, 0 for bars, which stay as they are, and for what has left
    logarithmic : whether strains are
    """

    ends: np.ndarray
    EA: np.ndarray
    L0: np.ndarray
    eps_p: np.ndarray
    limit: np.ndarray
    carries: np.ndarray
    logarithmic: bool


def cables_of(state: State) -> Cables:
    """The elements of a state."""
    plastic, m = state.features.plastic, state.m
    limit = state.yield_force if plastic else np.full(m, np.inf)
    eps_p = state.eps_p if plastic else np.zeros(m)
    carries = ((state.EA > 0.0) & (state.bar == 0)).astype(np.uint8)
    logarithmic = state.features.strain == "logarithmic"
    return Cables(state.ends, state.EA, state.L0, eps_p, limit, carries, logarithmic)


@part_of_kernel
def trial(e, length, cables):
    """Force [N] of element e, were it elastic, at a length [m], and its stiffness [N/m]."""
    EA, L0 = cables.EA[e], cables.L0[e]
    if cables.logarithmic:
        return EA * (logarithm(length / L0) - cables.eps_p[e]), EA / length
    return EA * ((length - L0) / L0 - cables.eps_p[e]), EA / L0


@part_of_kernel
def _along(e, u, cables):
    """How much farther the second end of element e moves than the first, three [m]."""
    a, b = cables.ends[e, 0], cables.ends[e, 1]
    return u[b, 0] - u[a, 0], u[b, 1] - u[a, 1], u[b, 2] - u[a, 2]


@part_of_kernel
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@part_of_kernel
def _scaled(e, at, sign, first, rest):
    """The scaling of element e, or (sign -1) its inverse, times a vector of four."""
    w0, w, size = at[e, 0], (at[e, 1], at[e, 2], at[e, 3]), at[e, 4]
    if sign < 0.0:
        size = 1.0 / size
    along = _dot(w, rest)
    more = along / (1.0 + w0) + sign * first
    scaled = (size * (rest[0] + more * w[0]), size * (rest[1] + more * w[1]), size * (rest[2] + more * w[2]))
    return size * (w0 * first + sign * along), scaled


@part_of_kernel
def with_gap(a, k, gap):
    """The tension N [N] above 0 of which N (N - a) = k gap, for a force a [N] of the elastic law."""
    return 0.5 * (a + np.sqrt(a * a + 4.0 * gap * k))


@kernel
def begin_cones(x, cables, gap, now):
    """Fill now (m, 6): length [m], tension [N], flow [N], pull, three [N], for positions x (n, 3) [m]."""
    for e in range(now.shape[0]):
        if not cables.carries[e]:
            continue
        d = _along(e, x, cables)
        L = np.sqrt(_dot(d, d))
        a, k = trial(e, max(L, 1e-3 * cables.L0[e]), cables)
        N, limit, flow = with_gap(a, k, gap), cables.limit[e], 0.0
        if limit < np.inf:
            half = 0.5 * (limit - N)
            N = max(N + half - np.sqrt(half * half + gap * k), LEAST * min(N, limit))
            flow = gap * k / (limit - N)
        half = 0.5 * gap / N
        length = half + np.sqrt(half * half + L * L)
        now[e, 0], now[e, 1], now[e, 2] = length, N, flow
        for i in range(3):
            now[e, 3 + i] = N / length * d[i]


@kernel
def scale_cones(x, cables, now, at, direction, axial, across):
    """Fill the scaling at (m, 5), and the stiffness of cables in arrays of a `Tangent`."""
    for e in range(now.shape[0]):
        if not cables.carries[e]:
            across[e] = max(across[e], 0.0)
            continue
        d, v = _along(e, x, cables), (now[e, 3], now[e, 4], now[e, 5])
        length, N = now[e, 0], now[e, 1]
        s = np.sqrt(length * length - _dot(d, d))
        z = np.sqrt(N * N - _dot(v, v))
        g = np.sqrt(2.0 * (1.0 + (length * N - _dot(d, v)) / (s * z)))
        at[e, 0], at[e, 4] = (length / s + N / z) / g, np.sqrt(s / z)
        square = 0.0
        for i in range(3):
            at[e, 1 + i] = (d[i] / s + v[i] / z) / g
            square += at[e, 1 + i] ** 2
        for i in range(3):
            direction[e, i] = at[e, 1 + i] / max(np.sqrt(square), 1e-300)
        square = s / z
        _, k = trial(e, length, cables)
        soft = square * k / (1.0 + now[e, 2] / (cables.limit[e] - N))
        H = 2.0 * at[e, 0] ** 2 - 1.0
        axial[e], across[e] = (H * soft + 1.0) / (soft + H) / square, 1.0 / square


@kernel
def aim_cones(x, cables, now, at, gap, more, aimed):
    """Fill aimed (m, 5): the pull [N] at fixed ends once products are `gap`, then what its lengths do.

    more : (m, 5), what the last change leaves of the products, see `correct_cones`
    """
    for e in range(now.shape[0]):
        if not cables.carries[e]:
            continue
        d = _along(e, x, cables)
        length, N, flow = now[e, 0], now[e, 1], now[e, 2]
        share = gap / (length * length - _dot(d, d))
        room, square = cables.limit[e] - N, at[e, 4] ** 2
        a, k = trial(e, length, cables)
        D = 1.0 + flow / room
        rest = (a - N - gap * k / room - more[e, 4]) / D
        H = (2.0 * at[e, 0] ** 2 - 1.0) / square
        longer = (share * length - N - more[e, 0] - rest) / (k / D + H)
        for i in range(3):
            aimed[e, i] = share * d[i] + more[e, 1 + i] - 2.0 * at[e, 0] / square * at[e, 1 + i] * longer
        aimed[e, 3], aimed[e, 4] = longer, rest


@kernel
def add_pulls(ends, pull, f):
    """Add pulls (m, 3) [N] on the first ends, and against them on the second ones, to f (n, 3) [N]."""
    for e in range(ends.shape[0]):
        for i in range(3):
            f[ends[e, 0], i] += pull[e, i]
            f[ends[e, 1], i] -= pull[e, i]


@part_of_kernel
def _room(a, b, c):
    """Smallest t > 0 with a t^2 + 2 b t + c = 0, c > 0; inf: none."""
    root = b * b - a * c
    if root < 0.0:
        return np.inf
    below = np.sqrt(root) - b
    return c / below if below > 0.0 else np.inf


@kernel
def change_cones(x, u, cables, now, at, direction, axial, across, gap, more, aimed, change):
    """Fill change (m, 9) of `now`, and of the vectors along, with displacements u (n, 3) [m] of nodes.

    How much of it can be gone before an inequality no longer holds.
    """
    far = np.inf
    for e in range(now.shape[0]):
        if not cables.carries[e]:
            continue
        d, w, v = _along(e, x, cables), _along(e, u, cables), (now[e, 3], now[e, 4], now[e, 5])
        length, N, flow = now[e, 0], now[e, 1], now[e, 2]
        room, square = cables.limit[e] - N, at[e, 4] ** 2
        _, k = trial(e, length, cables)
        soft = k / (1.0 + flow / room)
        H = (2.0 * at[e, 0] ** 2 - 1.0) / square
        turned = 2.0 * at[e, 0] / square * _dot((at[e, 1], at[e, 2], at[e, 3]), w)
        longer = aimed[e, 3] + turned / (soft + H)
        tighter = aimed[e, 4] + soft * longer
        flows = 0.0
        if cables.limit[e] < np.inf:
            flows = gap * k / room - flow + flow / room * tighter + more[e, 4]
        stiff = (axial[e] - across[e]) * _dot((direction[e, 0], direction[e, 1], direction[e, 2]), w)
        pulls = (
            aimed[e, 0] - v[0] + across[e] * w[0] + stiff * direction[e, 0],
            aimed[e, 1] - v[1] + across[e] * w[1] + stiff * direction[e, 1],
            aimed[e, 2] - v[2] + across[e] * w[2] + stiff * direction[e, 2],
        )
        change[e, 0], change[e, 1], change[e, 2] = longer, tighter, flows
        for i in range(3):
            change[e, 3 + i], change[e, 6 + i] = pulls[i], w[i]
        far = min(
            far, _room(longer * longer - _dot(w, w), length * longer - _dot(d, w), length**2 - _dot(d, d))
        )
        far = min(
            far, _room(tighter**2 - _dot(pulls, pulls), N * tighter - _dot(v, pulls), N * N - _dot(v, v))
        )
        far = min(far, -length / longer if longer < 0.0 else np.inf)
        far = min(far, -N / tighter if tighter < 0.0 else np.inf)
        far = min(far, room / tighter if tighter > 0.0 else np.inf)
        far = min(far, -flow / flows if flows < 0.0 else np.inf)
    return far


@kernel
def correct_cones(cables, now, at, change, more):
    """Fill more (m, 5): what products have of second order in a change, as tension, pull and flow."""
    for e in range(now.shape[0]):
        if not cables.carries[e]:
            continue
        a, b = _scaled(e, at, 1.0, now[e, 1], (-now[e, 3], -now[e, 4], -now[e, 5]))
        s, t = _scaled(e, at, -1.0, change[e, 0], (change[e, 6], change[e, 7], change[e, 8]))
        z, y = _scaled(e, at, 1.0, change[e, 1], (-change[e, 3], -change[e, 4], -change[e, 5]))
        r = (s * y[0] + z * t[0], s * y[1] + z * t[1], s * y[2] + z * t[2])
        first = (a * (s * z + _dot(t, y)) - _dot(b, r)) / (a * a - _dot(b, b))
        rest = ((r[0] - first * b[0]) / a, (r[1] - first * b[1]) / a, (r[2] - first * b[2]) / a)
        more[e, 0], rest = _scaled(e, at, -1.0, first, rest)
        for i in range(3):
            more[e, 1 + i] = rest[i]
        more[e, 4] = change[e, 2] * change[e, 1] / (cables.limit[e] - now[e, 1])


@kernel
def gaps_of_cones(x, cables, now, out):
    """Fill out (m, 2): the products [J] of length and tension less those of vectors, and of flow and room."""
    for e in range(now.shape[0]):
        out[e, 0] = out[e, 1] = 0.0
        if not cables.carries[e]:
            continue
        length, N = now[e, 0], now[e, 1]
        out[e, 0] = length * N - _dot(_along(e, x, cables), (now[e, 3], now[e, 4], now[e, 5]))
        if cables.limit[e] < np.inf:
            _, k = trial(e, length, cables)
            out[e, 1] = now[e, 2] * (cables.limit[e] - N) / k
