"""Form finding by tensions, by Newton's method from the equilibrium of force densities."""

from functools import cache
from typing import Any

from netfall.core.arrays import padded_copy
from netfall.parallel.mpi import MPI
from netfall.physics.elements import add_axial_forces
from netfall.statics.bounds import LARGE_SHARE, MAX_DECADES
from netfall.statics.form.elements import tangent_of, tangent_of_form
from netfall.statics.multigrid.cycle import CycleStructure
from netfall.statics.multigrid.lines import distribute_lines
from netfall.statics.newton import STABLE, Newton, NoConvergence, StopRequested
from netfall.statics.relaxation import Paused, initial_relaxation

# artificial stiffness along elements of constant tension, over their force density [-], in turn
ARTIFICIAL_STIFFNESS = (0.1, 0.01, 1e-3, 1e-4)


def newton_form(
    distribution: Any,
    halo: Any,
    net: Any,
    elements: Any,
    settings: Any,
    target_residual: float,
    stop: Any,
) -> tuple[Any, ...] | None:
    """Move net.x to the form; return conjugate gradient iterations and the largest residual [N]. Collective.

    net : `relaxation.Net`; elements : `elements.Elements`; target_residual : [N]; stop : stop flag

    Returns None and restores net.x if Newton's method does not apply or does not converge. Raises Paused.
    """
    comm = distribution.comm
    has_struts = comm.allreduce(bool((elements.T0 < 0.0).any()), MPI.LOR)
    if net.turned is not None or has_struts:
        return None
    before = padded_copy(net.x)
    structure = CycleStructure(cache(lambda: distribute_lines(distribution, elements.ends, before, net.free)))
    newton = Newton(comm, halo, distribution, net, lambda: tangent_of_form(elements, net.x), structure)
    try:
        total = _approach_force_densities(newton, elements)
        if elements.constant:
            total += _approach_constant_tension(newton, elements)
        for k in range(MAX_DECADES):
            solution = newton.find(settings.tolerance / 10.0**k, before, stop)
            total += solution.iterations
            if solution.residual > target_residual:
                continue
            if solution.unstable_at == STABLE:
                return total, solution.residual
            break
    except StopRequested:
        net.x[:] = before
        raise Paused(initial_relaxation(before)) from None
    except NoConvergence:
        pass
    net.x[:] = before
    return None


def _approach_force_densities(newton: Newton, elements: Any) -> int:
    """Move the net close to the equilibrium of its initial force densities; return the iterations.

    Collective.

    Raises NoConvergence if the densities define no shape.
    """
    x = newton.net.x
    elements.measure(x)
    q = elements.densities()
    N = q * elements.L
    newton.f[:] = elements.load
    add_axial_forces(x, elements.ends, N, elements.L, newton.f)
    r = newton.without_held(newton.f[newton.owned])
    K = tangent_of(elements, x, N, q, q)
    s, count = newton.solve(K, newton.cycle(K), r)
    newton.set_displacement(s)
    x += newton.spread
    return count


def _approach_constant_tension(newton: Newton, elements: Any) -> int:
    """Move the net closer to the form at constant tension; return the iterations. Collective.

    The tangent has no stiffness along elements. Far from the form its corrections would let the nodes of a
    cable coincide. So an artificial stiffness is added that decreases with each correction. Raises
    NoConvergence.
    """
    newton.begin()
    total = 0
    for share in ARTIFICIAL_STIFFNESS:
        r, K = newton.residual(), tangent_of_form(elements, newton.net.x, share)
        s, count = newton.solve(K, newton.cycle(K), r)
        total += count
        if newton.go(s, r) < LARGE_SHARE:
            raise NoConvergence("the form of these tensions is nearly undetermined")
    return total
