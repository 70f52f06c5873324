"""The equilibria of equilibrium.py by PETSc: Newton's method, conjugate gradients with its multigrid (GAMG).

/usr/bin/python3 jobs/bench/equilibrium_petsc.py net.npz     (Debian: python3-petsc4py, python3-numpy)
"""

import sys
import time

import numpy as np
from petsc4py import PETSc

LEFT, CLOSE = 3e-3, 1e-6  # as netfall: of the residual, and of the displacement, what a correction leaves

data = np.load(sys.argv[1])
elements, L0, EA, start = (data[name] for name in ("elements", "L0", "EA", "x"))
free = ~data["fixed"]
x, n = start.copy(), len(start)
a, b = elements.astype(np.int32).T
row, column = np.concatenate([a, b, a, b]), np.concatenate([a, b, b, a])

matrix = PETSc.Mat().createBAIJ((3 * n, 3 * n), 3, nnz=np.bincount(row, minlength=n).astype(np.int32) + 1)
solver = PETSc.KSP().create()
solver.setType("cg")
solver.getPC().setType("gamg")
solver.setTolerances(rtol=LEFT)
began, total = time.perf_counter(), 0
for load in data["loads"]:
    before = np.inf
    while True:
        d = x[b] - x[a]
        L = np.sqrt((d * d).sum(1))
        N = np.maximum(EA * (L - L0) / L0, 0.0)
        f = load.copy()
        for ends, sign in ((a, 1.0), (b, -1.0)):
            for axis in range(3):
                f[:, axis] += sign * np.bincount(ends, N / L * d[:, axis], n)
        along = d / L[:, None]
        block = (EA / L0 - N / L)[:, None, None] * along[:, :, None] * along[:, None, :]
        block += (N / L)[:, None, None] * np.eye(3)
        diagonal = np.zeros((n, 3, 3))
        for i in range(3):
            for j in range(3):
                diagonal[:, i, j] = np.bincount(a, block[:, i, j], n) + np.bincount(b, block[:, i, j], n)
        inside = free.any(1)
        diagonal[~inside] = np.eye(3)
        beside = -block * (inside[a] & inside[b])[:, None, None]
        matrix.zeroEntries()
        rows = np.concatenate([np.arange(n), a, b]).astype(np.int32)
        columns = np.concatenate([np.arange(n), b, a]).astype(np.int32)
        values = np.concatenate([diagonal, beside, beside])
        order = np.lexsort((columns, rows))
        begin = np.searchsorted(rows[order], np.arange(n + 1)).astype(np.int32)
        matrix = PETSc.Mat().createBAIJ(
            (3 * n, 3 * n), 3, csr=(begin, columns[order], values[order].reshape(-1))
        )
        matrix = matrix.convert("aij")
        matrix.setBlockSize(3)
        matrix.setOption(PETSc.Mat.Option.SPD, True)
        right, s = matrix.createVecs()
        right.setArray((f * free).ravel())
        solver.setOperators(matrix)
        solver.solve(right, s)
        total += solver.getIterationNumber()
        x += s.getArray().reshape(n, 3)
        size = np.abs(s.getArray()).max() / np.abs(x - start).max()
        if size * max(LEFT, min(1.0, size / before)) <= CLOSE:
            break
        before = size
print(f"{len(elements):9d} {time.perf_counter() - began:8.2f} s {total:5d} iterations of CG with GAMG")
