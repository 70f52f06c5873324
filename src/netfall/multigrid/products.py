"""The product of three matrices of `rows` that makes a coarser one.

What is summed is summed in ascending global number of the finer rows, so that each block has the same bits on
any number of ranks. Rows of the product of the last two matrices are made one at a time and not kept: memory
that is touched for the first time costs more than the arithmetic.
"""

import numpy as np
from mpi4py import MPI

from netfall.ground.compile import kernel, part_of_kernel
from netfall.multigrid.rows import (
    BlockRows,
    Rows,
    ascending,
    blocks_of,
    entries_of,
    place_here,
    rows_of,
    to_others,
)


def _from_owners(comm: MPI.Comm, rows: Rows, asked: list[np.ndarray]) -> Rows:
    """The rows that this rank asked others for. Collective. asked : of each rank the rows that it asks for"""
    out = []
    for places in asked:
        counts, entries = entries_of(np.diff(rows.start), places)
        out.append((counts, rows.column[entries], rows.block[entries]))
    counts, column, block = (np.concatenate(each) for each in zip(*comm.alltoall(out)))
    return Rows(np.concatenate([[0], np.cumsum(counts)]), column, block)


def coarser(matrix: BlockRows, up: BlockRows, down: BlockRows) -> BlockRows:
    """down times matrix times up, where down is the transposed of up. Collective."""
    comm, columns = matrix.comm, up.columns
    slot, asked = np.full(columns.n, -1, np.int32), down.ghosts.asked
    parts = (
        rows_of(matrix.local),
        rows_of(up.own),
        _from_owners(comm, rows_of(up.own), matrix.ghosts.asked),
    )
    ghosts = _from_owners(comm, parts[1], asked), _products_of_ghosts(comm, parts, asked, slot)
    own = _pattern(down, parts, ghosts[1], slot)
    order = np.argsort(np.concatenate([matrix.rows.mine, down.ghosts.number]), kind="stable")
    product = np.empty(columns.n, np.int32), np.empty((columns.n, 3, 3))
    add_products(order, parts, ghosts, place_here(comm, columns), slot, *product, own)
    return BlockRows(comm, blocks_of(own.block, own.column, own.start, columns.n), columns, columns)


def _products_of_ghosts(comm: MPI.Comm, parts, asked: list[np.ndarray], slot: np.ndarray) -> Rows:
    """The rows of matrix times up that this rank asked others for. Collective.

    parts, slot : of `product_row`; asked : of each rank the rows that it asks for
    """
    fine, up, beyond = parts
    places = np.concatenate(asked)
    _, entries = entries_of(np.diff(fine.start), places)
    lengths = np.concatenate([np.diff(up.start), np.diff(beyond.start)])
    most = lengths[fine.column[entries]].sum()
    rows = Rows(np.zeros(len(places) + 1, np.int64), np.empty(most, np.int32), np.empty((most, 3, 3)))
    product_rows(places, parts, slot, rows)
    ends = np.cumsum([len(each) for each in asked])
    return _from_owners(comm, rows, np.split(np.arange(len(places)), ends[:-1]))


def _pattern(down: BlockRows, parts, products: Rows, slot: np.ndarray) -> Rows:
    """The coarser matrix, columns ascending, with zeros for blocks."""
    below = down.local.indptr, down.local.indices
    start, none = np.zeros(len(below[0]), np.int64), np.empty(0, np.int32)
    coarse_columns(*below, parts, products, slot, start, none)
    column = np.empty(start[-1], np.int32)
    coarse_columns(*below, parts, products, slot, start, column)
    slot[:] = -1
    return Rows(*ascending(start, column, len(slot)), np.zeros((len(column), 3, 3)))


@part_of_kernel
def _add_row(matrix, entry, rows, row, slot, column, block, end):
    """Add an entry of a matrix times a row of another to a row of the product; the new end of this."""
    for k in range(rows.start[row], rows.start[row + 1]):
        c = rows.column[k]
        s = slot[c]
        if s < 0:
            s = slot[c] = end
            column[end] = c
            for i in range(3):
                for j in range(3):
                    block[end, i, j] = 0.0
            end += 1
        for i in range(3):
            for j in range(3):
                b = block[s, i, j]
                for m in range(3):
                    b += matrix[entry, i, m] * rows.block[k, m, j]
                block[s, i, j] = b
    return end


@part_of_kernel
def _product_row(p, parts, slot, column, block, first):
    """Put row p of matrix times up at column[first:] and block[first:], in no order; its end.

    parts : `Rows` of the matrix, of up and of the latter's ghosts; columns of the matrix count through both
    slot : (n,) of -1, as it is again afterwards
    """
    fine, up, beyond = parts
    n, end = up.start.shape[0] - 1, first
    for entry in range(fine.start[p], fine.start[p + 1]):
        j = fine.column[entry]
        if j < n:
            end = _add_row(fine.block, entry, up, j, slot, column, block, end)
        else:
            end = _add_row(fine.block, entry, beyond, j - n, slot, column, block, end)
    for k in range(first, end):
        slot[column[k]] = -1
    return end


@kernel
def product_rows(places, parts, slot, out):
    """Fill `Rows` out, long enough, with some rows of matrix times up; parts, slot : of `_product_row`"""
    end = 0
    for i in range(places.shape[0]):
        out.start[i] = end
        end = _product_row(places[i], parts, slot, out.column, out.block, end)
    out.start[-1] = end


@part_of_kernel
def _note_columns(a, rows, j, slot, column, end):
    """Add the columns of a row to those of coarse row a, which are marked by its number; the new end."""
    for k in range(rows.start[j], rows.start[j + 1]):
        c = rows.column[k]
        if slot[c] != a:
            slot[c] = a
            if column.shape[0] > 0:
                column[end] = c
            end += 1
    return end


