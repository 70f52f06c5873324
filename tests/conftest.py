"""Shared helpers of the tests: run netfall like a user, on any number of ranks, from job texts and tables."""

import contextlib
import gc
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from results import Report, assert_same_results
from standing_ranks import StandingRanks
from validation_table import Comparison, Table

from netfall.core.cache import set_cache_folder
from netfall.core.errors import InputError, Interrupted

set_cache_folder()  # of compiled kernels, for this process and the processes that it starts
gc.set_threshold(1_000_000, 20, 100)  # similar to the command

# The environment before MPI starts in this process: with more variables mpirun fails silently.
# Ranks of two tests share the cores, so they do not wait in busy loops. Warnings are errors, as in the tests.
# Python keeps its byte code in any case, because compiling it takes a quarter of each start of netfall.
ENVIRONMENT = os.environ | {
    "OMPI_MCA_mpi_yield_when_idle": "1",
    "PYTHONWARNINGS": "error",
    "PYTHONDONTWRITEBYTECODE": "",
}
ROOT = Path(__file__).resolve().parents[1]
BIN = ROOT / ".venv" / "bin"
UNCOMPILED = ROOT / "tests" / "uncompiled"
IN_PLAIN_PYTHON = "uncompiled" in os.environ.get("PYTHONPATH", "")
# For processes whose kernels run as plain Python.
PLAIN = {"PYTHONPATH": os.pathsep.join([str(UNCOMPILED), os.environ.get("PYTHONPATH", "")])}

STEEL = """
[cable]
modulus = 1.95e11
area = 683.08e-6
density = 7850.0
prestress = 100e3
"""
BARE = STEEL.replace("prestress = 100e3\n", "")  # without prestress


def pytest_addoption(parser):
    parser.addoption("--long", action="store_true", help="also the tests that take minutes")
    parser.addoption("--slurm", action="store_true", help="also the tests under Slurm and on two hosts")
    parser.addoption("--table", help="write the comparisons of tests/validation to this file")


LEFT_OUT = {  # by the mark
    "long": "takes minutes",
    "slurm": "starts Slurm or virtual hosts, as root",
}

# Workers take files from this list, the longest first, so that all end together; then the others.
# Files with runs on three ranks are between others, because ranks of two tests wait for each other.
LONGEST_FIRST = [
    *("redistribution", "odd_results", "processors", "loads", "study", "output", "restart", "study_runs"),
    *("report", "erection", "changes_of_form", "hazard", "slipping", "fracture", "random_nets", "dynamics"),
    *("bending", "slide", "stage_supports", "removal", "parallel", "full_disks", "compile"),
    *("measured", "buckling", "readme", "turned_supports"),
]
ANY_TIME = ["kernels", "page_examples"]  # their cases share nothing and fill the time at the end


def pytest_collection_modifyitems(config, items):
    """Skip tests whose option is not given. If there are several workers, start with the longest files."""
    for mark, reason in LEFT_OUT.items():
        if not config.getoption(f"--{mark}"):
            for item in items:
                if mark in item.keywords:
                    item.add_marker(pytest.mark.skip(reason=f"{reason}; --{mark} runs it"))
    if is_worker(config):
        items.sort(key=lambda item: start_order(item.path.stem.removeprefix("test_")))


def is_worker(config) -> bool:
    """Return whether this process is one of several of `pytest -n`."""
    return hasattr(config, "workerinput")


