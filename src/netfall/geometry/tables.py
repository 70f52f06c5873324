"""Net of two tables, nodes and elements: columns, units, ends, and plausibility."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray, rows_of
from netfall.core.errors import InputError
from netfall.core.functions import from_rotated_axes, log
from netfall.geometry import messages
from netfall.geometry.net import Net, pair_key, unconnected_pairs
from netfall.job import messages as job_messages
from netfall.job.csv_table import AXES, MAX_CELL, NO_UNIT, ZONE_SEPARATOR, Table, parse_number
from netfall.job.job import Job
from netfall.job.keys.fields import keys_of
from netfall.job.keys.models import MAX_EXPANSION, MIN_EXPANSION, Cable
from netfall.job.values import format_list

MIN_POSITIVE = 1e-12  # smallest value of a positive column
NODE_COLUMNS = (
    *("id", *AXES, "fixed", *(f"fixed_{k}" for k in AXES), *(f"load_{k}" for k in AXES), "mass", "area"),
    *(f"{name}_{k}" for name in ("normal", "spring", "spring_rest") for k in AXES),
    *("angle", "zone", "zone_share"),
)
ELEMENT_COLUMNS = (
    *("start", "end", "id", "group", "prestress", "force_density", "unstressed_length", "area", "modulus"),
    *("cable", "breaking_load", "yield_stress", "fracture_strain", "type", "kind", "density", "expansion"),
)
COLUMN_OF_KEY = {"thermal_expansion": 'its name here is "expansion"'}
SECTION_LIMITS = {  # columns of the elements that override sections: smallest value, unit, largest value
    "prestress": (-MAX_CELL, "N", MAX_CELL),
    "area": (1e-12, "m2", MAX_CELL),
    "modulus": (1.0, "Pa", MAX_CELL),
    "breaking_load": (MIN_POSITIVE, "N", MAX_CELL),
    "yield_stress": (MIN_POSITIVE, "Pa", MAX_CELL),
    "fracture_strain": (MIN_POSITIVE, "", MAX_CELL),
    "density": (MIN_POSITIVE, "kg/m3", MAX_CELL),
    "expansion": (MIN_EXPANSION, "1/K", MAX_EXPANSION),
}
TO_METRES = {"m": (1, 1), "cm": (1, 100), "mm": (1, 1000), "ft": (3048, 10000), "in": (254, 10000)}
UNIT_ROUNDING = 4e-16  # rounding error of the length of a unit normal
SHARE_SUM_ROUNDING = 1e-9  # rounding error of the sum of shares
LENGTH_LOG_TOLERANCE = 0.2  # |log(ratio of two lengths)| below which they are probably the same length


def read_tables(job: Job) -> tuple[Net, dict[str, np.ndarray]]:
    """Read the net of a job's tables, and the columns that override its sections, (m,) nan: not given.

    Raises InputError with all errors in the tables.
    """
    nodes = Table(job.path.parent / job.net.nodes, NODE_COLUMNS, ("id", *AXES))
    cables = Table(job.path.parent / job.net.elements, ELEMENT_COLUMNS, ("start", "end"))
    for name in (name for name in keys_of(Cable) if name in cables and name not in ELEMENT_COLUMNS):
        remedy = COLUMN_OF_KEY.get(name, "this is a key of [cable] and [group.NAME]. Give it there.")
        cables.wrong(job_messages.UNKNOWN_COLUMN(line=cables.header_line, name=name, suggestion=remedy))
    of_nodes = _node_columns(job, nodes)
    of_elements, names, columns = _element_columns(cables, nodes, of_nodes["node_id"])
    nodes.finish(cables)
    _lengths_in_metres(job, of_nodes["x"], of_elements)
    net = Net(**of_nodes, **of_elements, group_names=names, notes=nodes.notes + cables.notes)
    key = pair_key(net.elements, net.n)
    several, times = np.unique(key, return_counts=True)
    if parallel := [" and ".join(map(str, net.element_id[key == k])) for k in several[times > 1]]:
        net.notes.append(messages.PARALLEL_ELEMENTS(elements=format_list(parallel)))
    if close_names := [
        f"{net.node_id[a]} and {net.node_id[b]}, {1e3 * np.linalg.norm(net.x[a] - net.x[b]):.3g} mm apart"
        for a, b in unconnected_pairs(net.x, net.elements, net.tolerance)
    ]:
        net.notes.append(messages.CLOSE_NODES(pairs=format_list(close_names)))
    return net, columns


def read_lines(job: Job, node_id: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Read the edges of faces without an element (k, 2), [roof] lines, and notes. Raises InputError."""
    if not (job.roof and job.roof.lines):
        return np.zeros((0, 2), np.int64), []
    table = Table(job.path.parent / job.roof.lines, ("start", "end"), ("start", "end"))
    lines = _pairs(table, node_id, job.net.nodes or "the net")
    table.finish()
    return lines, table.notes


