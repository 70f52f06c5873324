"""Sparse matrices of 3 x 3 blocks in single precision, their rows spread over the ranks, for preconditioners.

A row sums its blocks in ascending global number of the column, so a product has the same bits on any number
of ranks.
"""

from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from netfall.arithmetic import fused
from netfall.compile import kernel, part_of_kernel

TAG = 31


class Share(NamedTuple):
    """What one rank has of a matrix, and of the vectors that it multiplies.

    start (rows + 1,), column (k,) local int32, block (k, 9) float32 : compressed rows
    n_columns : owned by this rank; ghosts follow them
    senders, receive_counts : ranks that send ghosts, and how many; receivers, send_index : whom this rank
        sends which of its own
    """

    start: np.ndarray
    column: np.ndarray
    block: np.ndarray
    n_columns: int
    senders: list[int]
    receive_counts: list[int]
    receivers: list[int]
    send_index: list[np.ndarray]


def shares(matrix, rows: list[np.ndarray], columns: list[np.ndarray]) -> list[Share]:
    """The shares of all ranks of a scipy BSR matrix of 3 x 3 blocks, sorted columns.

    rows, columns : the global numbers that each rank owns, in its own order
    """
    owner = np.empty(matrix.shape[1] // 3, np.int64)
    place = np.empty_like(owner)
    for rank, own in enumerate(columns):
        owner[own], place[own] = rank, np.arange(len(own))
    cut = [_cut(matrix, own, owner, place, rank, columns) for rank, own in enumerate(rows)]
    wanted = [_by_owner(ghosts, owner) for _, ghosts in cut]
    done = []
    for rank, ((start, column, block), _) in enumerate(cut):
        receivers = [other for other in range(len(rows)) if rank in wanted[other]]
        done.append(
            Share(
                start,
                column,
                block,
                len(columns[rank]),
                list(wanted[rank]),
                [len(ids) for ids in wanted[rank].values()],
                receivers,
                [place[wanted[other][rank]] for other in receivers],
            )
        )
    return done


def _cut(matrix, own, owner, place, rank: int, columns):
    """Rows `own` of a matrix with local columns, and the global numbers of the ghosts among these."""
    counts = np.diff(matrix.indptr)[own]
    start = np.concatenate([[0], np.cumsum(counts)])
    entry = np.repeat(matrix.indptr[own] - start[:-1], counts) + np.arange(start[-1])
    column = matrix.indices[entry]
    ghosts = np.unique(column[owner[column] != rank])
    ghosts = ghosts[np.argsort(owner[ghosts], kind="stable")]
    local = place.copy()
    local[ghosts] = len(columns[rank]) + np.arange(len(ghosts))
    block = matrix.data[entry].reshape(-1, 9).astype(np.float32)
    return (start, local[column].astype(np.int32), block), ghosts


def _by_owner(ghosts: np.ndarray, owner: np.ndarray) -> dict[int, np.ndarray]:
    return {int(rank): ghosts[owner[ghosts] == rank] for rank in np.unique(owner[ghosts])}


@kernel
def multiply_rows(start, column, block, x, y):
    """y (rows, 3) = blocks times x (columns, 3)."""
    for i in range(np.uint64(start.shape[0] - 1)):
        a, b, c = np.float32(0.0), np.float32(0.0), np.float32(0.0)
        for k in range(np.uint64(start[i]), np.uint64(start[i + 1])):
            j = np.uint64(column[k])
            u, v, w = x[j, 0], x[j, 1], x[j, 2]
            a = fused(block[k, 2], w, fused(block[k, 1], v, fused(block[k, 0], u, a)))
            b = fused(block[k, 5], w, fused(block[k, 4], v, fused(block[k, 3], u, b)))
            c = fused(block[k, 8], w, fused(block[k, 7], v, fused(block[k, 6], u, c)))
        y[i, 0], y[i, 1], y[i, 2] = a, b, c


@part_of_kernel
def add_step(i, inverse, r, s, t, scale, keep, step):
    """Row i of step = keep step + scale inverse (r, s, t).

    inverse : (n, 6), of symmetric blocks the entries 00, 01, 02, 11, 12, 22
    """
    a, b, c = inverse[i, 0], inverse[i, 1], inverse[i, 2]
    d, e, f = inverse[i, 3], inverse[i, 4], inverse[i, 5]
    step[i, 0] = fused(scale, fused(c, t, fused(b, s, a * r)), keep * step[i, 0])
    step[i, 1] = fused(scale, fused(e, t, fused(d, s, b * r)), keep * step[i, 1])
    step[i, 2] = fused(scale, fused(f, t, fused(e, s, c * r)), keep * step[i, 2])


@kernel
def first_step(inverse, b, scale, step):
    """step = scale inverse b: the step from zero. All (rows, 3); inverse : as in `add_step`"""
    for i in range(step.shape[0]):
        step[i, 0] = step[i, 1] = step[i, 2] = 0.0
        add_step(i, inverse, b[i, 0], b[i, 1], b[i, 2], scale, scale, step)


@kernel
def step_rows(start, column, block, inverse, b, x, scale, keep, step):
    """step = keep step + scale inverse (b - blocks times x). All (rows, 3); inverse : as in `add_step`"""
    for i in range(np.uint64(start.shape[0] - 1)):
        r, s, t = b[i, 0], b[i, 1], b[i, 2]
        for k in range(np.uint64(start[i]), np.uint64(start[i + 1])):
            j = np.uint64(column[k])
            u, v, w = x[j, 0], x[j, 1], x[j, 2]
            r = fused(-block[k, 2], w, fused(-block[k, 1], v, fused(-block[k, 0], u, r)))
            s = fused(-block[k, 5], w, fused(-block[k, 4], v, fused(-block[k, 3], u, s)))
            t = fused(-block[k, 8], w, fused(-block[k, 7], v, fused(-block[k, 6], u, t)))
        add_step(i, inverse, r, s, t, scale, keep, step)


@kernel
def dot_rows(a, b, out):
    """Products (n,) of the rows of two arrays (n, 3)."""
    for p in range(out.shape[0]):
        out[p] = a[p, 0] * b[p, 0] + a[p, 1] * b[p, 1] + a[p, 2] * b[p, 2]


@kernel
def advance(step, p, q, s, left, before):
    """s += step p; before = left; left -= step q. All (n, 3), step a number."""
    for i in range(s.shape[0]):
        for k in range(3):
            s[i, k] += step * p[i, k]
            before[i, k] = left[i, k]
            left[i, k] -= step * q[i, k]


@kernel
def turn(share, z, p):
    """p = z + share p. Both (n, 3), share a number."""
    for i in range(p.shape[0]):
        for k in range(3):
            p[i, k] = z[i, k] + share * p[i, k]


class SpreadMatrix:
    """The product of a matrix with a vector, rows (n_owned, 3) float32 of both on each rank."""

    def __init__(self, comm: MPI.Comm, all_shares: list[Share] | None):
        """Collective. all_shares : on rank 0."""
        self.comm = comm
        self.share: Share = comm.scatter(all_shares)
        ghosts = sum(self.share.receive_counts)
        self.x = np.zeros((self.share.n_columns + ghosts, 3), np.float32)
        self.own = self.x[: self.share.n_columns]
        self.y = np.zeros((len(self.share.start) - 1, 3), np.float32)
        self.out = [np.empty((len(index), 3), np.float32) for index in self.share.send_index]

    def __call__(self, x: np.ndarray | None = None) -> np.ndarray:
        """The rows of the product, in an array that the next call overwrites. Collective.

        x : (n_columns, 3); None: what is in `own`
        """
        share = self.share
        if x is not None:
            self.own[:] = x
        self._exchange()
        multiply_rows(share.start, share.column, share.block, self.x, self.y)
        return self.y

    def take_step(self, b: np.ndarray, inverse: np.ndarray, scale, keep, step: np.ndarray) -> None:
        """step = keep step + scale inverse (b - product with `own`), and add it to `own`. Collective."""
        share = self.share
        self._exchange()
        step_rows(share.start, share.column, share.block, inverse, b, self.x, scale, keep, step)
        self.own += step

    def _exchange(self) -> None:
        requests, row, share = [], self.share.n_columns, self.share
        if not (share.senders or share.receivers):
            return
        for rank, count in zip(share.senders, share.receive_counts):
            requests.append(self.comm.Irecv(self.x[row : row + count], rank, TAG))
            row += count
        for rank, index, out in zip(share.receivers, share.send_index, self.out):
            np.take(self.x, index, axis=0, out=out)
            requests.append(self.comm.Isend(out, rank, TAG))
        MPI.Request.Waitall(requests)
