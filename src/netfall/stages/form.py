"""Form finding: the shape in which the net is in equilibrium under its prestress (paper 2.5, steps 1 and 2).

By the particles (FPM), with the tension N = T0 + s EA (L - L_start) / L_start, s a small share of the modulus
or 0 for constant tension; or by force density, one sparse linear solve (Schek 1974). The unstressed lengths
of the real material follow in closed form.
"""

from functools import cache

import numpy as np
from mpi4py import MPI

from netfall.equilibrium.newton import SHORT, Newton, NoConvergence, Stopped, is_large
from netfall.equilibrium.relaxation import Net as RelaxedNet
from netfall.equilibrium.relaxation import (
    Paused,
    Relaxation,
    largest_force,
    not_begun,
    relax,
)
from netfall.equilibrium.stable import unstable_shape
from netfall.ground.columns import placed
from netfall.ground.compile import kernel
from netfall.ground.errors import DivergedError, InputError
from netfall.ground.stop import NEVER, StopRequest
from netfall.job.values import counted
from netfall.mechanics.elements import add_tensions, geometric_stiffness, nodal_stiffness
from netfall.mechanics.supports import keep_on_guides, largest_residual
from netfall.multigrid.cycle import Structure
from netfall.multigrid.lines import lines_of
from netfall.multigrid.tangent import Tangent
from netfall.net.net import Net
from netfall.net.turned import held_along, is_guided, turned_column
from netfall.numerics.functions import lengths
from netfall.numerics.sparse import Singular, solve_sparse
from netfall.parallel.agree import on_root
from netfall.parallel.halo import Halo
from netfall.parallel.subdomain import Distribution
from netfall.prestress.self_stress import self_stress
from netfall.stages.scene import Form

TOGETHER = 1e-6  # of the length at the start: an element so short is as good as gone
LOOKS = 10  # in turn, at which one is: a node may pass close to another on its way


NEAR = 1e-2  # of the residual forces, what the start leaves
SOFTER = (0.1, 0.01, 1e-3, 1e-4)  # of force densities: stiffness along elements of constant tension, then ...
LEAST = 1e-6  # ... the same at last: nodes of a straight cable may stand anywhere along it
MANY = 100_000  # particles, at constant tension: below that relaxation takes no longer
TIGHTER = 0.1  # times: the tolerance where the residual asks for more
MOST_AGAIN = 4


@kernel
def form_tensions(x, ends, T0, stiffness, L_start, bar, N, L):
    """Tensions N (m,) [N] and lengths L (m,) [m] of the form-finding elements; a cable never pushes."""
    for e in range(ends.shape[0]):
        a, b = ends[e, 0], ends[e, 1]
        dx, dy, dz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
        L[e] = np.sqrt(dx * dx + dy * dy + dz * dz)
        N[e] = T0[e] + stiffness[e] * (L[e] - L_start[e])
        if N[e] < 0.0 and not bar[e]:
            N[e] = 0.0


def force_density_form(net: Net, load: np.ndarray | None = None) -> np.ndarray:
    """Equilibrium positions (n, 3) [m] for given force densities, or prestress / length where none are given.

    sum_e q_e (x_other - x_p) + load_p = 0 on each free axis: a sparse system, in factors. Only on rank 0.
    load : (n, 3) [N], None: none

    Raises InputError where the system is singular: the densities then define no shape.
    """
    q = np.where(np.isfinite(net.force_density), net.force_density, net.prestress / net.lengths())
    total, size = np.zeros((2, net.n))
    pull = np.zeros((net.n, 3))  # of the held ends
    for end in range(2):
        np.add.at(total, net.elements[:, end], q)
        np.add.at(size, net.elements[:, end], np.abs(q))
    x = net.x.copy()
    for axes in _held_alike(net):
        held = net.held[:, axes[0]]
        free, place = np.flatnonzero(~held), np.cumsum(~held) - 1
        for end in range(2):
            there = net.elements[:, 1 - end]
            np.add.at(pull, net.elements[:, end], np.where(held[there], q, 0.0)[:, None] * net.x[there])
        within = ~held[net.elements].any(1)
        try:
            if load is not None:
                pull += load
            sides = total[free], pull[free][:, axes], size[free]
            found = solve_sparse(place[net.elements[within]], -q[within], *sides)
        except Singular as error:
            raise _not_held(net, free[error.rows], axes) from None
        x[np.ix_(free, axes)] = found
        pull[:] = 0.0
    if not np.isfinite(x).all():
        p = int(np.flatnonzero(~np.isfinite(x).all(1))[0])
        raise InputError(
            f"form finding by force density has no solution around node {net.node_id[p]}: "
            "give force densities (or prestress) that hold every free node"
        )
    return x


