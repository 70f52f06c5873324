"""Checks by group: the worst element of each with its case and utilisation; service limits."""

from typing import Any, NamedTuple

import h5py
import numpy as np

from netfall.job.keys.groups import EVERYWHERE, displacement_limits
from netfall.job.keys.models import Limits
from netfall.post.checks import cables
from netfall.post.checks.cases import count_slack_cables, displacements_from
from netfall.results.file import COMBINATION_KINDS, EQUILIBRIUM, Case
from netfall.results.states import Envelope

ALIKE = 1e-3  # relative difference of forces below which elements of a group and type share a row (symmetry)


class ServiceLimit(NamedTuple):
    """Service limit of [limits] in a combination.

    value : reached; allowed : given in the job; at : place, in words
    """

    case: str
    what: str
    unit: str
    value: float
    allowed: float
    at: str
    holds: bool


def group_columns(
    f: h5py.File, envelope: Envelope, checked: list[cables.ElementCheck]
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
    """Rank the elements by their utilisation in a check, and count how many each stands for.

    Elements of one group, type and resistance whose forces are alike share one row, led by the first of them.
    """
    R, key = checked.resistance, checked.ranking_key()
    N = np.where(checked.check.with_moment, checked.utilisation * R, checked.force)
    kinds = list(zip(cables.element_groups(f), cables.element_types(f), np.char.mod("%.6g", R).tolist()))
    order = np.lexsort((np.arange(len(N)), -np.round(key, 9)))
    rows: list[list[int]] = []
    last_row: dict[tuple[Any, ...], int] = {}  # current row of each kind
    for e in order.tolist():
        row = last_row.get(kinds[e])
        if row is None or abs(N[e] - N[rows[row][0]]) > ALIKE * abs(N[rows[row][0]]):
            last_row[kinds[e]] = len(rows)
            rows.append([e, 0])
        rows[last_row[kinds[e]]][1] += 1
    return [(e, count) for e, count in rows]


def limits_of(f: h5py.File, limits: Limits, cases: list[Case]) -> list[ServiceLimit]:
    """Compare the combinations of service with the limits of [limits].

    The general limit of displacements holds for the nodes without a limit of a group.
    """
    ids, names = f["net/node_id"][:], f["net/group_names"].asstr()[:].tolist()
    allowed = displacement_limits(limits, names)
    ends, groups = f["net/elements"][:], cables.element_groups(f)
    nodes = {name: np.unique(ends[groups == name]) for name in allowed if name != EVERYWHERE}
    if EVERYWHERE in allowed:
        nodes[EVERYWHERE] = np.setdiff1d(np.arange(len(ids)), np.concatenate([[], *nodes.values()]))
    results, service = [], [case for case in cases if case.kind == COMBINATION_KINDS[1]]
    for case, slack in zip(service, count_slack_cables(f, service)):
        stable, displacement = case.state == EQUILIBRIUM, displacements_from(f, case, limits.reference)
        for name, rows in nodes.items():
            if len(rows):
                row, of = rows[np.argmax(displacement[rows])], f" of {name}" if name else ""
                reached, at = float(displacement[row]), f"node {ids[row]}" if case.carries else case.state
                holds = stable and reached <= allowed[name]
                what = f"displacement{of} from {limits.reference}"
                results.append(ServiceLimit(case.name, what, "m", reached, allowed[name], at, holds))
        if limits.slack is not None:
            at, value = ("", float(slack)) if case.carries else (case.state, np.nan)
            holds = stable and value <= limits.slack
            results.append(ServiceLimit(case.name, "slack", "cables", value, float(limits.slack), at, holds))
    return results
