"""The product of three matrices of `rows` that makes a coarser one, and transposed matrices.

Where blocks come to stand depends on the places of the others alone. So it is found once for all tangents of
a net; blocks are then multiplied and added up in that order: in ascending global number of the finer rows, so
that each block has the same bits on any number of ranks. Rows of the product of the last two matrices are
made one at a time and not kept: memory that is touched for the first time costs more than the arithmetic.
"""

import numpy as np

from netfall.core.kernels import kernel, part_of_kernel
from netfall.core.records import Record, f8_2, i4, i8
from netfall.multigrid.rows import (
    BlockRows,
    Borrowed,
    Pattern,
    Rows,
    ascending,
    entries_of,
    place_here,
    starts_of,
)
from netfall.numerics.arithmetic import fused


class FlatRows(Record):
    """Compressed rows of blocks: `rows.Rows` for kernels. block : (k, 9), absent where places alone count"""

    start: i8
    column: i4
    block: f8_2


class Coarser:
    """Makes down times matrix times up, where down is the transposed of up. `pattern` is that of the product.

    order : the finer rows by their number, ascending, ghosts after own ones
    beyond, others : rows of up that are ghosts of the matrix, of down
    own, lent : rows of matrix times up of this rank, in that order, and those that others need
    place : (k,) where each block of a row of up times one of that product is added, -1: nowhere here
    """

    def __init__(self, matrix: Pattern, up: Pattern, down: Pattern):
        """Collective."""
        self.comm, self.matrix, asked, columns = matrix.comm, matrix, down.ghosts.asked, up.columns
        self.beyond, self.others = Borrowed(up, matrix.ghosts.asked), Borrowed(up, asked)
        parts = (
            _places(matrix.start, matrix.local),
            _places(up.start, up.column),
            _places(self.beyond.start, self.beyond.column),
        )
        number = np.concatenate([matrix.rows.mine, down.ghosts.number])
        slot = np.full(columns.n, -1, np.int32)
        self.order = np.argsort(number, kind="stable")
        self.own = _ProductRows(self.order[self.order < len(matrix.rows.mine)], parts, slot)
        self.lent = _ProductRows(np.concatenate(asked), parts, slot)
        ends = np.cumsum([len(each) for each in asked])[:-1]
        self.ends = self.lent.start[ends]
        counts = np.concatenate(self.comm.alltoall(np.split(np.diff(self.lent.start), ends)))
        self.products = starts_of(counts), self._from_others(self.lent.column)
        products = _places(*self.products)
        start, none = np.zeros(len(down.start), np.int64), np.empty(0, np.int32)
        coarse_columns(down.start, down.local, *parts, products, slot, start, none)
        column = np.empty(start[-1], np.int32)
        coarse_columns(down.start, down.local, *parts, products, slot, start, column)
        self.pattern = Pattern(self.comm, *ascending(start, column, columns.n), columns, columns)
        own, here = _places(self.own.start, self.own.column), place_here(self.comm, columns)
        others = _places(self.others.start, self.others.column)
        of_own = np.diff(up.start)[self.own.places] @ np.diff(self.own.start)
        of_ghosts = np.diff(self.others.start) @ np.diff(self.products[0])
        self.place = np.empty(of_own + of_ghosts, np.int32)
        into = self.pattern.start, self.pattern.column, self.place
        place_products(self.order, parts[1], others, products, own, here, *into)

    def _from_others(self, lent: np.ndarray) -> np.ndarray:
        """What others lend this rank, of columns or blocks that it lends. Collective."""
        return np.concatenate(self.comm.alltoall(np.split(lent, self.ends)))

    def of(self, matrix: BlockRows, up: BlockRows) -> BlockRows:
        """Collective."""
        parts = tuple(_flat(each) for each in (matrix.local, up.local, self.beyond.of(up)))
        lent = np.zeros((len(self.lent.column), 9))
        product_rows(self.lent.places, *parts, self.lent.start, self.lent.spot, lent)
        ghosts = _flat(self.others.of(up)), FlatRows(*self.products, self._from_others(lent))
        block, scratch = np.zeros((len(self.pattern.column), 9)), np.empty((self.own.widest, 9))
        add_products(self.order, *parts, *ghosts, self.own.start, self.own.spot, self.place, scratch, block)
        return BlockRows(self.pattern, block.reshape(-1, 3, 3))


def _places(start: np.ndarray, column: np.ndarray) -> FlatRows:
    return FlatRows(start, column, np.zeros((0, 9)))


def _flat(rows: Rows) -> FlatRows:
    return FlatRows(rows.start, rows.column, rows.block.reshape(-1, 9))


