"""The form by tensions, by Newton's method from the equilibrium of force densities."""

from functools import cache

from netfall.equilibrium.newton import SHORT, Newton, NoConvergence, Stopped
from netfall.equilibrium.relaxation import Paused, not_begun
from netfall.equilibrium.stable import unstable_shape
from netfall.form.elements import tangent_of, tangent_of_form
from netfall.ground.columns import placed
from netfall.mechanics.elements import add_tensions
from netfall.multigrid.cycle import Structure
from netfall.multigrid.lines import lines_of
from netfall.parallel.mpi import MPI

NEAR = 1e-2  # of the residual forces, what the start leaves
SOFTER = (0.1, 0.01, 1e-3, 1e-4)  # of force densities: stiffness along elements of constant tension, in turn
TIGHTER = 0.1  # times: the tolerance where the residual asks for more
MOST_AGAIN = 4


def newton_form(comm, distribution, halo, net, elements, settings, asked: float, stop) -> tuple | None:
    """Move net.x to the form; iterations of conjugate gradients and the largest residual [N]. Collective.

    net : `relaxation.Net`; elements : `elements.Elements`; asked : [N], of the residual
    stop : a wish to pause

    None where Newton's method is not tried or does not find it; net.x is then as before. Raises Paused.
    """
    if net.turned is not None:
        return None
    if comm.allreduce(bool((elements.T0 < 0.0).any()), MPI.LOR):  # compressed struts
        return None
    before = placed(net.x)
    kept = Structure(cache(lambda: lines_of(distribution, elements.ends, before, net.free)))
    newton = Newton(comm, halo, distribution, net, lambda: tangent_of_form(elements, net.x), kept)
    try:
        total = _towards_force_density(newton, elements)
        if elements.constant:
            total += _nearer(newton, elements)
        for k in range(MOST_AGAIN):
            found = newton.find(settings.tolerance * TIGHTER**k, before, stop)
            total += found.iterations
            if found.residual > asked:
                continue
            if unstable_shape(newton) is None:
                return total, found.residual
            break
    except Stopped:
        net.x[:] = before
        raise Paused(not_begun(before)) from None
    except NoConvergence:
        pass
    net.x[:] = before
    return None


def _towards_force_density(newton: Newton, elements) -> int:
    """Move to where the elements, of the force densities they begin with, nearly hold each other. Collective.

    The iterations. Raises NoConvergence where the densities hold no shape.
    """
    x = newton.net.x
    elements.measure(x)
    q = elements.densities()
    N = q * elements.L
    newton.f[:] = elements.load
    add_tensions(x, elements.ends, N, elements.L, newton.f)
    r = newton.not_held(newton.f[newton.owned])
    K = tangent_of(elements, x, N, q, q)
    s, count = newton.solve(K, newton.cycle(K), r, NEAR)
    newton.spread_out(s)
    x += newton.spread
    return count


def _nearer(newton: Newton, elements) -> int:
    """Move nearer to the form at constant tension; the iterations. Collective. Raises NoConvergence.

    The tangent has no stiffness along elements, and far away its corrections let nodes of a cable run
    together. So it has some, less at each correction.
    """
    newton.begin()
    total = 0
    for share in SOFTER:
        r, K = newton.residual(), tangent_of_form(elements, newton.net.x, share)
        s, count = newton.solve(K, newton.cycle(K), r, NEAR)
        total += count
        if newton.go(s, r) < SHORT:
            raise NoConvergence("these tensions hardly have a form")
    return total
