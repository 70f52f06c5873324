"""What the tests share: running netfall as a user does, on any number of ranks, from job texts and tables."""

import contextlib
import gc
import os
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

set_cache_folder()  # of compiled kernels: here, and in what is started
gc.set_threshold(1_000_000, 20, 100)  # as the command

# As it was before any MPI start-up in this process: mpirun fails silently with more.
# Ranks of two tests share the cores, so they do not wait in busy loops. Warnings are errors, as in the tests.
# What Python makes of its sources is kept, whatever is asked for: that is a quarter of each start of netfall.
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


def pytest_addoption(parser):
    parser.addoption("--long", action="store_true", help="also the tests that take minutes")
    parser.addoption("--slurm", action="store_true", help="also the tests under Slurm and on two hosts")
    parser.addoption("--table", help="write the comparisons of tests/validation to this file")


LEFT_OUT = {  # by the mark
    "long": "takes minutes",
    "slurm": "starts Slurm or hosts of its own, as root",
}

# Workers take files from this list in turn, the longest first so that all end together; then the others.
# Files with runs on three ranks stand between others: ranks of two tests wait for one another.
LONGEST_FIRST = [
    *("redistribution", "odd_results", "processors", "loads", "study", "output", "restart", "study_runs"),
    *("report", "erection", "changes_of_form", "hazard", "slipping", "fracture", "random_nets", "dynamics"),
    *("bending", "slide", "stage_supports", "removal", "parallel", "full_disks", "compile"),
    *("measured", "buckling", "readme", "turned_supports"),
]
ANY_TIME = ["kernels", "page_examples"]  # their cases share nothing and fill what is left at the end


def pytest_collection_modifyitems(config, items):
    """Leave out what is not asked for; begin with what takes longest where there are several workers."""
    for mark, reason in LEFT_OUT.items():
        if not config.getoption(f"--{mark}"):
            for item in items:
                if mark in item.keywords:
                    item.add_marker(pytest.mark.skip(reason=f"{reason}; --{mark} runs it"))
    if on_worker(config):
        items.sort(key=lambda item: turn_of(item.path.stem.removeprefix("test_")))


def on_worker(config) -> bool:
    """Whether this process is one of several of `pytest -n`."""
    return hasattr(config, "workerinput")


