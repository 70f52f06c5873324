"""Products and transposes of distributed block matrices.

The pattern of a result depends on the patterns of the factors alone, so it is computed once for all tangents
of a net. Blocks are multiplied and added in ascending global number of the rows of the second matrix. So each
block has the same bits on any number of ranks.
"""

import numpy as np

from netfall.core.arithmetic import fused
from netfall.core.kernels import kernel, part_of_kernel
from netfall.core.records import Record, f8_2, i4, i8
from netfall.core.types import FloatArray, IntArray, Integer
from netfall.statics.multigrid.rows import BlockRows, GhostRows, Pattern, ascending, local_place, row_starts

NO_BLOCKS = np.zeros((0, 9))


class FlatRows(Record):
    """Compressed rows of blocks: `rows.Rows` for kernels. block : (k, 9), empty if only the pattern counts"""

    start: i8
    column: i4
    block: f8_2


class Product:
    """Product of two matrices with given patterns; `pattern` is that of the product.

    ghosts : rows of the second one that other ranks own
    """

    def __init__(self, first: Pattern, second: Pattern):
        """Collective."""
        self.ghosts = GhostRows(second, first.ghosts.requested_places)
        rows = FlatRows(first.start, first.local, NO_BLOCKS), FlatRows(second.start, second.column, NO_BLOCKS)
        ghosts = FlatRows(self.ghosts.start, self.ghosts.column, NO_BLOCKS)
        slot, start = np.empty(second.columns.n, np.int32), np.zeros(len(first.start), np.int64)
        product_columns(*rows, ghosts, slot, start, np.empty(0, np.int32))
        column = np.empty(start[-1], np.int32)
        product_columns(*rows, ghosts, slot, start, column)
        sorted_rows = ascending(start, column, second.columns.n)
        self.pattern = Pattern(first.comm, *sorted_rows, first.rows, second.columns)

    def of(self, first: BlockRows, second: BlockRows) -> BlockRows:
        """Compute the product of two matrices. Collective."""
        ghosts, pattern = self.ghosts.of(second), self.pattern
        block, slot = np.zeros((len(pattern.column), 9)), np.empty(pattern.columns.n, np.int64)
        rows = (
            FlatRows(first.pattern.start, first.pattern.local, first.block.reshape(-1, 9)),
            FlatRows(second.pattern.start, second.pattern.column, second.block.reshape(-1, 9)),
            FlatRows(ghosts.start, ghosts.column, ghosts.block.reshape(-1, 9)),
        )
        add_products(*rows, pattern.start, pattern.column, slot, block)
        return BlockRows(pattern, block.reshape(-1, 3, 3))


@kernel
def product_columns(
    first: FlatRows, second: FlatRows, ghosts: FlatRows, slot: IntArray, start: IntArray, column: IntArray
) -> None:
    """Fill start (rows + 1,) and, if it is not empty, column (k,) of a product, in no order.

    first, second, ghosts : `FlatRows`, the last ones the second's rows of other ranks; slot : (n,) scratch
    """
    n, end = second.start.shape[0] - 1, 0
    for c in range(slot.shape[0]):
        slot[c] = -1
    for i in range(start.shape[0] - 1):
        start[i] = end
        for entry in range(first.start[i], first.start[i + 1]):
            j = first.column[entry]
            if j < n:
                end = _note_columns(i, second, j, slot, column, end)
            else:
                end = _note_columns(i, ghosts, j - n, slot, column, end)
    start[-1] = end


@part_of_kernel
def _note_columns(i: int, rows: FlatRows, j: int, slot: IntArray, column: IntArray, end: int) -> int:
    """Add the columns of row j to those of row i, marked by i in `slot`; return the new end."""
    for k in range(rows.start[j], rows.start[j + 1]):
        c = rows.column[k]
        if slot[c] != i:
            slot[c] = i
            if column.shape[0] > 0:
                column[end] = c
            end += 1
    return end


@part_of_kernel
def _add_product(a: FloatArray, i: Integer, b: FloatArray, j: Integer, c: FloatArray, k: Integer) -> None:
    """Compute c[k] += a[i] b[j] for blocks (9,)."""
    for row in range(3):
        u, v, w = a[i, 3 * row], a[i, 3 * row + 1], a[i, 3 * row + 2]
        for s in range(3):
            c[k, 3 * row + s] = fused(
                w, b[j, 6 + s], fused(v, b[j, 3 + s], fused(u, b[j, s], c[k, 3 * row + s]))
            )


