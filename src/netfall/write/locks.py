"""The place of a file that a run writes: reserved for one run at a time; what goes wrong there, in words."""

import fcntl
import os
import shutil
from contextlib import contextmanager
from pathlib import Path

import h5py

from netfall.ground.errors import BUSY, InputError, OutputError


@contextmanager
def writing(path: Path):
    """What goes wrong in this block is reported as a failure to write `path`. Raises OutputError."""
    try:
        yield
    except BrokenPipeError:  # of what is told meanwhile, to somebody who has stopped reading
        raise
    except (OSError, RuntimeError) as error:  # h5py raises either
        reason = (
            os.strerror(error.errno)
            if isinstance(error, OSError) and error.errno
            else str(error).split(", errno")[0].strip()
        )
        try:
            room = f"{shutil.disk_usage(path.parent).free / 1e6:.0f} MB are free in {path.parent.resolve()}"
        except OSError:
            room = f"the folder {path.parent} is gone"
        raise OutputError(
            f"{path}: cannot be written ({reason}); {room}; make room there or give another place with -o"
        ) from error


@contextmanager
def whole(path: Path):
    """A place to write to; the file there gets the name `path` at the end of the block, or goes.

    Raises OutputError for what goes wrong.
    """
    temporary = path.with_name(f".{path.stem}.part{path.suffix}")  # its ending says what kind of file it is
    with writing(path):
        try:
            yield temporary
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)


def sync(path: Path) -> None:
    """Have a file, or the names in a folder, on the disk."""
    there = os.open(path, os.O_RDONLY)
    try:
        os.fsync(there)
    finally:
        os.close(there)


def check_place(path: Path) -> None:
    """Refuse a result file that could not be written at the end. Raises InputError."""
    folder = path.parent
    if not folder.is_dir():
        raise InputError(
            f"{path}: the folder {folder} does not exist; make it, or give another place with -o"
        )
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the name of a file with -o")
    if not os.access(folder, os.W_OK):
        raise InputError(
            f"{path}: the folder {folder.resolve()} cannot be written to; give another place with -o"
        )
    if path.exists():
        _check_replaceable(path)


def _check_replaceable(path: Path) -> None:
    """Refuse to write over what is no result of netfall, or is open elsewhere.

    An old result is replaced, once the new one is whole.
    """
    try:
        with h5py.File(path, "r") as file:
            ours = "provenance" in file and "netfall_study" not in file.attrs
    except BlockingIOError:
        raise InputError(
            f"{path}: another program has it open for writing; close it there, or give another name with -o"
        ) from None
    except OSError:
        ours = False
    if not ours:
        raise InputError(
            f"{path}: exists and is no result of netfall; move it away, or give another name with -o"
        )


def claim(path: Path):
    """Reserve the name of a result for this process: an open lock file, for `release`.

    Raises InputError if another run has it. The system gives up the lock of a process that ends, however it
    ends.
    """
    lock = path.with_name(f".{path.name}.lock")
    while True:
        with writing(path):
            file = open(lock, "a")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            raise InputError(f"{path}: {BUSY}; wait for it, or give another name with -o") from None
        except OSError:
            return file  # a file system without locks
        if lock.exists() and os.path.samestat(lock.stat(), os.fstat(file.fileno())):
            return file
        file.close()  # the run before removed it between the two calls


def release(file) -> None:
    """Give up what `claim` reserved."""
    Path(file.name).unlink(missing_ok=True)
    file.close()
