"""Table of [wind] sectors: net pressure coefficients of the roof and its zones by wind direction.

Coefficients are linear between two directions of the table, also across 360 degrees.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from netfall.core.errors import InputError
from netfall.job import messages as job_messages
from netfall.job.csv_table import Table, parse_number
from netfall.job.job import Job
from netfall.job.values import suggest
from netfall.loads import messages

ROOF_COLUMN = "pressure_coefficient"  # column of nodes in no zone, or in a zone without a column


def describe_origin(direction: float) -> str:
    """Describe the origin of a wind that blows to a direction [degrees], from x towards y."""
    return f"from {(direction + 180.0) % 360.0:g} degrees"


def describe_direction(direction: float) -> str:
    """Describe the direction that a wind blows to, and its origin."""
    return f"to {direction:g} degrees ({describe_origin(direction)})"


@dataclass(frozen=True)
class Sectors:
    """Coefficients by direction (d,) [degrees] that the wind blows to, ascending; of_zone : by zone."""

    direction: np.ndarray
    of_roof: np.ndarray
    of_zone: dict[str, np.ndarray]
    notes: list[str] = field(default_factory=list)

    def at(self, direction: float) -> tuple[float, dict[str, float]]:
        """Return the coefficients of the roof and of the zones for a wind to a direction [degrees]."""

        def value(column: Any) -> Any:
            return float(np.interp(direction, self.direction, column, period=360.0))

        return value(self.of_roof), {name: value(column) for name, column in self.of_zone.items()}


def read_sectors(job: Job, zones: list[str]) -> Sectors | None:
    """Read the table of a job with columns direction, pressure_coefficient, and one per zone name.

    Returns None without a table. Raises InputError with all errors in it.
    """
    if not (job.wind and job.wind.sectors):
        return None
    path = job.path.parent / job.wind.sectors
    columns = {name.lower(): name for name in zones}  # headers are read in lower case
    if len(columns) < len(zones):
        raise InputError(messages.ZONES_DIFFER_BY_CASE(path=path))
    known = ("direction", ROOF_COLUMN, *columns)
    table = Table(path, known, ("direction", ROOF_COLUMN))
    direction = table.numbers("direction", unit="degrees")
    for row in np.flatnonzero(~((direction >= 0) & (direction < 360)))[:3]:
        cell = table.words("direction")[row][:40]
        table.wrong(messages.SECTOR_DIRECTION(row=table.at(row), cell=cell))
    table.ascending("direction", direction)
    for name in [name for name in table.columns if name not in known]:
        if any(np.isfinite(parse_number(word)) for word in table.words(name)):  # no column of remarks
            suggestion = suggest(name, known)
            line = table.header_line
            table.wrong(job_messages.UNKNOWN_COLUMN(line=line, name=name[:40], suggestion=suggestion))
    coefficients = {name: table.numbers(name) for name in (ROOF_COLUMN, *columns) if name in table}
    for name in coefficients:
        table.full(name, 3)
        if columns.get(name) in job.wind.zone_values(ROOF_COLUMN):
            zone = columns[name]
            table.wrong(messages.SECTOR_CONFLICT(column=name, zone=zone, key=ROOF_COLUMN))
    table.finish()
    of_roof = coefficients.pop(ROOF_COLUMN)
    return Sectors(direction, of_roof, {columns[name]: v for name, v in coefficients.items()}, table.notes)
