"""Elements that are at a limit of theirs in an equilibrium."""

import numpy as np
from mpi4py import MPI

from netfall.mechanics.material import REACHED
from netfall.mechanics.state import State
from netfall.parallel.agree import all_of
from netfall.parallel.subdomain import Distribution
from netfall.record.energy import Snapshot


def at_limit_in(
    comm: MPI.Comm, distribution: Distribution, state: State, snapshot: Snapshot
) -> dict[str, tuple[int, ...]]:
    """Elements, global numbers, by limit; of a limit at which none is nothing. Collective.

    over_strength : beyond their fracture strain; buckled, yielding : at Euler's load, at the yield force
    """
    gid, N, there = distribution.subdomain.element_gid, snapshot.N, {}
    if state.features.fracture:
        crushed = state.features.crushing and snapshot.eps < state.eps_c
        there["over_strength"] = (snapshot.eps > state.eps_u) | crushed
    if state.features.buckling:
        there["buckled"] = -N >= REACHED * state.euler
    if state.features.plastic:
        there["yielding"] = np.abs(N) >= REACHED * state.yield_force
    whole = state.broken == 0
    found = {name: all_of(comm, gid[at & whole].tolist()) for name, at in there.items()}
    return {name: ids for name, ids in found.items() if ids}