@kernel
def coarse_columns(begin, member, parts, products, slot, start, column):
    """Fill start (rows + 1,) and, if it is not empty, column (k,) of the coarser matrix.

    begin, member : compressed rows of down; parts : of `_product_row`; products : those of ghosts
    slot : (n,) scratch
    """
    fine, up, beyond = parts
    n, ups, end = fine.start.shape[0] - 1, up.start.shape[0] - 1, 0
    for c in range(slot.shape[0]):
        slot[c] = -1
    for a in range(start.shape[0] - 1):
        start[a] = end
        for place in range(begin[a], begin[a + 1]):
            p = member[place]
            if p >= n:
                end = _note_columns(a, products, p - n, slot, column, end)
                continue
            for entry in range(fine.start[p], fine.start[p + 1]):
                j = fine.column[entry]
                if j < ups:
                    end = _note_columns(a, up, j, slot, column, end)
                else:
                    end = _note_columns(a, beyond, j - ups, slot, column, end)
    start[-1] = end


@kernel
def add_products(order, parts, ghosts, place, slot, column, block, out):
    """Add what each finer row brings to the blocks of the coarser matrix, `Rows` out.

    order : the finer rows by their number, ascending, ghosts after own ones; ghosts : `Rows` of up, of matrix
    times up; place : (n,) of each coarse row here, or -1; parts, slot : of `_product_row`; column (n,), block
    (n, 3, 3) : scratch
    """
    fine, up, _ = parts
    others, products = ghosts
    n = fine.start.shape[0] - 1
    for r in order:
        if r < n:
            end = _product_row(r, parts, slot, column, block, 0)
            for k in range(up.start[r], up.start[r + 1]):
                _add_member(up, k, place, column, block, 0, end, out)
        else:
            g = r - n
            first, end = products.start[g], products.start[g + 1]
            for k in range(others.start[g], others.start[g + 1]):
                _add_member(others, k, place, products.column, products.block, first, end, out)


@part_of_kernel
def _add_member(up, k, place, column, block, first, end, out):
    """Add the transposed entry k of up times a row of the product to a row of the coarser matrix."""
    a = place[up.column[k]]
    if a < 0:
        return
    for m in range(first, end):
        low, high = out.start[a], out.start[a + 1] - 1
        while low < high:
            middle = (low + high) // 2
            if out.column[middle] < column[m]:
                low = middle + 1
            else:
                high = middle
        for i in range(3):
            for j in range(3):
                b = out.block[low, i, j]
                for way in range(3):
                    b += up.block[k, way, i] * block[m, way, j]
                out.block[low, i, j] = b


def transposed(matrix: BlockRows) -> BlockRows:
    """The transposed matrix, in single precision. Collective."""
    comm, own, mine = matrix.comm, rows_of(matrix.own), matrix.rows.mine
    more = _entries_of_others(matrix)
    number = np.concatenate([mine, more[0]]).astype(np.int32)
    start = np.zeros(len(matrix.columns.mine) + 1, np.int64)
    place = place_here(comm, matrix.columns)
    count_columns(own.column, place, start)
    count_columns(more[1], place, start)
    np.cumsum(start, out=start)
    row, block = np.empty(start[-1], np.int32), np.empty((start[-1], 3, 3), np.float32)
    order = np.argsort(number, kind="stable")
    transpose_rows(order, number, own, more[1], more[2], place, start[:-1].copy(), row, block)
    return BlockRows(comm, blocks_of(block, row, start, matrix.rows.n), matrix.columns, matrix.rows)


def _entries_of_others(matrix: BlockRows) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row, column and block (k, 3, 3), in single precision, of others' entries in this rank's columns."""
    comm, own = matrix.comm, matrix.own
    rank = matrix.columns.rank[own.indices] if comm.size > 1 else None
    parts = []
    for to in range(comm.size):
        entries = np.flatnonzero(rank == to) if to != comm.rank else np.zeros(0, int)
        row = matrix.rows.mine[np.searchsorted(own.indptr, entries, "right") - 1]
        parts.append((row, own.indices[entries], own.data[entries].astype(np.float32)))
    row, column, block = (np.concatenate(each) for each in zip(*to_others(comm, parts)))
    return row, column, block


@kernel
def count_columns(column, place, start):
    """Add the entries of each column, by its place, to start[place + 1]."""
    for k in range(column.shape[0]):
        c = place[column[k]]
        if c >= 0:
            start[c + 1] += 1


@kernel
def transpose_rows(order, number, own, more_column, more_block, place, free_place, row, block):
    """Fill row (k,) and block (k, 3, 3) of a transposed matrix.

    order : rows by their number, ascending; those after the own ones have one entry each, of `more`
    number : of the rows; own : `Rows`; place : of each column here, or -1
    free_place : where the entries of each column begin, overwritten
    """
    n = own.start.shape[0] - 1
    for r in order:
        if r < n:
            for k in range(own.start[r], own.start[r + 1]):
                _put(number[r], place[own.column[k]], own.block, k, free_place, row, block)
        else:
            _put(number[r], place[more_column[r - n]], more_block, r - n, free_place, row, block)


@part_of_kernel
def _put(number, c, from_block, k, free_place, row, block):
    """Entry k of a row goes to column c, if that is here."""
    if c < 0:
        return
    to = free_place[c]
    row[to] = number
    for i in range(3):
        for j in range(3):
            block[to, j, i] = from_block[k, i, j]
    free_place[c] = to + 1
