"""Net of a job, from a generator or from tables, with sections and checks of the whole net."""

from collections.abc import Iterator

import numpy as np

from netfall.core.errors import InputError, raise_errors
from netfall.core.functions import lengths, surface_axes
from netfall.core.messages import mm
from netfall.geometry import messages, sections
from netfall.geometry.bars import bar_errors, bar_notes, set_bars
from netfall.geometry.cables import cables_of
from netfall.geometry.generators import generate as generators
from netfall.geometry.net import Net, connected_parts, nearest_group, part_contains, subdivide
from netfall.geometry.sections import strength_errors, strength_notes
from netfall.geometry.tables import read_lines, read_tables
from netfall.geometry.turned import is_rotated
from netfall.job import messages as job_messages
from netfall.job.derived import carries_permanent, has_aerodynamic_damping, has_load_cases, roof_groups
from netfall.job.job import Job
from netfall.job.keys.groups import (
    ANY_GROUP,
    Groups,
    displacement_limits,
    is_pattern,
    pattern_errors,
    unmatched_sections,
)
from netfall.job.values import counted, format_value

STEEP_GENERATORS = ("saddle", "stadium")  # generators whose start is flat inside and steep along the boundary
NEAR_SHARE = 0.1  # share of an element's length; a node nearer to its loose end was probably meant there
# Codes of the errors on an element that is weaker than its prestress, possibly by its random strength.
TOO_WEAK = {messages.PRESTRESS_ABOVE_YIELD.code, messages.WEAKER_THAN_PRESTRESS.code}
MOST_ELEMENTS = 50_000_000  # largest number of elements; each takes some 900 bytes on rank 0 at set-up


def build_net(job: Job) -> Net:
    """Build the net that a job describes, subdivided, with sections and areas.

    Raises InputError with all errors in the tables, or in the net as a whole.
    """
    columns: dict[str, np.ndarray] = {}
    if job.net.nodes:
        net, columns = read_tables(job)
    else:
        name = job.net.generator or ""
        if problem := generators.dimension_error(name, getattr(job.net, name), MOST_ELEMENTS):
            raise InputError([f"{job.path}: [net.{name}] {problem}"])
        net = generators.generate(job.net)
    own_prestress, errors = net.prestress, [f"{job.path}: {line}" for line in _group_name_errors(job, net)]
    try:
        sections.set_sections(job, net, columns)
    except InputError as error:
        raise InputError([*net.notes, *errors, *error.lines]) from None
    raise_errors([*net.notes, *errors] if errors else [])
    set_bars(job, net)
    net.prestress = net.prestress if own_prestress is None else own_prestress  # a generator's own equilibrium
    if net.m * job.net.subdivide > MOST_ELEMENTS:
        number = net.m * job.net.subdivide
        parts, most = job.net.subdivide, MOST_ELEMENTS
        raise InputError(messages.TOO_MANY_ELEMENTS(path=job.path, parts=parts, number=number, most=most))
    lines, notes = read_lines(job, net.node_id)
    between = net.fixed[net.elements].all((1, 2))
    if job.net.subdivide > 1 and job.net.nodes and between.any():  # the new nodes cannot sag
        notes.append(messages.HELD_SUBDIVISION(elements=counted("element", net.element_id[between])))
    net.outline, net.notes = np.concatenate([net.outline, lines]), net.notes + notes
    net.roof_axes = surface_axes(job.roof.normal) if job.roof else None
    net = subdivide(net, job.net.subdivide)
    net.cable, net.cable_names = cables_of(net, job.slides, job.net.generator in STEEP_GENERATORS)
    sections.set_strengths(job, net)
    errors = [f"{job.path}: {line}" for line in _net_errors(job, net)] + _table_errors(job, net)
    errors += [f"{job.path}: {line}" for check in (strength_errors, bar_errors) for line in check(job, net)]
    net.notes += _loose_end_warnings(job, net)
    raise_errors([*net.notes, *errors] if errors else [])
    net.notes += [*strength_notes(job, net), *bar_notes(job, net)]
    size = float(np.ptp(net.x, axis=0).max())
    for name, limit in displacement_limits(job.limits, net.group_names).items() if job.limits else ():
        if limit > size:  # for example in mm without a unit
            place = "limits" if name == ANY_GROUP else f"limits.group.{name}"
            net.notes.append(messages.LARGE_DISPLACEMENT_LIMIT(place=place, value=limit, size=size))
    return net


def _loose_end_warnings(job: Job, net: Net) -> Iterator[str]:
    """Yield a warning about free nodes with one element, unless the form carries loads."""
    finds_form = job.form_finding is not None and job.form_finding.method != "given_geometry"
    single = np.bincount(net.elements.ravel(), minlength=net.n) == 1
    ends = np.flatnonzero(single & ~net.held.any(1))
    if not finds_form or carries_permanent(job) or not len(ends):
        return
    p = ends[0]
    neighbour = net.elements[(net.elements == p).any(1)].sum() - p
    distance = lengths(net.x - net.x[p])
    length = distance[neighbour]
    distance[[p, neighbour]] = np.inf
    nearest = int(np.argmin(distance))
    is_near = distance[nearest] < NEAR_SHARE * length
    beside = f" (node {net.node_id[nearest]} is {mm(distance[nearest])} away)" if is_near else ""
    yield messages.LOOSE_ENDS(nodes=counted("node", net.node_id[ends]), beside=beside)


