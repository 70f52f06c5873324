"""Compiled code that several processes keep on disk at the same time."""

import inspect
import multiprocessing
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest
from conftest import ROOT

from netfall.ground.apart import Entry, call
from netfall.ground.compile import FileForEach, allocating_kernel, kernel, kernel_apart, turn
from netfall.ground.handed import laid
from netfall.ground.progress import Progress
from netfall.job.read import read_job
from netfall.mechanics.fields import Features, Particles
from netfall.mechanics.fracture import BREAKING
from netfall.parallel.mpi import MPI
from netfall.program import setup
from netfall.program.ahead import Ahead, ahead_of, plan_of, state_with, types_of
from netfall.program.run import run_job
from netfall.step.beside import EXCHANGED, pack, unpack
from netfall.step.forces import KICKED, kick_chunk
from netfall.step.loop import time_loop
from netfall.step.tear import break_elements


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


def test_one_of_several_processes_compiles_and_the_others_load(tmp_path):
    """The ranks of a first run lack the same versions at the same moment; what compiles them is for one."""
    program = (
        "import sys\n"
        "import numpy as np\n"
        "from netfall.net.parts import label_parts, parts_of\n"
        "assert parts_of(np.array([[2, 1]]), 3).tolist() == [0, 1, 1]\n"
        "print(sum(label_parts.stats.cache_misses.values()), int('numba.np.linalg' in sys.modules))\n"
    )
    start = lambda: subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, env=own)
    own = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    told = [process.communicate(timeout=120)[0].split() for process in [start(), start(), start()]]
    assert sorted(told) == [[b"0", b"0"], [b"0", b"0"], [b"1", b"1"]]


def test_a_turn_is_one_process_at_a_time_and_no_reason_to_hang(tmp_path):
    """A process that was stopped while it compiled keeps others waiting for a while, and not for ever."""
    lock = turn(tmp_path / "lock")
    assert turn(tmp_path / "lock", 0.05) is None
    lock.close()
    again = turn(tmp_path / "lock", 0.05)
    assert again is not None
    again.close()
    assert turn(tmp_path / "no folder" / "lock") is None


@pytest.mark.parametrize("name", ["stadium", "saddle", "taps", "trusses"])
def test_the_time_loop_is_compiled_ahead_for_what_the_run_calls_it_with(monkeypatch, tmp_path, name):
    """Types that are known before there is a state: those with which the run then steps."""
    if not hasattr(time_loop, "overloads"):
        pytest.skip("kernels run as plain Python")
    known = []
    monkeypatch.setattr(setup, "compile_ahead", lambda *scene: known.append(ahead_of(*scene)))
    job = read_job(ROOT / "jobs" / f"{name}.toml", ["dynamics.duration=0.02"])
    run_job(MPI.COMM_SELF, job, tmp_path / "r.vtkhdf", Progress(False))
    [ahead] = known
    plan = plan_of(ahead, state_with(ahead))
    assert types_of(ahead, plan) in time_loop.overloads
    assert all(entry.kinds in entry.kernel.overloads for entry in plan.apart if entry.kernel)


def functions_of(kernel, known: dict) -> dict:
    """A kernel and all that it calls of netfall, by their names."""
    function = getattr(kernel, "py_func", kernel)
    known[f"{function.__module__}.{function.__qualname__}"] = function
    for name in function.__code__.co_names:
        called = function.__globals__.get(name)
        called = getattr(called, "py_func", called)
        ours = inspect.isfunction(called) and called.__module__.startswith("netfall")
        if ours and f"{called.__module__}.{called.__qualname__}" not in known:
            functions_of(called, known)
    return known


OF_AXES = {"spring", "spring_zero", "load_before", "load_after", "wind", "drag"}  # not read of the halo
READS = [
    ((kick_chunk,), KICKED, set()),
    ((pack, unpack), EXCHANGED, OF_AXES),
    ((break_elements,), BREAKING, set()),
]


