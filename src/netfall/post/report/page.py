"""Page summary.md of a report: the run, governing members, factors of the checks; numbers have units."""

import re
from collections import Counter
from collections.abc import Collection
from itertools import compress, product
from pathlib import Path

import h5py
import numpy as np

from netfall.core.messages import count_of, mm, warning_count
from netfall.job.values import format_list
from netfall.post.checks.bending import is_concrete
from netfall.post.checks.cables import PASSES, Cutting, ElementCheck, element_groups, slack_cables
from netfall.post.checks.cases import limits_of
from netfall.post.checks.ends import end_weights
from netfall.post.checks.nodes import FRICTION_SAFETY
from netfall.post.report import markdown as md
from netfall.post.report.sections import (
    at_limits,
    bending,
    cases,
    checks,
    concrete,
    groups,
    limits,
)
from netfall.results import file, removals, states, warning_text
from netfall.results.datasets import UNDECIDED
from netfall.results.file import read_cases
from netfall.results.removals import worst_removals
from netfall.results.states import Envelope

SHOWN_ROWS = 10  # rows of the most used elements after removals
NEGLIGIBLE_SUM = 1e-8  # share of the summed forces; smaller sums are residuals of the equilibrium
NEGLIGIBLE_SLIP = 1e-9  # m; smaller slips are residuals of the equilibrium
ALL_STAGES = "all stages"
COLUMNS = {
    "cables.csv": "one row per cable: strength [N]; largest tension at an end and smallest in the middle "
    "(of bars at an end) [N] with stage, time [s] and element of the largest; stages in which it is slack; "
    "times [s] at which its first element was removed and broke; after a removal the largest ratio of "
    "tension to tension before, and the largest dynamic factor (if the equilibrium changes enough); "
    "resistance [N], utilisation",
    "elements.csv": "the same for each element, with its nodes and `unstressed_length` [m]; for bars with "
    "a second moment `buckling_length` [m], `euler_load` [N], relative `slenderness`, `chi` of EN "
    "1993-1-1; for bending chains `bending_moment_max`, in checks with bending `moment`, "
    "`moment_resistance` [N m]",
    "cutting_list.csv": "one row per cable: `unstressed_length` [m] at the temperature of form finding, "
    "`length_in_form` [m], `temperature` [K], `unstressed_length_at_temperature` [m], `measuring_load` [N], "
    "`length_at_measuring_load` [m] (at that temperature), `mass` [kg]",
    "cases.csv": "one row per case or combination and group: smallest and largest force [N], largest "
    "displacement [m] from {start} and from the permanent state, slack cable elements, state, load factor "
    "reached, reason",
    "forces.csv": "one row per element: the force in its middle [N] in the form and in each case and stage",
    "displacements.csv": "one row per node: its displacement [m] and components from {start} (of stages from "
    "the form), and from the permanent state; largest in motion",
    "checks.csv": "one row per check and group, worst first: the governing member, how many members are "
    "`alike` (same utilisation), the governing case, N_Ed (at an end) and N_Rd [N], utilisation, result; in "
    "checks with bending M_Ed and M_Rd [N m]",
    "moments.csv": "one row for each end of bars of bending chains or of concrete, in each equilibrium: "
    "force N [N], magnitude `moment`, `moment_vertical` and `moment_plan` with sign [N m]",
    "reactions.csv": "one row per support and stage: position [m]; `force` [N] of the elements on the "
    "support along its held axes, at an elastic support the force on its spring; `foundation` [N]: the "
    "same plus the loads on the node itself; in motion its highest and lowest components, largest magnitude",
    "slides.csv": "with `[[slide]]`, one row per clamp or saddle and stage: tensions on both sides and "
    "their difference, slip resistance [N], utilisation, slip [m]; the largest for `dynamics`",
    "shop_list.csv": "one row per set of equal pieces: lengths and marks of clamps (of the first "
    "cable, from its end of the smaller node id) [mm] under the measuring load [N] "
    "at the temperature [K], sum of the deductions at both ends, mass [kg] of one piece",
}


