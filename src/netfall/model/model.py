"""The model of a job: its net in the initial state, on rank 0, in global order.

What is a constant of a particle or an element is computed here once, and sent to whoever holds it; so it has
the same bits on any number of ranks.
"""

import hashlib
from dataclasses import dataclass, field, fields

import numpy as np

from netfall.ground.errors import InputError
from netfall.job.asks import along_normals, grows, loads_the_roof
from netfall.job.job import Job
from netfall.job.memory import FORGETFUL, OF_SPEED, Memory, key_of
from netfall.mechanics.fields import Features
from netfall.mechanics.material import elastic_forces, unstressed_length, warm_length
from netfall.mechanics.stability import scaled_mass
from netfall.model.idle import bare_zones, without_effect
from netfall.model.loads import (
    Roof,
    by_node,
    carried_mass,
    loading_of,
    preload,
    pressure_load,
    shape_coefficients,
)
from netfall.model.losses import named_elements
from netfall.model.probes import Probes, find_probes
from netfall.model.start import check_start, check_tensions, far_notes, low_notes, unit_notes
from netfall.net.build import build_net
from netfall.net.net import Net
from netfall.parallel import partition
from netfall.roof.areas import Roofing, roof_of, tributary_areas
from netfall.roof.panels import Panels, panels_of
from netfall.roof.zones import Zones, zones_of
from netfall.wind.field import GeneratedHistory, force_factor, make_wind_field, read_history


@dataclass
class Model:
    """What rank 0 knows of the whole net.

    Attributes that bear the name of a field in `mechanics.fields` are what that field starts with.
    """

    net: Net
    roofing: Roofing
    zones: Zones
    part: np.ndarray
    partition_source: str
    roof: Roof = None  # areas, zones
    x: np.ndarray = None  # m, initial state
    N: np.ndarray = None  # N, there
    L0: np.ndarray = None  # m, at the temperature of the loads
    cut_length: np.ndarray = None  # m, unstressed, at the temperature of form finding
    half_mass: np.ndarray = None  # kg, half of each element's own mass
    spring_rest: np.ndarray = None  # m, displacement at which elastic supports carry nothing
    mass: np.ndarray = None  # kg
    added: np.ndarray = None  # kg, of it, by mass scaling: inertia without weight
    permanent: np.ndarray = None  # N, of what is constant: self weight, dead load
    live: np.ndarray = None  # N, the rest of it, which statics bring on in steps
    growing: np.ndarray = None  # N, that grows over [load] ramp
    carried: np.ndarray = None  # kg, of dead load and snow
    panels: Panels = None  # of the cladding, where they can tear off
    wind: np.ndarray = None  # N s2/m2
    mean_wind: np.ndarray = None  # N, force of the mean wind
    shape_coefficient: np.ndarray = None  # of the wind
    wind_field: object = None
    history: object = None  # of the wind
    lost: list[np.ndarray] = field(default_factory=list)  # elements that each [[remove]] names
    probes: Probes = None
    notes_of_values: list[str] = field(default_factory=list)
    notes_of_history: list[str] = field(default_factory=list)
    area_given: float = 0.0  # m2, of the roof in the geometry that is given

    @property
    def area(self) -> np.ndarray:
        """(n,) [m2] of surface."""
        return self.roof.area

    @property
    def plan_area(self) -> np.ndarray:
        """(n,) [m2] in plan."""
        return self.roof.plan_area

    @property
    def vector_area(self) -> np.ndarray:
        """(n, 3) [m2], upward."""
        return self.roof.vector

    @property
    def x_start(self) -> np.ndarray:
        """(n, 3) [m], from which displacements count."""
        return self.x

    @property
    def load(self) -> np.ndarray:
        """(n, 3) [N], constant in the dynamic stage."""
        return self.permanent + self.live

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
    def support(self) -> np.ndarray:
        """(n,) [N/m] of elastic supports, the stiffest axis."""
        return self.net.spring.max(1)

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
        return (
            self.net.notes
            + self.roofing.notes
            + self.zones.notes
            + self.notes_of_values
            + self.notes_of_history
        )

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


def make_model(job: Job, ranks: int, memory: Memory = FORGETFUL) -> Model:
    """Net, areas and partition of a job; the initial state comes with `set_initial`. Raises InputError."""
    key = ranks, key_of(job, without=OF_SPEED)
    net, roofing, zones, part, source = memory.once("net", key, lambda: _partitioned(job, ranks))
    model = Model(net, roofing, zones, part, source)
    model.lost, model.probes = named_elements(job, net), find_probes(job, net)
    model.shape_coefficient, notes = shape_coefficients(job, zones)
    model.notes_of_values = without_effect(job, net) + notes + unit_notes(net)
    model.history = read_history(job)
    if model.history:
        model.notes_of_history = model.history.notes + far_notes(job, net, model.history.places)
    return model


def _partitioned(job: Job, ranks: int) -> tuple:
    """Net, roofing, zones, partition and where this comes from."""
    net = build_net(job)
    roofing = roof_of(job, net)
    zones = zones_of(job, net, roofing.faces)
    if not job.changes_net():
        part = partition.read_partition(job.name, net.n, net.elements, ranks)
        if part is not None:
            return net, roofing, zones, part, f"{partition.FOLDER / job.name}.graph.part.{ranks}"
    return net, roofing, zones, partition.metis_partition(net.n, net.elements, ranks), "METIS, k-way"


def model_digest(job: Job, net: Net) -> str:
    """Fingerprint of a job, of the files that it reads and of every column of its net."""
    total = hashlib.sha256(job.digest().encode())
    for column in fields(Net):
        values = getattr(net, column.name)
        if column.name != "notes" and values is not None:
            total.update(column.name.encode())
            total.update(values.tobytes() if isinstance(values, np.ndarray) else repr(values).encode())
    return total.hexdigest()


