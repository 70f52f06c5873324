"""What a collapse costs beside its steps: the benchmark's net, torn or yielding, and intact.

    python jobs/bench/collapse.py N [--ranks P] [--rounds R] [--command NETFALL] [--even]

N x N particles under a load that comes at once. Three scenes of the same steps: intact; torn: strengths of
the elements scattered by 5 % about what the load asks for; flowing: half of the elements yield. Prints for
each round the seconds of the dynamic stage and their ratios to the intact net's, then the medians as JSON.
With --even a net that LAMMPS can tear as well (lammps_collapse.py): flat, of bars of one length and
one strength, which are taken out where they break.
"""

import argparse
import json
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import net
import numpy as np

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("N", type=int)
parser.add_argument("--ranks", type=int, default=1)
parser.add_argument("--rounds", type=int, default=3)
parser.add_argument("--command", default=str(Path(sys.executable).with_name("netfall")), help="that is timed")
parser.add_argument("--even", action="store_true", help="a flat net of one length and one strength")
arguments = parser.parse_args()

SCATTER = 0.0 if arguments.even else 0.05  # of the strain at fracture
YIELD = 160e6  # Pa: what half of them reach
JOB = f"""
[net]
nodes = "nodes.csv"
elements = "elements.csv"
[cable]
modulus = 1.95e11
area = 6.83e-4
density = 7850.0
kind = "{"bar" if arguments.even else "cable"}"
{{strength}}
[load]
self_weight = false
steps = 0
[dynamics]
duration = {net.TORN_STEPS * net.TORN_DT}
time_step = {net.TORN_DT}
fragments = {str(not arguments.even).lower()}
[output]
history_interval = {net.TORN_STEPS * net.TORN_DT / 10}
frames = 1
"""
SCENES = {"intact": "", "torn": ""}
if not arguments.even:
    SCENES["flowing"] = f"yield_stress = {YIELD}"


def write_tables(folder: Path, torn: bool) -> None:
    """nodes.csv and elements.csv of the net; torn : with strengths"""
    whole = net.make_even_net(arguments.N) if arguments.even else net.make_net(arguments.N)
    random = np.random.default_rng(net.SEED)
    load, mass = net.sideways_load(arguments.N, random), np.full(len(whole.x), net.MASS)
    columns, names = (
        [np.arange(len(whole.x)), whole.x, whole.fixed, mass, load],
        "id,x,y,z,fixed,mass,load_x,load_y",
    )
    np.savetxt(folder / "nodes.csv", np.column_stack(columns), "%.17g", ",", header=names, comments="")
    columns, names = [whole.elements, whole.L0], "start,end,unstressed_length"
    if torn:
        draw = random.standard_normal(len(whole.L0))
        columns, names = [*columns, net.STRENGTH * (1.0 + SCATTER * draw)], names + ",fracture_strain"
    np.savetxt(folder / "elements.csv", np.column_stack(columns), "%.17g", ",", header=names, comments="")


def run(folder: Path, scene: str) -> dict:
    """Seconds of the dynamic stage, of the slowest rank, and what became of the net."""
    result = folder / "result.vtkhdf"
    command = [
        *shlex.split(arguments.command),
        "run",
        str(folder / f"{scene}.toml"),
        "--quiet",
        "-o",
        str(result),
    ]
    if arguments.ranks > 1:
        command = [str(Path(sys.executable).with_name("mpirun")), "-n", str(arguments.ranks), *command]
    subprocess.run(command, check=True, cwd=folder)
    with h5py.File(result) as file:
        plastic = file["final/plastic_strain"][:] > 0 if "plastic_strain" in file["final"] else np.zeros(1)
        return {
            "seconds": float(np.max(file["provenance/timings"].attrs["dynamics"])),
            "steps": int(file["provenance"].attrs["steps"]),
            "broken": int(file["history/broken"][-1]),
            "yielded": float(plastic.mean()),
        }


with tempfile.TemporaryDirectory() as name:
    folders = {scene: Path(name, scene) for scene in SCENES}
    for scene, folder in folders.items():
        folder.mkdir()
        write_tables(folder, scene == "torn")
        (folder / f"{scene}.toml").write_text(JOB.format(strength=SCENES[scene]))
        run(folder, scene)  # compiles
    seconds = {scene: [] for scene in SCENES}
    for _ in range(arguments.rounds):
        for scene, folder in folders.items():
            found = run(folder, scene)
            seconds[scene].append(found["seconds"])
            print(scene, found, flush=True)
    ratio = {s: float(np.median(np.divide(seconds[s], seconds["intact"]))) for s in SCENES if s != "intact"}
    print(json.dumps({"N": arguments.N, "ranks": arguments.ranks, **ratio}))
