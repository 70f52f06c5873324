"""Export of a result as a folder of tables: the complete form-found net, and a job that runs it again."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from netfall.core.errors import InputError
from netfall.core.functions import to_rotated_axes
from netfall.core.messages import count_of
from netfall.exchange import messages
from netfall.exchange.job_again import keeps_zones, write_rerun_job
from netfall.exchange.state import MARK, NET_RECORD, ExportState
from netfall.geometry.cables import meeting_pairs
from netfall.job.csv_table import AXES, ZONE_SEPARATOR, write_table
from netfall.results.locks import atomic_folder
from netfall.results.reader import Result
from netfall.results.states import support_angles

CONTENTS = None
FOLDER, STATIC_ONLY, UNITS = True, False, False
README_NAME = "README.txt"
FILES = ("nodes.csv", "elements.csv", "faces.csv", "job.toml", "history.csv", "events.csv", README_NAME)


def write(result: Result, state: ExportState, folder: Path, unit: str) -> list[str]:
    """Write nodes.csv, elements.csv and faces.csv, the job.toml that reads them, history and events.

    For a state in motion only the tables are written: positions of the points and forces of the elements.
    """
    is_export = _check_folder(folder)
    with atomic_folder(folder) as temporary:
        lines = [
            line.replace(str(temporary), str(folder)) for line in _write_tables(result, state, temporary)
        ]
        _check_copies(folder, temporary, is_export)
        (temporary / README_NAME).write_text(
            "\n".join([MARK, *lines, *state.warnings]) + "\n", encoding="utf-8"
        )
        for name in FILES:  # remove files of an earlier export that this export lacks
            if not (temporary / name).exists():
                (folder / name).unlink(missing_ok=True)
    return lines


def _write_tables(result: Result, state: ExportState, folder: Path) -> list[str]:
    """Write the files; return lines on what was written."""
    tables = _net_tables(result, state) if state.is_form else _in_motion(state)
    lines = [f"{folder}: {state.name}; coordinates in m, forces in N"]
    if hasattr(result, "history"):
        tables |= {"history": _history(result), "events": dict(result.events)}
    for name, columns in tables.items():
        write_table(folder / f"{name}.csv", columns)
        lines.append(f"{folder / name}.csv: {count_of(len(next(iter(columns.values()))), 'row')}")
    lines += state.removed_element_lines("rows")
    if state.is_form:
        lines += write_rerun_job(result, state, folder, "faces" in tables, FILES)
    else:
        lines.append(messages.WITHOUT_LOADS(state=state.name))
    return lines


def _check_folder(folder: Path) -> bool:
    """Whether netfall exported the content of the folder. Raises InputError for tables of the user."""
    about = folder / README_NAME
    is_export = about.is_file() and about.read_text(encoding="utf-8", errors="replace").startswith(MARK)
    existing = [name for name in FILES if (folder / name).exists()]
    if existing and not is_export:
        raise InputError(messages.FOREIGN_TABLE(folder=folder, file=existing[0]))
    return is_export


def _check_copies(folder: Path, temporary: Path, is_export: bool) -> None:
    """Check that no copy replaces a file of the user. Raises InputError."""
    for copy in sorted(temporary.iterdir()):
        target = folder / copy.name
        if not is_export and target.exists() and target.read_bytes() != copy.read_bytes():
            raise InputError(messages.OTHER_COPY(folder=folder, file=copy.name))


def _in_motion(state: ExportState) -> dict[str, dict[str, Any]]:
    """Return the tables of a state in motion."""
    elements = _ends(state) | {"group": state.group} | state.unstressed()
    elements |= {"tension": state.tension, "broken": state.broken.astype(int)}
    present = ~state.out()
    return {"nodes": _places(state), "elements": {name: each[present] for name, each in elements.items()}}


def _net_tables(result: Result, state: ExportState) -> dict[str, dict[str, Any]]:
    """Return the tables of the form-found net, without nodes of removed elements."""
    present, nodes = ~state.out(), _places(state) | _node_columns(result, state)
    elements, faces = _ends(state) | _element_columns(result, state), _faces(result, state)
    used = state.connected()
    tables = {
        "nodes": {name: values[used] for name, values in nodes.items()},
        "elements": {name: values[present] for name, values in elements.items()},
    }
    return tables | ({"faces": faces} if len(faces["face"]) else {})


def _places(state: ExportState) -> dict[str, np.ndarray]:
    """Return the columns of node ids, coordinates and supports."""
    columns = {"id": state.node_id, **{k: state.position[:, i] for i, k in enumerate(AXES)}}
    return columns | {f"fixed_{k}": state.fixed[:, i].astype(int) for i, k in enumerate(AXES)}


def _ends(state: ExportState) -> dict[str, np.ndarray]:
    """Return the columns of element ids and end nodes."""
    start, end = state.node_id[state.ends].T
    return {"id": state.element_id, "start": start, "end": end}


def _recorded(result: Result, name: str, rows: int) -> np.ndarray:
    """Return a column (rows, ...) of the net as it was built."""
    values = result.file[f"{NET_RECORD}/{name}"][:]
    return np.broadcast_to(values, (rows, *values.shape[1:])) if len(values) == 1 else values


def _node_columns(result: Result, state: ExportState) -> dict[str, np.ndarray]:
    """Return loads, masses, areas, normals, springs and zones of the nodes, if the net has them."""
    net, n = result.file["net"], len(result.nodes["id"])
    angle = support_angles(result.file)
    columns: dict[str, np.ndarray] = {}
    recorded = partial(_recorded, result, rows=n)
    for name, values in (("load", recorded("load")), ("normal", recorded("normal"))):
        if (values[np.isfinite(values)] != 0.0).any():
            columns |= {f"{name}_{k}": values[:, i] for i, k in enumerate(AXES)}
    if recorded("mass").any():
        columns["mass"] = recorded("mass")
    if np.isfinite(recorded("area")).any():
        columns["area"] = recorded("area")
    if "spring" in net:
        spring, rest = net["spring"][:], to_rotated_axes(recorded("spring_rest"), angle)
        for name, values in (("spring", spring), ("spring_rest", np.where(spring > 0.0, rest, 0.0))):
            columns |= {f"{name}_{k}": values[:, i] for i, k in enumerate(AXES)}
    if angle is not None:
        columns["angle"] = angle
    if (net["zone"][:] >= 0).any() and not keeps_zones(result, state):
        columns |= _zone_columns(result)
    return columns


def _zone_columns(result: Result) -> dict[str, np.ndarray]:
    """Return the zone of each node; for a node in several zones, all names and shares."""
    zone, net = result.nodes["zone"].astype(object), result.file["net"]
    if "zone_share" not in net:
        return {"zone": zone}
    names, share = net["zone_names"].asstr()[:], net["zone_share"][:]
    share_text = np.full(len(zone), "", object)
    for row in np.flatnonzero(((share > 0) & (share < 1)).any(1)):
        is_in = share[row] > 0
        zone[row] = ZONE_SEPARATOR.join(names[is_in])
        share_text[row] = ZONE_SEPARATOR.join(map(repr, share[row, is_in].tolist()))
    return {"zone": zone, "zone_share": share_text}


def _element_columns(result: Result, state: ExportState) -> dict[str, np.ndarray]:
    """Return kinds, lengths, cables, sections and strengths of the elements.

    Strengths are those before the random draw.
    """
    net, m = result.file["net"], len(state.ends)
    recorded = partial(_recorded, result, rows=m)
    has_factors = "strength" in net and not state.out().any()  # a reduced net has other numbers
    factor = net["strength"][:] if has_factors else np.ones(m)
    columns = {"group": state.group, "kind": np.where(net["bar"][:].astype(bool), "bar", "cable")}
    columns["unstressed_length"] = state.unstressed_length
    columns["cable"] = _cable_names(result)
    columns |= {"area": recorded("section"), "modulus": recorded("modulus"), "density": recorded("density")}
    columns["expansion"] = net["expansion"][:]
    strengths = {name: recorded(name) for name in ("yield_stress", "breaking_load", "fracture_strain")}
    strain_at_load = strengths["breaking_load"] / (recorded("modulus") * recorded("section"))
    is_own = strengths["fracture_strain"] < strain_at_load
    strengths["fracture_strain"] = np.where(is_own, strengths["fracture_strain"], np.inf)
    for name, values in strengths.items():
        if np.isfinite(values).any():
            undrawn = strength_before_draw(values, factor)
            columns[name] = np.where(np.isfinite(undrawn), undrawn, np.nan)
    if "type" in net:
        names = np.append(net["type_names"].asstr()[:], "").astype(str)
        columns["type"] = names[net["type"][:]]
    return columns


def _cable_names(result: Result) -> np.ndarray:
    """Return the name of the cable (m,) of each element; "" if the name would join bars with bending.

    Where more than two bars of a group meet, chains of bars end, but not those of a name in the table.
    """
    net, cable = result.file["net"], result.file["net/cable"][:]
    names = net["cable_names"].asstr()[:].astype(str)
    if "second_moment" in net:
        bars = np.flatnonzero(np.isfinite(net["second_moment"][:]))
        ends, node = (2 * bars[:, None] + [0, 1]).ravel(), net["elements"][:].ravel()
        named, grouped = (meeting_pairs(ends, node, kind) for kind in (cable, net["group"][:]))
        for k in np.unique(cable[named[~np.isin(named, grouped).all(1)] // 2]):
            if names[k] == f"e{result.elements['id'][cable == k].min()}":  # the table of the run has no name
                names[k] = ""
    return names[cable]


def strength_before_draw(value: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """Find the smallest numbers (m,) whose product with the factor (m,) reaches the value (m,) exactly."""
    with np.errstate(over="ignore"):
        quotient = value / factor
        for _ in range(2):
            smaller = np.nextafter(quotient, 0.0)
            quotient = np.where(np.isfinite(quotient) & (smaller * factor >= value), smaller, quotient)
        for _ in range(2):
            quotient = np.where(quotient * factor >= value, quotient, np.nextafter(quotient, np.inf))
    return quotient


def _faces(result: Result, state: ExportState) -> dict[str, np.ndarray]:
    """Return the faces, one row for each corner of each ring; corners without elements have coordinates."""
    start, corner, face, extra = (
        result.file[f"{NET_RECORD}/{name}"][:]
        for name in ("ring_start", "ring_corner", "ring_face", "corners")
    )
    n, ring = len(result.nodes["id"]), np.repeat(np.arange(len(face)), np.diff(start))
    hole = np.arange(len(face)) - np.searchsorted(face, face)
    points = np.concatenate([state.position[:n], extra])
    is_node = np.isin(corner, np.flatnonzero(state.connected()))
    node = np.where(is_node, state.node_id[np.where(is_node, corner, 0)].astype(object), "")
    columns = {"face": face[ring]} | ({"ring": hole[ring]} if hole.any() else {}) | {"node": node}
    if not is_node.all():
        coordinates = np.full((len(corner), 3), np.nan)
        coordinates[~is_node] = points[corner[~is_node]]
        columns |= {k: coordinates[:, i] for i, k in enumerate(AXES)}
    return columns


def _history(result: Result) -> dict[str, np.ndarray]:
    """Return the columns of /history, with probes named by the ids of their nodes and elements."""
    history = result.history
    by_id = ("probe", "element")
    columns = {name: history[name] for name in history if not name.startswith(by_id)}
    if "probe_particle" in history:
        nodes = result.nodes["id"][history["probe_particle"]]
        for row, node in enumerate(nodes):
            for i, k in enumerate(AXES):
                columns[f"displacement_{k} of node {node}"] = history["probe_displacement"][:, row, i]
    for tension, elements in (("probe_tension", "probe_element"), ("element_tension", "element")):
        for row, element in enumerate(history[elements] if tension in history else ()):
            columns[f"tension of element {_named(result, element)}"] = history[tension][:, row]
    return columns


def _named(result: Result, element: int) -> str:
    """Return the id of an element, with its nodes if several elements share the id."""
    ids, rows = result.elements["id"], result.elements
    nodes = f" ({rows['start'][element]}-{rows['end'][element]})"
    return f"{ids[element]}{nodes if (ids == ids[element]).sum() > 1 else ''}"
