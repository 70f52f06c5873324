"""Compiled code that several processes keep on disk at the same time."""

import multiprocessing
from pathlib import Path

from netfall.compile import FileForEach


def keep(folder: Path, start, mine: str, repeats: int) -> None:
    """Keep versions of one function, each at the same moment as the other processes keep theirs."""
    for number in range(repeats):
        start.wait()
        FileForEach(str(folder), "motion.axis-1", stamp(number)).save((mine, "float64"), mine)


def stamp(number: int) -> tuple[str, int]:
    """Of a source file: another one makes the cache empty, as a fresh clone's is."""
    return ("time", number)


def test_processes_that_compile_at_once_load_their_own(tmp_path):
    """The axes of a particle differ by an index alone: one loaded for another is wrong in silence."""
    context = multiprocessing.get_context("fork")
    processes, repeats = 3, 50
    start = context.Barrier(processes)
    names = [f"axis {k}" for k in range(processes)]
    workers = [context.Process(target=keep, args=(tmp_path, start, name, repeats)) for name in names]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join(60)
    assert [worker.exitcode for worker in workers] == [0] * processes
    files = FileForEach(str(tmp_path), "motion.axis-1", stamp(repeats - 1))
    assert [files.load((name, "float64")) for name in names] == names


def test_code_of_a_changed_source_is_not_loaded(tmp_path):
    """The digest of a name covers what a version was compiled for, not the source: the stamp does."""
    FileForEach(str(tmp_path), "motion.axis-1", stamp(1)).save("float64", "old law")
    assert FileForEach(str(tmp_path), "motion.axis-1", stamp(2)).load("float64") is None
    assert FileForEach(str(tmp_path), "motion.axis-1", stamp(1)).load("float64") == "old law"
    FileForEach(str(tmp_path), "motion.axis-1", stamp(1)).flush()
    assert FileForEach(str(tmp_path), "motion.axis-1", stamp(1)).load("float64") is None
