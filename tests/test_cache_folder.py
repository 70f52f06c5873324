"""The folder of compiled kernels, and the process that compiles while others wait."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import ENVIRONMENT
from mpi4py import MPI

from netfall.cli.parser import read_command
from netfall.core import cache
from netfall.core.errors import InputError
from netfall.core.timings import StopFlag
from netfall.driver import compile as compiling


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Return a package with a kernel and other code, without a configured folder."""
    package = tmp_path / "netfall"
    texts = {
        "physics/law.py": "LIMIT = 1.0\n",
        "explicit/loop.py": "@kernel\ndef loop(): pass\n",
        "post/report/page.py": "TITLE = ''\n",
    }
    for name, text in texts.items():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(text)
    monkeypatch.setattr(cache, "PACKAGE", package)
    monkeypatch.setattr(cache, "CONSTANTS", (f"{package / 'physics'}{os.sep}",))
    monkeypatch.setenv(cache.CACHE_VARIABLE, "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    return package


def chosen(given: str = "") -> Path:
    """Return the folder that a process chooses in an environment."""
    os.environ[cache.CACHE_VARIABLE] = given
    cache.set_cache_folder()
    return Path(os.environ[cache.CACHE_VARIABLE])


def test_changed_sources_have_another_folder(package):
    """For any kernel, and constants, because numba only checks the file of the called kernel."""
    first = chosen()
    assert first.is_dir() and first.parent == package / "__pycache__"
    (package / "post/report/page.py").write_text("TITLE = 'another'\n")
    assert chosen() == first
    folders, changed = {first}, {"explicit/loop.py": "@kernel\ndef loop(): return 1\n", "physics/law.py": ""}
    for name, text in (changed | {"explicit/more.py": "@inner_kernel\ndef more(): pass\n"}).items():
        (package / name).write_text(text)
        folders.add(chosen())
    assert len(folders) == 4


@pytest.mark.parametrize("name", ["NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"])
def test_another_processor_has_another_folder(package, monkeypatch, name):
    """Also one that numba is configured for, or that the system reports."""
    first = chosen()
    monkeypatch.setenv(name, "generic")
    assert chosen() != first
    monkeypatch.delenv(name)
    assert chosen() == first
    monkeypatch.setattr(cache, "processor", lambda: b"another")
    assert chosen() != first


def test_a_given_folder_contains_one_folder_for_all_processes(package, tmp_path):
    """A command passes its folder to the processes that it starts, which make none inside it."""
    first = chosen(str(tmp_path / "mine"))
    assert first.parent == tmp_path / "mine" and first.is_dir()
    assert chosen(str(first)) == first


def test_the_users_folder_is_used_if_the_package_is_read_only(package, tmp_path):
    """For example if another user has installed it; here files replace the folders."""
    (package / "__pycache__").write_text("")
    (tmp_path / "full").write_text("")
    assert chosen().parent == chosen(str(tmp_path / "full")).parent == tmp_path / "home" / "netfall"


def test_folders_of_old_sources_are_removed(package):
    """Only folders are removed that no command has used for a month, because a run may take long."""
    first, names = chosen(), ("netfall-" + "0" * 16, "netfall-" + "1" * 16, "netfall-notes", "other")
    old, young, *others = (first.parent / name for name in names)
    for path in (old, young, *others):
        path.mkdir()
        (path / "code.nbc").write_text("")
        days = cache.MAX_CACHE_AGE_DAYS + (-1 if path is young else 1)
        os.utime(path, (0, time.time() - 86400 * days))
    os.utime(first, (0, 0))
    assert chosen() == first and first.is_dir()
    assert [path.exists() for path in (old, young, *others)] == [False, True, True, True]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder without compiled code, in which compilation is only simulated."""
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(tmp_path))
    monkeypatch.setattr(compiling, "GROUPS", {})
    return tmp_path


HOLDS_ITS_TURN = """
from netfall.driver.compile import one_process_at_a_time
with one_process_at_a_time():
    print("there", flush=True)
    input()
"""


def test_one_process_compiles_at_a_time_and_others_do_not_hang(folder, monkeypatch):
    """A process stopped while it compiles delays others for a while, not forever."""
    monkeypatch.setattr(compiling, "COMPILE_PATIENCE", 0.5)
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    own = ENVIRONMENT | {cache.CACHE_VARIABLE: str(folder)}
    waited = []
    with subprocess.Popen([sys.executable, "-c", HOLDS_ITS_TURN], env=own, **pipes) as other:
        assert other.stdout.readline() == "there\n"
        for ended in (False, True):
            begin = time.monotonic()
            with compiling.one_process_at_a_time():
                waited.append(time.monotonic() - begin)
            if not ended:
                other.communicate("\n")
    assert waited[0] > 0.4 and waited[1] < 0.4


def test_a_compiled_folder_is_marked(folder):
    """For a version of numba and a processor, so that runs need not check all kernels."""
    assert not compiling.compiled_marker().exists()
    compiling.compile_all()
    assert [path for path in folder.iterdir() if path.is_file()] == [
        compiling.compiled_marker()
    ]  # numba has folders


def test_compile_needs_a_folder(folder, monkeypatch):
    """No folder is known, or it is not a folder: the command fails before it compiles."""
    for value in ("", str(folder / "none")):
        monkeypatch.setenv(cache.CACHE_VARIABLE, value)
        with pytest.raises(InputError, match="E042"):
            read_command(["compile"])()


@pytest.mark.parametrize(
    "error", ["OSError(28, 'No space left')", "RuntimeError('no locator available for x')"]
)
def test_an_error_in_the_cache_names_the_variable(error):
    """The folder is full, or cannot be written."""
    code = f"from netfall import __main__ as m\ndef fail(_): raise {error}\nm.read_command = fail\nm.main()"
    done = subprocess.run([sys.executable, "-c", code], env=ENVIRONMENT, capture_output=True, text=True)
    assert done.returncode == 1 and cache.CACHE_VARIABLE in done.stderr


def test_compilation_in_advance_ends_at_a_stop_signal(tmp_path, monkeypatch):
    """A job of Slurm has 30 s from its signal to its end; the kernels take a minute."""
    monkeypatch.setenv(cache.CACHE_VARIABLE, str(tmp_path))
    stop = StopFlag(signals=())
    stop.signal = "SIGTERM"
    compiling.compile_missing(MPI.COMM_SELF, stop)
    assert {path.name for path in tmp_path.iterdir()} == {"compiling"}


def test_an_interrupt_before_a_command_begins_is_a_plain_line():
    """Ctrl-C while netfall loads: nothing was computed, and there is no fault to look for."""
    code = "from netfall import __main__ as m\ndef stop(_): raise KeyboardInterrupt\n"
    code += "m.read_command = stop\nm.main()"
    done = subprocess.run([sys.executable, "-c", code], env=ENVIRONMENT, capture_output=True, text=True)
    assert done.returncode == 1 and done.stderr == "error: interrupted\n"


@pytest.mark.parametrize("ending", [".nbi", ".nbc", None])
def test_an_error_from_damaged_code_names_the_folder_to_remove(tmp_path, ending):
    """Numba lets errors of pickle through, which name no file, in each later run too. Others are not its."""
    (tmp_path / "kernel.py").write_text(
        "import numba\n@numba.njit(cache=True)\ndef f(x):\n    return x + 1\n"
    )
    code = "from netfall import __main__ as m\ndef work(_):\n    import kernel\n    kernel.f(1)\n"
    code += f"{'' if ending else '    raise EOFError'}\nm.read_command = lambda _: lambda: work(0)\nm.main()"
    environment = ENVIRONMENT | {cache.CACHE_VARIABLE: str(tmp_path)}
    command = [sys.executable, "-c", code]
    for damaged in (False, True):
        for path in tmp_path.rglob(f"*{ending}") if damaged else ():
            path.write_bytes(path.read_bytes()[:20])
        done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)
    is_named = f"Compiled code in {tmp_path}/netfall-" in done.stderr
    assert done.returncode == 1 and is_named == bool(ending), done.stderr
