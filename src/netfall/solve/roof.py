"""A job made ready to step: net, form, unstressed lengths, masses, loads, limits, split over the ranks.

What is a constant of a particle or an element is computed once, on rank 0, and sent to whoever holds it; so it
has the same bits on any number of ranks.
"""

import hashlib
import time
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mpi4py import MPI

from netfall.errors import InputError
from netfall.job.read import Job
from netfall.mechanics.compile import wake
from netfall.mechanics.material import unstressed_length
from netfall.mechanics.stability import Limit, after_fracture_limit, any_shape_limits, scaled_mass
from netfall.mechanics.state import Scene, State
from netfall.net.areas import Roofing, normals, roof_of, tributary_areas
from netfall.net.build import build_net
from netfall.net.net import GRAVITY, Net
from netfall.output.checkpoint import Checkpoint
from netfall.parallel import partition
from netfall.parallel.distribute import Distribution, cut_net
from netfall.parallel.halo import Halo
from netfall.parallel.root import on_root
from netfall.solve.form_finding import Form, find_form
from netfall.solve.relax import Paused, state_residual
from netfall.solve.restart import interrupted, pause_form_finding, restore_relaxation, restored_form
from netfall.solve.spectrum import assembled_limit
from netfall.solve.stop import NEVER, StopRequest
from netfall.wind.field import GeneratedHistory, make_wind_field, read_measured

LARGEST_SHARP = 50_000  # elements up to which each run finds the sharp limit of its step, in 10 ms at stadium size, half a second here; beyond, where a fixed step needs it
STEP_PHASES = ("dynamics: forces and kick", "dynamics: exchange", "dynamics: drift")


class Phases:
    """Wall time [s] of each phase of a run on this rank."""

    def __init__(self, steps: bool = False):
        """steps : whether the parts of a step are timed too, which takes some 0.2 microseconds a step"""
        self.seconds: dict[str, float] = {}
        self.of_steps = np.zeros(3) if steps else None  # of `stepping.time_loop`

    @contextmanager
    def phase(self, name: str):
        """Count the time of a block under a name."""
        begin = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - begin

    def over_ranks(self, comm: MPI.Comm) -> dict[str, np.ndarray]:
        """Least, mean and largest time [s] over the ranks of each phase. Collective."""
        mine = dict(self.seconds)
        if self.of_steps is not None:
            mine |= dict(zip(STEP_PHASES, self.of_steps.tolist()))
        every = comm.allgather(mine)
        return {
            name: np.array([f([other.get(name, 0.0) for other in every]) for f in (min, np.mean, max)])
            for name in mine
        }


@dataclass
class Whole:
    """What rank 0 knows of the whole roof, in global order; None on the other ranks."""

    net: Net
    roofing: Roofing
    part: np.ndarray
    partition_source: str
    area: np.ndarray = None  # m2 of surface
    plan_area: np.ndarray = None  # m2
    x: np.ndarray = None  # initial state
    N: np.ndarray = None
    L0: np.ndarray = None
    mass: np.ndarray = None
    added: np.ndarray = None  # kg, of it, by mass scaling: inertia without weight
    load: np.ndarray = None
    field: object = None
    history: object = None

    def notes(self) -> list[str]:
        """What is plausible but odd in the net, its tables and its roof."""
        return self.net.notes + self.roofing.notes + getattr(self.history, "notes", [])


@dataclass
class Roof:
    """The roof on one rank, ready for statics or dynamics."""

    whole: Whole | None
    distribution: Distribution
    state: State
    halo: Halo
    form: Form | None
    residual: float  # N, of the prestressed net with the real material
    reference: float  # N, largest tension of the initial state
    limits: dict[str, Limit] = field(default_factory=dict)
    digest: str = ""  # of job and net, for checkpoints
    stage: str | None = None  # in which the run that is taken up was interrupted; None: a new run
    checkpoint: Checkpoint | None = None  # of that run, on rank 0


