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


class Overflow(io.RawIOBase):
    """A file for HDF5 that takes everything: what the disk does not take stays in memory; `check` tells."""

    def __init__(self, disk):
        """disk : open for reading and writing, without a buffer"""
        self.disk, self.place, self.error = disk, 0, None
        self.kept: list[tuple[int, bytes]] = []  # place and bytes, as they came

    def check(self) -> None:
        """Raise the OSError of the first bytes that the disk did not take."""
        if self.error is not None:
            raise self.error

    # --- what h5py asks of a file

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a place, which is returned."""
        end = max([os.fstat(self.disk.fileno()).st_size, *(at + len(data) for at, data in self.kept)])
        self.place = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self.place, os.SEEK_END: end}[whence]
        return self.place

    def readinto(self, buffer) -> int:
        """Fill a buffer from the disk and from what is kept; zeros where there is nothing."""
        view, first = memoryview(buffer).cast("B"), self.place
        found = os.pread(self.disk.fileno(), len(view), first)
        view[: len(found)] = found
        view[len(found) :] = bytes(len(view) - len(found))
        for at, data in self.kept:
            low, high = max(at, first), min(at + len(data), first + len(view))
            if low < high:
                view[low - first : high - first] = data[low - at : high - at]
        self.place += len(view)
        return len(view)

    def write(self, data) -> int:
        """Write all of it, or keep what is left."""
        rest, size = memoryview(data).cast("B"), memoryview(data).nbytes
        try:
            while rest and self.error is None:
                written = os.pwrite(self.disk.fileno(), rest, self.place)
                rest, self.place = rest[written:], self.place + written
        except OSError as error:
            self.error = error
        if rest:
            self.kept.append((self.place, bytes(rest)))
            self.place += len(rest)
        return size

    def truncate(self, size: int | None = None) -> int:
        """Set the end."""
        size = self.place if size is None else size
        try:
            if self.error is None:
                os.ftruncate(self.disk.fileno(), size)
        except OSError as error:
            self.error = error
        return size


@contextmanager
def h5_file(path: Path, mode: str):
    """An HDF5 file, new ("w") or to be added to ("r+"), and a function that raises OSError if it has no room.

    That is called at the end as well. What is written after the room has ended is held in memory: whoever
    writes much asks now and then.
    """
    with open(path, {"w": "w+b", "r+": "r+b"}[mode], buffering=0) as disk:
        overflow = Overflow(disk)
        with h5py.File(overflow, mode) as file:
            yield file, overflow.check
        overflow.check()


@contextmanager
def h5_whole(path: Path):
    """A new HDF5 file: at the end on the disk under its name, or what was there is as before."""
    with whole(path) as place:
        with h5_file(place, "w") as (file, _):
            yield file
        sync(place)
