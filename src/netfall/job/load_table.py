"""Tables of loads, `load_table` of [load], cases and stages: loads of nodes, elements or zones.

Rows of zones become values of [load.zone.NAME], or of `set`. `loads.tables` reads rows of nodes and elements.
"""

from pathlib import Path
from typing import Any

import numpy as np

from netfall.job import messages
from netfall.job.csv_table import Table
from netfall.job.fields import keys_of
from netfall.job.models import LoadZone
from netfall.job.values import format_value

AXES = ("x", "y", "z")
ZONE_KEYS = ("dead", "snow", "pressure")  # keys of [load.zone.NAME] that are columns
PRESSURES = tuple(f"pressure_{axis}" for axis in AXES)  # components of a pressure [x, y, z]
COLUMNS = {  # columns of the loads of each kind of row
    "node": tuple(f"load_{axis}" for axis in AXES),
    "element": tuple(f"line_{axis}" for axis in AXES),
    "zone": (*ZONE_KEYS, *PRESSURES),
}
UNITS = {"node": "N", "element": "N/m", "zone": "N/m2"}  # of these columns; m of unstressed length


def open_load_table(path: Path) -> tuple[Table, str]:
    """Open a table of loads; return it and what its rows name: node, element or zone. Raises InputError."""
    known = (*COLUMNS, *(name for columns in COLUMNS.values() for name in columns))
    table = Table(path, known, ())
    given = [name for name in known if name in table]
    of_rows = [name for name in COLUMNS if name in table]
    loads = [name for name in given if name not in COLUMNS]
    if len(of_rows) != 1 or not loads or set(loads) - {*COLUMNS[of_rows[0]]}:
        table.wrong(messages.LOAD_COLUMNS(given=", ".join(given) or "none of them"))
        table.finish()
    return table, of_rows[0]


def zone_values(path: Path, zone_rows: dict[str, str]) -> dict[str, Any]:
    """Return the values of a table by names like "load.zone.NAME.snow"; none if it has no zones.

    zone_rows : place of the first row of each zone, which this adds to. Raises InputError.
    """
    table, of_rows = open_load_table(path)
    if of_rows != "zone":
        return {}
    columns = {name: table.numbers(name, unit=UNITS["zone"]).tolist() for name in ZONE_KEYS}
    vectors = table.stacked(PRESSURES, unit=UNITS["zone"])
    if "pressure" in table and np.isfinite(vectors).any():
        table.wrong(messages.EXCLUSIVE(keys=f"columns pressure and {', '.join(PRESSURES)}"))
    table.full("zone")
    values: dict[str, Any] = {}
    first: dict[str, str] = {}
    for row, zone in enumerate(table.words("zone")):
        if first.setdefault(zone, table.at(row)) != table.at(row):
            table.wrong(messages.ZONE_TWICE(row=table.at(row), name=format_value(zone), first=first[zone]))
        zone_rows.setdefault(zone, f"{path}: {table.at(row)}: zone")
        given = {name: column[row] for name, column in columns.items() if np.isfinite(column[row])}
        if np.isfinite(vectors[row]).any():
            given["pressure"] = np.nan_to_num(vectors[row]).tolist()
        for name, value in given.items():
            if not keys_of(LoadZone)[name].fits(value):
                expected, cell = keys_of(LoadZone)[name].expected(), format_value(value)
                table.wrong(messages.INVALID_CELL(row=table.at(row), name=name, cell=cell, expected=expected))
            values[f"load.zone.{zone}.{name}"] = value
    table.finish()
    return values
