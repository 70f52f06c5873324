"""Files that remain: the last two checkpoints of a result, given checkpoints, all those of other results."""

from pathlib import Path

import pytest
from conftest import assert_same_results, refused
from test_long_runs import ELEMENTS, JOB, NODES

from netfall.results.checkpoint import checkpoint_path

AT_ONCE = ("--walltime", "00:00:00")  # stops at the first look: step 0, or 100,000 steps on


def tiny_job(workshop, duration: float, more: str = "") -> Path:
    """Return three nodes in a constant wind, with a million steps a second."""
    return workshop.job(JOB.replace("16.2", str(duration)) + more, NODES, ELEMENTS)


def steps(folder: Path) -> list[int]:
    """Return step numbers of the checkpoints in a folder."""
    return sorted(int(path.stem.split("-")[-1]) for path in folder.glob("*checkpoint-*"))


def test_the_given_checkpoint_remains(workshop):
    """Five newer ones follow. A later run, which resumes a newer one, removes it."""
    job = tiny_job(workshop, 0.006, "checkpoint_interval = 0.001\n")
    workshop.run(job, *AT_ONCE, code=4)
    (given,) = workshop.folder.glob("result.checkpoint-*")
    before = given.read_bytes()
    workshop.run(job, "--restart", given).close()
    assert steps(workshop.folder) == [0, 4000, 5000]
    assert given.read_bytes() == before
    workshop.run(job, "--restart", given.with_name("result.checkpoint-5-000000004000.h5")).close()
    assert steps(workshop.folder) == [4000, 5000]


def test_requeued_runs_leave_the_last_two_checkpoints_and_those_of_another_folder(workshop):
    """Stopped, resumed in a second folder, then from the newest there to the end: the first one remains."""
    job = tiny_job(workshop, 0.35)
    whole = workshop.run(job, output="whole.vtkhdf")
    for folder in ("first", "second"):
        (workshop.folder / folder).mkdir()
    workshop.run(job, *AT_ONCE, output="first/result.vtkhdf", code=4)
    (given,) = (workshop.folder / "first").glob("*.checkpoint-*")
    before, newest, second = given.read_bytes(), given, workshop.folder / "second"
    for k in (1, 2, 3):
        workshop.run(job, *AT_ONCE, "--restart", newest, output="second/result.vtkhdf", code=4)
        assert steps(second) == [100_000 * each for each in (k - 1, k) if each]
        newest = max(second.glob("*.checkpoint-*"))
    assert_same_results(whole, workshop.run(job, "--restart", newest, output="second/result.vtkhdf"))
    assert given.read_bytes() == before


def test_results_with_other_suffixes_have_separate_checkpoints(workshop):
    """a, a.h5 and a.vtkhdf in one folder are all stopped and resumed."""
    job = tiny_job(workshop, 0.003)
    names = ("a", "a.h5", "a.vtkhdf")
    for name in names:
        workshop.run(job, *AT_ONCE, output=name, code=4)
    paths = [checkpoint_path(workshop.folder / name, 5, 0) for name in names]
    assert all(path.exists() for path in paths) and len(set(paths)) == 3
    assert paths[2].name == "a.checkpoint-5-000000000000.h5"
    for name, checkpoint in zip(names, paths):
        workshop.run(job, "--restart", checkpoint, output=name).close()


def test_a_damaged_part_of_the_result_is_refused_at_the_start(workshop):
    """One bit differs, or the end is cut off: HDF5 would read wrong numbers, or fail when the run ends."""
    job = tiny_job(workshop, 0.003)
    workshop.run(job, *AT_ONCE, output="r.vtkhdf", code=4)
    (segment,) = workshop.folder.glob(".r.vtkhdf.segment-*")
    good, checkpoint = segment.read_bytes(), workshop.folder / "r.checkpoint-5-000000000000.h5"
    half = len(good) // 2
    for damaged in (good[:half] + bytes([good[half] ^ 1]) + good[half + 1 :], good[:-100]):
        segment.write_bytes(damaged)
        message = refused("run", job, "--restart", checkpoint, "-o", workshop.folder / "r.vtkhdf")
        assert f"{segment.name}: this part of the interrupted run's result is missing or damaged" in message
    segment.write_bytes(good)
    workshop.run(job, "--restart", checkpoint, output="r.vtkhdf").close()


@pytest.mark.parametrize("name", ["r[12].vtkhdf", "r*.vtkhdf", "r?.vtkhdf"])
def test_a_name_with_wildcards_does_not_match_another_run(workshop, name):
    """The run writes checkpoints, segments and its result. A stopped run r1 next to it can be resumed."""
    job = tiny_job(workshop, 0.006, "checkpoint_interval = 0.001\n")
    workshop.run(job, *AT_ONCE, output="r1.vtkhdf", code=4)
    before = {path: path.read_bytes() for path in workshop.folder.iterdir() if "r1." in path.name}
    assert len(before) == 2  # a checkpoint and a segment
    workshop.run(job, output=name).close()
    assert all(path.read_bytes() == content for path, content in before.items())
    checkpoint = workshop.folder / "r1.checkpoint-5-000000000000.h5"
    workshop.run(job, "--restart", checkpoint, output="r1.vtkhdf").close()
    assert not list(workshop.folder.glob(".*"))


def test_the_next_run_removes_partial_files_of_a_killed_one(workshop):
    """Partial result, segment and checkpoint, and locks of Open MPI. Files of another run remain."""
    job = tiny_job(workshop, 0.006, "checkpoint_interval = 0.001\n")
    own = (".r.vtkhdf", "..r.vtkhdf.segment-0123abcd-000002", ".r.checkpoint-5-000000000036.h5")
    of_others = (".r.b.vtkhdf", "..r2.vtkhdf.segment-0123abcd-000002", ".r2.checkpoint-5-000000000036.h5")
    parts = (".part", ".part-1310064641-8956.lock")
    for name in own + of_others:
        for part in parts:
            (workshop.folder / f"{name}{part}").touch()
    workshop.run(job, output="r.vtkhdf").close()
    left = {path.name for path in workshop.folder.glob(".*")}
    assert left == {name + part for name in of_others for part in parts}