def _pairs(table: Table, node_id: np.ndarray, nodes: str) -> np.ndarray:
    """Return the columns start and end (m, 2) as node rows; nodes : name of the table of nodes."""
    ends = np.column_stack([_ends(table, k, node_id, nodes) for k in ("start", "end")])
    for row in np.flatnonzero((ends[:, 0] == ends[:, 1]) & (ends[:, 0] >= 0)):
        table.wrong(messages.SAME_NODE(row=table.at(int(row)), node=node_id[ends[row, 0]]))
    return ends


def _ends(table: Table, name: str, node_id: np.ndarray, nodes: str) -> np.ndarray:
    """Return the rows of the nodes in one column, -1: unknown."""
    numbers = table.integers(name)
    is_integer = numbers >= -MAX_CELL
    rows = np.where(is_integer, rows_of(node_id, numbers), -1)
    has_ids = (node_id >= -MAX_CELL).all()  # otherwise some ids have errors
    for row in np.flatnonzero((rows < 0) & is_integer & has_ids).tolist():
        place, number = table.at(row), numbers[row]
        table.wrong(messages.NO_SUCH_NODE(row=place, name=name, number=number, nodes=nodes))
    return rows


def _node_columns(job: Job, nodes: Table) -> dict[str, Any]:
    """Read the columns of the nodes for `Net`."""
    unit = job.net.unit
    factor, divisor = TO_METRES[unit]
    x = nodes.stacked(AXES, unit=unit) * factor / divisor
    node_id = nodes.integers("id")
    for k in AXES:
        nodes.full(k)
    if any(nodes.units.get(k, "-") not in NO_UNIT for k in AXES) and "net.unit" in job.given():
        nodes.wrong(job_messages.EXCLUSIVE(keys="units below the header and [net] unit"))
    _, first, number = np.unique(node_id, return_index=True, return_inverse=True)
    for row in np.flatnonzero(first[number] != np.arange(len(node_id))).tolist():
        place, other = nodes.at(row), nodes.at(int(first[number[row]]))
        nodes.wrong(messages.DUPLICATE_NODE_ID(row=place, number=node_id[row], first=other))
    angle = nodes.numbers("angle", 0.0, unit="degrees") if "angle" in nodes else None

    def vectors(name: str, low: float, unit: str) -> FloatArray:
        return nodes.stacked([f"{name}_{k}" for k in AXES], 0.0, low, unit)

    spring, rest = vectors("spring", 0.0, "N/m"), vectors("spring_rest", -MAX_CELL, "m")
    for row, k in np.argwhere((rest != 0.0) & (spring == 0.0))[:1]:
        key = f"{nodes.at(row)}: spring_rest_{AXES[k]}"
        nodes.wrong(job_messages.NEEDS(key=key, needed=f"spring_{AXES[k]}"))
    return dict(
        x=x,
        fixed=_fixed(nodes),
        node_id=node_id,
        load=vectors("load", -MAX_CELL, "N"),
        mass=nodes.numbers("mass", 0.0, low=0.0, unit="kg"),
        area=nodes.numbers("area", low=0.0, unit="m2"),
        normal=_normals(nodes, job.roof.normal if job.roof else None),
        spring=spring,
        spring_rest=from_rotated_axes(rest, angle),
        angle=angle,
        **_zone_column(nodes),
    )


