"""The net of a job: from a generator or from tables, with sections, checked as a whole."""

import numpy as np

from netfall.ground.errors import InputError
from netfall.job.asks import air_damps, carries_permanent, load_steps, roof_groups
from netfall.job.job import Job
from netfall.job.values import counted, shown
from netfall.net import sections
from netfall.net.bars import bar_errors, bar_notes, set_bars
from netfall.net.cables import cables_of, same_names
from netfall.net.generators import generate as generators
from netfall.net.net import Net, nearest_group, subdivide
from netfall.net.parts import part_has, parts_of
from netfall.net.tables import read_lines, read_tables
from netfall.net.turned import is_turned

STEEP = ("saddle", "stadium")  # generators whose start is level inside and steep along the boundary
MOST_ELEMENTS = 50_000_000  # some 900 bytes each on rank 0 at set-up


def build_net(job: Job) -> Net:
    """The net that a job describes, subdivided, with sections and areas.

    Raises InputError with all that is wrong in the tables, or with the net as a whole.
    """
    net = _with_sections(job) if job.net.nodes else _from_generator(job)
    if net.m * job.net.subdivide > MOST_ELEMENTS:
        raise InputError(
            f"{job.path}: [net] subdivide = {job.net.subdivide}: gives {net.m * job.net.subdivide:.3g} "
            f"elements; at most {MOST_ELEMENTS:.0e} fit"
        )
    lines, notes = read_lines(job, net.node_id)
    net.outline, net.notes = np.concatenate([net.outline, lines]), net.notes + notes + _held_whole(job, net)
    net = subdivide(net, job.net.subdivide)
    net.cable, net.cable_names = cables_of(net, job.net.generator in STEEP)
    sections.set_strengths(job, net)
    sections.set_length_errors(job, net)
    errors = _whole_net_errors(job, net) + _cables_of_one_name(job, net)
    errors += sections.strength_errors(job, net) + bar_errors(job, net)
    if errors:
        raise InputError(errors)
    net.notes += sections.strength_notes(job, net) + bar_notes(job, net)
    return net


def _held_whole(job: Job, net: Net) -> list[str]:
    """A note on elements of tables whose new nodes `subdivide` holds, for whoever meant them to hang."""
    between = net.fixed[net.elements].all((1, 2))
    if job.net.subdivide == 1 or not (job.net.nodes and between.any()):
        return []
    return [
        f"[net] subdivide: {counted('element', net.element_id[between])} between two fixed nodes: new nodes "
        "there are fixed too, so nothing sags, swings or bends between them, and no load there changes a "
        "force; what is to hang freely needs a node of nodes.csv between its ends"
    ]


def _from_generator(job: Job) -> Net:
    wrong = generators.wrong_dimensions(job.net, MOST_ELEMENTS)
    if wrong:
        raise InputError(f"{job.path}: [net] {wrong}")
    net = generators.generate(job.net)
    given = net.prestress
    _set_sections(job, net)
    net.prestress = net.prestress if given is None else given
    return net


def _with_sections(job: Job) -> Net:
    """The net of the tables; what stands in their columns overrides the job's sections."""
    net, columns = read_tables(job)
    _set_sections(job, net, columns)
    return net


def _set_sections(job: Job, net: Net, columns: dict | None = None) -> None:
    """The sections of the elements; unknown groups are reported before what they leave missing."""
    wrong = _wrong_groups(job, net)
    try:
        sections.set_sections(job, net, columns)
    except InputError as error:
        raise InputError(wrong + error.lines) from None
    if wrong:
        raise InputError(wrong)
    set_bars(job, net)


def _wrong_groups(job: Job, net: Net) -> list[str]:
    """A line for each section or list that names a group of which there is no element."""
    known = set(net.group_names) - {""}
    lines = [
        f"{job.path}: [cable.{name}]: no element is of this group; {nearest_group(net, name)}"
        for name in job.groups
        if name not in known
    ]
    lines += [
        f"{job.path}: [roof] groups: no element is of group {shown(name)}; {nearest_group(net, name)}"
        for name in roof_groups(job)
        if name not in known
    ]
    return lines


