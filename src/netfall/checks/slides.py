"""How far clamps and saddles are used: the difference of the tensions beside one over what holds it.

    holds = resistance + t (exp(mu alpha / 1.65) - 1)     t: the smaller tension, alpha: turn of the cable

The partial factor is on friction alone (EN 1993-1-11, 6.3); the resistance of a clamp is as given (6.4).
"""

import numpy as np

from netfall.results.states import MOTION, ShownState, equilibria, final

SAFETY = 1.65  # gamma_M,fr


def slide_columns(f) -> dict[str, np.ndarray]:
    """A row for each place of /slide and state; in motion the largest difference.

    difference : [N], after less before; slip : [m] that has passed; utilisation : in motion of clamps alone
    """
    last = final(f)
    blocks = [_of_state(f, state, state.slip and state.slip()) for state in equilibria(f)]
    blocks += [_of_state(f, last, f["slide/slip"][-1])] if last else []
    if "difference" in f["slide"]:
        blocks.append(_in_motion(f["slide"]))
    places = {"node": f["slide/node"][:], "cable": f["slide/cable"].asstr()[:].astype(object)}
    columns = {name: np.tile(values, len(blocks)) for name, values in places.items()}
    return columns | {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}


def _of_state(f, state: ShownState, slip: np.ndarray | None) -> dict[str, np.ndarray]:
    g, N = f["slide"], state.tension()
    before, after = N[g["before"][:]], N[g["after"][:]]
    opened = state.place and f[state.place].attrs.get("clamps") == "open"
    less = np.maximum(np.minimum(before, after), 0.0)
    holds = less * np.expm1(g["friction"][:] * _turn(f, state) / SAFETY)
    holds = holds + (0.0 if opened else g["resistance"][:])
    slip = np.full(len(holds), np.nan) if slip is None else slip
    return _block(state.name, before, after, after - before, holds, slip)


def _in_motion(g) -> dict[str, np.ndarray]:
    """The largest differences over the rows of the history."""
    difference, nan = g["difference"][:], np.full(len(g["node"]), np.nan)
    largest = np.take_along_axis(difference, np.abs(difference).argmax(0)[None], 0)[0]
    slip = g["slip"][:]
    passed = np.take_along_axis(slip, np.abs(slip).argmax(0)[None], 0)[0]
    holds = np.where(g["friction"][:] > 0.0, nan, g["resistance"][:])
    return _block(MOTION, nan, nan, largest, holds, passed)


def _block(name: str, before, after, difference, holds, slip) -> dict[str, np.ndarray]:
    used = np.divide(np.abs(difference), holds, out=np.full(len(holds), np.nan), where=holds > 0.0)
    return {
        "stage": np.full(len(holds), name, object),
        "tension_before": before,
        "tension_after": after,
        "difference": difference,
        "holds": holds,
        "utilisation": used,
        "slip": slip,
    }


def _turn(f, state: ShownState) -> np.ndarray:
    """By what angle (k,) [rad] a state turns the cable at each place; 0 where a side has split off."""
    g, x = f["slide"], state.position()
    ends = f["net/elements"][:] if state.ends is None else state.ends
    row = {number: k for k, number in enumerate(f["net/node_id"][:].tolist())}
    node = np.array([row[number] for number in g["node"][:].tolist()])
    sides, there = [], True
    for name in ("before", "after"):
        of = ends[g[name][:]]
        there = there & (of == node[:, None]).any(1)
        along = x[np.where(of[:, 0] == node, of[:, 1], of[:, 0])] - x[node]
        sides.append(along / np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None])
    total, apart = (np.linalg.norm(sides[0] + sign * sides[1], axis=1) for sign in (1, -1))
    return np.where(there, 2.0 * np.arctan2(total, apart), 0.0)
