"""Loss of members: elements that leave the net at a given time, whatever their strain.

An element's stiffness is gone from a step on; its mass stays with its ends. What is stored in it counts as
dissipated, as where one is taken out at a fracture (`fracture.take_out`). Particles that held nothing but
lost elements, and carry nothing, leave with them: they stand still where they were, without mass and load.
Their kinetic energy counts as negative external work, as that of cladding that tears off.
"""

import numpy as np

from netfall.mechanics.fracture import dissipate
from netfall.mechanics.state import State


def lose_elements(state: State, elements: np.ndarray, dt: float) -> None:
    """Take elements, local rows (k,), out of the net; `plan.Plan.attach` is due after it. dt : [s], of a step

    Every rank that holds one decides alike.
    """
    for e in elements.tolist():
        if state.EA[e] > 0.0:  # else another rank has kept it when it broke, or it had been taken out
            dissipate(state, e, dt)
            _let_go(state, e)
        state.EA[e], state.lost[e], state.broken[e] = 0.0, 1, 1
        if state.eps_u is not None:
            state.eps_u[e] = np.inf


def leave(state: State, particles: np.ndarray) -> None:
    """Particles, local rows (k,), leave the net."""
    for p in particles.tolist():
        if state.work is not None and state.own(p):
            state.work[p, 0] -= 0.5 * state.mass[p] * float(np.sum(state.v[p].astype(float) ** 2))
        state.mass[p] = 0.0
        state.v[p] = state.load[p] = 0.0
        if state.wind is not None:
            state.wind[p] = 0.0


def _let_go(state: State, e: int) -> None:
    """The ends of element e hold it no more; those that split off from the net with it leave."""
    for p in state.ends[e].tolist():
        if state.valence is not None:
            state.valence[p] -= 1
        if p >= state.first_split:
            leave(state, np.array([p]))
