"""Model of a job: its net in the initial state, on rank 0, in global order; source of each rank's state.

Rank 0 computes the constants of particles and elements once and sends them to the ranks that own the rows.
The constants therefore have the same bits on any number of ranks.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from netfall.core.arrays import rows_of
from netfall.core.errors import InputError
from netfall.core.functions import lengths
from netfall.geometry.areas import TributaryAreas, tributary_areas
from netfall.geometry.bars import euler_load
from netfall.geometry.net import Net
from netfall.geometry.sections import MAX_EXCESS, values_of_key
from netfall.geometry.shares import FaceShares, Panels, make_panels
from netfall.geometry.slender import slender_elements
from netfall.geometry.turned import global_held_axes, global_spring_stiffness, rotation_column
from netfall.geometry.zones import RoofAreas, Zones, roof_areas
from netfall.job import derived
from netfall.job.cache import NO_CACHE, ResultCache, cache_key
from netfall.job.job import Job
from netfall.loads import loads
from netfall.loads.base_motion import Motion, make_motion, sudden_load_notes
from netfall.loads.loads import GivenLoads
from netfall.loads.removal import absent_member_notes, superposed_excitation_notes
from netfall.loads.wind.field import GeneratedHistory, WindField, force_factor, make_wind_field
from netfall.loads.wind.measured import TableHistory
from netfall.model import messages
from netfall.model.layout import Layout
from netfall.model.start import check_initial_strains, check_tensions, describe_element, wind_height_notes
from netfall.model.unused import snow_on_upright_notes, zone_without_area_notes
from netfall.parallel.subdomain import Distribution
from netfall.physics.bending import Joints, curvatures
from netfall.physics.fields import FIELDS, Features, Field
from netfall.physics.law.measures import ForceLimits, caps_of, elastic_forces, unstressed_length
from netfall.physics.slip.motion import slip_points_of
from netfall.physics.stability import scaled_mass
from netfall.physics.state import State

# largest initial curvature of a joint, 2 tan(170 deg / 2); no bending axis exists beyond it
MAX_INITIAL_CURVATURE = 22.86


@final
@dataclass(frozen=True)
class Model:
    """The whole net in its initial state, on rank 0.

    An attribute with the name of a field in `physics.fields` contains the initial values of that field;
    `initial_value` gives the other fields.

    x : (n, 3) [m]; N : (m,) [N]; roof : areas at x; area_given : [m2], surface in the given geometry
    L0 : (m,) [m], unstressed, at the temperature of the loads; cut_length : at the temperature of form
    finding
    half_mass : (m,) [kg], half of each element's own mass; half_ice : (m,) [kg], of the ice on it
    spring_rest : (n, 3) [m], displacement at which the elastic supports carry no force
    mass : (n,) [kg], total, including two parts that have inertia but no weight, None if absent:
    added : (n,) [kg], by mass scaling; air_mass : (n,) [kg], added mass of the air
    air : (n, 3), c of `physics.air`, None: no aerodynamic damping; drag : on detached fragments, None: none
    loading : the constant loads; form_load : (n, 3) [N], those that the form carries
    wind_field, history : of the wind, None: no wind
    motion : of the supports, None: they do not move
    panels : of the cladding, None: panels do not tear off
    joints : of bending chains, free of moment in the initial state; None: no chains
    start_notes : messages on unusual values of the initial state
    """

    layout: Layout
    x: np.ndarray
    N: np.ndarray
    roof: RoofAreas
    area_given: float
    L0: np.ndarray
    cut_length: np.ndarray
    half_mass: np.ndarray
    half_ice: np.ndarray
    spring_rest: np.ndarray
    mass: np.ndarray
    added: np.ndarray | None
    air_mass: np.ndarray | None
    air: np.ndarray | None
    drag: loads.Drag | None
    loading: loads.Loading
    form_load: np.ndarray
    wind_field: WindField | None
    history: GeneratedHistory | TableHistory | None
    motion: Motion | None
    panels: Panels | None
    joints: Joints | None
    start_notes: tuple[str, ...]

    @property
    def net(self) -> Net:
        """The net of the job as given."""
        return self.layout.net

    @property
    def mass_unscaled(self) -> np.ndarray:
        """(n,) [kg], mass without the inertia that mass scaling adds."""
        return self.mass if self.added is None else self.mass - self.added

    @property
    def own_mass(self) -> np.ndarray:
        """(n,) [kg], mass without the added mass of the air, which a fracture removes with the wind."""
        return self.mass if self.air_mass is None else self.mass - self.air_mass

    @property
    def load(self) -> np.ndarray:
        """(n, 3) [N], constant load of the dynamic stage."""
        return self.loading.permanent + self.loading.live

    @property
    def loaded(self) -> np.ndarray:
        """(n,) bool, whether constant forces other than weight act."""
        return self.loading.loaded

    @property
    def wind(self) -> np.ndarray | None:
        """(n, 3) [N s2/m2], wind force at a speed of 1 m/s."""
        return None if self.wind_field is None else self.wind_field.force

    @property
    def mean_wind(self) -> np.ndarray | None:
        """(n, 3) [N], force of the mean wind."""
        field = self.wind_field
        return None if field is None else field.force * field.mean_square(self.history.mean_gust)[:, None]

    @property
    def eps_u(self) -> np.ndarray:
        """(m,), strain at fracture; inf: the element never breaks."""
        return self.net.fracture_strain

    @property
    def element_force_limits(self) -> ForceLimits:
        """Forces at which elements yield and buckle, and the Euler loads of bars that must not buckle."""
        net = self.net
        return caps_of(net.yield_force, euler_load(net, self.cut_length), net.buckling, net.bending)

    @property
    def euler(self) -> np.ndarray:
        """(m,) [N], compression at which bars buckle; inf: they do not buckle."""
        return self.element_force_limits.buckling

    def roof_at(self, x: np.ndarray) -> RoofAreas:
        """Return the areas at x (n, 3) [m]; those of slender elements are the initial ones."""
        return roof_areas(self.net, _areas_at(self.layout, x), self.layout.zones, self.roof.slender)

    def forces_of(self, loads: GivenLoads) -> np.ndarray:
        """Compute the nodal forces (n, 3) [N] of loads of nodes and elements."""
        return loads.forces(self.net, self.cut_length, self.net.is_there)

    def element_id_of(self, e: int) -> int:
        """Return the id of an element."""
        return int(self.net.element_id[e])

    def node_name(self, p: int) -> str:
        """Name a particle in a message: by the id of its node, or by the element whose fragment end it is."""
        if p < self.net.n:
            return f"node {self.net.node_id[p]}"
        return f"the end that broke off with element {self.element_id_of((p - self.net.n) // 2)}"

    def element_name(self, e: int) -> str:
        """Name an element in a message: its id, the ids of its nodes and its length."""
        return describe_element(self.net, e, self.L0)


def make_model(
    job: Job,
    layout: Layout,
    x: np.ndarray,
    N: np.ndarray | None,
    cache: ResultCache = NO_CACHE,
    before_stages: bool = False,
) -> Model:
    """Build the model of the initial state x (n, 3) [m] with axial forces N (m,) [N].

    N : None: the prestress of the tables; before_stages : whether stages of erection follow. Raises
    InputError.
    """
    net = layout.net
    L = lengths(x[net.elements[:, 1]] - x[net.elements[:, 0]])
    N, L0 = _unstressed_state(job, net, L, net.prestress if N is None else N)
    notes = check_initial_strains(job, net, N, L, L0)
    # `cache_key` is expensive: it reads all tables
    key = (cache_key(job), x.tobytes()) if cache.most else None
    areas = cache.get_or_compute("areas", key, lambda: _areas_at(layout, x))
    roof = roof_areas(net, areas, layout.zones, slender_elements(net, x, L0))
    notes += zone_without_area_notes(layout.zones, roof.area) if derived.has_area_loads(job) else []
    notes += snow_on_upright_notes(job, roof)
    _check_normals(job, net, roof)
    (half_mass, own), half_ice = _own_mass(net, L0), np.zeros(net.m)
    if roof.slender and job.load:
        half_ice[roof.slender.element] = 0.5 * roof.slender.ice_mass(job.load.ice)
    loading = loads.make_loading(job, roof, own, layout.loads.forces(net, L0, net.is_there))
    form_load = _form_load(net, loading) if derived.carries_permanent(job) else np.zeros_like(x)
    mass, added = _scale_masses(job, net, L0, own + net.mass + loading.carried)
    field, history = _wind(job, layout, x, roof, cache, key)
    air_mass = loads.added_air_mass(job, roof)
    motion = make_motion(job, net, x, before_stages) if derived.moves_supports(job) else None
    notes += motion.notes if motion else []
    notes += sudden_load_notes(job, (loading.permanent + loading.live - form_load)[~net.fixed])
    winds: dict[str, Any] = {"[wind]": (job.wind, field.force)} if field else {}
    for name, wind in ((name, case.wind) for name, case in layout.cases.items() if case.wind):
        drag = loads.drag_areas(roof, wind, job.load)
        winds[f"[[case]] {name}:"] = wind, loads.wind_force_area(wind, roof, drag)
    notes += wind_height_notes(net, x, winds)
    notes += [*absent_member_notes(job, net), *superposed_excitation_notes(job, bool(field and field.varies))]
    panels_tear = field and job.wind.after_fracture == "panels"
    return Model(
        layout,
        x,
        N,
        roof,
        float(layout.roofing.given.surface.sum()) if job.form_finding else 0.0,
        L0=L0,
        cut_length=L0,
        half_mass=half_mass,
        half_ice=half_ice,
        spring_rest=loads.spring_preload_displacement(net, x, N, L, form_load)
        if job.form_finding
        else net.spring_rest,
        mass=mass if air_mass is None else mass + air_mass,
        added=added,
        air_mass=air_mass,
        air=loads.aerodynamic_damping(job, x, roof),
        drag=loads.make_drag(job, x, roof),
        loading=loading,
        form_load=form_load,
        wind_field=field,
        history=history,
        motion=motion,
        panels=_panels(job, layout, areas.shares, loading) if panels_tear else None,
        joints=_joints(job, layout, x, L0) if layout.chains else None,
        start_notes=tuple(notes),
    )


def _joints(job: Job, layout: Layout, x: np.ndarray, L0: np.ndarray) -> Joints:
    """Build the joints of bending chains, with k = EI / l for equal bars.

    For two different bars k = 2 / (l1 / EI1 + l2 / EI2). Raises InputError if a chain folds back, because the
    bending axis is then undefined.
    """
    net, particles, elements = layout.net, layout.chains.particles, layout.chains.elements
    initial = curvatures(x, particles)
    for k in np.flatnonzero(lengths(initial) > MAX_INITIAL_CURVATURE)[:1]:
        first, second = net.element_id[elements[k]]
        node = net.node_id[particles[k, 1]]
        raise InputError(messages.CHAIN_TURNS_BACK(path=job.path, node=node, first=first, second=second))
    flexibility = (L0 / (net.modulus * net.second_moment))[elements]
    return Joints(particles, 2.0 / (flexibility[:, 0] + flexibility[:, 1]), initial)


def permanent_load_of_form(job: Job, layout: Layout, x: np.ndarray, N: np.ndarray) -> np.ndarray:
    """Compute the permanent load (n, 3) [N] of a form at x (n, 3) [m] with axial forces N (m,) [N]."""
    net, areas = layout.net, _areas_at(layout, x)
    L = lengths(x[net.elements[:, 1]] - x[net.elements[:, 0]])
    _, own = _own_mass(net, unstressed_length(L, N, net.EA, job.cable.strain_measure))
    roof = roof_areas(net, areas, layout.zones)
    return _form_load(net, loads.make_loading(job, roof, own, net.load))


def _form_load(net: Net, loading: loads.Loading) -> np.ndarray:
    """Return the permanent load (n, 3) [N] as a form carries it: a subdivided bar has it at its two ends.

    In a form elements have only axial forces, so a load between the ends would make an arch of the bar.
    """
    load, bars = loading.permanent.copy(), net.bar[:: net.parts]
    inner, ends = net.inner_particles()[bars], net.undivided()[bars]
    share = (np.arange(1, net.parts) / net.parts)[:, None]
    for end, part in enumerate((1.0 - share, share)):
        np.add.at(load, ends[:, end], (part * loading.permanent[inner]).sum(1))
    load[inner] = 0.0
    return load


def _own_mass(net: Net, L0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute half of each element's own mass (m,) [kg], and the sums of these at the nodes (n,) [kg]."""
    half = 0.5 * net.density * net.section * L0
    return half, np.bincount(net.elements[:, 0], half, net.n) + np.bincount(net.elements[:, 1], half, net.n)


