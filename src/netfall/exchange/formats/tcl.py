"""Export of a result as an OpenSees model, which solves the last equilibrium of the run again."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from netfall.core.arrays import IntArray
from netfall.core.errors import InputError
from netfall.core.functions import directions
from netfall.core.progress import one_line
from netfall.exchange import messages
from netfall.exchange.state import (
    ExportState,
    form_of,
    guided_at_an_angle,
    lengths,
    no_equilibrium_warnings,
)
from netfall.job.values import counted
from netfall.physics.law.measures import elastic_forces, unstressed_length
from netfall.post.checks.nodes import sum_end_forces
from netfall.results.locks import whole
from netfall.results.reader import Result
from netfall.results.states import (
    Springs,
    StateView,
    group_equilibria,
    read_springs,
)

CONTENTS = (
    *("ids", "tensions", "unstressed lengths", "axes of supports", "stiffness", "bars"),
    *("loads of nodes", "temperature", "springs", "angles of supports"),
)
FOLDER, STATIC_ONLY, UNITS = False, True, False
FORCE_TOLERANCE = 1e-9  # share of the largest force by which two computations of a force may differ
LOAD_STEPS = 10
MAX_TAG = 2**31 - 1  # of a node or an element of OpenSees
SPECIAL = str.maketrans({character: f"\\{character}" for character in '\\"[]{}$'})  # in a string of Tcl
HEAD = """\
# {title}
# {what}, by netfall from {source}
# Tags are ids of nodes and elements. Units: m, N. Corotational trusses with initial strain, cables without
# stiffness when slack. Strains refer to the lengths in the form: modulus and initial strain follow from that.
# Elastic supports are zeroLength elements to held nodes in the same place.
#
#   OpenSees {name}
#
# writes {stem}_tension.txt (element, force [N]) and {stem}_displacement.txt (node, from the form [m])

