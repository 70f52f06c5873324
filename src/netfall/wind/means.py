"""Gusts that are means over the roof around control points, with which its load is that of their coherence.

Between the control points gusts are g(y) = sum_i h_i(y) u_i, h the hats of their grid. With u_i the mean of
the gusts over the plan by P = M^-1 h, M_ij the integral of h_i h_j, a load whose shape is made of hats has at
every frequency the spectrum that Davenport's coherence gives it (the projection is orthogonal). Gusts at the
points, interpolated, are alike over a whole cell, however fast they vary. Means are weaker at a single node:
they lack what is alike over less than a cell.

The covariance of two means is a sum over separations a, b along the axes of the wind,

    R_(ik)(jl)(tau) = sum_ab r(tau; a, b) K_a,ij K_b,kl,    K_a,ij = sum_p,q P_ip P_jq over |p - q| = a,

r the covariance of points so far apart, at one height.
"""

import numpy as np

from netfall.numerics.linear import factorised, product, solve_columns

FINE, PER_CELL = 64, 8  # parts of the plan along an axis over which means are taken, at the least


def hats(values: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Weights (k, n) of the points of a line (k,) at values (n,), linear between them and level beyond."""
    return np.array([np.interp(values, line, row) for row in np.eye(len(line))])


def alike(line: np.ndarray, low: float, extent: float) -> tuple[np.ndarray, np.ndarray]:
    """Separations a (s,) [m] along an axis, and K (s, k k), for control points on a line (k,) [m]."""
    parts = max(FINE, PER_CELL * (len(line) - 1))
    h = hats(low + extent * (np.arange(parts) + 0.5) / parts, line)
    k, P = len(line), h.copy()
    M, K = np.empty((k, k)), np.empty((parts, k, k))
    product(h, np.ascontiguousarray(h.T), M)
    factorised(M)
    solve_columns(M, P)
    for a in range(parts):
        product(P[:, : parts - a].copy(), P[:, a:].T.copy(), K[a])
    K[1:] += K[1:].transpose(0, 2, 1)
    return extent * np.arange(parts) / parts, K.reshape(parts, k * k)


def together(r: np.ndarray, along: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Covariances (lags, c, c) of means, from those r (lags, s t) of points that are apart.

    along : (s, k k), across : (t, l l), K of both axes; c = k l
    """
    lags, (s, kk), (t, ll) = len(r), along.shape, across.shape
    half, whole = np.empty((lags * s, ll)), np.empty((lags * ll, kk))
    product(r.reshape(lags * s, t), across, half)
    product(half.reshape(lags, s, ll).transpose(0, 2, 1).reshape(lags * ll, s), along, whole)
    k, m = round(kk**0.5), round(ll**0.5)
    return whole.reshape(lags, m, m, k, k).transpose(0, 3, 1, 4, 2).reshape(lags, k * m, k * m)
