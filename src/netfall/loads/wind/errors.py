"""Errors of interpolated gusts against Davenport's coherence: load on all nodes, correlation of pairs."""

from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray
from netfall.core.functions import exp, lengths, total
from netfall.core.linear import product
from netfall.loads.wind.autoregressive import PointGusts, cosine_weights, frequency_nodes
from netfall.loads.wind.coherence import along_wind
from netfall.loads.wind.field import WindField
from netfall.loads.wind.surface import SurfaceMeans, make_surface
from netfall.physics.wind_spectra import Gust

MAX_COMPARED_NODES = 200  # largest number of nodes whose pairs are compared
CORRELATION_ROWS = 400  # rows of the table of Davenport's correlation


def load_power(
    x: np.ndarray, vector: FloatArray, field: WindField, settings: Any, n: FloatArray, weight: FloatArray
) -> np.ndarray:
    """Return the power (w,) of the load on all nodes over that of the coherence, for gusts at points.

    x : (n, 3); vector : (n, 3) [m2]; n : (f,) [Hz] frequencies; weight : (w, f), weights of frequencies in a
    sum
    """
    decay = settings.coherence_decay
    y, up, points = (along_wind(place, settings.direction) for place in (x, vector, field.control_point))
    node_load = np.sqrt(np.sum(field.force**2, axis=1)) * field.mean
    load = np.bincount(field.corner.ravel(), (node_load[:, None] * field.weight).ravel(), len(points))
    at_points = PointGusts(points, field.control_mean, decay).covariances(n, weight)
    surface = make_surface(y, up, field.mean, decay, len(points))
    share = surface.over_patches(node_load[surface.node])
    delay, pairs = surface.pairs(share[:, None], decay)
    target = SurfaceMeans(delay, pairs).covariances(n, weight)
    return load @ at_points @ load / target[:, 0, 0]


def coherence_errors(x: np.ndarray, field: WindField, settings: Any, gust: Gust) -> np.ndarray:
    """Compute the root mean square errors (2,) of correlations of loaded nodes x (n, 3) against Davenport's.

    The first is over pairs separated more over the roof than in height, by decay, the second over all
    other pairs. nan: no such pairs
    """
    loaded = np.flatnonzero(field.force.any(1) if field.force.any() else np.ones(len(x), bool))
    loaded = loaded[np.lexsort(x[loaded].T)]
    node = loaded[np.unique(np.linspace(0, len(loaded) - 1, MAX_COMPARED_NODES).astype(int))]
    p, q = (node[rows] for rows in np.triu_indices(len(node), 1))
    y = along_wind(x, settings.direction)
    separation = np.abs(y[p] - y[q]) * settings.coherence_decay
    delay = lengths(separation) / (0.5 * (field.mean[p] + field.mean[q]))
    correlation = _covariance(field, p, q) / (field.deviation[p] * field.deviation[q])
    square = (correlation - _correlation(delay, gust, settings.time_step)) ** 2
    in_height = separation[:, 2] > lengths(separation[:, :2])
    means = [
        total(square[which]) / which.sum() if which.any() else np.nan for which in (~in_height, in_height)
    ]
    return np.sqrt(np.array(means))


def _covariance(field: WindField, p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Compute the covariances (k,) [m2/s2] of the gusts at pairs of nodes."""
    pairs = field.model.covariance[field.corner[p][:, :, None], field.corner[q][:, None]]
    return np.sum(field.weight[p][:, :, None] * field.weight[q][:, None] * pairs, axis=(1, 2))


def _correlation(delay: np.ndarray, gust: Gust, dt: float) -> np.ndarray:
    """Compute Davenport's correlation (k,) of gusts sampled at dt [s], with coherence exp(-n delay)."""
    n = frequency_nodes(gust, dt)
    weight = cosine_weights(n, [0], dt) * gust.spectrum(n)
    table = np.linspace(0.0, 1.0, CORRELATION_ROWS) ** 2 * delay.max(initial=0.0)
    correlation = product(weight / weight.sum(), exp(-np.multiply.outer(n, table)))
    return np.interp(delay, table, correlation[0])
