"""Sections of a report on cases, combinations and bending."""

import h5py
import numpy as np

from netfall.job.keys.entries import CASE_LOAD_KEYS, CASE_WIND_KEYS, flatten_settings
from netfall.job.values import format_value
from netfall.post.checks import cables
from netfall.post.checks.bending import is_bending, is_concrete
from netfall.post.checks.cases import (
    REFERENCES,
    ServiceLimit,
    count_slack_cables,
    largest_displacements,
)
from netfall.post.checks.codes import BENDING_KIND
from netfall.post.report import markdown as md
from netfall.results import states
from netfall.results.datasets import EQUILIBRIUM
from netfall.results.file import COMBINATION_KINDS, Case, read_job_tables
from netfall.results.warning_text import element_list

LIMIT_WORDS = {  # attribute of an equilibrium: the limit that its listed elements have reached
    "over_strength": "strength exceeded",
    "buckled": "at the Euler load",
    "beyond_euler": "above the Euler load, without buckling = true",
    "yielding": "at the yield force",
}
UNFACTORED = "No combination is of kind ULS: loads count as the job gives them, without partial factors."
ERECTION = "Loads in stages of erection count as the job gives them, without partial factors."
GROUP_COLUMNS = {  # heading in tables: dataset of /net and its unit
    "EA [kN]": ("axial_stiffness", 1e3),
    "mass [kg/m]": ("mass_per_length", 1.0),
    "breaking force [kN]": ("breaking_load", 1e3),
    "yield force [kN]": ("yield_force", 1e3),
    "second moment [cm4]": ("second_moment", 1e-8),
}
ACTION_KEYS = ("self_weight", "load_table", *CASE_LOAD_KEYS, *CASE_WIND_KEYS)  # of [load] and [wind]
MOST_STAGES = 10  # number of named stages


def cases(f: h5py.File, all_cases: list[Case], table: dict[str, np.ndarray]) -> list[str]:
    """Return the table of cases, one row each; table : see `case_columns`."""
    lines, largest = [], {name: largest_displacements(f, all_cases, name) for name in REFERENCES}
    for k, (case, count) in enumerate(zip(all_cases, count_slack_cables(f, all_cases))):
        rows, numbers = table["case"] == case.name, [""] * 5
        if case.carries:
            low, high = (table[f"tension_{name}"][rows].astype(float) for name in ("min", "max"))
            moved = [largest[name][k] for name in REFERENCES]
            moved_texts = [f"{1e3 * distance:.1f} mm at node {node}" for distance, node in moved]
            numbers = [md.force(np.nanmin(low)), md.force(np.nanmax(high)), *moved_texts, count]
        reached = f", to a load factor of {case.load_factor:.3g}" if case.load_factor < 1.0 else ""
        lines.append([case.name, case.kind, case.state.replace("_", " ") + reached, *numbers])
    header = ["case", "kind", "state", "smallest force", "largest force", "largest displacement"]
    header += ["from the permanent state", "slack cables"]
    failed = [case for case in all_cases if case.state != EQUILIBRIUM]
    remarks = [md.item(f"{case.name}: {case.reason}") for case in failed if case.reason]
    if failed:
        count = f"{len(failed)} of {len(all_cases)} cases"
        text = md.bold(f"For {count} no stable equilibrium before a limit point was found.")
        remarks = [text, "", *remarks]
    return [
        f"Each is a separate equilibrium. Displacements are relative to {states.start_name(f)} and to the",
        "equilibrium under the permanent loads. Load factors run from that equilibrium (0) to the full",
        "case (1). For values by group see cases.csv.",
        "",
        *md.as_table(header, lines),
        *([""] if remarks else []),
        *remarks,
        "",
        *actions(f),
        *md.picture("axial forces in equilibrium", "states.png"),
    ]


def actions(f: h5py.File) -> list[str]:
    """Return the loads of the job and of each case, and the factors of each combination."""
    job = read_job_tables(f)
    sections = {"load": {"self_weight": True} | job["load"]} if "load" in job else {}
    sections |= {"wind": job["wind"]} if "wind" in job else {}
    lines = ["Loads as in the job, numbers without a unit in SI units, and factors:", ""]
    for section, table in sections.items():
        given = flatten_settings(table).items()
        values = {name: value for name, value in given if name.rpartition(".")[2] in ACTION_KEYS}
        lines.append(_settings(f"[{section}]", values))
    if (load := f["provenance/net/load"][:]).any():  # by the factor of `load`
        resultant = np.broadcast_to(load, f["net/fixed"].shape).sum(axis=0)
        texts = ", ".join(map(md.force, resultant))
        lines.append(md.item(f"loads of nodes.csv: resultant {texts} along x, y, z"))
    for case in job.get("case", []):
        others = {name: value for name, value in case.items() if name not in ("name", "set")}
        lines.append(_settings(case["name"], flatten_settings(case.get("set", {}) | others)))
    for one in job.get("combination", []):
        factors = {"permanent": 1.0, "prestress": 1.0} | one["factors"]
        terms = " + ".join(f"{value:g} {name}" for name, value in factors.items() if value)
        lines.append(md.item(f"{one['name']}: {terms or 'nothing'}"))
    return lines


