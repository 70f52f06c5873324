"""Runs of a job from Python, in separate processes.

A run configures its process (compiler, memory, signals, MPI), so it does not use the user's process.
"""

import os
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

from netfall.api import messages
from netfall.api.net import Net
from netfall.core.errors import (
    LAST_CHECKPOINT,
    DivergedError,
    InputError,
    Interrupted,
    OutputError,
)
from netfall.core.launch import (
    RANKS,
    SIZES,
    default_launcher,
    environment_without_launcher,
    launcher_variables,
    run_command,
)
from netfall.job.keys.schema import LIST_KEYS, TABLES
from netfall.job.toml_text import toml_text, toml_value
from netfall.results.reader import Result

JOB_FILE = "job.toml"  # file of a job given as a dict, in a temporary folder
PATH_NAMES = {key.name for keys in (TABLES | LIST_KEYS).values() for key in keys if key.kind == "path"}
STOP_TIME = 60.0  # s within which a run must stop with a checkpoint


def run(
    job: str | Path | dict[str, Any],
    overrides: dict[str, Any] | None,
    ranks: int | None,
    output: str | Path | None,
    quiet: bool,
) -> Result:
    """Execute `netfall.run`, which describes the arguments."""
    given = _with_absolute_paths(overrides or {}) if isinstance(job, dict) else overrides or {}
    settings = [f"{name}={toml_value(value, f'{name} = ')}" for name, value in given.items()]
    if ranks is not None and (isinstance(ranks, bool) or not isinstance(ranks, int) or ranks < 1):
        raise InputError(messages.WRONG_RANKS(ranks=ranks))
    if under_mpirun():
        raise InputError(messages.UNDER_MPIRUN())
    folder = _temporary_folder()  # of a job that is a dict, and of a result without output
    try:
        path = _job_file(job, Path(folder.name)) if isinstance(job, dict) else Path(job)
        place = Path(folder.name, f"{path.stem}.vtkhdf") if output is None else Path(output)
        _run_in_processes(path, place, folder.name, settings, ranks or 1, quiet)
        result = Result(place)
    except BaseException:
        folder.cleanup()
        raise
    if output is None:
        result._keeps = folder  # removed with the result
    else:
        folder.cleanup()
    try:
        for line in result.warnings if quiet else ():
            warnings.warn(line.removeprefix("warning: "), stacklevel=3)
    except Warning:  # the user's filters turn warnings into errors
        result.close()
        raise
    return result


def under_mpirun() -> bool:
    """Return whether this process is one of several ranks, according to its launcher or to MPI.

    A single rank does not count, because srun may have started a notebook.
    """
    mpi, sizes = sys.modules.get("mpi4py.MPI"), launcher_variables(SIZES)
    if mpi and mpi.Is_initialized() and not mpi.Is_finalized() and mpi.COMM_WORLD.size > 1:
        return True
    return next(iter(sizes.values())) > 1 if sizes else bool(launcher_variables(RANKS))


def _as_given(folder: str, lines: list[str]) -> list[str]:
    """Return messages without the name of the temporary folder; the job file of a dict is then `job`.

    Mentions of its checkpoints are left out, since they are removed with the folder.
    """
    prefix = f"{folder}{os.sep}"
    checkpoint = " " + LAST_CHECKPOINT.format(path=re.escape(prefix) + r".+\.h5")
    lines = [re.sub(checkpoint, "", line) for line in lines]
    return [line.replace(f"{prefix}{JOB_FILE}", "job").replace(prefix, "") for line in lines]


def _temporary_folder() -> tempfile.TemporaryDirectory[str]:
    """Make a temporary folder here, where other nodes see it, or in the system's folder if that fails."""
    try:
        return tempfile.TemporaryDirectory(prefix=".netfall-", dir=os.getcwd(), ignore_cleanup_errors=True)
    except OSError:
        return tempfile.TemporaryDirectory(prefix="netfall-", ignore_cleanup_errors=True)


