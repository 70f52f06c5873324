"""Times the step of netfall on the benchmark's net.

    mpirun -n P python step.py N SCENE [--rounds R] [--device gpu]

SCENE: elastic, or one or more of plastic, fracture, wind, energy, sections, bars, buckling, bending (chains
along x), slip (clamps along x, which hold; loose: without resistance), air, air_mass, band joined by + (all:
the first four, and damping; more may be added: all+air). Prints a line of JSON.
"""

import argparse
import json
import resource
import sys
import time
from functools import partial

import numpy as np
from mpi4py import MPI

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("N", type=int)
parser.add_argument("scene")
parser.add_argument("--rounds", type=int, default=5)
parser.add_argument("--seconds", type=float, default=1.0, help="of a round")
parser.add_argument("--device", choices=("cpu", "gpu"), default="cpu")
arguments = parser.parse_args()

import net

from netfall.explicit.loop import Interval
from netfall.explicit.plan import StepPlan, halo_width
from netfall.gpu.plan import GpuPlan
from netfall.gpu.stepper import Gpu
from netfall.parallel.halo import Halo
from netfall.parallel.partition import metis_partition
from netfall.parallel.subdomain import Distribution, split_net
from netfall.physics.bending import Joints, curvatures
from netfall.physics.fields import FIELDS, Features
from netfall.physics.law.branches import band_branches
from netfall.physics.slip.law import slip_inertia
from netfall.physics.slip.motion import adjacent_sums, slip_points_of
from netfall.physics.state import State

STIFFNESS = 1e3  # N m, of joints of chains that bend
comm = MPI.COMM_WORLD
words = set(arguments.scene.replace("all", "plastic+fracture+wind+energy").split("+")) - {"elastic"}
scene = Features(
    **dict.fromkeys(words - {"energy", "band", "loose"}, True),
    sliding=int("slip" in words),
    energy="energy" in words,
    band=band_branches(0.01, 0.3, 9.0) if "band" in words else (),
)

begin = time.perf_counter()
whole = net.make_net(arguments.N)
n, m = len(whole.x), len(whole.elements)
number = np.arange(n).reshape(arguments.N, -1)
joints = np.stack([number[:, :-2], number[:, 1:-1], number[:, 2:]], -1).reshape(-1, 3)[: n * scene.bending]
subdomains = (
    split_net(n, whole.elements, metis_partition(n, whole.elements, comm.size), comm.size, joints)
    if comm.rank == 0
    else None
)
distribution = Distribution(comm, n, m, subdomains)
del subdomains
subdomain = distribution.subdomain
state = State(scene, subdomain.n_owned, subdomain.n_halo, len(subdomain.element_gid))
state.gid[:], state.ends[:], state.owned[:] = subdomain.particle_gid, subdomain.ends, subdomain.element_owned
state.x[:] = state.x_start[:] = whole.x[subdomain.particle_gid]
state.free[:] = ~whole.fixed[subdomain.particle_gid][:, None]
state.mass[:], state.load[:, 2] = net.MASS, -net.LOAD
state.L0[:], state.EA[:], state.half_mass[:] = whole.L0[subdomain.element_gid], net.EA, 1.0
if scene.plastic:
    state.yield_force[:] = 100 * net.PRESTRESS
if scene.fracture:
    state.eps_u[:] = 1.0
if scene.wind:
    if scene.air:
        state.air[:, 2] = 1.0
    if scene.air_mass:
        state.air_mass[:] = 0.3 * net.MASS
    state.wind[:, 2], state.speed_before[:], state.speed_after[:] = 1e-12, 1.0, 2.0
if scene.bending:
    there = subdomain.joints
    of_joints = np.full(len(there), STIFFNESS), curvatures(state.x, there)
    state.joints = Joints(there, *of_joints, (there[:, 1] < subdomain.n_owned).astype(np.uint8))
if scene.buckling:
    state.euler[:] = np.inf
if scene.slip:
    along = whole.elements[subdomain.element_gid]
    through = (along[:, 1] - along[:, 0] == 1)[:, None] & ~whole.fixed[along]
    state.strand[:], state.slip_along[:], state.slip_place[:] = state.L0, 1, np.where(through, 0, -1)
    state.resistance[:, 0] = 0.0 if "loose" in words else 1e12
    state.slip_at[:], state.slip_share[:] = state.ends, 1.0
    points = slip_points_of(state, np.where(through.any(1), subdomain.element_gid, -1))
    sums = (adjacent_sums(points, values) for values in (state.half_mass, state.EA / state.L0))
    state.slip_points, state.slip_mass[points.node, 0] = points, slip_inertia(*sums, net.DT)
halo = Halo(comm, subdomain, halo_width(state))
make_plan = partial(GpuPlan, Gpu()) if arguments.device == "gpu" else StepPlan
plan = make_plan(state, halo)
centre = whole.centre
del whole
set_up = time.perf_counter() - begin


def advance(first: int, steps: int) -> float:
    """Seconds for some steps, the slowest rank's."""
    comm.Barrier()
    begin = time.perf_counter()
    damping = 1.0 if arguments.scene.startswith("all") else 0.0
    done = plan.run(Interval(first, steps, net.DT if first else 0.0, net.DT, damping, 0.0, 1e9))
    assert done == steps
    seconds = time.perf_counter() - begin
    return comm.allreduce(seconds, MPI.MAX)


mine = np.flatnonzero(subdomain.particle_gid[: subdomain.n_owned] == centre)
advance(0, net.CHECKED)
plan.collect()
z = comm.allreduce(float(state.x[mine[0], 2] - state.x_start[mine[0], 2]) if len(mine) else 0.0)
steps = max(5, int(arguments.seconds / max(advance(net.CHECKED, 5) / 5, 1e-6)))
steps = comm.bcast(steps)
seconds = [advance(net.CHECKED + 5 + k * steps, steps) / steps for k in range(arguments.rounds)]
buffers, alone = halo.buffers, halo.buffers.numbers.copy()  # the step without its exchange, for its share
for place in (0, buffers.to_second):
    alone[place + buffers.receive_at[:, None] + np.arange(3)] = 0.0  # forces on the halo; masses stay
nobody = {"counts": buffers.counts[:0], "requests": np.zeros((2, 0), np.uint8)}
halo.buffers = buffers.with_values(numbers=alone, **nobody)
plan.attach(state)
without = min(advance(0, steps) / steps for _ in range(2))
halo.buffers = buffers
held = sum(getattr(state, f.name).nbytes for f in FIELDS if getattr(state, f.name) is not None)
held, peak = comm.allreduce(held), comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
if comm.rank == 0:
    best = min(seconds)
    json.dump(
        {
            "program": "netfall",
            "N": arguments.N,
            "elements": m,
            "ranks": comm.size,
            "scene": arguments.scene,
            "rate": m / best,
            "median": m / sorted(seconds)[len(seconds) // 2],
            "exchange": max(0.0, 1.0 - without / best),
            "displacement": z,
            "set_up": set_up,
            "state_bytes": held / m,
            "peak_bytes": peak,
        },
        sys.stdout,
    )
    print()
