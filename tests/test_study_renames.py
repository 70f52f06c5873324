"""Old names of datasets are errors with the new names; files of other versions are refused."""

import h5py
import numpy as np
import pytest
from conftest import error_lines, refused
from study_files import columns, write_study
from test_study_runs import JOB, write

import netfall
from netfall.results.checkpoint import FORMAT as CHECKPOINT_FORMAT
from netfall.results.checkpoint import Checkpoint
from netfall.results.file import open_result
from netfall.results.h5 import finish_file
from netfall.results.reader import RENAMED
from netfall.study.answers.read import read_study
from netfall.study.table import FORMAT, read_digests


@pytest.fixture
def result(workshop):
    """Return the path of a result in a static wind, with one history row and /initial_state."""
    job = JOB.replace("duration = 1.6", "duration = 0.001").replace("speed = 33.0", "speed = 10.0")
    workshop.run(workshop.job(job)).close()
    return workshop.folder / "result.vtkhdf"


def test_an_old_name_in_python_is_a_key_error_with_the_new_one(result):
    """For each of RENAMED; an unknown name is the usual error."""
    with netfall.open(result) as opened:
        for old, new in RENAMED.items():
            with pytest.raises(KeyError, match=f"'{old}' is '{new}' since version 0.5"):
                opened.rest if old == "rest" else opened.history[old]
            assert len(opened.initial_state["position"] if old == "rest" else opened.history[new])
        with pytest.raises(KeyError, match=r"no column .*balance.*did you mean"):
            opened.history["balance"]


def test_a_result_of_another_version_is_refused_by_its_name(result):
    with h5py.File(result, "r+") as file:
        assert file["provenance"].attrs["netfall"] == netfall.__version__
        file["provenance"].attrs["netfall"] = "0.4.0"
        del file["provenance"].attrs["format"]
    line = f"{result}: written by netfall 0.4.0, "
    for read in (open_result, netfall.open):
        (error,) = error_lines(read, result)
        assert error.startswith(line)
    assert refused("info", result).startswith(f"error: {line}")


def test_a_study_of_another_version_is_refused_by_its_name(tmp_path):
    path = tmp_path / "storm.study.h5"
    write_study(path, columns({}, np.zeros(2, bool), np.zeros(2)), {})
    with h5py.File(path, "r+") as file:
        file.attrs["netfall_study"] = FORMAT - 1
        file["provenance/netfall"] = "0.4.0"
    line = f"{path}: written by netfall 0.4.0, "
    for read in (read_study, read_digests):
        (error,) = error_lines(read, path)
        assert error.startswith(line)
    assert refused("study", write(tmp_path), "-o", path, cwd=tmp_path).startswith(f"error: {line}")


@pytest.mark.parametrize("version", ["0.5.0", "0.4 or older", "9.0.0"])
def test_a_checkpoint_of_another_version_is_refused_by_its_name(tmp_path, version):
    """Checkpoints of 0.4 have no version. One of the same layout may have another form or erection."""
    path, temporary = tmp_path / "a.checkpoint-5-000000000000.h5", tmp_path / "a.h5"
    with h5py.File(temporary, "w") as file:
        file.attrs["format"] = CHECKPOINT_FORMAT if version == "9.0.0" else 13
        if version != "0.4 or older":
            file.attrs["netfall"] = version
    finish_file(temporary, path, seal=True)
    (error,) = error_lines(Checkpoint, path, "")
    assert error.startswith(f"{path}: written by netfall {version}, ")
