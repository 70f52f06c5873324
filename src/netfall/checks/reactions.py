"""The reactions of a roof at its supports, in each stage.

Two of them. `force`: where an axis is held, the pull of the elements at the support; at an elastic support
the force on its spring (`mechanics.supports`). `foundation`: that, and what acts on the node itself, which at
a spring is in it already; so those of a stage add up to all its loads.
"""

import numpy as np

from netfall.numerics.rotation import from_own, to_own
from netfall.results.states import ShownState, equilibria, final, springs_of, support_angles


def held_axes(f, place: str = "") -> np.ndarray:
    """(n, 3) bool, own axes with a support of either kind; place : of a state, which may have its own."""
    own = f"{place}/held"  # of a stage, and of the form
    held = f[own if place and own in f else "net/fixed"][:].astype(bool)
    return held | (f["net/spring"][:] > 0) if "spring" in f["net"] else held


def pull_at(x: np.ndarray, ends: np.ndarray, N: np.ndarray) -> np.ndarray:
    """Sum of the forces (points, 3) [N] with which elements pull at their ends.

    x : (points, 3) [m]; ends : (m, 2) rows of these; N : (m,) [N] tension positive
    """
    d = x[ends[:, 1]] - x[ends[:, 0]]
    L = np.linalg.norm(d, axis=1)
    force = np.divide(N[:, None] * d, L[:, None], out=np.zeros_like(d), where=L[:, None] > 0)
    pull = np.zeros_like(x)
    np.add.at(pull, ends[:, 0], force)
    np.subtract.at(pull, ends[:, 1], force)
    return pull


def reaction_columns(f) -> dict[str, np.ndarray]:
    """A row for each support and stage: the force [N] on it along the axes that it holds."""
    elements = f["net/elements"][:]
    stages = [*equilibria(f), *([last] if (last := final(f)) else [])]
    blocks = []
    for stage in stages:
        held = held_axes(f, stage.place)
        nodes = np.flatnonzero(held.any(1))
        blocks.append(_of_stage(f, stage, held[nodes], nodes, elements))
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}


def _of_stage(f, stage: ShownState, held, nodes, elements) -> dict[str, np.ndarray]:
    """held : (k, 3) bool, own axes of the supports, rows (k,) of the net"""
    x, angle = stage.position(), support_angles(f)
    pull = pull_at(x, elements if stage.ends is None else stage.ends, stage.tension())
    angle = None if angle is None else angle[nodes]
    force = np.where(held, to_own(pull[nodes], angle), 0.0)
    if "spring" in f["net"]:
        carried = stage.reaction() if stage.reaction else 0.0 - springs_of(f).forces(x)  # feet may settle
        force = np.where(f["net/spring"][:][nodes] > 0.0, to_own(carried[nodes], angle), force)
    force = from_own(force, angle)
    foundation = force if stage.unloaded else np.full_like(force, np.nan)  # in motion the file has none
    if stage.reaction:
        foundation = stage.reaction()[nodes]
    return {
        "node": f["net/node_id"][:][nodes],
        "stage": np.full(len(nodes), stage.name, object),
        **{axis: x[nodes, k] for k, axis in enumerate("xyz")},
        **{f"force_{axis}": force[:, k] for k, axis in enumerate("xyz")},
        "force": np.linalg.norm(force, axis=1),
        **{f"foundation_{axis}": foundation[:, k] for k, axis in enumerate("xyz")},
        "foundation": np.linalg.norm(foundation, axis=1),
    }