wipe
model basic -ndm 3 -ndf 3
"""
ANALYSIS = """
constraints Plain
numberer RCM
system UmfPack
test NormDispIncr 1e-12 100 0 0
algorithm Newton
integrator LoadControl {step}
analysis Static
"""
RESULTS = """
# --- the equilibrium, and what it is
if {{[analyze {steps}] != 0}} {{ puts stderr "{name}: no equilibrium found"; exit 1 }}
set out [open "{stem}_tension.txt" w]
foreach e [getEleTags] {{ if {{$e < {foot}}} {{ puts $out "$e [lindex [basicForce $e] 0]" }} }}
close $out
set out [open "{stem}_displacement.txt" w]
foreach p [getNodeTags] {{ if {{$p < {foot}}} {{ puts $out "$p [nodeDisp $p]" }} }}
close $out
"""


def write(result: Result, state: ExportState, path: Path, unit: str) -> list[str]:
    """Write the model, which starts from the form. Raises InputError for supports that OpenSees lacks."""
    _check_guides(result, state, path)
    _check_tags(result, state, path)
    equilibrium, free = _equilibrium(result, state)
    name, x = equilibrium.name, equilibrium.position()
    present, removal_lines = ~state.out(), state.removed_element_lines("trusses")
    tension, free = equilibrium.tension()[present], free[present]
    EA, bar = result.elements["axial_stiffness"][present], result.elements["bar"].astype(bool)[present]
    ends, ids = state.ends[present], state.element_id[present]
    state = replace(state, position=form_of(result)[0], ends=ends, element_id=ids)
    settlement = np.where(state.fixed, x - state.position, 0.0)  # settlement of supports
    length = lengths(x, state.ends)
    linear_tension = elastic_forces(length, free, EA, bar, strain="engineering")
    nonlinear = np.abs(linear_tension - tension) > FORCE_TOLERANCE * np.abs(tension).max()
    free = np.where(nonlinear, unstressed_length(length, tension, EA, strain="engineering"), free)
    springs = read_springs(result.file)
    load = np.where(state.fixed, 0.0, -sum_end_forces(x, state.ends, tension) - springs.forces(x))
    load[np.abs(load) <= FORCE_TOLERANCE * np.abs(tension).max()] = 0.0
    fields = dict(name=path.name, stem=path.stem, steps=LOAD_STEPS, step=repr(1.0 / LOAD_STEPS))
    fields["foot"] = first_free_tag(state)
    quoted = {key: str(value).translate(SPECIAL) for key, value in fields.items()}
    head = HEAD.format(title=one_line(result.title), what=one_line(name), source=result.path.name, **fields)
    parts = [head, _nodes(state, settlement), _elements(state, free, EA, bar), _springs(state, springs)]
    parts.append(_loads(state, load, settlement))
    with whole(path) as temporary:
        temporary.write_text(
            "".join(parts) + ANALYSIS.format(**fields) + RESULTS.format(**quoted), encoding="utf-8"
        )
    counts = f"nodes: {len(x)}, trusses: {len(free)}, nodes with loads: {int(load.any(1).sum())}"
    spring_count = f", on springs: {len(springs.nodes)}" if len(springs.nodes) else ""
    lines = [f"{path}: {name}; {counts}{spring_count}", *removal_lines]
    if nonlinear.any():
        lines.append(messages.NOT_LINEAR_ELASTIC(path=path, count=int(nonlinear.sum())))
    return lines


def _check_guides(result: Result, state: ExportState, path: Path) -> None:
    """Check that nodes are guided only along x or y. Raises InputError."""
    guided = guided_at_an_angle(result, state.fixed)
    if guided.any():
        nodes = counted("node", state.node_id[guided])
        raise InputError(messages.GUIDED_NODES(path=path, nodes=nodes))


def _check_tags(result: Result, state: ExportState, path: Path) -> None:
    """Check that OpenSees accepts the ids, including the feet of springs. Raises InputError."""
    last = first_free_tag(state) + len(read_springs(result.file).nodes) - 1
    if last > MAX_TAG:
        raise InputError(messages.LARGE_TAGS(path=path, last=last, limit=MAX_TAG))


def _equilibrium(result: Result, state: ExportState) -> tuple[StateView, np.ndarray]:
    """Return the equilibrium of the case, or the last equilibrium of the run, and lengths (m,) [m] in it."""
    if state.case:
        place = f"cases/{state.case}"
    else:
        place = next((name for name in ("initial_state", "statics") if name in result.file), "")
    if not place:
        view = StateView(state.name, lambda: state.tension, lambda: state.position)
        return view, state.unstressed_length
    state.warnings.extend(no_equilibrium_warnings(result.file, place))
    return [*group_equilibria(result.file, place)][-1], state.unstressed_length_warm


def _nodes(state: ExportState, settlement: np.ndarray) -> str:
    """Return the nodes and their fixed axes; settlement : (n, 3) [m] of supports.

    Axes that settle are free here, because the loads prescribe their displacement.
    """
    lines, fixed = [], state.fixed & (settlement == 0.0)
    for tag, x, held in zip(state.node_id.tolist(), state.position.tolist(), fixed.tolist(), strict=True):
        lines.append(f"node {tag} {x[0]!r} {x[1]!r} {x[2]!r}\n")
        if any(held):
            lines.append(f"fix {tag} {' '.join(str(int(axis)) for axis in held)}\n")
    return "".join(lines)


def _elements(state: ExportState, free: IntArray, EA: np.ndarray, bar: np.ndarray) -> str:
    """Return two materials and a truss of area 1 m2 for each element: its stiffness and initial strain.

    Strains refer to the lengths in the form.
    """
    length = lengths(state.position, state.ends)
    modulus = EA * length / free
    in_compression = np.where(bar, modulus, 0.0)
    columns = (state.element_id, state.node_id[state.ends], modulus, in_compression, (length - free) / length)
    lines = []
    for k, (tag, (a, b), E, E_c, strain) in enumerate(zip(*(c.tolist() for c in columns), strict=True)):
        lines.append(
            f"uniaxialMaterial Elastic {2 * k + 1} {E!r} 0.0 {E_c!r}\n"
            f"uniaxialMaterial InitStrainMaterial {2 * k + 2} {2 * k + 1} {strain!r}\n"
            f"element corotTruss {tag} {a} {b} 1.0 {2 * k + 2}\n"
        )
    return "".join(lines)


def _springs(state: ExportState, springs: Springs) -> str:
    """Return a foot and a zeroLength element for each node on springs, with the initial strain."""
    lines, material = [], 2 * len(state.element_id)
    columns = (springs.nodes, springs.stiffness, springs.rest)
    for tag, (p, k, offset) in enumerate(zip(*(c.tolist() for c in columns)), first_free_tag(state)):
        x, materials, axes = state.position[p].tolist(), [], []
        lines.append(f"node {tag} {x[0]!r} {x[1]!r} {x[2]!r}\nfix {tag} 1 1 1\n")
        for axis in [axis for axis in range(3) if k[axis] > 0.0]:
            lines.append(f"uniaxialMaterial Elastic {material + 1} {k[axis]!r}\n")
            initial = f"{material + 2} {material + 1} {-offset[axis]!r}"
            lines.append(f"uniaxialMaterial InitStrainMaterial {initial}\n")
            material += 2
            materials.append(str(material))
            axes.append(str(axis + 1))
        ends = f"{tag} {int(state.node_id[p])}"
        orient = ""
        if springs.angle is not None:
            c, s = directions(springs.angle[tag - first_free_tag(state)][None])[0].tolist()
            orient = f" -orient {c!r} {s!r} 0 {-s!r} {c!r} 0"
        materials_text, axes_text = " ".join(materials), " ".join(axes)
        lines.append(f"element zeroLength {tag} {ends} -mat {materials_text} -dir {axes_text}{orient}\n")
    return "".join(lines)


def first_free_tag(state: ExportState) -> int:
    """Return the first number above all nodes and elements, for the feet of springs and their elements."""
    return 1 + int(max(state.node_id.max(), state.element_id.max()))


def _loads(state: ExportState, load: np.ndarray, settlement: np.ndarray) -> str:
    """Return the pattern of nodal loads and of prescribed displacements; settlement : (n, 3) [m]."""
    loaded = np.flatnonzero(load.any(1))
    lines = [
        f"    load {tag} {f[0]!r} {f[1]!r} {f[2]!r}\n"
        for tag, f in zip(state.node_id[loaded].tolist(), load[loaded].tolist(), strict=True)
    ]
    for p, k in np.argwhere(settlement != 0.0).tolist():
        lines.append(f"    sp {int(state.node_id[p])} {k + 1} {float(settlement[p, k])!r}\n")
    return "\ntimeSeries Linear 1\npattern Plain 1 1 {\n" + "".join(lines) + "}\n"
