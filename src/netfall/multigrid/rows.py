"""Sparse matrices of 3 x 3 blocks in double precision, their rows spread over the ranks.

A row keeps its blocks in ascending global number of the column, and a product sums in that order. So it has
the same bits on any number of ranks.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from mpi4py import MPI


class Owners:
    """Which rank owns which rows of a matrix, or of a vector; all ranks know it.

    mine : global numbers of this rank's rows, in its order; rank, place : (n,) the owner of each row, and
        where the row stands there
    """

    def __init__(self, comm: MPI.Comm, mine: np.ndarray):
        """Collective."""
        everyone = comm.allgather(mine)
        self.mine, self.n = mine, sum(map(len, everyone))
        self.rank, self.place = np.empty((2, self.n), np.int32)
        for rank, own in enumerate(everyone):
            self.rank[own], self.place[own] = rank, np.arange(len(own))


class Ghosts(NamedTuple):
    """What a rank needs of others' rows, and they of its own.

    number : global numbers, owner by owner, each owner's ascending; counts : (ranks,) of each owner
    asked : of each rank the places of this rank's rows that it needs
    """

    number: np.ndarray
    counts: np.ndarray
    asked: list[np.ndarray]

    def joined(self, comm: MPI.Comm, own: np.ndarray) -> np.ndarray:
        """This rank's rows (n, ...), then those that it needs of others. Collective."""
        return np.concatenate([own, *comm.alltoall([own[places] for places in self.asked])])


def ghosts_of(comm: MPI.Comm, wanted: np.ndarray, owners: Owners) -> Ghosts:
    """The ghosts among rows that a rank needs, by global numbers in any order and number. Collective."""
    needs = np.zeros(owners.n, bool)
    needs[wanted] = True
    needs[owners.mine] = False
    number = np.flatnonzero(needs)
    number = number[np.argsort(owners.rank[number], kind="stable")]
    counts = np.bincount(owners.rank[number], minlength=comm.size)
    asked = comm.alltoall(np.split(owners.place[number], np.cumsum(counts)[:-1]))
    return Ghosts(number, counts, asked)


def to_others(comm: MPI.Comm, parts: list) -> list:
    """What each rank has for this one, of parts for each; its own part is not copied. Collective."""
    own = parts[comm.rank]
    got = comm.alltoall([None if rank == comm.rank else part for rank, part in enumerate(parts)])
    got[comm.rank] = own
    return got


class BlockRows:
    """The rows of a matrix that this rank owns."""

    def __init__(self, comm: MPI.Comm, own, rows: Owners, columns: Owners):
        """own : scipy BSR array (3 rows of this rank, 3 columns of all ranks), columns ascending in a row."""
        self.comm, self.own, self.rows, self.columns = comm, own, rows, columns

    @cached_property
    def ghosts(self) -> Ghosts:
        """Columns that others own. Collective at first."""
        return ghosts_of(self.comm, self.own.indices, self.columns)

    @cached_property
    def local(self):
        """The same rows, columns as they stand on this rank, then ghosts. Collective at first."""
        place = self.columns.place.copy()
        first = len(self.columns.mine)
        place[self.ghosts.number] = first + np.arange(len(self.ghosts.number), dtype=np.int32)
        column = place[self.own.indices]
        n_columns = first + len(self.ghosts.number)
        return blocks_of(self.own.data, column, self.own.indptr, n_columns)

    def times_vector(self, x: np.ndarray) -> np.ndarray:
        """The product (rows, 3) with a vector of rows (columns, 3) on each rank. Collective."""
        return (self.local @ self.ghosts.joined(self.comm, x).ravel()).reshape(-1, 3)

    def diagonal(self) -> np.ndarray:
        """The blocks (rows, 3, 3) on the diagonal of a square matrix."""
        return self.own.data[self.own.indices == self.rows.mine[_row_of_each(self.own)]]

    def everywhere(self) -> "BlockRows":
        """A square matrix, all of whose rows each rank has. Collective."""
        own = self.own
        parts = self.comm.allgather((self.rows.mine, np.diff(own.indptr), own.indices, own.data))
        row, counts, column, block = (np.concatenate(each) for each in zip(*parts))
        counts, entries = entries_of(counts, np.argsort(row))
        start = np.concatenate([[0], np.cumsum(counts)])
        owners = Owners(MPI.COMM_SELF, np.arange(self.rows.n))
        whole = blocks_of(block[entries], column[entries], start, self.rows.n)
        return BlockRows(MPI.COMM_SELF, whole, owners, owners)

    def dense(self) -> np.ndarray:
        """The whole matrix (3 rows, 3 columns of all) on every rank. Collective."""
        whole = np.zeros((self.rows.n, 3, self.columns.n, 3))
        whole[self.rows.mine[_row_of_each(self.own)], :, self.own.indices] = self.own.data
        self.comm.Allreduce(MPI.IN_PLACE, whole, MPI.SUM)  # one term that is not zero: no rounding
        return whole.reshape(3 * self.rows.n, -1)


class Rows(NamedTuple):
    """Compressed rows of blocks.

    start : (rows + 1,) where those of each begin; column : (k,); block : (k, 3, 3)
    """

    start: np.ndarray
    column: np.ndarray
    block: np.ndarray


def rows_of(matrix) -> Rows:
    """Those of a scipy BSR array."""
    return Rows(matrix.indptr, matrix.indices, matrix.data)


def place_here(comm: MPI.Comm, owners: Owners) -> np.ndarray:
    """Where each row (n,) stands on this rank, -1: on another."""
    return np.where(owners.rank == comm.rank, owners.place, np.int32(-1))


def blocks_of(block: np.ndarray, column: np.ndarray, start: np.ndarray, n_columns: int):
    """A scipy BSR array of blocks (k, 3, 3) in rows of blocks from start (rows + 1,)."""
    from scipy.sparse import bsr_array

    # Of unlike integers scipy would copy the columns, to the wider ones.
    start = start.astype(column.dtype, copy=False)
    return bsr_array((block, column, start), shape=(3 * (len(start) - 1), 3 * n_columns))


def ascending(start: np.ndarray, column: np.ndarray, n_columns: int) -> tuple[np.ndarray, np.ndarray]:
    """The same compressed rows, the columns of each in ascending order."""
    from scipy.sparse import csr_array

    shape = len(start) - 1, n_columns
    rows = csr_array((np.empty(len(column), bool), column, start), shape)
    rows.sort_indices()
    return rows.indptr, rows.indices


def _row_of_each(matrix) -> np.ndarray:
    return np.repeat(np.arange(len(matrix.indptr) - 1), np.diff(matrix.indptr))


def entries_of(counts: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of compressed rows with so many entries: how many some of them have, and where these stand."""
    start, counts = (np.cumsum(counts) - counts)[rows], counts[rows]
    return counts, np.repeat(start - (np.cumsum(counts) - counts), counts) + np.arange(counts.sum())
