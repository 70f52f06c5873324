"""The net of a job: from a generator or from tables, with sections, checked as a whole."""

from pathlib import Path

import numpy as np

from netfall.compile import kernel
from netfall.errors import InputError
from netfall.job.read import Job, nearest
from netfall.job.table import Table
from netfall.net import faces, generators
from netfall.net.net import Net, subdivide

MOST_ELEMENTS = 50_000_000  # what fits the memory of one rank at set-up, some 500 bytes each

AXES = ("x", "y", "z")
NODE_COLUMNS = (
    "id",
    *AXES,
    "fixed",
    *(f"fixed_{k}" for k in AXES),
    *(f"load_{k}" for k in AXES),
    "mass",
    "area",
)
ELEMENT_COLUMNS = (
    "start",
    "end",
    "id",
    "group",
    "prestress",
    "force_density",
    "unstressed_length",
    "area",
    "modulus",
)


def build_net(job: Job) -> Net:
    """The net that a job describes, subdivided, with sections and areas.

    Raises InputError with all that is wrong in the tables, or with the net as a whole.
    """
    net = _from_tables(job) if job.net.nodes else _from_generator(job)
    if net.m * job.net.subdivide > MOST_ELEMENTS:
        raise InputError(
            f"{job.path}: [net] subdivide = {job.net.subdivide}: gives {net.m * job.net.subdivide:.3g} elements; "
            f"at most {MOST_ELEMENTS:.0e} fit"
        )
    _check_groups(job, net)
    net = subdivide(net, job.net.subdivide)
    errors = _whole_net_errors(job, net)
    if errors:
        raise InputError(errors)
    return net


def _from_generator(job: Job) -> Net:
    name = job.net.generator
    size = generators.expected_size(name, job.net)
    if not size <= MOST_ELEMENTS:
        size_key = "cells" if name == "saddle" else "spacing"
        raise InputError(
            f"{job.path}: [net] {size_key} = {getattr(job.net, size_key):g}: asks for {size:.3g} elements; "
            f"at most {MOST_ELEMENTS:.0e} fit"
        )
    if name == "saddle":
        net = generators.saddle(job.net.side, job.net.rise, job.net.cells)
    else:
        if job.net.spacing > 0.25 * min(job.net.length, job.net.width):
            raise InputError(
                f"{job.path}: [net] spacing = {job.net.spacing:g}: too wide for the roof; "
                f"expected at most {0.25 * min(job.net.length, job.net.width):g} m, a quarter of the shorter axis"
            )
        net = generators.stadium(job.net.length, job.net.width, job.net.arch_rise, job.net.spacing)
    _set_sections(job, net)
    return net


def _from_tables(job: Job) -> Net:
    nodes = Table(job.path.parent / job.net.nodes, NODE_COLUMNS, ("id", *AXES))
    cables = Table(job.path.parent / job.net.elements, ELEMENT_COLUMNS, ("start", "end"))
    columns = [nodes.numbers(k, unit="m") for k in AXES]
    node_id = nodes.integers("id")
    for k in AXES:
        _no_empty_cells(nodes, k)
    fixed = _fixed(nodes)
    load = np.column_stack([nodes.numbers(f"load_{k}", 0.0, unit="N") for k in AXES])
    mass = nodes.numbers("mass", 0.0, low=0.0, unit="kg")
    area = nodes.numbers("area", low=0.0, unit="m2")
    first: dict[int, int] = {}
    for row, number in enumerate(node_id.tolist()):
        if number in first:
            nodes.wrong(
                f"{nodes.at(row)}: id = {number}: stands on {nodes.at(first[number])} already; ids are unique"
            )
        first.setdefault(number, row)
    ends = np.column_stack([_ends(cables, k, first, nodes.path) for k in ("start", "end")])
    for row in np.flatnonzero(ends[:, 0] == ends[:, 1]):
        if ends[row, 0] >= 0:
            cables.wrong(
                f"{cables.at(row)}: start and end are both node {node_id[ends[row, 0]]}; expected two nodes"
            )
    element_id = cables.integers("id") if "id" in cables else np.arange(len(cables))
    if len(np.unique(element_id)) < len(element_id):
        values, counts = np.unique(element_id, return_counts=True)
        cables.wrong(f"id = {values[counts > 1][0]}: stands {counts.max()} times; ids are unique")
    words = cables.words("group") if "group" in cables else [""] * len(cables)
    names, group = np.unique(words, return_inverse=True)
    columns_e = dict(
        prestress=cables.numbers("prestress", unit="N"),
        force_density=cables.numbers("force_density", unit="N/m"),
        unstressed_length=cables.numbers("unstressed_length", low=1e-9, unit="m"),
        section=cables.numbers("area", low=1e-12, unit="m2"),
        modulus=cables.numbers("modulus", low=1.0, unit="Pa"),
    )
    raise_all(nodes, cables)
    net = Net(
        np.column_stack(columns),
        fixed,
        ends,
        group,
        [str(name) for name in names],
        node_id,
        element_id,
        load,
        mass,
        area,
        columns_e["force_density"],
        columns_e["unstressed_length"],
    )
    _set_sections(job, net)
    for name in ("prestress", "section", "modulus"):
        value = columns_e[name]
        setattr(net, name, np.where(np.isnan(value), getattr(net, name), value))
    return net


