"""Form finding of a net by the method of the job (paper 2.5, steps 1 and 2).

The form is the geometry in which the net is in equilibrium under its prestress. The unstressed lengths of the
real material follow in closed form. A form by tensions is found by Newton's method, or by dynamic relaxation
if that does not apply or converge.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from netfall.core.arrays import padded_copy
from netfall.core.errors import DivergedError
from netfall.core.functions import lengths
from netfall.core.messages import kN, without_code
from netfall.core.timings import StopFlag
from netfall.geometry.net import Net
from netfall.geometry.turned import global_held_axes, is_guided, rotation_column
from netfall.parallel.agree import largest_of_ranks, on_root
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.physics.elements import add_axial_forces
from netfall.physics.supports import largest_residual
from netfall.statics import messages
from netfall.statics.bounds import SUBSTITUTE_SHARE
from netfall.statics.form.densities import force_density_form
from netfall.statics.form.self_stress import self_stress
from netfall.statics.form.tensions import FormElements, newton_form
from netfall.statics.relaxation import StaticNet, largest_force, relax


@final
@dataclass
class Form:
    """Result of form finding.

    x : (n, 3) [m], owned and halo; N : (m,) [N]; residual : largest residual force [N] on the free axes
    reference : largest prestress [N] of what can move, the reference of the tolerance
    self_stress : (k, m) states of self-stress of a given geometry, on rank 0; None: not computed
    """

    x: np.ndarray
    N: np.ndarray
    iterations: int
    residual: float
    reference: float
    self_stress: np.ndarray | None = None


class CoincidentNodes(DivergedError):
    """Coincidence of nodes in a relaxation at constant tension."""


@dataclass
class FormSearch:
    """Search for the form of a net by the method of the job.

    net : on rank 0, None elsewhere; settings : [form_finding]
    report(iteration, residual) : called on the way
    """

    net: Net | None
    distribution: Distribution
    halo: Halo
    settings: Any
    report: Callable[[int, float], None]
    stop: StopFlag

    def find(self, load: np.ndarray | None = None, start: Any = None) -> Form:
        """Find the form of the net. Collective. Raises StopRequested.

        load : (n, 3) [N], all particles, on rank 0, that the form carries, None: none
        start : positions (n, 3) [m] of this rank from which to relax, None: the given ones
        """
        net, distribution, settings = self.net, self.distribution, self.settings
        comm, n_owned = distribution.comm, distribution.subdomain.n_owned
        carried = distribution.particles(load) if comm.bcast(load is not None) else None

        def particles(rows: np.ndarray | None) -> np.ndarray:
            # strided columns as in a state, so that compiled kernels serve form finding and equilibria
            return padded_copy(distribution.particles(rows))

        x = particles(None if net is None else net.x)
        held = distribution.particles(None if net is None else global_held_axes(net, net.held))
        free = padded_copy(1 - held.astype(np.uint8))
        if settings.method == "given_geometry":
            stress = on_root(comm, lambda: self_stress(net, load, settings.tolerance))
            N = distribution.elements(stress and stress.N)
            residual = comm.bcast(stress and float(lengths(stress.residual).max()))
            reference = largest_force(comm, N, distribution.subdomain.ends, free)
            return Form(x, N, 1, residual, reference, stress and stress.states)
        guided = comm.bcast(net is not None and bool(is_guided(net, net.held).any()))
        turned = particles(rotation_column(net, net.held) if net else None) if guided else None
        elements = FormElements(distribution, net, x, settings.modulus_factor, carried, turned)
        q, owned_load = elements.densities(), None if carried is None else carried[:n_owned]
        solutions = 0
        if settings.method == "force_density" or settings.start == "force_density":
            linear = on_root(comm, lambda: force_density_form(net, load, settings.tolerance))
            x, solutions = particles(linear and linear.x), comm.bcast(linear and linear.solutions)
            elements.q = distribution.elements(linear and linear.force_density)
            q = elements.densities()
            elements = FormElements(distribution, net, x, settings.modulus_factor, carried, turned)
            if comm.allreduce(not elements.L_start.all(), MPI.LOR):  # collapsed; the model refuses it
                return Form(x, elements.T0, solutions, np.nan, np.nan)
        has_densities = settings.method == "force_density"
        N = q * elements.L_start if has_densities else elements.T0
        reference = largest_force(comm, N, elements.ends, free, owned_load)
        allowed = settings.tolerance * reference
        if has_densities:
            f = np.zeros_like(x) + elements.load
            add_axial_forces(x, elements.ends, N, elements.L_start, f)
            residual = comm.allreduce(largest_residual(f, free, n_owned), MPI.MAX)
            if not residual <= allowed:
                raise DivergedError(messages.DENSITIES_NEARLY_SINGULAR(residual=residual, allowed=allowed))
            return Form(x, N, solutions, residual, reference)
        if start is not None:
            x[:] = start
        moving = StaticNet(x, free, elements.ends, elements.forces, elements.bound, turned=turned)
        iterations, residual = self._by_tensions(moving, elements, allowed)
        return Form(x, elements.N, iterations, residual, reference)

    def _by_tensions(self, moving: StaticNet, elements: FormElements, allowed: float) -> tuple[int, float]:
        """Move moving.x to the form; return iterations and the largest residual [N], at most `allowed`.

        Collective.
        """
        halo, settings = self.halo, self.settings
        result = newton_form(self.distribution, halo, moving, elements, settings, allowed, self.stop)
        if result is not None:
            return result
        report = self._coincidence_check(elements) if elements.constant else self.report
        most = settings.max_iterations
        try:
            return relax(halo, moving, allowed, most, "form finding", report, self.stop)
        except CoincidentNodes:
            raise
        except DivergedError as error:
            worst, reason = self._worst_nodes(moving), without_code(str(error))
            raise DivergedError(messages.FORM_NOT_FOUND(reason=reason, nodes=worst)) from None

    def _coincidence_check(self, elements: FormElements) -> Callable[[int, float], None]:
        """Return a function that reports, and raises CoincidentNodes if nodes coincide. Collective.

        The work of a constant tension is least when its element has zero length. So nodes of an edge cable,
        for example, coincide if the pull of the net does not hold them apart.
        """
        comm, net, numbers = self.distribution.comm, self.net, self.distribution.subdomain.element_gid

        def check(iteration: int, residual: float) -> None:
            self.report(iteration, residual)
            shrinkage, gid = largest_of_ranks(comm, -elements.L / elements.L_start, numbers)
            if -shrinkage < SUBSTITUTE_SHARE:
                ends = net and "-".join(str(net.node_id[p]) for p in net.elements[gid])
                element = comm.bcast(net and f"{net.element_id[gid]} ({ends})")
                raise CoincidentNodes(messages.COINCIDENT_NODES(element=element, iterations=iteration))

        return check

    def _worst_nodes(self, moving: StaticNet) -> str:
        """Return the nodes with the largest residuals as text, the same on every rank. Collective."""
        f, n, net = np.zeros_like(moving.x), self.distribution.subdomain.n_owned, self.net
        moving.forces(moving.x, f)
        size = np.nan_to_num(lengths(np.where(moving.free[:n] != 0, f[:n], 0.0)), nan=np.inf)
        gid = self.distribution.subdomain.particle_gid[:n]
        gathered = self.distribution.comm.allgather((size, gid))
        all_sizes, numbers = (np.concatenate(arrays) for arrays in zip(*gathered))
        worst = np.lexsort((numbers, -all_sizes))[: messages.MAX_LISTED_NODES]
        text = net and ", ".join(f"node {net.node_id[numbers[k]]}: {kN(all_sizes[k])}" for k in worst)
        return str(self.distribution.comm.bcast(text))
