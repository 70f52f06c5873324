"""What the supports of a net in equilibrium hand on to the foundation."""

import numpy as np

from netfall.mechanics.state import State
from netfall.mechanics.supports import spring_forces
from netfall.record.energy import Snapshot


def forces_on_supports(state: State, snapshot: Snapshot, load: np.ndarray) -> np.ndarray:
    """Forces (r, 3) [N] on what holds the owned particles: of the elements, and what acts on the node itself.

    load : (n, 3) [N]. Along an axis with a spring what the spring carries, which in equilibrium is the same;
    0 along an axis that nothing holds.
    """
    rows = snapshot.rows
    held = state.free[rows] == 0
    force = np.where(held, snapshot.room.f_int[rows] + load[rows], 0.0)
    if state.features.springs:
        force -= spring_forces(
            *(array[rows] for array in (state.x, state.x_start, state.spring, state.spring_rest))
        )
    return force
