"""Wind on a roof: control points, histories in time, forces on the particles (paper 3, Eq. 5 to 7).

Histories exist only at a few control points; the gust at a particle is interpolated from the four around
it. With `means`, histories are means over the surface around points in the space of the nodes. With
`points` they are gusts at the points of a grid over the plan, as in the paper, or in space if heights
matter more than plan. Interpolation between partly correlated points would weaken these gusts. The weights
are therefore scaled to keep the variance. The gusts of neighbours are then more correlated than Davenport's
coherence gives.

At their onset gusts grow from zero, starting from the equilibrium under the mean wind.

The errors of interpolated gusts refer to Davenport's coherence: load on all nodes, correlation of pairs.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, final

import numpy as np

from netfall.core.arrays import FloatArray, IntArray
from netfall.core.functions import cos, exp, lengths, total
from netfall.core.kernels import kernel
from netfall.core.linear import product
from netfall.job.derived import tap_axes
from netfall.job.job import Job
from netfall.loads.wind.autoregressive import (
    GustModel,
    GustRecursion,
    PointGusts,
    cosine_weights,
    fit_gust_model,
    frequency_nodes,
)
from netfall.loads.wind.control_points import cluster_points, cluster_weights, is_resolved, plan_points
from netfall.loads.wind.measured import TableHistory, point_weights, read_measured, read_taps
from netfall.loads.wind.surface import SurfaceMeans, make_surface, make_surface_means, square_variances
from netfall.physics.wind_spectra import Gust, along_wind, make_gust, mean_speed


@final
@dataclass(frozen=True)
class WindField:
    """Wind data of each particle, computed once on rank 0.

    control_point : (c, 3) [m]; control_mean : (c,) [m/s]; model : of the gusts, None without gusts
    mean : (n,) [m/s]; corner : (n, 4) control points around each particle; weight : (n, 4)
    force : (n, 3) [N s2/m2] on each particle at 1 m/s
    tapped : whether pressures [N/m2] at taps replace speeds and their squares; force is then at 1 N/m2
    warnings : on the gusts, by `driver.reporting.wind`, once computed; samples of a study share the field
    """

    control_point: np.ndarray
    control_mean: np.ndarray
    model: GustModel | None
    mean: np.ndarray
    corner: np.ndarray
    weight: np.ndarray
    force: np.ndarray
    tapped: bool = False
    warnings: list[tuple[str, ...]] = field(default_factory=list)

    @property
    def varies(self) -> bool:
        """Whether the wind has gusts: generated, or from a table, for which the field has no mean."""
        return self.model is not None or not self.control_mean.any()

    @cached_property
    def deviation(self) -> np.ndarray:
        """Standard deviation (n,) [m/s] of the gusts on each particle."""
        return interpolated_deviation(self.corner, self.weight, self.model.covariance)

    def mean_square(self, mean_gust: np.ndarray) -> np.ndarray:
        """Compute the square (n,) [m2/s2] of the mean speed; mean_gust : (c,) [m/s], mean of the history."""
        speed = np.empty(len(self.mean))
        particle_speeds(self.mean, self.corner, self.weight, mean_gust, speed)
        return speed if self.tapped else speed * speed


def force_factor(settings: Any) -> np.ndarray | float:
    """Return the force on an upward vector area of 1 m2 at 1 m/s, -c_p,net rho / 2 [N s2/m2].

    For pressures at taps it is -1, the force at 1 N/m2.
    """
    if settings.pressures:
        return -1.0
    return -np.asarray(settings.pressure_coefficient) * 0.5 * settings.air_density


def profile_speed(settings: Any, speed: float, z: np.ndarray) -> np.ndarray:
    """Compute the mean wind (k,) [m/s] at z (k,) [m] from its speed at 10 m above ground."""
    return mean_speed(z + settings.base_height, speed, settings.profile_exponent)


def mean_wind_square(x: np.ndarray, settings: Any) -> np.ndarray:
    """Compute the square (n,) [m2/s2] of the mean wind at x (n, 3) [m] from its speed at 10 m."""
    mean = profile_speed(settings, settings.speed, x[:, 2])
    return mean * mean


def make_wind_field(
    x: np.ndarray,
    vector: np.ndarray,
    settings: Any,
    places: np.ndarray | None = None,
    force: np.ndarray | None = None,
    patches: Any = None,
) -> WindField:
    """Build the field for a roof at its start: x (n, 3) [m], upward vector areas A (n, 3) [m2].

    vector : with the drag areas of slender elements, if there are any
    places : (c, 3) [m], of a table of speeds at several points, or (c, 2 or 3) of pressures at taps
    force : (n, 3) [N s2/m2] at 1 m/s, None: from the coefficients in `settings`
    patches : of `loads.exposed_patches`, None: squares around the nodes
    The force at speed U is -c_p,net rho U^2 / 2 A: suction (c_p,net < 0) lifts (Eq. 6, 7). The force on drag
    areas is rho U^2 / 2 times the area. It is quasi-steady: U is the speed at the particle, not relative to
    its motion.
    """
    force = np.reshape(force_factor(settings), (-1, 1)) * vector if force is None else force
    if settings.pressures:
        corner, weight = point_weights(x, places, places.shape[1])
        zero_speed, zero_mean = np.zeros(len(places)), np.zeros(len(x))
        return WindField(places, zero_speed, None, zero_mean, corner, weight, force, tapped=True)
    if settings.file:
        return _measured_field(x, force, settings, places)
    y, up = along_wind(x, settings.direction), along_wind(vector, settings.direction)
    patches = patches or (y, square_variances(up))
    profile = partial(profile_speed, settings, settings.speed)
    mean, gust, model = profile(x[:, 2]), make_gust(settings), None
    if gust is None:
        points, corner, weight = plan_points(y, np.asarray(up.any(1)), settings.control_points)[:3]
    elif settings.gust_field == "point":
        points, corner, weight = _points(y, patches, up, mean, settings)
        gusts = PointGusts(points, profile(points[:, 2]), settings.coherence_decay)
        model = fit_gust_model(gusts, gust, settings.time_step, settings.ar_order)
        correlation = model.covariance / model.covariance[0, 0]
        weight = weight / interpolated_deviation(corner, weight, correlation)[:, None]
    else:
        surface, points, corner, weight = _clusters(y, patches, up, mean, settings)
        gusts = make_surface_means(surface, corner, weight, len(points), settings.coherence_decay)
        model = fit_gust_model(gusts, gust, settings.time_step, settings.ar_order)
    points = along_wind(points, -settings.direction)  # back to the axes of the net
    return WindField(points, profile(points[:, 2]), model, mean, corner, weight, force)


def _points(
    y: FloatArray, patches: Any, vector: FloatArray, mean: FloatArray, settings: Any
) -> tuple[Any, ...]:
    """Return the control points of `points`: on a grid in plan, unless the net is too steep for a grid."""
    loaded = np.asarray(vector.any(1)) if vector.any() else np.ones(len(y), bool)
    points, corner, weight, cell = plan_points(y, loaded, settings.control_points)
    if is_resolved(y[loaded], points, corner[loaded], weight[loaded], cell, settings.coherence_decay):
        return points, corner, weight
    return _clusters(y, patches, vector, mean, settings)[1:]


def _clusters(y: Any, patches: Any, vector: Any, mean: Any, settings: Any) -> tuple[Any, ...]:
    """Return the loaded surface, control points in space, and nearest points and weights of each node."""
    decay, limit = np.array(settings.coherence_decay), settings.control_points
    surface = make_surface(patches, vector, mean, decay, limit)
    points = cluster_points(surface, decay, limit)
    corner, weight = cluster_weights(y, points, decay)
    return surface, points, corner, weight


def _measured_field(x: FloatArray, force: FloatArray, settings: Any, points: Any) -> WindField:
    """Build the field of a table. The profile converts its speeds to the height of each particle.

    The table has one speed at 10 m, or several at their points (c, 3) [m].
    """
    rows = len(x)
    corner, weight = np.zeros((rows, 4), np.int64), np.zeros((rows, 4))
    profile = partial(profile_speed, settings, 1.0)
    if points is None:
        points = np.array([[*x[:, :2].mean(0), 10.0 - settings.base_height]])
        weight[:, 0] = profile(x[:, 2])
    else:
        corner, weight = point_weights(x, points)
        weight *= profile(x[:, 2])[:, None] / profile(points[:, 2])[corner]
    return WindField(points, np.zeros(len(points)), None, np.zeros(rows), corner, weight, force)


def interpolated_deviation(corner: IntArray, weight: FloatArray, covariance: FloatArray) -> np.ndarray:
    """Compute the standard deviation (n,) of sums with weights (n, 4) at points with covariance (c, c)."""
    pairs = covariance[corner[:, :, None], corner[:, None, :]]
    return np.sqrt(np.sum(weight[:, :, None] * weight[:, None, :] * pairs, axis=(1, 2)))


@kernel
def particle_speeds(
    mean: FloatArray, corner: IntArray, weight: FloatArray, gust: FloatArray, speed: FloatArray
) -> None:
    """Compute the total wind speed (n,) [m/s] of the particles from the gusts (c,) at the control points."""
    for p in range(mean.shape[0]):
        u = mean[p]
        for k in range(4):
            u += weight[p, k] * gust[corner[p, k]]
        speed[p] = u


def read_history(job: Job) -> TableHistory | None:
    """Read the history of measured speeds or tap pressures; None: generated wind. Raises InputError."""
    wind = job.wind
    if wind is None or not (wind.file or wind.pressures):
        return None
    if wind.file:
        return read_measured(job)
    folder = job.path.parent
    return read_taps(folder / wind.taps, folder / wind.pressures, job.dynamics.duration, tap_axes(job))


class GeneratedHistory:
    """Gusts generated sample by sample, on rank 0."""

    def __init__(self, field: WindField, settings: Any):
        self.dt = settings.time_step
        self.mean_gust = np.zeros(len(field.control_mean))  # m/s, zero over the duration
        self.recursion = GustRecursion(field.model, settings.seed) if field.model else None

    def sample(self, k: int) -> tuple[float, np.ndarray]:
        """Return time [s] and gusts (c,) [m/s] of sample k; samples must be requested in order."""
        return k * self.dt, self.recursion.advance() if self.recursion else self.mean_gust


MIN_RAMP_SAMPLES = 16  # smallest number of samples of the ramp; the linear interpolation error is then 0.3 %


def gust_growth(time: float, ramp: float) -> float:
    """Return the share of the gusts at a time [s]: (1 - cos(pi t / ramp)) / 2 over the ramp [s], then 1."""
    if time >= ramp:
        return 1.0
    return 0.5 * (1.0 - float(cos(math.pi * max(time, 0.0) / ramp)))


class GrowingGusts:
    """Samples of a history whose difference from its mean grows over the ramp; on rank 0.

    If the samples are too far apart to resolve the ramp, linear samples are inserted.
    """

    def __init__(self, history: GeneratedHistory | TableHistory, ramp: float):
        """history : `GeneratedHistory`, `TableHistory`; ramp : [s], 0: no growth"""
        self.history = history
        self.ramp = ramp if ramp > 0.0 else -math.inf  # a table may have times before 0
        self.count = 0  # samples taken from the history
        self.last = (0.0, history.mean_gust)  # latest of these

    def next(self) -> list[tuple[float, np.ndarray]]:
        """Return the next sample, time [s] and gusts (c,) [m/s], after the samples inserted before it."""
        (start, first), sample = self.last, self.history.sample(self.count)
        time, gust = sample
        end, parts = min(time, self.ramp), 1
        if self.count and start < self.ramp:
            parts = math.ceil((end - start) * MIN_RAMP_SAMPLES / self.ramp)
        times = [start + k / parts * (end - start) for k in range(1, parts)]
        if times and time > self.ramp:
            times.append(self.ramp)
        samples = [(t, first + (t - start) / (time - start) * (gust - first)) for t in times] + [sample]
        self.count, self.last = self.count + 1, sample
        mean = self.history.mean_gust
        return [
            (t, g if t >= self.ramp else mean + gust_growth(t, self.ramp) * (g - mean)) for t, g in samples
        ]

    def until(self, end: float) -> tuple[np.ndarray, np.ndarray]:
        """Return times (t,) [s] and gusts (t, c) of the samples to the first at or after a time [s]."""
        samples = self.next()
        while samples[-1][0] < end:
            samples += self.next()
        times, gusts = map(np.array, zip(*samples))
        count = int(np.searchsorted(times, end)) + 1
        return times[:count], gusts[:count]


MAX_COMPARED_NODES = 200  # largest number of nodes whose pairs are compared
CORRELATION_ROWS = 400  # rows of the table of Davenport's correlation


def load_power(
    patches: Any, vector: FloatArray, field: WindField, settings: Any, n: FloatArray, weight: FloatArray
) -> np.ndarray:
    """Return the power (w,) of the load on all nodes relative to the coherence model, for gusts at points.

    patches : of `loads.exposed_patches`; vector : (n, 3) [m2]
    n : (f,) [Hz] frequencies; weight : (w, f), weights of frequencies in a sum
    """
    decay = settings.coherence_decay
    up, points = (along_wind(place, settings.direction) for place in (vector, field.control_point))
    node_load = np.sqrt(np.sum(field.force**2, axis=1)) * field.mean
    load = np.bincount(field.corner.ravel(), (node_load[:, None] * field.weight).ravel(), len(points))
    at_points = PointGusts(points, field.control_mean, decay).covariances(n, weight)
    surface = make_surface(patches, up, field.mean, decay, len(points))
    share = surface.over_patches(node_load[surface.node])
    delay, pairs = surface.pairs(share[:, None], decay)
    target = SurfaceMeans(delay, pairs).covariances(n, weight)
    return load @ at_points @ load / target[:, 0, 0]


def coherence_errors(x: np.ndarray, field: WindField, settings: Any, gust: Gust) -> np.ndarray:
    """Compute the root mean square errors (2,) of correlations of loaded nodes x (n, 3) against Davenport's.

    The first error is over pairs whose separation, weighted by decay, is larger in plan than in height; the
    second is over all other pairs. nan: no such pairs
    """
    loaded = np.flatnonzero(field.force.any(1) if field.force.any() else np.ones(len(x), bool))
    loaded = loaded[np.lexsort(x[loaded].T)]
    node = loaded[np.unique(np.linspace(0, len(loaded) - 1, MAX_COMPARED_NODES).astype(int))]
    p, q = (node[rows] for rows in np.triu_indices(len(node), 1))
    y = along_wind(x, settings.direction)
    separation = np.abs(y[p] - y[q]) * settings.coherence_decay
    delay = lengths(separation) / (0.5 * (field.mean[p] + field.mean[q]))
    pairs = field.model.covariance[field.corner[p][:, :, None], field.corner[q][:, None]]
    covariance = np.sum(field.weight[p][:, :, None] * field.weight[q][:, None] * pairs, axis=(1, 2))
    correlation = covariance / (field.deviation[p] * field.deviation[q])
    square = (correlation - _correlation(delay, gust, settings.time_step)) ** 2
    in_height = separation[:, 2] > lengths(separation[:, :2])
    means = [
        total(square[which]) / which.sum() if which.any() else np.nan for which in (~in_height, in_height)
    ]
    return np.sqrt(np.array(means))


def _correlation(delay: np.ndarray, gust: Gust, dt: float) -> np.ndarray:
    """Compute Davenport's correlation (k,) of gusts sampled at dt [s], with coherence exp(-n delay)."""
    n = frequency_nodes(gust, dt)
    weight = cosine_weights(n, [0], dt) * gust.spectrum(n)
    table = np.linspace(0.0, 1.0, CORRELATION_ROWS) ** 2 * delay.max(initial=0.0)
    correlation = product(weight / weight.sum(), exp(-np.multiply.outer(n, table)))
    return np.interp(delay, table, correlation[0])
