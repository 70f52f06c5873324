"""Measured wind: tables of speeds or pressures over time, and their interpolation to particles.

One column `speed` is the speed at 10 m above ground everywhere. Several columns are speeds at the points and
heights of a second table. A particle uses the four nearest points in plan, weighted by distance; the
power-law profile converts each speed from its height to that of the particle.

Wind tunnel data are values over time at taps: pressures [N/m2] or coefficients, as the caller interprets
them; positive values press on the roof. The taps are in a table name, x, y, in the axes of the net; with
`[roof] normal` also z. The values are in a table with a column time and a column per tap, or in an HDF5 file
with `time` (t,) and `value` (t, c), columns in the order of the taps; 64 rows are in memory at a time. Times
are full-scale times of the roof, in s. A node uses the four nearest taps in plan, or in space if they have z,
weighted by distance (`point_weights`). Values are linear between times.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from netfall.core.arrays import FloatArray
from netfall.core.errors import InputError, raise_errors
from netfall.core.functions import integral, lengths
from netfall.core.messages import Message
from netfall.job.csv_table import MAX_CELL, Table
from netfall.job.job import Job
from netfall.loads import messages
from netfall.physics.wind_spectra import LOWEST_HEIGHT

BLOCK_ROWS = 64  # rows of a long file that are read at once
DISTANCE_TOLERANCE = 1e-3  # relative difference up to which distances count as equal
MAX_DISTANCES = 1 << 21  # largest number of distances in memory at once
COINCIDENCE_DISTANCE = 1e-3  # m: distance in plan below which points coincide


def point_weights(x: np.ndarray, places: np.ndarray, axes: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest points (n, 4) of each particle x (n, 3), and weights (n, 4) whose sum is 1.

    axes : 2: in plan, 3: in space

    Weights are ((R - d) / (R d))^2 at distance d, with R the distance of the fifth nearest point
    (Shepard 1968, Franke and Little), so the weight of a point is zero when another replaces it. A particle
    at a point has the value of the point. With fewer than five points the weights are 1 / d^2.
    """
    order, distance = nearest_points(x[:, :axes], places[:, :axes])
    d = np.maximum(distance, COINCIDENCE_DISTANCE)
    used = min(4, len(places))
    weight = 1.0 / d[:, :used]
    if len(places) > 4:
        weight = weight - 1.0 / d[:, 4:5]
    weight = np.where(weight.max(1, keepdims=True) > 0.0, weight, 1.0) ** 2  # five equal distances
    corner = np.zeros((len(x), 4), np.int64)
    weights = np.zeros((len(x), 4))
    corner[:, :used], weights[:, :used] = order[:, :used], weight / weight.sum(1, keepdims=True)
    return corner, weights


def ambiguous_particles(x: np.ndarray, places: np.ndarray, axes: int) -> np.ndarray:
    """Return rows of particles with five or more equally near points; arguments as in `point_weights`.

    For these, the order of the points, or rounding, determines which four are used.
    """
    distance = nearest_points(x[:, :axes], places[:, :axes])[1]
    return np.flatnonzero(
        distance[:, -1] <= (1.0 + DISTANCE_TOLERANCE) * distance[:, 0] if len(places) > 4 else []
    )


