"""Sparse matrices with rows distributed over the ranks: products compared with dense ones, and bits."""

import hashlib
import itertools
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import on_ranks, run_process
from mpi4py import MPI
from nets import dense

from netfall.statics.multigrid.cycle import DirectSolver, Elimination
from netfall.statics.multigrid.distributed import DistributedMatrix
from netfall.statics.multigrid.levels import aggregates
from netfall.statics.multigrid.rows import BlockRows, Owners, Pattern, Product, TransposedMatrix

SEEDS = 24
SINGLE = 1e-6  # of the largest: rounding of a few products in single precision


class Matrix:
    """A random matrix of 3 x 3 blocks, some or most of them zero."""

    def __init__(self, rng, rows: int, columns: int, symmetric: bool = False):
        self.there = rng.random((rows, columns)) < rng.choice([0.03, 0.2, 1.0])
        if symmetric:
            self.there |= self.there.T
        self.blocks = rng.normal(size=(rows, columns, 3, 3)) * self.there[:, :, None, None]

    def dense(self) -> np.ndarray:
        return self.blocks.transpose(0, 2, 1, 3).reshape(3 * len(self.there), -1)

    def spread(self, comm, rows: Owners, columns: Owners) -> BlockRows:
        place, column = np.nonzero(self.there[rows.own_gid])
        start = np.searchsorted(place, np.arange(len(rows.own_gid) + 1))
        pattern = Pattern(comm, start, column.astype(np.int32), rows, columns)
        return BlockRows(pattern, self.blocks[rows.own_gid[place], column])


def owners(comm, rng, n: int) -> Owners:
    """Return rows in random order and random owners, sometimes none for the last rank."""
    order, owner = rng.permutation(n), rng.integers(0, 6, n)
    ranks = max(1, comm.size - int(rng.integers(0, 2)))
    return Owners(comm, order[owner[order] % ranks == comm.rank])


def products(comm, seed: int) -> tuple[float, float, str]:
    """Return relative errors in double and single precision, and a digest of all products."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 60))
    m = int(rng.integers(1, n + 1))
    A, P = Matrix(rng, n, n, symmetric=True), Matrix(rng, n, m)
    x, b = rng.normal(size=(2, n, 3)).astype(np.float32)
    rows, columns = owners(comm, rng, n), owners(comm, rng, m)
    matrix, up = A.spread(comm, rows, columns=rows), P.spread(comm, rows, columns)
    transposed = TransposedMatrix(up.pattern)
    down = transposed.of(up)
    first = Product(matrix.pattern, up.pattern)
    coarse = Product(transposed.pattern, first.pattern).of(down, first.of(matrix, up))
    for start, end in itertools.pairwise(coarse.pattern.start):
        assert (np.diff(coarse.pattern.column[start:end]) > 0).all()

    product, inverse = (
        DistributedMatrix(matrix),
        np.tile(np.float32([1, 0, 0, 1, 0, 1]), (len(rows.own_gid), 1)),
    )
    whole = [product(x[rows.own_gid]).copy()]
    step, expected, moved = np.zeros_like(whole[0]), x.astype(float), np.zeros((n, 3))
    for _ in range(3):
        product.take_step(b[rows.own_gid], inverse, np.float32(0.01), np.float32(0.3), step)
        moved = 0.3 * moved + 0.01 * (b - (A.dense() @ expected.ravel()).reshape(-1, 3))
        expected += moved
    whole.append(product.own)
    whole = [gathered(comm, rows, each) for each in whole] + [dense(coarse), dense(down)]
    references = [
        (A.dense() @ x.ravel()).reshape(-1, 3),
        expected,
        P.dense().T @ A.dense() @ P.dense(),
        P.dense().T,
    ]
    solution, exact = solved(comm, rng, rows)
    whole.append(solution)
    references.append(exact)
    size = lambda reference: max(np.abs(reference).max(), 1e-3)
    errors = [np.abs(one - other).max() / size(other) for one, other in zip(whole, references)]
    digest = hashlib.sha256(b"".join(each.tobytes() for each in whole)).hexdigest()
    return max(errors[2], errors[4]), max(errors[0], errors[1], errors[3]), digest


def solved(comm, rng, rows: Owners) -> tuple[np.ndarray, np.ndarray]:
    """Return the solution of the direct solver for a positive definite matrix; some rows are zero."""
    S = Matrix(rng, rows.n, rows.n, symmetric=True)
    S.there |= np.eye(rows.n, dtype=bool)
    values = S.dense() + S.dense().T
    idle = rng.random(len(values)) < 0.1
    values[idle] = values[:, idle] = 0.0
    values[~idle, ~idle] = np.abs(values).sum(0)[~idle] + 1.0
    S.blocks = values.reshape(rows.n, 3, rows.n, 3).transpose(0, 2, 1, 3)
    matrix, b = S.spread(comm, rows, columns=rows), rng.normal(size=(rows.n, 3))
    exact = np.zeros(3 * rows.n)
    exact[~idle] = np.linalg.solve(values[~idle][:, ~idle], b.ravel()[~idle])
    return DirectSolver(Elimination(matrix.pattern), matrix)(b), exact.reshape(-1, 3)


def gathered(comm, rows: Owners, own: np.ndarray) -> np.ndarray:
    whole = np.empty((rows.n, 3), np.float32)
    for own_rows, part in comm.allgather((rows.own_gid, own)):
        whole[own_rows] = part
    return whole


def digests() -> None:
    for seed in range(SEEDS):
        double, single, digest = products(MPI.COMM_WORLD, seed)
        assert double < 1e-13 and single < SINGLE, (seed, double, single)
        if MPI.COMM_WORLD.rank == 0:
            print(digest)


@pytest.mark.parametrize("ranks", [2, 3])
def test_products_agree_with_dense_matrices_on_any_number_of_ranks(ranks):
    """Also if a rank has no rows, and if rows or the whole matrix have no block."""
    alone = [products(MPI.COMM_SELF, seed) for seed in range(SEEDS)]
    assert max(double for double, _, _ in alone) < 1e-13 and max(single for _, single, _ in alone) < SINGLE
    command = [*on_ranks(ranks), sys.executable, "-c", "import test_block_matrices as t; t.digests()"]
    done = run_process(*command, cwd=Path(__file__).parent)
    assert done.stdout.split() == [digest for _, _, digest in alone]


def test_particles_of_a_net_of_squares_form_aggregates():
    """Aggregates have nine particles, except at two edges. A particle without neighbours is in none."""
    is_free = np.pad(np.ones((8, 8), bool), 2)
    is_free[0, 0] = True  # alone
    number = np.cumsum(is_free.ravel()).reshape(is_free.shape) - 1
    pairs = []
    for i, j in zip(*np.nonzero(is_free)):
        neighbours = ((i, j), (i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1))
        pairs += [(number[i, j], number[k]) for k in neighbours if min(k) >= 0 and is_free[k]]
    row, column = np.array(sorted(pairs), np.int32).T
    start, rows = np.searchsorted(row, np.arange(66)), Owners(MPI.COMM_SELF, np.arange(65))
    of, count = aggregates(Pattern(MPI.COMM_SELF, start, column, rows, rows), True)
    strip = np.array([0, 0, 1, 1, 1, 2, 2, 2])
    assert of[0] < 0 and count == 9
    assert (of[1:].reshape(8, 8) == 3 * strip[:, None] + strip).all()