def start_order(name: str) -> int:
    """Return the position of a file in the order of starts."""
    if name in LONGEST_FIRST:
        return LONGEST_FIRST.index(name)
    return len(LONGEST_FIRST) + (name in ANY_TIME)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Distribute whole files, whose tests share compiled code and results, or single cases of ANY_TIME."""
    from xdist.scheduler import LoadScopeScheduling

    class ByFile(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            file, _, test = nodeid.partition("::")
            _, _, case = test.partition("[")
            return case if case and Path(file).stem.removeprefix("test_") in ANY_TIME else file

    return ByFile(config, log)


def on_ranks(ranks: int) -> list[str]:
    """Return the start of a command line that runs a program on a number of ranks."""
    return [str(BIN / "mpirun"), "-n", str(ranks)] if ranks > 1 else []


def run_netfall(*arguments, ranks=1, cwd=None, timeout=300, environment=None, code=0):
    """Run netfall in a new process with extra environment variables; return the finished process. code :
    expected exit code, None: any
    """
    line = [*on_ranks(ranks), BIN / "netfall", *arguments]
    return run_process(
        *line, cwd=cwd, timeout=timeout, environment=ENVIRONMENT | (environment or {}), code=code
    )


def run_process(*line, cwd=None, timeout=300, environment=ENVIRONMENT, code=0) -> subprocess.CompletedProcess:
    """Run a command in a new process; return the finished process. code : expected, None: any"""
    streams = dict(capture_output=True, text=True, stdin=subprocess.DEVNULL)
    done = subprocess.run([*map(str, line)], cwd=cwd, env=environment, timeout=timeout, **streams)
    assert code is None or done.returncode == code, (done.returncode, done.stdout + done.stderr)
    return done


def start_run(job: Path, output: Path, ranks: int = 1) -> subprocess.Popen:
    """Start a run in new processes; return it when its dynamic stage has begun."""
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    line = [*on_ranks(ranks), str(BIN / "netfall"), "run", str(job), "-o", str(output)]
    process = subprocess.Popen(line, env=ENVIRONMENT, text=True, **pipes)
    while "dynamics:" not in process.stdout.readline():
        assert process.poll() is None, process.stderr.read()
    return process


def children_of(pid: int, word: bytes) -> list[int]:
    """Return the children of a process whose command line contains a word."""
    children = []
    with contextlib.suppress(OSError):  # of processes that have ended
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
            if word in Path(f"/proc/{child}/cmdline").read_bytes():
                children.append(int(child))
    return children


def wait_for(condition) -> None:
    """Wait until a condition holds. Fail after two minutes."""
    end = time.monotonic() + 120
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


STANDING = {}  # by the number of ranks


def run_on_standing_ranks(*arguments, ranks=1, cwd=None, timeout=300, environment=None, code=0):
    """Run netfall like `run_netfall`, on ranks that persist. Starting new ones takes 2 s of a core each."""
    if ranks not in STANDING:
        STANDING[ranks] = StandingRanks([*on_ranks(ranks), BIN / "python"], ENVIRONMENT)
    done = STANDING[ranks].run(*arguments, cwd=cwd, timeout=timeout, environment=environment)
    assert code is None or done.returncode == code, (done.returncode, done.stdout + done.stderr)
    return done


@contextlib.contextmanager
def standing_runs_of_python():
    """Let `netfall.run` use ranks that persist, instead of processes that it starts."""

    def run(job, output, folder, settings, ranks, quiet):
        words = [word for setting in settings for word in ("--set", setting)]
        run_on_standing_ranks("run", job, *words, "-o", output, "--quiet", ranks=ranks)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("netfall.api.run._run_in_processes", run)
        yield


def lines_with(words: str, *command, **how) -> list[str]:
    """Return the lines in the output of a command that contain a text."""
    lines = run_on_standing_ranks(*command, **how).stdout.splitlines()
    return [line for line in lines if words in line]


def refused(*arguments, run=run_on_standing_ranks, **more) -> str:
    """Return the only error of a command that must fail. Warnings may precede it."""
    lines = run(*arguments, **more, code=2).stderr.splitlines()
    (line,) = [line for line in lines if not line.startswith("warning: ")]
    return line


def error_lines(of, *given, **how) -> list[str]:
    """Return the lines of the InputError that a function raises."""
    with pytest.raises(InputError) as raised:
        of(*given, **how)
    return raised.value.lines


class Workshop:
    """A folder with job files and their results."""

    def __init__(self, folder: Path, standing: bool = False):
        """standing : whether jobs run on ranks that persist"""
        self.folder, self.standing = folder, standing

    def job(self, text: str, nodes: str = "", elements: str = "", name: str = "job") -> Path:
        """Write a job file, and tables where given."""
        if nodes:
            (self.folder / "nodes.csv").write_text(nodes)
            (self.folder / "elements.csv").write_text(elements)
            text = '[net]\nnodes = "nodes.csv"\nelements = "elements.csv"\n' + text
        path = self.folder / f"{name}.toml"
        path.write_text(text)
        return path

    def run(self, job: Path, *arguments, ranks=1, output="result.vtkhdf", code=0, environment=None):
        """Run a job; its result file, open, or the finished process. A code of None is not checked."""
        line = ["run", job, "-o", self.folder / output, *arguments]
        run = run_on_standing_ranks if self.standing and environment is not PLAIN else run_netfall
        done = run(*line, ranks=ranks, cwd=self.folder, environment=environment, code=code)
        return self.open(output) if code == 0 else done

    def solve(self, text: str, nodes: str = "", elements: str = "", *arguments, name="job", **how):
        """Write a job and run it: as `job` and `run`."""
        return self.run(self.job(text, nodes, elements, name), *arguments, **how)

    def run_exported(self) -> tuple[h5py.File, list[str]]:
        """Export the result and run the exported job; return its open result and the lines of the export."""
        lines = self.export()
        return self.run(self.folder / "t.csv" / "job.toml", output="again.vtkhdf"), lines

    def export(self) -> list[str]:
        """Export the tables of the result to t.csv; return the lines of the export."""
        from netfall.exchange.export import export

        lines = []
        export(self.folder / "result.vtkhdf", self.folder / "t.csv", lines.append)
        return lines

    def run_here(self, job: Path, output="result.vtkhdf", **how) -> h5py.File:
        """Run a job in this process without output; return its result file, open."""
        from netfall.core.progress import Progress
        from netfall.driver.run import run_job
        from netfall.job.read import read_job
        from netfall.parallel.mpi import MPI

        run_job(MPI.COMM_SELF, read_job(job), self.folder / output, Progress(False, False), **how)
        return self.open(output)

    def pause(self, job: Path, stop, output="result.vtkhdf") -> tuple[Path, str]:
        """Start a job in this process and stop it; return its checkpoint and the message. stop : a stop flag,
        or the number of checks after which it is set
        """
        stop = StopAfter(stop) if isinstance(stop, int) else stop
        with pytest.raises(Interrupted) as raised:
            self.run_here(job, output, stop=stop)
        (checkpoint,) = self.folder.glob(f"{output.partition('.')[0]}.checkpoint*")
        return checkpoint, str(raised.value)

    def assert_pause_changes_no_bit(self, job: Path, stop, words: str, whole=None) -> None:
        """Compare a run with one that pauses and resumes on two ranks. words : pattern of the message"""
        whole = whole or self.run(job, output="whole.vtkhdf")
        checkpoint, message = self.pause(job, stop)
        assert re.search(words, message), message
        assert_same_results(whole, self.run(job, "--restart", checkpoint, ranks=2))

    def printed(self, job: Path, *arguments, output="result.vtkhdf", **how) -> str:
        """Run a job and return its output."""
        return run_on_standing_ranks("run", job, "-o", self.folder / output, *arguments, **how).stdout

    def check(self, job: Path, *arguments) -> str:
        """Return the output of `netfall check`."""
        return run_on_standing_ranks("check", job, *arguments, cwd=self.folder).stdout

    def info(self, result="result.vtkhdf") -> str:
        """Return the output of `netfall info`."""
        return run_on_standing_ranks("info", self.folder / result).stdout

    def report(self, result="result.vtkhdf", folder="report", pictures: bool = False, **options) -> Report:
        """Write the report of a result and return it. Pictures take longest and are omitted by default."""
        from netfall.post.report import report

        with pytest.MonkeyPatch.context() as patch:
            if not pictures:
                patch.setattr(report, "_pictures", lambda *_: [])
            report.write_report(self.folder / result, self.folder / folder, **options)
        return Report(self.folder / folder)

    def open(self, output: str = "result.vtkhdf") -> h5py.File:
        """Open a result file."""
        return h5py.File(self.folder / output)


class StopAfter:
    """A stop flag that is set after a number of checks."""

    def __init__(self, checks: int):
        """checks : number of checks before it is set"""
        self.left = checks

    @property
    def is_set(self) -> bool:
        self.left -= 1
        return self.left < 0


def can_use_standing_ranks(request) -> bool:
    """Return whether the jobs of a test may run on ranks that persist."""
    return request.node.get_closest_marker("processes") is None


@pytest.fixture
def workshop(tmp_path, request):
    return Workshop(tmp_path, can_use_standing_ranks(request))


class BothWays(Workshop):
    """A workshop that runs each job on one rank and on several, and compares all bits."""

    def run(self, job: Path, *arguments, ranks=2, output="result.vtkhdf", code=0):
        """Run a job on one rank and on `ranks`; the result file, open, if both are equal to the bit."""
        one = super().run(job, *arguments, output=output, code=code)
        if code == 0 and ranks > 1:
            with super().run(job, *arguments, ranks=ranks, output=f"ranks-{output}") as several:
                assert_same_results(one, several)
        return one


@pytest.fixture(autouse=True)
def close_figures():
    """Close figures that a test has drawn but not saved: matplotlib warns of more than 20."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.fixture
