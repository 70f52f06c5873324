"""One HDF5 file written by all ranks (MPI-IO), or by rank 0 where h5py is serial; whole or absent.

It is written under a temporary name and renamed at the end. Rows are appended in contiguous blocks, a rank
with an empty one included (h5py's own slicing would leave the others waiting for it in a collective write).
"""

import hashlib
import itertools
import math
import os
import secrets
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from netfall.ground.errors import InputError, OutputError
from netfall.parallel.agree import on_all, on_root
from netfall.parallel.mpi import MPI
from netfall.parallel.slabs import Slabs
from netfall.write.locks import give_back, reserve, size_of, sync, writing

PARALLEL = bool(h5py.get_config().mpi)
CHUNK_BYTES = 1 << 18
HELD_BYTES = 1 << 20  # of all ranks, that a dataset's blocks may wait for one another to be written together
DATASET_BYTES = 1 << 13  # of HDF5's own lists, at most: of a dataset without its chunks, ...
CHUNK_ENTRY_BYTES = 1 << 7  # ... and of each of these
SPARE_BYTES = 1 << 18  # of the disk, that are reserved ahead, and for labels of datasets
LEFT_OPEN: list[h5py.File | None] = []  # files that are not to be closed before the process ends
SEAL = b"netfall-sha256:"  # behind the HDF5 file, before the digest of all that precedes


@dataclass
class Growing:
    """A dataset that rows are appended to, kept open: looking it up takes longer than writing a row.

    row_bytes : of one row; rows : with those that wait
    waiting : (first row of all ranks' blocks, rows of them, place of this rank's block in them, this block)
    """

    id: h5py.h5d.DatasetID
    dtype: np.dtype
    rows: int
    tail: tuple[int, ...]
    row_bytes: int
    waiting: list[tuple[int, int, int, np.ndarray]]


