"""Pressures of a wind tunnel: values in time at taps, and what of them reaches a node.

The values are pressures [N/m2] or coefficients, as the caller takes them; positive presses on the roof. The
taps stand in a table name, x, y, in the axes of the net; the values in a table with the columns time and one
for each tap by name, or in an HDF5 file with `time` (t,) and `value` (t, c), columns in the order of the
taps, of which 64 rows are held at a time. Times are those of the roof, in s. A node takes the values of the
four nearest taps in plan, weighted by distance (`measured.place_weights`); between times values are linear.
"""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from netfall.ground.errors import InputError
from netfall.job.table import LARGEST, Table
from netfall.wind.measured import check_apart, place_weights

ROWS = 64  # of a long file that are read at once


class TapHistory:
    """Values at taps in time, from time 0 on; samples as `measured.MeasuredHistory` gives them.

    places : (c, 2) [m], x and y of the taps; notes : on the tables
    mean_gust : (c,), the mean over the duration
    """

    def __init__(self, time, rows: Callable[[int, int], np.ndarray], places, notes, duration: float):
        """time : (t,) [s]; rows(first, end) : values (end - first, c) of these rows; duration : [s]"""
        self.first = int(np.searchsorted(time, 0.0, side="right")) - 1
        self.time, self.places, self.notes = time[self.first :], places, notes
        self._rows, self._begin, self._block = rows, -1, None
        share = _shares(time, duration)
        blocks = range(0, len(time), ROWS)
        sums = (np.add.reduce(share[i : i + ROWS, None] * rows(i, i + ROWS), axis=0) for i in blocks)
        self.mean_gust = sum(sums)

    def sample(self, k: int) -> tuple[float, np.ndarray]:
        """Time [s] and values (c,) of row k; the last one stands for all that follow."""
        k = min(k, len(self.time) - 1)
        begin = k // ROWS * ROWS
        if begin != self._begin:
            end = min(begin + ROWS, len(self.time))
            self._begin, self._block = begin, self._rows(self.first + begin, self.first + end)
        return float(self.time[k]), self._block[k - begin]

    def weights(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Taps (n, 4) that reach each node x (n, 3) [m], and their weights (n, 4), whose sum is 1."""
        return place_weights(x, self.places)

    def record(self) -> tuple[dict, dict]:
        """Nothing: a row depends on its number alone."""
        return {}, {}

    def restore(self, numbers: dict, arrays: dict) -> None:
        """Nothing to take up."""


def _shares(time: np.ndarray, duration: float) -> np.ndarray:
    """Weights (t,) of the rows in the mean from 0 to a duration [s], linear between them."""
    begin, end = np.clip(time[:-1], 0.0, duration), np.clip(time[1:], 0.0, duration)
    second = (end - begin) * (0.5 * (begin + end) - time[:-1]) / np.diff(time)
    share = np.zeros(len(time))
    share[:-1] += end - begin - second
    share[1:] += second
    return share / duration


def read_taps(taps: Path, values: Path, duration: float) -> TapHistory:
    """The history of two files, over at least a duration [s]. Raises InputError."""
    table = Table(taps, ("name", "x", "y", "z"), ("name", "x", "y"))
    names = [name.lower() for name in table.words("name")]
    places = np.column_stack([table.numbers(axis, unit="m") for axis in "xy"])
    for row, name in enumerate(names):
        if not name or name == "time" or name in names[:row]:
            table.wrong(f"{table.at(row)}: name = {name[:40]!r}: expected a name of its own")
    if np.isnan(places).any():
        table.wrong("empty cells; expected a number in each")
    check_apart(table, names, places, "one tap at each place, with what presses and what lifts there added")
    table.finish()
    if values.suffix in (".h5", ".hdf5"):
        time, rows, notes = *_long_file(values, len(names)), []
    else:
        time, rows, notes = _csv_file(values, names)
    _check_times(values, time, duration)
    return TapHistory(time, rows, places, table.notes + notes, duration)


def _csv_file(path: Path, names: list[str]):
    table = Table(path, ("time", *names), ("time", *names))
    time = table.numbers("time", unit="s")
    value = np.column_stack([table.numbers(name) for name in names])
    if np.isnan(time).any() or np.isnan(value).any():
        table.wrong("empty cells; expected a number in each")
    table.finish()
    return time, lambda first, end: value[first:end], table.notes


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
    back = np.flatnonzero(~(np.diff(time) > 0))
    if len(back):
        k = int(back[0])
        raise InputError(
            f"{path}: time = {time[k + 1]:g} is not after the row before ({time[k]:g}); "
            "expected ascending times"
        )
    if not (time[0] <= 0 and time[-1] >= duration):
        raise InputError(
            f"{path}: covers {time[0]:g} to {time[-1]:g} s; expected 0 to duration = {duration:g} s"
        )