def _not_held(net: Net, rows: np.ndarray, axes: list[int]) -> InputError:
    """That the nodes in these rows have no place along these axes: a singular matrix of force densities."""
    ids = net.node_id[rows]
    one, along = len(ids) == 1, " and ".join("xyz"[axis] for axis in axes)
    return InputError(
        "form finding by force density has no solution: the force densities do not hold "
        f"{counted('node', ids)} along {along}, which could stand anywhere; hold "
        f"{'it' if one else 'one of them'}, join {'it' if one else 'them'} to supports, or give force "
        "densities (or prestress) that do not cancel"
    )


def _held_alike(net: Net) -> list[list[int]]:
    """The axes on which something is free, those together on which the same nodes are."""
    groups: dict[bytes, list[int]] = {}
    for axis in range(3):
        if not net.held[:, axis].all():
            groups.setdefault(net.held[:, axis].tobytes(), []).append(axis)
    return list(groups.values())


WORST = 5  # nodes that a failed form names
ADVICE = (
    "for struts and rings set [form_finding] modulus_factor = 1, or begin with a state of self-stress, "
    'method = "keep"; give prestresses or force densities that balance at these nodes'
)


class Elements:
    """The form-finding elements of one rank: tensions by `form_tensions` and the forces that follow."""

    def __init__(
        self, distribution: Distribution, net: Net | None, x, modulus_factor: float, load=None, turned=None
    ):
        """load : (n, 3) [N] that the form carries, None: none; turned : as in `relaxation.Net`"""
        self.load, self.turned = 0.0 if load is None else np.asfortranarray(load), turned
        self.constant = modulus_factor == 0.0  # their tensions
        column = lambda name: distribution.elements(None if net is None else getattr(net, name))
        self.ends = distribution.subdomain.ends
        self.bar = column("bar").astype(np.uint8)
        self.T0, self.q, EA = column("prestress"), column("force_density"), column("EA")
        self.N, self.L = np.empty_like(EA), np.empty_like(EA)
        self.stiffness = np.zeros_like(EA)
        self.L_start = np.zeros_like(EA)
        self.forces(x, np.zeros_like(x))
        self.L_start = self.L.copy()
        with np.errstate(divide="ignore", invalid="ignore"):  # a form that has collapsed is refused later
            self.stiffness = modulus_factor * EA / self.L_start

    def densities(self):
        """Force densities (m,) [N/m]: as given, elsewhere of the prestress where the elements begin."""
        return np.where(np.isfinite(self.q), self.q, self.T0 / self.L_start)

    def measure(self, x):
        """Tensions `N` and lengths `L` at x."""
        form_tensions(x, self.ends, self.T0, self.stiffness, self.L_start, self.bar, self.N, self.L)

    def forces(self, x, f):
        """Write the forces f (n, 3) [N] of the elements at x, none along lines on which supports hold."""
        self.measure(x)
        f[:] = self.load
        add_tensions(x, self.ends, self.N, self.L, f)
        if self.turned is not None:
            keep_on_guides(self.turned, f)

    def bound(self, x):
        """Upper bound (m,) [N/m] of the stiffness, axial and transverse."""
        return self.stiffness + geometric_stiffness(self.N, self.L)


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


def find_form(
    comm: MPI.Comm,
    net: Net | None,
    distribution: Distribution,
    settings,
    halo: Halo,
    report,
    stop: StopRequest = NEVER,
    resume: Relaxation | None = None,
    load: np.ndarray | None = None,
    start: np.ndarray | None = None,
) -> Form:
    """The form of the net by the job's method.

    Collective. net : on rank 0, None elsewhere; stop, resume : as in `relax`
    load : (n, 3) [N], all particles, on rank 0, that the form carries, None: none; start : positions (n, 3)
        [m] of this rank from which to relax, None: those that are given
    """
    if net is not None and load is not None:
        load = load[: net.n]
    carried = distribution.particles(load) if comm.bcast(load is not None) else None
    # columns stand apart, as in a state: what is compiled for the form then serves for equilibria too
    particles = lambda rows: placed(distribution.particles(rows))
    x = particles(None if net is None else net.x)
    free = 1 - particles(None if net is None else held_along(net, net.held)).astype(np.uint8)
    guided = comm.bcast(net is not None and bool(is_guided(net, net.held).any()))
    turned = particles(net and turned_column(net, net.held)) if guided else None
    if settings.method == "keep":
        return kept_form(comm, net, distribution, settings, x, free, load)
    given = Elements(distribution, net, x, settings.modulus_factor, carried, turned)
    mine = None if carried is None else carried[: halo.n_owned]
    largest = lambda N: largest_force(comm, N, given.ends, free, mine)
    if settings.method == "force_density" or settings.start == "force_density":
        x = particles(on_root(comm, lambda: force_density_form(net, load)))
        elements = Elements(distribution, net, x, settings.modulus_factor, carried, turned)
    else:
        elements = given
    if settings.method == "force_density":
        return _of_densities(
            comm, given.densities(), elements, x, free, halo.n_owned, settings.tolerance, largest
        )
    if start is not None:
        x[:] = start
    moving = RelaxedNet(x, free, elements.ends, elements.forces, elements.bound, turned=turned)
    reference = largest(elements.T0)
    asked = settings.tolerance * reference
    found = _of_tensions(
        comm, net, distribution, halo, moving, elements, settings, asked, report, stop, resume
    )
    return Form(x, elements.N, *found, reference)