def summary(
    f: h5py.File,
    result: Path,
    tables: dict[str, dict[str, np.ndarray]],
    envelope: Envelope,
    checked: list[ElementCheck],
    cutting: Cutting,
    more_warnings: list[str],
) -> str:
    """Assemble the page; more_warnings : in addition to those of the run."""
    cables, all_cases = tables["cables.csv"], read_cases(f)
    service = limits_of(f, all_cases)
    bends = "bending_moment_max" in tables["elements.csv"]
    warnings = file.warnings_of_run(f) + more_warnings
    remarks = map(md.item, [*map(md.bold, warnings), *file.notes_of_run(f)])
    sections = {
        "Warnings and notes": [f"{warning_count(warnings)}.", "", *remarks],
        "Groups": groups(f),
        "Cases and combinations": all_cases and cases(f, all_cases, tables["cases.csv"]),
        "Checks": checks(f, envelope, checked, tables["checks.csv"]),
        "Elements at a limit": at_limits(f),
        "Limits in service": (all_cases or service is not None) and limits(service, all_cases),
        "Utilisation": _utilisation(cables, checked),
        "Bending": bends and bending(f, envelope, tables),
        "Reinforced concrete": concrete(f, envelope, tables),
        "Clamps and saddles": "slides.csv" in tables and _slides(tables["slides.csv"]),
        "Factors": _factors(checked),
        "Tensions": _tensions(f, envelope, checked[0]),
        "Member removals": "removal" in f and _removals(f, checked, tables["elements.csv"]),
        "Removed and broken cables": _failed_cables(cables),
        "Slack cables": _slack(f, cables, envelope),
        "Reactions": _reactions(f, tables["reactions.csv"]),
        "Cutting list": _cutting(f, tables["cutting_list.csv"], cutting),
        "Shop list": _shop(f, tables["shop_list.csv"]),
        "Tables": _tables(f, tables),
    }
    verdict = _not_passed(tables["checks.csv"], all(limit.holds for limit in service or ()))
    parts = [[md.heading(1, file.result_title(f) or result.stem), "", *_run_lines(f, result, verdict)]]
    parts += [[md.heading(2, title), "", *lines] for title, lines in sections.items() if lines]
    return "\n".join(map(md.page, parts))


def _not_passed(table: dict[str, np.ndarray], limits_hold: bool) -> list[str]:
    """Return a line on the checks, with their groups, and the limits that are not passed; [] if all are.

    table : see `group_columns`
    """
    failed: dict[str, list[str]] = {}
    for check, result, group in zip(table["check"], table["result"], table["group"]):
        if result not in ("", PASSES):
            failed.setdefault(f"{check} {result}", []).append(group or "no group")
    texts = [f"{result} ({format_list(names)})" for result, names in failed.items()]
    texts += ["limits in service FAIL"] * (not limits_hold)
    return [md.bold(f"Not passed: {'; '.join(texts)}.")] if texts else []


def _run_lines(f: h5py.File, result: Path, verdict: list[str]) -> list[str]:
    """Return the lines on the run, failed states, checks and energy errors; verdict : on the checks."""
    p, overrides = f["provenance"].attrs, file.provenance_text(f, "overrides")
    lines = [
        md.markup("Result {} of netfall {}, {}.", md.code(result.name), p["netfall"], p["exit_state"]),
        f"{len(f['net/particles'])} particles, {count_of(len(f['net/elements']), 'element')} in "
        f"{count_of(len(f['net/cable_names']), 'cable')}. Ids are those of the tables; "
        "forces are positive in tension.",
        f"Digest of the job and its net: {p['job_digest'][:16]}.",
    ]
    failed = [path for path in states.equilibrium_groups(f) if states.no_equilibrium(f[path])]
    if overrides:
        lines.append(md.markup("With {}.", md.Markup(", ".join(map(md.code, overrides.split("\n"))))))
    if "form_finding" in f:
        lines += [line[0].upper() + line[1:] + "." for line in file.form_finding_lines(f)]
        if states.no_equilibrium(f["form_finding"]):
            lines.append(md.bold(f"Not reached: {f['form_finding'].attrs['reason']}."))
        if "deviation" in f and states.no_equilibrium(f["deviation"]):
            lines.append(md.bold(f"No equilibrium: {f['deviation'].attrs['reason']}."))
    for path in failed:
        is_open = f[path].attrs["state"] == UNDECIDED
        how = "is undecided (there may be an equilibrium)" if is_open else "has no equilibrium"
        lines.append(md.bold(f"{states.group_title(f, path)} {how}: {f[path].attrs['reason']}."))
    lines += verdict
    if "history" in f:
        if len(f["events/element"]):
            broken = len(np.unique(f["events/element_id"][:]))
            lines.append(
                f"{count_of(broken, 'element')} broke, the first at t = {f['events/time'][0]:.4g} s."
            )
        moved, start = f["envelope/displacement_max"][:], states.start_name(f)
        node = int(np.nanargmax(moved))
        when = f"at node {f['net/node_id'][node]}, t = {f['envelope/displacement_max_time'][node]:.4g} s"
        lines.append(f"Largest displacement in motion, from {start}: {mm(moved[node])} {when}.")
        known = np.isfinite(f["history/energy_balance_error"]).any()
        error = warning_text.balance_text(f["history"]) if known else "not known (no energy check)"
        lines.append(f"Largest energy balance error: {error}.")
    if "form_finding" in f:
        lines += md.picture("the form, by axial force", "form.png")
    if "stages" in f:
        lines += md.picture("the stages of erection, by axial force", "stages.png")
    return lines


