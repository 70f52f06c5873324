"""The model of a job: its net in the initial state, on rank 0, in global order.

What is a constant of a particle or an element is computed here once, and sent to whoever holds it; so it has
the same bits on any number of ranks.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from netfall.ground.errors import InputError
from netfall.job import asks
from netfall.job.job import Job
from netfall.job.memory import FORGETFUL, Memory, key_of
from netfall.mechanics.bending import Joints, curvatures
from netfall.mechanics.law.limits import Caps, caps_of
from netfall.mechanics.law.measures import elastic_forces, unstressed_length
from netfall.mechanics.stability import scaled_mass
from netfall.model.idle import bare_zones
from netfall.model.layout import Layout
from netfall.model.loads import (
    Drag,
    Loading,
    by_node,
    carried_mass,
    damping_air,
    drag_on,
    kappa_area,
    loading_of,
    moving_air,
    preload,
    pressure_load,
)
from netfall.model.losses import absent_notes, shaken_notes
from netfall.model.motion import Motion, motion_of
from netfall.model.start import check_start, check_tensions, element_words, low_notes
from netfall.net.bars import euler_load
from netfall.net.net import Net
from netfall.numerics.functions import lengths
from netfall.roof.areas import Areas, tributary_areas
from netfall.roof.panels import Panels, panels_of
from netfall.roof.shares import Shares
from netfall.roof.zones import Roof
from netfall.wind.field import GeneratedHistory, WindField, force_factor, make_wind_field
from netfall.wind.measured import TableHistory

FOLDED = 22.86  # 2 tan(170 deg / 2): the largest curvature without moment at which a chain has an axis


@dataclass(frozen=True)
class Model:
    """What rank 0 knows of the whole net in its initial state.

    Attributes that bear the name of a field in `mechanics.fields` are what that field starts with; for others
    see `model.state`.

    x : (n, 3) [m]; N : (m,) [N]; roof : areas there; area_given : [m2], surface in the geometry that is given
    L0 : (m,) [m], unstressed, at the temperature of the loads; cut_length : at that of form finding
    half_mass : (m,) [kg], half of each element's own mass
    spring_rest : (n, 3) [m], displacement at which elastic supports carry nothing
    mass : (n,) [kg]; of it, inertia without weight and None where there is none:
    added : (n,) [kg] by mass scaling; air_mass : (n,) [kg] of air that moves along
    air : (n, 3), c of `mechanics.air`, None: no air damping; drag : on what is cut free, None: none
    loading : the constant loads
    wind_field, history : of the wind, None: there is none
    motion : of supports, None: they stand still
    panels : of the cladding, None: they do not tear off
    joints : of chains of bars that bend, without moment in the initial state; None: there are none
    start_notes : what is plausible but odd in the initial state
    """

    layout: Layout
    x: np.ndarray
    N: np.ndarray
    roof: Roof
    area_given: float
    L0: np.ndarray
    cut_length: np.ndarray
    half_mass: np.ndarray
    spring_rest: np.ndarray
    mass: np.ndarray
    added: np.ndarray | None
    air_mass: np.ndarray | None
    air: np.ndarray | None
    drag: Drag | None
    loading: Loading
    wind_field: WindField | None
    history: GeneratedHistory | TableHistory | None
    motion: Motion | None
    panels: Panels | None
    joints: Joints | None
    start_notes: tuple[str, ...]

    @property
    def net(self) -> Net:
        """As it was given."""
        return self.layout.net

    @property
    def own_mass(self) -> np.ndarray:
        """(n,) [kg] without the air: what is left of it where a fracture takes the wind away."""
        return self.mass if self.air_mass is None else self.mass - self.air_mass

    @property
    def load(self) -> np.ndarray:
        """(n, 3) [N], constant in the dynamic stage."""
        return self.loading.permanent + self.loading.live

    @property
    def wind(self) -> np.ndarray | None:
        """(n, 3) [N s2/m2], force at 1 m/s."""
        return self.wind_field and self.wind_field.force

    @property
    def mean_wind(self) -> np.ndarray | None:
        """(n, 3) [N], force of the mean wind."""
        field = self.wind_field
        return field and field.force * field.mean_square(self.history.mean_gust)[:, None]

    @property
    def eps_u(self) -> np.ndarray:
        """(m,), strain at fracture; inf: never breaks."""
        return self.net.fracture_strain

    @property
    def caps(self) -> Caps:
        """Forces at which elements yield and buckle, and beyond which bars should."""
        net = self.net
        return caps_of(net.yield_force, euler_load(net, self.cut_length), net.buckling, net.bending)

    @property
    def euler(self) -> np.ndarray:
        """(m,) [N], compression at which bars buckle; inf: they do not."""
        return self.caps.buckling

    @property
    def notes(self) -> tuple[str, ...]:
        """What is plausible but odd in the net, its tables, its roof and its initial state."""
        return self.layout.notes + self.start_notes

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
        return element_words(self.net, e, self.L0)


def make_model(
    job: Job, layout: Layout, x: np.ndarray, N: np.ndarray | None, memory: Memory = FORGETFUL
) -> Model:
    """Unstressed lengths, masses, loads and wind of the initial state x (n, 3) [m] with tensions N (m,) [N].

    N : None: the prestress of the tables. Raises InputError.
    """
    net = layout.net
    L = lengths(x[net.elements[:, 1]] - x[net.elements[:, 0]])
    N, L0 = _unstressed(job, net, L, net.prestress if N is None else N)
    notes = check_start(job, net, N, L, L0)
    here = (key_of(job), x.tobytes()) if memory.most else None  # a key holds the tables
    areas = memory.once("areas", here, lambda: _areas(layout, x))
    roof = Roof(areas.surface, areas.plan, areas.vector, layout.zones)
    notes += bare_zones(layout.zones, roof.area) if asks.loads_the_roof(job) else []
    _check_normals(job, net, roof)
    half, own = _own_mass(net, L0)
    loading = loading_of(job, roof, own, net.load)
    carried = loading.permanent if asks.carries_permanent(job) else None  # by the form
    mass, added = _scaled(job, net, L0, own + net.mass + loading.carried)
    find = lambda *asked: memory.once("wind", here, lambda: make_wind_field(x, roof.vector, *asked))
    field, history = _wind(job, layout, find)
    air_mass = moving_air(job, roof)
    motion = motion_of(job, net, x) if asks.moves_supports(job) else None
    notes += motion.notes if motion else []
    if field:
        notes += low_notes(job, net, x, field.force)
    notes += [*absent_notes(job, net), *shaken_notes(job, bool(field and field.varies))]
    tears = field and job.wind.after_fracture == "panels"
    return Model(
        layout,
        x,
        N,
        roof,
        float(layout.roofing.given.surface.sum()) if job.form_finding else 0.0,
        L0=L0,
        cut_length=L0,
        half_mass=half,
        spring_rest=preload(net, x, N, L, carried) if job.form_finding else net.spring_rest,
        mass=mass if air_mass is None else mass + air_mass,
        added=added,
        air_mass=air_mass,
        air=damping_air(job, net, x, roof),
        drag=drag_on(job, x, roof),
        loading=loading,
        wind_field=field,
        history=history,
        motion=motion,
        panels=_panels(job, layout, areas.shares, loading) if tears else None,
        joints=_joints(job, layout, x, L0) if layout.chains else None,
        start_notes=tuple(notes),
    )


def _joints(job: Job, layout: Layout, x: np.ndarray, L0: np.ndarray) -> Joints:
    """The joints of chains that bend: k = EI / l, of two unlike bars 2 / (l1 / EI1 + l2 / EI2).

    Raises InputError where a chain folds back, so that no axis is known about which it bends.
    """
    net, particles, elements = layout.net, layout.chains.particles, layout.chains.elements
    rest = curvatures(x, particles)
    for k in np.flatnonzero(lengths(rest) > FOLDED)[:1]:
        first, second = net.element_id[elements[k]]
        raise InputError(
            f"{job.path}: node {net.node_id[particles[k, 1]]}: the bending chain turns back by more than 170 "
            f"degrees from element {first} to element {second}; expected at most 170 degrees; move the node, "
            "or put the two bars in different groups"
        )
    gives = (L0 / (net.modulus * net.second_moment))[elements]
    return Joints(particles, 2.0 / (gives[:, 0] + gives[:, 1]), rest)


def permanent_load(job: Job, layout: Layout, x: np.ndarray, N: np.ndarray) -> np.ndarray:
    """Self weight and dead load (n, 3) [N] of the net at x (n, 3) [m] with axial forces N (m,) [N]."""
    net, areas = layout.net, _areas(layout, x)
    L = lengths(x[net.elements[:, 1]] - x[net.elements[:, 0]])
    _, own = _own_mass(net, unstressed_length(L, N, net.EA, job.cable.strain))
    roof = Roof(areas.surface, areas.plan, areas.vector, layout.zones)
    return loading_of(job, roof, own, net.load).permanent


def _own_mass(net: Net, L0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Half of each element's own mass (m,) [kg], and what nodes (n,) have of it."""
    half = 0.5 * net.density * net.section * L0
    return half, np.bincount(net.elements[:, 0], half, net.n) + np.bincount(net.elements[:, 1], half, net.n)