def job_digest(job: Job, net: Net) -> str:
    """Fingerprint of a job and of the net that its tables gave."""
    total = hashlib.sha256(job.digest().encode())
    for values in (
        net.x,
        net.fixed,
        net.elements,
        net.load,
        net.mass,
        net.area,
        net.normal,
        net.section,
        net.modulus,
        net.density,
        net.prestress,
        net.force_density,
        net.unstressed_length,
    ):
        total.update(np.ascontiguousarray(values).tobytes())
    return total.hexdigest()


def scene_of(job: Job, net: Net) -> Scene:
    """What the scene has, as the job names it."""
    differ = lambda values: bool((values != values[:1]).any())
    return Scene(
        precision=job.dynamics.precision if job.dynamics else "double",
        fragments=not job.dynamics or job.dynamics.fragments,
        plastic=bool(np.isfinite(net.yield_stress).any()),
        fracture=bool(np.isfinite(net.fracture_strain).any()),
        wind=job.wind is not None,
        logarithmic=job.cable.strain == "logarithmic",
        bars=bool(net.bar.any()),
        part_held=bool((net.fixed.any(1) & ~net.fixed.all(1)).any()),
        sections=differ(net.modulus * net.section) or differ(net.yield_stress * net.section),
        energy=job.output.energy,
    )


def make_whole(job: Job, ranks: int) -> Whole:
    """Net, areas and partition of a job, on rank 0. Raises InputError."""
    net = build_net(job)
    roofing = roof_of(job, net)
    part, source = None, "METIS, k-way"
    if not job.changes_net():
        part = partition.read_partition(job.name, net.n, net.elements, ranks)
        if part is not None:
            source = f"{partition.FOLDER / job.name}.graph.part.{ranks}"
    if part is None:
        part = partition.metis_partition(net.n, net.elements, ranks)
    whole = Whole(net, roofing, part, source)
    if job.wind and job.wind.file:
        whole.history = read_measured(job)
    return whole


def prepare(
    comm: MPI.Comm,
    job: Job,
    phases: Phases,
    report: Callable = lambda iteration, residual: None,
    result: Path | None = None,
    restart: Path | None = None,
    stop: StopRequest = NEVER,
) -> Roof:
    """The roof in its initial state: form found, prestressed, loaded. Collective.

    result : path of the result file, beside which a form finding that is stopped leaves a checkpoint; restart : the checkpoint to go on from

    Raises InputError for what is wrong in the job, DivergedError if form finding does not converge, Interrupted if `stop` asks for it.
    """
    with phases.phase("net and partition"):
        if comm.rank > 0:
            wake()  # while rank 0 reads the net
        whole = on_root(comm, lambda: make_whole(job, comm.size))
        n, m, scene = comm.bcast((whole.net.n, whole.net.m, scene_of(job, whole.net)) if whole else None)
        distribution = Distribution(
            comm, n, m, on_root(comm, lambda: cut_net(n, whole.net.elements, whole.part, comm.size))
        )
        halo = Halo(comm, distribution.piece, 3)
    net = whole.net if whole else None
    form = None
    digest = comm.bcast(job_digest(job, net) if whole else None)
    checkpoint = on_root(comm, lambda: Checkpoint(restart, digest)) if restart else None
    stage = comm.bcast(checkpoint and checkpoint.record["stage"])
    with phases.phase("form finding"):
        if stage in ("statics", "dynamics"):
            form = comm.bcast(checkpoint and restored_form(checkpoint.record))
            on_root(
                comm,
                lambda: _set_initial(
                    job, whole, checkpoint.arrays["x"], checkpoint.arrays["N"] if job.form_finding else None
                ),
            )
        elif job.form_finding is not None:
            try:
                form = find_form(
                    comm,
                    net,
                    distribution,
                    job.form_finding,
                    halo,
                    report,
                    stop,
                    restore_relaxation(distribution, checkpoint),
                )
            except Paused as pause:
                raise interrupted(
                    f"in form finding, iteration {pause.at.iteration}",
                    pause_form_finding(job, result, digest, distribution, pause),
                ) from None
            x, N = distribution.gather_particles(form.x), distribution.gather_elements(form.N)
            on_root(comm, lambda: _set_initial(job, whole, x, N))
        else:
            on_root(comm, lambda: _set_initial(job, whole, net.x, None))
    with phases.phase("state"):
        state = make_state(distribution, whole, scene)
        residual = state_residual(comm, state, 0.0)
        reference = comm.bcast(float(np.abs(whole.N).max(initial=0.0)) if whole else None)
        if form is not None and not residual <= 1.001 * job.form_finding.tolerance * form.reference:
            raise InputError(
                f"{job.path}: [form_finding] tolerance = {job.form_finding.tolerance:g}: the prestressed net with the real material has a "
                f"residual of {residual / form.reference:.3g} of the prestress; expected a tolerance that rounding allows"
            )
        limits = comm.bcast(
            step_limits(whole, scene, job.dynamics.fragment_mass if job.dynamics else 0.0) if whole else None
        )
        asked = job.dynamics.time_step if job.dynamics else "auto"
        if job.dynamics and (m <= LARGEST_SHARP or asked != "auto" and asked > limits["any_shape"].dt):
            limits["assembled"] = assembled_limit(comm, state, distribution.piece.element_gid, halo)
    return Roof(
        whole, distribution, state, halo, form, residual, reference, limits, digest, stage, checkpoint
    )