def _utilisation(cables: dict[str, np.ndarray], checked: list[ElementCheck]) -> list[str]:
    """Return the section on utilisation by all checks."""
    lines = [
        "Forces result from the loads of the job, without further factors. Utilisation is the largest",
        "tension, or compression, over resistance, with given strengths, not random draws. It is that of",
        "the end with the larger force, which exceeds the force in the middle, in other tables, by half of",
        "the weight, ice and line load of the element along it. Compression",
        "is checked only for bars with a second_moment. The force in an element cannot exceed its yield",
        "force or buckling load, so an element that yields, buckles or breaks in motion fails, whatever",
        "its utilisation.",
        "",
    ]
    for one in checked:
        values = cables[f"utilisation_{one.name}"]
        has_value = np.flatnonzero(np.isfinite(values))
        words = f"empty, {one.explain_no_utilisation()}"
        if len(has_value):
            worst, results = has_value[np.argmax(values[has_value])], cables[f"result_{one.name}"]
            others = Counter(result for result in results if result not in ("", PASSES, "FAILS"))
            counts = [f"cables that fail: {(results == 'FAILS').sum()}"]
            counts += [f"{result}: {count}" for result, count in others.items()]
            counts.append(f"without value: {len(values) - len(has_value)}")
            words = f"largest {values[worst]:.4g} in cable {cables['cable'][worst]}, {', '.join(counts)}"
        lines.append(md.item(f"{one.check.title}: {words}"))
    no_strength = ~np.isfinite(cables["breaking_load"]) & ~np.isfinite(cables["yield_force"])
    if no_strength.any():
        text = "cables without utilisation, because they have neither breaking_load nor yield_stress"
        lines.append(md.item(f"{text}: {int(no_strength.sum())}"))
    return lines + md.picture("utilisation of the elements", "utilisation.png")


def _slides(table: dict[str, np.ndarray]) -> list[str]:
    """Return the most used clamp or saddle and the slip of each stage; table : see `slip_point_columns`."""
    rows = []
    for stage, stage_rows in _by_stage(table):
        columns = {name: values[stage_rows] for name, values in table.items()}
        difference, slip = (np.abs(np.nan_to_num(columns[name])) for name in ("difference", "slip"))
        worst = np.lexsort((difference, np.nan_to_num(columns["utilisation"], nan=-1.0)))[-1]
        row = {name: values[worst] for name, values in columns.items()}
        holds = row["holds"]  # nan for saddles in motion, because their tensions are not recorded
        held = "not known" if np.isnan(holds) else md.force(holds)
        count = (slip > NEGLIGIBLE_SLIP).sum()
        slipped = f"{count}, by up to {1e3 * slip.max():.4g} mm" if count else "none"
        where, difference = f"node {row['node']}, cable {row['cable']}", md.force(abs(row["difference"]))
        rows.append([stage, where, difference, held, md.share(row["utilisation"]), slipped])
    explanation = [
        "Utilisation is the difference of the tensions on both sides over the resistance. For clamps this is",
        "the given slip resistance, for saddles the friction over "
        f"{FRICTION_SAFETY:g} (EN 1993-1-11, 6.3), so a saddle slips",
        "above 1. A clamp slips at 1; in motion the inertia of its cable can raise the value.",
        "",
    ]
    header = ["stage", "governing slip point", "difference", "resistance", "utilisation", "slip"]
    return explanation + md.as_table(header, rows)


