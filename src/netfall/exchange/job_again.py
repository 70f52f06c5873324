"""Job that runs an exported net again: the job of the run, adapted to the tables of the form."""

import hashlib
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from netfall.core.functions import lengths
from netfall.core.progress import one_line
from netfall.exchange import messages
from netfall.exchange.state import MARK, NET_RECORD, ExportState, form_of
from netfall.job.csv_table import AXES, COLUMNS, UNITS, open_load_table, write_table
from netfall.job.keys.entries import Case, flatten_settings, split
from netfall.job.keys.groups import group_values, unmatched_sections
from netfall.job.keys.schema import LIST_KEYS, SECTIONS
from netfall.job.toml_text import toml_text
from netfall.job.validate import Validator
from netfall.results.file import provenance_text, read_job_tables
from netfall.results.reader import Result
from netfall.results.states import last_stage

TABLES = ("net", "roof")  # sections whose files the exported tables replace
FILES = {
    key.name
    for section, keys in [*SECTIONS.items(), *LIST_KEYS.items()]
    for key in keys
    if key.kind == "path" and section not in TABLES
}
LENGTH_ROUNDING = 1e-9  # rounding error of a buckling length, the sum of the lengths of parts [-]
AREA_LOADS = {"dead", "snow", "pressure", "added_mass", "load_table", "pressure_table", "speed", "wind"}
HEAD = """\
# {mark}: {title}, in its form
#
# The tables in this folder define the form, its unstressed lengths, loads, sections and faces. So there is
# no form finding, and [net] has only the tables. All other keys are those of the original job.

"""


def write_rerun_job(
    result: Result, state: ExportState, folder: Path, faces: bool, exported: tuple[str, ...]
) -> list[str]:
    """Write job.toml and the files that it reads; return lines on what was written.

    faces : whether faces.csv is exported; exported : names of the exported files, which copies must not have
    """
    job = read_job_tables(result.file)
    job["title"] = result.title
    for section in ("form_finding", "target", "stage"):  # the tables contain their results
        job.pop(section, None)
    job["net"] = {"nodes": "nodes.csv", "elements": "elements.csv"}
    present = {*state.group[~state.out()]}
    groups = job.get("group", {})
    job["group"] = {name: groups[name] for name in groups if name not in unmatched_sections(groups, present)}
    applied_keys = ["prestress", "horizontal_force", "length_std"]  # the unstressed lengths include both
    applied_keys += ["strength_cov"] if state.out().any() else []  # included in the strengths
    for table in [job["cable"], *job["group"].values()]:
        for key in applied_keys:
            table.pop(key, None)
    if faces:
        normal = job.get("roof", {}).get("normal")
        job["roof"] = {"faces": "faces.csv"} | ({"normal": normal} if normal else {})
    used = _used_zones(result)
    keeps_zones = keeps_zone_entries(result)
    _reduce_zones(job, used, keeps_zones)
    mixes = _acts_on_corners(result) and not keeps_zones and _shares_differ(result)
    lines = [messages.SHARES_OF_NODES()] if mixes else []
    lines += [*_loss_notes(result, job), *_rename_subdivided(result, state, job)]
    lines += _name_slip_points(result, state, job)
    node_id = dict.fromkeys(map(str, state.node_id[state.connected()].tolist()))
    for case in job.get("case", []):
        settled = {node: shift for node, shift in case.pop("settlement", {}).items() if node in node_id}
        if settled or (not case.keys() & {"load_table", "pressure_table"} and not case["set"]):
            case["settlement"] = settled or {next(iter(node_id)): [0.0, 0.0, 0.0]}  # a case needs an action
    if "strength_cov" in applied_keys and "strength" in result.file["net"]:
        lines.append(messages.DRAWN_STRENGTHS())
    has_probes = hasattr(result, "history") and "probe_particle" in result.history
    if has_probes and "probes" in job.get("output", {}):  # in the form another node may be nearest
        job["output"]["probes"] = result.nodes["id"][result.history["probe_particle"]].tolist()
    _remove_absent_names(result, state, job)
    source = Path(provenance_text(result.file, "job_folder"))
    tables = {name: table for name, table in job.items() if name != "limits"}  # its displacement is a length
    lines += _copy_files(tables, source, folder, dict.fromkeys(exported), _digests_of_run(result))
    lines += _adapt_load_tables(job, folder, state, used)
    head = HEAD.format(mark=MARK, title=one_line(result.title))
    if not job["group"]:
        del job["group"]
    ordered_job = {name: job[name] for name in ("title", "net", "cable", "group") if name in job} | job
    (folder / "job.toml").write_text(head + toml_text(ordered_job), encoding="utf-8")
    return [f"{folder / 'job.toml'}: runs this net again, without form finding", *lines]