class SharedFile:
    """Appends global rows to datasets of one file. Every method is collective.

    base : rows that each dataset has in files written before this one, of which this is the continuation
    """

    def __init__(self, comm: MPI.Comm, path: Path, base: dict[str, int] | None = None):
        self.comm = comm
        self.path = path
        self.base = dict(base or {})
        self.temporary = path.with_name(f".{path.name}.part")
        self.slabs = Slabs(comm, PARALLEL)
        self.writes = PARALLEL or comm.rank == 0
        self.file = None
        self._growing: dict[str, Growing] = {}
        self._size = 0  # bytes of the file so far, at most
        self._reserved = SPARE_BYTES  # of the disk, kept for it
        on_root(comm, self._first_room)
        try:
            on_all(comm, self._open)
        except OutputError:
            LEFT_OPEN.append(self.file)
            raise

    def _first_room(self) -> None:
        """What HDF5 writes of a file even if nothing is put into it; as much again is reserved then."""
        try:
            with writing(self.path):
                self.temporary.touch()
                reserve(self.temporary, self._reserved)
        except OutputError:
            self.temporary.unlink(missing_ok=True)
            raise

    def _open(self):
        with writing(self.path):
            if PARALLEL:
                self.file = h5py.File(self.temporary, "w", driver="mpio", comm=self.comm)
                self._transfer = h5py.h5p.create(h5py.h5p.DATASET_XFER)
                self._transfer.set_dxpl_mpio(h5py.h5fd.MPIO_COLLECTIVE)
            elif self.comm.rank == 0:
                self.file = h5py.File(self.temporary, "w")
                self._transfer = h5py.h5p.create(h5py.h5p.DATASET_XFER)
            if self.comm.rank == 0:
                reserve(self.temporary, self._reserved)  # opened as a new file, it has lost what it had

    def create(self, name: str, dtype, tail: tuple[int, ...] = (), rows: int = 1024) -> None:
        """An empty dataset that grows by rows of shape `tail`, some `rows` of them at a time."""
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
        """Rows of each dataset so far, those of earlier files included. On ranks that write."""
        self._write_all()
        found = dict(self.base)

        def add(name, item):
            if isinstance(item, h5py.Dataset):
                found[name] = found.get(name, 0) + item.shape[0]

        if self.writes:
            self.file.visititems(add)
        return found

    def append(self, name: str, block: np.ndarray, total: int, place: int | None = None) -> int:
        """Append `total` rows, of which this rank gives its block, at once or with later ones.

        Returns the first new row, those of earlier files counted.
        place : of the block in them, where it is not that of the rank's block of so many rows
        """
        if not self.writes:
            return 0
        with writing(self.path):
            kept = self._open_dataset(name)
            first = kept.rows
            kept.rows += total
            place = int(self.slabs.bounds(total)[self.comm.rank]) if place is None else place
            with np.errstate(over="ignore"):  # of what diverges, which is told
                copied = np.array(block, kept.dtype, order="C")  # its owner goes on
            kept.waiting.append((first, total, place, copied))
            if (kept.rows - kept.waiting[0][0]) * kept.row_bytes >= HELD_BYTES:
                self._write_waiting(kept)
        return first + self.base.get(name, 0)

    def put(self, name: str, block: np.ndarray, total: int, dtype=np.float64) -> None:
        """A new dataset of `total` rows, of which this rank gives its block."""
        self.create(name, dtype, block.shape[1:], total)
        self.append(name, block, total)

    def append_state(self, name: str, block: np.ndarray, total: int) -> None:
        """Append one state: a row (total, ...) of which this rank gives its block along the first axis."""
        if not self.writes:
            return
        with writing(self.path):
            kept = self._open_dataset(name)
            block = np.ascontiguousarray(block[None], kept.dtype)
            start = (kept.rows, int(self.slabs.bounds(total)[self.comm.rank]), *(0,) * (block.ndim - 2))
            kept.rows += 1
            self._extend(kept)
            self._transfer_block(kept, block, start, (1,) * block.ndim, (1,) * block.ndim, block.shape)

    def _extend(self, kept: Growing) -> None:
        """Give a dataset the rows that it is to have; whole chunks of it are then on the disk."""
        chunk = kept.id.get_create_plist().get_chunk()
        cells = [-(-size // part) for size, part in zip((kept.rows, *kept.tail), chunk)]
        before = [-(-size // part) for size, part in zip(kept.id.shape, chunk)]
        more = math.prod(cells) - math.prod(before)
        chunk_bytes = math.prod(chunk) * kept.dtype.itemsize
        self._make_room(more * (chunk_bytes + CHUNK_ENTRY_BYTES))
        kept.id.set_extent((kept.rows, *kept.tail))

    def _make_room(self, size: int) -> None:
        """Reserve so many bytes, and some to spare, before HDF5 needs them. Raises OutputError on all."""
        self._size += size
        if self._size <= self._reserved:
            return
        self._reserved = self._size + SPARE_BYTES

        def have():
            with writing(self.path):
                reserve(self.temporary, self._reserved)

        on_root(self.comm, have) if PARALLEL else have()

    def _open_dataset(self, name: str) -> Growing:
        if name not in self._growing:
            dataset = self.file[name]
            tail = dataset.shape[1:]
            self._growing[name] = Growing(
                dataset.id,
                dataset.dtype,
                dataset.shape[0],
                tail,
                dataset.dtype.itemsize * math.prod(tail),
                [],
            )
        return self._growing[name]

    def _write_waiting(self, kept: Growing) -> None:
        """Write the blocks that wait; those of equal size as one."""
        if kept.waiting:
            self._extend(kept)
        for total, group in itertools.groupby(kept.waiting, key=lambda waits: waits[1]):
            firsts, _, places, blocks = zip(*group)
            one = (1,) * len(kept.tail)
            start = (firsts[0] + places[0], *(0,) * len(kept.tail))
            self._transfer_block(
                kept,
                np.concatenate(blocks) if len(blocks) > 1 else blocks[0],
                start,
                (max(total, 1), *one),
                (len(blocks), *one),
                blocks[0].shape,
            )
        kept.waiting.clear()

    def _transfer_block(self, kept: Growing, block: np.ndarray, start, stride, count, shape) -> None:
        """Write a block into `count` places of a shape, `stride` apart; an empty block takes part."""
        space = kept.id.get_space()
        if block.size:
            space.select_hyperslab(start, count, stride, shape)
            memory = h5py.h5s.create_simple(block.shape)
        else:
            block = np.zeros((1,) * block.ndim, kept.dtype)
            space.select_none()
            memory = h5py.h5s.create_simple(block.shape)
            memory.select_none()
        kept.id.write(memory, space, block, dxpl=self._transfer)

    def _write_all(self) -> None:
        """Nothing waits any more."""
        with writing(self.path):
            for kept in self._growing.values():
                self._write_waiting(kept)

    def close(self, finish=lambda file: None, seal: bool = False) -> None:
        """Close, let rank 0 add the small datasets by finish(file), and give the file its name.

        seal : append a digest of the whole file, which `check_seal` verifies
        """
        self._write_all()
        self._growing.clear()
        with writing(self.path):
            if self.writes:
                self.file.close()
        self.comm.Barrier()
        self.file = None

        def last():
            with writing(self.path):
                reserve(self.temporary, self.temporary.stat().st_size + size_of(finish) + SPARE_BYTES)
                with h5py.File(self.temporary, "r+") as file:
                    finish(file)
                give_back(self.temporary)
                publish(self.temporary, self.path, seal)

        on_root(self.comm, last)

    def discard(self) -> None:
        """Leave nothing behind. Not collective: for the way out after an error, on the rank that saw it."""
        LEFT_OPEN.append(self.file)  # closing it would wait for the other ranks, or write to a full disk
        self.temporary.unlink(missing_ok=True)

    def discard_after(self, error: BaseException) -> None:
        """Leave nothing behind after an error: `discard_all` if every rank has it, else `discard`."""
        self.discard_all() if getattr(error, "on_every_rank", False) else self.discard()

    def discard_all(self) -> None:
        """Close without keeping anything. Collective."""
        self._growing.clear()
        if self.writes and self.file is not None:
            self.file.close()
        self.comm.Barrier()
        if self.comm.rank == 0:
            self.discard()
        self.comm.Barrier()


def check_one_folder(comm: MPI.Comm, path: Path) -> None:
    """Check that every rank sees the folder in which all of them are to open a file. Collective.

    MPI would wait for ever for a rank that opens a file of its own. Raises InputError.
    """
    if not PARALLEL or comm.size == 1:
        return
    mark = path.with_name(f".{path.name}.{comm.bcast(secrets.token_hex(8))}")

    def make():
        with writing(path):
            mark.touch()

    on_root(comm, make)
    blind = [rank for rank, sees in enumerate(comm.allgather(os.path.exists(mark))) if not sees]
    if comm.rank == 0:
        mark.unlink(missing_ok=True)
    if blind:
        folder = comm.bcast(path.parent.resolve())
        raise InputError(
            f"{path}: {len(blind)} of {comm.size} ranks, rank {blind[0]} first, cannot see what rank 0 "
            f"writes into {folder}; all ranks write one file: give a folder that all of them share with -o, "
            "and start them in the same working directory"
        )


def publish(temporary: Path, path: Path, seal: bool = False) -> None:
    """Give a finished file its name, once it is on disk; with a digest behind it if sealed."""
    if seal:
        with open(temporary, "r+b") as file:
            digest = hashlib.file_digest(file, "sha256").digest()
            file.seek(0, os.SEEK_END)
            file.write(SEAL + digest)
    sync(temporary)
    os.replace(temporary, path)


def check_seal(path: Path) -> bool:
    """Whether a sealed file is whole: its digest stands behind it and fits."""
    tail = len(SEAL) + 32
    try:
        with open(path, "rb") as file:
            size = file.seek(0, os.SEEK_END)
            if size < tail:
                return False
            file.seek(size - tail)
            mark, digest = file.read(len(SEAL)), file.read()
            file.seek(0)
            total, left = hashlib.sha256(), size - tail
            while left:
                block = file.read(min(left, 1 << 24))
                total.update(block)
                left -= len(block)
    except OSError:
        return False
    return mark == SEAL and total.digest() == digest
