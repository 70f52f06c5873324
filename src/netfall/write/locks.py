"""The place of a file that a run writes: reserved for one run at a time; what goes wrong there, in words."""

import ctypes
import errno
import fcntl
import io
import os
import resource
import shutil
import tempfile
from contextlib import contextmanager
from pathlib import Path

import h5py

from netfall.ground.errors import BUSY, InputError, OutputError

KEEP_SIZE = 1  # FALLOC_FL_KEEP_SIZE of Linux: the file's size stays what has been written
UNKNOWN = (errno.EOPNOTSUPP, errno.ENOSYS)  # to the file system: it reserves nothing
_fallocate = ctypes.CDLL(None, use_errno=True).fallocate


@contextmanager
def writing(path: Path):
    """What goes wrong in this block is reported as a failure to write `path`. Raises OutputError."""
    try:
        yield
    except BrokenPipeError:  # of what is told meanwhile, to somebody who has stopped reading
        raise
    except (OSError, RuntimeError) as error:  # h5py raises either
        known = isinstance(error, OSError) and error.errno
        reason = os.strerror(error.errno) if known else str(error).split(", errno")[0].strip()
        try:
            room = f"{shutil.disk_usage(path.parent).free / 1e6:.0f} MB are free in {path.parent.resolve()}"
        except OSError:
            room = f"the folder {path.parent} is gone"
        raise OutputError(
            f"{path}: cannot be written ({reason}); {room}; make room there or give another place with -o"
        ) from error


def followed(path: Path) -> Path:
    """Return the file that a symbolic link stands for; another path as it is."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


@contextmanager
def whole(path: Path):
    """A place to write to; the file there gets the name `path` at the end of the block, or goes.

    Raises OutputError for what goes wrong.
    """
    path = followed(path)
    temporary = path.with_name(f".{path.stem}.part{path.suffix}")  # its ending says what kind of file it is
    with writing(path):
        try:
            yield temporary
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)


@contextmanager
def whole_folder(path: Path):
    """A folder to write to, in `path`; the files there get into `path` at the end of the block, or go.

    A folder that is made for them goes with them. Raises OutputError for what goes wrong.
    """
    made = not path.exists()
    with writing(path):
        path.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=".part-", dir=path))
        try:
            yield temporary
            for file in sorted(temporary.iterdir()):
                os.replace(file, path / file.name)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
            if made and not any(path.iterdir()):
                path.rmdir()


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


def reserve(path: Path, size: int) -> None:
    """Have room for a file of so many bytes, which may be shorter so far. Raises OSError if there is none.

    Where the file system cannot reserve, there is as much free as it takes at this moment.
    """
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    if limit != resource.RLIM_INFINITY and size > limit:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG))
    there = os.open(path, os.O_WRONLY)
    try:
        if _fallocate(there, KEEP_SIZE, 0, size) == 0:
            return
        why, free = ctypes.get_errno(), os.fstatvfs(there)
        enough = size - os.fstat(there).st_size <= free.f_bavail * free.f_frsize
        if why not in UNKNOWN or not enough:
            why = errno.ENOSPC if why in UNKNOWN else why
            raise OSError(why, os.strerror(why))
    finally:
        os.close(there)


def give_back(path: Path) -> None:
    """Free what was reserved behind the end of a file."""
    os.truncate(path, path.stat().st_size)


@contextmanager
def roomy_h5(path: Path, size: int):
    """A new HDF5 file for which so many bytes are reserved. Raises OSError if there are not as many."""
    path.touch()
    reserve(path, size)
    with h5py.File(path, "w") as file:
        reserve(path, size)  # opened as a new file, it has lost what it had
        yield file
    give_back(path)


def size_of(finish) -> int:
    """Bytes of an HDF5 file with what finish(file) writes alone."""
    memory = io.BytesIO()
    with h5py.File(memory, "w") as file:
        finish(file)
    return memory.getbuffer().nbytes


@contextmanager
def h5_whole(path: Path):
    """A new HDF5 file, in memory: at the end on the disk under its name, or what was there is as before."""
    memory = io.BytesIO()
    with h5py.File(memory, "w") as file:
        yield file
    with whole(path) as place:
        place.write_bytes(memory.getbuffer())
        sync(place)
