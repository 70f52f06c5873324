"""The model of a job: its net in the initial state, on rank 0, in global order.

What is a constant of a particle or an element is computed here once, and sent to whoever holds it; so it has
the same bits on any number of ranks.
"""

import hashlib
from dataclasses import dataclass, field, fields

import numpy as np

from netfall.errors import InputError
from netfall.job.read import Job
from netfall.mechanics.fields import Scene
from netfall.mechanics.material import elastic_forces, unstressed_length
from netfall.mechanics.stability import scaled_mass
from netfall.net.areas import Roofing, normals, roof_of, tributary_areas
from netfall.net.build import build_net
from netfall.net.net import GRAVITY, Net
from netfall.parallel import partition
from netfall.solve.start import check_start, low_notes, unit_notes
from netfall.solve.unused import without_effect
from netfall.wind.field import GeneratedHistory, make_wind_field, read_measured

COLLAPSED = 1e-6  # of the length that is given: an element so short in the form is none any more
LARGEST_LOG = 500.0  # of a logarithmic strain: exp of much more is no number


@dataclass
class Model:
    """What rank 0 knows of the whole net.

    Attributes that bear the name of a field in `mechanics.fields` are what that field starts with.
    """

    net: Net
    roofing: Roofing
    part: np.ndarray
    partition_source: str
    area: np.ndarray = None  # m2 of surface
    plan_area: np.ndarray = None  # m2
    x: np.ndarray = None  # m, initial state
    N: np.ndarray = None  # N, there
    L0: np.ndarray = None  # m
    mass: np.ndarray = None  # kg
    added: np.ndarray = None  # kg, of it, by mass scaling: inertia without weight
    load: np.ndarray = None  # N, constant
    growing: np.ndarray = None  # N, that grows over [load] ramp
    wind: np.ndarray = None  # N s2/m2
    wind_field: object = None
    history: object = None  # of the wind
    notes_of_values: list[str] = field(default_factory=list)
    notes_of_history: list[str] = field(default_factory=list)

    @property
    def x_start(self) -> np.ndarray:
        """(n, 3) [m], from which displacements count."""
        return self.x

    @property
    def free(self) -> np.ndarray:
        """(n, 3), 1 where the axis can move."""
        return 1 - self.net.fixed.astype(np.uint8)

    @property
    def moves(self) -> np.ndarray:
        """(n,) bool, whether any axis can move."""
        return ~self.net.fixed.all(1)

    @property
    def valence(self) -> np.ndarray:
        """(n,) elements attached."""
        return np.bincount(self.net.elements.ravel(), minlength=self.net.n)

    @property
    def EA(self) -> np.ndarray:
        """(m,) [N], axial stiffness."""
        return self.net.modulus * self.net.section

    @property
    def bar(self) -> np.ndarray:
        """(m,) bool, whether compression is carried."""
        return self.net.bar

    @property
    def half_mass(self) -> np.ndarray:
        """(m,) [kg], half of each element's own mass."""
        return 0.5 * self.net.density * self.net.section * self.L0

    @property
    def yield_force(self) -> np.ndarray:
        """(m,) [N], axial force at yield; inf: elastic."""
        return self.net.yield_stress * self.net.section

    @property
    def eps_u(self) -> np.ndarray:
        """(m,), strain at fracture; inf: never breaks."""
        return self.net.fracture_strain

    def column(self, name: str) -> np.ndarray:
        """What a field of `mechanics.fields` starts with: an attribute here, or a column of the net."""
        return getattr(self, name) if hasattr(self, name) else getattr(self.net, name)

    def notes(self) -> list[str]:
        """What is plausible but odd in the net, its tables and its roof."""
        return self.net.notes + self.roofing.notes + self.notes_of_values + self.notes_of_history

    def id_of(self, e: int) -> int:
        """Id of an element."""
        return int(self.net.element_id[e])

    def node_name(self, p: int) -> str:
        """A particle by the id of its node, or by what it split off with, for messages."""
        if p < self.net.n:
            return f"node {self.net.node_id[p]}"
        return f"the end that broke off with element {self.id_of((p - self.net.n) // 2)}"

    def element_name(self, e: int) -> str:
        """Id, ids of the nodes and length of an element, for messages."""
        ids = "-".join(str(self.net.node_id[p]) for p in self.net.elements[e])
        return f"{self.net.element_id[e]} (nodes {ids}, {self.L0[e]:.4g} m)"


def make_model(job: Job, ranks: int) -> Model:
    """Net, areas and partition of a job; the initial state comes with `set_initial`. Raises InputError."""
    net = build_net(job)
    roofing = roof_of(job, net)
    part, source = None, "METIS, k-way"
    if not job.changes_net():
        part = partition.read_partition(job.name, net.n, net.elements, ranks)
        if part is not None:
            source = f"{partition.FOLDER / job.name}.graph.part.{ranks}"
    if part is None:
        part = partition.metis_partition(net.n, net.elements, ranks)
    model = Model(net, roofing, part, source)
    model.notes_of_values = without_effect(job, net) + unit_notes(net)
    if job.wind and job.wind.file:
        model.history = read_measured(job)
        model.notes_of_history = model.history.notes
    return model


def model_digest(job: Job, net: Net) -> str:
    """Fingerprint of a job, of the files that it reads and of every column of its net."""
    total = hashlib.sha256(job.digest().encode())
    for column in fields(Net):
        values = getattr(net, column.name)
        if column.name != "notes" and values is not None:
            total.update(column.name.encode())
            total.update(values.tobytes() if isinstance(values, np.ndarray) else repr(values).encode())
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
        varying=grows(job),
        logarithmic=job.cable.strain == "logarithmic",
        bars=bool(net.bar.any()),
        part_held=bool((net.fixed.any(1) & ~net.fixed.all(1)).any()),
        sections=differ(net.modulus * net.section) or differ(net.yield_stress * net.section),
        energy=job.output.energy,
    )


