"""The package as users install it: a wheel, in an environment of its own, away from the checkout."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest
from conftest import ENVIRONMENT, ROOT

import netfall
from netfall.core.extras import EXTRA_OF_PACKAGE, EXTRAS

BUILT_FROM = ("pyproject.toml", "README.md", "LICENSE", "src")


def run(*command, cwd: Path, warnings: str = "error") -> str:
    """What a command prints; it has to succeed. warnings : what becomes of those of Python"""
    own = {name: value for name, value in ENVIRONMENT.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(
        [*map(str, command)],
        cwd=cwd,
        env=own | {"PYTHONWARNINGS": warnings},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, (command, done.stdout, done.stderr)
    return done.stdout


def pip(*arguments, cwd: Path) -> None:
    """pip of this environment, which has warnings of its own."""
    command = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check")
    run(*command, *arguments, cwd=cwd, warnings="ignore")


def built_wheel(folder: Path) -> Path:
    """The wheel of the sources, built from a copy so that the checkout stays as it is."""
    copy = folder / "sources"
    leave_out = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for name in BUILT_FROM:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, copy / name, ignore=leave_out)
        else:
            copy.mkdir(exist_ok=True)
            shutil.copy(ROOT / name, copy / name)
    pip("wheel", "--no-deps", "--no-build-isolation", "-w", folder, copy, cwd=folder)
    return next(folder.glob("netfall-*.whl"))


def installed(wheel: Path, folder: Path) -> Path:
    """The programs of a new environment with the wheel; what it depends on is that of this one."""
    environment = folder / "environment"
    run(sys.executable, "-m", "venv", "--without-pip", environment, cwd=folder)
    python = environment / "bin" / "python"
    site = Path(
        run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder).strip()
    )
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    pip("--python", python, "install", "--no-deps", "--no-index", wheel, cwd=folder)
    return environment / "bin"


@pytest.mark.parametrize("package, extra", [("matplotlib", "plot"), ("ezdxf", "cad"), ("vtkmodules", "cad")])
def test_a_missing_package_is_told_with_the_extra_that_brings_it(tmp_path, package, extra):
    """By the command that needs it: exit code 2, one line, no traceback; the program itself starts."""
    (tmp_path / "a.dxf").touch()
    (tmp_path / "a.vtu").touch()
    words = {"matplotlib": ["plot", "a.vtkhdf"], "ezdxf": ["import", "a.dxf", "-o", "a"]}
    words["vtkmodules"] = ["import", "a.vtu", "-o", "a"]
    script = f"import sys; sys.modules[{package!r}] = None; from netfall.__main__ import main; main()"
    command = [sys.executable, "-c", script, *words[package]]
    done = subprocess.run(command, cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True)
    advice = (
        f"error: needs {package}, which is not installed; get it with: pip install 'netfall[{extra}]' [E003]"
    )
    assert (done.returncode, done.stderr.strip()) == (2, advice)


def test_every_extra_is_one_of_the_package():
    """What pyproject.toml calls extras, and no compute node needs what they bring."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert {*EXTRAS} <= {*project["optional-dependencies"]}
    assert [one for one in project["dependencies"] if re.match(r"[\w]+", one)[0] in EXTRA_OF_PACKAGE] == []


@pytest.mark.long
def test_an_installed_wheel_runs_a_job(tmp_path):
    """Built and installed, netfall writes, checks, runs and reports a job with nothing of the checkout."""
    wheel = built_wheel(tmp_path)
    with zipfile.ZipFile(wheel) as packed:
        names = set(packed.namelist())
    files = [*(ROOT / "src").rglob("*.toml"), *(ROOT / "src" / "netfall" / "docs" / "pages").rglob("*.*")]
    assert len(files) > 20 and {path.relative_to(ROOT / "src").as_posix() for path in files} <= names
    programs = installed(wheel, tmp_path)
    here = tmp_path / "elsewhere"
    here.mkdir()
    where = run(programs / "python", "-c", "import netfall; print(netfall.__file__)", cwd=here)
    assert where.startswith(str(tmp_path / "environment") + os.sep)
    command = programs / "netfall"
    assert run(command, "--version", cwd=here).startswith(f"netfall {netfall.__version__},")
    run(command, "init", "roof.toml", cwd=here)
    assert "roof.toml" in run(command, "check", "roof.toml", cwd=here)
    run(command, "run", "roof.toml", "--set", "dynamics.duration=0.1", "-o", "roof.vtkhdf", cwd=here)
    assert "dynamics" in run(command, "info", "roof.vtkhdf", cwd=here)
    run(command, "report", "roof.vtkhdf", cwd=here)
    assert "mean wind speed" in run(command, "docs", "wind.speed", cwd=here)
    assert "EN 1993-1-11" in (here / "roof-report" / "summary.md").read_text()
