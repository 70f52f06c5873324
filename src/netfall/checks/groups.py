"""Checks by group: the worst member of each, in which case, by how much; limits in service."""

from typing import NamedTuple

import numpy as np

from netfall.checks import cables
from netfall.results.cases import EQUILIBRIUM, KINDS, Case
from netfall.results.states import Envelope

ALIKE = 1e-3  # of the force: members of a group and type with forces as near are one row, by symmetry


class Limit(NamedTuple):
    """A service limit in a combination; value : reached, allowed : of [limits], at : where, in words."""

    case: str
    what: str
    unit: str
    value: float
    allowed: float
    at: str
    holds: bool


def group_columns(f, envelope: Envelope, checked: cables.Checked) -> dict[str, np.ndarray]:
    """A row for each check and group, those of a check worst first: its member with the largest utilisation.

    alike : how many elements of the group and type have the same force, this one included
    result : as of `results_of`
    """
    rows = [
        (check, e, alike)
        for check in checked.checks
        for e, alike in _firsts(cables.groups_of(f), members(f, checked, check.name))
    ]
    each = np.array([e for _, e, _ in rows])
    of = lambda table: np.array([table[check.name][e] for check, e, _ in rows])
    used = of(checked.utilisation)
    return {
        "check": np.array([check.name for check, *_ in rows], object),
        "kind": np.array([check.kind for check, *_ in rows], object),
        "group": cables.groups_of(f)[each],
        "type": cables.types_of(f)[each],
        "cable": f["net/cable_names"].asstr()[:].astype(object)[f["net/cable"][:][each]],
        "element": f["net/element_id"][:][each],
        "alike": np.array([alike for *_, alike in rows]),
        "case": np.array(envelope.names, object)[of(checked.of)],
        "N_Ed": of(checked.force),
        "N_Rd": of(checked.resistance),
        "utilisation": used,
        "result": of({check.name: cables.results_of(checked, check.name) for check in checked.checks}),
    }


def members(f, checked: cables.Checked, check: str) -> list[tuple[int, int]]:
    """The elements by their utilisation in a check, the largest first, and how many each stands for.

    Those of one group, type and resistance whose forces are alike are one row, by the first of them.
    """
    N, R, key = checked.force[check], checked.resistance[check], checked.decisive(check)
    kind = list(zip(cables.groups_of(f), cables.types_of(f), np.nan_to_num(R, nan=-1.0).tolist()))
    order = np.lexsort((np.arange(len(N)), -np.round(key, 9)))
    rows: list[list[int]] = []
    last: dict[tuple, int] = {}  # of each kind the row that it has now
    for e in order.tolist():
        row = last.get(kind[e])
        if row is None or abs(N[e] - N[rows[row][0]]) > ALIKE * abs(N[rows[row][0]]):
            last[kind[e]] = len(rows)
            rows.append([e, 0])
        rows[last[kind[e]]][1] += 1
    return [(e, count) for e, count in rows]


def _firsts(group: np.ndarray, rows: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """The first row of each group."""
    found: dict[str, tuple[int, int]] = {}
    for e, count in rows:
        found.setdefault(group[e], (e, count))
    return list(found.values())


def limits_of(job: dict, cases: list[Case], moved: list[tuple[float, int]], slack: list[int]) -> list[Limit]:
    """The limits of [limits] in each combination of service.

    moved : of each case the largest displacement [m], nan: none, and its node's id; slack : cables without
    tension
    """
    given, found = job.get("limits", {}), []
    for case, (most, node), number in zip(cases, moved, slack):
        if case.kind != KINDS[1]:
            continue
        stands = case.state == EQUILIBRIUM
        if "displacement" in given:
            limit = float(given["displacement"])
            at = f"node {node}" if most == most else case.state
            found.append(Limit(case.name, "displacement", "m", most, limit, at, stands and most <= limit))
        if "slack" in given:
            limit = float(given["slack"])
            at, value = ("", float(number)) if case.carries else (case.state, np.nan)
            found.append(Limit(case.name, "slack", "cables", value, limit, at, stands and value <= limit))
    return found