def nearest_points(
    x: np.ndarray, places: np.ndarray, tolerance: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest points, at most five, of points x (n, a), and their distances [m].

    tolerance : [m] within which points count as equally near as the fourth; the first of them are used
    """
    size, blocks = max(1, MAX_DISTANCES // len(places)), []
    for first in range(0, len(x), size):
        distance = lengths(x[first : first + size, None] - places)
        order = np.argsort(distance, axis=1, kind="stable")[:, :5]
        if tolerance and len(places) > 4:
            fourth, fifth = np.take_along_axis(distance, order[:, 3:], 1).T[..., None]
            tied = (np.abs(distance - fourth) <= tolerance) & (fifth - fourth <= tolerance)
            rows = tied.any(1)
            order[rows] = np.argsort(np.where(tied, fourth, distance)[rows], axis=1, kind="stable")[:, :5]
        blocks.append((order, np.take_along_axis(distance, order, 1)))
    order, distance = map(np.concatenate, zip(*blocks))
    return order, distance


class TableHistory:
    """Rows of a table over time, from time 0 on; one block is in memory at a time.

    places : (c, 2 or 3) [m], positions of its columns; None: one column everywhere; notes : on the tables
    mean_gust : (c,), the mean over the duration
    """

    def __init__(
        self,
        time: FloatArray,
        rows: Callable[[int, int], np.ndarray],
        mean_gust: FloatArray,
        places: FloatArray | None,
        notes: list[Any],
    ):
        """time : (t,) [s]; rows(first, end) : values (end - first, c) of these rows"""
        self.first = int(np.searchsorted(time, 0.0, side="right")) - 1
        self.time, self.mean_gust = time[self.first :], mean_gust
        self.places, self.notes = places, notes
        self._rows, self._begin = rows, -1
        self._block: Any = None

    def sample(self, k: int) -> tuple[float, np.ndarray]:
        """Return time [s] and values (c,) of row k; the last row applies to all later ones."""
        k = min(k, len(self.time) - 1)
        begin = k // BLOCK_ROWS * BLOCK_ROWS
        if begin != self._begin:
            end = min(begin + BLOCK_ROWS, len(self.time))
            self._begin, self._block = begin, self._rows(self.first + begin, self.first + end)
        return float(self.time[k]), self._block[k - begin]

    def until(self, end: float) -> tuple[np.ndarray, np.ndarray]:
        """Return times (k,) [s] and values (k, c) of the rows up to the first at or after a time [s]."""
        rows = int(np.searchsorted(self.time, end)) + 1
        return self.time[:rows], self._rows(self.first, self.first + rows)


def read_measured(job: Job) -> TableHistory:
    """Read the history of [wind] file, with columns time [s] and speed [m/s], or one per point.

    Raises InputError unless times ascend, start at or before 0, and reach the end of the simulated time.
    """
    names, places, duration = ["speed"], None, job.dynamics.duration
    notes: list[str] = []
    if job.wind.points:
        path = job.path.parent / job.wind.points
        names, places, notes = read_points(path, "xyz", messages.POINTS_ABOVE_ONE_ANOTHER)
        height = places[:, 2] + job.wind.base_height
        raise_errors(
            messages.POINT_TOO_LOW(
                path=path, name=name, height=z, base_height=job.wind.base_height, lowest=LOWEST_HEIGHT
            )
            for name, z in zip(names, height)
            if z < LOWEST_HEIGHT
        )
    table, time, speed = read_time_table(job.path.parent / job.wind.file, names, duration, "m/s", 0.0)
    times = np.unique(np.clip(time, 0.0, duration))
    course = (np.interp(times, time, column) for column in speed.T)
    mean = np.array([integral(values, times) / duration for values in course])
    return TableHistory(time, lambda first, end: speed[first:end], mean, places, notes + table.notes)


def read_time_table(
    path: Path, names: list[str], duration: float, unit: str, low: float = -MAX_CELL
) -> tuple[Table, FloatArray, FloatArray]:
    """Read a table, its column time (t,) [s] and columns `names` (t, c) with numbers >= `low`.

    Raises InputError unless times ascend from at or before 0 to a duration [s], and each cell has a number.
    """
    table = Table(path, ("time", *names), ("time", *names))
    time = table.numbers("time", unit="s")
    values = table.stacked(names, low=low, unit=unit)
    table.finish()
    table.ascending("time", time)
    table.check_no_gaps(time, values)
    _check_coverage(path, time, duration)
    return table, time, values


def read_points(
    path: Path, axes: str, coincident: Message, dimensions: int = 2
) -> tuple[list[str], np.ndarray, list[str]]:
    """Read names, lower-case as in headers, positions (c, 2 or 3) [m] and notes of a table of points.

    axes : required columns; coincident : error for two points that coincide in these dimensions

    Raises InputError for points without a unique name, or that coincide in these dimensions.
    """
    table = Table(path, ("name", "x", "y", "z"), ("name", *axes))
    names = [name.lower() for name in table.words("name")]
    places = table.stacked(axes, unit="m")
    for row, name in enumerate(names):
        place, shown = table.at(row), name[:40]
        if not name or name == "time" or name in names[:row]:
            table.wrong(messages.POINT_NAME(row=place, name=shown))
        apart = lengths((places[:row] - places[row])[:, :dimensions])
        close = apart < COINCIDENCE_DISTANCE  # a particle would have the mean
        if close.any():
            table.wrong(coincident(row=place, name=shown, other=names[int(close.argmax())]))
    table.check_no_gaps(places)
    return names, places, table.notes


def read_taps(taps: Path, values: Path, duration: float, axes: str = "xy") -> TableHistory:
    """Read the history of two files, over at least a duration [s]; axes : of the taps. Raises InputError."""
    names, places, notes = read_points(taps, axes, messages.TAPS_ABOVE_ONE_ANOTHER, len(axes))
    if values.suffix in (".h5", ".hdf5"):
        time, rows = _long_file(values, len(names))
        _check_coverage(values, time, duration)
    else:
        table, time, value = read_time_table(values, names, duration, "N/m2")
        notes = notes + table.notes

        def rows(first: int, end: int) -> FloatArray:
            return value[first:end]

    return TableHistory(time, rows, _mean(time, rows, duration), places, notes)


def _mean(time: np.ndarray, rows: Callable[..., Any], duration: float) -> np.ndarray:
    """Compute mean values (c,) over the duration [s], linear between rows; arguments of `TableHistory`."""
    begin, end = np.clip(time[:-1], 0.0, duration), np.clip(time[1:], 0.0, duration)
    second = (end - begin) * (0.5 * (begin + end) - time[:-1]) / np.diff(time)
    share = np.zeros(len(time))
    share[:-1] += end - begin - second
    share[1:] += second
    share, blocks = share / duration, range(0, len(time), BLOCK_ROWS)
    return sum(
        np.add.reduce(share[i : i + BLOCK_ROWS, None] * rows(i, i + BLOCK_ROWS), axis=0) for i in blocks
    )


def _long_file(path: Path, count: int) -> tuple[FloatArray, Callable[..., Any]]:
    """Open an HDF5 file; return its times (t,) [s] and a function that reads rows. Raises InputError."""
    try:
        file = h5py.File(path)
        time, value = file["time"][:], file["value"]
        shape = value.shape
        if not {time.dtype.kind, value.dtype.kind} <= {*"fiu"}:
            raise TypeError(f"time holds {time.dtype} and value {value.dtype}, which are not real numbers")
    except (OSError, KeyError, AttributeError, ValueError, TypeError) as error:
        raise InputError(messages.NOT_HDF5(path=path, error=error)) from None
    if time.ndim != 1 or not len(time) or shape != (len(time), count):
        raise InputError(messages.HDF5_SHAPES(path=path, time=time.shape, value=shape, count=count))

    def rows(first: int, end: int) -> FloatArray:
        return value[first:end].astype(float)

    for first in range(0, len(time), BLOCK_ROWS):
        invalid = ~(np.abs(rows(first, first + BLOCK_ROWS)) <= MAX_CELL).all(1)
        if invalid.any():
            k = first + int(invalid.argmax())
            raise InputError(messages.HDF5_VALUE(path=path, row=k, largest=MAX_CELL))
    time = time.astype(float)
    for k in np.flatnonzero(~(np.diff(time) > 0))[:1]:
        raise InputError(messages.TIMES_NOT_ASCENDING(path=path, time=time[k + 1], before=time[k]))
    return time, rows


def _check_coverage(path: Path, time: np.ndarray, duration: float) -> None:
    """Check that ascending times cover the duration [s]. Raises InputError."""
    if not (time[0] <= 0 and time[-1] >= duration):
        raise InputError(
            messages.TIMES_NOT_COVERED(path=path, first=time[0], last=time[-1], duration=duration)
        )