class _ProductRows:
    """Some rows of matrix times up: start (rows + 1,), column (k,), in no order.

    spot : where in its row each block of the matrix times one of up is added
    """

    def __init__(self, places: np.ndarray, parts, slot: np.ndarray):
        """places : of the rows; parts : `FlatRows` of the matrix, of up, of the latter's ghosts; columns of
        the matrix count through both; slot : (n,) of -1, as it is again afterwards
        """
        fine, up, beyond = parts
        lengths = np.concatenate([np.diff(up.start), np.diff(beyond.start)])
        _, entries = entries_of(np.diff(fine.start), places)
        most = lengths[fine.column[entries]].sum()
        self.places, self.start = places.astype(np.int64), np.zeros(len(places) + 1, np.int64)
        self.spot, column = np.empty((2, most), np.int32)
        product_columns(self.places, *parts, slot, self.start, column, self.spot)
        self.column = column[: self.start[-1]].copy()
        self.widest = int(np.diff(self.start).max(initial=0))


@kernel
def product_columns(places, fine, up, beyond, slot, start, column, spot):
    """Fill start, column and spot of `_ProductRows`; fine, up, beyond : its parts; slot : as there."""
    n, count, end = up.start.shape[0] - 1, 0, 0
    for i in range(places.shape[0]):
        start[i] = end
        for entry in range(fine.start[places[i]], fine.start[places[i] + 1]):
            j = fine.column[entry]
            rows = up if j < n else beyond
            j = j if j < n else j - n
            for k in range(rows.start[j], rows.start[j + 1]):
                c = rows.column[k]
                if slot[c] < 0:
                    slot[c] = end - start[i]
                    column[end] = c
                    end += 1
                spot[count] = slot[c]
                count += 1
        for k in range(start[i], end):
            slot[column[k]] = -1
    start[-1] = end


@part_of_kernel
def _note_columns(a, rows, j, slot, column, end):
    """Add the columns of row j to those of coarse row a, which are marked by its number; the new end."""
    for k in range(rows.start[j], rows.start[j + 1]):
        c = rows.column[k]
        if slot[c] != a:
            slot[c] = a
            if column.shape[0] > 0:
                column[end] = c
            end += 1
    return end


@kernel
def coarse_columns(begin, member, fine, up, beyond, products, slot, start, column):
    """Fill start (rows + 1,) and, if it is not empty, column (k,) of the coarser matrix, in no order.

    begin, member : rows of down; fine, up, beyond : parts of `_ProductRows`; products : of ghosts
    slot : (n,) scratch
    """
    n, ups, end = fine.start.shape[0] - 1, up.start.shape[0] - 1, 0
    for c in range(slot.shape[0]):
        slot[c] = -1
    for a in range(start.shape[0] - 1):
        start[a] = end
        for entry in range(begin[a], begin[a + 1]):
            p = member[entry]
            if p >= n:
                end = _note_columns(a, products, p - n, slot, column, end)
                continue
            for of_fine in range(fine.start[p], fine.start[p + 1]):
                j = fine.column[of_fine]
                if j < ups:
                    end = _note_columns(a, up, j, slot, column, end)
                else:
                    end = _note_columns(a, beyond, j - ups, slot, column, end)
    start[-1] = end


@kernel
def place_products(order, up, others, products, own, here, start, column, place):
    """Fill `place` of `Coarser`. up, others (ghosts of it), products (of matrix times up), own : `FlatRows`

    order : of `Coarser`; here : (n,) where each coarse row is, or -1; start, column : of the coarser matrix
    """
    n, count, i = up.start.shape[0] - 1, 0, 0
    for r in order:
        if r < n:
            count = _place_row(up, r, own, i, here, start, column, place, count)
            i += 1
        else:
            count = _place_row(others, r - n, products, r - n, here, start, column, place, count)


@part_of_kernel
def _place_row(up, r, product, i, here, start, column, place, count):
    for k in range(up.start[r], up.start[r + 1]):
        a = here[up.column[k]]
        for m in range(product.start[i], product.start[i + 1]):
            low = -1
            if a >= 0:
                low, high = start[a], start[a + 1] - 1
                while low < high:
                    middle = (low + high) // 2
                    if column[middle] < product.column[m]:
                        low = middle + 1
                    else:
                        high = middle
            place[count] = low
            count += 1
    return count


@part_of_kernel
def _add_product(a, i, b, j, c, k):
    """c[k] += a[i] b[j], of blocks (9,)."""
    for row in range(3):
        u, v, w = a[i, 3 * row], a[i, 3 * row + 1], a[i, 3 * row + 2]
        for s in range(3):
            c[k, 3 * row + s] = fused(
                w, b[j, 6 + s], fused(v, b[j, 3 + s], fused(u, b[j, s], c[k, 3 * row + s]))
            )


@part_of_kernel
def _add_transposed(a, i, b, j, c, k):
    """c[k] += a[i]^T b[j]."""
    for row in range(3):
        u, v, w = a[i, row], a[i, 3 + row], a[i, 6 + row]
        for s in range(3):
            c[k, 3 * row + s] = fused(
                w, b[j, 6 + s], fused(v, b[j, 3 + s], fused(u, b[j, s], c[k, 3 * row + s]))
            )


