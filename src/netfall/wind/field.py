"""The wind on a roof: control points, histories in time, the force on the particles (paper 3, Eq. 5 to 7).

Histories exist at a few control points only; a particle's gust is interpolated between the four around it.
With `means` they are means over the surface around points in the space that it fills. With `points` they are
those at the points of a grid over the plan, as in the paper, or in space if heights matter more than plan.
Interpolation between partly correlated points would weaken these gusts, so its weights are scaled to keep the
variance, and gusts of neighbours are more alike than their coherence makes them.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from netfall.core.kernels import kernel
from netfall.wind.autoregressive import AtPoints, GustModel, GustRecursion, fit_gust_model
from netfall.wind.clusters import cluster_points, cluster_weights
from netfall.wind.coherence import along_wind, mean_speed
from netfall.wind.grid import is_resolved, plan_points
from netfall.wind.means import means_over
from netfall.wind.measured import TableHistory, place_weights, read_measured, read_taps
from netfall.wind.spectra import gust_of
from netfall.wind.surface import surface_of


@dataclass(frozen=True)
class WindField:
    """What the wind needs for each particle; all of it computed on rank 0, once.

    control_point : (c, 3) [m]; control_mean : (c,) [m/s]; model : of the gusts, None without gusts
    mean : (n,) [m/s]; corner : (n, 4) control points around; weight : (n, 4)
    force : (n, 3) [N s2/m2] on each particle at 1 m/s
    tapped : given are pressures at taps [N/m2] in place of speeds and of their squares; force at 1 N/m2
    """

    control_point: np.ndarray
    control_mean: np.ndarray
    model: GustModel | None
    mean: np.ndarray
    corner: np.ndarray
    weight: np.ndarray
    force: np.ndarray
    tapped: bool = False

    @property
    def varies(self) -> bool:
        """Whether it blows in gusts: generated ones, or those of a table, of which a field has no mean."""
        return self.model is not None or not self.control_mean.any()

    @cached_property
    def deviation(self) -> np.ndarray:
        """Standard deviation (n,) [m/s] of the gusts on each particle."""
        return interpolated_deviation(self.corner, self.weight, self.model.covariance)

    def mean_square(self, mean_gust: np.ndarray) -> np.ndarray:
        """Square (n,) [m2/s2] of the mean speed; mean_gust : (c,) [m/s], what the history adds to it."""
        speed = np.empty(len(self.mean))
        particle_speeds(self.mean, self.corner, self.weight, mean_gust, speed)
        return speed if self.tapped else speed * speed


def force_factor(settings) -> np.ndarray | float:
    """Force on an upward vector area of 1 m2, [N s2/m2] at 1 m/s: -u_s rho / 2; of taps at 1 N/m2: -1."""
    if settings.pressures:
        return -1.0
    return -np.asarray(settings.shape_coefficient) * 0.5 * settings.air_density


def still_force(x: np.ndarray, vector: np.ndarray, settings) -> np.ndarray:
    """Force (n, 3) [N] of the mean wind, which its speed at 10 m gives; arguments as of `make_wind_field`."""
    mean = mean_speed(x[:, 2] + settings.base_height, settings.speed, settings.profile_exponent)
    return np.reshape(force_factor(settings), (-1, 1)) * vector * (mean * mean)[:, None]


def make_wind_field(
    x: np.ndarray, vector: np.ndarray, settings, places: np.ndarray | None = None
) -> WindField:
    """The field for a roof at its start: x (n, 3) [m], upward vector areas A (n, 3) [m2].

    places : (c, 3) [m], of a table of speeds at several points, or (c, 2) of pressures at taps
    The force at speed U is -u_s rho U^2 / 2 A: suction (u_s < 0) lifts (Eq. 6, 7).
    """
    force = np.reshape(force_factor(settings), (-1, 1)) * vector
    if settings.pressures:
        corner, weight = place_weights(x, places)
        still, at_rest = np.zeros(len(places)), np.zeros(len(x))
        return WindField(places, still, None, at_rest, corner, weight, force, tapped=True)
    if settings.file:
        return _measured_field(x, force, settings, places)
    y, up = along_wind(x, settings.direction), along_wind(vector, settings.direction)
    profile = lambda z: mean_speed(z + settings.base_height, settings.speed, settings.profile_exponent)
    mean, gust, model = profile(x[:, 2]), gust_of(settings), None
    if gust is None:
        points, corner, weight = plan_points(y, up.any(1), settings.control_points)[:3]
    elif settings.gusts == "points":
        points, corner, weight = _points(y, up, mean, settings)
        gusts = AtPoints(points, profile(points[:, 2]), settings.coherence_decay)
        model = fit_gust_model(gusts, gust, settings.time_step, settings.ar_order)
        correlation = model.covariance / model.covariance[0, 0]
        weight = weight / interpolated_deviation(corner, weight, correlation)[:, None]
    else:
        surface, points, corner, weight = _clusters(y, up, mean, settings)
        gusts = means_over(surface, corner, weight, len(points), settings.coherence_decay)
        model = fit_gust_model(gusts, gust, settings.time_step, settings.ar_order)
    points = along_wind(points, -settings.direction)  # back to the axes of the net
    return WindField(points, profile(points[:, 2]), model, mean, corner, weight, force)


def _points(y, vector, mean, settings) -> tuple:
    """Place the points of `points`: on a grid in plan unless the net rises too steeply for it."""
    loaded = vector.any(1) if vector.any() else np.ones(len(y), bool)
    *found, cell = plan_points(y, loaded, settings.control_points)
    if is_resolved(y[loaded], found[0], found[1][loaded], found[2][loaded], cell, settings.coherence_decay):
        return tuple(found)
    return _clusters(y, vector, mean, settings)[1:]


def _clusters(y, vector, mean, settings) -> tuple:
    """Return the loaded surface, points in the space that it fills, those near each node, their weights."""
    decay, limit = np.array(settings.coherence_decay), settings.control_points
    surface = surface_of(y, vector, mean, decay, limit)
    points = cluster_points(surface, decay, limit)
    return surface, points, *cluster_weights(y, points, decay)


def _measured_field(x, force, settings, places) -> WindField:
    """The field of a table, whose speeds the profile carries to each particle's height.

    From one speed at 10 m, or from several at their places (c, 3) [m].
    """
    rows = len(x)
    corner, weight = np.zeros((rows, 4), np.int64), np.zeros((rows, 4))
    profile = lambda z: mean_speed(z + settings.base_height, 1.0, settings.profile_exponent)
    if places is None:
        places = np.array([[*x[:, :2].mean(0), 10.0 - settings.base_height]])
        weight[:, 0] = profile(x[:, 2])
    else:
        corner, weight = place_weights(x, places)
        weight *= profile(x[:, 2])[:, None] / profile(places[:, 2])[corner]
    return WindField(places, np.zeros(len(places)), None, np.zeros(rows), corner, weight, force)


def interpolated_deviation(corner, weight, covariance) -> np.ndarray:
    """Standard deviation (n,) of what weights (n, 4) make of control points with a covariance (c, c)."""
    pairs = covariance[corner[:, :, None], corner[:, None, :]]
    return np.sqrt(np.sum(weight[:, :, None] * weight[:, None, :] * pairs, axis=(1, 2)))


@kernel
def particle_speeds(mean, corner, weight, gust, speed):
    """Total wind speed (n,) [m/s] of the particles from the gusts (c,) of the control points."""
    for p in range(mean.shape[0]):
        u = mean[p]
        for k in range(4):
            u += weight[p, k] * gust[corner[p, k]]
        speed[p] = u


def read_history(job) -> TableHistory | None:
    """The history of measured speeds or of pressures at taps, None: generated. Raises InputError."""
    wind = job.wind
    if wind is None or not (wind.file or wind.pressures):
        return None
    if wind.file:
        return read_measured(job)
    folder = job.path.parent
    return read_taps(folder / wind.taps, folder / wind.pressures, job.dynamics.duration)


class GeneratedHistory:
    """Gusts generated sample by sample, on rank 0."""

    def __init__(self, field: WindField, settings):
        self.dt = settings.time_step
        self.mean_gust = np.zeros(len(field.control_mean))  # m/s, over the duration: none
        self.recursion = GustRecursion(field.model, settings.seed) if field.model else None

    def sample(self, k: int) -> tuple[float, np.ndarray]:
        """Time [s] and gusts (c,) [m/s] of sample k; samples are asked for in order."""
        return k * self.dt, self.recursion.advance() if self.recursion else self.mean_gust

    def record(self) -> tuple[dict, dict]:
        """The state that a continuation needs, for `restore`: numbers and arrays."""
        return self.recursion.record() if self.recursion else ({}, {})

    def restore(self, numbers: dict, arrays: dict) -> None:
        """Take up the record of an earlier run."""
        if self.recursion:
            self.recursion.restore(numbers, arrays)