def _remove_absent_names(result: Result, state: ExportState, job: dict[str, Any]) -> None:
    """Remove the nodes, elements, cables and groups that left the net from the sections that name them."""
    net, present = result.file["net"], ~state.out()
    names: dict[str, Any] = {"elements": state.element_id, "group": state.group}
    names["cables"] = net["cable_names"].asstr()[:].astype(str)[net["cable"][:]]
    existing = {key: {*values[present].tolist()} for key, values in names.items()}
    existing["groups"] = existing["group"]
    existing["nodes"] = existing["probes"] = {*state.node_id[state.connected()].tolist()}
    for section in ("remove", "motion", "output", "roof"):
        table = job.get(section, {})
        for entry in list(table) if isinstance(table, list) else [table]:
            for key in [key for key in entry if key in existing]:
                given = entry[key]
                named = given if isinstance(given, list) else [given]
                remaining = [n for n in named if isinstance(n, list) or n in existing[key]]  # or points
                if remaining:
                    entry[key] = remaining if isinstance(given, list) else given
                elif isinstance(table, list):  # an entry without nodes would move all supports
                    table.remove(entry)
                else:
                    del entry[key]
        if table == []:
            job.pop(section, None)
    limits = job.get("limits", {}).get("group", {})
    for name in unmatched_sections(limits, existing["group"]):
        del limits[name]


def _used_zones(result: Result) -> set[str]:
    """Return the names of the zones with nodes, or shares of nodes."""
    net = result.file["net"]
    if "zone_share" in net:
        return set(net["zone_names"].asstr()[:][net["zone_share"][:].any(0)])
    return set(result.nodes["zone"].tolist())


def _acts_on_corners(result: Result) -> bool:
    """Return whether loads act on the corners of faces, with separate zones, and zones meet at nodes."""
    record, roof = result.file[NET_RECORD], read_job_tables(result.file).get("roof", {})
    is_given = any(np.isfinite(record[name][:]).any() for name in ("area", "normal"))
    return bool("normal" in roof and "zone_share" in result.file["net"] and not is_given)


def keeps_zone_entries(result: Result) -> bool:
    """Return whether the exported job has the entries [[zone]] of the run, not shares of nodes in nodes.csv.

    At a fold of a roof with `normal`, the zones of the faces differ from the shares of the node. Entries
    reproduce the zones if they are existing groups, or polygons of a net as given.
    """
    job, names = read_job_tables(result.file), result.file["net/zone_names"].asstr()[:]
    entries = {entry["name"]: entry for entry in job.get("zone", [])}
    keys = {"groups"} if "form_finding" in job or "target" in job else {"groups", "polygon"}
    is_whole = _acts_on_corners(result) and "stage" not in job
    return is_whole and all(keys & entries.get(name, {}).keys() for name in names)


def _shares_differ(result: Result) -> bool:
    """Return whether zones have other shares of nodes than of faces.

    They differ at folds, and if nodes moved after the start geometry, in which zones divide the faces.
    """
    area, vector = result.nodes["area"].sum(), result.nodes["vector_area"].sum(axis=0)
    given = np.column_stack([result.nodes[axis] for axis in AXES])
    movement = np.abs(form_of(result)[0] - given).max()
    has_folds = lengths(vector[None])[0] < (1.0 - LENGTH_ROUNDING) * area
    return bool(has_folds or movement > LENGTH_ROUNDING * np.ptp(given, axis=0).max())


def _reduce_zones(job: dict[str, Any], used: set[str], keeps_entries: bool) -> None:
    """Reduce the job to used zones, and their entries to names if the node table assigns them.

    A polygon may contain other nodes in the form than in the initial geometry.
    """
    unused = {entry["name"] for entry in job.get("zone", [])} - used
    zones = [entry for entry in job.get("zone", []) if entry["name"] not in unused]
    job["zone"] = zones if keeps_entries else [{"name": entry["name"]} for entry in zones]
    if not job["zone"]:
        del job["zone"]
    for section in ("load", "wind"):
        for name in unused:
            job.get(section, {}).get("zone", {}).pop(name, None)
    for case in job.get("case", []):
        changes = flatten_settings(case.get("set", {}))
        case["set"] = {key: value for key, value in changes.items() if split(key)[1] not in unused}