@kernel
def add_products(
    first: FlatRows,
    second: FlatRows,
    ghosts: FlatRows,
    start: IntArray,
    column: IntArray,
    slot: IntArray,
    out: FloatArray,
) -> None:
    """Add the products of the rows to out (k, 9), zeros, with rows start (rows + 1,), column (k,).

    first, second, ghosts : see `product_columns`; slot : (n,) scratch
    """
    n = second.start.shape[0] - 1
    for i in range(np.uint64(start.shape[0] - 1)):
        for k in range(np.uint64(start[i]), np.uint64(start[i + 1])):
            slot[column[k]] = k
        for entry in range(np.uint64(first.start[i]), np.uint64(first.start[i + 1])):
            j = first.column[entry]
            if j < n:
                _add_row(first.block, entry, second, j, slot, out)
            else:
                _add_row(first.block, entry, ghosts, j - n, slot, out)


@part_of_kernel
def _add_row(block: FloatArray, entry: int, rows: FlatRows, j: int, slot: IntArray, out: FloatArray) -> None:
    """Add a block times row j to the row of a product whose columns are at `slot`."""
    for k in range(np.uint64(rows.start[j]), np.uint64(rows.start[j + 1])):
        _add_product(block, entry, rows.block, k, out, np.uint64(slot[rows.column[k]]))


class TransposedMatrix:
    """Transpose of a matrix with a given pattern; `pattern` is that of the transpose.

    entries : blocks that each rank needs; source : index of each block, own ones first
    """

    def __init__(self, matrix: Pattern):
        """Collective."""
        self.comm, own_rows = matrix.comm, matrix.rows.mine
        rank = matrix.columns.rank[matrix.column]
        self.entries = [
            np.flatnonzero(rank == target) if target != self.comm.rank else np.zeros(0, int)
            for target in range(self.comm.size)
        ]
        sent = [(matrix.row[entries], matrix.column[entries]) for entries in self.entries]
        row, column = (np.concatenate(arrays) for arrays in zip(*self.comm.alltoall(sent)))
        number = np.concatenate([own_rows, row]).astype(np.int32)
        local_index = local_place(self.comm, matrix.columns)
        local_row = local_index[np.concatenate([matrix.column, column])]
        start = row_starts(np.bincount(local_row[local_row >= 0], minlength=len(matrix.columns.mine)))
        row, self.source = np.empty((2, start[-1]), np.int32)
        order = np.argsort(number, kind="stable")
        transpose_rows(
            order,
            number,
            matrix.start,
            matrix.column,
            column,
            local_index,
            start[:-1].copy(),
            row,
            self.source,
        )
        self.pattern = Pattern(self.comm, start, row, matrix.columns, matrix.rows)

    def of(self, matrix: BlockRows) -> BlockRows:
        """Compute the transpose of a matrix. Collective."""
        received = np.concatenate(self.comm.alltoall([matrix.block[entries] for entries in self.entries]))
        block = np.empty((len(self.source), 3, 3))
        transpose_blocks(self.source, matrix.block, received, block)
        return BlockRows(self.pattern, block)


@kernel
def transpose_rows(
    order: IntArray,
    number: IntArray,
    begin: IntArray,
    column: IntArray,
    more_column: IntArray,
    place: IntArray,
    free_place: IntArray,
    row: IntArray,
    source: IntArray,
) -> None:
    """Fill row (k,) and source (k,) of a transpose.

    order : rows by ascending number; rows after the own ones have one entry each, in `more_column`
    number : of the rows; begin, column : of own ones; place : of each column on this rank, or -1
    free_place : first place of the entries of each column, overwritten
    """
    n = begin.shape[0] - 1
    for r in order:
        first, end = (begin[r], begin[r + 1]) if r < n else (begin[n] + r - n, begin[n] + r - n + 1)
        for k in range(first, end):
            c = place[column[k] if r < n else more_column[r - n]]
            if c >= 0:
                row[free_place[c]], source[free_place[c]] = number[r], k
                free_place[c] += 1


@kernel
def transpose_blocks(source: IntArray, own: FloatArray, more: FloatArray, out: FloatArray) -> None:
    """Fill out (k, 3, 3) with transposed blocks of `own` and, with indices that continue, `more`."""
    for k in range(source.shape[0]):
        e = source[k]
        for i in range(3):
            for j in range(3):
                out[k, i, j] = own[e, j, i] if e < own.shape[0] else more[e - own.shape[0], j, i]