@part_of_kernel
def _add_row(p, fine, up, beyond, spot, count, first, out):
    """Add row p of matrix times up to out[first:]; how far in spot it got. fine, up, beyond : `FlatRows`"""
    n = up.start.shape[0] - 1
    for entry in range(np.uint64(fine.start[p]), np.uint64(fine.start[p + 1])):
        j = fine.column[entry]
        if j < n:
            for k in range(np.uint64(up.start[j]), np.uint64(up.start[j + 1])):
                _add_product(fine.block, entry, up.block, k, out, np.uint64(first + spot[count]))
                count += 1
        else:
            j -= n
            for k in range(np.uint64(beyond.start[j]), np.uint64(beyond.start[j + 1])):
                _add_product(fine.block, entry, beyond.block, k, out, np.uint64(first + spot[count]))
                count += 1
    return count


@kernel
def product_rows(places, fine, up, beyond, start, spot, out):
    """Add some rows of matrix times up to zeros, out (k, 9). Others : of `_ProductRows`"""
    count = 0
    for i in range(places.shape[0]):
        count = _add_row(places[i], fine, up, beyond, spot, count, start[i], out)


@kernel
def add_products(order, fine, up, beyond, others, products, start, spot, place, scratch, out):
    """Add what each finer row brings to the blocks of the coarser matrix, zeros, out (k, 9).

    fine, up, beyond : `FlatRows` of the matrix, of up, of ghosts of that; others, products : ghosts of up, of
    matrix times up; start, spot : of own rows, as of `_ProductRows`; order, place : of `Coarser`
    scratch : (most, 9)
    """
    n, at, count, i = up.start.shape[0] - 1, 0, 0, 0
    for r in order:
        if r < n:
            width = start[i + 1] - start[i]
            i += 1
            for m in range(width):
                for s in range(9):
                    scratch[m, s] = 0.0
            at = _add_row(r, fine, up, beyond, spot, at, 0, scratch)
            for k in range(np.uint64(up.start[r]), np.uint64(up.start[r + 1])):
                for m in range(np.uint64(width)):
                    if place[count] >= 0:
                        _add_transposed(up.block, k, scratch, m, out, np.uint64(place[count]))
                    count += 1
        else:
            g = r - n
            for k in range(np.uint64(others.start[g]), np.uint64(others.start[g + 1])):
                for m in range(np.uint64(products.start[g]), np.uint64(products.start[g + 1])):
                    if place[count] >= 0:
                        _add_transposed(others.block, k, products.block, m, out, np.uint64(place[count]))
                    count += 1


class Transposed:
    """Makes the transposed of a matrix, in single precision. `pattern` is its.

    entries : of each rank the blocks that it needs; source : which block, own ones first, each one is
    """

    def __init__(self, matrix: Pattern):
        """Collective."""
        self.comm, mine = matrix.comm, matrix.rows.mine
        rank = matrix.columns.rank[matrix.column]
        self.entries = [
            np.flatnonzero(rank == to) if to != self.comm.rank else np.zeros(0, int)
            for to in range(self.comm.size)
        ]
        parts = [(matrix.row[entries], matrix.column[entries]) for entries in self.entries]
        row, column = (np.concatenate(each) for each in zip(*self.comm.alltoall(parts)))
        number = np.concatenate([mine, row]).astype(np.int32)
        place = place_here(self.comm, matrix.columns)
        here = place[np.concatenate([matrix.column, column])]
        start = starts_of(np.bincount(here[here >= 0], minlength=len(matrix.columns.mine)))
        row, self.source = np.empty((2, start[-1]), np.int32)
        order = np.argsort(number, kind="stable")
        transpose_rows(
            order, number, matrix.start, matrix.column, column, place, start[:-1].copy(), row, self.source
        )
        self.pattern = Pattern(self.comm, start, row, matrix.columns, matrix.rows)

    def of(self, matrix: BlockRows) -> BlockRows:
        """Collective."""
        more = np.concatenate(self.comm.alltoall([matrix.block[entries] for entries in self.entries]))
        block = np.empty((len(self.source), 3, 3), np.float32)
        transpose_blocks(self.source, matrix.block, more, block)
        return BlockRows(self.pattern, block)


@kernel
def transpose_rows(order, number, begin, column, more_column, place, free_place, row, source):
    """Fill row (k,) and source (k,) of a transposed matrix.

    order : rows by their number, ascending; those after the own ones have one entry each, of `more`
    number : of the rows; begin, column : of own ones; place : of each column here, or -1
    free_place : where the entries of each column begin, overwritten
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
def transpose_blocks(source, own, more, out):
    """Fill out (k, 3, 3) with transposed blocks, of own ones and, counted on, more."""
    for k in range(source.shape[0]):
        e = source[k]
        for i in range(3):
            for j in range(3):
                out[k, i, j] = own[e, j, i] if e < own.shape[0] else more[e - own.shape[0], j, i]
