"""With what forces the elements pull at the supports, in each stage."""

import numpy as np

from netfall.output.report_stages import Stage, equilibria, final


def held_axes(f) -> np.ndarray:
    """(n, 3) bool, axes with a support of either kind."""
    held = f["net/fixed"][:].astype(bool)
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
    """A row for each support and stage: the force [N] with which elements pull at it along its held axes.

    Nothing else is in them: what acts on the node itself goes into the support besides.
    """
    held, elements = held_axes(f), f["net/elements"][:]
    nodes = np.flatnonzero(held.any(1))
    blocks = [_of_stage(f, stage, held, nodes, elements) for stage in _stages(f)]
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}


def _stages(f):
    yield from equilibria(f)
    last = final(f)
    if last:
        yield last


def _of_stage(f, stage: Stage, held, nodes, elements) -> dict[str, np.ndarray]:
    x = stage.position()
    pull = pull_at(x, elements if stage.ends is None else stage.ends, stage.tension())
    at = nodes if stage.ends is None else _rows_of_nodes(f, nodes)
    force = np.where(held[nodes], pull[at], 0.0)
    return {
        "node": f["net/node_id"][:][nodes],
        "stage": np.full(len(nodes), stage.name, object),
        **{axis: x[at, k] for k, axis in enumerate("xyz")},
        **{f"force_{axis}": force[:, k] for k, axis in enumerate("xyz")},
        "force": np.linalg.norm(force, axis=1),
    }


def _rows_of_nodes(f, nodes: np.ndarray) -> np.ndarray:
    """Rows of /final at which nodes are."""
    number = f["final/particle_id"][:]
    order = np.argsort(number, kind="stable")
    return order[np.searchsorted(number[order], nodes)]
