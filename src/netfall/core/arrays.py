"""Columns of numbers, placed in memory so that a step can read and write many of them at once.

The first-level cache holds eight lines with the same offset within a page. A step goes through some fifty
columns at once. The columns of a plain numpy array start at multiples of the row count. If that is close to a
multiple of 512, all have about the same offset and evict one another: a step then took up to 40 % longer.
"""

import numpy as np

LINE, PAGE, WIDEST = 64, 4096, 8  # bytes of a cache line, a page, and the widest number
LINES = PAGE // LINE
APART = 13  # cache lines, offset within a page from one column to the next
SHIFT = 5  # cache lines, offset within a page from one table to the next


def columns(count: int, rows: int, dtype, table: int = 0) -> np.ndarray:
    """Allocate zeros (count, rows or more): contiguous columns, each starting at a cache line.

    The padded row count does not depend on the type, so that one index is valid for all arrays.
    table : number of the table among those read together
    """
    lines = -(-rows * WIDEST // LINE)
    lines += (APART - lines) % LINES
    length, size = lines * LINE // WIDEST, np.dtype(dtype).itemsize
    memory = np.zeros(count * length * size + 2 * PAGE, np.uint8)
    begin = -memory.ctypes.data % PAGE + SHIFT * table % LINES * LINE
    return np.ndarray((count, length), dtype, memory.data, begin)


def placed(array: np.ndarray) -> np.ndarray:
    """Copy an array (rows, width) into such columns; never contiguous, so that kernels see one type."""
    rows, width = array.shape
    copy = columns(width, rows + 1, array.dtype)[:, :rows].T
    copy[:] = array
    return copy