def turn_of(name: str) -> int:
    """When the tests of a file begin."""
    if name in LONGEST_FIRST:
        return LONGEST_FIRST.index(name)
    return len(LONGEST_FIRST) + (name in ANY_TIME)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Hand out whole files, whose tests share compiled code and results; of some, whole cases."""
    from xdist.scheduler import LoadScopeScheduling

    class ByFile(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            file, _, test = nodeid.partition("::")
            _, _, case = test.partition("[")
            return case if case and Path(file).stem.removeprefix("test_") in ANY_TIME else file

    return ByFile(config, log)


def on_ranks(ranks: int) -> list[str]:
    """The start of a command line that starts something on some ranks."""
    return [str(BIN / "mpirun"), "-n", str(ranks)] if ranks > 1 else []


def run_netfall(*arguments, ranks=1, cwd=None, timeout=300, environment=None, code=0):
    """netfall on some ranks, with more variables in its environment: the finished process and its output.

    code : with which it has to end; None: any
    """
    line = [*on_ranks(ranks), BIN / "netfall", *arguments]
    return run_process(
        *line, cwd=cwd, timeout=timeout, environment=ENVIRONMENT | (environment or {}), code=code
    )


def run_process(*line, cwd=None, timeout=300, environment=ENVIRONMENT, code=0) -> subprocess.CompletedProcess:
    """A process of its own, finished, and its output. code : with which it has to end; None: any"""
    streams = dict(capture_output=True, text=True, stdin=subprocess.DEVNULL)
    done = subprocess.run([*map(str, line)], cwd=cwd, env=environment, timeout=timeout, **streams)
    assert code is None or done.returncode == code, (done.returncode, done.stdout + done.stderr)
    return done


def begun(job: Path, output: Path, ranks: int = 1) -> subprocess.Popen:
    """A run with processes of its own, whose dynamic stage has begun."""
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    line = [*on_ranks(ranks), str(BIN / "netfall"), "run", str(job), "-o", str(output)]
    process = subprocess.Popen(line, env=ENVIRONMENT, text=True, **pipes)
    while "dynamics:" not in process.stdout.readline():
        assert process.poll() is None, process.stderr.read()
    return process


def wait_for(there) -> None:
    """Until something is there; a failure after two minutes."""
    end = time.monotonic() + 120
    while not there():
        assert time.monotonic() < end
        time.sleep(0.02)


STANDING = {}  # by their number


def run_on_standing_ranks(*arguments, ranks=1, cwd=None, timeout=300, environment=None, code=0):
    """The same without the start of processes, some 2 s of a core for each: by ranks that stay."""
    if ranks not in STANDING:
        STANDING[ranks] = StandingRanks([*on_ranks(ranks), BIN / "python"], ENVIRONMENT)
    done = STANDING[ranks].run(*arguments, cwd=cwd, timeout=timeout, environment=environment)
    assert code is None or done.returncode == code, (done.returncode, done.stdout + done.stderr)
    return done


@contextlib.contextmanager
def standing_runs_of_python():
    """`netfall.run` on ranks that stay, instead of processes that it starts."""

    def run(place, settings, ranks, quiet):
        words = [word for setting in settings for word in ("--set", setting)]
        run_on_standing_ranks("run", place.job, *words, "-o", place.output, "--quiet", ranks=ranks)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("netfall.api.run._run_in_processes", run)
        yield


def lines_with(words: str, *command, **how) -> list[str]:
    """The lines of the output of a command that have these words."""
    lines = run_on_standing_ranks(*command, **how).stdout.splitlines()
    return [line for line in lines if words in line]


def refused(*arguments, run=run_on_standing_ranks, **more) -> str:
    """The one error with which netfall refuses what is wrong; warnings may come before it."""
    lines = run(*arguments, **more, code=2).stderr.splitlines()
    (line,) = [line for line in lines if not line.startswith("warning: ")]
    return line


def error_lines(of, *given, **how) -> list[str]:
    """The lines of the error with which a function refuses what is wrong."""
    with pytest.raises(InputError) as raised:
        of(*given, **how)
    return raised.value.lines


class Workshop:
    """A folder with job files and what came of them."""

    def __init__(self, folder: Path, standing: bool = False):
        """standing : jobs run on ranks that stay"""
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

    def run_here(self, job: Path, output="result.vtkhdf", **how) -> h5py.File:
        """Run a job in this process, silently; its result file, open."""
        from netfall.core.progress import Progress
        from netfall.driver.run import run_job
        from netfall.job.read import read_job
        from netfall.parallel.mpi import MPI

        run_job(MPI.COMM_SELF, read_job(job), self.folder / output, Progress(False, False), **how)
        return self.open(output)

    def pause(self, job: Path, stop, output="result.vtkhdf") -> tuple[Path, str]:
        """Begin a job in this process and stop it; the checkpoint that it leaves, and what is said then.

        stop : a wish to stop, or after how many looks there is one
        """
        stop = StopAfter(stop) if isinstance(stop, int) else stop
        with pytest.raises(Interrupted) as raised:
            self.run_here(job, output, stop=stop)
        (checkpoint,) = self.folder.glob(f"{output.partition('.')[0]}.checkpoint*")
        return checkpoint, str(raised.value)

    def said(self, job: Path, *arguments, output="result.vtkhdf", **how) -> str:
        """What a run of a job prints."""
        return run_on_standing_ranks("run", job, "-o", self.folder / output, *arguments, **how).stdout

    def check(self, job: Path, *arguments) -> str:
        """What `netfall check` tells of a job."""
        return run_on_standing_ranks("check", job, *arguments, cwd=self.folder).stdout

    def info(self, result="result.vtkhdf") -> str:
        """What `netfall info` tells of a result."""
        return run_on_standing_ranks("info", self.folder / result).stdout

    def report(self, result="result.vtkhdf", folder="report", pictures: bool = False, **options) -> Report:
        """The report of a result; without its pictures, which take longer than all the rest, if not asked."""
        from netfall.post.report import report

        with pytest.MonkeyPatch.context() as patch:
            if not pictures:
                patch.setattr(report, "_pictures", lambda *_: [])
            report.write_report(self.folder / result, self.folder / folder, **options)
        return Report(self.folder / folder)

    def open(self, output: str = "result.vtkhdf") -> h5py.File:
        """A result file."""
        return h5py.File(self.folder / output)


class StopAfter:
    """A wish to stop that comes with a certain look."""

    def __init__(self, looks: int):
        """looks : so many without the wish"""
        self.left = looks

    @property
    def is_set(self) -> bool:
        self.left -= 1
        return self.left < 0


def may_stand(request) -> bool:
    """Whether the jobs of a test may run on ranks that stay."""
    return request.node.get_closest_marker("processes") is None


@pytest.fixture
def workshop(tmp_path, request):
    return Workshop(tmp_path, may_stand(request))


class BothWays(Workshop):
    """A workshop whose jobs run on one rank and on several, with the same bits."""

    def run(self, job: Path, *arguments, ranks=2, output="result.vtkhdf", code=0):
        """Run a job on one rank and on `ranks`; the result file, open, if both are equal to the bit."""
        one = super().run(job, *arguments, output=output, code=code)
        if code == 0 and ranks > 1:
            with super().run(job, *arguments, ranks=ranks, output=f"ranks-{output}") as several:
                assert_same_results(one, several)
        return one


@pytest.fixture(autouse=True)
def no_figures_left():
    """Close the pictures that a test has drawn and not stored: matplotlib warns of more than 20."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.fixture
