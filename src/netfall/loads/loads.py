"""Constant loads of a job on its particles: permanent, live and growing loads; loads of tables.

Permanent: self weight and superimposed dead load. Live: loads of nodes, snow, ice, pressure. The static stage
applies the live loads in steps. All of them act in the dynamic stage.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from netfall.core.arrays import rows_of
from netfall.core.errors import InputError, raise_errors
from netfall.core.functions import cos, from_rotated_axes, lengths, sin, to_rotated_axes
from netfall.geometry.net import GRAVITY, Net
from netfall.geometry.zones import RoofAreas, Zones
from netfall.job import derived
from netfall.job.csv_table import COLUMNS, MAX_CELL, UNITS, Table, open_load_table
from netfall.job.job import Job
from netfall.job.keys.models import Load, Wind
from netfall.loads import messages
from netfall.loads.wind.field import WindField, force_factor, profile_speed
from netfall.loads.wind.sectors import Sectors
from netfall.loads.wind.surface import square_variances
from netfall.physics.air import damping_vectors
from netfall.physics.wind_spectra import along_wind


@dataclass(frozen=True)
class GivenLoads:
    """Loads of nodes (n, 3) [N], and of elements (m, 3) [N/m of unstressed length], None: none."""

    nodes: np.ndarray
    elements: np.ndarray | None = None

    def forces(self, net: Net, L0: np.ndarray, present: np.ndarray) -> np.ndarray:
        """Compute the forces (n, 3) [N] on the nodes: nodal loads, and half of each element's load.

        L0 : (m,) [m], unstressed lengths; present : (m,) bool, elements in the net
        """
        if self.elements is None:
            return self.nodes
        force, half = self.nodes.copy(), 0.5 * self.elements * np.where(present, L0, 0.0)[:, None]
        for end in net.elements.T:
            np.add.at(force, end, half)
        return force


def read_given_loads(job: Job, net: Net) -> tuple[GivenLoads, dict[str, GivenLoads], list[str]]:
    """Return the loads of the nodes' table and [load], the loads of each table of loads, and notes.

    Tables of zones are omitted, because `job.csv_table` converts them to values. Raises InputError with all
    errors.
    """
    loads, errors, notes = {}, [], []
    for name in dict.fromkeys(name for _, name in job.load_tables()):
        try:
            table, of_rows = open_load_table(job.path.parent / name)
            notes += table.notes
            if of_rows != "zone":
                loads[name] = _read_loads(table, of_rows, net)
        except InputError as error:
            errors += error.lines
    raise_errors(errors)
    everywhere = GivenLoads(net.load)
    if job.load and job.load.load_table in loads:
        own = loads[job.load.load_table]
        everywhere = replace(own, nodes=net.load + own.nodes)
    return everywhere, loads, notes


def _read_loads(table: Table, of_rows: str, net: Net) -> GivenLoads:
    """Read the loads of nodes or elements; rows for the same node or element add. Raises InputError."""
    ids = net.node_id if of_rows == "node" else net.element_id[:: net.parts]
    values = table.stacked(COLUMNS[of_rows], 0.0, unit=UNITS[of_rows])
    numbers = table.integers(of_rows)
    rows = rows_of(ids, numbers)
    for k in np.flatnonzero((rows < 0) & (numbers >= -MAX_CELL)).tolist():
        table.wrong(messages.NO_SUCH_LOADED(row=table.at(k), kind=of_rows, number=numbers[k]))
    table.finish()
    total = np.zeros((len(ids), 3))
    np.add.at(total, rows, values)
    if of_rows == "node":
        return GivenLoads(total)
    return GivenLoads(np.zeros((net.n, 3)), np.repeat(total, net.parts, axis=0))


@dataclass(frozen=True)
class Loading:
    """Constant loads, forces (n, 3) [N]; carried : (n,) [kg], mass of dead load, snow and ice.

    loaded : (n,) bool, whether forces other than weight act
    growing : load that grows over [load] ramp, None: none
    """

    permanent: np.ndarray
    live: np.ndarray
    growing: np.ndarray | None
    carried: np.ndarray
    loaded: np.ndarray


def make_loading(job: Job, roof: RoofAreas, own: np.ndarray, nodes: np.ndarray) -> Loading:
    """Compute the loads of a job.

    own : (n,) [kg], mass of the elements; nodes : (n, 3) [N], loads of the nodes
    """
    load, permanent = job.load, np.zeros_like(nodes)
    if load is None:
        return Loading(permanent, nodes.copy(), None, np.zeros(len(nodes)), np.asarray(nodes.any(1)))
    if load.self_weight:
        permanent[:, 2] -= GRAVITY * own
    permanent += dead_load(load, roof)
    carried, pressure = carried_mass(load, roof), pressure_load(load, roof)
    live, loaded = nodes + snow_and_ice_load(load, roof), np.asarray(np.hstack([nodes, pressure]).any(1))
    if derived.has_growing_pressure(job):
        return Loading(permanent, live, pressure, carried, loaded)
    return Loading(permanent, live + pressure, None, carried, loaded)


def carried_mass(load: Load, roof: RoofAreas) -> np.ndarray:
    """Compute the mass of dead load, snow and ice, (n,) [kg]."""
    parts = roof.parts
    dead, snow = parts.zones.spread(load, "dead"), parts.zones.spread(load, "snow")
    mass = roof.at_nodes(dead * parts.area / GRAVITY + snow * parts.plan_area / GRAVITY)
    return mass if roof.slender is None else mass + roof.slender.at_ends(roof.slender.ice_mass(load.ice))


def live_load(load: Load, roof: RoofAreas, nodes: np.ndarray) -> np.ndarray:
    """Compute the live load of [load], (n, 3) [N]; nodes : as in `make_loading`."""
    return nodes + snow_and_ice_load(load, roof) + pressure_load(load, roof)


def dead_load(load: Load, roof: RoofAreas) -> np.ndarray:
    """Compute the weight of the cladding on its surface, (n, 3) [N]."""
    force, parts = np.zeros_like(roof.vector), roof.parts
    force[:, 2] -= roof.at_nodes(parts.zones.spread(load, "dead") * parts.area)
    return force


def snow_and_ice_load(load: Load, roof: RoofAreas) -> np.ndarray:
    """Compute the weight of the snow on the area in plan, and of the ice on slender elements, (n, 3) [N]."""
    force, parts = np.zeros_like(roof.vector), roof.parts
    force[:, 2] -= roof.at_nodes(parts.zones.spread(load, "snow") * parts.plan_area)
    if roof.slender is not None:
        force[:, 2] -= GRAVITY * roof.slender.at_ends(roof.slender.ice_mass(load.ice))
    return force


def pressure_load(load: Load, roof: RoofAreas) -> np.ndarray:
    """Compute the force of the pressure, (n, 3) [N].

    A scalar pressure acts opposite to the vector areas, whose sum is exact. A pressure [x, y, z] acts on the
    surface area.
    """
    parts = roof.parts
    force = np.zeros_like(parts.vector)
    for value, share in parts.zones.parts(load, "pressure"):
        if value is not None:
            if isinstance(value, int | float):
                zone_force = -value * parts.vector
            else:
                zone_force = parts.area[:, None] * np.array(value)
            force += share[:, None] * zone_force
    return roof.at_nodes(force)


def spring_preload_displacement(
    net: Net, x: np.ndarray, N: np.ndarray, L: np.ndarray, load: np.ndarray
) -> np.ndarray:
    """Compute the displacements (n, 3) [m] at which springs carry no force.

    Form finding holds the axes with springs. Each spring therefore starts with the reaction to the axial
    forces N (m,) [N] of elements of length L (m,) [m] and to the load (n, 3) [N] of form finding.
    """
    if not net.spring.any():
        return np.zeros((net.n, 3))
    force = load.copy()
    tension = (N / L)[:, None] * (x[net.elements[:, 1]] - x[net.elements[:, 0]])
    np.add.at(force, net.elements[:, 0], tension)
    np.subtract.at(force, net.elements[:, 1], tension)
    force = to_rotated_axes(force, net.angle)
    displacement = np.divide(-force, net.spring, out=np.zeros((net.n, 3)), where=net.spring > 0)
    return from_rotated_axes(displacement, net.angle)


def coefficients_of(wind: Wind, sectors: Sectors | None, zones: Zones) -> np.ndarray:
    """Return the net pressure coefficient of each row of some zones; sectors : of the wind or None."""
    if sectors is None:
        return zones.spread(wind, "pressure_coefficient")
    of_roof, of_zone = sectors.at(wind.direction)
    return zones.by_node(of_roof, wind.zone_values("pressure_coefficient") | of_zone)


def with_coefficients(wind: Wind, sectors: Sectors | None, zones: Zones) -> Any:
    """Return a section [wind] with the net pressure coefficient (r,) of each row of some zones."""
    return wind.replaced(pressure_coefficient=coefficients_of(wind, sectors, zones))


def wind_force_area(settings: Any, roof: RoofAreas, drag: np.ndarray | None) -> np.ndarray:
    """Compute the force (n, 3) [N s2/m2] of a wind of 1 m/s; settings : with coefficients of the parts.

    drag : (n, 3) [m2], drag areas of slender elements, where pressures at taps do not act; None: no areas
    """
    force = roof.at_nodes(np.reshape(force_factor(settings), (-1, 1)) * roof.parts.vector)
    return force if drag is None or settings.pressures else force + 0.5 * settings.air_density * drag


def drag_areas(roof: RoofAreas, wind: Wind, load: Load | None) -> np.ndarray | None:
    """Compute the drag areas (n, 3) [m2] of slender elements with the ice of [load]; None: no elements."""
    if roof.slender is None:
        return None
    return roof.slender.at_ends(roof.slender.drag_areas(wind.direction, load.ice if load else 0.0))


def exposed_areas(roof: RoofAreas, drag: np.ndarray | None) -> np.ndarray:
    """Return the areas (n, 3) [m2] on which gusts act: roof areas, and drag areas, None: no drag areas."""
    return roof.vector if drag is None else roof.vector + drag


def exposed_patches(
    roof: RoofAreas, x: np.ndarray, wind: Wind, load: Load | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return centres (n, 3) [m] of the exposed areas, and variances (n, 3) [m2] in them, in axes of the wind.

    The roof of a node is a square along the surface, the half of a slender element a line from the node x.
    """
    normal, centre = (along_wind(each, wind.direction) for each in (roof.vector, roof.centre))
    area = lengths(normal)[:, None]
    spread = square_variances(normal)
    if roof.slender is None:
        return centre, spread
    slender, node = roof.slender, along_wind(x, wind.direction)
    half = 0.5 * lengths(slender.drag_areas(wind.direction, load.ice if load else 0.0))[:, None]
    quarter = 0.25 * slender.length[:, None] * along_wind(slender.axis, wind.direction)
    first, second = area * (centre - node), area * (spread + (centre - node) ** 2)
    for end, step in zip(slender.ends.T, (quarter, -quarter)):
        np.add.at(area, end, half)
        np.add.at(first, end, half * step)
        np.add.at(second, end, half * (4.0 / 3.0) * step**2)
    unit = np.where(area > 0.0, area, 1.0)
    shift = first / unit
    return node + shift, np.maximum(0.0, second / unit - shift**2)  # rounding makes zeros negative


