"""Tables of a report by case, and checks by group: forces, displacements, governing elements, limits."""

import itertools
from collections.abc import Iterable
from typing import Any, NamedTuple

import h5py
import numpy as np

from netfall.core.functions import lengths
from netfall.job.keys.groups import ANY_GROUP, displacement_limits
from netfall.job.keys.models import Limits
from netfall.job.validate import Validator
from netfall.post.checks import cables
from netfall.post.checks.cables import element_groups, element_name_columns
from netfall.results import states
from netfall.results.datasets import EQUILIBRIUM
from netfall.results.file import COMBINATION_KINDS, Case, read_job_tables

NAN = np.nan
REFERENCES = "form", "permanent"  # references of displacements


def case_columns(f: h5py.File, cases: list[Case]) -> dict[str, np.ndarray]:
    """Return extremes of forces [N] and displacements [m], one row for each case and group of elements.

    slack : elements of slack cables. A case without equilibrium has a reason and no numbers. A group that
    erection has removed has no forces.
    """
    group, rows = element_groups(f), []
    groups = {name: np.flatnonzero(group == name) for name in dict.fromkeys(group.tolist())}
    for case in cases:
        numbers = _extremes(f, case, groups) if case.carries else {name: [NAN] * 9 for name in groups}
        outcome = [case.state, case.load_factor, case.reason]
        rows += [[case.name, case.kind, name, *numbers[name], *outcome] for name in groups]
    names = ["case", "kind", "group", "tension_min", "element_min", "tension_max", "element_max"]
    names += ["displacement_max", "node_max", "from_permanent_max", "node_from_permanent"]
    names += ["slack", "state", "load_factor", "reason"]
    columns = zip(*rows) if rows else [[]] * len(names)
    return {name: np.array(values, object) for name, values in zip(names, columns)}


def _extremes(f: h5py.File, case: Case, groups: dict[str, np.ndarray]) -> dict[str, list[Any]]:
    """Compute the numbers of a row of `case_columns` by group; groups : elements (k,) of each group."""
    ids, nodes, ends = f["net/element_id"][:], f["net/node_id"][:], f["net/elements"][:]
    N, displacements = case.shown.tension(), [displacements_from(f, case, name) for name in REFERENCES]
    is_absent, by_group = states.absent(f), {}
    slack = states.slack_elements(f, N) & ~is_absent
    for name, rows in groups.items():
        low, high, node = rows[np.argmin(N[rows])], rows[np.argmax(N[rows])], np.unique(ends[rows])
        by_group[name] = [NAN] * 4 if is_absent[rows].all() else [N[low], ids[low], N[high], ids[high]]
        for displacement in displacements:
            farthest = node[np.argmax(displacement[node])]
            by_group[name] += [displacement[farthest], nodes[farthest]]
        by_group[name].append(len(np.unique(ids[rows][slack[rows]])))
    return by_group


def displacements_from(f: h5py.File, case: Case, reference: str) -> np.ndarray:
    """Compute the displacements (n,) [m] of the nodes in a case; nan if it has no equilibrium.

    reference : one of REFERENCES
    """
    start = states.start_position(f) if reference == "form" else states.permanent_position(f)
    unknown = start is None or not case.carries
    return np.full(len(f["net/node_id"]), NAN) if unknown else lengths(case.shown.position() - start)


def largest_displacements(f: h5py.File, cases: list[Case], reference: str) -> list[tuple[float, int]]:
    """Find the largest displacement [m] in each case, and its node's id; see `displacements_from`."""
    displacements = [displacements_from(f, case, reference) for case in cases]
    largest = [(values, int(np.argmax(values))) for values in displacements]
    return [(float(values[node]), int(f["net/node_id"][node])) for values, node in largest]


def count_slack_cables(f: h5py.File, cases: list[Case]) -> list[int]:
    """Count the cables of each case that have a slack element."""
    is_present, cable = ~states.absent(f), f["net/cable"][:]
    return [
        len(np.unique(cable[states.slack_elements(f, case.shown.tension()) & is_present])) for case in cases
    ]


