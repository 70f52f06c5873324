"""The job that runs an exported net again: that which was run, for the tables of the form."""

import shutil
from pathlib import Path

import numpy as np

from netfall.exchange.state import MARK, State
from netfall.ground.progress import one_line
from netfall.job.cases import split
from netfall.job.entries import LISTS
from netfall.job.schema import SECTIONS
from netfall.job.toml_text import toml_text
from netfall.results.file import job_of, provenance_text
from netfall.results.result import Result
from netfall.results.states import last_stage

TABLES = ("net", "roof")  # sections whose files are those of the form
FILES = {
    key.name
    for section, keys in [*SECTIONS.items(), *LISTS.items()]
    for key in keys
    if key.kind == "path" and section not in TABLES
}
HEAD = """\
# {mark}: {title}, in its form
#
# The tables beside hold the form, its unstressed lengths, loads, sections and faces; so there is no form
# finding, and no [net] but the tables. All else is the job that was run.

"""


def job_again(result: Result, state: State, folder: Path, faces: bool, own: tuple[str, ...]) -> list[str]:
    """Write job.toml and the files that it reads; what is said of them.

    faces : whether there is faces.csv; own : names of the files of the export, which no copy takes
    """
    job = job_of(result.file)
    job["title"] = result.title
    for section in ("form_finding", "target", "stage"):  # the tables hold what came of them
        job.pop(section, None)
    job["net"] = {"nodes": "nodes.csv", "elements": "elements.csv"}
    there = {*state.group[~state.out()]}
    of_groups = {name for name, table in job["cable"].items() if isinstance(table, dict)}
    job["cable"] = {name: value for name, value in job["cable"].items() if name not in of_groups - there}
    again = ["prestress", "length_deviation"]  # both are in the unstressed lengths
    again += ["strength_deviation"] if state.out().any() else []  # and that in the strengths
    for table in [job["cable"], *job["cable"].values()]:
        if isinstance(table, dict):
            for key in again:
                table.pop(key, None)
    if faces:
        job["roof"] = {"faces": "faces.csv"}
    _zones(job, _used_zones(result))
    told = _lost_cables(result, job) + _bent(result) + _parts(result, state, job)
    if "strength_deviation" in again and "strength" in result.file["net"]:
        told.append(
            "note: strengths are those that were drawn, in reports too: without all elements others would be"
        )
    kept = hasattr(result, "history") and "probe_particle" in result.history
    if kept and "probes" in job.get("output", {}):  # a place may be nearer to another node in the form
        job["output"]["probes"] = result.nodes["id"][result.history["probe_particle"]].tolist()
    told += _files(job, Path(provenance_text(result.file, "job_folder")), folder, dict.fromkeys(own))
    head = HEAD.format(mark=MARK, title=one_line(result.title))
    order = {name: job[name] for name in ("title", "net", "cable")} | job
    (folder / "job.toml").write_text(head + toml_text(order), encoding="utf-8")
    return [f"{folder / 'job.toml'}: runs this net again, without form finding", *told]


def _used_zones(result: Result) -> set[str]:
    """Names of the zones that have nodes, or shares of nodes."""
    net = result.file["net"]
    if "zone_share" in net:
        return set(net["zone_names"].asstr()[:][net["zone_share"][:].any(0)])
    return set(result.nodes["zone"].tolist())


def _zones(job: dict, used: set[str]) -> None:
    """Zones by the columns of the table: the form may have other nodes in a polygon than the start had."""
    idle = {entry["name"] for entry in job.get("zone", [])} - used
    job["zone"] = [{"name": entry["name"]} for entry in job.get("zone", []) if entry["name"] not in idle]
    if not job["zone"]:
        del job["zone"]
    for section in ("load", "wind"):
        for name in idle:
            job.get(section, {}).get("zone", {}).pop(name, None)
    for case in job.get("case", []):
        of_idle = lambda key: split(key)[1] in idle
        case["set"] = {key: value for key, value in case.get("set", {}).items() if not of_idle(key)}


def _bent(result: Result) -> list[str]:
    """That tables have no moments, where stages of erection left some."""
    if "bending" not in result.file["net"] or not last_stage(result.file):
        return []
    return ["note: bars that bend have moments after the last stage of erection, which start from zero here"]


def _parts(result: Result, state: State, job: dict) -> list[str]:
    """What was subdivided: ids of elements name all their parts, bars buckle as long as they did."""
    if len(np.unique(state.cable)) == len(state.cable):
        return []
    for table in [*job.get("remove", []), job.get("output", {})]:
        if "elements" in table:
            table["elements"] = state.element_id[np.isin(state.cable, table["elements"])].tolist()
    told = _buckling_lengths(result, job)
    return told + [
        f"note: the parts of the {len(np.unique(state.cable))} subdivided elements are elements of their own "
        "here; where one is lost, the nodes between its parts are nodes like others"
    ]


def _buckling_lengths(result: Result, job: dict) -> list[str]:
    """Give groups of bars in parts the buckling length that they had, of the whole element of the table."""
    net, told = result.file["net"], []
    if "second_moment" not in net or "buckling_length" in job["cable"]:
        return []
    length, group = net["buckling_length"][:], net["group"][:]
    for g, name in enumerate(net["group_names"].asstr()[:].tolist()):
        own = length[(group == g) & np.isfinite(net["euler_load"][:])]
        table = job["cable"].setdefault(name, {}) if name else job["cable"]
        if not len(own) or "buckling_length" in table:
            continue
        table["buckling_length"] = float(own.max())
        if own.min() < own.max():
            told.append(
                f"note: bars of group {name or '(none)'} have buckling lengths of {own.min():.6g} to "
                f"{own.max():.6g} m: here all have that of the longest"
            )
    return told


def _lost_cables(result: Result, job: dict) -> list[str]:
    if hasattr(result, "removal") and len(result.removal["time"]) > len(job.get("remove", [])):
        return [
            "note: this run of a study lost a member by the study's own list: add its [[remove]] to job.toml"
        ]
    return []


def _files(table, source: Path, folder: Path, taken: dict[str, Path | None]) -> list[str]:
    """Copy the files that a job names into the folder, and say so.

    source : the folder of the job; taken : what each name in the folder is a copy of, None: of nothing
    """
    told = []
    items = table.items() if isinstance(table, dict) else enumerate(table)
    for key, value in list(items):
        if isinstance(value, dict | list):
            told += _files(value, source, folder, taken)
        elif isinstance(value, str) and str(key).rpartition(".")[2] in FILES:
            name = Path(value).name
            while taken.get(name, source / value) != source / value:
                name = f"other_{name}"
            table[key] = name
            if name not in taken:
                told.append(_copied(source / value, folder / name, key))
            taken[name] = source / value
    return told


def _copied(source: Path, target: Path, key: str) -> str:
    if not source.is_file():
        return f"note: {key} = {target.name}: {source} is no more there; put it beside job.toml"
    shutil.copyfile(source, target)
    return f"{target}: copied from {source}"