def _of_densities(comm: MPI.Comm, q, elements: Elements, x, free, n_owned, tolerance, largest) -> Form:
    """The form at x (n, 3) [m] by force densities q (m,) [N/m], which have to hold it. Collective.

    largest(N) : the largest of forces, as of `find_form`
    """
    N = q * elements.L_start
    f = np.zeros_like(x) + elements.load
    add_tensions(x, elements.ends, N, elements.L_start, f)
    residual, reference = comm.allreduce(largest_residual(f, free, n_owned), MPI.MAX), largest(N)
    if not residual <= tolerance * reference:
        raise DivergedError(
            f"form finding by force density: largest residual {residual:.3g} N, "
            f"asked {tolerance * reference:.3g} N; the densities are nearly singular"
        )
    return Form(x, N, 1, residual, reference)


def _of_tensions(
    comm, net, distribution, halo, moving: RelaxedNet, elements, settings, asked, report, stop, resume
) -> tuple:
    """Move moving.x to the form by tensions; iterations and the largest residual [N]. Collective.

    By Newton's method where the net is large, or where nodes ran together in a relaxation, else by that;
    asked : [N], of the residual; the others as of `find_form`
    """
    by_newton = lambda: newton_form(comm, distribution, halo, moving, elements, settings, asked, stop)
    begun = moving.x.copy(order="K")
    large = distribution.n >= MANY if elements.constant else is_large(distribution)
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
            raise DivergedError(f"{error}; {worst}; {ADVICE}") from None
        return found


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


def kept_form(comm: MPI.Comm, net: Net | None, distribution: Distribution, settings, x, free, load) -> Form:
    """The geometry as given, x (n, 3) [m], and its self-stress; load : as in `find_form`. Collective."""
    found = on_root(comm, lambda: self_stress(net, load, settings.tolerance))
    N = distribution.elements(found and found.N)
    residual = comm.bcast(found and float(lengths(found.residual).max()))
    reference = largest_force(comm, N, distribution.subdomain.ends, free)
    return Form(x, N, 1, residual, reference, found and found.states)


def newton_form(comm, distribution, halo, net, elements, settings, asked: float, stop) -> tuple | None:
    """Move net.x to the form; iterations of conjugate gradients and the largest residual [N]. Collective.

    net : `relaxation.Net`; elements : `form.Elements`; asked : [N], of the residual
    stop : a wish to pause

    None where Newton's method is not tried or does not find it; net.x is then as before. Raises Paused.
    """
    if net.turned is not None:
        return None
    if comm.allreduce(bool((elements.T0 < 0.0).any()), MPI.LOR):  # compressed struts
        return None
    before = placed(net.x)
    inverse = lambda newton, tangent: newton.cycle(tangent)
    kept = Structure(cache(lambda: lines_of(distribution, elements.ends, before, net.free)))
    newton = Newton(comm, halo, distribution, net, lambda: tangent_of_form(elements, net.x), inverse, kept)
    try:
        total = _towards_force_density(newton, elements)
        if elements.constant:
            total += _nearer(newton, elements)
        for k in range(MOST_AGAIN):
            found = newton.find(settings.tolerance * TIGHTER**k, before, stop)
            total += found.gradients
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


def tangent_of_form(elements, x: np.ndarray, share: float = LEAST) -> Tangent:
    """The tangent stiffness of form-finding elements at x (n, 3).

    share : of the force density that counts along elements of constant tension, which have no stiffness there
    """
    elements.measure(x)
    taut = (elements.N > 0.0) | (elements.bar != 0)
    across = elements.N / np.maximum(elements.L, 1e-300)
    along = share * across if elements.constant else elements.stiffness
    return _tangent(elements, x, elements.N.copy(), np.where(taut, along, 0.0), across)


def _tangent(elements, x, N, axial, across) -> Tangent:
    length = np.maximum(elements.L, 1e-300)[:, None]
    direction = np.ascontiguousarray((x[elements.ends[:, 1]] - x[elements.ends[:, 0]]) / length)
    nodal = np.zeros(len(x))
    nodal_stiffness(elements.ends, elements.stiffness + np.abs(across), nodal)
    return Tangent(N, direction, axial, across, None, nodal)


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
    K = _tangent(elements, x, N, q, q)
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
