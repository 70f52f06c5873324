"""Form finding by tensions, by Newton's method from the equilibrium of force densities.

Elements have N = T0 + s EA (L - L_start) / L_start, with s a small share of the modulus, or 0 for constant
tension.
"""

from functools import cache
from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray, padded_copy
from netfall.core.functions import lengths
from netfall.geometry.net import Net
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.physics.elements import add_axial_forces, geometric_stiffness, nodal_stiffness
from netfall.physics.supports import project_on_guides
from netfall.statics.bounds import LARGE_SHARE, MAX_DECADES, SUBSTITUTE_SHARE
from netfall.statics.multigrid.cycle import CycleStructure
from netfall.statics.multigrid.lines import distribute_lines
from netfall.statics.multigrid.tangent import Tangent
from netfall.statics.newton import STABLE, Newton, NoConvergence

# artificial stiffness along elements of constant tension, over their force density [-], in turn
ARTIFICIAL_STIFFNESS = (0.1, 0.01, 1e-3, 1e-4)


class FormElements:
    """Form-finding elements of one rank; a cable never pushes."""

    def __init__(
        self,
        distribution: Distribution,
        net: Net | None,
        x: FloatArray,
        modulus_factor: float,
        load: Any = None,
        turned: Any = None,
    ):
        """load : (n, 3) [N] that the form carries, None: none; turned : as in `relaxation.StaticNet`"""
        self.load, self.turned = 0.0 if load is None else np.asfortranarray(load), turned
        self.constant = modulus_factor == 0.0  # whether tensions are constant

        def column(name: str) -> np.ndarray:
            return distribution.elements(None if net is None else getattr(net, name))

        self.ends = distribution.subdomain.ends
        self.bar = column("bar").astype(np.uint8)
        self.T0, self.q, EA = column("prestress"), column("force_density"), column("EA")
        self.stiffness = self.L_start = np.zeros_like(EA)
        self.measure(x)
        self.L_start = self.L
        with np.errstate(divide="ignore", invalid="ignore"):  # a collapsed form is refused later
            self.stiffness = modulus_factor * EA / self.L_start

    def densities(self) -> Any:
        """Return force densities (m,) [N/m]: as given, otherwise prestress over initial length."""
        return np.where(np.isfinite(self.q), self.q, self.T0 / self.L_start)

    def measure(self, x: FloatArray) -> None:
        """Compute tensions `N` [N] and lengths `L` [m] at x."""
        self.L = lengths(x[self.ends[:, 1]] - x[self.ends[:, 0]])
        N = self.T0 + self.stiffness * (self.L - self.L_start)
        self.N = np.where((N < 0.0) & (self.bar == 0), 0.0, N)

    def forces(self, x: FloatArray, f: FloatArray) -> None:
        """Write the forces f (n, 3) [N] of the elements at x, without components along held lines."""
        self.measure(x)
        f[:] = self.load
        add_axial_forces(x, self.ends, self.N, self.L, f)
        if self.turned is not None:
            project_on_guides(self.turned, f)

    def bound(self, x: FloatArray) -> FloatArray:
        """Compute an upper bound (m,) [N/m] of the stiffness, axial and transverse."""
        return self.stiffness + geometric_stiffness(self.N, self.L)


def tangent_of_form(elements: Any, x: np.ndarray, share: float = SUBSTITUTE_SHARE) -> Tangent:
    """Compute the tangent stiffness of form-finding elements at x (n, 3).

    share : of the force density, used as stiffness along elements of constant tension, which have none
    """
    elements.measure(x)
    taut = (elements.N > 0.0) | (elements.bar != 0)
    across = elements.N / np.maximum(elements.L, 1e-300)
    along = share * across if elements.constant else elements.stiffness
    return tangent_at_forces(elements, x, elements.N, np.where(taut, along, 0.0), across)


def tangent_at_forces(elements: Any, x: np.ndarray, N: Any, axial: Any, across: Any) -> Tangent:
    """Compute the tangent stiffness at x (n, 3) of axial forces N [N].

    axial, across : stiffness along and across the elements [N/m]
    """
    length = np.maximum(elements.L, 1e-300)[:, None]
    direction = np.ascontiguousarray((x[elements.ends[:, 1]] - x[elements.ends[:, 0]]) / length)
    nodal = np.zeros(len(x))
    nodal_stiffness(elements.ends, elements.stiffness + np.abs(across), nodal)
    return Tangent(N, direction, axial, across, None, nodal)


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

    elements : `FormElements`; target_residual : [N]; stop : stop flag

    Returns None and restores net.x if Newton's method does not apply or does not converge.
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
    K = tangent_at_forces(elements, x, N, q, q)
    s, count = newton.solve(K, newton.cycle(K), r)
    newton.set_displacement(s)
    x += newton.u
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
        if newton.move_along(s, r) < LARGE_SHARE:
            raise NoConvergence("the form of these tensions is nearly undetermined")
    return total