def _whole_net_errors(job: Job, net: Net) -> list[str]:
    errors = []
    lengths = net.lengths()
    for e in np.flatnonzero(~(lengths > 0))[:5]:
        a, b = net.node_id[net.elements[e]]
        errors.append(
            f"{job.path}: element {net.element_id[e]} between nodes {a} and {b} has no length; "
            "nodes that coincide must be one"
        )
    lonely = np.flatnonzero(np.bincount(net.elements.ravel(), minlength=net.n) == 0)
    for p in lonely[:5]:
        errors.append(f"{job.path}: node {net.node_id[p]} belongs to no element; remove it or connect it")
    equilibrium = job.form_finding is not None or load_steps(job) > 0
    if equilibrium and not errors:
        label = parts_of(net.elements, net.n)
        held = part_has(label, net.held.any(1))
        for part in np.flatnonzero((label == np.arange(net.n)) & ~held)[:5]:
            members = net.node_id[label == part]
            errors.append(
                f"{job.path}: the part of the net with node {members[0]} ({len(members)} nodes) "
                "has no support; fix a node of it: form finding and statics need an equilibrium"
            )
    compressed = np.flatnonzero((net.prestress < 0) & ~net.bar)
    if len(compressed) and not np.isfinite(net.force_density).any():
        e = compressed[0]
        errors.append(
            f"{job.path}: element {net.element_id[e]}: prestress = {net.prestress[e]:g}: "
            'a cable carries no compression; expected >= 0, or kind = "bar" for its group'
        )
    over = np.flatnonzero(np.abs(net.prestress) > net.yield_force)
    if len(over):
        e = over[0]
        errors.append(
            f"{job.path}: element {net.element_id[e]}: prestress = {net.prestress[e]:g} N: "
            f"above the yield force {net.yield_force[e]:g} N; "
            "lower it or choose a larger area"
        )
    if job.form_finding is not None and np.isfinite(net.unstressed_length).any():
        errors.append(
            f"{job.path}: unstressed_length in {job.net.elements} and [form_finding] exclude each other: "
            "form finding computes the unstressed lengths"
        )
    if job.form_finding is not None and net.spring_rest.any():
        errors.append(
            f"{job.path}: spring_rest_x, y, z in {job.net.nodes} and [form_finding] exclude each other: "
            "springs begin with the reaction of the form"
        )
    return errors + _springs_on_supports(job, net) + _without_tension(job, net) + _not_turned(job, net)


def _cables_of_one_name(job: Job, net: Net) -> list[str]:
    """Names of the table that a piece without a name has too."""
    return [
        f"{job.path.parent / job.net.elements}: cable = {name}: so a piece without a name is called, by the "
        "least id of its elements; rename it, or name that piece too"
        for name in same_names(net.cable_names)
    ]


def _springs_on_supports(job: Job, net: Net) -> list[str]:
    """Elastic supports of axes that are held rigidly."""
    both = np.argwhere(net.fixed & (net.spring > 0))
    return [
        f"{job.path.parent / job.net.nodes}: node {net.node_id[p]}: spring_{'xyz'[k]} = "
        f"{net.spring[p, k]:g}: the axis is fixed too; keep one of the two"
        for p, k in both[:5]
    ]


def _not_turned(job: Job, net: Net) -> list[str]:
    """What cannot be computed with supports in axes of their own, as far as the job asks for it."""
    nodes, form, place = net.node_id[is_turned(net)], job.form_finding, job.path.parent / str(job.net.nodes)
    if not len(nodes):
        return []
    refused = {
        '[form_finding] method = "force_density"': form and form.method == "force_density",
        '[form_finding] start = "force_density"': form and form.start == "force_density",
        "[[slide]]": bool(job.slides),
        "[wind] air_damping": air_damps(job),
    }
    return [
        f"{place}: angle: {counted('node', nodes)}: {what} does not know supports in axes of their own; "
        "expected angle = 0 there, supports alike along both axes in plan, or a job without it"
        for what, asked in refused.items()
        if asked
    ]


def _without_tension(job: Job, net: Net) -> list[str]:
    """Form finding by particles without a prestress: any shape would be in equilibrium."""
    moving = ~net.held[net.elements].all((1, 2))
    if job.form_finding is None or job.form_finding.method != "fpm" or not moving.any():
        return []
    if net.prestress[moving].any() or carries_permanent(job):
        return []
    other = np.isfinite(net.force_density).any()
    return [
        f'{job.path}: [form_finding] method = "fpm": no element that can move has a prestress, and without '
        "tension there is no form; give prestress in [cable], a number of N > 0, or as a column"
        + (', or method = "force_density", which takes the force densities of the table' if other else "")
    ]
