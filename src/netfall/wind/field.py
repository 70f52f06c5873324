"""The wind on a roof: control points, histories in time, the force on the particles (paper 3, Eq. 5 to 7).

Histories exist at a few control points only, a grid over the roof in plan, along the wind and across it; a
particle's gust is interpolated between the four around it. Interpolation between partly correlated points
would weaken the gust, so its weights are scaled to keep the variance, and gusts of neighbours are more alike
than their coherence makes them. Means over the roof around each point (`means`) are interpolated as they are.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from netfall.ground.compile import kernel
from netfall.wind.autoregressive import AtPoints, GustModel, GustRecursion, OverAreas, fit_gust_model
from netfall.wind.coherence import along_wind, mean_speed
from netfall.wind.means import alike
from netfall.wind.measured import TableHistory, place_weights, read_measured
from netfall.wind.spectra import gust_of
from netfall.wind.taps import read_taps

CLOSEST = 2.0  # m between control points, at the least
AS_NEAR = 1e-5  # of the size in plan: nodes that much farther from a control point count as the nearest


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


def control_grid(x: np.ndarray, limit: int) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates along x and y of a grid of at most `limit` control points over the plan of x (n, 3)."""
    low, extent = x[:, :2].min(0), np.ptp(x[:, :2], axis=0)
    most = 1 + np.floor(extent / CLOSEST).astype(int)
    ratio = (extent[0] + 1e-9) / (extent[1] + 1e-9)
    nx = int(np.clip(round(np.sqrt(limit * ratio)), 1, min(limit, most[0])))
    ny = int(np.clip(limit // nx, 1, most[1]))
    line = lambda k, count: low[k] + extent[k] * (np.linspace(0, 1, count) if count > 1 else np.array([0.5]))
    return line(0, nx), line(1, ny)


def control_heights(plan: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Heights z (c,) [m] of control points, in plan (c, 2), over the nodes x (n, 3) that the wind acts on.

    That of the nearest; of several as near the middle between highest and lowest. So the order of the nodes
    does not matter, and a roof that is mirrored has mirrored points.
    """
    slack = AS_NEAR * np.ptp(x[:, :2], axis=0).max()

    def height(place):
        away = np.sqrt(np.sum((x[:, :2] - place) ** 2, axis=1))
        z = x[away <= away.min() + slack, 2]
        return 0.5 * (z.min() + z.max())

    return np.array([height(place) for place in plan])


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
    y = along_wind(x, settings.direction)
    gx, gy = control_grid(y, settings.control_points)
    X, Y = np.meshgrid(gx, gy, indexing="ij")
    plan = np.column_stack([X.ravel(), Y.ravel()])
    points = np.column_stack([plan, control_heights(plan, y[vector.any(1)] if vector.any() else y)])
    profile = lambda z: mean_speed(z + settings.base_height, settings.speed, settings.profile_exponent)
    corner, weight = _bilinear(y, gx, gy)
    gust, model = gust_of(settings), None
    if gust:
        mean, s = profile(points[:, 2]), settings
        at_points = s.gusts == "points"
        gusts = AtPoints(points, mean, s.coherence_decay) if at_points else _over_areas(y, mean, s)
        model = fit_gust_model(gusts, gust, s.time_step, s.ar_order)
        if at_points:
            correlation = model.covariance / model.covariance[0, 0]
            weight = weight / interpolated_deviation(corner, weight, correlation)[:, None]
    points = along_wind(points, -settings.direction)  # back to the axes of the net
    return WindField(points, profile(points[:, 2]), model, profile(x[:, 2]), corner, weight, force)


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


def _over_areas(y, mean, settings) -> OverAreas:
    """The means over the roof of nodes y (n, 3), in axes of the wind, around control points of means (c,)."""
    lines, low, extent = control_grid(y, settings.control_points), y.min(0), np.ptp(y, axis=0)
    along, across = (alike(line, low[k], extent[k]) for k, line in enumerate(lines))
    return OverAreas(along, across, float(mean.mean()), settings.coherence_decay)


def load_power(x: np.ndarray, field: WindField, settings, n: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Power (w,) of the load on all nodes x (n, 3) over what the coherence makes of it; of gusts at points.

    n : (f,) [Hz] frequencies; weight : (w, f), of each of them in a sum
    """
    y, points = (along_wind(place, settings.direction) for place in (x, field.control_point))
    each = np.sqrt(np.sum(field.force**2, axis=1)) * field.mean
    plain = field.weight / field.weight.sum(1)[:, None]

    def power(gusts, weights):
        load = np.bincount(field.corner.ravel(), (each[:, None] * weights).ravel(), len(points))
        return load @ gusts.covariances(n, weight) @ load

    at_points = AtPoints(points, field.control_mean, settings.coherence_decay)
    return power(at_points, field.weight) / power(_over_areas(y, field.control_mean, settings), plain)


def interpolated_deviation(corner, weight, covariance) -> np.ndarray:
    """Standard deviation (n,) of what weights (n, 4) make of control points with a covariance (c, c)."""
    pairs = covariance[corner[:, :, None], corner[:, None, :]]
    return np.sqrt(np.sum(weight[:, :, None] * weight[:, None, :] * pairs, axis=(1, 2)))


def _bilinear(x, gx, gy):
    """Control points (n, 4) around each particle in plan, and their weights."""

    def along(values, grid):
        if len(grid) == 1:
            return np.zeros(len(values), np.int64), np.zeros(len(values), np.int64), np.zeros(len(values))
        i = np.clip(np.searchsorted(grid, values, side="right") - 1, 0, len(grid) - 2)
        return i, i + 1, np.clip((values - grid[i]) / (grid[i + 1] - grid[i]), 0.0, 1.0)

    i0, i1, s = along(x[:, 0], gx)
    j0, j1, t = along(x[:, 1], gy)
    ny = len(gy)
    corner = np.stack([i0 * ny + j0, i0 * ny + j1, i1 * ny + j0, i1 * ny + j1], -1)
    return corner, np.stack([(1 - s) * (1 - t), (1 - s) * t, s * (1 - t), s * t], -1)


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
