"""Command `netfall import`: from a drawing or mesh to tables, a picture, a first job and a report."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from netfall.core.errors import InputError
from netfall.core.messages import count_of
from netfall.exchange import messages
from netfall.exchange.drawings.reading import ImportOptions, NetImport, read_net
from netfall.job.csv_table import write_table
from netfall.job.toml_text import toml_name, toml_value
from netfall.results.locks import atomic_folder

MAX_ANGLE = 10.0  # degrees from the vertical
MAX_IMBALANCE = 1e-3  # of the largest force; coordinates rounded to millimetres leave less
MAX_SINE = 0.02  # sine of the angle to the horizontal below which an element has no vertical pull
TEXT = """\
# {name}: a first job for the net that was imported. Sections and forces are placeholders: CHOOSE them.
#
#   netfall check this file
#   netfall run this file

title = {title}

[net]
nodes = "nodes.csv"
elements = "elements.csv"

[cable]                         # CHOOSE; the values of all groups that have none of their own below
modulus = 1.6e11                # Pa
area = 500e-6                   # m2
density = 7850.0                # kg/m3
{prestress}# yield_stress = 1.4e9          # Pa
# fracture_strain = 0.03
# catalogue = "cables.csv"      # name, mass_per_length, axial_stiffness, breaking_load; then for the cables
# type = "FLC40"                # of a group, in place of modulus, area and density

{groups}
{form_finding}
[load]
self_weight = true
# dead = 300.0                  # N/m2 of roof surface, cladding
# snow = 750.0                  # N/m2 in plan
steps = 1

# [wind]
# speed = 40.0                  # m/s, mean at 10 m
# turbulence_intensity = 0.2    # intensity of the gusts at 10 m
# base_height = 0.0             # m of z = 0 above ground
# pressure_coefficient = -1.3   # suction
#
# [dynamics]
# duration = 6.0                # s
"""
GROUP = """\
# [group.{name}]
# area = 500e-6                 # m2
# kind = "bar"                  # if it carries compression too
"""
PRESTRESS = "prestress = 50e3                # N, with which the form is found\n"
BY_PRESTRESS = """\
[form_finding]                  # finds the form under the prestress; remove it to keep the geometry as drawn
"""
BY_DENSITY = """\
[form_finding]                  # finds the form of the force densities of elements.csv
method = "force_density"
"""
GIVEN = "# the geometry is in equilibrium with the prestress of elements.csv: no [form_finding]\n"
POSTS = """\
[group.{name}]
kind = "bar"                    # GUESSED: {reason}
area = 4000e-6                  # m2, CHOOSE
modulus = 2.1e11
{prestress}"""
UPRIGHT = "vertical, and only its compression can hold up a node"
PUSHED = "the file has negative force densities in it"
NO_PRESTRESS = "prestress = 0.0                 # N; negative is compression\n"


def import_file(path: Path, folder: Path, options: ImportOptions, say: Callable[[str], None]) -> None:
    """Read a drawing, report its content and faults, and write tables, a picture and a first job.

    Raises InputError if the file cannot be read, has no unit, or contains no net.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(messages.IMPORT_TO_FILE(folder=folder))
    if (folder / "nodes.csv").exists() and not (folder / "report.txt").exists():
        raise InputError(messages.FOREIGN_NODES(folder=folder))
    reading = read_net(path, options)
    written = []
    try:
        with atomic_folder(folder) as temporary:
            written = _write(reading, folder, temporary)
    finally:  # last, because a closed pipe can stop the output
        for line in [*reading.lines, *written]:
            say(line)


def _write(reading: NetImport, folder: Path, target: Path) -> list[str]:
    """Write tables, picture, job and report of a folder to `target`; return lines on what was written."""
    from netfall.post.plots.net import draw_imported_net

    net, drawing = reading.net, reading.drawing
    names = [" ".join(name.splitlines()).strip() for name in drawing.layers]  # as cells of a table
    node_id, group = _node_ids(reading), [names[k] for k in drawing.layer[net.line].tolist()]
    x = net.x
    nodes, fixed = {"id": node_id, "x": x[:, 0], "y": x[:, 1], "z": x[:, 2]}, reading.fixed
    if (fixed.any(1) == fixed.all(1)).all():
        nodes["fixed"] = fixed[:, 0].astype(int)
    else:
        nodes |= {f"fixed_{axis}": fixed[:, k].astype(int) for k, axis in enumerate("xyz")}
    elements = {"id": np.arange(1, len(net.ends) + 1), "start": node_id[net.ends[:, 0]]}
    elements |= {"end": node_id[net.ends[:, 1]], "group": group}
    direction = x[net.ends[:, 1]] - x[net.ends[:, 0]]
    length, drawn = (np.linalg.norm(d, axis=1) for d in (direction, np.diff(drawing.lines, axis=1)[:, 0]))
    is_part = (np.bincount(net.line)[net.line] > 1) | np.isin(net.line, net.parts[:, 0])
    q = np.zeros(0)
    if drawing.force_density is not None:  # parts have the force of their line
        q = drawing.force_density[net.line] * np.where(is_part, drawn[net.line] / length, 1.0)
    taut = {group[e] for e in np.flatnonzero(q > 0.0).tolist()}
    for e in np.flatnonzero(q < 0.0).tolist():  # no cable of the group becomes a bar with them
        while group[e] in taut:
            group[e] += "_struts"
    balanced = len(q) > 0 and is_balanced(x, net.ends, q, fixed)  # only form finding preloads springs
    if len(q):
        elements |= {"prestress": q * length} if balanced else {"force_density": q}
    if reading.spring is not None:
        nodes |= {f"spring_{axis}": reading.spring[:, k] for k, axis in enumerate("xyz")}
    write_table(target / "nodes.csv", nodes)
    write_table(target / "elements.csv", elements)
    lines = _group_lines(group, length)
    job = folder / f"{folder.resolve().name}.toml"
    is_new = not job.exists()
    if is_new:
        upright = upright_groups(group, direction)
        props = {group[e] for e in np.flatnonzero(compressed_elements(x, net.ends, reading.held)).tolist()}
        posts = dict.fromkeys((name for name in upright if name in props), UPRIGHT)
        posts |= {group[e]: PUSHED for e in np.flatnonzero(q < 0.0).tolist() if group[e] not in posts}
        names = sorted(set(group))
        text = first_job(reading.path.stem, names, posts, elements.get("force_density"), balanced)
        lines += [
            f'    group "{name}": {reason.split(",")[0]}, imported as kind = "bar" in {job.name}'
            for name, reason in posts.items()
        ]
        lines += [
            f'    group "{name}": vertical, imported as cables; for posts or struts set kind = "bar" '
            f"in {job.name}"
            for name in upright
            if name not in posts
        ]
        (target / job.name).write_text(text, encoding="utf-8")
    spring = np.zeros_like(fixed) if reading.spring is None else reading.spring > 0.0
    draw_imported_net(x, net.ends, group, fixed, spring, reading.marks, reading.path.name, target / "net.png")
    (target / "report.txt").write_text("\n".join([*reading.lines, *lines, ""]), encoding="utf-8")
    note = "" if is_new else " (existing job, not changed)"
    return [
        *lines,
        f"{folder}: nodes.csv, elements.csv, net.png, report.txt, {job.name}{note}",
        f"next: netfall check {job}",
    ]


