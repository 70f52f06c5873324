"""Checks by group: the worst element of each with its case and utilisation; service limits."""

from typing import NamedTuple

import numpy as np

from netfall.job.units import to_unit
from netfall.post.checks import cables
from netfall.results.cases import COMBINATION_KINDS, EQUILIBRIUM, Case
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


def group_columns(f, envelope: Envelope, checked: list[cables.ElementCheck]) -> dict[str, np.ndarray]:
    """Return the element with the largest utilisation, one row for each check and group.

    The rows of a check begin with the worst group.
    alike : number of elements of the group and type with the same force, this one included
    result : see `ElementCheck.results`
    """
    rows: list[tuple] = []
    names, types = cables.element_groups(f), cables.element_types(f)
    for one in checked:
        first_rows: dict[str, tuple] = {}  # of each group
        results = one.results()
        for e, count in members(f, one):
            row = (one.name, one.check.kind, e, count, one.of[e], one.force[e], one.resistance[e])
            first_rows.setdefault(names[e], (*row, one.utilisation[e], results[e]))
        rows += first_rows.values()
    check, kind, elements, alike, of, force, resistance, utilisation, result = map(list, zip(*rows))
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
    }


def members(f, checked: cables.ElementCheck) -> list[tuple[int, int]]:
    """Rank the elements by their utilisation in a check, and count how many each stands for.

    Elements of one group, type and resistance whose forces are alike share one row, led by the first of them.
    """
    N, R, key = checked.force, checked.resistance, checked.ranking_key()
    kinds = list(zip(cables.element_groups(f), cables.element_types(f), np.char.mod("%.6g", R).tolist()))
    order = np.lexsort((np.arange(len(N)), -np.round(key, 9)))
    rows: list[list[int]] = []
    last_row: dict[tuple, int] = {}  # current row of each kind
    for e in order.tolist():
        row = last_row.get(kinds[e])
        if row is None or abs(N[e] - N[rows[row][0]]) > ALIKE * abs(N[rows[row][0]]):
            last_row[kinds[e]] = len(rows)
            rows.append([e, 0])
        rows[last_row[kinds[e]]][1] += 1
    return [(e, count) for e, count in rows]


def limits_of(
    job: dict, cases: list[Case], largest: list[tuple[float, int]], slack: list[int]
) -> list[ServiceLimit]:
    """Compare the combinations of service with the limits of [limits].

    largest : largest displacement [m] of each case, nan: none, and its node's id
    slack : slack cables of each case
    """
    allowed, limits = job.get("limits", {}), []
    for case, (reached, node), slack_count in zip(cases, largest, slack):
        if case.kind != COMBINATION_KINDS[1]:
            continue
        valid = case.state == EQUILIBRIUM
        if "displacement" in allowed:
            limit = float(to_unit(allowed["displacement"], "m"))
            at = f"node {node}" if reached == reached else case.state
            limits.append(
                ServiceLimit(case.name, "displacement", "m", reached, limit, at, valid and reached <= limit)
            )
        if "slack" in allowed:
            limit = float(allowed["slack"])
            at, value = ("", float(slack_count)) if case.carries else (case.state, np.nan)
            limits.append(
                ServiceLimit(case.name, "slack", "cables", value, limit, at, valid and value <= limit)
            )
    return limits
