"""Measured wind: a table of speeds at one point or at several, and what of it reaches a particle.

One column, `speed`, is the speed at 10 m above ground everywhere. Several columns belong to the points of a
second table, each the speed at that place and height; a particle takes those of the four nearest points in
plan, weighted by distance, and the power-law profile carries each from its own height to the particle's.

Pressures of a wind tunnel: values in time at taps, and what of them reaches a node.

The values are pressures [N/m2] or coefficients, as the caller takes them; positive presses on the roof. The
taps stand in a table name, x, y, in the axes of the net; the values in a table with the columns time and one
for each tap by name, or in an HDF5 file with `time` (t,) and `value` (t, c), columns in the order of the
taps, of which 64 rows are held at a time. Times are those of the roof, in s. A node takes the values of the
four nearest taps in plan, weighted by distance (`place_weights`); between times values are linear.
"""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from netfall.ground.errors import InputError
from netfall.job.table import LARGEST, Table
from netfall.numerics.functions import integral, lengths
from netfall.wind.coherence import LOWEST_HEIGHT

ROWS = 64  # of a long file that are read at once
LEVEL = 1e-3  # share of a distance by which others count as the same
MOST_PAIRS = 1 << 21  # of particles and places whose distances are held at once
TOGETHER = 1e-3  # m in plan; points as close are one place