def mean_pressure(job: Job, coefficient: np.ndarray, field: WindField, mean_gust: np.ndarray) -> np.ndarray:
    """Compute the pressure (n,) [N/m2] of the mean wind, positive onto the roof: c_p,net rho U^2 / 2.

    coefficient : (n,); mean_gust : (c,) [m/s] at the control points, in addition to the mean of the field
    """
    square = field.mean_square(mean_gust)
    return square if field.tapped else coefficient * (0.5 * job.wind.air_density) * square


def load_datasets(job: Job, zones: Zones) -> dict[str, np.ndarray]:
    """Build the datasets of /load that are present: snow and pressure (n,) [N/m2], ice [m], temperature [K].

    A pressure along axes is nan. A node in several zones has the mean weighted by their shares.
    """
    if job.load is None:
        return {}
    numbers = {"temperature": job.load.temperature, "ice": job.load.ice}
    datasets: dict[str, Any] = {name: np.float64(value) for name, value in numbers.items() if value}
    if any(value for value, _ in zones.parts(job.load, "snow")):
        datasets["snow"] = zones.spread(job.load, "snow")
    parts = zones.parts(job.load, "pressure")
    if any(isinstance(value, int | float) for value, _ in parts):
        datasets["pressure"] = np.zeros(len(zones.of_node))
        for value, share in parts:
            along_axes = np.where(share > 0.0, np.nan, 0.0)
            datasets["pressure"] += along_axes if isinstance(value, list) else share * (value or 0.0)
    return datasets


