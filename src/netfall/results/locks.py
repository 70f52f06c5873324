"""Output path of a run: a lock against simultaneous runs, disk space, and errors of failed writes."""

import ctypes
import errno
import fcntl
import os
import re
import resource
import secrets
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

import h5py

from netfall.core.errors import InputError, OutputError
from netfall.results import messages

KEEP_SIZE = 1  # FALLOC_FL_KEEP_SIZE of Linux: reserve space without a change of the file's size
OTHER_REMEDIES: dict[int | None, str] = {  # of errors without relation to disk space
    errno.ENAMETOOLONG: "Give a shorter name",
    **dict.fromkeys(
        (errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOENT, errno.ENOTDIR), "Give another path"
    ),
}
# bytes that names of temporary files have more than that of the result; Open MPI crashes beyond the limit
ADDED_TO_NAME = 60
UNSUPPORTED_ERRORS = (errno.EOPNOTSUPP, errno.ENOSYS)  # the file system cannot reserve space
LEFTOVER = re.compile(r"\.[0-9a-f]{16}\.part(\.\w+)?")  # names of temporary files
LEFTOVER_AGE_S = 86400.0  # s since the last change; older temporary files are abandoned
_fallocate = ctypes.CDLL(None, use_errno=True).fallocate


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Convert errors in this block into an OutputError on the failure to write `path`."""
    try:
        yield
    except BrokenPipeError:  # standard output was closed; the file is not affected
        raise
    except (OSError, RuntimeError) as error:  # h5py raises either
        code = error.errno if isinstance(error, OSError) else None
        reason = os.strerror(code) if code else str(error).split(", errno")[0].strip()
        try:
            space = f"{shutil.disk_usage(path.parent).free / 1e6:.0f} MB are free in {path.parent.resolve()}"
        except OSError:
            space = f"the folder {path.parent} does not exist"
        remedy = OTHER_REMEDIES.get(code, "Make room there, or give another path")
        line = messages.CANNOT_WRITE(path=path, reason=reason, space=space, remedy=remedy)
        raise OutputError(line) from error


def resolve_link(path: Path) -> Path:
    """Return the target of a symbolic link, or the path itself if it is not a link."""
    return Path(os.path.realpath(path)) if os.path.islink(path) else path


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Yield a temporary path. The file there is renamed to `path` at the end of the block.

    Its folder is made if necessary. After an error the file is removed. Raises OutputError.
    """
    path = resolve_link(path)
    _remove_leftovers(path.parent)
    # a different name for each process; writers derive the format from the suffix
    temporary = path.with_name(f".{secrets.token_hex(8)}.part{path.suffix}")
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield temporary
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)


@cache
def _remove_leftovers(folder: Path) -> None:
    """Remove temporary files of `whole` that killed processes left in a folder; once in a process."""
    for old in folder.glob(".*.part*"):
        with suppress(OSError):  # another process may remove it
            is_own = LEFTOVER.fullmatch(old.name) and old.is_file()
            if is_own and time.time() - old.stat().st_mtime > LEFTOVER_AGE_S:
                old.unlink()


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder in `path`. Its files are moved to `path` at the end of the block.

    After an error they are removed, and so is `path` if this function made it. Raises OutputError.
    """
    is_new = not path.exists()
    with writing(path):
        path.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=".part-", dir=path))
        try:
            yield temporary
            for file in sorted(temporary.iterdir()):
                os.replace(file, path / file.name)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
            if is_new and not any(path.iterdir()):
                path.rmdir()


def sync(path: Path) -> None:
    """Flush a file, or the entries of a folder, to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def check_output_path(path: Path) -> None:
    """Check that a result file can be written to a path. Raises InputError."""
    folder = path.parent
    if not folder.is_dir():
        raise InputError(messages.MISSING_FOLDER(path=path, folder=folder))
    if len(os.fsencode(path.name)) > (most := os.pathconf(folder, "PC_NAME_MAX") - ADDED_TO_NAME):
        raise InputError(messages.NAME_TOO_LONG(path=path, most=most))
    if path.is_dir():
        raise InputError(messages.FOLDER_AS_OUTPUT(path=path))
    if not os.access(folder, os.W_OK):
        raise InputError(messages.READ_ONLY_FOLDER(path=path, folder=folder.resolve()))
    if not path.exists():
        return
    # a new result replaces an old one, which no program has open, only once it is complete
    try:
        with h5py.File(path, "r") as file:
            is_result = "provenance" in file and "netfall_study" not in file.attrs
    except BlockingIOError:
        raise InputError(messages.OUTPUT_IN_USE(path=path)) from None
    except OSError:
        is_result = False
    if not is_result:
        raise InputError(messages.OTHER_FILE_THERE(path=path))