def _zone_column(nodes: Table) -> dict[str, Any]:
    """Return the zone names, the row of each node's zone, -1: none, and shares if the table has them.

    A node in several zones has "edge/drift" with the shares "0.25/0.5".
    """
    if "zone" not in nodes and "zone_share" not in nodes:
        return {}
    words = nodes.words("zone")
    cells = [
        (word.split(ZONE_SEPARATOR), _shares_in(nodes, row, share, word)) if share else ([word], [1.0])
        for row, (word, share) in enumerate(zip(words, nodes.words("zone_share")))
    ]
    for row, (zones, _) in enumerate(cells):
        if wrong := [name for name in zones if name in (".", "..") or ZONE_SEPARATOR in name]:
            place, expected = nodes.at(row), f"a name without {ZONE_SEPARATOR}, other than . and .."
            nodes.wrong(job_messages.INVALID_CELL(row=place, name="zone", cell=wrong[0], expected=expected))
    if "zone_share" not in nodes:
        all_names, row_of_name = np.unique(["", *words], return_inverse=True)
        return {"zone": row_of_name[1:] - 1, "zone_names": [str(name) for name in all_names[1:]]}
    names = sorted({name for zones, _ in cells for name in zones} - {""})
    share = np.zeros((len(nodes), len(names)))
    for row, (zones, values) in enumerate(cells):
        for name, value in zip(zones, values):
            if name:
                share[row, names.index(name)] += value
    zone = np.where(share.any(1), np.argmax(share, axis=1), -1) if names else np.full(len(nodes), -1)
    return {"zone": zone, "zone_names": names, "zone_share": share}


def _shares_in(nodes: Table, row: int, cell: str, zone: str) -> list[float]:
    """Return the shares of a cell, one per zone of the zone cell; report cells that do not match."""
    values = [parse_number(word) for word in cell.split(ZONE_SEPARATOR)]
    names = zone.split(ZONE_SEPARATOR)
    fit = len(values) == len(set(names)) == len(names) and all(names)
    if not (fit and all(0.0 < value <= 1.0 for value in values) and sum(values) <= 1.0 + SHARE_SUM_ROUNDING):
        nodes.wrong(messages.WRONG_SHARES(row=nodes.at(row), cell=cell[:40], zone=zone[:40]))
        return []
    return values


def _element_columns(cables: Table, nodes: Table, node_id: np.ndarray) -> tuple[Any, ...]:
    """Read the columns of the elements for `Net`, the group names, and the columns that override sections."""
    ends = _pairs(cables, node_id, nodes.path.name)
    element_id = cables.integers("id") if "id" in cables else np.arange(len(cables))
    if len(np.unique(element_id)) < len(element_id):
        values, counts = np.unique(element_id, return_counts=True)
        number = values[counts > 1][0]
        cables.wrong(messages.DUPLICATE_ELEMENT_ID(number=number, count=counts.max()))
    names, group = np.unique(cables.words("group"), return_inverse=True)
    columns: dict[str, Any] = {
        name: cables.numbers(name, low=low, unit=unit, high=high)
        for name, (low, unit, high) in SECTION_LIMITS.items()
    }
    kinds = {"": np.nan, "cable": 0.0, "bar": 1.0}
    words = cables.words("kind")
    for row, word in enumerate(words):
        if word not in kinds:
            place, expected = cables.at(row), '"cable" or "bar"'
            cables.wrong(job_messages.INVALID_CELL(row=place, name="kind", cell=word[:40], expected=expected))
    columns["kind"] = np.array([kinds.get(word, np.nan) for word in words])
    columns["type"] = cables.words("type") if "type" in cables else []
    of_elements: dict[str, Any] = dict(
        elements=ends,
        group=group,
        element_id=element_id,
        cable_given=cables.words("cable") if "cable" in cables else [],
        force_density=cables.numbers("force_density", unit="N/m"),
        unstressed_length=cables.numbers("unstressed_length", low=1e-9, unit="m"),
    )
    return of_elements, [str(name) for name in names], columns


