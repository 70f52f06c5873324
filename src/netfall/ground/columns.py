"""Columns of numbers, placed in memory so that a step can read and write many of them side by side.

Of places that are alike within a page the first cache holds eight. The step goes through some fifty columns
at once. Those of arrays as numpy makes them begin where the number of rows has it: all alike where that is
near a multiple of 512, and then they push one another out: the step took up to 1.4 times as long.
"""

import numpy as np

LINE, PAGE, WIDEST = 64, 4096, 8  # bytes; of a number
LINES = PAGE // LINE
APART = 13  # lines within a page from one column to the next
SHIFT = 5  # lines within a page from one table to the next


def columns(count: int, rows: int, dtype, place: int = 0) -> np.ndarray:
    """Zeros (count, rows or some more): columns, each contiguous, the first at the begin of a line.

    As many rows whatever the type, so that an index that is right for one is so for all.
    place : a number of the table among those that are read beside it
    """
    lines = -(-rows * WIDEST // LINE)
    lines += (APART - lines) % LINES
    length, size = lines * LINE // WIDEST, np.dtype(dtype).itemsize
    room = np.zeros(count * length * size + 2 * PAGE, np.uint8)
    begin = -room.ctypes.data % PAGE + SHIFT * place % LINES * LINE
    return np.ndarray((count, length), dtype, room.data, begin)


def placed(array: np.ndarray) -> np.ndarray:
    """A copy of an array (rows, width), placed so; never contiguous, so that kernels get one type."""
    rows, width = array.shape
    copy = columns(width, rows + 1, array.dtype)[:, :rows].T
    copy[:] = array
    return copy
