"""A full disk at every stage that writes: one line, exit code 1, no partial file."""

import ctypes
import errno
import os
import shutil
import subprocess
import sys
import time
from itertools import product
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import (
    BIN,
    ENVIRONMENT,
    STEEL,
    assert_same_results,
    run_netfall,
    run_on_standing_ranks,
    run_process,
)
from kill_runs import changed
from mpi4py import MPI
from test_long_runs import ELEMENTS, NODES
from test_long_runs import JOB as TINY

from netfall.__main__ import main
from netfall.core.errors import InputError, OutputError
from netfall.results import locks as room
from netfall.results.h5 import SharedFile, find_segments, is_intact
from netfall.results.locks import atomic_h5, reserve_disk_space, whole

SHORT = changed(duration=0.06, frames=240)
DISK = 16  # MB
CUT = "No space left on device"


class Disk:
    """A disk in memory, of which a part is left free."""

    def __init__(self, folder: Path):
        self.folder = folder

    def leave(self, kilobytes: int) -> None:
        """Fill the disk except for a size; earlier contents are removed."""
        for path in self.names():
            (self.folder / path).unlink()
        (self.folder / "filler").unlink(missing_ok=True)
        with open(self.folder / "filler", "wb") as filler:
            os.posix_fallocate(filler.fileno(), 0, (DISK << 20) - (kilobytes << 10))

    def content(self) -> dict[Path, bytes]:
        """Return the files on the disk."""
        files = (path for path in self.folder.rglob("*") if path.is_file() and path.name != "filler")
        return {path: path.read_bytes() for path in files}

    def names(self) -> set[str]:
        """Return the names of the files on the disk."""
        return {path.name for path in self.folder.iterdir() if path.name != "filler"}


