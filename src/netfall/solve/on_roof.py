"""What acts on the roof node by node, with its zones: coefficients of the wind, and values for the result."""

from types import SimpleNamespace

import numpy as np

from netfall.job.read import Job
from netfall.net.zones import Zones
from netfall.solve.unused import idle_zones
from netfall.wind.field import WindField
from netfall.wind.sectors import read_sectors


def shape_coefficients(job: Job, zones: Zones) -> tuple[np.ndarray | None, list[str]]:
    """Coefficient (n,) of each node, for the wind's direction if there are sectors; notes.

    None without wind. Raises InputError for a wrong table.
    """
    wind = job.wind
    sectors = read_sectors(job, zones.names) if wind and wind.sectors else None
    notes = (sectors.notes if sectors else []) + idle_zones(job, zones, sectors)
    if sectors is None:
        return zones.spread(wind, "shape_coefficient") if wind else None, notes
    of_roof, of_zone = sectors.at(wind.direction)
    own = {name: values["shape_coefficient"] for name, values in wind.zone.items() if values}
    return zones.by_node(of_roof, own | of_zone), notes


def by_node(job: Job, coefficient: np.ndarray) -> SimpleNamespace:
    """The section [wind] with the shape coefficient (n,) of each node."""
    return SimpleNamespace(**(vars(job.wind) | {"shape_coefficient": coefficient}))


def mean_pressure(job: Job, coefficient: np.ndarray, field: WindField, mean_gust: np.ndarray) -> np.ndarray:
    """Pressure (n,) [N/m2] of the mean wind, positive where it presses on the roof: u_s rho U^2 / 2.

    coefficient : (n,); mean_gust : (c,) [m/s] at the control points, beyond the mean of the field
    """
    square = field.mean_square(mean_gust)
    return square if field.tapped else coefficient * (0.5 * job.wind.air_density) * square


def load_section(job: Job, zones: Zones) -> dict[str, np.ndarray]:
    """The datasets of /load: snow and pressure (n,) [N/m2], temperature [K], of what has any.

    A pressure along axes is nan; of a node in several zones the mean by their shares.
    """
    if job.load is None:
        return {}
    found = {"temperature": np.float64(job.load.temperature)} if job.load.temperature else {}
    if any(value for value, _ in zones.parts(job.load, "snow")):
        found["snow"] = zones.spread(job.load, "snow")
    parts = zones.parts(job.load, "pressure")
    if any(isinstance(value, int | float) for value, _ in parts):
        found["pressure"] = np.zeros(len(zones.of_node))
        for value, share in parts:
            along_axes = np.where(share > 0.0, np.nan, 0.0)
            found["pressure"] += along_axes if isinstance(value, list) else share * (value or 0.0)
    return found
