"""Additional facts on an equilibrium: elements at a limit, and torsion that the model neglects."""

from typing import Any

import numpy as np

from netfall.explicit.energy import Snapshot
from netfall.job.derived import has_second_moments
from netfall.job.job import Job
from netfall.model.model import Model
from netfall.parallel.agree import union_of_ranks
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.physics.bending import joint_moments
from netfall.physics.law.measures import REACHED_SHARE
from netfall.physics.state import State
from netfall.statics.bounds import NEGLIGIBLE


def largest_torsion(distribution: Distribution, state: State, chains: Any) -> tuple[float, int]:
    """Find the largest torsion of a bending chain, which is not modelled, and its location. Collective.

    The torsion is the sum of the moments that support the sections of the chain, independent of refinement.
    The result is its share of the largest bending moment, and the number of the particle with the largest
    part.
    chains : `geometry.cables.BendingChains` on rank 0, None elsewhere
    """
    joints = state.joints
    assert joints is not None
    moment, hold = np.empty((2, len(joints.stiffness)))
    joint_moments(state.x, joints, moment, hold)
    rows = np.column_stack([moment, hold, NEGLIGIBLE * joints.stiffness])
    rows = distribution.gather_joints(rows, joints.owned == 1, len(chains.chain) if chains else 0)
    torsion = None
    if rows is not None:
        (moment, hold, nil), torsion = rows.T, (0.0, 0)
        if len(rows) and moment.max() > nil.max():
            chain_torsion = np.bincount(chains.chain, hold)
            k = np.argmax(np.where(chains.chain == np.argmax(chain_torsion), hold, -1.0))
            torsion = float(chain_torsion.max() / moment.max()), int(chains.particles[k, 1])
    return distribution.comm.bcast(torsion)


def elements_at_limits(
    comm: MPI.Comm, distribution: Distribution, state: State, snapshot: Snapshot
) -> dict[str, tuple[int, ...]]:
    """Return the global numbers of elements at each limit, without limits that none reaches. Collective.

    over_strength : beyond their fracture strain; buckled, yielding : at the Euler load, at the yield force
    """
    gid, N, at_limit = distribution.subdomain.element_gid, snapshot.N, {}
    if state.features.fracture:
        crushed = state.features.crushing and snapshot.eps < state.eps_c
        at_limit["over_strength"] = (snapshot.eps > state.eps_u) | crushed
    if state.features.buckling:
        at_limit["buckled"] = -N >= REACHED_SHARE * state.euler
    if state.features.plastic:
        at_limit["yielding"] = np.abs(N) >= REACHED_SHARE * state.yield_force
    whole = state.broken == 0
    numbers = {
        name: union_of_ranks(comm, gid[reached & whole].tolist()) for name, reached in at_limit.items()
    }
    return {name: ids for name, ids in numbers.items() if ids}


def beyond_euler(
    comm: MPI.Comm, job: Job, distribution: Distribution, state: State, model: Model | None, N: np.ndarray
) -> dict[str, tuple[int, ...]]:
    """Return bars compressed beyond the Euler load that the model does not buckle. Collective.

    The format is that of `elements_at_limits`. model : on rank 0; N : [N] of the elements of this rank
    """
    if not has_second_moments(job):
        return {}
    all_N: Any = distribution.gather_elements(N, state.owned.astype(bool))
    elements: list[int] = []
    if model is not None:
        elements = np.flatnonzero(-all_N > model.element_force_limits.straight).tolist()
    beyond = tuple(comm.bcast(elements))
    return {"beyond_euler": beyond} if beyond else {}