def both_ways(tmp_path, request):
    """Run each job of a validation on one rank and on two, unless the test sets a number."""
    return BothWays(tmp_path, True)


TABLES = {}  # by the file of the tests


@pytest.fixture
def compare(request):
    """Return a function that makes a `Comparison`, which asserts a value and adds a row to the table."""
    table, of_file = TABLES.setdefault(request.path.name, Table()), getattr(request.module, "THEME", "")
    return lambda case, source, theme=of_file: Comparison(table, theme, case, source)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node):
    """Collect the rows of a worker."""
    for name, rows in node.workeroutput.get("tables", {}).items():
        TABLES[name] = Table(rows)


def pytest_sessionfinish(session):
    """Stop the ranks. Write the table of comparisons if requested, or pass it to the main process."""
    for ranks in STANDING.values():
        ranks.stop()
    if is_worker(session.config):
        session.config.workeroutput["tables"] = {name: table.plain() for name, table in TABLES.items()}
    elif session.config.getoption("--table"):
        rows = [row for _, table in sorted(TABLES.items()) for row in table.plain()]
        Table(rows).write(Path(session.config.getoption("--table")))


@pytest.fixture(scope="module")
def shared_workshop(tmp_path_factory, request):
    """Return one folder for all tests of a file."""
    return Workshop(tmp_path_factory.mktemp("shared"), can_use_standing_ranks(request))


def assert_same_bits_on(ranks: int, job: Path, one: h5py.File, workshop, name: str) -> None:
    """Check results on several ranks, also resumed from the first checkpoint of NAME on one rank."""
    with workshop.run(job, ranks=ranks, output=f"{name}{ranks}.vtkhdf") as several:
        assert_same_results(one, several)
    checkpoint = sorted(workshop.folder.glob(f"{name}.checkpoint-*"))[0]
    with workshop.run(job, "--restart", checkpoint, ranks=ranks, output=f"again{ranks}.vtkhdf") as again:
        assert_same_results(one, again)


def audits(f) -> np.ndarray:
    """Return the largest errors of the work identity and of the energy balance in a history."""
    return np.array([np.abs(f[f"history/{of}_error"][:]).max() for of in ("work_identity", "energy_balance")])
