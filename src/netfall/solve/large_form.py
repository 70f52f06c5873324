"""The form of a large net by Newton's method, at a cost in proportion to the net.

Relaxation takes the more iterations the finer the net is. Newton's method does not, once it begins near the
form: from equilibrium by force density, which is a linear problem. Without axial stiffness (constant tension)
its tangent couples particles along cables alone, across each of them; the levels of `multilevel` do not serve
that, and relaxation is faster. Neither is it tried where struts are compressed: such a net has several forms,
and what is looked for is the one near the given geometry.
"""

import numpy as np
from mpi4py import MPI

from netfall.mechanics.elements import add_tensions
from netfall.solve.newton import Newton, is_large
from netfall.solve.outcome import NotFound, Stopped
from netfall.solve.relaxation import Paused, nodal_stiffness, not_begun
from netfall.solve.stable import falling
from netfall.solve.tangent import Tangent

NEAR = 1e-2  # of the residual forces, what the start leaves
TIGHTER = 0.1  # times: the tolerance where the residual asks for more
MOST_AGAIN = 4


def large_form(comm, distribution, halo, net, elements, settings, asked: float, stop) -> tuple | None:
    """Move net.x to the form; iterations of conjugate gradients and the largest residual [N]. Collective.

    net : `relaxation.Net`; elements : `form_finding.Elements`; asked : [N], of the residual
    stop : a wish to pause

    None where Newton's method is not tried or does not find it; net.x is then as before. Raises Paused.
    """
    if not is_large(distribution) or settings.modulus_factor == 0.0:
        return None
    if comm.allreduce(bool((elements.T0 < 0.0).any()), MPI.LOR):  # compressed struts
        return None
    before = net.x.copy(order="K")
    inverse = lambda newton, tangent: newton.cycle(tangent)
    newton = Newton(comm, halo, distribution, net, lambda: tangent_of_form(elements, net.x), inverse)
    try:
        total = _towards_force_density(newton, elements)
        for k in range(MOST_AGAIN):
            found = newton.find(settings.tolerance * TIGHTER**k, before, stop)
            total += found.gradients
            if found.residual > asked:
                continue
            if falling(newton) is None:
                return total, found.residual
            break
    except Stopped:
        net.x[:] = before
        raise Paused(not_begun(before)) from None
    except NotFound:
        pass
    net.x[:] = before
    return None


def tangent_of_form(elements, x: np.ndarray) -> Tangent:
    """The tangent stiffness of form-finding elements at x (n, 3)."""
    elements.measure(x)
    taut = (elements.N > 0.0) | (elements.bar != 0)
    across = elements.N / np.maximum(elements.L, 1e-300)
    return _tangent(elements, x, elements.N.copy(), np.where(taut, elements.stiffness, 0.0), across)


def _tangent(elements, x, N, axial, across) -> Tangent:
    length = np.maximum(elements.L, 1e-300)[:, None]
    direction = np.ascontiguousarray((x[elements.ends[:, 1]] - x[elements.ends[:, 0]]) / length)
    nodal = np.zeros(len(x))
    nodal_stiffness(elements.ends, elements.stiffness + np.abs(across), nodal)
    return Tangent(N, direction, axial, across, None, nodal)


def _towards_force_density(newton: Newton, elements) -> int:
    """Move to where the elements, of the force densities they begin with, nearly hold each other. Collective.

    The iterations. Raises NotFound where the densities hold no shape.
    """
    x = newton.net.x
    elements.measure(x)
    q = elements.densities()
    N = q * elements.L
    newton.f[:] = 0.0
    add_tensions(x, elements.ends, N, elements.L, newton.f)
    r = np.where(newton.moves, newton.f[newton.owned], 0.0)
    K = _tangent(elements, x, N, q, q)
    s, count = newton.solve(K, newton.cycle(K), r, NEAR)
    newton.spread_out(s)
    x += newton.spread
    return count
