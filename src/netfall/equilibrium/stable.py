"""Whether an equilibrium is stable."""

import numpy as np

from netfall.equilibrium.newton import STABLE, UNKNOWN, Newton, NoConvergence, NotPositiveDefinite
from netfall.multigrid.tangent import scattered
from netfall.parallel.mpi import MPI

LEFT = 1e-4  # of a residual [-]: by then conjugate gradients have met displacements without stiffness


def unstable_shape(newton: Newton) -> np.ndarray | None:
    """Displacements (n_owned, 3) against which the net has no stiffness; None if stable. Collective.

    Conjugate gradients that answer forces of every shape come upon such displacements if there are any. Only
    compression, and moments, make them. Raises NoConvergence where that cannot be told.
    """
    K, newton.inertia = newton.tangent(), 0.0
    if not newton.comm.allreduce(K.softened, MPI.LOR):
        return None
    number = 3 * newton.distribution.subdomain.particle_gid[newton.owned, None] + np.arange(3)
    try:
        held = newton.moves & (K.nodal[newton.owned, None] > 0.0)  # not what has left the net
        r = newton.not_held(np.where(held, scattered(number), 0.0))
        newton.solve(K, newton.cycle(K), r, LEFT)
    except NotPositiveDefinite as error:
        return error.shape
    return None


def unstable_at(newton: Newton) -> int:
    """Global number of the particle that moves most in an unstable equilibrium, else `STABLE` or `UNKNOWN`.

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
    mine = (float(size[p]), -int(gid[p])) if len(size) else (-1.0, 0)
    return -max(newton.comm.allgather(mine))[1]