def _settings(title: str, values: dict[str, object]) -> md.Markup:
    """Return an item with the values of a table."""
    texts = [
        f"{name} = {value if isinstance(value, str) else format_value(value)}"
        for name, value in values.items()
    ]
    return md.item(f"{title}: {', '.join(texts) or 'nothing'}")


def groups(f: h5py.File) -> list[str]:
    """Return the table of stiffness, mass and strength by group, type and kind, without random draws."""
    names, types, net = cables.element_groups(f), cables.element_types(f), f["net"]
    kinds, lines = np.where(net["bar"][:] == 1, "bar", "cable"), []
    columns = {title: net[name][:] / unit for title, (name, unit) in GROUP_COLUMNS.items() if name in net}
    for group, label, kind in dict.fromkeys(zip(names, types, kinds)):
        rows = (names == group) & (types == label) & (kinds == kind)
        lines.append([group or "(none)", label, kind, len(np.unique(net["element_id"][:][rows]))])
        for column in columns.values():
            values = column[rows][known := np.isfinite(column[rows])]
            ends = [f"{value:.6g}" for value in (values.min(), values.max())] if len(values) else []
            without = len(np.unique(net["element_id"][:][rows][~known])) if len(values) else 0
            remark = f", {without} without" if without else ""
            lines[-1].append(" to ".join(dict.fromkeys(ends)) + remark)
    return md.as_table(["group", "type", "kind", "elements", *columns], lines)


def checks(
    f: h5py.File, envelope: states.Envelope, checked: list[cables.ElementCheck], table: dict[str, np.ndarray]
) -> list[str]:
    """Return for each check the worst element of each group, and the stages that count.

    table : see `group_columns`
    """
    lines, kinds = [], cables.stage_kinds(f, envelope)
    is_shown = np.isfinite(table["utilisation"].astype(float)) | (table["result"] == "FAILS")
    for one in checked:
        check, counting = one.check, cables.counted(kinds, one.check.kind)
        names = [name for name, counts in zip(envelope.names, counting) if counts]
        others = [f"and {len(names) - MOST_STAGES} more"] if len(names) > MOST_STAGES else []
        what = "sum" if check.with_moment else check.of
        text = f"The largest {what} of each element in: {'; '.join(names[:MOST_STAGES] + others)}."
        text = f"Of kind {check.kind}. {text}" if check.kind else text
        lines += [md.heading(3, check.title), "", text, ""]
        unfactored = [UNFACTORED] * (check.kind not in kinds and one.reason != "not checked")
        unfactored += [ERECTION] * any(place.startswith("stages/") for place in envelope.places)
        for remark in unfactored if check.kind == BENDING_KIND else []:
            lines += [md.bold(remark), ""]
        failures = [
            cables.NOT_VERIFIED[why].format(title)
            for why, title in cables.states_not_verified(f, envelope, counting)
        ]
        lines += [*map(md.bold, failures), *([""] if failures else [])]
        rows = []
        for k in np.flatnonzero(is_shown & (table["check"] == check.name)):
            row = {name: values[k] for name, values in table.items()}
            member = f"element {row['element']} of {row['cable']}"
            result = md.bold("FAILS") if row["result"] == "FAILS" else row["result"]
            rows.append([row["group"] or "(none)", row["type"], member, row["alike"], md.force(row["N_Ed"])])
            rows[-1] += [row["case"], md.force(row["N_Rd"])]
            rows[-1] += [md.moment(row[name]) for name in ("M_Ed", "M_Rd") if check.with_moment]
            rows[-1] += [md.share(row["utilisation"]), result]
        header = ["group", "type", "governing member", "alike", "N_Ed", "in", "N_Rd", "N_Ed / N_Rd", ""]
        if check.with_moment:
            header[7:8] = ["M_Ed", "M_Rd", "N_Ed / N_Rd + M_Ed / M_Rd"]
        lines += md.as_table(header, rows) if rows else [f"Empty: {one.explain_no_utilisation()}."]
        lines.append("")
    return lines


