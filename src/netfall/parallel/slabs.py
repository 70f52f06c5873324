"""Redistribution of owned rows, scattered in global order, to contiguous blocks for writing."""

import numpy as np

from netfall.parallel.mpi import MPI


class BlockWriter:
    """Division of the global rows 0 to total into one block per writing rank: all ranks, or rank 0 alone."""

    def __init__(self, comm: MPI.Comm, all_write: bool):
        self.comm = comm
        self.all_write = all_write

    def bounds(self, total: int) -> np.ndarray:
        """Return the first row of each rank's block, and the end (ranks + 1,)."""
        ranks = self.comm.size
        if self.all_write:
            return np.arange(ranks + 1) * total // ranks
        return np.array([0] + [total] * ranks)

    def collect(self, row: np.ndarray, values: np.ndarray, total: int) -> np.ndarray:
        """Return this rank's block (rows, k) of a global array (total, k). Collective.

        row : (r,) global rows that this rank holds; values : (r, k). Each global row is held by one rank.
        """
        if self.comm.size == 1:
            block = np.empty((total, values.shape[1]))
            block[row] = values
            return block
        bounds = self.bounds(total)
        target = np.searchsorted(bounds, row, side="right") - 1 if self.all_write else np.zeros(len(row), int)
        of_target = [target == rank for rank in range(self.comm.size)]
        low, high = bounds[self.comm.rank], bounds[self.comm.rank + 1]
        block = np.empty((high - low, values.shape[1]))
        for rows, received in self.comm.alltoall([(row[to_rank], values[to_rank]) for to_rank in of_target]):
            block[rows - low] = received
        return block