# --- air on the particles of a roof (`physics.air`): drag, aerodynamic damping and added mass


class Drag(NamedTuple):
    """Data of each node for the drag on detached fragments.

    size : (n,) [kg/m] rho A / 2; speed : (n,) [m/s], mean wind speed; along : x, y of the wind's direction
    """

    size: np.ndarray
    speed: np.ndarray
    along: tuple[float, float]


def make_drag(job: Job, x: np.ndarray, roof: RoofAreas) -> Drag | None:
    """Return the drag data at x (n, 3) [m]; None: no drag.

    The drag depends on the mean speed if the wind is given as pressures, otherwise on the gust speed.
    """
    if not derived.has_fragment_drag(job):
        return None
    wind = job.wind
    angle = wind.direction * (np.pi / 180.0)
    speed = profile_speed(wind, wind.speed or 0.0, x[:, 2])
    area = roof.area
    if roof.slender is not None:
        area = area + roof.slender.at_ends(roof.slender.reference_areas(job.load.ice if job.load else 0.0))
    return Drag(0.5 * wind.air_density * area, speed, (float(cos(angle)), float(sin(angle))))


def aerodynamic_damping_area(job: Job, roof: RoofAreas) -> np.ndarray:
    """Compute kappa rho A (n, 3) [kg/m] of vector areas A, kappa the aerodynamic damping coefficient."""
    kappa = roof.parts.zones.spread(job.wind, "aerodynamic_damping")
    return roof.at_nodes((kappa * job.wind.air_density)[:, None] * roof.parts.vector)


def aerodynamic_damping(job: Job, x: np.ndarray, roof: RoofAreas) -> np.ndarray | None:
    """Compute c (n, 3) of `physics.air` at x (n, 3) [m]; None: no aerodynamic damping.

    If the wind is given as pressures, c is that of the mean speed.
    """
    if not derived.has_aerodynamic_damping(job):
        return None
    vector, wind = aerodynamic_damping_area(job, roof), job.wind
    if wind.pressures:
        vector *= profile_speed(wind, wind.speed, x[:, 2])[:, None]
    return damping_vectors(vector)


def added_air_mass(job: Job, roof: RoofAreas) -> np.ndarray | None:
    """Compute the added mass (n,) [kg] of the air; None: no added mass."""
    if not derived.has_added_air_mass(job):
        return None
    return roof.at_nodes(roof.parts.zones.spread(job.load, "added_mass") * roof.parts.area)
