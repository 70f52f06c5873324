"""The equilibria of equilibrium.py by PETSc, on the net that it saved.

    /usr/bin/python3 jobs/bench/equilibrium_petsc.py net.npz             how long Newton's method takes with
                                                                         conjugate gradients and GAMG
    /usr/bin/python3 jobs/bench/equilibrium_petsc.py net.npz --direct    how far netfall's equilibria are off:
                                                                         Newton's method from each by factors

Debian: python3-petsc4py, python3-numpy, and PETSC_DIR set to its real variant.
"""

import sys
import time

import numpy as np
from petsc4py import PETSc

LEFT, CLOSE = 3e-3, 1e-6  # as netfall: of the residual, and of the displacement, what a correction leaves
EXACT = 1e-11  # of the displacement: the last correction by factors
NIL = 1e-9  # of the axial stiffness, in place of 0, so that what is slack all around is not singular


class Net:
    """What equilibrium.py saved, and where the net is."""

    def __init__(self, data):
        self.ends, self.L0, self.EA = data["elements"].astype(np.int32), data["L0"], data["EA"]
        self.yield_force, self.free = data["yield_force"], ~data["fixed"].any(1)
        self.start, self.x, self.eps_p = data["x"], data["x"].copy(), np.zeros(len(self.L0))

    def elements(self):
        """Vectors (m, 3) between the ends, lengths, strains and tensions (m,)."""
        d = self.x[self.ends[:, 1]] - self.x[self.ends[:, 0]]
        L = np.sqrt((d * d).sum(1))
        eps = (L - self.L0) / self.L0
        return d, L, eps, np.clip(self.EA * (eps - self.eps_p), 0.0, self.yield_force)

    def residual(self, load):
        """Forces (n, 3) on what can move."""
        d, L, _, N = self.elements()
        f = load.copy()
        for k, sign in ((0, 1.0), (1, -1.0)):
            for axis in range(3):
                f[:, axis] += sign * np.bincount(self.ends[:, k], N / L * d[:, axis], len(f))
        return f * self.free[:, None]

    def tangent(self, nil: float):
        """PETSc's matrix of 3 x 3 blocks; nil : share of the axial stiffness that every direction has."""
        d, L, _, N = self.elements()
        a, b = self.ends.T
        n, along = len(self.x), d / L[:, None]
        axial = np.where((N > 0.0) & (N < self.yield_force), self.EA / self.L0, 0.0)
        block = (axial - N / L)[:, None, None] * along[:, :, None] * along[:, None, :]
        block += (N / L + nil * self.EA / self.L0)[:, None, None] * np.eye(3)
        diagonal = np.zeros((n, 3, 3))
        for i in range(3):
            for j in range(3):
                diagonal[:, i, j] = np.bincount(a, block[:, i, j], n) + np.bincount(b, block[:, i, j], n)
        diagonal[~self.free] = np.eye(3)
        beside = -block * (self.free[a] & self.free[b])[:, None, None]
        rows, columns = np.concatenate([np.arange(n), a, b]), np.concatenate([np.arange(n), b, a])
        order = np.lexsort((columns, rows))
        begin = np.searchsorted(rows[order], np.arange(n + 1)).astype(np.int32)
        values = np.concatenate([diagonal, beside, beside])[order].reshape(-1)
        csr = begin, columns[order].astype(np.int32), values
        matrix = PETSc.Mat().createBAIJ((3 * n, 3 * n), 3, csr=csr).convert("aij")
        matrix.setBlockSize(3)
        matrix.setOption(PETSc.Mat.Option.SPD, True)
        return matrix

    def correct(self, solver, load, nil: float = 0.0) -> tuple[np.ndarray, int]:
        """Move by one correction (n, 3); it, and the solver's iterations."""
        matrix = self.tangent(nil)
        right, s = matrix.createVecs()
        right.setArray(self.residual(load).ravel())
        solver.setOperators(matrix)
        solver.solve(right, s)
        step = s.getArray().reshape(-1, 3).copy()
        self.x += step
        return step, solver.getIterationNumber()

    def commit(self):
        """What has yielded stays."""
        self.eps_p = np.maximum(self.eps_p, self.elements()[2] - self.yield_force / self.EA)


def by_gradients(data) -> str:
    """Newton's method as netfall's, from the start: a line for the table."""
    net, solver = Net(data), PETSc.KSP().create()
    solver.setType("cg")
    solver.getPC().setType("gamg")
    solver.setTolerances(rtol=LEFT)
    began, total = time.perf_counter(), 0
    for load in data["loads"]:
        before, missing = np.inf, np.inf
        while missing > CLOSE:
            step, count = net.correct(solver, load)
            size = np.abs(step).max() / np.abs(net.x - net.start).max()
            missing, before, total = size * max(LEFT, min(1.0, size / before)), size, total + count
        net.commit()
    return f"{len(net.L0):9d} {time.perf_counter() - began:8.2f} s {total:5d} iterations of CG with GAMG"


def by_factors(data) -> str:
    """How far netfall's equilibria are from the exact ones: shares of the largest, the worst of all loads."""
    net, solver = Net(data), PETSc.KSP().create()
    solver.setType("preonly")
    solver.getPC().setType("cholesky")
    solver.getPC().setFactorSolverType("mumps")
    moved = tension = 0.0
    for load, found, N in zip(data["loads"], data["found"], data["tension"]):
        net.x, size = found.copy(), np.inf
        while size > EXACT:
            step, _ = net.correct(solver, load, NIL)
            largest = np.sqrt(((net.x - net.start) ** 2).sum(1)).max()
            size = np.abs(step).max() / largest
        exact = net.elements()[3]
        moved = max(moved, np.sqrt(((net.x - found) ** 2).sum(1)).max() / largest)
        tension = max(tension, np.abs(exact - N).max() / exact.max())
        net.commit()
    slack, flows = int((exact == 0.0).sum()), int((exact == net.yield_force).sum())
    return (
        f"{len(net.L0):9d} displacements off by {moved:.1e}, tensions by {tension:.1e}; "
        f"at last {slack} slack, {flows} yield"
    )


saved = np.load(sys.argv[1])
print(by_factors(saved) if "--direct" in sys.argv[2:] else by_gradients(saved), flush=True)