@contextmanager
def locked_output(path: Path) -> Iterator[None]:
    """Lock the name of a result for this process until the end of the block.

    Raises InputError if another run holds the lock. The system releases the lock however the process ends.
    """
    lock = path.with_name(f".{path.name}.lock")
    while True:
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            file = open(lock, "a")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.close()
            raise InputError(messages.OUTPUT_IN_USE(path=path)) from None
        except OSError:
            break  # the file system has no locks
        if lock.exists() and os.path.samestat(lock.stat(), os.fstat(file.fileno())):
            break
        file.close()  # another run removed the lock file between open and flock: try again
    try:
        yield
    finally:
        lock.unlink(missing_ok=True)
        file.close()


def reserve_disk_space(path: Path, size: int) -> None:
    """Reserve disk space for a file of `size` bytes. Raises OSError if there is not enough.

    The file may still be shorter. If the file system cannot reserve space, only the free space is checked.
    """
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    if limit != resource.RLIM_INFINITY and size > limit:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG))
    descriptor = os.open(path, os.O_WRONLY)
    try:
        if _fallocate(descriptor, KEEP_SIZE, 0, size) == 0:
            return
        code, free = ctypes.get_errno(), os.fstatvfs(descriptor)
        enough = size - os.fstat(descriptor).st_size <= free.f_bavail * free.f_frsize
        if code not in UNSUPPORTED_ERRORS or not enough:
            code = errno.ENOSPC if code in UNSUPPORTED_ERRORS else code
            raise OSError(code, os.strerror(code))
    finally:
        os.close(descriptor)


def truncate_to_size(path: Path) -> None:
    """Free the space reserved beyond the end of a file."""
    os.truncate(path, path.stat().st_size)


@contextmanager
def reserved_h5(path: Path, size: int) -> Iterator[h5py.File]:
    """Yield a new HDF5 file with `size` bytes reserved. Raises OSError if there is not enough space."""
    path.touch()
    reserve_disk_space(path, size)
    with h5py.File(path, "w") as file:
        reserve_disk_space(path, size)  # again: opening truncates the file
        yield file
    truncate_to_size(path)


def h5_in_memory() -> h5py.File:
    """Open a new HDF5 file that is only in memory."""
    return h5py.File("in memory", "w", driver="core", backing_store=False)


def copy_all(source: h5py.Group, target: h5py.Group) -> None:
    """Copy all objects and attributes of a group to another, which may already contain some of the groups."""
    for name, value in source.attrs.items():
        target.attrs.create(name, value, dtype=source.attrs.get_id(name).dtype)
    for name in source:
        if name in target:
            copy_all(source[name], target[name])
        else:
            source.copy(name, target)


@contextmanager
def atomic_h5(path: Path) -> Iterator[h5py.File]:
    """Yield a new HDF5 file in memory, and write it to `path` at the end of the block.

    After an error an existing file at `path` is unchanged.
    """
    with h5_in_memory() as file:
        yield file
        file.flush()
        image = file.id.get_file_image()
    with whole(path) as place:
        place.write_bytes(image)
        sync(place)
