"""The form by tensions: by dynamic relaxation, and by Newton's method where the net is large."""

import numpy as np

from netfall.equilibrium.relaxation import Net as RelaxedNet
from netfall.equilibrium.relaxation import relax
from netfall.form.elements import Elements
from netfall.form.newton import newton_form
from netfall.ground.errors import DivergedError
from netfall.net.net import Net
from netfall.numerics.functions import lengths
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution

TOGETHER = 1e-6  # of the length at the start: an element so short is as good as gone
LOOKS = 10  # in turn, at which one is: a node may pass close to another on its way
MANY = 10_000  # particles: below that relaxation takes no longer than Newton's method (jobs/bench)
WORST = 5  # nodes that a failed form names
ADVICE = (
    "for struts and rings set [form_finding] modulus_factor = 1, or begin with a state of self-stress, "
    'method = "keep"; give prestresses or force densities that balance at these nodes'
)


def form_by_tensions(
    comm, net, distribution, halo, moving: RelaxedNet, elements, settings, asked, report, stop, resume
) -> tuple:
    """Move moving.x to the form by tensions; iterations and the largest residual [N]. Collective.

    By Newton's method where the net is large, or where nodes ran together in a relaxation, else by that;
    asked : [N], of the residual; the others as of `find_form`
    """
    by_newton = lambda: newton_form(comm, distribution, halo, moving, elements, settings, asked, stop)
    begun = moving.x.copy(order="K")
    large = distribution.n >= MANY
    if resume is None or resume.iteration == 0:
        resume = None
        if large and (found := by_newton()) is not None:
            return found
    if elements.constant:
        report = Watch(comm, distribution, net, elements, report)
    try:
        most = settings.max_iterations
        return relax(comm, halo, moving, asked, most, "form finding", report, stop, resume)
    except DivergedError as error:
        worst, moving.x[:] = worst_nodes(comm, net, distribution, moving), begun
        found = by_newton() if isinstance(error, RunTogether) and not large else None
        if found is None:
            more = "raise max_iterations or tolerance"
            raise DivergedError(f"{error}; {more}; {worst}; {ADVICE}") from None
        return found


class RunTogether(DivergedError):
    """Nodes have, in a relaxation at constant tension."""


class Watch:
    """Looks, where a relaxation at constant tension is reported, whether nodes have run together.

    Tensions that stay the same however short an element gets have their least work there: along an edge
    cable, say, that what pulls at it does not hold apart.
    """

    def __init__(
        self, comm: MPI.Comm, distribution: Distribution, net: Net | None, elements: Elements, report
    ):
        """net : on rank 0, None elsewhere; report : what is called besides"""
        self.comm, self.net, self.elements, self.report = comm, net, elements, report
        self.gid, self.looks = distribution.subdomain.element_gid, 0

    def __call__(self, iteration: int, residual: float) -> None:
        """Collective. Raises RunTogether where an element is as good as gone in LOOKS looks in turn."""
        self.report(iteration, residual)
        share = self.elements.L / self.elements.L_start
        e = int(np.argmin(share)) if len(share) else -1
        least, gid = min(self.comm.allgather((float(share[e]), int(self.gid[e])) if e >= 0 else (np.inf, -1)))
        self.looks = self.looks + 1 if least < TOGETHER else 0
        if self.looks < LOOKS:
            return
        net = self.net
        ends = net and "-".join(str(net.node_id[p]) for p in net.elements[gid])
        name = net and f"{net.element_id[gid]} ({ends})"
        raise RunTogether(
            f"form finding at constant tension: after {iteration} iterations the nodes of element "
            f"{self.comm.bcast(name)} have run together: nothing holds them apart, and these tensions have "
            'no form; set [form_finding] modulus_factor = 1e-3, or method = "force_density"'
        )


def worst_nodes(comm: MPI.Comm, net: Net | None, distribution: Distribution, moving: RelaxedNet) -> str:
    """The nodes with the largest residuals, at most `WORST`, in words, the same on every rank. Collective."""
    f, n = np.zeros_like(moving.x), distribution.subdomain.n_owned
    moving.forces(moving.x, f)
    size = lengths(np.where(moving.free[:n] != 0, f[:n], 0.0))
    order = np.argsort(-np.nan_to_num(size, nan=np.inf), kind="stable")[:WORST]
    gid = distribution.subdomain.particle_gid[:n][order]
    every = [pair for mine in comm.allgather(list(zip(size[order].tolist(), gid.tolist()))) for pair in mine]
    every.sort(key=lambda pair: (-np.nan_to_num(pair[0], nan=np.inf), pair[1]))
    told = net and ", ".join(f"node {net.node_id[p]}: {N:.3g} N" for N, p in every[:WORST])
    return f"largest residuals: {comm.bcast(told)}"