def _group_name_errors(job: Job, net: Net) -> Iterator[str]:
    """Yield an error for each section or list that names a group without elements, or clashing patterns."""
    tables: dict[str, Groups] = {"group": job.groups}
    if job.limits:
        tables["limits.group"] = job.limits.group
    for section, groups in tables.items():
        for name in unmatched_sections(groups, net.group_names):
            error = messages.NO_GROUP_MATCHES if is_pattern(name) else messages.NO_ELEMENT_OF_GROUP
            yield error(section=section, name=name, suggestion=nearest_group(net, name))
    for name in roof_groups(job):
        if name not in {*net.group_names} - {""}:
            suggestion = nearest_group(net, name)
            yield f"[roof] {messages.UNKNOWN_GROUP_IN_LIST(name=format_value(name), suggestion=suggestion)}"
    for section, groups in tables.items():
        yield from pattern_errors(groups, net.group_names, section)


def _net_errors(job: Job, net: Net) -> Iterator[str]:
    """Yield the errors of the net as a whole."""
    form = job.form_finding
    short = np.flatnonzero(~(net.lengths() > 0))
    for e in short[:5]:
        a, b = net.node_id[net.elements[e]]
        yield messages.NO_LENGTH(element=net.element_id[e], start=a, end=b)
    if net.horizontal_force is not None:
        is_short = ~(net.plan_lengths(net.x) > net.tolerance)
        for e in np.flatnonzero(np.isfinite(net.horizontal_force) & is_short)[:5]:
            a, b = net.node_id[net.elements[e]]
            yield job_messages.NO_LENGTH_IN_PLAN(element=net.element_id[e], start=a, end=b)
    if (form is not None or has_load_cases(job)) and not len(short) and not len(_unused_nodes(net)):
        label = connected_parts(net.elements, net.n)
        # The axes of a support may be turned in plan, so only z is certain to be free.
        is_weighed = job.load is not None and job.load.self_weight and has_load_cases(job) and not job.stages
        held = part_contains(label, np.asarray(net.held[:, 2] if is_weighed else net.held.any(1)))
        for part in np.flatnonzero((label == np.arange(net.n)) & ~held)[:5]:
            members = net.node_id[label == part]
            along = "vertical support" if net.held[label == part].any() else "support"
            yield messages.NO_SUPPORT(node=members[0], count=len(members), support=along)
    compressed = (net.prestress < 0) & ~net.bar & ~np.isfinite(net.force_density).any()
    for e in np.flatnonzero(compressed)[:1]:
        yield messages.COMPRESSED_CABLE(element=net.element_id[e], force=net.prestress[e])
    for e in np.flatnonzero(np.abs(net.prestress) > net.yield_force)[:1]:
        force, limit = net.prestress[e], net.yield_force[e]
        yield messages.PRESTRESS_ABOVE_YIELD(element=net.element_id[e], force=force, limit=limit)
    if form is not None and np.isfinite(net.unstressed_length).any():
        yield job_messages.EXCLUSIVE(keys=f"unstressed_length in {job.net.elements} and [form_finding]")
    if form is not None and net.spring_rest.any():
        yield job_messages.EXCLUSIVE(keys=f"spring_rest_x, y, z in {job.net.nodes} and [form_finding]")
    moving = ~net.held[net.elements].all((1, 2))
    tensioned = net.prestress[moving].any() or carries_permanent(job)
    if form is not None and form.method == "fpm" and moving.any() and not tensioned:
        # any shape is in equilibrium
        yield messages.NO_PRESTRESS()


def _unused_nodes(net: Net) -> np.ndarray:
    """Return the nodes that belong to no element."""
    return np.flatnonzero(np.bincount(net.elements.ravel(), minlength=net.n) == 0)


def _table_errors(job: Job, net: Net) -> list[str]:
    """Return errors: unused nodes, springs on fixed axes, wrong angles of supports, cable names twice."""
    nodes, elements = (job.path.parent / str(path) for path in (job.net.nodes, job.net.elements))
    turned, form = net.node_id[is_rotated(net)], job.form_finding
    refused = {
        '[form_finding] method = "force_density"': form and form.method == "force_density",
        '[form_finding] start = "force_density"': form and form.start == "force_density",
        "[[slide]]": bool(job.slides),
        "[wind] aerodynamic_damping": has_aerodynamic_damping(job),
    }
    of_nodes = [messages.UNUSED_NODE(node=net.node_id[p]) for p in _unused_nodes(net)[:5]]
    of_nodes += [
        messages.SPRING_ON_FIXED_AXIS(node=net.node_id[p], axis="xyz"[k], stiffness=net.spring[p, k])
        for p, k in np.argwhere(net.fixed & (net.spring > 0))[:5]
    ]
    of_nodes += [
        messages.ANGLE_NOT_SUPPORTED(nodes=counted("node", turned), key=key)
        for key, active in refused.items()
        if active and len(turned)
    ]
    # a name in the table equals one generated for a cable without a name
    names, times = np.unique(np.array(net.cable_names, str), return_counts=True)
    return [
        *(f"{nodes}: {error}" for error in of_nodes),
        *(f"{elements}: {messages.CABLE_NAME_TAKEN(name=name)}" for name in names[times > 1]),
    ]
