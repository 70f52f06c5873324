"""Direct solver for a matrix of 3 x 3 blocks, of which each rank holds all rows.

It takes the place of the multigrid in small nets, and of the coarsest levels in larger ones.
"""

import numpy as np

from netfall.core.sparse import elimination_tree, nested_dissection_order, sparse_factors, substitute
from netfall.statics.multigrid.rows import BlockRows, Pattern, ReplicatedMatrix, row_starts


class Elimination:
    """Order in which the unknowns of a matrix are eliminated. It depends on the pattern alone.

    unknowns : (3 n,) in this order; below, diagonal : where the entries of the matrix in this order are among
        those of its blocks; start, column : rows of the former; tree : of `elimination_tree`
    """

    def __init__(self, pattern: Pattern):
        """pattern : of the matrix, on the ranks. Collective."""
        self.whole = ReplicatedMatrix(pattern)
        row, column = self.whole.pattern.row, self.whole.pattern.column
        n = self.whole.pattern.rows.n
        above = row < column
        order = nested_dissection_order(np.column_stack([row, column])[above], n)
        self.unknowns = (3 * order[:, None] + np.arange(3)).ravel()
        place = np.argsort(self.unknowns).reshape(n, 3)
        # the entries of the blocks that end up below the diagonal, by row
        rows, columns = np.broadcast_arrays(place[row][:, :, None], place[column][:, None, :])
        self.below = np.flatnonzero(rows > columns)
        self.below = self.below[np.lexsort((columns.flat[self.below], rows.flat[self.below]))]
        self.start = row_starts(np.bincount(rows.flat[self.below], minlength=3 * n))
        self.column = columns.flat[self.below]
        on = np.flatnonzero(rows == columns)
        self.diagonal = on[np.argsort(rows.flat[on])]
        self.tree = elimination_tree(self.start, self.column)


class DirectSolver:
    """Solution of matrix x = b. Unknowns without stiffness of their own stay 0."""

    def __init__(self, elimination: Elimination, matrix: BlockRows):
        """Factorise the matrix; elimination : of its pattern. Collective."""
        self.unknowns = elimination.unknowns
        entries = elimination.whole.of(matrix).block.ravel()
        value, diagonal = entries[elimination.below], entries[elimination.diagonal]
        permuted = elimination.start, elimination.column, value, diagonal, diagonal
        self.lower, self.d, *_ = sparse_factors(permuted, elimination.tree, drops=True)

    def __call__(self, b: np.ndarray) -> np.ndarray:
        """Return x (n, 3) of b (n, 3), in double precision."""
        x = b.reshape(-1)[self.unknowns].astype(float)
        substitute(self.lower, self.d, x)
        answer = np.empty_like(x)
        answer[self.unknowns] = x
        return answer.reshape(b.shape)
