"""The guard of refactorings, same_bits.py: it finds what differs, and its random nets are jobs that run."""

import shutil

import h5py
import numpy as np
import pytest
from drawn_jobs import some_jobs
from same_bits import differences

from netfall.ground.errors import InputError
from netfall.job.read import read_job
from netfall.model.layout import features_of, make_layout


@pytest.fixture
def pair(tmp_path):
    """Two equal files, as a run writes them in small."""
    old, new = tmp_path / "old.h5", tmp_path / "new.h5"
    with h5py.File(old, "w") as file:
        file["final/position"] = np.array([[0.5, -0.0, np.nan], [1.0, 2.0, 3.0]])
        file["events/step"] = np.arange(4)
        file["net/group_names"] = np.array(["", "x"], h5py.string_dtype())
        file["final/position"].attrs["unit"] = "m"
        file["provenance/job"] = "one"
    shutil.copy(old, new)
    return old, new


def change(path, name, values):
    """Put other values in the place of a dataset."""
    with h5py.File(path, "r+") as file:
        del file[name]
        if values is not None:
            file[name] = values


def test_equal_files_are_equal(pair):
    """Also with nan and texts; /provenance does not count."""
    change(pair[1], "provenance/job", "another")
    assert differences(*pair) == (3, [])


@pytest.mark.parametrize("row, column", [(0, 0), (0, 1), (0, 2), (1, 2)])
def test_one_bit_is_found(pair, row, column):
    """The last bit of one number, of nan and of minus zero as well."""
    with h5py.File(pair[1], "r+") as file:
        values = file["final/position"][:]
        values.view(np.uint64)[row, column] ^= 1
        file["final/position"][...] = values
    (line,) = differences(*pair)[1]
    assert line.startswith(f"final/position: 1 of 6 values differ, the first at [{row}, {column}]")


@pytest.mark.parametrize(
    "name, values, expected",
    [
        ("events/step", None, "missing"),
        ("events/step", np.arange(4, dtype=np.int32), "type int32, was int64"),
        ("events/step", np.arange(5), "shape (5,), was (4,)"),
        ("net/group_names", np.array(["", "y"], h5py.string_dtype()), "another text"),
        ("final/position", np.array([[0.5, 0.0, np.nan], [1.0, 2.0, 3.0]]), "1 of 6 values differ"),
    ],
)
def test_other_datasets_are_found(pair, name, values, expected):
    """Missing, of another type or shape, another text, zero without its sign."""
    change(pair[1], name, values)
    assert any(line.startswith(f"{name}: {expected}") for line in differences(*pair)[1])


def test_attributes_are_compared(pair):
    """Another unit is a difference."""
    with h5py.File(pair[1], "r+") as file:
        file["final/position"].attrs["unit"] = "mm"
    assert differences(*pair)[1] == ["final/position@unit: type <U2, was <U1"]


def test_new_datasets_are_allowed_by_name_only(pair):
    """By the beginning of the name; what is gone never is."""
    with h5py.File(pair[1], "r+") as file:
        file["history/loss"] = 1.0
    assert differences(*pair)[1] == ["history/loss: new"]
    assert differences(*pair, ("history/",))[1] == []
    assert differences(*reversed(pair), ("history/",))[1] == ["history/loss: missing"]


def test_random_nets_have_what_their_scene_says(tmp_path):
    """Most jobs of a seed are read and give a net with the features of their scene; fewer are the same."""
    jobs, refused = some_jobs(12, 1), 0
    for k, job in enumerate(jobs):
        (folder := tmp_path / str(k)).mkdir()
        for name, text in ({"job.toml": job.text} | job.tables).items():
            (folder / name).write_text(text)
        try:
            layout = make_layout(read := read_job(folder / "job.toml"), 1)
        except InputError:
            refused += 1
            continue
        features = features_of(read, layout.net, layout.slides)
        for name in ("plastic", "fracture", "springs", "energy", "fragments"):
            assert getattr(features, name) == job.scene[name], (k, name)
    assert refused <= 3 and len({str(job.scene) for job in jobs}) == 3
    assert [job.text for job in some_jobs(3, 1)] == [job.text for job in jobs[:3]]
