"""Arrays: their types for annotations, columns placed in memory for the time loop, sets of integers.

The first-level cache holds eight lines with the same offset within a page. A time step accesses some fifty
columns at once. The columns of a plain numpy array start at multiples of the row count. If that is close to a
multiple of 512, all have about the same offset and evict one another: a step then took up to 40 % longer.

Sets are formed by sorting. numpy uses hashing, which takes ten times as long for a million integers.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.floating[Any]]  # mostly of float64
IntArray = NDArray[np.integer[Any]]  # of any size, signed or not
BoolArray = NDArray[np.bool_]
Triple = tuple[float, float, float]
AnyArray = NDArray[Any]  # if several types occur, or one may replace another
Integer = Any  # in kernels: an integer of any size
Index = Any  # in kernels: an index into arrays whose rows have the same length (`core.vectors.index_in`)
Lanes = Any  # in kernels: a number or a vector of LANES numbers (`core.vectors`), as the caller passes it


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


def distinct(values: np.ndarray) -> np.ndarray:
    """Return the distinct values in ascending order."""
    ordered = np.sort(values, axis=None)
    return ordered[np.append(True, ordered[1:] != ordered[:-1])[: len(ordered)]]


def first_largest(values: np.ndarray, number: np.ndarray) -> int:
    """Return the row of the largest of values (n,), n > 0; of equal values, that of the least number (n,).

    With global numbers the choice does not depend on how a net is distributed.
    """
    row = int(np.argmax(values))
    equal = np.flatnonzero(values == values[row])
    return int(equal[np.argmin(number[equal])]) if len(equal) else row  # none equals nan


def is_one_of(values: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return whether each value is one of others (k,)."""
    if not len(others):
        return np.zeros(np.shape(values), bool)
    ordered = np.sort(others)
    return ordered[np.minimum(np.searchsorted(ordered, values), len(ordered) - 1)] == values


def rows_of(gid: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return the rows of the wanted numbers (k,) in gid (n,), in any order; -1 if missing."""
    if not len(gid):
        return np.full(len(wanted), -1)
    order = np.argsort(gid, kind="stable")
    row = order[np.minimum(np.searchsorted(gid, wanted, sorter=order), len(gid) - 1)]
    return np.where(gid[row] == wanted, row, -1)