def grows(job: Job) -> bool:
    """Whether the pressure of [load] grows in the dynamic stage."""
    load = job.load
    return bool(job.dynamics and load and load.pressure is not None and load.ramp and not load.steps)


def set_initial(job: Job, model: Model, x: np.ndarray, N: np.ndarray | None) -> None:
    """Unstressed lengths, masses, loads and wind of the initial state x (n, 3) [m] with tensions N (m,) [N].

    N : None: the prestress of the tables. Raises InputError.
    """
    net, EA = model.net, model.EA
    L = np.sqrt(np.sum((x[net.elements[:, 1]] - x[net.elements[:, 0]]) ** 2, axis=1))
    logarithmic = job.cable.strain == "logarithmic"
    if N is None:
        N = net.prestress
    _check_tensions(job, net, N, L)
    L0 = unstressed_length(L, N, EA, logarithmic)
    given = np.isfinite(net.unstressed_length)
    if given.any():
        L0 = np.where(given, net.unstressed_length, L0)
        N = np.where(given, elastic_forces(L, L0, EA, net.bar, logarithmic), N)
    model.x, model.N, model.L0 = x, N, L0
    model.notes_of_values += check_start(job, model, L)
    half = model.half_mass
    own = np.bincount(net.elements[:, 0], half, net.n) + np.bincount(net.elements[:, 1], half, net.n)
    model.mass, model.load = own + net.mass, net.load.copy()
    model.area, model.plan_area = tributary_areas(x, net, model.roofing.faces)
    normal = normals(x, net, model.roofing.faces)
    _check_normals(job, model, normal)
    if job.load is not None:
        _add_loads(job, model, own, normal)
    if job.dynamics is not None and job.dynamics.mass_scaling:
        scaled = scaled_mass(net.elements, EA, L0, model.mass, model.moves, job.dynamics.mass_scaling)
        model.added, model.mass = scaled - model.mass, scaled
    if job.wind is not None:
        model.wind_field = make_wind_field(x, model.area, normal, job.wind)
        model.wind = model.wind_field.force
        model.notes_of_values += low_notes(job, net, x, model.wind)
        model.history = model.history or GeneratedHistory(model.wind_field, job.wind)


def _add_loads(job: Job, model: Model, own: np.ndarray, normal: np.ndarray) -> None:
    """The constant loads of [load], and the mass that comes with them. own : (n,) [kg] of the elements."""
    load = job.load
    if load.self_weight:
        model.load[:, 2] -= GRAVITY * own
    if load.dead:
        model.mass += load.dead * model.area / GRAVITY
        model.load[:, 2] -= load.dead * model.area
    if load.pressure is not None:
        # against the upward normal: what is positive presses on the roof
        number = isinstance(load.pressure, int | float)
        along = -load.pressure * normal if number else np.array(load.pressure)[None]
        if grows(job):
            model.growing = model.area[:, None] * along
        else:
            model.load += model.area[:, None] * along


def _check_normals(job: Job, model: Model, normal: np.ndarray) -> None:
    """Wind and pressure along normals must not vanish silently on particles that meet no face."""
    along = job.wind is not None or (job.load is not None and isinstance(job.load.pressure, int | float))
    bare = (model.area > 0) & ~normal.any(1) & model.moves
    if along and bare.any():
        raise InputError(
            f"{job.path}: {int(bare.sum())} free nodes with a roof area meet no closed face in plan, so wind "
            f"and pressure have no normal to act along (first: node {model.net.node_id[bare][0]}); close the "
            "faces with elements, give normal_x, normal_y, normal_z in nodes.csv, or pressure as [x, y, z]"
        )


def _check_tensions(job: Job, net: Net, N: np.ndarray, L: np.ndarray) -> None:
    yield_force, EA = net.yield_stress * net.section, net.modulus * net.section
    at_start = lambda e: f"its axial force is {N[e]:.4g} N in the initial state"
    checks = (
        (
            (N < 0) & ~net.bar,
            lambda e: f'{at_start(e)}: a cable carries no compression; give its group kind = "bar"',
        ),
        (
            np.abs(N) > yield_force,
            lambda e: (
                f"{at_start(e)}, above the yield force {yield_force[e]:.4g} N; "
                "lower the prestress or choose a larger area"
            ),
        ),
        (
            (1.0 + N / EA <= 0) | ((job.cable.strain == "logarithmic") & (np.abs(N) > LARGEST_LOG * EA)),
            lambda e: f"its axial force {N[e]:.4g} N is beyond its stiffness EA; choose a larger area",
        ),
    )
    errors = []
    for wrong, words in checks:
        if wrong.any():
            e = int(np.argmax(wrong))
            errors.append(f"{job.path}: element {net.element_id[e]}: {words(e)}")
    share = L / net.lengths()
    if not share.min() > COLLAPSED:
        e = int(np.argmin(share))
        ids = "-".join(str(net.node_id[p]) for p in net.elements[e])
        errors.append(
            f"{job.path}: [form_finding]: the form has collapsed: element {net.element_id[e]} (nodes {ids}) "
            f"is {L[e]:.3g} m long in it, {net.lengths()[e]:.4g} m as given; fix more nodes, or give "
            "prestresses or force densities that hold the free ones apart"
        )
    if errors:
        raise InputError(errors)