def upright_groups(group: list[str], direction: np.ndarray) -> list[str]:
    """Return the groups whose elements, directions (m, 3) [m], are all upright to MAX_ANGLE.

    Returns none if every group is upright, as in a net that hangs from one point.
    """
    upright = np.abs(direction[:, 2]) >= np.cos(np.radians(MAX_ANGLE)) * np.linalg.norm(direction, axis=1)
    others = {name for name, is_upright in zip(group, upright) if not is_upright}
    return sorted(set(group) - others) if others else []


def compressed_elements(x: np.ndarray, ends: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Select the elements (m,) below a free node that no element pulls up and others pull down.

    Only compression in an element holds such a node up. x : (n, 3) [m]; ends : (m, 2); held : (n,) bool
    """
    rise = np.diff(x[ends, 2], axis=1)[:, 0] / np.linalg.norm(np.diff(x[ends], axis=1)[:, 0], axis=1)
    up = np.full(len(x), -np.inf)
    np.maximum.at(up, ends[:, 0], rise)
    np.maximum.at(up, ends[:, 1], -rise)
    upper = np.where(rise > 0.0, ends[:, 1], ends[:, 0])
    down = np.bincount(upper[np.abs(rise) > MAX_SINE], minlength=len(x))
    propped = ~held & (up <= MAX_SINE) & (down >= 2)
    return propped[upper]


def _node_ids(reading: NetImport) -> np.ndarray:
    """Return the ids of the nodes: those of the file if they are unique, otherwise 1, 2, 3, ..."""
    net, keys = reading.net, reading.drawing.keys
    count = len(net.x)
    if keys is None or reading.options.split:
        return np.arange(1, count + 1)
    ids = np.full(count, -1)
    ids[net.ends] = keys[net.line]
    return ids if len(np.unique(ids)) == count else np.arange(1, count + 1)


def _group_lines(group: list[str], length: np.ndarray) -> list[str]:
    """Summarise the number and lengths of the elements, in all and by group."""
    names, row = np.unique(group, return_inverse=True)
    lines = [f"net: {count_of(len(length), 'element')}, {length.sum():.6g} m in all"]
    for k, name in enumerate(names):
        lengths = length[row == k]
        spread = f"{lengths.sum():.6g} m, from {lengths.min():.4g} to {lengths.max():.4g} m"
        lines.append(f'    group "{name}": {count_of(len(lengths), "element")}, {spread}')
    return lines


def is_balanced(x: np.ndarray, ends: np.ndarray, q: np.ndarray, fixed: np.ndarray) -> bool:
    """Return whether force densities q (m,) [N/m] are in equilibrium along axes that are not fixed (n, 3)."""
    force = q[:, None] * np.diff(x[ends], axis=1)[:, 0]
    residual = np.zeros_like(x)
    np.add.at(residual, ends[:, 0], force)
    np.add.at(residual, ends[:, 1], -force)
    return bool(np.abs(residual[~fixed]).max(initial=0.0) < MAX_IMBALANCE * np.abs(force).max())


def first_job(
    name: str, groups: list[str], posts: dict[str, str], densities: np.ndarray | None, balanced: bool
) -> str:
    """Return the text of a first job (TOML).

    name : of the drawing; groups : all groups; posts : groups that are probably bars, with the reason
    densities : (m,) [N/m] force densities of the file, nan: none; None: none in the file
    balanced : whether each element has the prestress that keeps the geometry
    """
    has_all = balanced or (densities is not None and bool(np.isfinite(densities).all()))
    form_finding = BY_PRESTRESS if densities is None else BY_DENSITY
    parts = [
        (POSTS if group in posts else GROUP).format(
            name=toml_name(group), prestress="" if has_all else NO_PRESTRESS, reason=posts.get(group)
        )
        for group in groups
    ]
    return TEXT.format(
        name=name,
        title=toml_value(" ".join(name.split()) or "imported net"),
        groups="".join(parts),
        prestress="" if has_all else PRESTRESS,
        form_finding=GIVEN if balanced else form_finding,
    )