def raise_all(*tables: Table) -> None:
    """Raise the errors of all the tables at once."""
    lines = []
    for table in tables:
        try:
            table.finish()
        except InputError as error:
            lines += error.lines
    if lines:
        raise InputError(lines)


def _no_empty_cells(table: Table, name: str) -> None:
    for row, word in enumerate(table.words(name)):
        if word == "":
            table.wrong(f"{table.at(row)}: {name} is empty; expected a number")


def _fixed(nodes: Table) -> np.ndarray:
    if "fixed" in nodes and any(f"fixed_{k}" in nodes for k in AXES):
        nodes.wrong("columns fixed and fixed_x, fixed_y, fixed_z exclude each other; keep one kind")
    columns = [nodes.numbers(f"fixed_{k}" if f"fixed_{k}" in nodes else "fixed", 0.0) for k in AXES]
    for name in ("fixed", *(f"fixed_{k}" for k in AXES)):
        if name in nodes:
            values = nodes.numbers(name, 0.0)
            for row in np.flatnonzero((values != 0) & (values != 1) & np.isfinite(values)):
                nodes.wrong(f"{nodes.at(row)}: {name} = {nodes.words(name)[row]!r}: expected 0 or 1")
    return np.column_stack(columns) == 1


def _ends(cables: Table, name: str, rows: dict[int, int], nodes: Path) -> np.ndarray:
    numbers = cables.integers(name)
    ends = np.full(len(cables), -1)
    for row, number in enumerate(numbers.tolist()):
        ends[row] = rows.get(number, -1)
        if ends[row] < 0:
            cables.wrong(f"{cables.at(row)}: {name} = {number}: no such node in {nodes.name}")
    return ends


def _set_sections(job: Job, net: Net) -> None:
    """Sections of the elements from [cable] and the [cable.GROUP] of their group."""
    tables = [vars(job.cable) | job.groups.get(name, {}) for name in net.group_names]
    column = lambda key, absent=None: np.array([absent if t[key] is None else t[key] for t in tables], float)[
        net.group
    ]
    net.section, net.modulus, net.density = column("area"), column("modulus"), column("density")
    net.prestress = column("prestress")
    net.yield_stress, net.fracture_strain = column("yield_stress", np.inf), column("fracture_strain", np.inf)
    net.bar = np.array([t["kind"] == "bar" for t in tables])[net.group]


def _check_groups(job: Job, net: Net) -> None:
    known = [name for name in net.group_names if name]
    advice = lambda name: nearest(name, known) if known else "the net has no groups"
    unknown = [name for name in job.groups if name not in known]
    if unknown:
        raise InputError(
            [f"{job.path}: [cable.{name}]: no element is of this group; {advice(name)}" for name in unknown]
        )


@kernel
def label_parts(elements, label):
    """Write the lowest particle of the part of the net that each belongs to. elements : (m, 2); label : (n,), out

    Union by path halving; scipy has the same, but takes a tenth of a second to load, before every run.
    """
    for p in range(label.shape[0]):
        label[p] = p
    for e in range(elements.shape[0]):
        a, b = elements[e, 0], elements[e, 1]
        while label[a] != a:
            label[a] = label[label[a]]
            a = label[a]
        while label[b] != b:
            label[b] = label[label[b]]
            b = label[b]
        label[max(a, b)] = min(a, b)
    for p in range(label.shape[0]):
        label[p] = label[label[p]]