def _set_initial(job: Job, whole: Whole, x: np.ndarray, N: np.ndarray | None) -> None:
    """Unstressed lengths, masses, loads and wind of the initial state x (n, 3) [m] with tensions N (m,) [N]."""
    net = whole.net
    EA = net.modulus * net.section
    L = np.sqrt(np.sum((x[net.elements[:, 1]] - x[net.elements[:, 0]]) ** 2, axis=1))
    logarithmic = job.cable.strain == "logarithmic"
    if N is None:
        N = net.prestress
    _check_tensions(job, net, N, L)
    L0 = unstressed_length(L, N, EA, logarithmic)
    given = np.isfinite(net.unstressed_length)
    if given.any():
        L0 = np.where(given, net.unstressed_length, L0)
        eps = np.log(L / L0) if logarithmic else (L - L0) / L0
        N = np.where(given, np.where(net.bar, EA * eps, np.maximum(EA * eps, 0.0)), N)
    whole.x, whole.N, whole.L0 = x, N, L0
    half = 0.5 * net.density * net.section * L0
    own = np.bincount(net.elements[:, 0], half, net.n) + np.bincount(net.elements[:, 1], half, net.n)
    whole.mass = own + net.mass
    whole.load = net.load.copy()
    whole.area, whole.plan_area = tributary_areas(x, net, whole.roofing.faces)
    normal = normals(x, net, whole.roofing.faces)
    _check_normals(job, whole, normal)
    if job.load is not None:
        if job.load.self_weight:
            whole.load[:, 2] -= GRAVITY * own
        if job.load.dead:
            whole.mass += job.load.dead * whole.area / GRAVITY
            whole.load[:, 2] -= job.load.dead * whole.area
        pressure = job.load.pressure
        if pressure is not None:
            # against the upward normal: what is positive presses on the roof
            along = -pressure * normal if isinstance(pressure, (int, float)) else np.array(pressure)[None]
            whole.load += whole.area[:, None] * along
    if job.dynamics is not None and job.dynamics.mass_scaling:
        scaled = scaled_mass(net.elements, EA, L0, whole.mass, ~net.fixed.all(1), job.dynamics.mass_scaling)
        whole.added, whole.mass = scaled - whole.mass, scaled
    if job.wind is not None:
        whole.field = make_wind_field(x, whole.area, normal, job.wind)
        whole.history = whole.history or GeneratedHistory(whole.field, job.wind)


def _check_normals(job: Job, whole: Whole, normal: np.ndarray) -> None:
    """Wind and pressure along normals must not vanish silently on particles that meet no face."""
    along = job.wind is not None or job.load is not None and isinstance(job.load.pressure, (int, float))
    bare = (whole.area > 0) & ~normal.any(1) & ~whole.net.fixed.all(1)
    if along and bare.any():
        raise InputError(
            f"{job.path}: {int(bare.sum())} free nodes with a roof area meet no closed face in plan, so wind and pressure have no normal "
            f"to act along (first: node {whole.net.node_id[bare][0]}); close the faces with elements, give normal_x, normal_y, normal_z in nodes.csv, or pressure as [x, y, z]"
        )


