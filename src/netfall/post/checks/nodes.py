"""Checks at nodes: reactions at supports, moments that loads at nodes lack, and utilisation of slip points.

Reactions, in each stage:
`force` is the pull of the elements along held axes, with the shear of bending chains; at an elastic support
it is the force on the spring (`physics.supports`). `foundation` adds the loads on the node itself, which a
spring force already includes.
The foundation forces of a stage therefore add up to all its loads. In motion the highest and lowest
foundation forces along each axis are those of /envelope, at different times.

Utilisation: the force against slip over the slip resistance. The force is the difference of the adjoining
tensions at the slip point; for the largest in motion they are those in the middle of elements.

holds = resistance + t (exp(mu alpha / 1.65) - 1)     t: the smaller tension, alpha: turn of the cable

The partial factor applies to friction alone (EN 1993-1-11, 6.3); the resistance of a clamp is as given (6.4).
"""

from typing import Any

import h5py
import numpy as np

from netfall.core.functions import from_rotated_axes, lengths, to_rotated_axes
from netfall.post import messages
from netfall.post.checks.bending import bending_forces, bending_strengths, is_bending, unit
from netfall.post.checks.ends import start_weights_of
from netfall.results.states import (
    DYNAMIC_STAGE,
    StateView,
    all_states,
    equilibria,
    form_position,
    read_springs,
    start_position,
    support_angles,
)


def held_axes(f: h5py.File, place: str = "") -> np.ndarray:
    """Return which axes (n, 3) of the nodes, rotated if given, have a support, rigid or elastic.

    place : group of the state, which may have other supports
    """
    path = f"{place}/held"  # stages of erection and the form have this dataset
    held = f[path if place and path in f else "net/fixed"][:].astype(bool)
    return held | spring_axes(f)


def spring_axes(f: h5py.File) -> np.ndarray:
    """Return which axes (n, 3) of the nodes have a spring."""
    return f["net/spring"][:] > 0 if "spring" in f["net"] else np.zeros(f["net/fixed"].shape, bool)


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


def element_pull(f: h5py.File, state: StateView) -> np.ndarray:
    """Return the forces (points, 3) [N] of all elements on the points of a state, with those of bending."""
    ends = f["net/elements"][:] if state.ends is None else state.ends
    pull = sum_end_forces(state.position(), ends, state.tension())
    return pull if state.read("bending_moment") is None else pull + bending_forces(f, state)


def reaction_columns(f: h5py.File) -> dict[str, np.ndarray]:
    """Return the forces [N] on supports along the axes that they hold, one row for each support and stage."""
    blocks = [_stage_reactions(f, stage) for stage in all_states(f)]
    if "envelope/reaction_max" in f:  # earlier versions do not write it
        blocks += [_motion_reactions(f, extreme) for extreme in ("highest", "lowest")]
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}


def _stage_reactions(f: h5py.File, stage: StateView) -> dict[str, np.ndarray]:
    """Return the rows of one stage."""
    held = held_axes(f, stage.place)
    nodes = np.flatnonzero(held.any(1))
    x, angle, reaction = stage.position(), support_angles(f), stage.read("reaction")
    pull = element_pull(f, stage)
    angle = None if angle is None else angle[nodes]
    force = np.where(held[nodes], to_rotated_axes(pull[nodes], angle), 0.0)
    if "spring" in f["net"]:
        carried = 0.0 - read_springs(f).forces(x) if reaction is None else reaction  # feet may settle
        force = np.where(spring_axes(f)[nodes], to_rotated_axes(carried[nodes], angle), force)
    force = from_rotated_axes(force, angle)
    foundation = force if stage.unloaded else np.full_like(force, np.nan)  # snapshots store no nodal loads
    foundation = foundation if reaction is None else reaction[nodes]
    return {
        "node": f["net/node_id"][:][nodes],
        "stage": np.full(len(nodes), stage.name, object),
        **{axis: x[nodes, k] for k, axis in enumerate("xyz")},
        **{f"force_{axis}": force[:, k] for k, axis in enumerate("xyz")},
        "force": np.linalg.norm(force, axis=1),
        **{f"foundation_{axis}": foundation[:, k] for k, axis in enumerate("xyz")},
        "foundation": np.linalg.norm(foundation, axis=1),
    }


def _motion_reactions(f: h5py.File, extreme: str) -> dict[str, np.ndarray]:
    """Return the rows of the highest or lowest components in motion, with the largest magnitude."""
    nodes = np.flatnonzero(held_axes(f).any(1))
    nan, R, x = np.full(len(nodes), np.nan), f[f"envelope/reaction_{extreme}"][:][nodes], start_position(f)
    return {
        "node": f["net/node_id"][:][nodes],
        "stage": np.full(len(nodes), f"{DYNAMIC_STAGE}, {extreme}", object),
        **{axis: x[nodes, k] for k, axis in enumerate("xyz")},
        **dict.fromkeys(("force_x", "force_y", "force_z", "force"), nan),
        **{f"foundation_{axis}": R[:, k] for k, axis in enumerate("xyz")},
        "foundation": f["envelope/reaction_max"][:][nodes],
    }