def _factors(checked: list[ElementCheck]) -> list[str]:
    """Return the table of the factors of all checks."""
    rows = []
    for check in (one.check for one in checked):
        for strength, factors in check.resistances:
            for factor in factors:
                group_values = "".join(f"; {group}: {value:g}" for group, value in factor.groups.items())
                sign = "times" if factor.use == "multiply" else "over"
                value = f"{sign} {factor.value:g}{group_values}"
                rows.append([check.name, md.code(strength), factor.name, value])
                rows[-1] += [factor.edition, factor.meaning]
    return md.as_table(["check", "of", "factor", "value", "edition", "meaning"], rows)


def _tensions(f: h5py.File, envelope: Envelope, check: ElementCheck) -> list[str]:
    """Return the table of utilisation, governed elements and slack elements by stage."""
    ids, rows = f["net/element_id"][:], []
    order = np.argsort(-envelope.most, kind="stable")
    worst = order[np.unique(ids[order], return_index=True)[1]]  # part of each subdivided element
    present = worst[~np.isnan(envelope.most[worst])]
    governs = np.bincount(envelope.of_most[present], minlength=len(envelope.names))
    shares = np.where(envelope.high < 0.0, np.nan, envelope.high) / check.resistance  # not of compression
    for k, name in enumerate(envelope.names):
        known = not np.isnan(shares[k]).all()
        largest = f"{np.nanmax(shares[k]):.3f} (element {ids[np.nanargmax(shares[k])]})" if known else ""
        rows.append([name, largest, governs[k], states.count_elements(f, envelope.slack[k])])
    header = ["stage", f"largest utilisation, {check.name}", "governs elements", "slack elements"]
    return md.as_table(header, rows)


def _removals(f: h5py.File, checked: list[ElementCheck], elements: dict[str, np.ndarray]) -> list[str]:
    """Return the effects of each removal, and the largest tensions after removals.

    elements : from `element_columns`
    """
    g, ids = f["removal"], f["net/element_id"][:]
    names, cable = f["net/cable_names"].asstr()[:], f["net/cable"][:]
    lines: list[str] = [md.item(line) for line in states.described_removals(f)]
    check, resistance, rows = checked[0].name, checked[0].resistance, []
    end_weight = end_weights(f)(removals.REMOVAL, states.start_position(f), 1.0)
    for k, e in worst_removals(f, resistance, end_weight, SHOWN_ROWS):
        N = {name: g[f"tension_{name}"][k, e] for name in ("before", "highest", "after")}
        factors = removals.significant_dynamic_factors(g, k, removals.first_fracture(f["events"]))
        numbers = removals.tension_ratios(g, k)[e], factors[e], (N["highest"] + end_weight[e]) / resistance[e]
        figures = [f"{value:.3g}" if np.isfinite(value) else "" for value in numbers]
        rows.append([k + 1, names[cable[e]], ids[e], *map(md.force, N.values()), *figures])
    if not rows:
        return lines
    header = ["removal", "cable", "element", "before", "largest", "equilibrium afterwards"]
    header += ["largest / before", "dynamic factor", check]
    explanation = (
        "The elements with the highest utilisation after a removal, by the tensions of every step. The "
        "dynamic factor is (peak - before) / (equilibrium afterwards - before). If the tension decreases, "
        f"the peak is the smallest tension. The factor is given {removals.WHERE_SIGNIFICANT}, and if nothing "
        "broke before the next removal:"
    )
    picture = [
        "",
        md.bold("No dynamic factor is known: there is no equilibrium, no large change, or elements broke."),
    ]
    if np.isfinite(elements["dynamic_factor"]).any():
        picture = md.picture("dynamic factors after removals", "dynamic_factors.png")
    return [*lines, "", explanation, "", *md.as_table(header, rows), *picture]


