"""Form finding by tensions: by dynamic relaxation, and by Newton's method for large nets."""

from collections.abc import Callable
from typing import Any

import numpy as np

from netfall.core.errors import DivergedError
from netfall.core.functions import lengths
from netfall.core.message import kN, without_code
from netfall.core.stop import StopFlag
from netfall.geometry.net import Net
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.statics import messages
from netfall.statics.form.elements import Elements
from netfall.statics.form.newton import newton_form
from netfall.statics.relaxation import Net as RelaxedNet
from netfall.statics.relaxation import Relaxation, relax

COINCIDENT = 1e-6  # length over the initial one [-], below which the nodes of an element coincide
COINCIDENCE_CHECKS = 10  # consecutive checks that must find it: a node may pass close to another on its way
MANY = 10_000  # particles: below that, relaxation is as fast as Newton's method (jobs/bench)
MAX_WORST_NODES = 5  # nodes that the message on a failure names


def form_by_tensions(
    comm: MPI.Comm,
    net: Net | None,
    distribution: Distribution,
    halo: Halo,
    moving: RelaxedNet,
    elements: Elements,
    settings: Any,
    target_residual: float,
    report: Callable[..., Any],
    stop: StopFlag,
    resume: Relaxation | None,
) -> tuple[Any, ...]:
    """Move moving.x to the form by tensions; return iterations and the largest residual [N]. Collective.

    Newton's method is used if the net is large or if nodes coincide in a relaxation, otherwise relaxation.
    target_residual : [N]; see `find_form` for the others
    """

    def by_newton() -> tuple[Any, ...] | None:
        return newton_form(comm, distribution, halo, moving, elements, settings, target_residual, stop)

    start = moving.x.copy(order="K")
    is_large = distribution.n >= MANY
    if resume is None or resume.iteration == 0:
        resume = None
        if is_large and (result := by_newton()) is not None:
            return result
    if elements.constant:
        report = CoincidenceCheck(comm, distribution, net, elements, report)
    try:
        max_iterations = settings.max_iterations
        return relax(
            comm, halo, moving, target_residual, max_iterations, "form finding", report, stop, resume
        )
    except DivergedError as error:
        worst, moving.x[:] = worst_nodes(comm, net, distribution, moving), start
        if not isinstance(error, CoincidentNodes):
            reason = without_code(str(error))
            raise DivergedError(messages.FORM_NOT_FOUND(reason=reason, nodes=worst)) from None
        result = None if is_large else by_newton()
        if result is None:
            raise
        return result


class CoincidentNodes(DivergedError):
    """Coincidence of nodes in a relaxation at constant tension."""


class CoincidenceCheck:
    """Check for nodes that coincide in a relaxation at constant tension, made whenever it reports.

    The work of a constant tension is least when its element has zero length. So nodes of an edge cable, for
    example, coincide if the pull of the net does not hold them apart.
    """

    def __init__(
        self,
        comm: MPI.Comm,
        distribution: Distribution,
        net: Net | None,
        elements: Elements,
        report: Callable[..., Any],
    ):
        """net : on rank 0, None elsewhere; report : called in addition"""
        self.comm, self.net, self.elements, self.report = comm, net, elements, report
        self.gid, self.looks = distribution.subdomain.element_gid, 0

    def __call__(self, iteration: int, residual: float) -> None:
        """Raise CoincidentNodes if an element's nodes coincide in COINCIDENCE_CHECKS consecutive checks.

        Collective.
        """
        self.report(iteration, residual)
        ratio = self.elements.L / self.elements.L_start
        e = int(np.argmin(ratio)) if len(ratio) else -1
        smallest, gid = min(
            self.comm.allgather((float(ratio[e]), int(self.gid[e])) if e >= 0 else (np.inf, -1))
        )
        self.looks = self.looks + 1 if smallest < COINCIDENT else 0
        if self.looks < COINCIDENCE_CHECKS:
            return
        net = self.net
        ends = net and "-".join(str(net.node_id[p]) for p in net.elements[gid])
        name = net and f"{net.element_id[gid]} ({ends})"
        element = self.comm.bcast(name)
        raise CoincidentNodes(messages.COINCIDENT_NODES(element=element, iterations=iteration))


def worst_nodes(comm: MPI.Comm, net: Net | None, distribution: Distribution, moving: RelaxedNet) -> str:
    """Return the nodes with the largest residuals as text, at most `MAX_WORST_NODES`, the same on every rank.

    Collective.
    """
    f, n = np.zeros_like(moving.x), distribution.subdomain.n_owned
    moving.forces(moving.x, f)
    size = lengths(np.where(moving.free[:n] != 0, f[:n], 0.0))
    gid = distribution.subdomain.particle_gid[:n]
    order = np.lexsort((gid, -np.nan_to_num(size, nan=np.inf)))[:MAX_WORST_NODES]
    pairs = [
        pair
        for local_pairs in comm.allgather(list(zip(size[order].tolist(), gid[order].tolist())))
        for pair in local_pairs
    ]
    pairs.sort(key=lambda pair: (-np.nan_to_num(pair[0], nan=np.inf), pair[1]))
    text = net and ", ".join(f"node {net.node_id[p]}: {kN(N)}" for N, p in pairs[:MAX_WORST_NODES])
    return str(comm.bcast(text))