@pytest.fixture
def disk(tmp_path):
    """Return a disk in memory, if this process may mount one."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = run_process("mount", "-t", "tmpfs", "-o", f"size={DISK}m", "netfall", folder, code=None)
    if mounted.returncode:
        pytest.skip(f"no disk can be mounted here: {mounted.stderr.strip()}")
    yield Disk(folder)
    subprocess.run(["umount", "-l", str(folder)], check=True)


def without_room(done, *words) -> str:
    """Return the one error line of a command that found no space."""
    assert done.returncode == 1, (done.returncode, done.stderr)
    lines = [line for line in done.stderr.splitlines() if "error: " in line or "ignal" in line]
    assert len(lines) == 1 and lines[0].startswith("error: "), done.stderr
    assert "Traceback" not in done.stderr and "HDF5" not in done.stderr
    assert "cannot be written" in lines[0] and "Make room there" in lines[0], lines[0]
    assert all(word in lines[0] for word in words), lines[0]
    return lines[0]


@pytest.mark.parametrize(
    "ranks, left",
    [
        (2, (40, 820, 2400, 3600)),
        pytest.param(1, (40, 900, 2400, 3600), marks=pytest.mark.long),
        pytest.param(2, (1800, 3600), marks=pytest.mark.long),
    ],
)
def test_a_run_ends_when_the_disk_is_full(disk, workshop, ranks, left):
    """There is no result and no partial file. With space the run resumes with equal bits."""
    job, refusals = workshop.job(SHORT), []
    for kilobytes in left:
        disk.leave(kilobytes)
        arguments = ("run", job, "-o", disk.folder / "r.vtkhdf", "--quiet")
        line = without_room(run_netfall(*arguments, ranks=ranks, code=None), CUT)
        names = disk.names()
        checkpoints = sorted(name for name in names if name.startswith("r.checkpoint"))
        parts = {name for name in names if name.startswith(".r.vtkhdf.segment")}
        assert names == {*checkpoints, *parts} and bool(parts) == bool(checkpoints)
        assert all(is_intact(disk.folder / name) for name in checkpoints)
        resumed = f"--restart {disk.folder / checkpoints[-1]}" if checkpoints else ""
        assert (resumed in line) if checkpoints else ("--restart" not in line)
        refusals.append((line.split(": cannot")[0].rpartition("/")[2].rstrip("0123456789"), len(checkpoints)))
    assert len(checkpoints) == 2 and ("r.vtkhdf", 2) in refusals  # at the last, while parts were joined
    assert left[0] > 40 or refusals[0] == ("r.vtkhdf", 0), refusals
    whole = workshop.run(job)
    (disk.folder / "filler").unlink()
    run_on_standing_ranks(*arguments, "--restart", disk.folder / checkpoints[-1], ranks=ranks)
    with h5py.File(disk.folder / "r.vtkhdf") as again:
        assert_same_results(whole, again)


LOADED = """[net]
generator = "saddle"
[net.saddle]
cells = 24
[form_finding]
METHOD
[load]
self_weight = true
snow = 500.0
steps = 2
"""
FORCE_DENSITY = 'method = "force_density"'


@pytest.mark.parametrize(
    "stage, ranks, left",
    [
        (1, 2, (0, 4)),
        (2, 1, (0, 100)),
        *(pytest.param(*row, (0, 4, 100, 300), marks=pytest.mark.long) for row in product((1, 2), (1, 2))),
    ],
)
def test_a_stop_before_dynamics_ends_when_the_disk_is_full(disk, workshop, stage, ranks, left):
    """In form finding (stage 1) and statics: first there is no space for the checkpoint, then there is."""
    method = "modulus_factor = 0" if stage == 1 else FORCE_DENSITY
    job = workshop.job(LOADED.replace("METHOD", method) + STEEL)
    arguments = ("run", job, "-o", disk.folder / "r.vtkhdf", "--quiet", "--walltime", "00:00:00")
    name = f"r.checkpoint-{stage}-"
    for kilobytes in left:
        disk.leave(kilobytes)
        done = run_netfall(*arguments, ranks=ranks, code=None)
        if stage == 1 and done.returncode == 4:  # of so little it has the room
            assert kilobytes >= 100
            continue
        without_room(done, "r.", CUT)
        assert disk.names() == set()
    disk.leave(4000)
    assert name in run_on_standing_ranks(*arguments, ranks=ranks, timeout=120, code=4).stderr
    (checkpoint,) = (path for path in disk.names() if path.startswith(name))
    assert is_intact(disk.folder / checkpoint)


@pytest.fixture
def netfall_here(monkeypatch, capsys):
    """Run netfall like `run_netfall`, in this process, for commands that only read results."""

    def run(*words) -> subprocess.CompletedProcess:
        monkeypatch.setattr(sys, "argv", ["netfall", *map(str, words)])
        monkeypatch.setattr(os, "_exit", sys.exit)  # by which an error ends
        with pytest.raises(SystemExit) as end:
            main()
        return subprocess.CompletedProcess(words, end.value.code, *capsys.readouterr())

    return run


def test_pictures_and_reports_end_when_the_disk_is_full(disk, workshop, netfall_here):
    """Complete files stay. No picture or table is partial."""
    result = workshop.folder / "result.vtkhdf"
    workshop.solve(LOADED.replace("METHOD", FORCE_DENSITY) + STEEL).close()
    for command in ("plot", "report", "check"):
        for kilobytes in (0, 20) if command == "plot" else (20,):
            disk.leave(kilobytes)
            source = workshop.folder / "job.toml" if command == "check" else result
            without_room(netfall_here(command, source, "-o", disk.folder), str(disk.folder), CUT)
            for name in disk.names():
                content = (disk.folder / name).read_bytes()
                assert not name.startswith(".") and content
                assert content.endswith(b"IEND\xaeB`\x82" if name.endswith(".png") else b"\n"), name


def test_init_and_partition_leave_no_partial_file(tmp_path):
    """A partial job would end the next `netfall init`, because the file exists."""
    (tmp_path / "roof.toml").write_text('[net]\ngenerator = "saddle"\n[net.saddle]\ncells = 60\n' + STEEL)
    for kilobytes, *words in ((0, "init", "new.toml"), (20, "partition", "roof.toml", "-n", "2")):
        command = ["bash", "-c", f'ulimit -f {kilobytes}; exec "$0" "$@"', BIN / "netfall", *words]
        base = ENVIRONMENT | {"PYTHONDONTWRITEBYTECODE": "1"}  # Python leaves truncated files
        done = run_process(*command, cwd=tmp_path, environment=base, code=None)
        without_room(done, "File too large")
        assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["roof.toml"]


def test_exports_and_imports_end_when_the_disk_is_full(disk, workshop, netfall_here):
    """No file or folder is left, and an earlier export stays. With space the command runs."""
    result = workshop.folder / "result.vtkhdf"
    workshop.solve(LOADED.replace("METHOD", FORCE_DENSITY) + STEEL).close()
    drawn = workshop.folder / "net.vtu"
    run_on_standing_ranks("export", result, "-o", drawn)
    endings = ("", ".dxf", ".tcl", ".json", ".vtu")
    commands = [("export", result, "-o", disk.folder / f"net{end}") for end in endings]
    for command in [*commands, ("import", drawn, "-o", disk.folder / "net", "--unit", "m")]:
        for kilobytes in (0, 30) if command is commands[0] else (30,):
            disk.leave(kilobytes)
            without_room(netfall_here(*command), str(disk.folder / "net"), CUT)
            assert disk.names() == set()
        (disk.folder / "filler").unlink()
        run_on_standing_ranks(*command)
        before = disk.content()
        with open(disk.folder / "filler", "wb") as filler, pytest.raises(OSError):
            while True:
                filler.write(bytes(1 << 16))
                filler.flush()
        without_room(netfall_here(*command), CUT)
        assert disk.content() == before
        for path in disk.names():
            shutil.rmtree(disk.folder / path) if (disk.folder / path).is_dir() else None


def test_studies_end_when_the_disk_is_full(disk, workshop):
    """The journal, then the study file, which has its name once complete. The same command resumes."""
    workshop.job(TINY.replace("16.2", "0.002"), NODES, ELEMENTS)
    study = workshop.folder / "study.toml"
    seeds = ", ".join(map(str, range(1, 13)))
    study.write_text(f'job = "job.toml"\n[vary]\n"dynamics.mass_damping" = [{seeds}]\n')
    command = ("study", study, "-o", disk.folder / "s.study.h5", "--workers", "1")
    for kilobytes, left in ((0, set()), (12, {"s.study.journal"})):
        disk.leave(kilobytes)
        without_room(run_netfall(*command, "--quiet", timeout=200, code=None), CUT)
        assert {name for name in disk.names() if (disk.folder / name).stat().st_size} == left
    (disk.folder / "filler").unlink()
    assert "12 of 12 runs are there" in run_netfall(*command, timeout=200).stdout
    assert disk.names() == {"s.study.h5"}


# --- how files are written


def test_a_full_disk_leaves_the_new_table_or_the_old_one(tmp_path, monkeypatch):
    """The old table keeps every byte."""
    path = tmp_path / "table.h5"
    with atomic_h5(path) as file:
        file["a"] = 1
    before = path.read_bytes()

    def full(*_):
        raise OSError(errno.ENOSPC, CUT)

    with monkeypatch.context() as patch:
        patch.setattr(room, "sync", full)
        with pytest.raises(OutputError, match=f"table.h5: cannot be written .{CUT}"), atomic_h5(path) as file:
            file["b"] = 2
    assert path.read_bytes() == before and {p.name for p in tmp_path.iterdir()} == {"table.h5"}
    with atomic_h5(path) as file:
        file["b"] = 2
    with h5py.File(path) as file:
        assert {*file} == {"b"}


@pytest.mark.parametrize(
    "code, words", [(errno.EROFS, "Give another path with"), (errno.ENAMETOOLONG, "Give a shorter name with")]
)
def test_pictures_that_cannot_be_written_are_named_with_a_remedy(tmp_path, monkeypatch, code, words):
    """Not every failure is a full disk. The folder of an output is made where it is written."""

    def refuse(*_, **__):
        raise OSError(code, os.strerror(code))

    with whole(tmp_path / "new" / "made.txt") as temporary:
        temporary.write_text("made")
    monkeypatch.setattr(Path, "mkdir", refuse)
    for work in (whole, room.locked_output):
        with pytest.raises(OutputError, match=f"a.png: cannot be written .{os.strerror(code)}.*{words} -o"):
            work(tmp_path / "a.png").__enter__()


def test_a_result_needs_a_name_with_room_for_those_of_its_temporary_files(tmp_path):
    """A run would otherwise end at its first checkpoint, or Open MPI would crash."""
    room.check_output_path(tmp_path / f"{'a' * 188}.vtkhdf")
    for name in (f"{'a' * 189}.vtkhdf", "é" * 98, "a" * 300):
        with pytest.raises(InputError, match=r"limit 195 bytes.\. Give a shorter name with -o"):
            room.check_output_path(tmp_path / name)


def test_a_full_disk_is_named_if_a_segment_is_restored_from_the_result(tmp_path, monkeypatch):
    """The result is there: it is not missing or damaged. No part of the segment remains."""
    result, target = tmp_path / "r.vtkhdf", tmp_path / ".r.vtkhdf.segment-recovered"
    with h5py.File(result, "w") as file:
        file.create_group("provenance").attrs["job_digest"] = "this job"
        file["rows"] = np.arange(9)

    def full(*_):
        raise OSError(errno.ENOSPC, CUT)

    given = tmp_path, ["gone"], {"rows": 5}, [result], "this job", target
    with monkeypatch.context() as patch:
        patch.setattr(room, "reserve_disk_space", full)
        with pytest.raises(OutputError, match=f"cannot be written .{CUT}"):
            find_segments(*given)
    assert {path.name for path in tmp_path.iterdir()} == {result.name}
    assert find_segments(*given) == [target]


def test_space_is_reserved_without_a_change_of_the_file(disk):
    """3 of 4 MB are reserved, 5 are refused. No other file gets the space until it is released."""
    disk.leave(4 << 10)
    path = disk.folder / "file"
    path.write_bytes(b"abc")
    reserve_disk_space(path, 3 << 20)
    assert path.read_bytes() == b"abc"
    with pytest.raises(OSError, match=CUT):
        (disk.folder / "other").write_bytes(bytes(2 << 20))
    (disk.folder / "other").unlink()
    with pytest.raises(OSError, match=CUT):
        reserve_disk_space(path, 5 << 20)
    room.truncate_to_size(path)
    (disk.folder / "other").write_bytes(bytes(2 << 20))
    assert path.read_bytes() == b"abc"


def test_without_reservation_the_free_space_counts(disk, monkeypatch):
    """On a file system without reservation, 3 of 4 free MB suffice for a file of 3, but not of 5."""

    def unknown(*_):
        ctypes.set_errno(errno.EOPNOTSUPP)
        return -1

    monkeypatch.setattr(room, "_fallocate", unknown)
    disk.leave(4 << 10)
    path = disk.folder / "file"
    path.touch()
    reserve_disk_space(path, 3 << 20)
    with pytest.raises(OSError, match=CUT):
        reserve_disk_space(path, 5 << 20)


@pytest.mark.parametrize(
    "datasets, tail, rows, appends",
    [(1, (3,), 25, 4000), (60, (), 7, 3), (3, (40, 3), 1, 300), (2, (3,), 30_000, 12), (200, (), 1, 1)],
    ids=["small rows", "many datasets", "states", "large rows", "rows of one"],
)
def test_hdf5_uses_no_more_space_than_reserved(tmp_path, datasets, tail, rows, appends):
    """With its own lists, at any moment, the file is at most as long as the reserved space."""
    file = SharedFile(MPI.COMM_SELF, tmp_path / "file.h5")
    names = [f"group-{k % 7}/values-{k}" for k in range(datasets)]
    for name in names:
        file.create(name, np.float64, tail, rows)
    for turn in range(appends):
        for name in names:
            if len(tail) == 2:
                file.append_state(name, np.full(tail, float(turn)), tail[0])
            else:
                file.append(name, np.full((rows, *tail), float(turn)), rows)
        if turn % 50 == 0 or turn == appends - 1:
            file.rows()  # what waits is written
            file.file.flush()
            assert file.temporary.stat().st_size <= file._reserved
    file.close()
    with h5py.File(tmp_path / "file.h5") as f:
        assert (f[names[-1]][-1] == appends - 1).all() and len(f[names[0]]) == rows * appends


def test_temporary_files_of_killed_processes_are_removed_after_a_day(tmp_path):
    """Files that another process may write stay, and those of other users."""
    old, new = (tmp_path / f".{digit * 16}.part.png" for digit in "0a")
    other = tmp_path / ".notes.part.png"
    for path in (old, new, other):
        path.touch()
        os.utime(path, (1.0, time.time() - 1e5 * (path is not new)))
    with whole(tmp_path / "a.png") as place:
        place.touch()
    assert {path.name for path in tmp_path.iterdir()} == {new.name, other.name, "a.png"}