def force_columns(f: h5py.File, cases: list[Case]) -> dict[str, np.ndarray]:
    """Return the forces [N], one row for each element and one column for each static state.

    The columns are the form, the cases by their names, and other stages.
    """
    columns = element_name_columns(f)
    for name, stage in _by_name(columns, cases, states.equilibria(f)):
        columns[name] = stage.tension() * factor(cases, stage)
    return columns


def displacement_columns(f: h5py.File, cases: list[Case]) -> dict[str, np.ndarray]:
    """Return the displacements [m], one row for each node.

    Each static state except the form has four columns: the magnitude and the three components. Displacements
    in stages of erection refer to the form, in later states to the last stage. Later states, except the
    permanent state, have four more columns relative to the permanent state. The last column has the largest
    magnitudes in motion.
    """
    form, x, permanent = states.form_position(f), states.start_position(f), states.permanent_position(f)
    columns = {"node": f["net/node_id"][:], **{axis: x[:, k] for k, axis in enumerate("xyz")}}
    shown = [state for state in states.equilibria(f) if state.place not in ("", states.FORM_GROUP)]
    shown += states.removal_equilibria(f) if "removal/displacement_after" in f else []
    stages = _by_name(columns, cases, shown)
    reserved = {*columns, *(name for name, _ in stages)}
    for name, stage in stages:
        is_erection = stage.place.startswith("stages/")
        starts = {name: form if is_erection else x}
        if permanent is not None and not is_erection and stage.place != states.PERMANENT:
            starts[_free_name(reserved, f"{name}, from permanent")] = permanent
        for title, start in starts.items():
            displacement = (stage.position() - start) * factor(cases, stage)
            columns[title] = lengths(displacement)
            for k, axis in enumerate("xyz"):  # "wind x" may also be a case
                columns[_free_name(reserved, f"{title} {axis}", f"{title}, {axis}")] = displacement[:, k]
    if "history" in f:
        columns[_free_name(reserved, states.DYNAMIC_STAGE)] = f["envelope/displacement_max"][:]
    return columns


def _by_name(
    columns: Iterable[str], cases: list[Case], stages: Iterable[states.StateView]
) -> list[tuple[str, states.StateView]]:
    """Return the states by the names of their columns: name of the case or, if in use, of the state."""
    reserved, own_names = set(columns), {case.shown.place: case.name for case in cases}
    return [
        (_free_name(reserved, own_names.get(stage.place, stage.name), stage.name), stage) for stage in stages
    ]


def _free_name(reserved: set[str], *names: str) -> str:
    """Return the first name that is not reserved, otherwise the last name with a number, and reserve it."""
    numbered = (f"{names[-1]} ({k})" for k in itertools.count(2))
    name = next(name for name in itertools.chain(names, numbered) if name not in reserved)
    reserved.add(name)
    return name


def factor(cases: list[Case], stage: states.StateView) -> float:
    """Return nan for a state of a case without equilibrium, 1 otherwise.

    The state of such a case belongs to a smaller load, so its numbers must not appear as those of the case.
    """
    return NAN if any(case.shown.place == stage.place and not case.carries for case in cases) else 1.0


# relative difference of forces below which elements of a group and type share a row (symmetry)
SYMMETRY = 1e-3


class ServiceLimit(NamedTuple):
    """Service limit of [limits] in a combination.

    value : reached; allowed : given in the job, both in `unit`; at : place, in words
    """

    case: str
    what: str
    unit: str
    value: float
    allowed: float
    at: str
    holds: bool