def undivided_bending(f: h5py.File) -> list[str]:
    """Return a warning for each group whose moments lack those of loads between the ends of its elements.

    Loads act at nodes. A load q along an element of length l causes up to q l^2 / 8 between its ends. q is
    the smaller of the loads at both ends, each over half of the lengths of the bending bars that meet there.
    """
    node, rows, warnings = f["net/elements"][:], np.flatnonzero(is_bending(f)), []
    names, group = f["net/group_names"].asstr()[:], f["net/group"][:][rows]
    x, q = form_position(f), np.zeros(len(rows))
    along = x[node[rows, 1]] - x[node[rows, 0]]
    span = lengths(along)
    share = np.bincount(node[rows].ravel(), np.repeat(span / 2.0, 2), len(x))
    for state in equilibria(f) if len(rows) else ():
        if (reaction := state.read("reaction")) is not None:
            load = (reaction - element_pull(f, state))[node[rows]] / share[node[rows]][..., None]  # N/m
            across = np.cross(load, unit(along)[:, None])
            q = np.fmax(q, np.sqrt((across**2).sum(2)).min(1))
    missing = q * span**2 / 8.0
    part = missing / bending_strengths(f)["moment"][rows]
    for g in np.unique(group[part > LARGE_MISSING_MOMENT]):
        k = np.where(group == g, part, 0.0).argmax()
        text = messages.UNDIVIDED_BENDING(
            group=names[g],
            element=f["net/element_id"][rows[k]],
            length=span[k],
            load=q[k] / 1e3,
            moment=missing[k] / 1e3,
            share=part[k],
        )
        warnings.append(text)
    return warnings


SLIP_COLUMNS = "tension_before", "tension_after", "difference", "holds", "utilisation", "slip"
LARGE_MISSING_MOMENT = 0.05  # share of the resistance W f: netfall warns above it
FRICTION_SAFETY = 1.65  # gamma_M,fr [-], partial factor on friction; EN 1993-1-11, 6.3


def slip_point_columns(f: h5py.File) -> dict[str, np.ndarray]:
    """Return one row for each slip point of /slide and state; in motion the largest difference.

    difference : [N], tension after less before; slip : [m] of cable that has passed

    In motion the utilisation is that of clamps alone.
    """
    g, at_start = f["slide"], start_weights_of(f)
    rows = [_slips_in_state(f, state, at_start) for state in all_states(f)]
    count = len(g["node"])
    if "difference" in g:
        nan, points = np.full(count, np.nan), np.arange(count)
        difference, slip = (v[np.abs(v).argmax(0), points] for v in (g["difference"][:], g["slip"][:]))
        holds = np.where(g["friction"][:] > 0.0, nan, g["resistance"][:])
        rows.append((DYNAMIC_STAGE, nan, nan, difference, holds, _utilisation(difference, holds), slip))
    names, *columns = zip(*rows)
    return {
        "node": np.tile(g["node"][:], len(rows)),
        "cable": np.tile(g["cable"].asstr()[:].astype(object), len(rows)),
        "stage": np.repeat(np.array(names, object), count),
        **dict(zip(SLIP_COLUMNS, map(np.concatenate, columns))),
    }


def _slips_in_state(f: h5py.File, state: StateView, at_start: Any) -> tuple[Any, ...]:
    """Return the name of a state, and each of SLIP_COLUMNS (k,) in it; at_start : of `start_weights_of`."""
    g, N, slip, force = f["slide"], state.tension(), state.read("slip"), state.read("slip_force")
    weight = np.zeros(len(N)) if state.unloaded else at_start(state.place, state.position(), state.live)
    node, start = g["node"][:], f["net/node_id"][:][f["net/elements"][:, 0]]
    before, after = (
        N[rows] + np.where(start[rows] == node, weight[rows], -weight[rows])
        for rows in (g["before"][:], g["after"][:])
    )
    clamps_open = state.place and f[state.place].attrs.get("clamps") == "open"
    smaller = np.maximum(np.minimum(before, after), 0.0)
    holds = smaller * np.expm1(g["friction"][:] * _turning_angle(f, state) / FRICTION_SAFETY)
    holds = holds + (0.0 if clamps_open else g["resistance"][:])
    slip = np.full(len(holds), np.nan) if slip is None else slip
    force = after - before if force is None else force  # earlier versions do not write it
    return state.name, before, after, after - before, holds, _utilisation(force, holds), slip


def _utilisation(force: np.ndarray, holds: np.ndarray) -> np.ndarray:
    """Return the ratio (k,) of a force to its resistance; nan without a resistance."""
    return np.divide(np.abs(force), holds, out=np.full(len(holds), np.nan), where=holds > 0.0)


def _turning_angle(f: h5py.File, state: StateView) -> np.ndarray:
    """Compute the angle (k,) [rad] by which the cable turns at each slip point; 0 if a side has split off."""
    g, x = f["slide"], state.position()
    ends = f["net/elements"][:] if state.ends is None else state.ends
    row = {number: k for k, number in enumerate(f["net/node_id"][:].tolist())}
    node = np.array([row[number] for number in g["node"][:].tolist()])
    sides, connected = [], True
    for name in ("before", "after"):
        side_ends = ends[g[name][:]]
        connected = connected & (side_ends == node[:, None]).any(1)
        direction = x[np.where(side_ends[:, 0] == node, side_ends[:, 1], side_ends[:, 0])] - x[node]
        sides.append(direction / np.maximum(np.linalg.norm(direction, axis=1), 1e-300)[:, None])
    sum_length, difference_length = (np.linalg.norm(sides[0] + sign * sides[1], axis=1) for sign in (1, -1))
    return np.where(connected, 2.0 * np.arctan2(sum_length, difference_length), 0.0)
