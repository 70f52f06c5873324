"""Old names of studies, options and datasets give the new ones; files of other versions are refused."""

import h5py
import numpy as np
import pytest
from conftest import refused, run_on_standing_ranks
from study_files import columns, write_study
from test_study_runs import JOB, write

import netfall
from netfall.cli.parser import RENAMED_OPTIONS, with_new_options
from netfall.core.errors import InputError
from netfall.results.checkpoint import Checkpoint
from netfall.results.file import open_result
from netfall.results.h5 import finish_file
from netfall.results.reader import RENAMED
from netfall.study.answers.read import read_study
from netfall.study.file import RULES, read_study_plan
from netfall.study.table import FORMAT, read_digests

STUDY = """
job = "roof.toml"
[vary]
"wind.speed" = [20.0, 30.0]
[sampling]
count = 2
"wind.seed" = {distribution = "integer", from = 1, to = 9}
[run]
keep_results = "broken"
[[failure]]
name = "detached"
outcome = "detached_area"
limit = 0.1
[[failure]]
name = "inexact"
outcome = "energy_balance_error"
limit = 1e-3
[[failure]]
name = "sunk"
outcome = "sunk_area"
limit = 0.2
depth = 0.5
"""


def texts(rule) -> tuple[str, str]:
    """A section, key or value as STUDY has it, and as it was before."""
    if rule.value:
        return f'outcome = "{rule.new}"', f'outcome = "{rule.value}"'
    return (f"\n{rule.new} = ", f"\n{rule.key} = ") if rule.key else (f"[{rule.new}]", f"[{rule.section}]")


@pytest.mark.parametrize("rule", RULES, ids=str)
def test_an_old_name_of_a_study_file_gives_the_same_study_and_one_warning(tmp_path, rule):
    new, old = texts(rule)
    assert new in STUDY
    plan = read_study_plan(write(tmp_path))
    plan, renamed = (read_study_plan(write(tmp_path, text)) for text in (STUDY, STUDY.replace(new, old)))
    (warning,) = (line for line in renamed.notes if line not in plan.notes)
    assert warning.startswith(f"warning: {tmp_path / 'storm.toml'}: [") and "since version 0.5" in warning
    assert rule.new in warning and (rule.value or rule.key or rule.section) in warning
    assert renamed.digest() == plan.digest() and np.array_equal(renamed.draws, plan.draws)
    assert renamed.failures == plan.failures and renamed.keep_results == plan.keep_results == "broken"
    assert not plan.notes


@pytest.mark.parametrize("rule", [rule for rule in RULES if not rule.value], ids=str)
def test_both_names_of_a_study_file_are_an_error(tmp_path, rule):
    new, old = texts(rule)
    value = STUDY.partition(new)[2].partition("\n")[0]
    text = STUDY.replace(new, f"{old}{value}{new}", 1) if rule.key else f"{STUDY}{old}\ncount = 2\n"
    with pytest.raises(InputError, match="are one name; remove") as error:
        read_study_plan(write(tmp_path, text))
    assert len(error.value.lines) == 1 and rule.new in str(error.value)


def test_the_warnings_are_printed_before_the_runs(tmp_path):
    """Two old names, two warnings, though three entries have the second one."""
    text = STUDY.replace("keep_results", "keep").replace("\nlimit", "\nabove")
    study = write(tmp_path, text.replace("[20.0, 30.0]", "[20.0]"))
    said = run_on_standing_ranks("study", study, "--workers", 1, cwd=tmp_path).stdout.splitlines()
    assert [line.split(": ")[2] for line in said if line.startswith(f"warning: {study}")] == [
        f"{names} since version 0.5. Version 0.6 refuses the old name. Use the new one. [W921]"
        for names in ("[run] keep is keep_results", "[[failure]] above is limit")
    ]


@pytest.mark.parametrize("old, new", RENAMED_OPTIONS.items())
def test_an_old_option_is_the_new_one_with_a_warning(old, new):
    for given, expected in (([old, "3"], [new, "3"]), ([f"{old}=3"], [f"{new}=3"])):
        words, (warning,) = with_new_options(["view", "a.study.h5", *given])
        assert words == ["view", "a.study.h5", *expected] and f"{old} is {new} since" in warning
    assert with_new_options(["view", new, "3"]) == (["view", new, "3"], [])
    with pytest.raises(InputError, match=f"{old} and {new} are one option"):
        with_new_options(["view", old, "3", f"{new}=3"])


def test_the_command_takes_an_old_option(tmp_path):
    done = run_on_standing_ranks("view", tmp_path / "no.vtkhdf", "--member", 3, cwd=tmp_path, code=2)
    warning, error = done.stderr.splitlines()
    assert warning.startswith("warning: --member is --sample") and error.startswith("error: --sample 3: ")


@pytest.fixture
def result(workshop):
    """The path of a result in a static wind, with one row of the history and /initial_state."""
    job = JOB.replace("duration = 1.6", "duration = 0.001").replace("speed = 33.0", "speed = 10.0")
    workshop.run(workshop.job(job)).close()
    return workshop.folder / "result.vtkhdf"


def test_an_old_name_in_python_is_a_key_error_with_the_new_one(result):
    """Each of RENAMED; a name that never was is an error as before."""
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
        with pytest.raises(InputError) as error:
            read(result)
        assert len(error.value.lines) == 1 and str(error.value).startswith(line)
    assert refused("info", result).startswith(f"error: {line}")


def test_a_study_of_another_version_is_refused_by_its_name(tmp_path):
    """By what reads it, and by `netfall study`, which would join it."""
    path = tmp_path / "storm.study.h5"
    write_study(path, columns({}, np.zeros(2, bool), np.zeros(2)), {})
    with h5py.File(path, "r+") as file:
        file.attrs["netfall_study"] = FORMAT - 1
        file["provenance/netfall"] = "0.4.0"
    line = f"{path}: written by netfall 0.4.0, "
    for read in (read_study, read_digests):
        with pytest.raises(InputError) as error:
            read(path)
        assert len(error.value.lines) == 1 and str(error.value).startswith(line)
    assert refused("study", write(tmp_path), "-o", path, cwd=tmp_path).startswith(f"error: {line}")


@pytest.mark.parametrize("version", ["0.5.1", "0.4 or older"])
def test_a_checkpoint_of_another_version_is_refused_by_its_name(tmp_path, version):
    """Those of 0.4 do not hold their version."""
    path, temporary = tmp_path / "a.checkpoint-5-000000000000.h5", tmp_path / "a.h5"
    with h5py.File(temporary, "w") as file:
        file.attrs["format"] = 12
        if version == "0.5.1":
            file.attrs["netfall"] = version
    finish_file(temporary, path, seal=True)
    with pytest.raises(InputError) as error:
        Checkpoint(path, "")
    assert len(error.value.lines) == 1 and str(error.value).startswith(
        f"{path}: written by netfall {version}, "
    )
