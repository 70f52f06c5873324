"""One HDF5 file written by all ranks (MPI-IO), or by rank 0 where h5py is serial; whole or absent.

It is written under a temporary name and renamed at the end. Rows are appended in contiguous blocks, a rank
with an empty one included (h5py's own slicing would leave the others waiting for it in a collective write).
"""

import os
from pathlib import Path

import h5py
import numpy as np
from mpi4py import MPI

from netfall.parallel.blocks import Blocks
from netfall.parallel.root import on_all

PARALLEL = bool(h5py.get_config().mpi)
CHUNK_BYTES = 1 << 18


class SharedFile:
    """Appends global rows to datasets of one file. Every method is collective."""

    def __init__(self, comm: MPI.Comm, path: Path):
        self.comm = comm
        self.path = path
        self.temporary = path.with_name(f".{path.name}.part")
        self.blocks = Blocks(comm, PARALLEL)
        self.writes = PARALLEL or comm.rank == 0
        self.file = None
        on_all(comm, self._open)

    def _open(self):
        if PARALLEL:
            self.file = h5py.File(self.temporary, "w", driver="mpio", comm=self.comm)
            self._transfer = h5py.h5p.create(h5py.h5p.DATASET_XFER)
            self._transfer.set_dxpl_mpio(h5py.h5fd.MPIO_COLLECTIVE)
        elif self.comm.rank == 0:
            self.file = h5py.File(self.temporary, "w")
            self._transfer = h5py.h5p.create(h5py.h5p.DATASET_XFER)

    def create(self, name: str, dtype, tail: tuple[int, ...] = ()) -> None:
        """An empty dataset that grows by rows of shape `tail`."""
        if self.writes:
            row = int(np.prod(tail, dtype=np.int64)) * np.dtype(dtype).itemsize
            if len(tail) == 2:  # whole states (rows of n x 3): chunks of one state
                chunks = (1, min(tail[0], max(1, CHUNK_BYTES // (tail[1] * np.dtype(dtype).itemsize))), tail[1])
            else:
                chunks = (max(1, CHUNK_BYTES // row),) + tail
            self.file.create_dataset(name, (0, *tail), maxshape=(None, *tail), chunks=chunks, dtype=dtype)

    def append(self, name: str, block: np.ndarray, total: int) -> int:
        """Append `total` rows, of which this rank gives its block; the first new row."""
        if not self.writes:
            return 0
        dataset = self.file[name]
        first = dataset.shape[0]
        dataset.resize(first + total, axis=0)
        self._write(dataset, block, first + self.blocks.bounds(total)[self.comm.rank])
        return first

    def append_state(self, name: str, block: np.ndarray, total: int) -> None:
        """Append one state: a row (total, ...) of which this rank gives its block along the first axis."""
        if not self.writes:
            return
        dataset = self.file[name]
        dataset.resize(dataset.shape[0] + 1, axis=0)
        self._write(dataset, block[None], dataset.shape[0] - 1, self.blocks.bounds(total)[self.comm.rank])

    def _write(self, dataset, block, *first):
        block = np.ascontiguousarray(block, dataset.dtype)
        space = dataset.id.get_space()
        if block.size:
            space.select_hyperslab((*map(int, first), *([0] * (block.ndim - len(first)))), block.shape)
            memory = h5py.h5s.create_simple(block.shape)
        else:
            block = np.zeros((1,) * block.ndim, dataset.dtype)
            space.select_none()
            memory = h5py.h5s.create_simple(block.shape)
            memory.select_none()
        dataset.id.write(memory, space, block, dxpl=self._transfer)

    def close(self, finish) -> None:
        """Close, let rank 0 add the small datasets by finish(file), and give the file its name."""
        on_all(self.comm, lambda: self.file.close() if self.writes else None)
        self.comm.Barrier()
        self.file = None

        def last():
            if self.comm.rank == 0:
                with h5py.File(self.temporary, "r+") as file:
                    finish(file)
                with open(self.temporary, "rb") as written:
                    os.fsync(written.fileno())
                os.replace(self.temporary, self.path)

        on_all(self.comm, last)

    def discard(self) -> None:
        """Leave nothing behind. Not collective: for the way out after an error."""
        if self.comm.rank == 0:
            self.temporary.unlink(missing_ok=True)
