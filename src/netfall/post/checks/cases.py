"""Tables of a report by case: forces, displacements, and the extremes of each group."""

from typing import Any

import h5py
import numpy as np

from netfall.core.functions import lengths
from netfall.post.checks.cables import element_groups, element_name_columns
from netfall.results.file import Case
from netfall.results.states import StateView, absent, equilibria, permanent_position, start_position

NAN = np.nan
REFERENCES = "form", "permanent"  # where displacements count from


def case_columns(f: h5py.File, cases: list[Case]) -> dict[str, np.ndarray]:
    """Return extremes of forces [N] and displacements [m], one row for each case and group of elements.

    slack : elements of cables without tension. A case without equilibrium has its reason and no numbers.
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
    slack, by_group = (N <= 0.0) & ~f["net/bar"][:].astype(bool) & ~absent(f), {}
    for name, rows in groups.items():
        low, high, node = rows[np.argmin(N[rows])], rows[np.argmax(N[rows])], np.unique(ends[rows])
        by_group[name] = [N[low], ids[low], N[high], ids[high]]
        for displacement in displacements:
            farthest = node[np.argmax(displacement[node])]
            by_group[name] += [displacement[farthest], nodes[farthest]]
        by_group[name].append(int(slack[rows].sum()))
    return by_group


def displacements_from(f: h5py.File, case: Case, reference: str) -> np.ndarray:
    """Compute the displacements (n,) [m] of the nodes in a case; nan if it has no equilibrium.

    reference : one of REFERENCES, where they count from
    """
    start = start_position(f) if reference == "form" else permanent_position(f)
    unknown = start is None or not case.carries
    return np.full(len(f["net/node_id"]), NAN) if unknown else lengths(case.shown.position() - start)


def largest_displacements(f: h5py.File, cases: list[Case], reference: str) -> list[tuple[float, int]]:
    """Find the largest displacement [m] in each case, and its node's id; see `displacements_from`."""
    displacements = [displacements_from(f, case, reference) for case in cases]
    largest = [(values, int(np.argmax(values))) for values in displacements]
    return [(float(values[node]), int(f["net/node_id"][node])) for values, node in largest]


def count_slack_cables(f: h5py.File, cases: list[Case]) -> list[int]:
    """Count the cables of each case that have an element without tension."""
    can_slacken, cable = ~f["net/bar"][:].astype(bool) & ~absent(f), f["net/cable"][:]
    return [len(np.unique(cable[(case.shown.tension() <= 0.0) & can_slacken])) for case in cases]


def force_columns(f: h5py.File, cases: list[Case]) -> dict[str, np.ndarray]:
    """Return the forces [N], one row for each element and one column for each static state.

    The columns are the form, the cases by their names, and other stages.
    """
    columns = element_name_columns(f)
    for stage in equilibria(f):
        columns[column_name(columns, cases, stage)] = stage.tension() * factor(cases, stage)
    return columns


def displacement_columns(f: h5py.File, cases: list[Case]) -> dict[str, np.ndarray]:
    """Return the displacements [m], one row for each node.

    Each static state but the form has four columns: the magnitude and the three components, from the form or
    the last stage of erection. States after the erection have four more, from the permanent state.
    """
    x, permanent = start_position(f), permanent_position(f)
    columns = {"node": f["net/node_id"][:], **{axis: x[:, k] for k, axis in enumerate("xyz")}}
    for stage in list(equilibria(f))[1:]:
        name, known = column_name(columns, cases, stage), factor(cases, stage)
        starts = {name: x}
        if permanent is not None and not stage.place.startswith("stages/"):
            starts[f"{name}, from permanent"] = permanent
        for column, start in starts.items():
            displacement = (stage.position() - start) * known
            columns[column] = lengths(displacement)
            columns |= {f"{column} {axis}": displacement[:, k] for k, axis in enumerate("xyz")}
    return columns


def column_name(columns: dict[str, np.ndarray], cases: list[Case], stage: StateView) -> str:
    """Return the name of a stage's column: the name of its case, unless a column has it already."""
    own_names = [case.name for case in cases if case.shown.place == stage.place and stage.place]
    return own_names[0] if own_names and own_names[0] not in columns else stage.name


def factor(cases: list[Case], stage: StateView) -> float:
    """Return nan for a state of a case without equilibrium, 1 otherwise.

    The state of such a case belongs to a smaller load, so its numbers must not appear as those of the case.
    """
    return NAN if any(case.shown.place == stage.place and not case.carries for case in cases) else 1.0
