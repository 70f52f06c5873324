"""Time and accuracy of equilibria against Newton's method with a sparse direct solver, on the same saddle.

    python jobs/bench/equilibrium.py 120 200 400            cells along a side; 2 c (c - 1) elements each
    mpirun -n 2 python jobs/bench/equilibrium.py 400 --alone without the direct solver
    python jobs/bench/equilibrium.py 400 --save net.npz    then equilibrium_petsc.py net.npz
    python jobs/bench/equilibrium.py 400 --until slack     or yielding: more than 2 kN/m2, see `CARRIES`
    python jobs/bench/equilibrium.py 120 --net soft        another net: see `NETS`
    python jobs/bench/equilibrium.py 50 100 --overload breaking    in place of these: see `OVERLOADS`

Self weight, then 2 kN/m2 upward in two steps. Times are of the equilibria, set-up of the net left out.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
from mpi4py import MPI
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from netfall.core.timings import NEVER_STOP, PhaseTimes
from netfall.driver.problem import equilibria, loaded
from netfall.driver.setup import prepare_problem
from netfall.driver.statics.stage import StaticPath, find_equilibria
from netfall.job.read import read_job

JOB = Path(__file__).with_name("equilibrium.toml")
CLOSE = 1e-7  # of the largest displacement: the direct solver's last correction
MOST_CORRECTIONS = 20
NIL = 1e-9  # of the axial stiffness, in place of 0
SYMMETRIC = {"SymmetricMode": True}  # of SuperLU
CARRIES = {  # pressure of each cell of 8 x 8 [N/m2], of more cells so much that each cable carries the same
    "slack": (24e3, []),
    "yielding": (12e3, ["cable.yield_stress=0.75e9"]),
}

OVERLOADS = {  # the same, of what they do not carry
    "breaking": (60e3, ["cable.fracture_strain=0.01", "load.stop_at_strength=true"]),
    "yielding and breaking": (
        12e3,
        ["cable.yield_stress=0.75e9", "cable.fracture_strain=0.04", "load.stop_at_strength=true"],
    ),
    "yielding": (60e3, ["cable.yield_stress=0.75e9"]),
}
LIGHT = [
    "net.saddle.side=200",
    "net.saddle.rise=10",
    "cable.modulus=1.6e11",
    "cable.area=400e-6",
    "cable.density=7850",
]
NETS = {  # in place of what equilibrium.toml has: under 100 N/m2, downward
    "taut": [*LIGHT, "cable.prestress=80e3", "load.self_weight=false"],
    "soft": [*LIGHT, "cable.prestress=8e3", "load.self_weight=false"],
    "given": [
        *LIGHT,
        "cable.prestress=80e3",
        "net.saddle.rise=1",
    ],  # no form is found: not in equilibrium at first
    "given slack": [*LIGHT, "cable.prestress=80e3", "net.saddle.rise=20"],  # a fifth of it slack at rest
}
CARRIED = 0.8  # of what is borne: an equilibrium to compare with

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("cells", type=int, nargs="+")
parser.add_argument("--alone", action="store_true", help="without the direct solver")
parser.add_argument("--until", choices=CARRIES, help="under so much load that cables go slack or yield")
parser.add_argument("--net", choices=NETS, help="another net")
parser.add_argument("--pressure", type=float, default=-100.0, help="[N/m2] on that")
parser.add_argument("--overload", choices=OVERLOADS, help="the time until it is told what is borne")
parser.add_argument("--save", help="file for the net, its loads and equilibria, for equilibrium_petsc.py")
arguments = parser.parse_args()


class Direct:
    """Newton's method with scipy's direct solver, from the same start, or from what was found."""

    def __init__(self, model):
        net = model.net
        self.elements, self.L0, self.EA = net.elements, model.L0, net.modulus * net.section
        self.yield_force, self.eps_p = net.yield_stress * net.section, np.zeros(net.m)
        self.x, self.start, self.moves = model.x.copy(), model.x, np.flatnonzero(~net.fixed.ravel())

    def find(self, load: np.ndarray) -> None:
        """Move to equilibrium under a load (n, 3) [N]; what yields there stays so."""
        for _ in range(MOST_CORRECTIONS):
            d, L, _, N = self.tensions()
            f = load.copy()
            for k, sign in ((0, 1.0), (1, -1.0)):
                for axis in range(3):
                    f[:, axis] += sign * np.bincount(self.elements[:, k], N / L * d[:, axis], len(f))
            step = splu(self.stiffness(d / L[:, None], L, N), "MMD_AT_PLUS_A", options=SYMMETRIC).solve(
                f.ravel()[self.moves]
            )
            self.x.ravel()[self.moves] += step
            if np.abs(step).max() < CLOSE * np.abs(self.x - self.start).max():
                break
        self.eps_p = np.maximum(self.eps_p, self.tensions()[2] - self.yield_force / self.EA)

    def tensions(self):
        """Vectors (m, 3) along the elements, their lengths, strains and tensions (m,)."""
        d = self.x[self.elements[:, 1]] - self.x[self.elements[:, 0]]
        L = np.sqrt((d * d).sum(1))
        eps = (L - self.L0) / self.L0
        return d, L, eps, np.clip(self.EA * (eps - self.eps_p), 0.0, self.yield_force)

    def stiffness(self, along, L, N):
        """Sparse tangent of the axes that move; what has none gets so little that it moves nothing else."""
        axial = np.where((N > 0.0) & (N < self.yield_force), self.EA / self.L0, 0.0)
        across = N / L + NIL * self.EA / self.L0
        block = (axial - N / L)[:, None, None] * along[:, :, None] * along[:, None, :]
        block += across[:, None, None] * np.eye(3)
        place = 3 * self.elements[:, :, None] + np.arange(3)
        row, column, value = [], [], []
        for i, j in ((0, 0), (1, 1), (0, 1), (1, 0)):
            row.append(np.repeat(place[:, i], 3, axis=1).ravel())
            column.append(np.tile(place[:, j], 3).ravel())
            value.append((block if i == j else -block).ravel())
        whole = (np.concatenate(value), (np.concatenate(row), np.concatenate(column)))
        n = self.x.size
        return coo_array(whole, shape=(n, n)).tocsr()[self.moves][:, self.moves].tocsc()


def job_of(cells: int):
    """The saddle of so many cells, and what it carries."""
    more = [f"net.saddle.cells={cells}"]
    if arguments.until:
        pressure, cable = CARRIES[arguments.until]
        more += [f"load.pressure=[0, 0, {pressure * cells / 8}]", *cable]
    if arguments.net:
        pressure = f"load.pressure=[0, 0, {arguments.pressure}]"
        job = read_job(JOB, [*more, *NETS[arguments.net], pressure, "load.steps=1"])
        return replace(job, form_finding=None) if "given" in arguments.net else job
    return read_job(JOB, more)


def measure(comm: MPI.Comm, cells: int) -> str:
    """A row of the table: elements, seconds, iterations; seconds of the direct solver, error. Collective."""
    job = job_of(cells)
    scene, _ = prepare_problem(comm, job, PhaseTimes())
    gather, found, path = scene.distribution.gather_particles, [], StaticPath()
    began = time.perf_counter()
    find_equilibria(scene, Mock(stop=NEVER_STOP), path, results=found)
    seconds = time.perf_counter() - began
    loads = [gather(loaded(scene, want).load) for want in equilibria(scene)]
    x = [gather(there["x"]) for _, there in found]
    N = [scene.distribution.gather_elements(each.equilibrium.snapshot.N) for each, *_ in found]
    row = f"{scene.distribution.m:9d} {seconds:8.2f} s {path.total:5d} iterations"
    if comm.rank > 0:
        return row
    if arguments.save:
        save(scene.model, x, N, loads)
    if arguments.alone:
        return row
    direct, began, errors = Direct(scene.model), time.perf_counter(), []
    for load, there, tension in zip(loads, x, N):
        if arguments.until or arguments.net:  # where Newton's method alone does not get
            direct.x[:] = there
        direct.find(load)
        exact = direct.tensions()[3]
        moved = np.abs(there - direct.x).max() / np.abs(direct.x - direct.start).max()
        errors.append((moved, np.abs(tension - exact).max() / exact.max()))
    row += f" {time.perf_counter() - began:8.2f} s direct"
    return row + "; displacements off by {:.1e}, tensions by {:.1e}".format(*np.max(errors, 0))


def save(model, found, tension, loads) -> None:
    """What equilibrium_petsc.py reads."""
    net = model.net
    np.savez(
        arguments.save,
        elements=net.elements,
        x=model.x,
        L0=model.L0,
        EA=net.modulus * net.section,
        yield_force=net.yield_stress * net.section,
        fixed=net.fixed,
        loads=loads,
        found=found,
        tension=tension,
    )


def overload(comm: MPI.Comm, cells: int) -> str:
    """A row: elements; seconds until it is told what is borne, and for `CARRIED` of that. Collective."""
    pressure, more = OVERLOADS[arguments.overload]
    pressure, seconds = pressure * cells / 8, []
    for _ in range(2):
        keys = [f"net.saddle.cells={cells}", "load.steps=1", f"load.pressure=[0, 0, {pressure}]", *more]
        scene, _ = prepare_problem(comm, read_job(JOB, keys), PhaseTimes())
        path, began = StaticPath(), time.perf_counter()
        find_equilibria(scene, Mock(stop=NEVER_STOP), path)
        seconds.append(time.perf_counter() - began)
        factor = path.steps[-1]["load_factor"]
        pressure *= CARRIED * factor
    told, carried = seconds
    return f"{scene.distribution.m:9d} {told:8.2f} s {carried:8.2f} s, {told / carried:.1f} times as long"


row_of = overload if arguments.overload else measure
row_of(MPI.COMM_WORLD, 50)  # compiles
for count in arguments.cells:
    line = row_of(MPI.COMM_WORLD, count)
    if MPI.COMM_WORLD.rank == 0:
        print(line, flush=True)
