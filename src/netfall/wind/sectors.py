"""The table of [wind] sectors: shape coefficients of the roof and its zones by the direction of the wind.

Between two directions of the table they are linear, also across 360 degrees.
"""

from dataclasses import dataclass, field

import numpy as np

from netfall.ground.errors import InputError
from netfall.job.job import Job
from netfall.job.table import Table

ROOF = "shape_coefficient"  # the column for what is in no zone, or in one without a column


def origin(direction: float) -> str:
    """Where a wind comes from that blows to a direction [degrees], from x towards y, in words."""
    return f"from {(direction + 180.0) % 360.0:g} degrees"


def bearing(direction: float) -> str:
    """Where a wind blows to, and where it comes from, in words."""
    return f"to {direction:g} degrees ({origin(direction)})"


@dataclass(frozen=True)
class Sectors:
    """direction : (d,) [degrees], where the wind blows to, ascending; of_zone : columns (d,) by zone."""

    direction: np.ndarray
    of_roof: np.ndarray
    of_zone: dict[str, np.ndarray]
    notes: list[str] = field(default_factory=list)

    def at(self, direction: float) -> tuple[float, dict[str, float]]:
        """The coefficient of the roof, and those of zones, for a wind in a direction [degrees]."""
        value = lambda column: float(np.interp(direction, self.direction, column, period=360.0))
        return value(self.of_roof), {name: value(column) for name, column in self.of_zone.items()}


def read_sectors(job: Job, zones: list[str]) -> Sectors:
    """The table of a job with columns direction, shape_coefficient, and those named as zones are.

    Raises InputError with all that is wrong in it.
    """
    path = job.path.parent / job.wind.sectors
    columns = {name.lower(): name for name in zones}  # as headers are read
    if len(columns) < len(zones):
        raise InputError(f"{path}: zones whose names differ in capital letters alone have the same column")
    table = Table(path, ("direction", ROOF, *columns), ("direction", ROOF))
    direction = table.numbers("direction", unit="degrees")
    for row in np.flatnonzero(~((direction >= 0) & (direction < 360)))[:3]:
        words = table.words("direction")[row][:40]
        table.wrong(f"{table.at(row)}: direction = {words!r}: expected a number of degrees >= 0 and < 360")
    table.ascending("direction", direction)
    found = {name: table.numbers(name) for name in (ROOF, *columns) if name in table}
    for name in found:
        table.full(name, 3)
        if ROOF in job.wind.zone.get(columns.get(name, ""), {}):
            both = f"[wind.zone.{columns[name]}] {ROOF} exclude each other; keep one of the two"
            table.wrong(f"column {name} and {both}")
    table.finish()
    of_roof = found.pop(ROOF)
    return Sectors(direction, of_roof, {columns[name]: v for name, v in found.items()}, table.notes)
