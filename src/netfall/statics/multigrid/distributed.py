"""Sparse matrices of 3 x 3 blocks in single precision, with rows distributed over the ranks.

Preconditioners use them. A row sums its blocks in ascending global number of the column, so a product has
the same bits on any number of ranks.
"""

from typing import Any

import numpy as np

from netfall.core.arithmetic import fused
from netfall.core.arrays import FloatArray
from netfall.core.kernels import kernel
from netfall.parallel.mpi import MPI
from netfall.statics.multigrid.rows import BlockRows, CompressedRows, Ghosts

TAG = 31


@kernel
def multiply_rows(rows: CompressedRows, x: FloatArray, y: FloatArray) -> None:
    """Compute y (rows, 3) = blocks times x (columns, 3)."""
    start, column, block = rows
    for i in range(np.uint64(start.shape[0] - 1)):
        a, b, c = np.float32(0.0), np.float32(0.0), np.float32(0.0)
        for k in range(np.uint64(start[i]), np.uint64(start[i + 1])):
            j = np.uint64(column[k])
            u, v, w = x[j, 0], x[j, 1], x[j, 2]
            a = fused(block[k, 2], w, fused(block[k, 1], v, fused(block[k, 0], u, a)))
            b = fused(block[k, 5], w, fused(block[k, 4], v, fused(block[k, 3], u, b)))
            c = fused(block[k, 8], w, fused(block[k, 7], v, fused(block[k, 6], u, c)))
        y[i, 0], y[i, 1], y[i, 2] = a, b, c


@kernel
def step_rows(rows: Any, inverse: Any, b: Any, x: Any, scale: Any, keep: Any, step: Any) -> None:
    """Compute step = keep step + scale inverse (b - blocks times x).

    rows : `CompressedRows`; inverse : (n, 6), the entries 00, 01, 02, 11, 12, 22 of symmetric blocks
    """
    start, column, block = rows
    for i in range(np.uint64(step.shape[0])):
        r, s, t = b[i, 0], b[i, 1], b[i, 2]
        for k in range(np.uint64(start[i]), np.uint64(start[i + 1])):
            j = np.uint64(column[k])
            u, v, w = x[j, 0], x[j, 1], x[j, 2]
            r = fused(-block[k, 2], w, fused(-block[k, 1], v, fused(-block[k, 0], u, r)))
            s = fused(-block[k, 5], w, fused(-block[k, 4], v, fused(-block[k, 3], u, s)))
            t = fused(-block[k, 8], w, fused(-block[k, 7], v, fused(-block[k, 6], u, t)))
        A, B, C = inverse[i, 0], inverse[i, 1], inverse[i, 2]
        D, E, F = inverse[i, 3], inverse[i, 4], inverse[i, 5]
        step[i, 0] = fused(scale, fused(C, t, fused(B, s, A * r)), keep * step[i, 0])
        step[i, 1] = fused(scale, fused(E, t, fused(D, s, B * r)), keep * step[i, 1])
        step[i, 2] = fused(scale, fused(F, t, fused(E, s, C * r)), keep * step[i, 2])


def dot_rows(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the inner products (n,) of the rows of two arrays (n, 3)."""
    products = a * b
    return products[:, 0] + products[:, 1] + products[:, 2]


class SharedRows:
    """Rows float32 (n, 3) of this rank, `own`, with the needed rows of others: `rows`, own ones first."""

    def __init__(self, comm: MPI.Comm, n: int, ghosts: Ghosts):
        self.comm, self.rows = comm, np.zeros((n + len(ghosts.number), 3), np.float32)
        self.own = self.rows[:n]
        ends = n + np.cumsum(ghosts.counts)
        self.receives = [
            (rank, self.rows[end - count : end])
            for rank, (end, count) in enumerate(zip(ends, ghosts.counts))
            if count
        ]
        self.sends = [
            (rank, places, np.empty((len(places), 3), np.float32))
            for rank, places in enumerate(ghosts.requested_places)
            if len(places)
        ]

    def share(self) -> None:
        """Send `own` to the ranks that need it and receive their rows. Collective."""
        requests = [self.comm.Irecv(rows, rank, TAG) for rank, rows in self.receives]
        for rank, places, out in self.sends:
            np.take(self.rows, places, axis=0, out=out)
            requests.append(self.comm.Isend(out, rank, TAG))
        MPI.Request.Waitall(requests)


class DistributedMatrix:
    """Product of a matrix with a vector, with rows float32 (rows, 3) of both on each rank."""

    def __init__(self, rows: BlockRows):
        """Collective."""
        self.shared = SharedRows(rows.comm, len(rows.columns.own_gid), rows.pattern.ghosts)
        self.share, self.x, self.own = self.shared.share, self.shared.rows, self.shared.own
        block = rows.block.reshape(-1, 9).astype(np.float32, copy=False)
        self.blocks = CompressedRows(rows.pattern.start, rows.pattern.local, block)
        self.y = np.zeros((len(self.blocks.start) - 1, 3), np.float32)

    def __call__(self, x: np.ndarray | None = None) -> np.ndarray:
        """Return the rows of the product, in an array that the next call overwrites. Collective.

        x : (n_columns, 3); None: the shared content of `own`
        """
        if x is not None:
            self.own[:] = x
            self.share()
        multiply_rows(self.blocks, self.x, self.y)
        return self.y

    def take_step(self, b: np.ndarray, inverse: np.ndarray, scale: Any, keep: Any, step: np.ndarray) -> None:
        """Compute step = keep step + scale inverse (b - product with `own`), add it to `own`, and share.

        Collective.
        """
        step_rows(self.blocks, inverse, b, self.x, scale, keep, step)
        self.own += step
        self.share()
