"""Columns of numbers, placed in memory so that a step can read and write many of them at once.

The first-level cache holds eight lines with the same offset within a page. A step goes through some fifty
columns at once. The columns of a plain numpy array start at multiples of the row count. If that is close to a
multiple of 512, all have about the same offset and evict one another: a step then took up to 40 % longer.
"""

from typing import Any

import numpy as np

LINE, PAGE, MAX_ITEM_BYTES = 64, 4096, 8  # bytes of a cache line, a page, and the widest number
LINES = PAGE // LINE
COLUMN_OFFSET_LINES = 13  # cache lines, offset within a page from one column to the next
TABLE_OFFSET_LINES = 5  # cache lines, offset within a page from one table to the next


def allocate_columns(count: int, rows: int, dtype: Any, table: int = 0) -> np.ndarray:
    """Allocate zeros (count, rows or more): contiguous columns, each starting at a cache line.

    The padded row count does not depend on the type, so that one index is valid for all arrays.
    table : number of the table among those read together
    """
    lines = -(-rows * MAX_ITEM_BYTES // LINE)
    lines += (COLUMN_OFFSET_LINES - lines) % LINES
    length, size = lines * LINE // MAX_ITEM_BYTES, np.dtype(dtype).itemsize
    memory = np.zeros(count * length * size + 2 * PAGE, np.uint8)
    begin = -memory.ctypes.data % PAGE + TABLE_OFFSET_LINES * table % LINES * LINE
    return np.ndarray((count, length), dtype, memory.data, begin)


def padded_copy(array: np.ndarray) -> np.ndarray:
    """Copy an array (rows, width); each column is padded as by `allocate_columns`.

    The copy is never contiguous, so that kernels see one type.
    """
    rows, width = array.shape
    copy = allocate_columns(width, rows + 1, array.dtype)[:, :rows].T
    copy[:] = array
    return copy