def features_of(job: Job, net: Net) -> Features:
    """What the scene has, as the job names it."""
    differ = lambda values: bool((values != values[:1]).any())
    return Features(
        fragments=not job.dynamics or job.dynamics.fragments,
        plastic=bool(np.isfinite(net.yield_stress).any()),
        fracture=bool(np.isfinite(net.fracture_strain).any()),
        wind=job.wind is not None,
        tapped=job.wind is not None and job.wind.pressures is not None,
        varying=grows(job) or any(entry.duration for entry in job.removes),
        springs=bool(net.spring.any()),
        losses=bool(job.removes),
        logarithmic=job.cable.strain == "logarithmic",
        bars=bool(net.bar.any()),
        part_held=bool((net.fixed.any(1) & ~net.fixed.all(1)).any()),
        sections=differ(net.modulus * net.section) or differ(net.yield_stress * net.section),
        energy=job.output.energy,
    )


def set_initial(
    job: Job, model: Model, x: np.ndarray, N: np.ndarray | None, memory: Memory = FORGETFUL
) -> None:
    """Unstressed lengths, masses, loads and wind of the initial state x (n, 3) [m] with tensions N (m,) [N].

    N : None: the prestress of the tables. Raises InputError.
    """
    net, EA = model.net, model.EA
    L = np.sqrt(np.sum((x[net.elements[:, 1]] - x[net.elements[:, 0]]) ** 2, axis=1))
    logarithmic = job.cable.strain == "logarithmic"
    if N is None:
        N = net.prestress
    check_tensions(job, net, N, L)
    L0 = unstressed_length(L, N, EA, logarithmic)
    given = np.isfinite(net.unstressed_length)
    if given.any():
        L0 = np.where(given, net.unstressed_length, L0)
        N = np.where(given, elastic_forces(L, L0, EA, net.bar, logarithmic), N)
    model.x, model.N, model.L0 = x, N, L0
    model.notes_of_values += check_start(job, model, L)
    model.cut_length = L0
    half = model.half_mass = 0.5 * net.density * net.section * L0
    model.spring_rest = preload(net, x, N, L) if job.form_finding else net.spring_rest
    own = np.bincount(net.elements[:, 0], half, net.n) + np.bincount(net.elements[:, 1], half, net.n)
    if job.form_finding:
        model.area_given = float(tributary_areas(net.x, net, model.roofing.faces).surface.sum())
    model.roof = Roof(*tributary_areas(x, net, model.roofing.faces), model.zones)
    model.notes_of_values += bare_zones(model.zones, model.area) if loads_the_roof(job) else []
    _check_normals(job, model)
    loading = loading_of(job, model.roof, own, net.load)
    model.permanent, model.live, model.growing = loading.permanent, loading.live, loading.growing
    model.mass, model.carried = own + net.mass + loading.carried, loading.carried
    if job.dynamics is not None and job.dynamics.mass_scaling:
        scaled = scaled_mass(
            net.elements, EA, L0, model.mass, model.moves, model.support, job.dynamics.mass_scaling
        )
        model.added, model.mass = scaled - model.mass, scaled
    if job.wind is not None:
        settings = by_node(job, model.shape_coefficient)
        places = model.history.places if model.history else None
        key = key_of(job), x.tobytes()
        find = lambda: make_wind_field(x, model.roof.vector, settings, places)
        model.wind_field = memory.once("wind", key, find)
        model.wind = model.wind_field.force
        model.notes_of_values += low_notes(job, net, x, model.wind)
        model.history = model.history or GeneratedHistory(model.wind_field, job.wind)
        if job.wind.after_fracture == "panels":
            _make_panels(job, model, settings)
        model.mean_wind = model.wind_field.mean_force(model.history.mean_gust)


def _make_panels(job: Job, model: Model, settings) -> None:
    """The panels that can tear off. Raises InputError where there are none, or loads grow on them."""
    if not len(model.roofing.faces) or np.isfinite(model.net.area).any():
        raise InputError(
            f'{job.path}: [wind] after_fracture = "panels": panels are the closed faces of the net, and '
            "their areas those of the nodes; expected a net with faces and without a column area"
        )
    if model.growing is not None:
        raise InputError(
            f'{job.path}: [wind] after_fracture = "panels": not together with [load] ramp; remove one of them'
        )
    panels = panels_of(model.x, model.net, model.roofing.faces)
    load, roof = job.load, Roof(*panels.areas, model.zones.at(panels.node))
    factor = np.broadcast_to(force_factor(settings), model.net.n)[panels.node]
    model.panels = panels._replace(
        mass=carried_mass(load, roof) if load else np.zeros_like(roof.area),
        pressure=pressure_load(load, roof) if load else np.zeros_like(roof.vector),
        wind=factor[:, None] * roof.vector,
    )


def warm(job: Job, model: Model) -> None:
    """Bring unstressed lengths to the temperature of the loads: L0 (1 + expansion temperature)."""
    model.L0 = warm_length(model.cut_length, model.net.expansion, job.load.temperature)


def _check_normals(job: Job, model: Model) -> None:
    """Wind and pressure along normals must not vanish silently on particles that meet no face."""
    bare = (model.area > 0) & ~model.roof.vector.any(1) & model.moves
    if along_normals(job) and bare.any():
        raise InputError(
            f"{job.path}: {int(bare.sum())} free nodes with a roof area meet no closed face in plan, so wind "
            f"and pressure have no normal to act along (first: node {model.net.node_id[bare][0]}); close the "
            "faces with elements, give normal_x, normal_y, normal_z in nodes.csv, or pressure as [x, y, z]"
        )