def _lengths_in_metres(job: Job, x: np.ndarray, of_elements: dict[str, Any]) -> None:
    """Report unstressed lengths that match the elements in the unit of the coordinates. x : (n, 3) [m]"""
    given, (factor, divisor) = of_elements["unstressed_length"], TO_METRES[job.net.unit]
    distance = np.linalg.norm(np.diff(x[of_elements["elements"]], axis=1)[:, 0], axis=1)
    known = np.isfinite(given) & (distance > 0.0)
    if factor == divisor or not known.any():
        return
    ratio = float(np.median(log(given[known] / distance[known])))
    if abs(ratio - float(log(divisor / factor))) < LENGTH_LOG_TOLERANCE:
        raise InputError(messages.LENGTHS_IN_NET_UNIT(path=job.net.elements, unit=job.net.unit))


def _fixed(nodes: Table) -> np.ndarray:
    """Return the held axes (n, 3) of the nodes."""
    if "fixed" in nodes and any(f"fixed_{k}" in nodes for k in AXES):
        nodes.wrong(job_messages.EXCLUSIVE(keys="columns fixed and fixed_x, fixed_y, fixed_z"))
    held = {}
    for name in ("fixed", *(f"fixed_{k}" for k in AXES)):
        if name in nodes:
            words = nodes.words(name)
            held[name] = np.array([parse_number(word or "0") for word in words])
            for row in np.flatnonzero((held[name] != 0) & (held[name] != 1)):
                place, cell = nodes.at(int(row)), words[row][:40]
                nodes.wrong(job_messages.INVALID_CELL(row=place, name=name, cell=cell, expected="0 or 1"))
    all_axes = held.get("fixed", np.zeros(len(nodes)))
    return np.column_stack([held.get(f"fixed_{k}", all_axes) for k in AXES]) == 1


def _normals(nodes: Table, outward: Sequence[float] | None) -> np.ndarray:
    """Return the upward unit normals (n, 3), nan if none is given. outward : `[roof] normal`, None: upward"""
    present = [f"normal_{k}" in nodes for k in AXES]
    if any(present) and not all(present):
        nodes.wrong(messages.NORMAL_COLUMN_MISSING())
    normal = nodes.stacked([f"normal_{k}" for k in AXES])
    given, length = np.isfinite(normal), np.linalg.norm(normal, axis=1, keepdims=True)
    for row in np.flatnonzero(given.any(1) & ~given.all(1) & all(present)):
        nodes.wrong(messages.INCOMPLETE_NORMAL(row=nodes.at(int(row))))
    side = messages.OUTWARD_NORMAL if outward else messages.UPWARD_NORMAL
    is_outward = normal @ np.array(outward or (0.0, 0.0, 1.0)) >= 0
    for row in np.flatnonzero(given.all(1) & ~((length[:, 0] > 0) & is_outward)):
        shown = ", ".join(f"{value:g}" for value in normal[row])
        nodes.wrong(messages.WRONG_NORMAL(row=nodes.at(int(row)), normal=shown, side=side))
    length[np.abs(length - 1.0) <= UNIT_ROUNDING] = 1.0  # a unit normal is read with the same bits
    return np.divide(normal, length, out=np.full_like(normal, np.nan), where=length > 0)
