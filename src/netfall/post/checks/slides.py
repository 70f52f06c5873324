"""Utilisation of clamps and saddles: the difference of the adjoining tensions over the slip resistance.

holds = resistance + t (exp(mu alpha / 1.65) - 1)     t: the smaller tension, alpha: turn of the cable

The partial factor applies to friction alone (EN 1993-1-11, 6.3); the resistance of a clamp is as given (6.4).
"""

import h5py
import numpy as np

from netfall.results.states import DYNAMIC_STAGE, StateView, equilibria, final

FRICTION_SAFETY = 1.65  # gamma_M,fr [-], partial factor on friction; EN 1993-1-11, 6.3


def slip_point_columns(f: h5py.File) -> dict[str, np.ndarray]:
    """Return one row for each slip point of /slide and state; in motion the largest difference.

    difference : [N], tension after less before; slip : [m] of cable that has passed

    In motion the utilisation is that of clamps alone.
    """
    final_state = final(f)
    blocks = [_state_rows(f, state, state.slip and state.slip()) for state in equilibria(f)]
    blocks += [_state_rows(f, final_state, f["slide/slip"][-1])] if final_state else []
    if "difference" in (g := f["slide"]):
        nan, points = np.full(len(g["node"]), np.nan), np.arange(len(g["node"]))
        difference, slip = (v[np.abs(v).argmax(0), points] for v in (g["difference"][:], g["slip"][:]))
        holds = np.where(g["friction"][:] > 0.0, nan, g["resistance"][:])
        blocks.append(_slip_rows(DYNAMIC_STAGE, nan, nan, difference, holds, slip))
    points = {"node": f["slide/node"][:], "cable": f["slide/cable"].asstr()[:].astype(object)}
    columns = {name: np.tile(values, len(blocks)) for name, values in points.items()}
    return columns | {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}


def _state_rows(f: h5py.File, state: StateView, slip: np.ndarray | None) -> dict[str, np.ndarray]:
    """Return the rows of a state; slip : (k,) [m], None: unknown."""
    g, N = f["slide"], state.tension()
    before, after = N[g["before"][:]], N[g["after"][:]]
    clamps_open = state.place and f[state.place].attrs.get("clamps") == "open"
    smaller = np.maximum(np.minimum(before, after), 0.0)
    holds = smaller * np.expm1(g["friction"][:] * _turning_angle(f, state) / FRICTION_SAFETY)
    holds = holds + (0.0 if clamps_open else g["resistance"][:])
    slip = np.full(len(holds), np.nan) if slip is None else slip
    return _slip_rows(state.name, before, after, after - before, holds, slip)


def _slip_rows(
    name: str,
    before: np.ndarray,
    after: np.ndarray,
    difference: np.ndarray,
    holds: np.ndarray,
    slip: np.ndarray,
) -> dict[str, np.ndarray]:
    """Return the rows of all slip points in one state; all arrays (k,)."""
    utilisation = np.divide(np.abs(difference), holds, out=np.full(len(holds), np.nan), where=holds > 0.0)
    return {
        "stage": np.full(len(holds), name, object),
        "tension_before": before,
        "tension_after": after,
        "difference": difference,
        "holds": holds,
        "utilisation": utilisation,
        "slip": slip,
    }


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