def _areas_at(layout: Layout, x: np.ndarray) -> TributaryAreas:
    """Return the areas at x (n, 3) [m]; areas of the given geometry are not computed again."""
    net, roofing = layout.net, layout.roofing
    is_given = np.array_equal(x, net.x)
    return roofing.given if is_given else tributary_areas(x, net, roofing.faces)


def _unstressed_state(job: Job, net: Net, L: np.ndarray, N: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return axial forces (m,) [N] and unstressed lengths (m,) [m] at lengths L (m,) [m].

    A given unstressed length determines the force of its element. N determines the other unstressed lengths.
    """
    EA, strain = net.EA, job.cable.strain_measure
    check_tensions(job, net, N, L)
    L0 = unstressed_length(L, N, EA, strain)
    given = np.isfinite(net.unstressed_length)
    if given.any():
        L0 = np.where(given, net.unstressed_length, L0)
        N = np.where(given, elastic_forces(L, L0, EA, net.bar, strain), N)
    return N, L0


def _scale_masses(
    job: Job, net: Net, L0: np.ndarray, mass: np.ndarray
) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the masses (n,) [kg] after mass scaling, and the added part; None: no mass scaling."""
    if job.dynamics is None or not job.dynamics.mass_scaling:
        return mass, None
    share, present = job.dynamics.mass_scaling, net.is_there
    scaled = scaled_mass(
        net.elements[present], net.EA[present], L0[present], mass, net.moves, net.support, share
    )
    return scaled, scaled - mass


def _wind(
    job: Job, layout: Layout, x: np.ndarray, roof: RoofAreas, cache: ResultCache, key: Any
) -> tuple[Any, ...]:
    """Return the wind field at x (n, 3) [m], and the wind history; None, None without wind.

    key : of the field in the cache. Raises InputError.
    """
    if job.wind is None:
        return None, None
    measured = layout.measured
    settings = loads.with_coefficients(job.wind, layout.sectors, layout.zones.of_parts)
    drag, places = loads.drag_areas(roof, settings, job.load), measured.places if measured else None
    exposed, force = loads.exposed_areas(roof, drag), loads.wind_force_area(settings, roof, drag)

    def make() -> WindField:
        patches = loads.exposed_patches(roof, x, settings, job.load)
        return make_wind_field(x, exposed, settings, places, force, patches)

    field = cache.get_or_compute("wind", key, make)
    return field, measured or GeneratedHistory(field, job.wind)


def _panels(job: Job, layout: Layout, shares: FaceShares, loading: loads.Loading) -> Panels:
    """Build the panels that can tear off.

    Raises InputError if the net has no panels, or if a load that grows over [load] ramp acts on panels.
    """
    net, faces = layout.net, layout.roofing.faces
    if not len(faces) or np.isfinite(net.area).any():
        raise InputError(messages.NO_PANELS(path=job.path))
    if loading.growing is not None:
        raise InputError(messages.PANELS_WITH_RAMP(path=job.path))
    panels = make_panels(net, faces, shares)
    zones = layout.zones.corners or Zones(layout.zones.names, layout.zones.share[panels.node])
    load, roof = job.load, RoofAreas(panels.area, panels.plan_area, panels.vector, zones)
    settings = loads.with_coefficients(job.wind, layout.sectors, zones)
    factor = np.broadcast_to(force_factor(settings), len(zones.share))
    zero, zero_mass = np.zeros_like(roof.vector), np.zeros_like(roof.area)
    return panels._replace(
        air=loads.aerodynamic_damping_area(job, roof) if derived.has_aerodynamic_damping(job) else zero,
        air_mass=loads.added_air_mass(job, roof) if derived.has_added_air_mass(job) else zero_mass,
        mass=loads.carried_mass(load, roof) if load else zero_mass,
        pressure=loads.pressure_load(load, roof) if load else zero,
        wind=factor[:, None] * roof.vector,
    )


def _check_normals(job: Job, net: Net, roof: RoofAreas) -> None:
    """Check that each free node with a roof area has a normal, along which wind and pressure act.

    Raises InputError for nodes that meet no closed face in plan: their load would vanish silently.
    """
    bare = (roof.area > 0) & ~roof.vector.any(1) & net.moves
    if derived.has_normal_loads(job) and bare.any():
        count, node = int(bare.sum()), net.node_id[bare][0]
        raise InputError(messages.NODES_WITHOUT_NORMAL(path=job.path, count=count, node=node))


def compressive_fracture_strain(model: Model) -> np.ndarray:
    """Return the fracture strains in compression (m,); -inf: none, or bars buckle before they break."""
    net, strain = model.net, model.net.fracture_strain
    by_load = np.isfinite(net.breaking_load) & (net.breaking_load <= net.EA * strain * (1.0 + MAX_EXCESS))
    return np.where(net.buckling & ~(by_load & (model.euler < net.breaking_load)), -strain, -np.inf)


# Initial values of fields that are not attributes of the model or its net.
INITIAL_VALUES: dict[str, Callable[[Model], np.ndarray]] = {
    "x_start": lambda model: model.x,
    "free": lambda model: 1 - global_held_axes(model.net, model.net.fixed).astype(np.uint8),
    "spring": lambda model: global_spring_stiffness(model.net),
    "turned": lambda model: rotation_column(model.net, model.net.fixed),
    "course": lambda model: model.motion.course,
    "strand": lambda model: model.L0,
    "slip_place": lambda model: model.layout.slides.place,
    "slip_along": lambda model: model.layout.slides.along,
    "slip_share": lambda model: model.layout.slides.share,
    "friction": lambda model: model.layout.slides.at_nodes(model.layout.slides.friction, model.net.n),
    "resistance": lambda model: model.layout.slides.at_nodes(model.layout.slides.resistance, model.net.n),
    "eps_c": compressive_fracture_strain,
    "drag_size": lambda model: model.drag.size,
    "steady_speed": lambda model: model.drag.speed,
}


def initial_value(job: Job, model: Model, field: Field) -> np.ndarray:
    """Return the initial values of a field; fields of a key of [cable] are 0 for elements without the key."""
    name = field.name
    if field.feature.startswith("cable."):
        return values_of_key(job, model.net, field.feature.removeprefix("cable."), 0.0)
    if name in INITIAL_VALUES:
        return INITIAL_VALUES[name](model)
    return getattr(model if hasattr(model, name) else model.net, name)


def make_state(distribution: Distribution, job: Job, model: Model | None, features: Features) -> State:
    """Build the state of one rank; `given` fields start with the values of the model. Collective."""
    subdomain = distribution.subdomain
    width = int(np.bincount(subdomain.ends.ravel()).max(initial=0))
    state = State(features, subdomain.n_owned, subdomain.n_halo, len(subdomain.element_gid), width)
    state.gid[:], state.ends[:] = subdomain.particle_gid, subdomain.ends
    state.owned[:] = subdomain.element_owned
    for row in FIELDS:
        if row.given and features.has(row):
            distribute = distribution.particles if row.entity == "particle" else distribution.elements
            getattr(state, row.name)[:] = distribute(
                None if model is None else initial_value(job, model, row)
            )
    if features.drags:
        state.wind_along = distribution.comm.bcast(model and model.drag.along)
    if features.bending:
        _place_joints(distribution, model, state)
    if features.slip:
        slip_at = distribution.elements(None if model is None else model.layout.slides.at)
        state.slip_at[:] = rows_of(subdomain.particle_gid, slip_at.ravel()).reshape(slip_at.shape)
    if features.sliding:
        segment = distribution.elements(None if model is None else model.layout.slides.segment)
        state.slip_points = slip_points_of(state, segment)
    return state


def _place_joints(distribution: Distribution, model: Model | None, state: State) -> None:
    """Set the joints of a state, and for each element the joints at its two ends. Collective."""
    subdomain, joints = distribution.subdomain, None if model is None else model.joints
    owned = (subdomain.joints[:, 1] < subdomain.n_owned).astype(np.uint8)
    stiffness = distribution.joints(None if joints is None else joints.stiffness)
    rest = distribution.joints(None if joints is None else joints.rest)
    state.joints = Joints(subdomain.joints, stiffness, rest, owned)
    joint_at = distribution.elements(None if model is None else model.layout.chains.at)
    state.joint_at = np.where(
        joint_at >= 0, rows_of(subdomain.joint_gid, joint_at.ravel()).reshape(joint_at.shape), joint_at
    )
