"""Sections of a report on cases and combinations: what came of each, checks by group, limits in service."""

import numpy as np

from netfall.checks.cables import Checked
from netfall.checks.cases import largest_displacements, slack_cables
from netfall.checks.codes import Check
from netfall.checks.counted import counted, places_of, stage_kinds, without_equilibrium, without_stability
from netfall.checks.groups import limits_of, members
from netfall.report.markdown import MOST_LISTED, as_table, bold, force, heading, item, more, picture, share
from netfall.results.cases import EQUILIBRIUM, KINDS, Case
from netfall.results.file import job_of
from netfall.results.states import Envelope, is_undecided, start_words, state_words

WORST = 10


def cases(f, made: list[Case], table: dict) -> list[str]:
    """A row for each case; table : as of `case_columns`."""
    lines = []
    for case, (most, node), count in zip(made, largest_displacements(f, made), slack_cables(f, made)):
        mine, figures = table["case"] == case.name, [""] * 4
        if most == most:
            low, high = np.min(table["tension_min"][mine]), np.max(table["tension_max"][mine])
            figures = [force(float(low)), force(float(high)), f"{1e3 * most:.1f} mm at node {node}", count]
        reached = "" if case.carries else f", to a load factor of {case.load_factor:.3g}"
        lines.append([case.name, case.kind, case.state.replace("_", " ") + reached, *figures])
    header = ["case", "kind", "state", "smallest force", "largest force", "largest displacement"]
    header += ["slack cables"]
    failed = [case for case in made if case.state != EQUILIBRIUM]
    told = [item(f"{case.name}: {case.reason}") for case in failed if case.reason]
    if failed:
        none = bold(f"{len(failed)} of {len(made)} cases have no equilibrium that was found and is stable.")
        told = [none, "", *told]
    return [
        f"Each is an equilibrium of its own; displacements count from {start_words(f)}. By groups:",
        "cases.csv.",
        "",
        *as_table(header, lines),
        *([""] if told else []),
        *told,
        *picture("axial forces at rest", "states.png"),
    ]


def checks(f, envelope: Envelope, checked: Checked, table: dict) -> list[str]:
    """For each check the worst of each group, and what counts for it; table : as of `group_columns`."""
    lines, kinds = [], stage_kinds(f, envelope)
    known = np.isfinite(table["utilisation"].astype(float))
    for check in checked.checks:
        which = counted(kinds, check.kind)
        names = [name for name, counts in zip(envelope.names, which) if counts]
        places = places_of(envelope, which)
        mine = np.flatnonzero(known & (table["check"] == check.name))
        lines += [heading(3, check.title), "", _counts(names, check), ""]
        told = [
            f"UNDECIDED: no equilibrium of {state_words(f, place)} was found."
            if is_undecided(f[place])
            else f"FAILS: {state_words(f, place)} has no equilibrium."
            for place in sorted(without_equilibrium(f, places), key=lambda place: is_undecided(f[place]))
        ]
        told += [f"FAILS: {state_words(f, place)} is not stable." for place in without_stability(f, places)]
        lines += [*map(bold, told), *([""] if told else [])]
        if not len(mine):
            lines += [f"Empty: {checked.why_empty(check)}.", ""]
            continue
        header = ["group", "type", "worst member", "alike", "N_Ed", "in", "N_Rd", "N_Ed / N_Rd", ""]
        lines += [*as_table(header, [_group_row(table, k) for k in mine]), ""]
    return lines


def _counts(names: list[str], check: Check) -> str:
    of = f"Of kind {check.kind}. " if check.kind else ""
    few = "; ".join(names[:WORST]) + (f"; and {len(names) - WORST} more" if len(names) > WORST else "")
    return f"{of}The largest {check.of} of each element in: {few}."


def _group_row(table: dict, k: int) -> list:
    of = {name: values[k] for name, values in table.items()}
    member = f"element {of['element']} of {of['cable']}"
    result = of["result"] if of["result"] != "FAILS" else bold("FAILS")
    return [
        *(of["group"] or "(none)", of["type"], member, of["alike"], force(of["N_Ed"]), of["case"]),
        *(force(of["N_Rd"]), share(of["utilisation"]), result),
    ]


def most_used(f, envelope: Envelope, checked: Checked) -> list[str]:
    """The members that are most used by the first check, symmetric ones in one row."""
    check = checked.checks[0].name
    used, ids, cable = checked.utilisation[check], f["net/element_id"][:], f["net/cable"][:]
    names, groups = f["net/cable_names"].asstr()[:], f["net/group_names"].asstr()[:][f["net/group"][:]]
    found = [(e, alike) for e, alike in members(f, checked, check) if np.isfinite(used[e])][:WORST]
    every = {each.name: checked.utilisation[each.name] for each in checked.checks}
    shown = [name for name, shares in every.items() if any(np.isfinite(shares[e]) for e, _ in found)]
    lines = [
        [names[cable[e]], groups[e], ids[e], alike, force(checked.force[check][e])]
        + [envelope.names[checked.of[check][e]], force(checked.resistance[check][e])]
        + [share(every[name][e]) for name in shown]
        for e, alike in found
    ]
    header = ["cable", "group", "element", "alike", "largest tension", "in", "resistance"]
    header += shown
    return ["", f"The {len(lines)} most used by {check}:", "", *as_table(header, lines)] if lines else []


def limits(f, made: list[Case]) -> list[str]:
    """What the limits in service come to."""
    job = job_of(f)
    if "limits" not in job:
        return ["None: the job has no [limits]."]
    found = limits_of(job, made, largest_displacements(f, made), slack_cables(f, made))
    if not found:
        return [f"Not checked: no combination is of kind {KINDS[1]}."]
    lines = [
        [each.case, each.what, f"{each.value:.4g} {each.unit}" if np.isfinite(each.value) else "none"]
        + [each.at, f"{each.allowed:.4g} {each.unit}", "passes" if each.holds else bold("FAILS")]
        for each in sorted(found, key=lambda each: each.holds)
    ]
    header = ["combination", "what", "reached", "at", "limit", ""]
    return [*as_table(header, lines[:MOST_LISTED]), *more(lines, "cases.csv")]
