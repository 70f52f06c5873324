"""A result as a model for OpenSees: the last equilibrium that the run found, to be found again."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from netfall.checks.reactions import pull_at
from netfall.exchange.state import State, form_of, lengths
from netfall.ground.errors import InputError
from netfall.ground.progress import one_line
from netfall.job.values import counted
from netfall.mechanics.law.measures import elastic_forces, unstressed_length
from netfall.numerics.rotation import directions
from netfall.results.result import Result
from netfall.results.states import Springs, springs_of, support_angles
from netfall.write.locks import whole

HOLDS = (
    *("ids", "tensions", "unstressed lengths", "axes of supports", "stiffness", "bars"),
    *("loads of nodes", "temperature", "springs", "angles of supports"),
)
FOLDER, AT_REST, UNITS = False, True, False
SAME = 1e-9  # of the largest force: what two ways to compute a force may differ by
LOAD_STEPS = 10
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


def write(result: Result, state: State, path: Path, unit: str) -> list[str]:
    """Write the model, which starts from the form. Raises InputError for supports that it cannot hold."""
    _check_guides(result, state, path)
    what, x, *of_elements = _equilibrium(result, state)
    there, told_out = ~state.out(), state.told_out("trusses")
    of_elements += [result.elements["axial_stiffness"], result.elements["bar"].astype(bool)]
    tension, free, EA, bar = (values[there] for values in of_elements)
    ends, ids = state.ends[there], state.element_id[there]
    state = replace(state, position=form_of(result)[0], ends=ends, element_id=ids)
    moved = np.where(state.fixed, x - state.position, 0.0)  # supports that settle
    reached = lengths(x, state.ends)
    linear = elastic_forces(reached, free, EA, bar, strain="engineering")
    other = np.abs(linear - tension) > SAME * np.abs(tension).max()
    free = np.where(other, unstressed_length(reached, tension, EA, strain="engineering"), free)
    springs = springs_of(result.file)
    load = np.where(state.fixed, 0.0, -pull_at(x, state.ends, tension) - springs.forces(x))
    load[np.abs(load) <= SAME * np.abs(tension).max()] = 0.0
    names = dict(name=path.name, stem=path.stem, steps=LOAD_STEPS, step=repr(1.0 / LOAD_STEPS))
    names["foot"] = first_foot(state)
    head = HEAD.format(title=one_line(result.title), what=one_line(what), source=result.path.name, **names)
    parts = [head, _nodes(state, moved), _elements(state, free, EA, bar), _springs(state, springs)]
    parts.append(_loads(state, load, moved))
    with whole(path) as place:
        place.write_text(
            "".join(parts) + ANALYSIS.format(**names) + RESULTS.format(**names), encoding="utf-8"
        )
    counts = f"{len(x)} nodes, {len(free)} trusses, {int(load.any(1).sum())} nodes with loads"
    sprung = f", {len(springs.nodes)} on springs" if len(springs.nodes) else ""
    told = [f"{path}: {what}; {counts}{sprung}", *told_out]
    if other.any():
        told.append(
            f"note: {int(other.sum())} elements are not linear elastic there (they yielded or slipped, the "
            "strain is logarithmic, or the case changes lengths): their unstressed lengths give the same "
            "force in this equilibrium alone; where many have yielded, OpenSees may not get there from the "
            "form"
        )
    return told


def _check_guides(result: Result, state: State, path: Path) -> None:
    """Raises InputError for nodes that move along lines which are neither x nor y."""
    angle = support_angles(result.file)
    if angle is None:
        return
    guided = (state.fixed[:, 0] != state.fixed[:, 1]) & (angle != 0.0)
    if guided.any():
        nodes = counted("node", state.node_id[guided])
        raise InputError(
            f"{path}: {nodes}: held along one axis at an angle, for which OpenSees has no fix; expected a "
            "stiff spring in place of fixed_x or fixed_y there, which zeroLength holds"
        )


def _equilibrium(result: Result, state: State) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
    """That of a case, else the last one found.

    What it is, position (n, 3) [m], tension (m,) [N], unstressed lengths (m,) [m]
    """
    x, tension = form_of(result)
    warm = result.elements["unstressed_length_warm"]
    if state.case:
        place = result.file[f"cases/{state.case}"]
        length = place["unstressed_length"][:] if "unstressed_length" in place else warm
        return state.name, x + place["displacement"][:], place["tension"][:], length
    if hasattr(result, "rest"):
        what = "rest under all constant loads" + " and the mean wind" * ("wind" in result.file)
        return what, result.rest["position"], result.rest["tension"], warm
    if hasattr(result, "statics"):
        moved, tension = result.statics["displacement"][-1], result.statics["tension"][-1]
        return "equilibrium under the static load", x + moved, tension, warm
    return "form", x, tension, result.elements["unstressed_length"]


def _nodes(state: State, moved: np.ndarray) -> str:
    """moved : (n, 3) [m], of supports; what moves is held by the loads"""
    lines, fixed = [], state.fixed & (moved == 0.0)
    for tag, x, held in zip(state.node_id.tolist(), state.position.tolist(), fixed.tolist(), strict=True):
        lines.append(f"node {tag} {x[0]!r} {x[1]!r} {x[2]!r}\n")
        if any(held):
            lines.append(f"fix {tag} {' '.join(str(int(axis)) for axis in held)}\n")
    return "".join(lines)


def _elements(state: State, free: np.ndarray, EA: np.ndarray, bar: np.ndarray) -> str:
    """Two materials for each truss, of the area 1 m2: its stiffness, and the strain it has in the form."""
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


def _springs(state: State, springs: Springs) -> str:
    """A foot and a zeroLength for each node on springs, whose materials begin with the spring's strain."""
    lines, material = [], 2 * len(state.element_id)
    columns = (springs.nodes, springs.stiffness, springs.rest)
    for tag, (p, k, rest) in enumerate(zip(*(c.tolist() for c in columns)), first_foot(state)):
        x, kinds, axes = state.position[p].tolist(), [], []
        lines.append(f"node {tag} {x[0]!r} {x[1]!r} {x[2]!r}\nfix {tag} 1 1 1\n")
        for axis in [axis for axis in range(3) if k[axis] > 0.0]:
            lines.append(f"uniaxialMaterial Elastic {material + 1} {k[axis]!r}\n")
            initial = f"{material + 2} {material + 1} {-rest[axis]!r}"
            lines.append(f"uniaxialMaterial InitStrainMaterial {initial}\n")
            material += 2
            kinds.append(str(material))
            axes.append(str(axis + 1))
        ends = f"{tag} {int(state.node_id[p])}"
        orient = ""
        if springs.angle is not None:
            c, s = directions(springs.angle[tag - first_foot(state)][None])[0].tolist()
            orient = f" -orient {c!r} {s!r} 0 {-s!r} {c!r} 0"
        mats, along = " ".join(kinds), " ".join(axes)
        lines.append(f"element zeroLength {tag} {ends} -mat {mats} -dir {along}{orient}\n")
    return "".join(lines)


def first_foot(state: State) -> int:
    """The first number above all nodes and elements, for the feet of springs and their elements."""
    return 1 + int(max(state.node_id.max(), state.element_id.max()))


def _loads(state: State, load: np.ndarray, moved: np.ndarray) -> str:
    loaded = np.flatnonzero(load.any(1))
    lines = [
        f"    load {tag} {f[0]!r} {f[1]!r} {f[2]!r}\n"
        for tag, f in zip(state.node_id[loaded].tolist(), load[loaded].tolist(), strict=True)
    ]
    for p, k in np.argwhere(moved != 0.0).tolist():
        lines.append(f"    sp {int(state.node_id[p])} {k + 1} {float(moved[p, k])!r}\n")
    return "\ntimeSeries Linear 1\npattern Plain 1 1 {\n" + "".join(lines) + "}\n"