def _job_file(job: dict[str, Any], folder: Path) -> Path:
    """Write a job, and the tables of its net. Paths in it are relative to the working directory."""
    job = _with_absolute_paths(job)
    net, fields = job.get("net"), Net.__dataclass_fields__
    if isinstance(net, Net):
        job["net"] = net.write(folder)
    elif isinstance(net, dict) and not isinstance(net.get("nodes"), (str, type(None))):
        if "elements" not in net:
            raise InputError(messages.NODES_WITHOUT_ELEMENTS())
        settings = {name: value for name, value in net.items() if name not in fields}
        arrays = Net(**{name: value for name, value in net.items() if name in fields})
        job["net"] = settings | arrays.write(folder)
    path = folder / JOB_FILE
    path.write_text(toml_text(job), encoding="utf-8")
    return path


def _with_absolute_paths(value: Any, key: Any = "") -> Any:
    """Return the value of a key with absolute paths of files, since the job file is in another folder."""
    if isinstance(value, dict):
        return {name: _with_absolute_paths(item, name) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_with_absolute_paths(item) if isinstance(item, dict) else item for item in value]
    # other keys contain names of groups or cases, which may also be names of files
    names_path = str(key).split(".")[-1] in PATH_NAMES
    if names_path and isinstance(value, (str, os.PathLike)) and os.path.isfile(value):
        return os.path.abspath(value)
    return value


def _run_in_processes(
    job: Path, output: Path, folder: str, settings: list[str], ranks: int, quiet: bool
) -> None:
    """Run a job in other processes. Raises the command's error, KeyboardInterrupt after a checkpoint.

    folder : temporary; a result in it is not kept
    """
    keeps = output.parent != Path(folder)
    launcher, options = default_launcher() if ranks > 1 else "", ["--quiet"] if quiet else []
    command = run_command(
        launcher, ranks, job, output, settings, *options, module="netfall.driver.child_process"
    )
    interrupt = None
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as complaints:
        with subprocess.Popen(
            command,
            env=_environment(),
            stdin=subprocess.PIPE,
            stdout=_output_stream(quiet),
            stderr=complaints,
            encoding="utf-8",
            errors="replace",
        ) as process:
            try:
                for line in process.stdout or ():
                    print(line, end="", flush=True)
                process.wait()
            except BaseException as raised:
                interrupt = raised
                if process.stdin is not None:
                    process.stdin.close()  # the run stops when its input ends
                _wait_or_kill(process)
        complaints.seek(0)
        lines = [line for line in complaints.read().splitlines() if line.strip()]
    stopped = process.returncode == Interrupted.exit_code
    if interrupt:
        if isinstance(interrupt, KeyboardInterrupt) and keeps and stopped:
            raise KeyboardInterrupt("\n".join(lines)) from None
        raise interrupt
    if stopped and not keeps:
        raise Interrupted(messages.NO_CHECKPOINT())
    if process.returncode:
        raise _error(process.returncode, _as_given(folder, lines), command)
    if lines:
        print("\n".join(lines), file=sys.stderr)


def _environment() -> dict[str, str]:
    """Return the environment of a run, with the module search path of this process."""
    folders = [folder or os.getcwd() for folder in sys.path if isinstance(folder, str)]
    return environment_without_launcher() | {"PYTHONPATH": os.pathsep.join(folders), "PYTHONSAFEPATH": "1"}


def _output_stream(quiet: bool) -> int | None:
    """Return where a run prints: a pipe if Python's output differs from that of the process."""
    if quiet:
        return subprocess.DEVNULL
    if sys.stdout is not sys.__stdout__:
        return subprocess.PIPE
    print(end="", flush=True)
    return None


def _wait_or_kill(process: subprocess.Popen[str]) -> None:
    """Wait until a stopping run ends; kill it after STOP_TIME, or at an interrupt."""
    try:
        process.wait(STOP_TIME)
    except (subprocess.TimeoutExpired, KeyboardInterrupt):
        process.kill()


def _error(code: int, lines: list[str], command: list[str]) -> Exception:
    """Return the exception for the exit code of a command, with its standard error."""
    own_lines = [line.removeprefix("error: ") for line in lines if line.startswith(("error: ", "warning: "))]
    if code == InputError.exit_code:
        return InputError(own_lines or lines)
    for error in (DivergedError, Interrupted):
        if code == error.exit_code:
            return error("\n".join(line.removeprefix("error: ") for line in lines))
    if code == OutputError.exit_code and own_lines and not own_lines[0].startswith("rank "):
        return OutputError("\n".join(own_lines))
    ended = f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
    return RuntimeError("\n".join([f"{shlex.join(command)} {ended}", *lines]))
