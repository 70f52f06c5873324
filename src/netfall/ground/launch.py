"""The launcher of MPI ranks: the usual one, the command of a run on its ranks, and what it must hold."""

import shlex
import shutil
import sys
from pathlib import Path

from netfall.ground.errors import InputError

RANK_NAMES = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK", "SLURM_PROCID")  # set by launchers


def default_launcher() -> str:
    """mpirun of the environment that netfall is installed in, else of the path."""
    beside = Path(sys.executable).with_name("mpirun")
    found = str(beside) if beside.exists() else shutil.which("mpirun")
    return f"{shlex.quote(found or 'mpirun')} -n {{ranks}}"


def run_command(
    launcher: str, ranks: int, job: Path, output: Path, overrides: list[str], *options: str
) -> list[str]:
    """The words of `netfall run` on so many ranks, for `subprocess`. launcher : command with {ranks} in it"""
    own = [sys.executable, "-m", "netfall", "run", str(job), "-o", str(output), *options]
    settings = [word for override in overrides for word in ("--set", override)]
    return [*shlex.split(launcher.format(ranks=ranks)), *own, *settings]


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
