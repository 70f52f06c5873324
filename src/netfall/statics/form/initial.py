"""Form of a job: form finding, and the permanent load that depends on the form."""

from collections.abc import Callable
from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray
from netfall.core.errors import DivergedError
from netfall.core.timings import StopFlag
from netfall.geometry.net import (
    Net,
    space_inner_particles,
    straighten_bars,
    undivide_bars,
    undo_subdivision,
)
from netfall.job.derived import carries_permanent
from netfall.job.job import Job
from netfall.model.layout import Layout
from netfall.model.model import permanent_load_of_form
from netfall.parallel.agree import on_root
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution, split_net
from netfall.statics import messages
from netfall.statics.bounds import MOST_STEPS, SETTLED_CHANGE
from netfall.statics.form.find import Form, FormSearch


def find_initial_form(
    job: Job,
    layout: Layout | None,
    distribution: Distribution,
    halo: Halo,
    report: Callable[..., Any],
    stop: StopFlag,
) -> tuple[Form, FloatArray | None, FloatArray | None]:
    """Find the form and return it with positions (n, 3) [m] and tensions (m,) [N] of the net on rank 0.

    Collective. Raises StopRequested if `stop` is set.

    If nothing loads an element between its ends, it is straight and has one tension. So the form of a
    subdivided net is that of the net as given, with the new particles evenly spaced. If the form carries its
    permanent load, cables sag between their ends and remain subdivided. Bars do not, because parts in
    compression would fold.
    """
    comm, is_loaded, own_halo = distribution.comm, carries_permanent(job), None
    net: Any = None if layout is None else layout.net  # these three on rank 0 alone
    as_given: Any = None if layout is None else _net_to_relax(job, net)
    if comm.bcast(layout is not None and as_given is not net):
        ranks: Any = None if layout is None else layout.part[: as_given.n]
        cut = on_root(comm, lambda: split_net(as_given.n, as_given.elements, ranks, comm.size))
        n, m = comm.bcast(None if layout is None else (as_given.n, as_given.m))
        distribution = Distribution(comm, n, m, cut)
        halo = own_halo = Halo(comm, distribution.subdomain, 3)

    search = FormSearch(as_given, distribution, halo, job.form_finding, report, stop)

    def gather(form: Form) -> tuple[FloatArray | None, FloatArray | None]:
        x, N = distribution.gather_particles(form.x), distribution.gather_elements(form.N)
        if layout is None:
            return x, N
        if is_loaded:
            return straighten_bars(net, x, N)
        return space_inner_particles(net, x), np.repeat(N, net.parts)

    try:
        form = _find_loaded_form(comm, job, layout, gather, search) if is_loaded else search.find()
    finally:
        if own_halo:
            own_halo.free()
    if form.self_stress is not None and not is_loaded:
        form.self_stress = np.repeat(form.self_stress, net.parts, axis=1)
    return form, *gather(form)


def _net_to_relax(job: Job, net: Net) -> Net:
    """Return the net whose form is searched: as given, or with subdivided cables for its permanent load."""
    if not carries_permanent(job):
        return undo_subdivision(net)
    return undivide_bars(net) if job.form_finding.method == "fpm" else net


def _find_loaded_form(
    comm: MPI.Comm, job: Job, layout: Layout | None, gather: Any, search: FormSearch
) -> Form:
    """Find the form that carries its own permanent load, by iteration of form and load. Collective.

    gather(form) : positions and forces of the whole net, on rank 0
    """
    start, total = None, 0

    def load_in(x: np.ndarray | None, N: np.ndarray | None) -> np.ndarray | None:
        return on_root(comm, lambda: permanent_load_of_form(job, layout, x, N))

    load = load_in(layout.net.x, layout.net.prestress) if layout else load_in(None, None)
    for _ in range(MOST_STEPS):
        form = search.find(load, start)
        total += form.iterations
        new_load = load_in(*gather(form))
        change = comm.bcast(layout and float(np.abs(new_load - load).max()))
        if change <= SETTLED_CHANGE * job.form_finding.tolerance * form.reference:
            form.iterations = total
            return form
        load, start = new_load, form.x
    allowed = SETTLED_CHANGE * job.form_finding.tolerance * form.reference
    raise DivergedError(messages.FORM_LOAD_NOT_CONVERGED(change=change, turns=MOST_STEPS, allowed=allowed))
