"""Products and transposes of distributed block matrices.

The pattern of a result depends on the patterns of the factors alone, so it is computed once for all tangents
of a net. Blocks are multiplied and added in ascending global number of the rows of the second matrix. So each
block has the same bits on any number of ranks.
"""

import numpy as np

from netfall.core.arithmetic import fused
from netfall.core.arrays import FloatArray, IntArray
from netfall.core.kernels import kernel
from netfall.statics.multigrid.rows import (
    BlockRows,
    Pattern,
    product_pattern,
    row_entries,
    row_starts,
    with_received,
)


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
        add_products(
            self.first.start,
            self.first.local,
            first.block.reshape(-1, 9),
            self.start,
            self.column,
            with_received(first.comm, self.entries, second.block).reshape(-1, 9),
            pattern.start,
            pattern.column,
            slot,
            block,
        )
        return BlockRows(pattern, block.reshape(-1, 3, 3))


@kernel
def add_products(
    start: IntArray,
    column: IntArray,
    a: FloatArray,
    row_start: IntArray,
    row_column: IntArray,
    b: FloatArray,
    out_start: IntArray,
    out_column: IntArray,
    slot: IntArray,
    c: FloatArray,
) -> None:
    """Add the products of rows of blocks a and b (k, 9) to c (k, 9), zeros.

    start, row_start, out_start : (rows + 1,) first block of each row of a, b and c; column, row_column,
        out_column : of each block; slot : (n,) scratch
    """
    for i in range(np.uint64(out_start.shape[0] - 1)):
        for k in range(np.uint64(out_start[i]), np.uint64(out_start[i + 1])):
            slot[out_column[k]] = k
        for entry in range(np.uint64(start[i]), np.uint64(start[i + 1])):
            j = np.uint64(column[entry])
            for m in range(np.uint64(row_start[j]), np.uint64(row_start[j + 1])):
                k = np.uint64(slot[row_column[m]])
                for row in range(3):
                    u, v, w = a[entry, 3 * row], a[entry, 3 * row + 1], a[entry, 3 * row + 2]
                    for s in range(3):
                        c[k, 3 * row + s] = fused(
                            w, b[m, 6 + s], fused(v, b[m, 3 + s], fused(u, b[m, s], c[k, 3 * row + s]))
                        )


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
        start = row_starts(np.bincount(place, minlength=len(matrix.columns.mine)))
        self.pattern = Pattern(self.comm, start, row[self.order], matrix.columns, matrix.rows)

    def of(self, matrix: BlockRows) -> BlockRows:
        """Compute the transpose of a matrix. Collective."""
        block = with_received(self.comm, self.entries, matrix.block, self.own)
        return BlockRows(self.pattern, np.ascontiguousarray(block.transpose(0, 2, 1)[self.order]))
