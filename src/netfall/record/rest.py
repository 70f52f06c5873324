"""What is kept of an equilibrium besides its state: elements at a limit, torsion left out."""

import numpy as np

from netfall.job.asks import has_second_moments
from netfall.job.job import Job
from netfall.mechanics.bending import joint_moments
from netfall.mechanics.law.limits import REACHED
from netfall.mechanics.state import State
from netfall.model.model import Model
from netfall.parallel.agree import all_of
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.record.energy import Snapshot

NIL = 1e-9  # of EI / l: a moment below that is rounding


def largest_torsion(distribution: Distribution, state: State, chains) -> tuple[float, int]:
    """Find the largest torsion of a chain that is not modelled, and where most of it is. Collective.

    It is the sum of the moments that hold the sections of the chain, the same at any refinement, as a share
    of the largest bending moment. With it comes the number of a particle.
    chains : `net.cables.Chains` on rank 0, None elsewhere
    """
    joints = state.joints
    moment, hold = np.empty((2, len(joints.stiffness)))
    joint_moments(state.x, joints, moment, hold)
    rows = np.column_stack([moment, hold, NIL * joints.stiffness])
    rows = distribution.gather_joints(rows, joints.owned == 1, len(chains.chain) if chains else 0)
    found = None
    if rows is not None:
        (moment, hold, nil), found = rows.T, (0.0, 0)
        if len(rows) and moment.max() > nil.max():
            total = np.bincount(chains.chain, hold)
            k = np.argmax(np.where(chains.chain == np.argmax(total), hold, -1.0))
            found = float(total.max() / moment.max()), int(chains.particles[k, 1])
    return distribution.comm.bcast(found)


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


def beyond_euler(
    comm: MPI.Comm, job: Job, distribution: Distribution, state: State, model: Model | None, N: np.ndarray
) -> dict[str, tuple[int, ...]]:
    """Bars compressed beyond Euler's load, which is no law of theirs, as of `at_limit_in`. Collective.

    model : on rank 0; N : [N] of the elements of this rank
    """
    if not has_second_moments(job):
        return {}
    N, beyond = distribution.gather_elements(N, state.owned.astype(bool)), []
    if model is not None:
        beyond = np.flatnonzero(-N > model.caps.straight).tolist()
    beyond = tuple(comm.bcast(beyond))
    return {"beyond_euler": beyond} if beyond else {}
