"""A result as a folder of tables: the net in its form with all that it has, and a job that runs it again."""

import hashlib
from pathlib import Path

import numpy as np

from netfall.exchange.job_again import job_again
from netfall.exchange.state import AXES, MARK, RECORD, State
from netfall.ground.errors import InputError
from netfall.job.table import SEVERAL, write_table
from netfall.numerics.rotation import to_own
from netfall.results.result import Result
from netfall.results.states import support_angles
from netfall.write.locks import whole_folder

HOLDS = None
FOLDER, AT_REST, UNITS = True, False, False
ABOUT = "README.txt"
OWN = ("nodes.csv", "elements.csv", "faces.csv", "job.toml", "history.csv", "events.csv", ABOUT)
DIGITS = 16  # of the digest


def write(result: Result, state: State, folder: Path, unit: str) -> list[str]:
    """nodes.csv, elements.csv and faces.csv, from which job.toml makes the same net; history and events.

    In motion the tables alone: where the points are then, and what elements carry.
    """
    ours = _check_folder(folder)
    with whole_folder(folder) as place:
        told = [line.replace(str(place), str(folder)) for line in _written(result, state, place)]
        _check_copies(folder, place, ours)
        (place / ABOUT).write_text("\n".join([MARK, *told]) + "\n", encoding="utf-8")
        for name in OWN:  # what an export before has left and this one does not write
            if not (place / name).exists():
                (folder / name).unlink(missing_ok=True)
    return told


def _written(result: Result, state: State, folder: Path) -> list[str]:
    """Write the files; what is said of them."""
    tables = _of_the_net(result, state) if state.is_form else _in_motion(state)
    told = [f"{folder}: {state.name}; coordinates in m, forces in N"]
    if hasattr(result, "history"):
        tables |= {"history": _history(result), "events": dict(result.events)}
    for name, columns in tables.items():
        write_table(folder / f"{name}.csv", columns)
        told.append(f"{folder / name}.csv: {len(next(iter(columns.values())))} rows")
    if state.is_form:
        told += state.told_out("rows")
        told += job_again(result, state, folder, "faces" in tables, OWN)
        told.append(f"digest of the net: {digest(folder)}, of the three tables; the same net has the same")
    else:
        told.append(f"note: {state.name}, without loads, masses, springs and sections: those are of the form")
    return told


def digest(folder: Path) -> str:
    """Of the tables that make the net, as they stand: a net that is read and written again has the same."""
    total = hashlib.sha256()
    for name in OWN[:3]:
        if (folder / name).exists():
            total.update(name.encode() + b"\n" + (folder / name).read_bytes())
    return total.hexdigest()[:DIGITS]


def _check_folder(folder: Path) -> bool:
    """Whether netfall exported what is in the folder. Raises InputError for tables of the user's."""
    about = folder / ABOUT
    ours = about.is_file() and about.read_text(encoding="utf-8", errors="replace").startswith(MARK)
    there = [name for name in OWN if (folder / name).exists()]
    if there and not ours:
        raise InputError(
            f"-o {folder}: has {there[0]} already, which is not what netfall exported; give another name"
        )
    return ours


def _check_copies(folder: Path, place: Path, ours: bool) -> None:
    """Raises InputError for a file of the user's that a copy of another one would replace."""
    for copy in sorted(place.iterdir()):
        there = folder / copy.name
        if not ours and there.exists() and there.read_bytes() != copy.read_bytes():
            raise InputError(f"-o {folder}: has another {copy.name} already; give another name")


def _in_motion(state: State) -> dict[str, dict]:
    """The tables of a moment."""
    elements = _ends(state) | {"group": state.group, "unstressed_length": state.unstressed_length}
    elements |= {"tension": state.tension, "broken": state.broken.astype(int)}
    return {"nodes": _places(state), "elements": elements}


def _of_the_net(result: Result, state: State) -> dict[str, dict]:
    """The tables of the net in its form."""
    there, elements = ~state.out(), _ends(state) | _element_columns(result, state)
    tables = {
        "nodes": _places(state) | _node_columns(result),
        "elements": {name: values[there] for name, values in elements.items()},
    }
    faces = _faces(result, state)
    return tables | ({"faces": faces} if len(faces["face"]) else {})


def _places(state: State) -> dict[str, np.ndarray]:
    columns = {"id": state.node_id, **{k: state.position[:, i] for i, k in enumerate(AXES)}}
    return columns | {f"fixed_{k}": state.fixed[:, i].astype(int) for i, k in enumerate(AXES)}


def _ends(state: State) -> dict[str, np.ndarray]:
    start, end = state.node_id[state.ends].T
    return {"id": state.element_id, "start": start, "end": end}


def _recorded(result: Result, name: str, rows: int) -> np.ndarray:
    """A column (rows, ...) of the net as it was built."""
    values = result.file[f"{RECORD}/{name}"][:]
    return np.broadcast_to(values, (rows, *values.shape[1:])) if len(values) == 1 else values