def _adapt_load_tables(job: dict[str, Any], folder: Path, state: ExportState, used: set[str]) -> list[str]:
    """Adapt each load table that the job names; return notes on tables without remaining loads."""
    sections = (job.get("load", {}), *job.get("case", []))
    names = {section["load_table"] for section in sections if "load_table" in section}
    paths = [folder / name for name in sorted(names) if (folder / name).is_file()]
    return [messages.EMPTY_LOAD_TABLE(path=p) for p in paths if not _adapt_load_table(p, state, used)]


def _adapt_load_table(path: Path, state: ExportState, used: set[str]) -> bool:
    """Write a load table for the existing nodes and parts of elements, or for the used zones.

    Returns whether any row remains. If not, the table contains a load of zero, because cases need rows.
    """
    table, of_rows = open_load_table(path)
    if of_rows == "node":
        node_id = state.node_id[state.connected()]
        named = [node_id[node_id == each] for each in table.integers("node")]
    elif of_rows == "element":
        named = [state.element_id[(state.cable == each) & ~state.out()] for each in table.integers("element")]
    else:
        named = [np.array([name])[: name in used] for name in table.words("zone")]
    row = np.repeat(np.arange(len(table)), [len(each) for each in named])
    if not len(row):
        write_table(path, {"node": state.node_id[state.connected()][:1], "load_z": np.zeros(1)})
        return False
    columns = {of_rows: np.concatenate(named)}
    for name in filter(table.__contains__, COLUMNS[of_rows]):
        columns[name] = table.numbers(name, unit=UNITS[of_rows])[row]
    write_table(path, columns)
    return True


def _rename_subdivided(result: Result, state: ExportState, job: dict[str, Any]) -> list[str]:
    """Name the parts of subdivided elements in the job, keep the buckling lengths, and return notes.

    state.cable contains the ids that the job uses for all parts of an element.
    """
    if len(np.unique(state.cable)) == len(state.cable):
        return []
    for table in [*job.get("remove", []), job.get("output", {})]:
        if "elements" in table:
            table["elements"] = state.element_id[np.isin(state.cable, table["elements"])].tolist()
    _extend_to_inner_supports(result, job)
    count = len(np.unique(state.cable))
    return [*_buckling_lengths(result, job), messages.PARTS_ARE_ELEMENTS(count=count)]


def _extend_to_inner_supports(result: Result, job: dict[str, Any]) -> None:
    """Add the inner nodes of elements between two supports, which move with them, to the moves of the job."""
    elements, ids, held = result.file["net/elements"][:], result.nodes["id"], result.nodes["fixed"]
    parts = len(elements) // len(np.unique(result.elements["id"]))
    settlements = [
        (case["settlement"], Validator("", []).table("", Case, case).settlement)
        for case in job.get("case", [])
        if "settlement" in case
    ]
    moving = [(entry["nodes"], set(entry["nodes"])) for entry in job.get("motion", []) if "nodes" in entry]
    for first in range(0, len(elements) if settlements or moving else 0, parts):
        inner, ends = elements[first : first + parts - 1, 1], elements[[first, first + parts - 1], [0, 1]]
        for table, given in settlements:
            start, end = (np.array(given.get(int(node), [0.0] * 3)) for node in ids[ends])
            for k, node in enumerate(inner if (start.any() or end.any()) else (), 1):
                if held[node].all():
                    table.setdefault(str(ids[node]), ((1 - k / parts) * start + k / parts * end).tolist())
        for nodes, moved in moving:
            if moved.issuperset(ids[ends].tolist()):
                nodes += ids[inner][held[inner].any(1)].tolist()