def group_columns(
    f: h5py.File, envelope: states.Envelope, checked: list[cables.ElementCheck]
) -> dict[str, np.ndarray]:
    """Return the element with the largest utilisation, one row for each check and group.

    The rows of a check begin with the worst group.
    alike : number of elements of the group and type with the same force, this one included
    result : see `ElementCheck.results`
    """
    rows: list[tuple[Any, ...]] = []
    names, types = cables.element_groups(f), cables.element_types(f)
    for one in checked:
        first_rows: dict[str, tuple[Any, ...]] = {}  # of each group
        results = one.results()
        for e, count in members(f, one):
            row = (one.name, one.check.kind, e, count, one.of[e], one.force[e], one.resistance[e])
            row += one.moment[e], one.moment_resistance[e], one.utilisation[e], results[e]
            first_rows.setdefault(names[e], row)
        rows += first_rows.values()
    check, kind, elements, alike, of, force, resistance, *moments, utilisation, result = map(list, zip(*rows))
    return {
        "check": np.array(check, object),
        "kind": np.array(kind, object),
        "group": names[elements],
        "type": types[elements],
        "cable": f["net/cable_names"].asstr()[:].astype(object)[f["net/cable"][:][elements]],
        "element": f["net/element_id"][:][elements],
        "alike": np.array(alike),
        "case": np.array(envelope.names, object)[of],
        "N_Ed": np.array(force),
        "N_Rd": np.array(resistance),
        "utilisation": np.array(utilisation),
        "result": np.array(result),
        "M_Ed": np.array(moments[0]),
        "M_Rd": np.array(moments[1]),
    }


def members(f: h5py.File, checked: cables.ElementCheck) -> list[tuple[int, int]]:
    """Rank the elements by their utilisation in a check, and count how many each represents.

    Elements of one group, type and resistance with equal forces share one row, with the name of the first. A
    subdivided element counts once, with its most used part.
    """
    R, key = checked.resistance, checked.ranking_key()
    N = np.where(checked.check.with_moment, checked.utilisation * R, checked.force)
    kinds = list(zip(cables.element_groups(f), cables.element_types(f), np.char.mod("%.6g", R).tolist()))
    order = np.lexsort((np.arange(len(N)), -np.round(key, 9)))
    order = order[np.sort(np.unique(f["net/element_id"][:][order], return_index=True)[1])]
    rows: list[list[int]] = []
    last_row: dict[tuple[Any, ...], int] = {}  # current row of each kind
    for e in order.tolist():
        row = last_row.get(kinds[e])
        if row is None or abs(N[e] - N[rows[row][0]]) > SYMMETRY * abs(N[rows[row][0]]):
            last_row[kinds[e]] = len(rows)
            rows.append([e, 0])
        rows[last_row[kinds[e]]][1] += 1
    return [(e, count) for e, count in rows]


def limits_of(f: h5py.File, cases: list[Case]) -> list[ServiceLimit] | None:
    """Compare the combinations of service with the limits of [limits]; None: the job has no such section.

    The general limit of displacements applies to nodes without a limit of a group. Elements that erection
    removes have no nodes.
    """
    if (table := read_job_tables(f).get("limits")) is None:
        return None
    limits = Validator("", []).table("limits", Limits, table)
    ids, names = f["net/node_id"][:], f["net/group_names"].asstr()[:].tolist()
    allowed = displacement_limits(limits, names)
    ends, groups = f["net/elements"][:], cables.element_groups(f)
    is_present = ~states.absent(f)
    nodes = {name: np.unique(ends[(groups == name) & is_present]) for name in allowed if name != ANY_GROUP}
    if ANY_GROUP in allowed:
        nodes[ANY_GROUP] = np.setdiff1d(np.arange(len(ids)), np.concatenate([[], *nodes.values()]))
    results, service = [], [case for case in cases if case.kind == COMBINATION_KINDS[1]]
    for case, slack in zip(service, count_slack_cables(f, service)):
        stable, displacement = case.state == EQUILIBRIUM, displacements_from(f, case, limits.reference)
        state = [] if stable else [case.state.replace("_", " ")]
        for name, rows in nodes.items():
            if len(rows):
                row, of = rows[np.argmax(displacement[rows])], f" of {name}" if name else ""
                reached, at = float(displacement[row]), [f"node {ids[row]}"] * case.carries + state
                holds = stable and reached <= allowed[name]
                what = f"displacement{of} from {limits.reference}"
                at_text = ", ".join(at)
                in_mm = 1e3 * reached, 1e3 * allowed[name]
                results.append(ServiceLimit(case.name, what, "mm", *in_mm, at_text, holds))
        if limits.slack is not None:
            at, value = "".join(state), float(slack) if case.carries else np.nan
            holds = stable and value <= limits.slack
            results.append(ServiceLimit(case.name, "slack", "cables", value, float(limits.slack), at, holds))
    return results