def _failed_cables(cables: dict[str, np.ndarray]) -> list[str]:
    """Return the cables of which an element was removed or broke, in order of time."""
    times = np.array([cables["lost_at"], cables["broken_at"]])
    first = np.fmin.reduce(times)
    rows = [k for k in np.argsort(first, kind="stable") if np.isfinite(first[k])]
    if not rows:
        return ["None."]
    cells = np.where(np.isfinite(times), np.char.mod("%.4g s", times), "")
    table = [[cables["cable"][k], cables["group"][k], *cells[:, k]] for k in rows]
    lines = [f"Cables with an element that was removed or broke: {len(rows)}.", ""]
    return lines + md.as_table(["cable", "group", "removed at", "broke at"], table, "cables.csv")


def _slack(f: h5py.File, cables: dict[str, np.ndarray], envelope: Envelope) -> list[str]:
    """Return the table of slack cables."""
    has_force = np.any(np.nan_to_num([envelope.high, envelope.low]), axis=(0, 2))  # (stages,)
    names, forceless = (list(compress(envelope.names, which)) for which in (has_force, ~has_force))
    text = [f"No element has a force in: {'; '.join(forceless)}.", ""] * bool(forceless)
    slack = [list(compress(names, of_cable)) for of_cable in slack_cables(f, envelope)[has_force].T]
    stages_of = {k: _abbreviate_stages(stages, names) for k, stages in enumerate(slack) if stages}
    if not stages_of:
        return text + [f"No intact cable is slack in any of: {', '.join(names)}."] * bool(names)
    rows = sorted(stages_of, key=lambda k: stages_of[k] == ALL_STAGES)  # always slack ones come last
    table = [[cables["cable"][k], cables["group"][k], stages_of[k]] for k in rows]
    lines = [f"Cables with a slack element, in stages in which they are intact: {len(rows)}.", ""]
    return text + lines + md.as_table(["cable", "group", "slack in"], table, "cables.csv")


def _abbreviate_stages(stages: list[str], names: list[str]) -> str:
    """Describe a subset of all stages briefly."""
    others = [name for name in names if name not in stages]
    if 2 * len(stages) <= len(names):
        return "; ".join(stages)
    return f"all stages except {'; '.join(others)}" if others else ALL_STAGES


def _reactions(f: h5py.File, table: dict[str, np.ndarray]) -> list[str]:
    """Return the sums and the largest reaction of each stage, and the extremes in motion."""
    rows = []
    for stage, stage_rows in _by_stage(table):
        if stage.startswith(f"{states.DYNAMIC_STAGE}, "):
            continue
        name = "foundation" if np.isfinite(table["foundation"][stage_rows]).all() else "force"
        top = stage_rows[np.argmax(table[name][stage_rows])]
        total = np.array([table[f"{name}_{axis}"][stage_rows].sum() for axis in "xyz"])
        total[np.abs(total) < NEGLIGIBLE_SUM * table[name][stage_rows].sum()] = 0.0
        largest = f"{md.force(table[name][top])} at node {table['node'][top]}"
        rows.append([stage, *map(md.force, total), largest])
    lines = [
        "Sums over all supports of the forces on the foundation: the pull of the elements (at elastic",
        "supports the force on the spring) and the loads on the node itself. In the final state and without",
        "an equilibrium under the whole load, only the pull. Largest: at one support.",
        "",
    ]
    if "envelope/reaction_max" in f:
        e, largest = f["envelope"], f["envelope/reaction_max"][:]
        top = int(np.argmax(largest))
        lines += [
            f"Largest in motion: {md.force(largest[top])} at node {f['net/node_id'][top]}, "
            f"t = {e['reaction_max_time'][top]:.4g} s, over rows of the history and at least every 50 steps;",
            "over all steps if elements can yield, break or are removed, loads act at once or supports move.",
            "",
        ]
    lines += md.as_table(["stage", "sum in x", "sum in y", "sum in z", "largest"], rows)
    return lines + _governing_supports(f, table)


