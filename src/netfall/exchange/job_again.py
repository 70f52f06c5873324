"""Job that runs an exported net again: the job of the run, adapted to the tables of the form."""

import hashlib
import shutil
from pathlib import Path
from typing import Any

import numpy as np

from netfall.core.progress import one_line
from netfall.exchange import messages
from netfall.exchange.state import MARK, ExportState
from netfall.job.keys.schema import LIST_KEYS, SECTIONS
from netfall.job.toml_text import toml_text
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
    if reason := _obstacle(result, state, job):
        return [messages.NO_JOB(reason=reason)]
    job["title"] = result.title
    for section in ("form_finding", "target", "stage"):  # the tables contain their results
        job.pop(section, None)
    job["net"] = {"nodes": "nodes.csv", "elements": "elements.csv"}
    for table in [job["cable"], *job.get("group", {}).values()]:
        for key in ("prestress", "horizontal_force", "length_std"):  # in the unstressed lengths
            table.pop(key, None)
    if faces:
        normal = job.get("roof", {}).get("normal")
        job["roof"] = {"faces": "faces.csv"} | ({"normal": normal} if normal else {})
    if "zone" in job and not keeps_zones(result, state):  # in the form polygons may contain other nodes
        job["zone"] = [{"name": entry["name"]} for entry in job["zone"]]
    has_probes = hasattr(result, "history") and "probe_particle" in result.history
    if has_probes and "probes" in job.get("output", {}):  # in the form another node may be nearest
        job["output"]["probes"] = result.nodes["id"][result.history["probe_particle"]].tolist()
    source = Path(provenance_text(result.file, "job_folder"))
    tables = {name: table for name, table in job.items() if name != "limits"}  # its displacement is a length
    lines = _copy_files(tables, source, folder, dict.fromkeys(exported), _digests_of_run(result))
    head = HEAD.format(mark=MARK, title=one_line(result.title))
    ordered_job = {name: job[name] for name in ("title", "net", "cable", "group") if name in job} | job
    (folder / "job.toml").write_text(head + toml_text(ordered_job), encoding="utf-8")
    return [f"{folder / 'job.toml'}: a job of this net, without form finding", *lines]


def keeps_zones(result: Result, state: ExportState) -> bool:
    """Return whether the exported job has the zones of the run in place of a column of the nodes."""
    job = read_job_tables(result.file)
    return _entries_give_zones(result, state, job) and not _obstacle(result, state, job)


def _has_zones_of_faces(result: Result, job: dict[str, Any]) -> bool:
    """Return whether faces at one node have zones of their own, which no column of the nodes can store."""
    net = result.file["net"]
    if "normal" in job.get("roof", {}):
        return bool((net["zone"][:] >= 0).any() or "zone_share" in net)
    cuts = any("polygon" in zone and zone.get("cut", True) for zone in job.get("zone", []))
    return "zone_share" in net and cuts


def _entries_give_zones(result: Result, state: ExportState, job: dict[str, Any]) -> bool:
    """Return whether [[zone]] gives faces the zones that they had in the run, as no node has moved."""
    entries, net = job.get("zone", []), result.file["net"]
    is_complete = sum("polygon" in entry or "groups" in entry for entry in entries) == len(net["zone_names"])
    has_moved = not np.array_equal(state.position, net["particles"])
    return is_complete and not has_moved and _has_zones_of_faces(result, job)


def _obstacle(result: Result, state: ExportState, job: dict[str, Any]) -> str:
    """Return the reason why the job of the run would not compute the same with the tables; "": it would."""
    net = result.file["net"]
    by_entries = _entries_give_zones(result, state, job)
    used = set(net["zone_names"].asstr()[:][np.unique(net["zone"][:][net["zone"][:] >= 0])])
    if "zone_share" in net:
        used |= set(net["zone_names"].asstr()[:][net["zone_share"][:].any(0)])
    reasons = {
        "parts of subdivided elements are separate elements": len(np.unique(state.cable)) < len(state.cable),
        "a stage of erection took elements out": state.out().any(),
        "bars that bend have moments after erection": "bending" in net and bool(last_stage(result.file)),
        "cables slip": "slide" in job,
        "a study removed a member": hasattr(result, "removal")
        and len(result.removal["time"]) > len(job.get("remove", [])),
        "faces at a node have zones of their own": _has_zones_of_faces(result, job) and not by_entries,
        "a zone has no nodes": any(entry["name"] not in used for entry in job.get("zone", []))
        and not by_entries,
    }
    return next((reason for reason, holds in reasons.items() if holds), "")


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
