"""Tables of a report by case: forces, displacements, and what is largest in each group."""

import numpy as np

from netfall.checks.cables import groups_of, names_of_elements
from netfall.results.cases import Case
from netfall.results.states import ShownState, absent, equilibria, start_position

NAN = np.nan


def case_columns(f, cases: list[Case]) -> dict[str, np.ndarray]:
    """A row for each case or combination and group of elements: extremes of forces [N], displacements [m].

    slack : elements of cables without tension; what has no equilibrium has its reason and no numbers
    """
    group, rows = groups_of(f), []
    of = {name: np.flatnonzero(group == name) for name in dict.fromkeys(group.tolist())}
    for case in cases:
        numbers = _extremes(f, case, of) if case.carries else {name: [NAN] * 7 for name in of}
        rest = [case.state, case.load_factor, case.reason]
        rows += [[case.name, case.kind, name, *numbers[name], *rest] for name in of]
    names = ["case", "kind", "group", "tension_min", "element_min", "tension_max", "element_max"]
    names += ["displacement_max", "node_max", "slack", "state", "load_factor", "reason"]
    columns = zip(*rows) if rows else [[]] * len(names)
    return {name: np.array(values, object) for name, values in zip(names, columns)}


def _extremes(f, case: Case, of: dict[str, np.ndarray]) -> dict[str, list]:
    """The numbers of a row of `case_columns` by group; of : elements (k,) of each."""
    ids, nodes, ends = f["net/element_id"][:], f["net/node_id"][:], f["net/elements"][:]
    N, moved = case.shown.tension(), np.linalg.norm(case.shown.position() - start_position(f), axis=1)
    slack, found = (N <= 0.0) & ~f["net/bar"][:].astype(bool) & ~absent(f), {}
    for name, mine in of.items():
        low, high, node = mine[np.argmin(N[mine])], mine[np.argmax(N[mine])], np.unique(ends[mine])
        far = node[np.argmax(moved[node])]
        extremes = [N[low], ids[low], N[high], ids[high], moved[far], nodes[far]]
        found[name] = [*extremes, int(slack[mine].sum())]
    return found


def largest_displacements(f, cases: list[Case]) -> list[tuple[float, int]]:
    """Of each case the largest displacement [m] from the form, nan: none, and the id of its node."""
    x, nodes, found = start_position(f), f["net/node_id"][:], []
    for case in cases:
        moved = np.linalg.norm(case.shown.position() - x, axis=1)
        far = int(np.argmax(moved))
        found.append((float(moved[far]) if case.carries else NAN, int(nodes[far])))
    return found


def slack_cables(f, cases: list[Case]) -> list[int]:
    """Of each case how many pieces of cable have an element without tension."""
    carries, cable = ~f["net/bar"][:].astype(bool) & ~absent(f), f["net/cable"][:]
    return [len(np.unique(cable[(case.shown.tension() <= 0.0) & carries])) for case in cases]


def force_columns(f, cases: list[Case]) -> dict[str, np.ndarray]:
    """A row for each element, a column [N] for each state: the form, cases by their names, other stages."""
    columns = names_of_elements(f)
    for stage in equilibria(f):
        columns[name_in(columns, cases, stage)] = stage.tension() * factor(cases, stage)
    return columns


def displacement_columns(f, cases: list[Case]) -> dict[str, np.ndarray]:
    """A row for each node, four columns [m] for each state but the form: from the form, and their length."""
    x = start_position(f)
    columns = {"node": f["net/node_id"][:], **{axis: x[:, k] for k, axis in enumerate("xyz")}}
    for stage in list(equilibria(f))[1:]:
        name, moved = name_in(columns, cases, stage), (stage.position() - x) * factor(cases, stage)
        columns[name] = np.linalg.norm(moved, axis=1)
        columns |= {f"{name} {axis}": moved[:, k] for k, axis in enumerate("xyz")}
    return columns


def name_in(columns: dict, cases: list[Case], stage: ShownState) -> str:
    """The name of a stage's column: of a case its own, unless there is one of that name."""
    own = [case.name for case in cases if case.shown.place == stage.place and stage.place]
    return own[0] if own and own[0] not in columns else stage.name


def factor(cases: list[Case], stage: ShownState) -> float:
    """nan for a case that has no equilibrium, whose state is that of less load; else 1."""
    return NAN if any(case.shown.place == stage.place and not case.carries for case in cases) else 1.0
