"""Pressures at taps: samples from CSV and HDF5, weights at nodes, refused files."""

import re

import h5py
import numpy as np
import pytest

from netfall.core.errors import InputError
from netfall.loads.wind.measured import point_weights, read_taps

TAPS = "name,x,y\nA,0,0\nB,10,0\nC,0,10\n"
TIME = np.arange(-2, 200) * 0.05
VALUES = np.outer(np.sin(TIME), [1.0, -2.0, 0.5])


@pytest.fixture
def files(tmp_path):
    (tmp_path / "taps.csv").write_text(TAPS)
    rows = (f"{t!r},{b!r},{a!r},{c!r}\n" for t, (a, b, c) in zip(TIME.tolist(), VALUES.tolist()))
    (tmp_path / "cp.csv").write_text("time,b,a,C\n" + "".join(rows))
    with h5py.File(tmp_path / "cp.h5", "w") as file:
        file["time"], file["value"] = TIME, VALUES
    return tmp_path


@pytest.mark.parametrize("name", ["cp.csv", "cp.h5"])
def test_samples_are_the_rows_from_time_zero(files, name):
    """Across blocks of rows, in any order, then the last row; both formats have the same bits."""
    history = read_taps(files / "taps.csv", files / name, 9.0)
    zero = 2
    for k in (0, 1, 63, 64, 130, 199, 5):
        time, value = history.sample(k)
        assert time == TIME[zero + k] and (value == VALUES[zero + k]).all()
    assert history.sample(5000)[0] == TIME[-1]
    fine = np.linspace(0, 9, 90_001)  # multiples of the samples' times
    mean = np.trapezoid(np.interp(fine, TIME, VALUES[:, 0]), fine) / 9
    assert np.allclose(history.mean_gust, mean * np.array([1.0, -2.0, 0.5]), rtol=1e-9)


def test_pressures_have_a_row_of_units(files):
    """kN/m2 and ms, as in any table."""
    (files / "cp.csv").write_text("time,a,b,c\nms,kN/m2,Pa,-\n0,0.3,300,300\n9000,-0.5,-500,-500\n")
    history = read_taps(files / "taps.csv", files / "cp.csv", 9.0)
    assert history.time.tolist() == [0.0, 9.0]
    assert [history.sample(k)[1].tolist() for k in (0, 1)] == [[300.0] * 3, [-500.0] * 3]


def test_a_node_has_the_pressure_of_near_taps(files):
    """At a tap its value, between three at one distance their mean, far outside nearly the mean."""
    history = read_taps(files / "taps.csv", files / "cp.csv", 9.0)
    x = np.array([[10.0, 0, 3], [5.0, 5, 7], [-3e5, -3e5, 0]])
    corner, weight = point_weights(x, history.places)
    value = np.array([1.0, -2.0, 0.5])
    assert np.allclose((weight * value[corner]).sum(1), [-2, -0.5 / 3, -0.5 / 3], atol=1e-3)


def wrong_file(folder, time=TIME, value=VALUES):
    """Write an HDF5 file with these datasets; return its path."""
    with h5py.File(folder / "wrong.h5", "w") as file:
        file["time"], file["value"] = time, value
    return folder / "wrong.h5"


@pytest.mark.parametrize(
    "change, message",
    [
        (dict(value=VALUES[:, :2]), "expected (t,) and (t, 3). Give a column for each of the 3 taps"),
        (dict(value=np.where(VALUES == VALUES[70, 1], np.nan, VALUES)), "value: row 70: not a number"),
        (dict(value=VALUES.astype("S")), "time holds float64 and value |S32, which are not real numbers"),
        (dict(value=1j * VALUES), "time holds float64 and value complex128, which are not real numbers"),
        (dict(time=TIME[::-1]), "is not after the row before"),
        (dict(time=TIME + 1), "covers 0.9 to"),
        (dict(time=0.5 * TIME), "expected 0 to duration = 9 s"),
    ],
)
def test_wrong_long_files_are_refused(files, change, message):
    with pytest.raises(InputError, match=re.escape(message)):
        read_taps(files / "taps.csv", wrong_file(files, **change), 9.0)


@pytest.mark.parametrize(
    "taps, values, message",
    [
        (TAPS, "time,a,b\n0,1,1\n9,1,1\n", "column c is missing"),
        (TAPS, "time,a,b,c\n0,1,1,\n9,1,1,1\n", "empty cells"),
        (TAPS + "a,3,3\n", "", "line 5: name = 'a': expected a unique name"),
        (TAPS + "d,3,\n", "", "empty cells"),
        (TAPS + "below,10,0\n", "", "line 5: name = 'below': at the same x, y as 'b'. Give one tap"),
    ],
)
def test_wrong_tables_are_refused(files, taps, values, message):
    (files / "taps.csv").write_text(taps)
    (files / "cp.csv").write_text(values)
    with pytest.raises(InputError, match=re.escape(message)):
        read_taps(files / "taps.csv", files / "cp.csv", 9.0)
    with pytest.raises(InputError, match="No such file"):
        read_taps(files / "points.csv", files / "cp.h5", 9.0)