def _node_columns(result: Result) -> dict[str, np.ndarray]:
    """Loads, masses, areas, normals, springs and zones, those of them that the net has."""
    net, n = result.file["net"], len(result.nodes["id"])
    of = lambda name: _recorded(result, name, n)
    angle = support_angles(result.file)
    found: dict[str, np.ndarray] = {}
    for name, values in (("load", of("load")), ("normal", of("normal"))):
        if (values[np.isfinite(values)] != 0.0).any():
            found |= {f"{name}_{k}": values[:, i] for i, k in enumerate(AXES)}
    if of("mass").any():
        found["mass"] = of("mass")
    if np.isfinite(of("area")).any():
        found["area"] = of("area")
    if "spring" in net:
        rest = to_own(of("spring_rest"), angle)
        for name, values in (("spring", net["spring"][:]), ("spring_rest", rest)):
            found |= {f"{name}_{k}": values[:, i] for i, k in enumerate(AXES)}
    if angle is not None:
        found["angle"] = angle
    if (net["zone"][:] >= 0).any():
        found |= _zone_columns(result)
    return found


def _zone_columns(result: Result) -> dict[str, np.ndarray]:
    """The zone of each node; of one in several all of them, and its shares beside."""
    zone, net = result.nodes["zone"].astype(object), result.file["net"]
    if "zone_share" not in net:
        return {"zone": zone}
    names, share = net["zone_names"].asstr()[:], net["zone_share"][:]
    beside = np.full(len(zone), "", object)
    for row in np.flatnonzero(((share > 0) & (share < 1)).any(1)):
        there = share[row] > 0
        zone[row] = SEVERAL.join(names[there])
        beside[row] = SEVERAL.join(map(repr, share[row, there].tolist()))
    return {"zone": zone, "zone_share": beside}


def _element_columns(result: Result, state: State) -> dict[str, np.ndarray]:
    """Kinds, lengths, pieces of cable, sections and strengths; these as they were before they were drawn."""
    net, m = result.file["net"], len(state.ends)
    of = lambda name: _recorded(result, name, m)
    drawn = "strength" in net and not state.out().any()  # else pieces of cable have other numbers
    factor = net["strength"][:] if drawn else np.ones(m)
    found = {"group": state.group, "kind": np.where(net["bar"][:].astype(bool), "bar", "cable")}
    found["unstressed_length"] = state.unstressed_length
    found["cable"] = net["cable_names"].asstr()[:].astype(str)[net["cable"][:]]
    found |= {"area": of("section"), "modulus": of("modulus"), "density": of("density")}
    found["expansion"] = net["expansion"][:]
    by_load = of("breaking_load") / (of("modulus") * of("section"))
    of_its_own = np.where(of("fracture_strain") < by_load, of("fracture_strain"), np.inf)
    for name, values in (
        ("yield_stress", of("yield_stress")),
        ("breaking_load", of("breaking_load")),
        ("fracture_strain", of_its_own),
    ):
        if np.isfinite(values).any():
            given = before_drawing(values, factor)
            found[name] = np.where(np.isfinite(given), given, np.nan)
    if "type" in net:
        names = np.append(net["type_names"].asstr()[:], "").astype(str)
        found["type"] = names[net["type"][:]]
    return found


def before_drawing(value: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """The least number (m,) whose product with the factor (m,) reaches the value (m,), to the last bit."""
    with np.errstate(over="ignore"):
        found = value / factor
        for _ in range(2):
            less = np.nextafter(found, 0.0)
            found = np.where(np.isfinite(found) & (less * factor >= value), less, found)
        for _ in range(2):
            found = np.where(found * factor >= value, found, np.nextafter(found, np.inf))
    return found


def _faces(result: Result, state: State) -> dict[str, np.ndarray]:
    """A row for each corner of each ring of a face; points that are no node by their places."""
    start, corner, face, others = (
        result.file[f"{RECORD}/{name}"][:] for name in ("ring_start", "ring_corner", "ring_face", "corners")
    )
    n, of_corner = len(result.nodes["id"]), np.repeat(np.arange(len(face)), np.diff(start))
    hole = np.arange(len(face)) - np.searchsorted(face, face)
    is_node = corner < n
    node = np.where(is_node, state.node_id[np.where(is_node, corner, 0)].astype(object), "")
    columns = {"face": face[of_corner]} | ({"ring": hole[of_corner]} if hole.any() else {}) | {"node": node}
    if not is_node.all():
        place = np.full((len(corner), 3), np.nan)
        place[~is_node] = others[corner[~is_node] - n]
        columns |= {k: place[:, i] for i, k in enumerate(AXES)}
    return columns


def _history(result: Result) -> dict[str, np.ndarray]:
    """The columns of /history; those of probes by the ids of their nodes and elements."""
    history = result.history
    by_id = ("probe", "element")
    columns = {name: history[name] for name in history if not name.startswith(by_id)}
    if "probe_particle" in history:
        nodes = result.nodes["id"][history["probe_particle"]]
        for row, node in enumerate(nodes):
            for i, k in enumerate(AXES):
                columns[f"displacement_{k} of node {node}"] = history["probe_displacement"][:, row, i]
        for row, element in enumerate(history["probe_element"]):
            columns[f"tension of element {_named(result, element)}"] = history["probe_tension"][:, row]
    if "element_tension" in history:
        for row, element in enumerate(history["element"]):
            columns[f"tension of element {_named(result, element)}"] = history["element_tension"][:, row]
    return columns


def _named(result: Result, element: int) -> str:
    """The id of an element, with its nodes where it is one part of several."""
    ids, rows = result.elements["id"], result.elements
    nodes = f" ({rows['start'][element]}-{rows['end'][element]})"
    return f"{ids[element]}{nodes if (ids == ids[element]).sum() > 1 else ''}"