def _whole_net_errors(job: Job, net: Net) -> list[str]:
    errors = []
    lengths = net.lengths()
    for e in np.flatnonzero(~(lengths > 0))[:5]:
        a, b = net.node_id[net.elements[e]]
        errors.append(
            f"{job.path}: element {net.element_id[e]} between nodes {a} and {b} has no length; nodes that coincide must be one"
        )
    lonely = np.flatnonzero(np.bincount(net.elements.ravel(), minlength=net.n) == 0)
    for p in lonely[:5]:
        errors.append(f"{job.path}: node {net.node_id[p]} belongs to no element; remove it or connect it")
    equilibrium = job.form_finding is not None or (job.load is not None and job.load.steps > 0)
    if equilibrium and not errors:
        label = np.empty(net.n, np.int64)
        label_parts(net.elements, label)
        held = np.zeros(net.n, bool)
        held[label[net.fixed.any(1)]] = True
        for part in np.flatnonzero((label == np.arange(net.n)) & ~held)[:5]:
            members = net.node_id[label == part]
            errors.append(
                f"{job.path}: the part of the net with node {members[0]} ({len(members)} nodes) has no support; "
                "fix a node of it: form finding and statics need an equilibrium"
            )
    compressed = np.flatnonzero((net.prestress < 0) & ~net.bar)
    if len(compressed) and not np.isfinite(net.force_density).any():
        e = compressed[0]
        errors.append(
            f"{job.path}: element {net.element_id[e]}: prestress = {net.prestress[e]:g}: a cable carries no compression; "
            'expected >= 0, or kind = "bar" for its group'
        )
    over = np.flatnonzero(np.abs(net.prestress) > net.yield_stress * net.section)
    if len(over):
        e = over[0]
        errors.append(
            f"{job.path}: element {net.element_id[e]}: prestress = {net.prestress[e]:g} N: above the yield force "
            f"{net.yield_stress[e] * net.section[e]:g} N; lower it or choose a larger area"
        )
    if job.form_finding is not None and np.isfinite(net.unstressed_length).any():
        errors.append(
            f"{job.path}: unstressed_length in {job.net.elements} and [form_finding] exclude each other: "
            "form finding computes the unstressed lengths"
        )
    return errors


def roof_areas(job: Job, net: Net) -> tuple[np.ndarray, faces.Faces, str]:
    """Tributary areas (n,) [m2], the faces that they and the normals come from, and a remark or "".

    Raises InputError where loads need areas that the plan does not define.
    """
    load, needed = (
        job.load,
        job.wind is not None
        or (job.load is not None and (job.load.dead > 0 or job.load.pressure is not None)),
    )
    normals_needed = job.wind is not None or (load is not None and isinstance(load.pressure, float))
    given = np.isfinite(net.area)
    if job.net.nodes:
        crossings = faces.crossing_elements(net)
        if crossings:
            if needed and not (given.all() and not normals_needed):
                raise InputError(
                    f"{job.path}: {crossings} pairs of elements cross in plan without a node, so the roof has no faces that "
                    "wind, dead load or pressure could act on; join them in nodes, or give `area` in nodes.csv and loads as vectors"
                )
            return (
                np.where(given, net.area, 0.0),
                faces.Faces(np.zeros(1, np.int64), np.zeros(0, np.int64)),
                "elements cross in plan: no faces",
            )
    found = faces.find_faces(net)
    area = np.where(given, net.area, faces.tributary_areas(net, found))
    remark = ""
    if needed:
        if not (area > 0).any():
            raise InputError(
                f"{job.path}: the net has no closed face in plan, so wind, dead load and pressure have nothing to act on; "
                "close the outline with elements between the supports, or give `area` in nodes.csv"
            )
        bare = ~(area > 0) & ~net.fixed.all(1)
        if bare.any():
            remark = f"{bare.sum()} free particles carry no roof area (first: node {net.node_id[bare][0]}); `area` in nodes.csv would give it"
    return area, found, remark
