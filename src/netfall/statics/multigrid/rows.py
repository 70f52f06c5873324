"""Sparse matrices of 3 x 3 blocks in double precision, with rows distributed over the ranks; their products.

A row keeps its blocks in ascending global number of the column. The pattern of a product or a transpose
depends on the patterns of the factors alone, so it is computed once for all tangents of a net. A product
multiplies and adds blocks in ascending global number of the rows of the second matrix. So it has the same
bits on any number of ranks.
"""

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from netfall.core.arithmetic import fused
from netfall.core.arrays import FloatArray, IntArray
from netfall.core.kernels import kernel
from netfall.parallel.mpi import MPI


class Owners:
    """Distribution of the rows of a matrix or vector over the ranks, known to all ranks.

    own_gid : of this rank's rows, in its order; rank, place : (n,) the owner of each row, and its
        index on that rank
    """

    def __init__(self, comm: MPI.Comm, own_gid: np.ndarray):
        """Collective."""
        gid_of_ranks = comm.allgather(own_gid)
        self.own_gid, self.n = own_gid, sum(map(len, gid_of_ranks))
        self.rank, self.place = np.empty((2, self.n), np.int32)
        for rank, rows in enumerate(gid_of_ranks):
            self.rank[rows], self.place[rows] = rank, np.arange(len(rows))


class Ghosts(NamedTuple):
    """Rows of other ranks that a rank needs, and rows of its own that others need.

    number : global numbers, ordered by owner, ascending for each owner; counts : (ranks,) of each owner
    requested_places : for each rank the places of this rank's rows that it needs
    """

    number: np.ndarray
    counts: np.ndarray
    requested_places: list[np.ndarray]

    def joined(self, comm: MPI.Comm, own: np.ndarray) -> np.ndarray:
        """Return this rank's rows (n, ...), followed by its ghosts. Collective."""
        return with_received(comm, self.requested_places, own)

    def local_rows(self, needed_gid: np.ndarray, owners: Owners) -> np.ndarray:
        """Return the local rows of global numbers (k,): own rows first, then ghosts."""
        row = owners.place.copy()
        row[self.number] = len(owners.own_gid) + np.arange(len(self.number), dtype=np.int32)
        return row[needed_gid]


def with_received(
    comm: MPI.Comm, entries: list[np.ndarray], values: np.ndarray, own: Any = slice(None)
) -> np.ndarray:
    """Return rows `own` of values, followed by those that other ranks send. Collective.

    entries : for each rank the rows of values that it needs; own : all of them on a single rank
    """
    if comm.size == 1:
        return values
    return np.concatenate([values[own], *comm.alltoall([values[rows] for rows in entries])])


def ghosts_of(comm: MPI.Comm, needed_gid: np.ndarray, owners: Owners) -> Ghosts:
    """Find the ghosts among rows that a rank needs, by global numbers in any order and number. Collective."""
    needs = np.zeros(owners.n, bool)
    needs[needed_gid] = True
    needs[owners.own_gid] = False
    number = np.flatnonzero(needs)
    number = number[np.argsort(owners.rank[number], kind="stable")]
    counts = np.bincount(owners.rank[number], minlength=comm.size)
    requested = comm.alltoall(np.split(owners.place[number], np.cumsum(counts)[:-1]))
    return Ghosts(number, counts, requested)


class Pattern:
    """Pattern of the blocks in the rows of a rank."""

    def __init__(self, comm: MPI.Comm, start: np.ndarray, column: np.ndarray, rows: Owners, columns: Owners):
        """start : (rows + 1,) first block of each; column : (k,) global numbers, ascending in a row"""
        self.comm, self.rows, self.columns = comm, rows, columns
        self.start, self.column = start.astype(np.int64, copy=False), column.astype(np.int32, copy=False)

    @cached_property
    def ghosts(self) -> Ghosts:
        """Return the columns that other ranks own. Collective at the first call."""
        return ghosts_of(self.comm, self.column, self.columns)

    @cached_property
    def local(self) -> np.ndarray:
        """Return the local indices (k,) of the columns: own ones, then ghosts.

        Collective at the first call.
        """
        return self.ghosts.local_rows(self.column, self.columns)

    @cached_property
    def row(self) -> np.ndarray:
        """Return the global number (k,) of the row of each block."""
        return np.repeat(self.rows.own_gid, np.diff(self.start))

    @cached_property
    def diagonal(self) -> np.ndarray:
        """Return the indices (rows,) of the diagonal blocks of a square matrix."""
        return np.flatnonzero(self.column == self.row)


class BlockRows:
    """Rows of a matrix that this rank owns: blocks (k, 3, 3) in a pattern."""

    def __init__(self, pattern: Pattern, block: np.ndarray):
        self.pattern, self.block = pattern, block
        self.comm, self.rows, self.columns = pattern.comm, pattern.rows, pattern.columns

    def diagonal(self) -> np.ndarray:
        """Return the diagonal blocks (rows, 3, 3) of a square matrix."""
        return self.block[self.pattern.diagonal]


def blocks_of(block: np.ndarray, column: np.ndarray, start: np.ndarray, n_columns: int) -> Any:
    """Build a scipy BSR array of blocks (k, 3, 3) with rows of blocks from start (rows + 1,)."""
    from scipy.sparse import bsr_array

    # with different integer types scipy would copy the columns to the wider one
    start = start.astype(column.dtype, copy=False)
    return bsr_array((block, column, start), shape=(3 * (len(start) - 1), 3 * n_columns))


