"""Stability of an equilibrium."""

import numpy as np

from netfall.parallel.mpi import MPI
from netfall.statics.multigrid.tangent import pseudo_random
from netfall.statics.newton import STABLE, UNKNOWN, Newton, NoConvergence, NotPositiveDefinite

LEFT = 1e-4  # share of the residual that may remain [-]: small enough to meet unstable displacements


def unstable_shape(newton: Newton) -> np.ndarray | None:
    """Return displacements (n_owned, 3) against which the net has no stiffness, None if stable. Collective.

    Conjugate gradients with a right-hand side that contains every shape meet such displacements if there are
    any. Only compression and moments cause them. Raises NoConvergence if the search does not decide.
    """
    K, newton.inertia = newton.tangent(), 0.0
    if not newton.comm.allreduce(K.is_softened, MPI.LOR):
        return None
    number = 3 * newton.distribution.subdomain.particle_gid[newton.owned, None] + np.arange(3)
    try:
        held = newton.moves & (K.nodal[newton.owned, None] > 0.0)  # without what has left the net
        r = newton.without_held(np.where(held, pseudo_random(number), 0.0))
        newton.solve(K, newton.cycle(K), r, LEFT)
    except NotPositiveDefinite as error:
        return error.shape
    return None


def unstable_at(newton: Newton) -> int:
    """Return the global number of the particle that moves most in the unstable shape, `STABLE` or `UNKNOWN`.

    Collective.
    """
    try:
        shape = unstable_shape(newton)
    except NoConvergence:
        return UNKNOWN
    if shape is None:
        return STABLE
    size = np.sqrt(shape[:, 0] ** 2 + shape[:, 1] ** 2 + shape[:, 2] ** 2)
    gid = newton.distribution.subdomain.particle_gid[: len(size)]
    p = np.lexsort((gid, -size))[0] if len(size) else 0
    candidate = (float(size[p]), -int(gid[p])) if len(size) else (-1.0, 0)
    return -max(newton.comm.allgather(candidate))[1]
