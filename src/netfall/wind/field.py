"""The wind on a roof: control points, histories in time, the force on the particles (paper 3, Eq. 5 to 7).

Histories exist at a few control points only, a grid over the roof in plan; a particle's gust is interpolated
between the four around it. Interpolation between partly correlated points would weaken the gust, so its
weights are scaled to keep the variance.
"""

from dataclasses import dataclass

import numpy as np

from netfall.compile import kernel
from netfall.job.table import Table
from netfall.wind.autoregressive import GustModel, GustRecursion, fit_gust_model
from netfall.wind.davenport import mean_speed

CLOSEST = 2.0  # m between control points, at the least


@dataclass(frozen=True)
class WindField:
    """What the wind needs for each particle; all of it computed on rank 0, once.

    control_point : (c, 3) [m]; control_mean : (c,) [m/s]; model : of the gusts, None without gusts
    mean : (n,) [m/s]; corner : (n, 4) control points around; weight : (n, 4)
    force : (n, 3) [N s2/m2] on each particle at 1 m/s
    """

    control_point: np.ndarray
    control_mean: np.ndarray
    model: GustModel | None
    mean: np.ndarray
    corner: np.ndarray
    weight: np.ndarray
    force: np.ndarray

    def mean_force(self, mean_gust: np.ndarray) -> np.ndarray:
        """Force (n, 3) [N] of the mean wind; mean_gust : (c,) [m/s], what the history's mean adds to it."""
        speed = np.empty(len(self.mean))
        particle_speeds(self.mean, self.corner, self.weight, mean_gust, speed)
        return self.force * (speed * speed)[:, None]


