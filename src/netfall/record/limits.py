"""Elements that are at a limit of theirs in an equilibrium."""

import numpy as np
from mpi4py import MPI

from netfall.mechanics.state import State
from netfall.parallel.subdomain import Distribution
from netfall.record.energy import Snapshot

NEAR = 1.0 - 1e-12  # of a force: at it


def at_limit_in(
    comm: MPI.Comm, distribution: Distribution, state: State, snapshot: Snapshot, most: int
) -> dict[str, tuple[int, ...]]:
    """Elements, global numbers, by limit; of a limit at which none is nothing. Collective.

    over_strength : all that are beyond their fracture strain
    buckled, yielding : at Euler's load, at the yield force; the first of them, so many at most
    """
    gid, N, whole, found = distribution.subdomain.element_gid, snapshot.N, state.broken == 0, {}
    if state.features.fracture:
        crushed = state.features.crushing and snapshot.eps < state.eps_c
        found["over_strength"] = gid[((snapshot.eps > state.eps_u) | crushed) & whole]
    if state.features.buckling:
        found["buckled"] = np.sort(gid[(-N >= NEAR * state.euler) & whole])[:most]
    if state.features.plastic:
        found["yielding"] = np.sort(gid[(np.abs(N) >= NEAR * state.yield_force) & whole])[:most]
    all_of = {name: set().union(*comm.allgather(ids.tolist())) for name, ids in found.items()}
    return {name: tuple(sorted(ids)) for name, ids in all_of.items() if ids}
