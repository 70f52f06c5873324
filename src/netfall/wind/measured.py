"""Measured wind: a table of speeds at one point or at several, and what of it reaches a particle.

One column, `speed`, is the speed at 10 m above ground everywhere. Several columns belong to the points of a
second table, each the speed at that place and height; a particle takes those of the four nearest points in
plan, weighted by distance, and the power-law profile carries each from its own height to the particle's.
"""

import numpy as np

from netfall.ground.errors import InputError
from netfall.job.table import Table
from netfall.numerics.functions import lengths
from netfall.wind.coherence import LOWEST_HEIGHT

TOGETHER = 1e-3  # m in plan; points as close are one place


def place_weights(x: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest places (n, 4) of each particle x (n, 3) in plan, and their weights (n, 4), whose sum is 1.

    Weights ((R - d) / (R d))^2 at distance d, R that of the fifth nearest (Shepard 1968, Franke and Little):
    a place fades out before another takes its turn. At a place its own speed; with less than five, 1 / d^2.
    """
    apart = lengths(x[:, None, :2] - places[:, :2])
    order = np.argsort(apart, axis=1, kind="stable")[:, :5]
    d = np.maximum(np.take_along_axis(apart, order, 1), TOGETHER)
    few = min(4, len(places))
    weight = 1.0 / d[:, :few]
    if len(places) > 4:
        weight = weight - 1.0 / d[:, 4:5]
    weight = np.where(weight.max(1, keepdims=True) > 0.0, weight, 1.0) ** 2  # five at one distance
    corner = np.zeros((len(x), 4), np.int64)
    weights = np.zeros((len(x), 4))
    corner[:, :few], weights[:, :few] = order[:, :few], weight / weight.sum(1, keepdims=True)
    return corner, weights


class MeasuredHistory:
    """A table of times (t,) [s] and speeds (t, c) [m/s], from time 0 on.

    places : (c, 3) [m], where they were measured; None: one speed at 10 m
    """

    def __init__(self, time: np.ndarray, speed: np.ndarray, places: np.ndarray | None, duration: float):
        """duration : [s], over which `mean_gust` (c,) [m/s] is the mean"""
        first = int(np.searchsorted(time, 0.0, side="right")) - 1
        self.time, self.speed = time[first:], speed[first:]
        self.places, self.notes = places, []
        within = np.unique(np.clip(time, 0.0, duration))
        course = (np.interp(within, time, column) for column in speed.T)
        self.mean_gust = np.array([np.trapezoid(values, within) / duration for values in course])

    def sample(self, k: int) -> tuple[float, np.ndarray]:
        """Time [s] and speeds (c,) [m/s] of row k; the last one stands for all that follow."""
        k = min(k, len(self.time) - 1)
        return float(self.time[k]), self.speed[k]

    def record(self) -> tuple[dict, dict]:
        """Nothing: a row depends on its number alone."""
        return {}, {}

    def restore(self, numbers: dict, arrays: dict) -> None:
        """Nothing to take up."""


def read_measured(job) -> MeasuredHistory:
    """The history of [wind] file, a table with columns time [s] and speed [m/s], or one for each of points.

    Raises InputError unless times ascend from 0 or before to the end of the simulated time.
    """
    names, places, notes = ["speed"], None, []
    if job.wind.points:
        names, places, notes = read_places(job.path.parent / job.wind.points)
        _check_heights(job, names, places)
    table = Table(job.path.parent / job.wind.file, ("time", *names), ("time", *names))
    time = table.numbers("time", unit="s")
    speed = np.column_stack([table.numbers(name, low=0.0, unit="m/s") for name in names])
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
    history = MeasuredHistory(time, speed, places, job.dynamics.duration)
    history.notes = notes + table.notes
    return history


def read_places(path) -> tuple[list[str], np.ndarray, list[str]]:
    """Names (as headers are read: in small letters), places (c, 3) [m] and notes of a table name, x, y, z.

    Raises InputError for points without a name of their own, or above one another.
    """
    table = Table(path, ("name", "x", "y", "z"), ("name", "x", "y", "z"))
    names = [name.lower() for name in table.words("name")]
    places = np.column_stack([table.numbers(axis, unit="m") for axis in "xyz"])
    for row, name in enumerate(names):
        if not name or name == "time" or name in names[:row]:
            table.wrong(
                f"{table.at(row)}: name = {name[:40]!r}: expected a name of its own, the column's in file"
            )
    if np.isnan(places).any():
        table.wrong("empty cells; expected a number in each")
    check_apart(table, names, places, "one height at each place, the profile does the rest")
    table.finish()
    return names, places, table.notes


def check_apart(table: Table, names: list[str], places: np.ndarray, expected: str) -> None:
    """Places (c, 2 or 3) [m] must differ in plan: of two at one place a particle would take the mean."""
    for row in range(len(places)):
        near = lengths(places[:row, :2] - places[row, :2]) < TOGETHER
        if near.any():
            table.wrong(
                f"{table.at(row)}: name = {names[row]!r}: at the same x, y as {names[int(near.argmax())]!r}; "
                f"expected {expected}"
            )


def _check_heights(job, names: list[str], places: np.ndarray) -> None:
    height = places[:, 2] + job.wind.base_height
    low = np.flatnonzero(height < LOWEST_HEIGHT)
    if len(low):
        raise InputError(
            [
                f"{job.path.parent / job.wind.points}: name = {names[k]!r}: {height[k]:g} m above ground "
                f"(z + base_height = {job.wind.base_height:g}); expected at least {LOWEST_HEIGHT:g} m"
                for k in low
            ]
        )
