"""What an equilibrium leaves in a state: taken, put back, carried on."""

import numpy as np

from netfall.mechanics.state import State

COMMITTED = ("x", "eps_p", "dissipated")


def committed(state: State) -> dict[str, np.ndarray]:
    """Copies of what an equilibrium leaves in the state, for `put_back`."""
    there = ((name, getattr(state, name)) for name in COMMITTED)
    return {name: array.copy(order="K") for name, array in there if array is not None}


def put_back(state: State, kept: dict[str, np.ndarray]) -> None:
    """The state as it was when `committed` was called."""
    for name, array in kept.items():
        getattr(state, name)[:] = array


def carried_on(state: State, base: dict[str, np.ndarray], times: float) -> np.ndarray:
    """Positions (n, 3) [m] as many times as far from those of `base`, as of `committed`, as now."""
    return base["x"] + times * (state.x - base["x"])
