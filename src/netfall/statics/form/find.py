"""Form finding of a net by the method of the job (paper 2.5, steps 1 and 2).

The form is the geometry in which the net is in equilibrium under its prestress. The unstressed lengths of the
real material follow in closed form.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from netfall.core.arrays import padded_copy
from netfall.core.errors import DivergedError
from netfall.core.functions import lengths
from netfall.core.stop import NEVER_STOP, StopFlag
from netfall.geometry.net import Net
from netfall.geometry.turned import global_held_axes, is_guided, rotation_column
from netfall.parallel.agree import on_root
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.physics.elements import add_axial_forces_now
from netfall.physics.supports import largest_residual
from netfall.statics import messages
from netfall.statics.form.densities import force_density_form
from netfall.statics.form.elements import Elements
from netfall.statics.form.self_stress import self_stress
from netfall.statics.form.tensions import form_by_tensions
from netfall.statics.relaxation import Net as RelaxedNet
from netfall.statics.relaxation import Relaxation, largest_force


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


def find_form(
    comm: MPI.Comm,
    net: Net | None,
    distribution: Distribution,
    settings: Any,
    halo: Halo,
    report: Callable[..., Any],
    stop: StopFlag = NEVER_STOP,
    resume: Relaxation | None = None,
    load: np.ndarray | None = None,
    start: np.ndarray | None = None,
) -> Form:
    """Find the form of the net by the method of the job. Collective.

    net : on rank 0, None elsewhere; stop, resume : see `relax`
    load : (n, 3) [N], all particles, on rank 0, that the form carries, None: none; start : positions (n, 3)
        [m] of this rank from which to relax, None: the given ones
    """
    if net is not None and load is not None:
        load = load[: net.n]
    carried = distribution.particles(load) if comm.bcast(load is not None) else None

    def particles(rows: np.ndarray | None) -> np.ndarray:
        # strided columns as in a state, so that compiled kernels serve form finding and equilibria
        return padded_copy(distribution.particles(rows))

    x = particles(None if net is None else net.x)
    held = distribution.particles(None if net is None else global_held_axes(net, net.held))
    free = padded_copy(1 - held.astype(np.uint8))
    guided = comm.bcast(net is not None and bool(is_guided(net, net.held).any()))
    turned = particles(rotation_column(net, net.held) if net else None) if guided else None
    if settings.method == "given_geometry":
        return form_as_given(comm, net, distribution, settings, x, free, load)
    given_elements = Elements(distribution, net, x, settings.modulus_factor, carried, turned)
    owned_load = None if carried is None else carried[: halo.n_owned]

    def largest(N: np.ndarray) -> float:
        return largest_force(comm, N, given_elements.ends, free, owned_load)

    if settings.method == "force_density" or settings.start == "force_density":
        x = particles(on_root(comm, lambda: force_density_form(net, load)))
        elements = Elements(distribution, net, x, settings.modulus_factor, carried, turned)
    else:
        elements = given_elements
    if settings.method == "force_density":
        return _of_densities(
            comm, given_elements.densities(), elements, x, free, halo.n_owned, settings.tolerance, largest
        )
    if start is not None:
        x[:] = start
    moving = RelaxedNet(x, free, elements.ends, elements.forces, elements.bound, turned=turned)
    reference = largest(elements.T0)
    target_residual = settings.tolerance * reference
    iterations, residual = form_by_tensions(
        comm, net, distribution, halo, moving, elements, settings, target_residual, report, stop, resume
    )
    return Form(x, elements.N, iterations, residual, reference)


def _of_densities(
    comm: MPI.Comm, q: Any, elements: Elements, x: Any, free: Any, n_owned: Any, tolerance: Any, largest: Any
) -> Form:
    """Build the form at x (n, 3) [m] from force densities q (m,) [N/m] and check its residual. Collective.

    largest(N) : returns the largest of forces, see `find_form`

    Raises DivergedError if the residual is too large.
    """
    N = q * elements.L_start
    f = np.zeros_like(x) + elements.load
    add_axial_forces_now(x, elements.ends, N, elements.L_start, f)
    residual, reference = comm.allreduce(largest_residual(f, free, n_owned), MPI.MAX), largest(N)
    if not residual <= tolerance * reference:
        allowed = tolerance * reference
        raise DivergedError(messages.DENSITIES_NEARLY_SINGULAR(residual=residual, allowed=allowed))
    return Form(x, N, 1, residual, reference)


def form_as_given(
    comm: MPI.Comm, net: Net | None, distribution: Distribution, settings: Any, x: Any, free: Any, load: Any
) -> Form:
    """Build the form of the given geometry, x (n, 3) [m], with its self-stress. Collective.

    load : see `find_form`
    """
    stress = on_root(comm, lambda: self_stress(net, load, settings.tolerance))
    N = distribution.elements(stress and stress.N)
    residual = comm.bcast(stress and float(lengths(stress.residual).max()))
    reference = largest_force(comm, N, distribution.subdomain.ends, free)
    return Form(x, N, 1, residual, reference, stress and stress.states)