def at_limits(f: h5py.File) -> list[str]:
    """Return the table of the elements at a limit, one row for each state and limit; possibly empty."""
    groups = [(path, f[path].attrs) for path in states.equilibrium_groups(f)]
    rows = [
        [states.group_title(f, path), words, element_list(attrs[name])]
        for name, words in LIMIT_WORDS.items()
        for path, attrs in groups
        if name in attrs
    ]
    return md.as_table(["state", "limit", "elements"], rows) if rows else []


def limits(results: list[ServiceLimit] | None, all_cases: list[Case]) -> list[str]:
    """Return the table of the service limits; results : from `limits_of`"""
    if results is None:
        return ["None: the job has no [limits]."]
    if not results and any(case.kind == COMBINATION_KINDS[1] for case in all_cases):
        return ["None: [limits] limits neither displacements nor slack cables."]
    if not results:
        return [f"Not checked: no combination is of kind {COMBINATION_KINDS[1]}."]
    lines = [
        [limit.case, limit.what, f"{limit.value:.4g} {limit.unit}" if np.isfinite(limit.value) else "none"]
        + [limit.at, f"{limit.allowed:.4g} {limit.unit}", "passes" if limit.holds else md.bold("FAILS")]
        for limit in sorted(results, key=lambda limit: limit.holds)
    ]
    header = ["combination", "what", "reached", "at", "limit", ""]
    return md.as_table(header, lines, "cases.csv")


CONVENTION = (
    "Moments are positive if they cause tension at the lower side of the member (vertical), and at the "
    "side away from the middle of its group, in a ring the outside (in plan). For vertical members these "
    "are the sides towards x and y."
)
GOVERNING = {"N": "N", "moment_vertical": "M vertical", "moment_plan": "M in plan"}  # columns, as text


def bending(f: h5py.File, envelope: states.Envelope, tables: dict[str, dict[str, np.ndarray]]) -> list[str]:
    """Return forces and moments at the governing points of groups with bending, and the unchecked groups.

    tables : of the report, by the names of their files
    """
    elements = tables["elements.csv"]
    lines = [
        CONVENTION,
        "",
        "Moments include second-order effects. N / (A f) + M / (W f) is checked for groups with",
        "section_modulus. Only chi accounts for imperfections. A chain without buckling_length in the",
        "job has only the check of its section, so its geometry must include them.",
        "",
        *_governing_points(f, envelope, tables["moments.csv"], is_bending(f)),
    ]
    moving = elements["bending_moment_max"][elements["case_moment"] == states.DYNAMIC_STAGE]
    if len(moving):
        lines += [
            "",
            f"In motion, for which only the magnitude is recorded: up to {md.moment(float(moving.max()))}.",
        ]
    return [*lines, *md.picture("largest bending moments", "moments.png")]


def concrete(f: h5py.File, envelope: states.Envelope, tables: dict[str, dict[str, np.ndarray]]) -> list[str]:
    """Return the forces and moments at the governing points of the groups of concrete; empty: no group."""
    if not (rows := is_concrete(f)).any():
        return []
    explanation = "For the design of the sections; no check of axial force with bending includes these bars."
    return [f"{explanation} {CONVENTION}", "", *_governing_points(f, envelope, tables["moments.csv"], rows)]


def _governing_points(
    f: h5py.File, envelope: states.Envelope, table: dict[str, np.ndarray], shown: np.ndarray
) -> list[str]:
    """Return the table of the extremes of N and of both moments in each group, in the stages of ULS checks.

    table : see `bending.moment_table`; shown : (m,) bool
    """
    stages = cables.counted(cables.stage_kinds(f, envelope), BENDING_KIND)
    names = [name for name, counts in zip(envelope.names, stages) if counts]
    lines = []
    for group in dict.fromkeys(cables.element_groups(f)[shown]):
        rows = np.flatnonzero((table["group"] == group) & np.isin(table["case"], names))
        points: dict[int, list[str]] = {}  # by row: the extremes at that point
        for column, words in GOVERNING.items():
            values = table[column][rows]
            for which, sign in (("least", -1.0), ("largest", 1.0)):
                if column == "N" or (sign * values > 0.0).any():
                    by_moment = np.nan_to_num(table["moment"][rows])
                    order = np.lexsort((-by_moment, -np.round(sign * values, 6)))
                    points.setdefault(int(rows[order[0]]), []).append(f"{which} {words}")
        for row, extremes in points.items():
            place = [table[name][row] for name in ("element", "node", "case")]
            moments = [md.moment(table[name][row]) for name in list(GOVERNING)[1:]]
            words = [group or "(none)", ", ".join(extremes)]
            lines.append([*words, *place, md.force(table["N"][row]), *moments])
    header = ["group", "governs", "element", "at node", "in", *GOVERNING.values()]
    return md.as_table(header, lines)