def _check_tensions(job: Job, net: Net, N: np.ndarray, L: np.ndarray) -> None:
    errors = []
    wrong = np.flatnonzero((N < 0) & ~net.bar)
    if len(wrong):
        e = wrong[0]
        errors.append(
            f"{job.path}: element {net.element_id[e]}: its axial force is {N[e]:.4g} N in the initial state: a cable carries no compression; "
            'give its group kind = "bar"'
        )
    over = np.flatnonzero(np.abs(N) > net.yield_stress * net.section)
    if len(over):
        e = over[0]
        errors.append(
            f"{job.path}: element {net.element_id[e]}: its axial force is {N[e]:.4g} N in the initial state, above the yield force "
            f"{net.yield_stress[e] * net.section[e]:.4g} N; lower the prestress or choose a larger area"
        )
    over = np.flatnonzero(1.0 + N / (net.modulus * net.section) <= 0)
    if len(over):
        e = over[0]
        errors.append(
            f"{job.path}: element {net.element_id[e]}: its axial force {N[e]:.4g} N is beyond its stiffness EA; choose a larger area"
        )
    short = np.flatnonzero(~(L > 0))
    if len(short):
        errors.append(
            f"{job.path}: element {net.element_id[short[0]]} has no length in the form that was found; choose other prestresses"
        )
    if errors:
        raise InputError(errors)


def make_state(distribution: Distribution, whole: Whole | None, scene: Scene) -> State:
    """The state of one rank from the global arrays of rank 0. Collective."""
    piece = distribution.piece
    state = State(
        scene,
        piece.n_owned,
        piece.n_halo,
        len(piece.element_gid),
        int(np.bincount(piece.ends.ravel()).max(initial=0)),
    )
    net = whole.net if whole else None
    particles = lambda get: distribution.particles(None if whole is None else get())
    elements = lambda get: distribution.elements(None if whole is None else get())
    state.gid[:] = piece.particle_gid
    state.ends[:] = piece.ends
    state.owned[:] = piece.element_owned
    state.x[:] = state.x_start[:] = particles(lambda: whole.x)
    state.free[:] = particles(lambda: 1 - net.fixed.astype(np.uint8))
    state.mass[:], state.load[:] = particles(lambda: whole.mass), particles(lambda: whole.load)
    state.L0[:], state.EA[:] = elements(lambda: whole.L0), elements(lambda: net.modulus * net.section)
    state.bar[:] = elements(lambda: net.bar.astype(np.uint8))
    state.half_mass[:] = elements(lambda: 0.5 * net.density * net.section * whole.L0)
    if scene.plastic:
        state.yield_force[:] = elements(lambda: net.yield_stress * net.section)
    if scene.fracture:
        state.eps_u[:] = elements(lambda: net.fracture_strain)
        state.valence[:] = particles(lambda: np.bincount(net.elements.ravel(), minlength=net.n))
    if scene.wind:
        state.wind[:] = particles(lambda: whole.field.force)
    return state


def step_limits(whole: Whole, scene: Scene, fragment_mass: float) -> dict[str, Limit]:
    """Limits of the explicit step that hold whatever the roof does, by name. Rank 0."""
    net = whole.net
    half = 0.5 * net.density * net.section * whole.L0
    limits = any_shape_limits(
        net.elements, net.modulus * net.section, whole.L0, whole.mass, ~net.fixed.all(1), net.bar
    )
    if scene.fracture and scene.fragments:
        limits.append(
            after_fracture_limit(
                net.elements,
                net.modulus * net.section,
                whole.L0,
                half,
                whole.mass,
                net.fixed.all(1),
                net.fracture_strain,
                fragment_mass,
            )
        )
    return {limit.name: limit for limit in limits}


def governing(limits: dict[str, Limit], automatic: bool) -> Limit:
    """The limit that the step must keep whatever the roof does, and one that is chosen here also for the sake of slack cables."""
    return min(
        (
            limit
            for limit in limits.values()
            if limit.name != "assembled" and (automatic or limit.name != "slackening")
        ),
        key=lambda limit: limit.dt,
    )