def place_weights(x: np.ndarray, places: np.ndarray, axes: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """The nearest places (n, 4) of each particle x (n, 3), and their weights (n, 4), whose sum is 1.

    axes : 2: in plan, 3: in space

    Weights ((R - d) / (R d))^2 at distance d, R that of the fifth nearest (Shepard 1968, Franke and Little):
    a place fades out before another takes its turn. At a place its own speed; with less than five, 1 / d^2.
    """
    order, apart = nearest_places(x[:, :axes], places[:, :axes])
    d = np.maximum(apart, TOGETHER)
    few = min(4, len(places))
    weight = 1.0 / d[:, :few]
    if len(places) > 4:
        weight = weight - 1.0 / d[:, 4:5]
    weight = np.where(weight.max(1, keepdims=True) > 0.0, weight, 1.0) ** 2  # five at one distance
    corner = np.zeros((len(x), 4), np.int64)
    weights = np.zeros((len(x), 4))
    corner[:, :few], weights[:, :few] = order[:, :few], weight / weight.sum(1, keepdims=True)
    return corner, weights


def between_places(x: np.ndarray, places: np.ndarray, axes: int = 2) -> np.ndarray:
    """Rows of particles as far from five places or more as from the nearest; arguments of `place_weights`.

    There the order of the places, or rounding, decides which four of them count.
    """
    apart = nearest_places(x[:, :axes], places[:, :axes])[1]
    return np.flatnonzero(apart[:, -1] <= (1.0 + LEVEL) * apart[:, 0] if len(places) > 4 else [])


def nearest_places(x: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The five nearest places (n, 5) of points x (n, a), of those there are, and how far off they are [m]."""
    block, found = max(1, MOST_PAIRS // len(places)), []
    for first in range(0, len(x), block):
        apart = lengths(x[first : first + block, None] - places)
        order = np.argsort(apart, axis=1, kind="stable")[:, :5]
        found.append((order, np.take_along_axis(apart, order, 1)))
    return tuple(map(np.concatenate, zip(*found)))


class TableHistory:
    """Rows of a table in time, from time 0 on, of which some are held at a time.

    places : (c, 2 or 3) [m], where its columns belong; None: one column everywhere; notes : on the tables
    mean_gust : (c,), the mean over the duration
    """

    def __init__(self, time, rows: Callable[[int, int], np.ndarray], mean_gust, places, notes):
        """time : (t,) [s]; rows(first, end) : values (end - first, c) of these rows"""
        self.first = int(np.searchsorted(time, 0.0, side="right")) - 1
        self.time, self.mean_gust = time[self.first :], mean_gust
        self.places, self.notes = places, notes
        self._rows, self._begin, self._block = rows, -1, None

    def sample(self, k: int) -> tuple[float, np.ndarray]:
        """Time [s] and values (c,) of row k; the last one stands for all that follow."""
        k = min(k, len(self.time) - 1)
        begin = k // ROWS * ROWS
        if begin != self._begin:
            end = min(begin + ROWS, len(self.time))
            self._begin, self._block = begin, self._rows(self.first + begin, self.first + end)
        return float(self.time[k]), self._block[k - begin]

    def until(self, end: float) -> tuple[np.ndarray, np.ndarray]:
        """Times (k,) [s] and values (k, c) of the rows up to the first at or after a time [s]."""
        rows = int(np.searchsorted(self.time, end)) + 1
        return self.time[:rows], self._rows(self.first, self.first + rows)

    def record(self) -> tuple[dict, dict]:
        """Nothing: a row depends on its number alone."""
        return {}, {}

    def restore(self, numbers: dict, arrays: dict) -> None:
        """Nothing to take up."""


def read_measured(job) -> TableHistory:
    """The history of [wind] file, a table with columns time [s] and speed [m/s], or one for each of points.

    Raises InputError unless times ascend from 0 or before to the end of the simulated time.
    """
    names, places, notes, duration = ["speed"], None, [], job.dynamics.duration
    if job.wind.points:
        one, path = "one height at each place, the profile does the rest", job.path.parent / job.wind.points
        names, places, notes = read_places(path, "xyz", one)
        height = places[:, 2] + job.wind.base_height
        if (height < LOWEST_HEIGHT).any():
            raise InputError(
                f"{path}: name = {name!r}: {z:g} m above ground (z + base_height = "
                f"{job.wind.base_height:g}); expected at least {LOWEST_HEIGHT:g} m"
                for name, z in zip(names, height)
                if z < LOWEST_HEIGHT
            )
    table, time, speed = read_rows(job.path.parent / job.wind.file, names, duration, 0.0, "m/s")
    within = np.unique(np.clip(time, 0.0, duration))
    course = (np.interp(within, time, column) for column in speed.T)
    mean = np.array([integral(values, within) / duration for values in course])
    return TableHistory(time, lambda first, end: speed[first:end], mean, places, notes + table.notes)


def read_rows(path: Path, names: list[str], duration: float, low: float = -LARGEST, unit: str = ""):
    """A table, its column time (t,) [s] and those of some names (t, c), numbers from `low` on.

    Raises InputError unless times ascend from 0 or before to a duration [s], and each cell has its number.
    """
    table = Table(path, ("time", *names), ("time", *names))
    time = table.numbers("time", unit="s")
    values = table.stacked(names, low=low, unit=unit)
    table.finish()
    table.ascending("time", time)
    table.no_gaps(time, values)
    if time[0] > 0 or time[-1] < duration:
        table.wrong(f"covers {time[0]:g} to {time[-1]:g} s; expected 0 to duration = {duration:g} s")
    table.finish()
    return table, time, values


def read_places(path: Path, axes: str, expected: str) -> tuple[list[str], np.ndarray, list[str]]:
    """Names (as headers are read: in small letters), places (c, 2 or 3) [m] and notes of a table of places.

    axes : that it must have; expected : in place of two places above one another

    Raises InputError for places without a name of their own, or above one another.
    """
    table = Table(path, ("name", "x", "y", "z"), ("name", *axes))
    names = [name.lower() for name in table.words("name")]
    places = table.stacked(axes, unit="m")
    for row, name in enumerate(names):
        place = f"{table.at(row)}: name = {name[:40]!r}"
        if not name or name == "time" or name in names[:row]:
            table.wrong(f"{place}: expected a name of its own, that of a column of values")
        near = lengths(places[:row, :2] - places[row, :2]) < TOGETHER  # a particle would take the mean
        if near.any():
            table.wrong(f"{place}: at the same x, y as {names[int(near.argmax())]!r}; expected {expected}")
    table.no_gaps(places)
    return names, places, table.notes


def read_taps(taps: Path, values: Path, duration: float) -> TableHistory:
    """The history of two files, over at least a duration [s]. Raises InputError."""
    one = "one tap at each place, with what presses and what lifts there added"
    names, places, notes = read_places(taps, "xy", one)
    if values.suffix in (".h5", ".hdf5"):
        time, rows = _long_file(values, len(names))
        _check_times(values, time, duration)
    else:
        table, time, value = read_rows(values, names, duration)
        rows, notes = (lambda first, end: value[first:end]), notes + table.notes
    return TableHistory(time, rows, _mean(time, rows, duration), places, notes)


def _mean(time: np.ndarray, rows, duration: float) -> np.ndarray:
    """Mean values (c,), linear between rows, over the duration [s]; time, rows : as in `TableHistory`."""
    begin, end = np.clip(time[:-1], 0.0, duration), np.clip(time[1:], 0.0, duration)
    second = (end - begin) * (0.5 * (begin + end) - time[:-1]) / np.diff(time)
    share = np.zeros(len(time))
    share[:-1] += end - begin - second
    share[1:] += second
    share, blocks = share / duration, range(0, len(time), ROWS)
    return sum(np.add.reduce(share[i : i + ROWS, None] * rows(i, i + ROWS), axis=0) for i in blocks)


def _long_file(path: Path, count: int):
    try:
        file = h5py.File(path)
        time, value = file["time"][:], file["value"]
        shape = value.shape
    except (OSError, KeyError, AttributeError, ValueError) as error:
        raise InputError(f"{path}: {error}; expected HDF5 with datasets time (t,) and value (t, c)") from None
    if time.ndim != 1 or not len(time) or shape != (len(time), count):
        raise InputError(
            f"{path}: time has the shape {time.shape} and value {shape}; expected (t,) and (t, {count}), "
            f"a column for each of the {count} taps"
        )
    rows = lambda first, end: value[first:end].astype(float)
    for first in range(0, len(time), ROWS):
        bad = ~(np.abs(rows(first, first + ROWS)) <= LARGEST).all(1)
        if bad.any():
            k = first + int(bad.argmax())
            raise InputError(
                f"{path}: value: row {k} has what is no number up to {LARGEST:g}; expected one in each"
            )
    return time.astype(float), rows


def _check_times(path: Path, time: np.ndarray, duration: float) -> None:
    for k in np.flatnonzero(~(np.diff(time) > 0))[:1]:
        what = f"time = {time[k + 1]:g} is not after the row before ({time[k]:g})"
        raise InputError(f"{path}: {what}; expected ascending times")
    if not (time[0] <= 0 and time[-1] >= duration):
        covered = f"covers {time[0]:g} to {time[-1]:g} s"
        raise InputError(f"{path}: {covered}; expected 0 to duration = {duration:g} s")