def both_ways(tmp_path, request):
    """For validation: each job on one rank and on two, where a test does not ask for more."""
    return BothWays(tmp_path, True)


TABLES = {}  # by the file whose tests made the rows


@pytest.fixture
def compare(request):
    """`Comparison` by case and source, of the theme of the file: asserted, and a row of the table."""
    table, of_file = TABLES.setdefault(request.path.name, Table()), getattr(request.module, "THEME", "")
    return lambda case, source, theme=of_file: Comparison(table, theme, case, source)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node):
    """Take over the rows that a worker has made."""
    for name, rows in node.workeroutput.get("tables", {}).items():
        TABLES[name] = Table(rows)


def pytest_sessionfinish(session):
    """Let the ranks go; write the table of comparisons where asked, or hand it to the process that does."""
    for ranks in STANDING.values():
        ranks.stop()
    if on_worker(session.config):
        session.config.workeroutput["tables"] = {name: table.plain() for name, table in TABLES.items()}
    elif session.config.getoption("--table"):
        rows = [row for _, table in sorted(TABLES.items()) for row in table.plain()]
        Table(rows).write(Path(session.config.getoption("--table")))


@pytest.fixture(scope="module")
def shared_workshop(tmp_path_factory, request):
    """One folder for the tests of a file."""
    return Workshop(tmp_path_factory.mktemp("shared"), may_stand(request))


def assert_same_bits_on(ranks: int, job: Path, one: h5py.File, workshop, name: str) -> None:
    """On so many ranks, and on these again from the first checkpoint of one rank's run, name.vtkhdf."""
    with workshop.run(job, ranks=ranks, output=f"{name}{ranks}.vtkhdf") as several:
        assert_same_results(one, several)
    kept = sorted(workshop.folder.glob(f"{name}.checkpoint-*"))[0]
    with workshop.run(job, "--restart", kept, ranks=ranks, output=f"again{ranks}.vtkhdf") as again:
        assert_same_results(one, again)


def audits(f) -> np.ndarray:
    """The largest errors in a history: of the work identity, and of the balance of energy."""
    return np.array([np.abs(f[f"history/{of}_error"][:]).max() for of in ("work_identity", "energy_balance")])