def _name_slip_points(result: Result, state: ExportState, job: dict[str, Any]) -> Iterator[str]:
    """Set the slip points of the run in each entry [[slide]], remove entries without any; yield a warning.

    The tables name all cables and have nodes for parts of elements, so more nodes would be inside cables. The
    warning states that segments end at such nodes. As nodes of a table, they stop the slip if they have a
    support or a loaded area.
    """
    if "slide" not in job:
        return
    slide, net, nodes = result.file["slide"], result.file["net"], result.nodes
    cable = net["cable_names"].asstr()[:].astype(str)[net["cable"][:]]
    point, sides = slide["node"][:], np.column_stack([slide["before"][:], slide["after"][:]])
    tables = {str(k): case for k, case in enumerate(job.get("case", []))}
    tables |= {name: job[name] for name in ("load", "wind") if name in job}
    loads = {part for name in flatten_settings(tables) for part in name.split(".")}
    has_areas = (nodes["area"] > 0.0) & bool(loads & AREA_LOADS)
    is_present, stops = ~state.out()[sides].any(1), nodes["fixed"].any(1) | has_areas
    stops[: len(stops) - len(cable) + len(np.unique(state.cable))] = False  # nodes of the table of the run
    for entry in job["slide"]:
        if "cables" in entry:
            entry["cables"] = [name for name in entry["cables"] if name in cable[~state.out()]]
        of_entry = np.isin(cable, entry["cables"]) if "cables" in entry else state.group == entry["group"]
        at = is_present & of_entry[sides].all(1) & np.isin(point, entry.get("nodes", point))
        entry["nodes"] = np.unique(point[at]).tolist()
        if stops[state.ends[np.isin(state.cable, state.cable[sides[at]])]].any():
            cables = ", ".join(entry["cables"]) if "cables" in entry else f"group {entry['group']}"
            yield messages.SEGMENTS_END(cables=cables)
    job["slide"] = [entry for entry in job["slide"] if entry["nodes"]]
    if not job["slide"]:
        del job["slide"]


def _buckling_lengths(result: Result, job: dict[str, Any]) -> Iterator[str]:
    """Give groups of subdivided bars the buckling length of the whole element; yield notes."""
    net = result.file["net"]
    if "second_moment" not in net or "buckling_length" in job["cable"]:
        return
    length, group = net["buckling_length"][:], net["group"][:]
    for g, name in enumerate(net["group_names"].asstr()[:].tolist()):
        bar_lengths = length[(group == g) & np.isfinite(net["euler_load"][:])]
        if not len(bar_lengths) or "buckling_length" in group_values(job["group"], name):
            continue
        table = job["group"].setdefault(name, {}) if name else job["cable"]
        table["buckling_length"] = float(bar_lengths.max())
        if bar_lengths.min() < (1.0 - LENGTH_ROUNDING) * bar_lengths.max():
            yield messages.LONGEST_BUCKLING_LENGTH(
                group=name or "(none)", low=bar_lengths.min(), high=bar_lengths.max()
            )


def _loss_notes(result: Result, job: dict[str, Any]) -> Iterator[str]:
    """Yield warnings if the study, not the job, removed a member, and if moments of erection are lost."""
    if hasattr(result, "removal") and len(result.removal["time"]) > len(job.get("remove", [])):
        yield messages.REMOVAL_OF_STUDY()
    if "bending" in result.file["net"] and last_stage(result.file):  # tables have no moments
        yield messages.MOMENTS_LEFT_OUT()


def _digests_of_run(result: Result) -> set[str]:
    """Return the digests of the files that the run read; empty in results of earlier versions."""
    provenance = result.file["provenance"]
    has_digests = "file_digests" in provenance or "file_digests" in provenance.attrs
    return set(provenance_text(result.file, "file_digests").split()) if has_digests else set()


def _copy_files(
    table: Any, source: Path, folder: Path, origins: dict[str, Path | None], digests: set[str]
) -> list[str]:
    """Copy the files that a job names into the folder; return lines on the copies.

    source : folder of the job; origins : source file of each name in the folder, None: not a copy
    digests : of the files that the run read
    """
    lines = []
    items = table.items() if isinstance(table, dict) else enumerate(table)
    for key, value in list(items):
        if isinstance(value, dict | list):
            lines += _copy_files(value, source, folder, origins, digests)
        elif isinstance(value, str) and str(key).rpartition(".")[2] in FILES:
            name = Path(value).name
            while origins.get(name, source / value) != source / value:
                name = f"other_{name}"
            table[key] = name
            if name not in origins:
                lines.append(_copy_file(source / value, folder / name, key, digests))
            origins[name] = source / value
    return lines


def _copy_file(source: Path, target: Path, key: str, digests: set[str]) -> str:
    """Copy a file; return the line on it, or a warning if it has changed or no longer exists."""
    if not source.is_file():
        return messages.FILE_GONE(key=key, name=target.name, source=source)
    shutil.copyfile(source, target)
    if digests and hashlib.sha256(target.read_bytes()).hexdigest() not in digests:
        return messages.FILE_CHANGED(target=target, source=source)
    return f"{target}: copied from {source}"
