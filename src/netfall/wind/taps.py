"""Pressures of a wind tunnel: values in time at taps, and what of them reaches a node.

The values are pressures [N/m2] or coefficients, as the caller takes them; positive presses on the roof. The
taps stand in a table name, x, y, in the axes of the net; the values in a table with the columns time and one
for each tap by name, or in an HDF5 file with `time` (t,) and `value` (t, c), columns in the order of the
taps, of which 64 rows are held at a time. Times are those of the roof, in s. A node takes the values of the
four nearest taps in plan, weighted by distance (`measured.place_weights`); between times values are linear.
"""

from pathlib import Path

import h5py
import numpy as np

from netfall.ground.errors import InputError
from netfall.job.table import LARGEST
from netfall.wind.measured import ROWS, TableHistory, read_places, read_rows


def _shares(time: np.ndarray, duration: float) -> np.ndarray:
    """Weights (t,) of the rows in the mean from 0 to a duration [s], linear between them."""
    begin, end = np.clip(time[:-1], 0.0, duration), np.clip(time[1:], 0.0, duration)
    second = (end - begin) * (0.5 * (begin + end) - time[:-1]) / np.diff(time)
    share = np.zeros(len(time))
    share[:-1] += end - begin - second
    share[1:] += second
    return share / duration


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
    """Mean values (c,) over the duration [s]; time, rows : as in `TableHistory`."""
    share = _shares(time, duration)
    blocks = range(0, len(time), ROWS)
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