def control_grid(x: np.ndarray, limit: int) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates along x and y of a grid of at most `limit` control points over the plan of x (n, 3)."""
    low, extent = x[:, :2].min(0), np.ptp(x[:, :2], axis=0)
    most = 1 + np.floor(extent / CLOSEST).astype(int)
    ratio = (extent[0] + 1e-9) / (extent[1] + 1e-9)
    nx = int(np.clip(round(np.sqrt(limit * ratio)), 1, min(limit, most[0])))
    ny = int(np.clip(limit // nx, 1, most[1]))
    line = lambda k, count: low[k] + extent[k] * (np.linspace(0, 1, count) if count > 1 else np.array([0.5]))
    return line(0, nx), line(1, ny)


def make_wind_field(x: np.ndarray, area: np.ndarray, normal: np.ndarray, settings) -> WindField:
    """The field for a roof at its start: x (n, 3) [m], tributary area (n,) [m2], upward normals (n, 3).

    The force at speed U is -u_s A rho U^2 / 2 along the upward normal: suction (u_s < 0) lifts (Eq. 6, 7).
    """
    height = x[:, 2] + settings.base_height
    force = (-settings.shape_coefficient * 0.5 * settings.air_density * area)[:, None] * normal
    if settings.file:  # one measured speed at 10 m, which the profile carries to each particle's height
        place = np.array([[*x[:, :2].mean(0), 10.0 - settings.base_height]])
        weight = np.zeros((len(x), 4))
        weight[:, 0] = mean_speed(height, 1.0, settings.profile_exponent)
        return WindField(
            place, np.zeros(1), None, np.zeros(len(x)), np.zeros((len(x), 4), np.int64), weight, force
        )
    gx, gy = control_grid(x, settings.control_points)
    X, Y = np.meshgrid(gx, gy, indexing="ij")
    plan = np.column_stack([X.ravel(), Y.ravel()])
    nearest = np.array([np.argmin(np.sum((x[:, :2] - p) ** 2, axis=1)) for p in plan])
    points = np.column_stack([plan, x[nearest, 2]])
    mean = mean_speed(points[:, 2] + settings.base_height, settings.speed, settings.profile_exponent)
    model = None
    corner, weight = _bilinear(x, gx, gy)
    if settings.roughness > 0:
        model = fit_gust_model(
            points,
            mean,
            settings.speed,
            settings.roughness,
            settings.coherence_decay,
            settings.time_step,
            settings.ar_order,
        )
        correlation = model.covariance / model.covariance[0, 0]
        spread = np.sum(
            weight[:, :, None] * weight[:, None, :] * correlation[corner[:, :, None], corner[:, None, :]],
            axis=(1, 2),
        )
        weight = weight / np.sqrt(spread)[:, None]
    return WindField(
        points,
        mean,
        model,
        mean_speed(height, settings.speed, settings.profile_exponent),
        corner,
        weight,
        force,
    )


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


class GeneratedHistory:
    """Gusts generated sample by sample, on rank 0."""

    def __init__(self, field: WindField, settings):
        self.dt = settings.time_step
        self.mean_gust = np.zeros(len(field.control_mean))  # m/s, over the duration: none
        self.recursion = (
            GustRecursion(field.model, settings.seed, settings.speed, self.dt) if field.model else None
        )

    def sample(self, k: int) -> tuple[float, np.ndarray]:
        """Time [s] and gusts (c,) [m/s] of sample k; samples are asked for in order."""
        return k * self.dt, self.recursion.advance() if self.recursion else self.mean_gust

    def record(self) -> tuple[dict, dict]:
        """The state that a continuation needs, for `restore`: numbers and arrays."""
        if not self.recursion:
            return {}, {}
        kept = self.recursion.record()
        return {"step": kept["step"]}, {"past": kept["past"]}

    def restore(self, numbers: dict, arrays: dict) -> None:
        """Take up the record of an earlier run."""
        if self.recursion:
            self.recursion.restore(numbers | arrays)


class MeasuredHistory:
    """A table of times (t,) [s] and speeds (t,) [m/s] at 10 m, from time 0 on."""

    def __init__(self, time: np.ndarray, speed: np.ndarray, duration: float):
        """duration : [s], over which `mean_gust` (1,) [m/s] is the mean"""
        self.notes: list[str] = []
        first = int(np.searchsorted(time, 0.0, side="right")) - 1
        self.time, self.speed = time[first:], speed[first:]
        within = np.unique(np.clip(time, 0.0, duration))
        self.mean_gust = np.array([np.trapezoid(np.interp(within, time, speed), within) / duration])

    def sample(self, k: int) -> tuple[float, np.ndarray]:
        """Time [s] and speed (1,) [m/s] of row k; the last one stands for all that follow."""
        k = min(k, len(self.time) - 1)
        return float(self.time[k]), self.speed[k : k + 1]

    def record(self) -> tuple[dict, dict]:
        """Nothing: a row depends on its number alone."""
        return {}, {}

    def restore(self, numbers: dict, arrays: dict) -> None:
        """Nothing to take up."""


def read_measured(job) -> MeasuredHistory:
    """The history of [wind] file, a table with columns time [s] and speed [m/s].

    Raises InputError unless times ascend from 0 or before to the end of the simulated time.
    """
    table = Table(job.path.parent / job.wind.file, ("time", "speed"), ("time", "speed"))
    time, speed = table.numbers("time", unit="s"), table.numbers("speed", low=0.0, unit="m/s")
    table.finish()
    for row in np.flatnonzero(np.diff(time) <= 0)[:3]:
        table.wrong(
            f"{table.at(row + 1)}: time = {time[row + 1]:g}: not after the row before ({time[row]:g}); "
            "expected ascending times"
        )
    if np.isnan(time).any() or np.isnan(speed).any():
        table.wrong("empty cells; expected a number in each")
    elif time[0] > 0 or time[-1] < job.dynamics.duration:
        table.wrong(
            f"covers {time[0]:g} to {time[-1]:g} s; expected 0 to duration = {job.dynamics.duration:g} s"
        )
    table.finish()
    history = MeasuredHistory(time, speed, job.dynamics.duration)
    history.notes = table.notes
    return history