def _areas(layout: Layout, x: np.ndarray) -> Areas:
    """The areas at x (n, 3) [m]: those of the geometry as given, where that is the initial state."""
    net, roofing = layout.net, layout.roofing
    same = np.array_equal(x, net.x)
    return roofing.given if same else tributary_areas(x, net, roofing.faces)


def _unstressed(job: Job, net: Net, L: np.ndarray, N: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tensions (m,) [N] and unstressed lengths (m,) [m] at lengths L: as given, else those of N."""
    EA, strain = net.EA, job.cable.strain
    check_tensions(job, net, N, L)
    L0 = unstressed_length(L, N, EA, strain)
    given = np.isfinite(net.unstressed_length)
    if given.any():
        L0 = np.where(given, net.unstressed_length, L0)
        N = np.where(given, elastic_forces(L, L0, EA, net.bar, strain), N)
    return N, L0


def _scaled(job: Job, net: Net, L0: np.ndarray, mass: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Masses (n,) [kg] with what mass scaling adds, and this."""
    if job.dynamics is None or not job.dynamics.mass_scaling:
        return mass, None
    share, there = job.dynamics.mass_scaling, net.is_there
    scaled = scaled_mass(net.elements[there], net.EA[there], L0[there], mass, net.moves, net.support, share)
    return scaled, scaled - mass


def _wind(job: Job, layout: Layout, find: Callable) -> tuple:
    """The field of the wind, as `find` makes it, and its history; None, None without. Raises InputError."""
    if job.wind is None:
        return None, None
    measured, settings = layout.measured, by_node(job, layout.shape_coefficient)
    field = find(settings, measured.places if measured else None)
    return field, measured or GeneratedHistory(field, job.wind)


def _panels(job: Job, layout: Layout, shares: Shares, loading: Loading) -> Panels:
    """The panels that can tear off. Raises InputError where there are none, or loads grow on them."""
    net, faces = layout.net, layout.roofing.faces
    wrong = "not together with [load] ramp; remove one of them" if loading.growing is not None else ""
    if not len(faces) or np.isfinite(net.area).any():
        wrong = (
            "panels are the closed faces of the net, and their areas those of the nodes; expected a net with "
            "faces and without a column area"
        )
    if wrong:
        raise InputError(f'{job.path}: [wind] after_fracture = "panels": {wrong}')
    panels = panels_of(net, faces, shares)
    zones = layout.zones.at(panels.node)
    load, roof = job.load, Roof(panels.area, panels.plan_area, panels.vector, zones)
    factor = np.broadcast_to(force_factor(by_node(job, layout.shape_coefficient)), net.n)[panels.node]
    still = np.zeros_like(roof.vector)
    return panels._replace(
        air=kappa_area(job, roof) if asks.air_damps(job) else still,
        air_mass=moving_air(job, roof) if asks.air_moves(job) else np.zeros_like(roof.area),
        mass=carried_mass(load, roof) if load else np.zeros_like(roof.area),
        pressure=pressure_load(load, roof) if load else np.zeros_like(roof.vector),
        wind=factor[:, None] * roof.vector,
    )


def _check_normals(job: Job, net: Net, roof: Roof) -> None:
    """Wind and pressure along normals must not vanish silently on particles that meet no face."""
    bare = (roof.area > 0) & ~roof.vector.any(1) & net.moves
    if asks.along_normals(job) and bare.any():
        raise InputError(
            f"{job.path}: {int(bare.sum())} free nodes with a roof area meet no closed face in plan, so wind "
            f"and pressure have no normal to act along (first: node {net.node_id[bare][0]}); close the "
            "faces with elements, give normal_x, normal_y, normal_z in nodes.csv, or pressure as [x, y, z]"
        )
