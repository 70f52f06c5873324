"""Report sections on cases and combinations: outcome of each, checks by group, service limits."""

import numpy as np

from netfall.post.checks.cables import ElementChecks
from netfall.post.checks.cases import count_slack_cables, largest_displacements
from netfall.post.checks.codes import Check
from netfall.post.checks.counted import (
    counted,
    groups_without_equilibrium,
    places_of,
    stage_kinds,
    unstable_groups,
)
from netfall.post.checks.groups import limits_of, members
from netfall.post.report.markdown import (
    MOST_LISTED,
    as_table,
    bold,
    force,
    heading,
    item,
    more,
    picture,
    share,
)
from netfall.results.cases import COMBINATION_KINDS, EQUILIBRIUM, Case
from netfall.results.file import read_job_tables
from netfall.results.states import Envelope, group_title, is_undecided, start_name

WORST = 10  # rows of the most used elements, and stages that are named


def cases(f, all_cases: list[Case], table: dict) -> list[str]:
    """Return the table of cases, one row each; table : see `case_columns`."""
    lines = []
    for case, (largest, node), count in zip(
        all_cases, largest_displacements(f, all_cases), count_slack_cables(f, all_cases)
    ):
        rows, numbers = table["case"] == case.name, [""] * 4
        if largest == largest:
            low, high = np.min(table["tension_min"][rows]), np.max(table["tension_max"][rows])
            numbers = [force(float(low)), force(float(high)), f"{1e3 * largest:.1f} mm at node {node}", count]
        reached = "" if case.carries else f", to a load factor of {case.load_factor:.3g}"
        lines.append([case.name, case.kind, case.state.replace("_", " ") + reached, *numbers])
    header = ["case", "kind", "state", "smallest force", "largest force", "largest displacement"]
    header += ["slack cables"]
    failed = [case for case in all_cases if case.state != EQUILIBRIUM]
    remarks = [item(f"{case.name}: {case.reason}") for case in failed if case.reason]
    if failed:
        text = bold(
            f"{len(failed)} of {len(all_cases)} cases have no equilibrium that was found and is stable."
        )
        remarks = [text, "", *remarks]
    return [
        f"Each is an equilibrium of its own; displacements count from {start_name(f)}. By groups:",
        "cases.csv.",
        "",
        *as_table(header, lines),
        *([""] if remarks else []),
        *remarks,
        *picture("axial forces at rest", "states.png"),
    ]


def checks(f, envelope: Envelope, checked: ElementChecks, table: dict) -> list[str]:
    """Return for each check the worst element of each group, and the stages that count.

    table : see `group_columns`
    """
    lines, kinds = [], stage_kinds(f, envelope)
    has_utilisation = np.isfinite(table["utilisation"].astype(float))
    for check in checked.checks:
        counting = counted(kinds, check.kind)
        names = [name for name, counts in zip(envelope.names, counting) if counts]
        paths = places_of(envelope, counting)
        rows = np.flatnonzero(has_utilisation & (table["check"] == check.name))
        lines += [heading(3, check.title), "", _stages_line(names, check), ""]
        failures = [
            f"UNDECIDED: no equilibrium of {group_title(f, path)} was found."
            if is_undecided(f[path])
            else f"FAILS: {group_title(f, path)} has no equilibrium."
            for path in sorted(groups_without_equilibrium(f, paths), key=lambda path: is_undecided(f[path]))
        ]
        failures += [f"FAILS: {group_title(f, path)} is not stable." for path in unstable_groups(f, paths)]
        lines += [*map(bold, failures), *([""] if failures else [])]
        if not len(rows):
            lines += [f"Empty: {checked.explain_no_utilisation(check)}.", ""]
            continue
        header = ["group", "type", "worst member", "alike", "N_Ed", "in", "N_Rd", "N_Ed / N_Rd", ""]
        lines += [*as_table(header, [_group_row(table, k) for k in rows]), ""]
    return lines


def _stages_line(names: list[str], check: Check) -> str:
    """Return the line on the stages that count for a check."""
    kind = f"Of kind {check.kind}. " if check.kind else ""
    stages = "; ".join(names[:WORST]) + (f"; and {len(names) - WORST} more" if len(names) > WORST else "")
    return f"{kind}The largest {check.of} of each element in: {stages}."


def _group_row(table: dict, k: int) -> list:
    """Return the row of a group in the table of a check."""
    row = {name: values[k] for name, values in table.items()}
    member = f"element {row['element']} of {row['cable']}"
    result = row["result"] if row["result"] != "FAILS" else bold("FAILS")
    return [
        *(row["group"] or "(none)", row["type"], member, row["alike"], force(row["N_Ed"]), row["case"]),
        *(force(row["N_Rd"]), share(row["utilisation"]), result),
    ]


def most_used(f, envelope: Envelope, checked: ElementChecks) -> list[str]:
    """Return the table of the elements that the first check uses most, symmetric ones in one row."""
    check = checked.checks[0].name
    utilisation, ids, cable = checked.utilisation[check], f["net/element_id"][:], f["net/cable"][:]
    names, groups = f["net/cable_names"].asstr()[:], f["net/group_names"].asstr()[:][f["net/group"][:]]
    ranked = [(e, alike) for e, alike in members(f, checked, check) if np.isfinite(utilisation[e])][:WORST]
    shares_of = {entry.name: checked.utilisation[entry.name] for entry in checked.checks}
    columns = [name for name, shares in shares_of.items() if any(np.isfinite(shares[e]) for e, _ in ranked)]
    lines = [
        [names[cable[e]], groups[e], ids[e], alike, force(checked.force[check][e])]
        + [envelope.names[checked.of[check][e]], force(checked.resistance[check][e])]
        + [share(shares_of[name][e]) for name in columns]
        for e, alike in ranked
    ]
    header = ["cable", "group", "element", "alike", "largest tension", "in", "resistance"]
    header += columns
    return ["", f"The {len(lines)} most used by {check}:", "", *as_table(header, lines)] if lines else []


def limits(f, all_cases: list[Case]) -> list[str]:
    """Return the table of the service limits."""
    job = read_job_tables(f)
    if "limits" not in job:
        return ["None: the job has no [limits]."]
    results = limits_of(job, all_cases, largest_displacements(f, all_cases), count_slack_cables(f, all_cases))
    if not results:
        return [f"Not checked: no combination is of kind {COMBINATION_KINDS[1]}."]
    lines = [
        [limit.case, limit.what, f"{limit.value:.4g} {limit.unit}" if np.isfinite(limit.value) else "none"]
        + [limit.at, f"{limit.allowed:.4g} {limit.unit}", "passes" if limit.holds else bold("FAILS")]
        for limit in sorted(results, key=lambda limit: limit.holds)
    ]
    header = ["combination", "what", "reached", "at", "limit", ""]
    return [*as_table(header, lines[:MOST_LISTED]), *more(lines, "cases.csv")]
