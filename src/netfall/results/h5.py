"""One HDF5 file that all ranks write (MPI-IO), or rank 0 if h5py is serial. It exists only if complete.

The file has a temporary name until it is complete. Rows are appended in contiguous blocks; a rank without
rows contributes an empty block. (With slices of h5py such a rank would skip the collective write, and the
others would wait.)

Segments are consecutive parts of a result file between checkpoints. They are joined at the end of the run.
"""

import hashlib
import itertools
import math
import os
import re
import secrets
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from netfall.core.errors import NO_SPACE, InputError, OutputError, is_on_every_rank
from netfall.parallel.agree import on_all, on_root
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import BlockWriter
from netfall.results import locks, messages
from netfall.results.locks import writing

HAS_PARALLEL_HDF5 = bool(h5py.get_config().mpi)
CHUNK_BYTES = 1 << 18
BUFFER_BYTES = 1 << 20  # buffer per dataset over all ranks; a full buffer is written at once
DATASET_BYTES = 1 << 13  # upper bound of HDF5 metadata per dataset, without its chunks
CHUNK_ENTRY_BYTES = 1 << 7  # upper bound of HDF5 metadata per chunk
SPARE_BYTES = 1 << 18  # disk space reserved ahead, also for unit attributes of datasets
UNCLOSED_FILES: list[h5py.File | None] = []  # keeps files referenced, so that h5py does not close them
HASH_BYTES = 1 << 24  # read at once for a digest
SEAL = b"netfall-sha256:"  # marks the digest of all preceding bytes, which follows the HDF5 file


@dataclass
class AppendableDataset:
    """An open dataset to which rows are appended. Opening it again would take longer than writing a row.

    rows : including buffered ones
    waiting : buffered blocks: (first row of all ranks' blocks, number of rows, offset of this rank's block in
        them, the block)
    """

    id: h5py.h5d.DatasetID
    dtype: np.dtype
    rows: int
    tail: tuple[int, ...]
    waiting: list[tuple[int, int, int, np.ndarray]] = field(default_factory=list)


