"""What the supports of a net in equilibrium hand on to the foundation."""

import numpy as np

from netfall.mechanics.state import State
from netfall.mechanics.supports import keep_on_guides, spring_forces
from netfall.record.energy import Snapshot


def forces_on_supports(state: State, snapshot: Snapshot, load: np.ndarray) -> np.ndarray:
    """Forces (r, 3) [N] on what holds the owned particles: of the elements, and what acts on the node itself.

    load : (n, 3) [N]. Along an axis with a spring what the spring carries, which in equilibrium is the same;
    0 along an axis that nothing holds.
    """
    rows = snapshot.rows
    total = snapshot.room.f_int[rows] + load[rows]
    force = np.where(state.free[rows] == 0, total, 0.0)
    turned = None if state.turned is None else state.turned[rows]
    if state.features.springs:
        springs = state.x, state.x_start, state.spring, state.spring_rest
        force -= spring_forces(*(array[rows] for array in springs), turned)
    if turned is not None:
        left = total.copy()
        keep_on_guides(turned, left)
        force[:, :2] += (total - left)[:, :2]
    return force
