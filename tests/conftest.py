"""What the tests share: running netfall as a user does, on any number of ranks, from job texts and tables."""

import os
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest
from validation_table import Table

ENVIRONMENT = dict(
    os.environ
)  # as it was before any MPI start-up in this process: mpirun fails silently with more
ROOT = Path(__file__).resolve().parents[1]
BIN = ROOT / ".venv" / "bin"

STEEL = """
[cable]
modulus = 1.95e11
area = 683.08e-6
density = 7850.0
prestress = 100e3
"""


def pytest_addoption(parser):
    parser.addoption("--long", action="store_true", help="also the tests that take minutes")
    parser.addoption("--table", help="write the comparisons of tests/validation to this file")


def pytest_collection_modifyitems(config, items):
    if not config.getoption("--long"):
        for item in items:
            if "long" in item.keywords:
                item.add_marker(pytest.mark.skip(reason="takes minutes; --long runs it"))


def run_netfall(*arguments, ranks=1, cwd=None, timeout=300, environment=None):
    """netfall with arguments on some ranks, and more variables in its environment: the finished process, output captured."""
    command = [str(BIN / "netfall"), *map(str, arguments)]
    if ranks > 1:
        command = [str(BIN / "mpirun"), "-n", str(ranks), *command]
    return subprocess.run(
        command,
        cwd=cwd,
        env=ENVIRONMENT | (environment or {}),
        capture_output=True,
        text=True,
        timeout=timeout,
        stdin=subprocess.DEVNULL,
    )


class Workshop:
    """A folder with job files and what came of them."""

    def __init__(self, folder: Path):
        self.folder = folder

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
        """Run a job; its result file, open, or the finished process; the exit code is checked, unless it is None."""
        done = run_netfall(
            "run",
            job,
            "-o",
            self.folder / output,
            *arguments,
            ranks=ranks,
            cwd=self.folder,
            environment=environment,
        )
        assert code is None or done.returncode == code, done.stdout + done.stderr
        return self.open(output) if code == 0 else done

    def open(self, output: str = "result.vtkhdf") -> h5py.File:
        """A result file."""
        return h5py.File(self.folder / output)


@pytest.fixture
def workshop(tmp_path):
    return Workshop(tmp_path)


class BothWays(Workshop):
    """A workshop whose jobs run on one rank and on several, with the same bits."""

    def run(self, job: Path, *arguments, ranks=3, output="result.vtkhdf", code=0):
        """Run a job on one rank and on `ranks`; the result file, open, after checking that both are equal to the bit."""
        one = super().run(job, *arguments, output=output, code=code)
        if code == 0 and ranks > 1:
            with super().run(job, *arguments, ranks=ranks, output=f"ranks-{output}") as several:
                assert_same_results(one, several)
        return one


@pytest.fixture
def both_ways(tmp_path):
    """For validation: each job on one rank and on three."""
    return BothWays(tmp_path)


TABLE = Table()


@pytest.fixture
def compare():
    """`Table.compare`: a figure beside an independent one, asserted, and a row of the table that `--table FILE` writes."""
    return TABLE.compare


def pytest_sessionfinish(session):
    """Write the table of comparisons where asked."""
    if session.config.getoption("--table"):
        TABLE.write(Path(session.config.getoption("--table")))


@pytest.fixture(scope="session")
def shared_workshop(tmp_path_factory):
    return Workshop(tmp_path_factory.mktemp("shared"))


def assert_same_results(one: h5py.File, other: h5py.File) -> int:
    """Every dataset but those of /provenance is equal to the last bit; how many there were."""
    names = lambda f: {name for name in _datasets(f) if not name.startswith("provenance")}
    assert names(one) == names(other)
    for name in names(one):
        a, b = one[name][()], other[name][()]
        bits = lambda values: (
            np.asarray(values).tolist()
            if np.asarray(values).dtype == object
            else np.asarray(values).tobytes()
        )
        assert np.shape(a) == np.shape(b) and bits(a) == bits(b), name
    return len(names(one))


def _datasets(f):
    found = []
    f.visititems(lambda name, item: found.append(name) if isinstance(item, h5py.Dataset) else None)
    return found
