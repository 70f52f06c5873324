"""The entry point of the command line, netfall VERB; the verbs stand in `parser`."""

import os
import signal
import sys
import time
from pathlib import Path

from netfall.cli import commands
from netfall.cli.parser import VERBS, parser
from netfall.core.cache import choose_folder
from netfall.ground.errors import DivergedError, InputError, Interrupted, OutputError
from netfall.ground.extras import naming_extras
from netfall.ground.launch import launched_rank
from netfall.ground.progress import tell, unread

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before a command loads numpy and numba: a rank is one thread
choose_folder()


def check_verb(words: list[str]) -> None:
    """Raise InputError for a first word that is no command: a forgotten one, mostly."""
    if not words or words[0].startswith("-") or words[0] in VERBS:
        return
    verb = {".toml": "run", ".vtkhdf": "info"}.get(Path(words[0]).suffix)
    advice = f"did you mean netfall {verb} {words[0]}?" if verb else f"expected one of {', '.join(VERBS)}"
    raise InputError(f"netfall {words[0]}: is no command; {advice}")


def _open_standard_files() -> None:
    """Have output and errors go to nowhere where they are closed: the next file would be taken for them."""
    for number, name in ((0, "stdin"), (1, "stdout"), (2, "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.dup2(os.open(os.devnull, os.O_RDWR), number)
            setattr(sys, name, open(number, "r" if number == 0 else "w", closefd=False))
    for stream in (sys.stdout, sys.stderr):
        if (stream.encoding or "utf-8").lower() != "utf-8":  # of a locale that lacks letters
            stream.reconfigure(errors="backslashreplace")


def _tell(what) -> None:
    """A line on standard error, if anybody reads it."""
    try:
        tell(what, stream=sys.stderr)
    except OSError:
        unread(sys.stderr)


def main() -> None:
    """Entry point: run a command; the exit code says how it ended (jobs/RUNNING.md)."""
    _open_standard_files()
    top = parser()
    try:
        check_verb(sys.argv[1:])
        arguments = top.parse_args()
        if arguments.verb is None and not arguments.version:
            top.print_help()
            sys.exit(2)
        verb = {"import": "import_"}.get(arguments.verb, arguments.verb)
        with naming_extras():
            commands.version() if arguments.version else getattr(commands, verb)(arguments)
        sys.stdout.flush()
    except (InputError, DivergedError, Interrupted) as error:
        if _rank() == 0:
            _tell(error)
        sys.exit(error.exit_code)
    except BrokenPipeError:
        unread(sys.stdout)
        sys.exit(1)
    except BaseException as error:
        abort(error)


def _rank() -> int:
    """Return this process's rank: of several, what MPI says; else what the launcher says."""
    if "mpi4py.MPI" in sys.modules:
        from mpi4py import MPI

        if MPI.COMM_WORLD.size > 1:
            return MPI.COMM_WORLD.rank
    return launched_rank()


def abort(error: BaseException) -> None:
    """An error on one rank ends all of them: the others would wait for it."""
    if isinstance(error, SystemExit):
        raise error
    if os.environ.get("NETFALL_TRACEBACK"):
        import traceback

        traceback.print_exception(error)
    if isinstance(error, OutputError):
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        # What ranks meet at the same moment the lowest of them tells, and ends the others.
        time.sleep(min(5.0, 0.5 * _rank()))
    common = getattr(error, "on_every_rank", False)
    if not common or _rank() == 0:
        _tell(f"netfall: {_in_words(error)}")
    _end_other_ranks(common)
    os._exit(1)  # HDF5 would try again, at exit, to write what it could not


def _in_words(error: BaseException) -> str:
    if isinstance(error, (InputError, OutputError)):
        return str(error)
    if isinstance(error, ImportError) and "libmpi" in str(error):
        return (
            f"{error}. h5py was built for this MPI library: install it (Debian: openmpi-bin), or a serial "
            "h5py: pip install --force-reinstall --only-binary h5py h5py"
        )
    return f"rank {_rank()}: {type(error).__name__}: {error} (NETFALL_TRACEBACK=1 shows where)"


def _end_other_ranks(common: bool) -> None:
    """common : whether every rank comes here; rank 0 has then told the error before the first one aborts"""
    if "mpi4py.MPI" not in sys.modules:
        return
    from mpi4py import MPI

    if MPI.COMM_WORLD.size > 1 and not MPI.Is_finalized():
        if common:
            MPI.COMM_WORLD.Barrier()
        MPI.COMM_WORLD.Abort(1)


if __name__ == "__main__":
    main()