@pytest.mark.parametrize("kernels, fields, besides", READS, ids=["kick", "exchange", "fracture"])
def test_kernels_that_scenes_share_are_given_all_that_they_read(kernels, fields, besides):
    """A field that is not given is None, and what a kernel does with it would be left out in silence."""
    read = set()
    for one in kernels:
        for function in functions_of(one, {}).values():
            read |= set(re.findall(r"\bparticles\.(\w+)", inspect.getsource(function)))
    assert (read & set(Particles._fields)) - besides == set(fields)


def test_what_others_compile_works_beside_the_kernels():
    """Whoever uses numba in the same process has all of it: what is left out is left out of kernels alone."""
    if not hasattr(time_loop, "overloads"):
        pytest.skip("kernels run as plain Python")

    @numba.njit
    def largest(n):
        return np.sort(np.zeros(n))[-1]

    assert largest(3) == 0.0
    with pytest.raises(ValueError, match="negative dimensions"):
        largest(-1)


def test_scenes_that_differ_in_what_the_step_alone_reads_share_the_kernels_of_a_moment():
    """Losses, several strengths, several yield forces: elements and law have the types of one scene."""
    scenes = [
        Features(plastic=True, fracture=True),
        Features(plastic=True, fracture=True, losses=True, bars=True),
        Features(plastic=True, fracture=True, strengths=True, sections=True),
    ]
    states = [state_with(Ahead(features, False, False)) for features in scenes]
    assert len({numba.typeof(state.of_a_moment) for state in states}) == 1
    assert len({numba.typeof((state.elements, state.law)) for state in states}) == 3


class Pair(NamedTuple):
    a: np.ndarray
    b: np.ndarray


class Nested(NamedTuple):
    pair: Pair
    absent: None
    factor: float


@kernel
def add_pair(pair, sums):
    for i in range(len(sums)):
        sums[i] += pair.a[i] + pair.b[i]


@allocating_kernel
def sum_of(nested):
    if nested.absent is not None:
        return nested.absent
    sums = np.zeros_like(nested.pair.a)
    for _ in range(3):
        add_pair(nested.pair, sums)
    return nested.factor * sums


def test_arrays_of_a_tuple_that_is_handed_on_have_as_many_owners_afterwards():
    """A kernel that counts them reads a tuple within a tuple by its address; by hand 2 x 3 x (1 + 10)."""
    nested = Nested(Pair(np.ones(4), np.full(4, 10.0)), None, 2.0)
    before = sys.getrefcount(nested.pair.a), sys.getrefcount(nested.pair.b)
    for _ in range(100):
        assert sum_of(nested).tolist() == [66.0] * 4
    assert (sys.getrefcount(nested.pair.a), sys.getrefcount(nested.pair.b)) == before


class Rules(NamedTuple):
    first: bool
    second: bool
    factor: float
    last: bool


class Whole(NamedTuple):
    nothing: None
    rules: Rules
    columns: tuple
    pair: Pair
    number: int


@kernel_apart
def write_sums(k, whole, sums):
    scale = whole.rules.factor if whole.rules.second and not whole.rules.first else 0.0
    sums[k] = scale * (whole.pair.a[1, 2] + whole.pair.b[k]) + whole.number + whole.columns[1][0]
    sums[k] += 1000.0 if whole.rules.last else 0.0


@kernel
def write_both(entry, whole, sums):
    if whole.nothing is None:
        for k in range(2):
            call(entry, k, whole, sums)


def test_a_kernel_called_by_its_address_reads_what_is_laid_down():
    """Numbers, truths, none, arrays in any order of memory: 3 (6 + 10) + 7 + 0.5 + 1000, and 11 for 10."""
    a = np.asfortranarray(np.arange(1.0, 7.0).reshape(2, 3))
    columns = np.array([0.25]), np.array([0.5])
    pair = Pair(a, np.array([10.0, 99.0, 11.0])[::2])
    whole, sums = Whole(None, Rules(False, True, 3.0, True), columns, pair, 7), np.zeros(2)
    entry = Entry(write_sums, 0, whole, sums)
    write_both(entry, laid(whole), sums)
    assert sums.tolist() == [1055.5, 1058.5]
    sums[:] = 0.0
    write_both(entry, whole, sums)  # as Python has it
    assert sums.tolist() == [1055.5, 1058.5]
