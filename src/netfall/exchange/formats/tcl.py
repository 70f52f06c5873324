"""A result as a model for OpenSees: the last equilibrium that the run found, to be found again."""

from pathlib import Path

import numpy as np

from netfall.exchange.state import State, form_of, lengths
from netfall.mechanics.material import elastic_forces, unstressed_length
from netfall.results.result import Result
from netfall.write.locks import whole

HOLDS = (
    *("ids", "tensions", "unstressed lengths", "axes of supports", "stiffness", "bars"),
    *("loads of nodes", "temperature"),
)
FOLDER, AT_REST = False, True
SAME = 1e-9  # of the largest force: what two ways to compute a force may differ by
LOAD_STEPS = 10
HEAD = """\
# {title}
# {what}, by netfall from {source}
# Tags are ids of nodes and elements. Units: m, N. Corotational trusses with initial strain, cables without
# stiffness when slack. Strains refer to the lengths in the form: modulus and initial strain follow from that.
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
foreach e [getEleTags] {{ puts $out "$e [lindex [basicForce $e] 0]" }}
close $out
set out [open "{stem}_displacement.txt" w]
foreach p [getNodeTags] {{ puts $out "$p [nodeDisp $p]" }}
close $out
"""


def write(result: Result, state: State, path: Path) -> list[str]:
    """Write the model. The state is the form, which the model starts from."""
    what, x, tension, free = _equilibrium(result)
    EA, bar, reached = result.elements["axial_stiffness"], result.elements["bar"], lengths(x, state.ends)
    linear = elastic_forces(reached, free, EA, bar.astype(bool), strain="engineering")
    other = np.abs(linear - tension) > SAME * np.abs(tension).max()
    free = np.where(other, unstressed_length(reached, tension, EA, strain="engineering"), free)
    load = np.where(state.fixed, 0.0, -internal(x, state.ends, tension))
    load[np.abs(load) <= SAME * np.abs(tension).max()] = 0.0
    names = dict(name=path.name, stem=path.stem, steps=LOAD_STEPS, step=repr(1.0 / LOAD_STEPS))
    head = HEAD.format(title=" ".join(result.title.split()), what=what, source=result.path.name, **names)
    parts = [head, _nodes(state), _elements(result, state, free), _loads(state, load)]
    with whole(path) as place:
        place.write_text(
            "".join(parts) + ANALYSIS.format(**names) + RESULTS.format(**names), encoding="utf-8"
        )
    told = [f"{path}: {what}; {len(x)} nodes, {len(free)} trusses, {int(load.any(1).sum())} nodes with loads"]
    if other.any():
        told.append(
            f"note: {int(other.sum())} elements are not linear elastic there (they yielded, or the strain is "
            "logarithmic): their unstressed lengths give the same force in this equilibrium alone; where "
            "many have yielded, OpenSees may not get there from the form"
        )
    return told


def _equilibrium(result: Result) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
    """The last one found: what it is, position (n, 3) [m], tension (m,) [N], unstressed lengths (m,) [m]."""
    x, tension = form_of(result)
    warm = result.elements["unstressed_length_warm"]
    if hasattr(result, "rest"):
        what = "rest under all constant loads and the mean wind"
        return what, result.rest["position"], result.rest["tension"], warm
    if hasattr(result, "statics"):
        moved, tension = result.statics["displacement"][-1], result.statics["tension"][-1]
        return "equilibrium under the static load", x + moved, tension, warm
    return "form", x, tension, result.elements["unstressed_length"]


def internal(x: np.ndarray, ends: np.ndarray, tension: np.ndarray) -> np.ndarray:
    """Forces (n, 3) [N] of the elements on the nodes."""
    along = x[ends[:, 1]] - x[ends[:, 0]]
    force = along * (tension / np.linalg.norm(along, axis=1))[:, None]
    total = np.zeros_like(x)
    np.add.at(total, ends[:, 0], force)
    np.add.at(total, ends[:, 1], -force)
    return total


def _nodes(state: State) -> str:
    lines = []
    for tag, x, held in zip(
        state.node_id.tolist(), state.position.tolist(), state.fixed.tolist(), strict=True
    ):
        lines.append(f"node {tag} {x[0]!r} {x[1]!r} {x[2]!r}\n")
        if any(held):
            lines.append(f"fix {tag} {' '.join(str(int(axis)) for axis in held)}\n")
    return "".join(lines)


def _elements(result: Result, state: State, free: np.ndarray) -> str:
    """Two materials for each truss, of the area 1 m2: its stiffness, and the strain it has in the form."""
    length = lengths(state.position, state.ends)
    modulus = result.elements["axial_stiffness"] * length / free
    in_compression = np.where(result.elements["bar"].astype(bool), modulus, 0.0)
    columns = (state.element_id, state.node_id[state.ends], modulus, in_compression, (length - free) / length)
    lines = []
    for k, (tag, (a, b), E, E_c, strain) in enumerate(zip(*(c.tolist() for c in columns), strict=True)):
        lines.append(
            f"uniaxialMaterial Elastic {2 * k + 1} {E!r} 0.0 {E_c!r}\n"
            f"uniaxialMaterial InitStrainMaterial {2 * k + 2} {2 * k + 1} {strain!r}\n"
            f"element corotTruss {tag} {a} {b} 1.0 {2 * k + 2}\n"
        )
    return "".join(lines)


def _loads(state: State, load: np.ndarray) -> str:
    loaded = np.flatnonzero(load.any(1))
    lines = [
        f"    load {tag} {f[0]!r} {f[1]!r} {f[2]!r}\n"
        for tag, f in zip(state.node_id[loaded].tolist(), load[loaded].tolist(), strict=True)
    ]
    return "\ntimeSeries Linear 1\npattern Plain 1 1 {\n" + "".join(lines) + "}\n"
