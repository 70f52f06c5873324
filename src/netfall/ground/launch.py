"""Runs of a job as commands of their own, for studies that vary what stands in it."""

import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from netfall.ground.errors import BUSY, InputError

LAUNCHER = "mpirun -n {ranks}"


class RunFailed(InputError):
    """A run that did not end with exit code 0."""

    def __init__(self, command: str, exit_code: int, printed: str):
        lines = [line for line in printed.strip().splitlines() if line] or ["no message"]
        self.exit_code, self.reason = exit_code, lines[0]
        self.state = {2: "refused", 3: "diverged"}.get(exit_code, "failed")
        if BUSY in self.reason:
            self.state = "failed"  # another time it may go
        super().__init__([f"a run ended with exit code {exit_code}: {command}", *lines[:5]])


def default_launcher() -> str:
    """mpirun of the environment that netfall is installed in, else of the path."""
    beside = Path(sys.executable).with_name("mpirun")
    found = str(beside) if beside.exists() else shutil.which("mpirun")
    return LAUNCHER.replace("mpirun", shlex.quote(found or "mpirun"), 1)


@contextmanager
def passing_result(folder: Path) -> Iterator[Path]:
    """Name of a result file that no other run has; it and what a run leaves beside it are gone at the end."""
    with tempfile.TemporaryDirectory(prefix=".netfall-", dir=folder) as place:
        yield Path(place) / "result.vtkhdf"


def run_command(
    launcher: str, ranks: int, job: Path, output: Path, overrides: list[str], *options: str
) -> list[str]:
    """The words of `netfall run` on so many ranks, for `subprocess`. launcher : command with {ranks} in it"""
    own = [sys.executable, "-m", "netfall", "run", str(job), "-o", str(output), *options]
    settings = [word for override in overrides for word in ("--set", override)]
    return [*shlex.split(launcher.format(ranks=ranks)), *own, *settings]


def run_job_command(
    launcher: str, ranks: int, job: Path, output: Path, overrides: list[str], *options: str
) -> None:
    """`netfall run` on so many ranks; returns when the result is written.

    launcher : command with {ranks} in it

    Raises RunFailed if it does not end with exit code 0, with what it printed.
    """
    command = run_command(launcher, ranks, job, output, overrides, "--quiet", *options)
    try:
        ended = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    except OSError as error:
        raise InputError(
            f'--launcher "{launcher}": {error.strerror}: {error.filename}; '
            "give the command that starts MPI ranks here"
        ) from None
    if ended.returncode:
        raise RunFailed(shlex.join(command), ended.returncode, ended.stderr or ended.stdout)


def check_launcher(launcher: str) -> None:
    """Raises InputError for a launcher without its {ranks}."""
    try:
        good = "{ranks}" in launcher and bool(shlex.split(launcher.format(ranks=1)))
    except (ValueError, KeyError, IndexError):
        good = False
    if not good:
        raise InputError(
            f'--launcher "{launcher}": expected a command with {{ranks}} in it, '
            'for example "srun -n {ranks}"'
        )