def _governing_supports(f: h5py.File, table: dict[str, np.ndarray]) -> list[str]:
    """Return the table of the supports that have the extremes of a component on the foundation.

    The form counts only without stages of erection, because the structure is never in that state with them.
    """
    known = np.isfinite(table["foundation_x"]) & ~((table["stage"] == "form") & ("stages" in f))
    R = np.column_stack([table[f"foundation_{axis}"] for axis in "xyz"])[known]
    node, names = table["node"][known], table["stage"][known]
    R[np.abs(R) < NEGLIGIBLE_SUM * np.abs(R).max(initial=0.0)] = 0.0
    governs: dict[int, list[str]] = {}
    for k, (which, sign) in product(range(3), (("least", -1.0), ("largest", 1.0))):
        values = np.round(sign * R[:, k], 6)
        if (values > 0.0).any():
            top = int(np.argmax(values))
            state = re.sub(f"^({states.DYNAMIC_STAGE}), (lowest|highest)$", r"\1", names[top])
            governs.setdefault(node[top], []).append(f"{which} {'xyz'[k]} ({state})")
    rows = []
    for support, extremes in governs.items():
        ends = zip(R[node == support].min(0), R[node == support].max(0))
        rows.append([support, ", ".join(extremes), *(f"{md.force(a)} to {md.force(b)}" for a, b in ends)])
    title = "Supports with the extremes of a component, and all its values, over these states and the motion:"
    return ["", title, "", *md.as_table(["node", "governs", "x", "y", "z"], rows)] if rows else []


def _by_stage(table: dict[str, np.ndarray]) -> list[tuple[str, np.ndarray]]:
    """Return the stages of a table in its order, with the rows of each."""
    return [(stage, np.flatnonzero(table["stage"] == stage)) for stage in dict.fromkeys(table["stage"])]


def _cutting(f: h5py.File, table: dict[str, np.ndarray], cutting: Cutting) -> list[str]:
    """Return the lines on the cutting list."""
    mean = f"its mean tension {'after' if states.last_stage(f) else 'in'} {states.start_name(f)}"
    load = mean if cutting.load is None else md.force(cutting.load)
    warning = (
        "These lengths and the shop list include random length errors (length_std). For the lengths to cut, "
        "write the report of a run without length_std."
    )
    return [md.bold(warning), ""] * ("deviation" in f) + [
        f"{count_of(len(table['cable']), 'cable')}, {table['unstressed_length'].sum():.6g} m unstressed",
        f"at the temperature of form finding, {table['mass'].sum():.5g} kg. Measured at",
        f"{cutting.temperature:+g} K from that temperature, each cable under {load}, bars without load.",
    ]


def _shop(f: h5py.File, table: dict[str, np.ndarray]) -> list[str]:
    """Return the first rows of the shop list."""
    concrete = list(dict.fromkeys(element_groups(f)[is_concrete(f)]))
    left_out = [f"Without members of concrete: {', '.join(concrete)}.", ""] if concrete else []
    names = ("mark", "count", "type", "length_pin_to_pin", "cut_length", "measuring_load", "clamps")
    lines = [
        [*piece, f"{pins:.1f}", f"{cut:.1f}", md.force(load), len(clamps.split("; ")) if clamps else 0]
        for *piece, pins, cut, load, clamps in zip(*(table[name] for name in names))
    ]
    header = ["mark", "pieces", "type", "pin to pin", "cut length", "measuring load", "clamps"]
    return left_out + [
        f"{len(lines)} different pieces, {sum(table['count'])} in all; "
        "lengths in mm under the measuring load,",
        "with the positions of clamps in shop_list.csv.",
        "",
        *md.as_table(header, lines, "shop_list.csv"),
    ]


def _tables(f: h5py.File, tables: Collection[str]) -> list[str]:
    """Return the list of the tables that the report has, with their columns."""
    start, described = states.start_name(f), [item for item in COLUMNS.items() if item[0] in tables]
    lines = [md.markup("- {}: " + text, md.code(name), start=start) for name, text in described]
    return [
        *lines,
        "",
        "Numbers are in SI units: m, N, kg, s, K. An empty cell means that there is no value.",
    ]
