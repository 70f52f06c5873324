"""Reactions of a roof at its supports, in each stage.

`force` is the pull of the elements along held axes; at an elastic support it is the force on the spring
(`physics.supports`). `foundation` adds the loads on the node itself, which a spring force already includes.
The foundation forces of a stage therefore add up to all its loads.
"""

import h5py
import numpy as np

from netfall.core.functions import from_rotated_axes, to_rotated_axes
from netfall.results.states import StateView, equilibria, final, read_springs, support_angles


def held_axes(f: h5py.File, place: str = "") -> np.ndarray:
    """Return which own axes (n, 3) of the nodes have a support, rigid or elastic.

    place : group of the state, which may have supports of its own
    """
    path = f"{place}/held"  # stages of erection and the form have one
    held = f[path if place and path in f else "net/fixed"][:].astype(bool)
    return held | (f["net/spring"][:] > 0) if "spring" in f["net"] else held


def sum_end_forces(x: np.ndarray, ends: np.ndarray, N: np.ndarray) -> np.ndarray:
    """Sum the forces (points, 3) [N] with which elements pull at their ends.

    x : (points, 3) [m]; ends : (m, 2) rows of these; N : (m,) [N] tension positive
    """
    d = x[ends[:, 1]] - x[ends[:, 0]]
    L = np.linalg.norm(d, axis=1)
    force = np.divide(N[:, None] * d, L[:, None], out=np.zeros_like(d), where=L[:, None] > 0)
    pull = np.zeros_like(x)
    np.add.at(pull, ends[:, 0], force)
    np.subtract.at(pull, ends[:, 1], force)
    return pull


def reaction_columns(f: h5py.File) -> dict[str, np.ndarray]:
    """Return the forces [N] on supports along the axes that they hold, one row for each support and stage."""
    elements = f["net/elements"][:]
    stages = [*equilibria(f), *([final_state] if (final_state := final(f)) else [])]
    blocks = []
    for stage in stages:
        held = held_axes(f, stage.place)
        nodes = np.flatnonzero(held.any(1))
        blocks.append(_stage_reactions(f, stage, held[nodes], nodes, elements))
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}


def _stage_reactions(
    f: h5py.File, stage: StateView, held: np.ndarray, nodes: np.ndarray, elements: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the rows of one stage; held : (k, 3) bool, own axes of the supports at nodes (k,)."""
    x, angle = stage.position(), support_angles(f)
    pull = sum_end_forces(x, elements if stage.ends is None else stage.ends, stage.tension())
    angle = None if angle is None else angle[nodes]
    force = np.where(held, to_rotated_axes(pull[nodes], angle), 0.0)
    if "spring" in f["net"]:
        carried = stage.reaction() if stage.reaction else 0.0 - read_springs(f).forces(x)  # feet may settle
        force = np.where(f["net/spring"][:][nodes] > 0.0, to_rotated_axes(carried[nodes], angle), force)
    force = from_rotated_axes(force, angle)
    foundation = force if stage.unloaded else np.full_like(force, np.nan)  # snapshots store no nodal loads
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