class SharedFile:
    """Appends global rows to datasets of one file. Every method is collective.

    base : rows of each dataset in earlier files that this one continues
    """

    def __init__(self, comm: MPI.Comm, path: Path, base: dict[str, int] | None = None):
        self.comm = comm
        self.path = path
        self.base = dict(base or {})
        self.temporary = path.with_name(f".{path.name}.part")
        self.slabs = BlockWriter(comm, HAS_PARALLEL_HDF5)
        self.writes = HAS_PARALLEL_HDF5 or comm.rank == 0
        self.file: Any = None
        self._growing: dict[str, AppendableDataset] = {}
        self._size = 0  # upper bound of the file's size in bytes
        self._reserved = SPARE_BYTES  # bytes reserved on the disk
        on_root(comm, self._reserve_header)
        try:
            on_all(comm, self._open)
        except OutputError:
            UNCLOSED_FILES.append(self.file)
            raise

    def _reserve_header(self) -> None:
        """Reserve disk space for the metadata of an empty HDF5 file."""
        try:
            with writing(self.path):
                self.temporary.touch()
                locks.reserve_disk_space(self.temporary, self._reserved)
        except OutputError:
            self.temporary.unlink(missing_ok=True)
            raise

    def _open(self) -> None:
        with writing(self.path):
            if HAS_PARALLEL_HDF5:
                self.file = h5py.File(self.temporary, "w", driver="mpio", comm=self.comm)
                self._transfer = h5py.h5p.create(h5py.h5p.DATASET_XFER)
                self._transfer.set_dxpl_mpio(h5py.h5fd.MPIO_COLLECTIVE)
            elif self.comm.rank == 0:
                self.file = h5py.File(self.temporary, "w")
                self._transfer = h5py.h5p.create(h5py.h5p.DATASET_XFER)
            if self.comm.rank == 0:
                locks.reserve_disk_space(self.temporary, self._reserved)  # again: opening truncates the file

    def create(self, name: str, dtype: Any, tail: tuple[int, ...] = (), rows: int = 1024) -> None:
        """Create an empty dataset that grows by rows of shape `tail`; its chunks have up to `rows` rows."""
        if self.writes:
            row = math.prod(tail) * np.dtype(dtype).itemsize
            if len(tail) == 2:  # whole states (rows of n x 3): chunks of one state
                chunks = 1, min(tail[0], max(1, CHUNK_BYTES * tail[0] // row)), tail[1]
            else:
                chunks = (max(1, min(rows, CHUNK_BYTES // row)),) + tail
            self._make_room(DATASET_BYTES)
            with writing(self.path):
                self.file.create_dataset(name, (0, *tail), maxshape=(None, *tail), chunks=chunks, dtype=dtype)

    def rows(self) -> dict[str, int]:
        """Return the number of rows of each dataset, including earlier files. On ranks that write."""
        self._flush()
        counts = dict(self.base)

        def add(name: str, item: h5py.Dataset | h5py.Group) -> None:
            if isinstance(item, h5py.Dataset):
                counts[name] = counts.get(name, 0) + item.shape[0]

        if self.writes:
            self.file.visititems(add)
        return counts

    def append(self, name: str, block: np.ndarray, total: int, place: int | None = None) -> int:
        """Append `total` rows, of which `block` is this rank's part. The block may be buffered.

        Returns the first new row, counted from the first of the earlier files.
        place : offset of the block in the rows; None: ranks have equal blocks
        """
        if not self.writes:
            return 0
        with writing(self.path):
            dataset = self._open_dataset(name)
            first = dataset.rows
            dataset.rows += total
            place = int(self.slabs.bounds(total)[self.comm.rank]) if place is None else place
            with np.errstate(over="ignore"):  # netfall reports a diverging run elsewhere
                copied = np.array(block, dataset.dtype, order="C")  # the caller may change its array
            dataset.waiting.append((first, total, place, copied))
            row_bytes = dataset.dtype.itemsize * math.prod(dataset.tail)
            if (dataset.rows - dataset.waiting[0][0]) * row_bytes >= BUFFER_BYTES:
                self._flush_dataset(dataset)
        return first + self.base.get(name, 0)

    def put(self, name: str, block: np.ndarray, total: int, dtype: Any = np.float64) -> None:
        """Create a dataset of `total` rows, of which `block` is this rank's part."""
        self.create(name, dtype, block.shape[1:], total)
        self.append(name, block, total)

    def append_state(self, name: str, block: np.ndarray, total: int) -> None:
        """Append one state: a row (total, ...), of which `block` is this rank's part along the first axis."""
        if not self.writes:
            return
        with writing(self.path):
            dataset = self._open_dataset(name)
            block = np.ascontiguousarray(block[None], dataset.dtype)
            start = (dataset.rows, int(self.slabs.bounds(total)[self.comm.rank]), *(0,) * (block.ndim - 2))
            dataset.rows += 1
            self._extend(dataset)
            self._transfer_block(dataset, block, start, (1,) * block.ndim, (1,) * block.ndim, block.shape)

    def _extend(self, dataset: AppendableDataset) -> None:
        """Resize a dataset to its number of rows. HDF5 then allocates whole chunks."""
        chunk = dataset.id.get_create_plist().get_chunk()
        cells = [-(-size // part) for size, part in zip((dataset.rows, *dataset.tail), chunk)]
        cells_before = [-(-size // part) for size, part in zip(dataset.id.shape, chunk)]
        new_chunks = math.prod(cells) - math.prod(cells_before)
        chunk_bytes = math.prod(chunk) * dataset.dtype.itemsize
        self._make_room(new_chunks * (chunk_bytes + CHUNK_ENTRY_BYTES))
        dataset.id.set_extent((dataset.rows, *dataset.tail))

    def _make_room(self, size: int) -> None:
        """Reserve disk space for `size` bytes and SPARE_BYTES. Raises OutputError on all ranks.

        An HDF5 write that fails for lack of space would leave the file unusable.
        """
        self._size += size
        if self._size <= self._reserved:
            return
        self._reserved = self._size + SPARE_BYTES

        def have() -> None:
            with writing(self.path):
                locks.reserve_disk_space(self.temporary, self._reserved)

        on_root(self.comm, have) if HAS_PARALLEL_HDF5 else have()

    def _open_dataset(self, name: str) -> AppendableDataset:
        if name not in self._growing:
            dataset, dtype = self.file[name], self.file[name].dtype
            rows, *tail = dataset.shape
            self._growing[name] = AppendableDataset(dataset.id, dtype, rows, tuple(tail))
        return self._growing[name]

    def _flush_dataset(self, dataset: AppendableDataset) -> None:
        """Write the buffered blocks; consecutive blocks of equal size in one transfer."""
        if dataset.waiting:
            self._extend(dataset)
        for total, group in itertools.groupby(dataset.waiting, key=lambda entry: entry[1]):
            firsts, _, places, blocks = zip(*group)
            ones = (1,) * len(dataset.tail)
            start = (firsts[0] + places[0], *(0,) * len(dataset.tail))
            block, stride = np.concatenate(blocks) if len(blocks) > 1 else blocks[0], (max(total, 1), *ones)
            self._transfer_block(dataset, block, start, stride, (len(blocks), *ones), blocks[0].shape)
        dataset.waiting.clear()

    def _transfer_block(
        self,
        dataset: AppendableDataset,
        block: np.ndarray,
        start: tuple[int, ...],
        stride: tuple[int, ...],
        count: tuple[int, ...],
        shape: tuple[int, ...],
    ) -> None:
        """Write a block, possibly empty, into `count` regions of a shape, `stride` apart."""
        space = dataset.id.get_space()
        if block.size:
            space.select_hyperslab(start, count, stride, shape)
            memory = h5py.h5s.create_simple(block.shape)
        else:
            block = np.zeros((1,) * block.ndim, dataset.dtype)
            space.select_none()
            memory = h5py.h5s.create_simple(block.shape)
            memory.select_none()
        dataset.id.write(memory, space, block, dxpl=self._transfer)

    def _flush(self) -> None:
        """Write the buffered blocks of all datasets."""
        with writing(self.path):
            for dataset in self._growing.values():
                self._flush_dataset(dataset)

    def close(
        self,
        finish: Callable[..., Any] = lambda file: None,
        conclude: Callable[..., Any] = lambda file: None,
        seal: bool = False,
    ) -> None:
        """Close the file, let rank 0 add the small datasets by finish(file), and rename the file.

        finish : writes to a file in memory, whose size is known before it is added to the file on disk
        conclude : adds data derived from the complete file, at most SPARE_BYTES
        seal : whether to append a digest of the whole file, which `is_intact` verifies
        """
        self._flush()
        self._growing.clear()
        with writing(self.path):
            if self.writes:
                self.file.close()
        self.comm.Barrier()
        self.file = None
        on_root(self.comm, lambda: _complete_file(self.temporary, self.path, finish, conclude, seal))

    def discard(self) -> None:
        """Remove the file. Not collective: called after an error, on the rank that raised it."""
        UNCLOSED_FILES.append(self.file)  # closing would wait for the other ranks, or write to a full disk
        self.temporary.unlink(missing_ok=True)

    def discard_after(self, error: BaseException) -> None:
        """Remove the file after an error, by `discard_all` if every rank raised it, or by `discard`."""
        self.discard_all() if is_on_every_rank(error) else self.discard()

    def discard_all(self) -> None:
        """Close and remove the file. Collective."""
        self._growing.clear()
        if self.writes and self.file is not None:
            self.file.close()
        self.comm.Barrier()
        if self.comm.rank == 0:
            self.discard()
        self.comm.Barrier()


def check_one_folder(comm: MPI.Comm, path: Path) -> None:
    """Check that every rank sees the folder in which all ranks will open a file. Collective.

    MPI would wait for ever for a rank that opens a file on another file system. Raises InputError.
    """
    if not HAS_PARALLEL_HDF5 or comm.size == 1:
        return
    probe = path.with_name(f".{path.name}.{comm.bcast(secrets.token_hex(8))}")

    def make() -> None:
        with writing(path):
            probe.touch()

    on_root(comm, make)
    blind = [rank for rank, is_visible in enumerate(comm.allgather(os.path.exists(probe))) if not is_visible]
    if comm.rank == 0:
        probe.unlink(missing_ok=True)
    if blind:
        folder = comm.bcast(path.parent.resolve())
        raise InputError(
            messages.FOLDER_NOT_SHARED(
                path=path, blind=len(blind), ranks=comm.size, first=blind[0], folder=folder
            )
        )


def _complete_file(
    temporary: Path, path: Path, finish: Callable[..., Any], conclude: Callable[..., Any], seal: bool = False
) -> None:
    """Add the small datasets to a closed file and rename it; arguments as of `SharedFile.close`. Rank 0."""
    with writing(path), locks.h5_in_memory() as small:
        finish(small)
        small.flush()
        locks.reserve_disk_space(temporary, temporary.stat().st_size + small.id.get_filesize() + SPARE_BYTES)
        with h5py.File(temporary, "r+") as file:
            locks.copy_all(small, file)
            conclude(file)
        locks.truncate_to_size(temporary)
        finish_file(temporary, path, seal)


def finish_file(temporary: Path, path: Path, seal: bool = False) -> None:
    """Rename a finished file to its path, once it is on disk; append a digest first if sealed."""
    if seal:
        with open(temporary, "r+b") as file:
            digest = hashlib.file_digest(file, "sha256").digest()
            file.seek(0, os.SEEK_END)
            file.write(SEAL + digest)
    locks.sync(temporary)
    os.replace(temporary, path)


def is_intact(path: Path) -> bool:
    """Return whether a sealed file is complete: it ends in a digest that matches its contents."""
    total = hashlib.sha256()
    try:
        with open(path, "rb") as file:
            sealed_bytes = os.fstat(file.fileno()).st_size - len(SEAL) - total.digest_size
            for start in range(0, sealed_bytes, HASH_BYTES):
                total.update(file.read(min(HASH_BYTES, sealed_bytes - start)))
            return file.read() == SEAL + total.digest()
    except OSError:
        return False


COPY_BYTES = 1 << 26  # buffer while segments are joined


def append_rows(source: h5py.File, target: h5py.File, limit: dict[str, int] | None = None) -> None:
    """Append the rows of every dataset of one file to the other's.

    limit : number of rows per dataset; datasets without an entry are left out
    """

    def copy(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if not isinstance(item, h5py.Dataset) or (limit is not None and name not in limit):
            return
        rows = item.shape[0] if limit is None else limit[name]
        if name not in target:
            layout = {"maxshape": (None, *item.shape[1:]), "chunks": item.chunks, "dtype": item.dtype}
            target.create_dataset(name, (0, *item.shape[1:]), **layout)
        target_rows, first = target[name], target[name].shape[0]
        target_rows.resize(first + rows, axis=0)
        row_bytes = item.dtype.itemsize * int(np.prod(item.shape[1:], dtype=np.int64))
        slab = max(1, COPY_BYTES // max(1, row_bytes))
        for begin in range(0, rows, slab):
            end = min(begin + slab, rows)
            target_rows[first + begin : first + end] = item[begin:end]

    source.visititems(copy)


def join_segments(
    segments: list[Path],
    temporary: Path,
    path: Path,
    finish: Callable[..., Any],
    conclude: Callable[..., Any],
) -> None:
    """Write the result file from its segments and the small datasets, then remove the segments. Rank 0.

    finish, conclude : as of `SharedFile.close`
    """
    with writing(path):
        size = sum(segment.stat().st_size for segment in segments) + SPARE_BYTES
        with locks.reserved_h5(temporary, size) as file:
            for segment in segments:
                with h5py.File(segment, "r") as part:
                    append_rows(part, file)
    _complete_file(temporary, path, finish, conclude)
    pattern = _temporary_file_pattern(path)  # matches files of this run and of earlier runs that were killed
    for old in [each for each in path.parent.iterdir() if pattern.fullmatch(each.name)]:
        old.unlink(missing_ok=True)


def _temporary_file_pattern(path: Path) -> re.Pattern[str]:
    """Return a pattern for temporary files of a result.

    They are segments, unfinished files, and the lock files that Open MPI leaves next to them.
    """
    name, stem = re.escape(path.name), re.escape(path.stem)
    segment = rf"\.{name}\.segment-[0-9a-f]{{8}}-(\d{{6,}}|recovered)"
    checkpoint = rf"({stem}\.|{name}-)checkpoint-\d-\d{{12,}}\.h5"
    return re.compile(rf"{segment}|\.({name}|{segment}|{checkpoint})\.part(-\d+-\d+\.lock)?")


def find_segments(
    folder: Path, names: list[str], rows: dict[str, int], results: list[Path], digest: str, target: Path
) -> list[Path]:
    """Return the segments of an interrupted run. If it finished, make one from its result file. Rank 0.

    results : possible paths of that file; target : name of the new segment
    Raises InputError if there is neither, or if a segment is damaged, OutputError if the disk is full.
    """
    segments = [folder / name for name in names]
    missing = next((segment for segment in segments if not is_intact(segment)), None)
    if missing is None:
        return segments
    for result in results:
        try:
            with h5py.File(result, "r") as file:
                if file["provenance"].attrs["job_digest"] == digest:
                    with locks.reserved_h5(target, result.stat().st_size + SPARE_BYTES) as part:
                        append_rows(file, part, rows)
                    finish_file(target, target, seal=True)
                    return [target]
        except (OSError, KeyError) as error:
            target.unlink(missing_ok=True)
            if isinstance(error, OSError) and error.errno in NO_SPACE:
                with writing(target):
                    raise
    raise InputError(messages.MISSING_SEGMENT(segment=missing, result=results[0]))
