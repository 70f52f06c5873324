"""Entry point of the command line, netfall COMMAND; `cli.parser` lists the commands."""

import errno
import gc
import os
import signal
import sys
import time
from io import TextIOWrapper
from typing import cast

from netfall.cli.parser import read_command
from netfall.core.cache import CACHE_VARIABLE, set_cache_folder
from netfall.core.errors import (
    NO_SPACE,
    DivergedError,
    InputError,
    Interrupted,
    OutputError,
    is_on_every_rank,
    naming_extras,
)
from netfall.core.launch import launched_rank
from netfall.core.messages import is_error
from netfall.core.progress import print_lines, redirect_to_null

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # one thread per rank; must be set before numpy and numba are loaded
set_cache_folder()
# (new objects, generations) between collections. Compilation creates millions of short-lived objects: with
# Python's default of 700 a first run takes 5 s more, with a million 0.5 s.
GARBAGE_COLLECTION = (2_000_000, 20, 100)


def _open_standard_files() -> None:
    """Open closed standard streams on the null device; otherwise the next opened file would replace them."""
    for number, name in ((0, "stdin"), (1, "stdout"), (2, "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.dup2(os.open(os.devnull, os.O_RDWR), number)
            setattr(sys, name, open(number, "r" if number == 0 else "w", closefd=False))
    for stream in (sys.stdout, sys.stderr):
        if (stream.encoding or "utf-8").lower() != "utf-8":  # the locale may lack characters
            cast(TextIOWrapper, stream).reconfigure(errors="backslashreplace")


def _print_error(what: object) -> None:
    """Print a line to standard error, if it is still open."""
    try:
        print_lines(what, stream=sys.stderr)
    except OSError:
        redirect_to_null(sys.stderr)


def main() -> None:
    """Run a command. The exit code states how it ended (docs/pages/reference/exit-codes.md)."""
    _open_standard_files()
    gc.set_threshold(*GARBAGE_COLLECTION)
    try:
        command = read_command(sys.argv[1:])
        with naming_extras():
            command()
        sys.stdout.flush()
    except (InputError, DivergedError, Interrupted) as error:
        if _rank() == 0:
            lines = error.lines if isinstance(error, InputError) else [str(error)]
            for line in lines:
                _print_error(f"error: {line}" if is_error(line) else line)
        sys.exit(error.exit_code)
    except BrokenPipeError:
        redirect_to_null(sys.stdout)
        sys.exit(1)
    except BaseException as error:
        abort(error)
    finally:
        signal.signal(signal.SIGUSR1, signal.SIG_IGN)  # a late stop signal must not replace the exit code


def _rank() -> int:
    """Return this process's rank, from MPI if it has several ranks, or from the launcher."""
    if "mpi4py.MPI" in sys.modules:
        from mpi4py import MPI

        if MPI.COMM_WORLD.size > 1:
            return MPI.COMM_WORLD.rank
    return launched_rank()


def abort(error: BaseException) -> None:
    """End all ranks after an error on one of them, since the others would wait for it."""
    if isinstance(error, SystemExit):
        raise error
    if os.environ.get("NETFALL_TRACEBACK"):
        import traceback

        traceback.print_exception(error)
    if isinstance(error, OutputError):
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        # If several ranks have the error at once, the lowest reports it and ends the others.
        time.sleep(min(5.0, 0.5 * _rank()))
    common = is_on_every_rank(error)
    if not common or _rank() == 0:
        _print_error(f"error: {_in_words(error)}")
    _end_other_ranks(common)
    os._exit(1)  # at a normal exit HDF5 would repeat the failed write


def _in_words(error: BaseException) -> str:
    if isinstance(error, (InputError, OutputError)):
        return str(error)
    if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
        return f"{error.filename}: {error.strerror}. Give a shorter name"
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    if isinstance(error, ImportError) and "libmpi" in str(error):
        return (
            f"{error}. h5py was built for this MPI library: install it (Debian: openmpi-bin), or a serial "
            "h5py: pip install --force-reinstall --only-binary h5py h5py"
        )
    text = f"rank {_rank()}: {type(error).__name__}: {error} (NETFALL_TRACEBACK=1 shows where)"
    folder = os.environ.get(CACHE_VARIABLE, "the folders of the package")
    if "no locator available" in str(error) or getattr(error, "errno", None) in NO_SPACE:
        text += f". If compiled code has no room in {folder}, set {CACHE_VARIABLE} to another folder"
    if type(error).__name__ in ("UnpicklingError", "EOFError") and _is_from_numba(error):
        text += f". Compiled code in {folder} is damaged. Remove this folder"
    return text


def _is_from_numba(error: BaseException) -> bool:
    """Return whether numba raised an error, for example when it read a file of its cache that was cut off."""
    import traceback

    frames = traceback.walk_tb(error.__traceback__)
    return any(frame.f_globals.get("__name__", "").startswith("numba.") for frame, _ in frames)


def _end_other_ranks(common: bool) -> None:
    """Abort all ranks of MPI.

    common : whether every rank calls this; rank 0 then reports the error before any rank aborts
    """
    if "mpi4py.MPI" not in sys.modules:
        return
    from mpi4py import MPI

    if MPI.COMM_WORLD.size > 1 and not MPI.Is_finalized():
        if common:
            MPI.COMM_WORLD.Barrier()
        MPI.COMM_WORLD.Abort(1)


if __name__ == "__main__":
    main()