def product_pattern(
    start: np.ndarray, column: np.ndarray, row_start: np.ndarray, row_column: np.ndarray, n_columns: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the compressed rows of the product of two matrices, with ascending columns.

    start, column : rows of the first one; row_start, row_column : of the second one
    """
    from scipy.sparse import csr_array

    n_rows = len(row_start) - 1
    first = csr_array((np.ones(len(column), bool), column, start), (len(start) - 1, n_rows))
    second = csr_array((np.ones(len(row_column), bool), row_column, row_start), (n_rows, n_columns))
    product = first @ second
    product.sort_indices()
    return product.indptr, product.indices


def row_starts(counts: np.ndarray) -> np.ndarray:
    """Return the first entry of rows with these counts (rows + 1,)."""
    return np.concatenate([[0], np.cumsum(counts)])


def row_entries(counts: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Select rows of a compressed matrix: return their numbers of entries, and the indices of the entries.

    counts : entries of each row of the matrix; rows : the selected ones
    """
    start, counts = (np.cumsum(counts) - counts)[rows], counts[rows]
    return counts, np.repeat(start - (np.cumsum(counts) - counts), counts) + np.arange(counts.sum())


class CompressedRows(NamedTuple):
    """Blocks (k, 9) of the rows of a matrix, as kernels take them.

    start : (rows + 1,) first block of each row; column : (k,) of each block
    """

    start: IntArray
    column: IntArray
    block: FloatArray


class Product:
    """Product of two matrices with given patterns; `pattern` is that of the product.

    start, column : rows of the second one that this rank needs: own ones, then those of other ranks
    entries : blocks of the second one that each rank needs of this one
    """

    def __init__(self, first: Pattern, second: Pattern):
        """Collective."""
        counts, self.first = np.diff(second.start), first
        self.entries = [row_entries(counts, places)[1] for places in first.ghosts.requested_places]
        self.start = row_starts(first.ghosts.joined(first.comm, counts))
        self.column = with_received(first.comm, self.entries, second.column)
        rows = product_pattern(first.start, first.local, self.start, self.column, second.columns.n)
        self.pattern = Pattern(first.comm, *rows, first.rows, second.columns)

    def of(self, first: BlockRows, second: BlockRows) -> BlockRows:
        """Compute the product of two matrices. Collective."""
        pattern = self.pattern
        block, slot = np.zeros((len(pattern.column), 9)), np.empty(pattern.columns.n, np.int64)
        needed = with_received(first.comm, self.entries, second.block)
        add_products(
            CompressedRows(self.first.start, self.first.local, first.block.reshape(-1, 9)),
            CompressedRows(self.start, self.column, needed.reshape(-1, 9)),
            CompressedRows(pattern.start, pattern.column, block),
            slot,
        )
        return BlockRows(pattern, block.reshape(-1, 3, 3))


@kernel
def add_products(a: CompressedRows, b: CompressedRows, out: CompressedRows, slot: IntArray) -> None:
    """Add the products of rows of blocks of a and b to the blocks of `out`, zeros. slot : (n,) scratch"""
    first, second, c = a.block, b.block, out.block
    for i in range(np.uint64(out.start.shape[0] - 1)):
        for k in range(np.uint64(out.start[i]), np.uint64(out.start[i + 1])):
            slot[out.column[k]] = k
        for entry in range(np.uint64(a.start[i]), np.uint64(a.start[i + 1])):
            j = np.uint64(a.column[entry])
            for m in range(np.uint64(b.start[j]), np.uint64(b.start[j + 1])):
                k = np.uint64(slot[b.column[m]])
                for row in range(3):
                    u, v, w = first[entry, 3 * row], first[entry, 3 * row + 1], first[entry, 3 * row + 2]
                    for s in range(3):
                        total = fused(u, second[m, s], c[k, 3 * row + s])
                        c[k, 3 * row + s] = fused(w, second[m, 6 + s], fused(v, second[m, 3 + s], total))


class TransposedMatrix:
    """Transpose of a matrix with a given pattern; `pattern` is that of the transpose.

    own, entries : blocks that this rank needs, and those that each other rank needs of it
    order : of the own blocks and then the received ones in the transpose
    """

    def __init__(self, matrix: Pattern):
        """Collective."""
        self.comm, owner = matrix.comm, matrix.columns.rank[matrix.column]
        self.own = np.flatnonzero(owner == self.comm.rank)
        self.entries = [np.flatnonzero(owner == rank) for rank in range(self.comm.size)]
        self.entries[self.comm.rank] = self.own[:0]
        row, column = (
            with_received(self.comm, self.entries, numbers, self.own)
            for numbers in (matrix.row.astype(np.int32), matrix.column)
        )
        place = matrix.columns.place[column]
        self.order = np.lexsort((row, place))
        start = row_starts(np.bincount(place, minlength=len(matrix.columns.own_gid)))
        self.pattern = Pattern(self.comm, start, row[self.order], matrix.columns, matrix.rows)

    def of(self, matrix: BlockRows) -> BlockRows:
        """Compute the transpose of a matrix. Collective."""
        block = with_received(self.comm, self.entries, matrix.block, self.own)
        return BlockRows(self.pattern, np.ascontiguousarray(block.transpose(0, 2, 1)[self.order]))
