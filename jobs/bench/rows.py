"""Times what a row of the history costs on the benchmark's net, with its audit and the envelope.

    python rows.py N [N ...] [losses]

Prints a line of JSON for each N x N particles: CPU seconds of a step, of a row and of the audit alone, as for
a frame. With losses the extremes of the forces are kept in each step.
"""

import json
import sys
import time
from types import SimpleNamespace

import net
import numpy as np
from mpi4py import MPI

from netfall.explicit.energy import total_energies
from netfall.explicit.loop import Interval
from netfall.explicit.plan import StepPlan, halo_width
from netfall.explicit.rows import MOST_ROWS, DynamicEnvelope, RowTable
from netfall.model.layout import Probes
from netfall.parallel.halo import Halo
from netfall.parallel.subdomain import Distribution, split_net
from netfall.physics.fields import Features
from netfall.physics.state import State

ROUNDS = 60  # short ones: the least is that of a core that nothing else took


def best(call, seconds=2e-3) -> float:
    """CPU seconds of a call, the least of some rounds."""
    call()
    begin = time.process_time()
    call()
    times = max(1, int(seconds / (time.process_time() - begin)))
    found = []
    for _ in range(ROUNDS):
        begin = time.process_time()
        for _ in range(times):
            call()
        found.append((time.process_time() - begin) / times)
    return min(found)


def measure(N: int) -> dict:
    """The figures of a net of N x N particles, with the audit and damping."""
    whole = net.make_net(N)
    n, m = len(whole.x), len(whole.elements)
    distribution = Distribution(MPI.COMM_SELF, n, m, split_net(n, whole.elements, np.zeros(n, int), 1))
    subdomain = distribution.subdomain
    state = State(Features(energy=True, losses="losses" in sys.argv), n, 0, m)
    state.gid[:], state.ends[:], state.owned[:] = subdomain.particle_gid, subdomain.ends, 1
    state.x[:] = state.x_start[:] = whole.x[subdomain.particle_gid]
    state.free[:] = ~whole.fixed[subdomain.particle_gid][:, None]
    state.mass[:], state.load[:, 2], state.half_mass[:] = net.MASS, -net.LOAD, 1.0
    state.L0[:], state.EA[:] = whole.L0, net.EA
    halo = Halo(MPI.COMM_SELF, subdomain, halo_width(state))
    at, none, envelope = SimpleNamespace(first=1), np.zeros(0, np.int64), DynamicEnvelope(distribution, state)
    due = np.arange(1, 10_000_000)
    rows = RowTable(state, due, net.DT, due[-1], Probes(none, none, none, none), envelope)
    plan, observed = StepPlan(state, halo), StepPlan(state, halo, rows=rows)
    steps = min(MOST_ROWS, max(1, 200_000 // m))

    def step(plan=plan):
        plan.run(Interval(at.first, steps, net.DT, net.DT, 0.5, 0.0, 1e9))
        at.first += steps

    def step_with_rows():
        rows.made[0] = at.first - 1
        step(observed)
        rows.take_rows()

    audit = lambda: total_energies(MPI.COMM_SELF, state, rows.snapshot.take(state, net.DT, net.DT, 0.5, 0.0))
    found = {"N": N, "elements": m, "step": best(step) / steps, "audit": best(audit)}
    found["row"] = best(step_with_rows) / steps - found["step"]
    return found


for N in sys.argv[1:]:
    if N.isdigit():
        print(json.dumps(measure(int(N))), flush=True)
