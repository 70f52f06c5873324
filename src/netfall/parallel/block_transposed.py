"""The transposed of a matrix of `block_rows`."""

import numpy as np

from netfall.compile import kernel, part_of_kernel
from netfall.parallel.block_rows import BlockRows, blocks_of, place_here, rows_of, to_others


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
