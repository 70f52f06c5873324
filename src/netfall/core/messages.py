"""Messages of the package `core`: start of MPI, extras."""

from netfall.core.message import Message

NO_LAUNCHER = Message("E001", "mpirun: not found, so no MPI library. {install}")
WRONG_LAUNCHER = Message(
    "E002",
    '--launcher "{launcher}": expected a command with {{ranks}} in it, for example "srun -n {{ranks}}"',
)
MISSING_PACKAGE = Message(
    "E003", "needs {package}, which is not installed; get it with: pip install 'netfall[{extra}]'"
)
LAUNCHER_MISMATCH = Message(
    "E004",
    "MPI: {variable} = {count}: the launcher started {count} processes, and MPI connects {size} of them. "
    "Start the ranks with the mpirun of the MPI library that netfall --version names; for a run on one rank "
    "unset {variable}",
    "The program mpirun or srun belongs to another MPI library than the one that mpi4py was built for or "
    "loads. Each process then is a run of its own.",
)
OTHER_VERSION = Message(
    "E005", "{path}: written by netfall {version}, which this version does not read; {remedy}"
)
INTERRUPTED = Message("N006", "interrupted {when}. Resume with --restart {path}")
