"""The largest values of a run that a study keeps: over the motion, or over the equilibria without one."""

from typing import NamedTuple

import numpy as np

from netfall.mechanics.state import State
from netfall.parallel.subdomain import Distribution
from netfall.stages.scene import Scene


class Extremes(NamedTuple):
    """Of a run, on rank 0: over the rows of the history and at its end, or over all equilibria.

    tension : (m,) [N]; strain : (m,) the largest that the element bore, tension over EA and plastic strain
    compressed : (m,) the same of compression, positive; of a motion no more than at Euler's load
    displacement : (n, 1) [m]; sunk : (n, 1) [m] downwards, at the end of a motion
    """

    tension: np.ndarray
    strain: np.ndarray
    compressed: np.ndarray
    displacement: np.ndarray
    sunk: np.ndarray


def elastic_strain(N: np.ndarray, EA: np.ndarray) -> np.ndarray:
    """Of forces N (m,) [N]; 0 of what is not there any more."""
    return np.divide(N, EA, out=np.zeros(len(N)), where=EA > 0.0)


def gathered(distribution: Distribution, state: State, rows: Extremes) -> Extremes:
    """The extremes of all ranks, on rank 0; rows : of this rank, (m,) and (n_owned,). Collective."""
    mine = state.owned.astype(bool)
    of_elements = (distribution.gather_elements(each, mine) for each in rows[:3])
    return Extremes(*of_elements, *(distribution.gather_particles(each[:, None]) for each in rows[3:]))


def extremes_of_motion(scene: Scene, simulation) -> Extremes:
    """Of a dynamic stage. The plastic strain of a cable only grows, so its last one counts. Collective."""
    state, n, (tension, _, least, _) = simulation.state, simulation.state.n_owned, simulation.envelope.tension
    plastic = 0.0 if state.eps_p is None else state.eps_p
    strain = elastic_strain(tension, state.EA) + plastic
    compressed = -np.minimum(0.0, elastic_strain(least, state.EA) + plastic)
    moved, sunk = simulation.envelope.displacement[0], state.x_start[:n, 2] - state.x[:n, 2]
    return gathered(scene.distribution, state, Extremes(tension, strain, compressed, moved, sunk))


class Watched:
    """What is largest in the equilibria that it has taken in."""

    def __init__(self, distribution: Distribution):
        self._distribution = distribution
        m, n = len(distribution.subdomain.element_gid), distribution.subdomain.n_owned
        self._rows = Extremes(*np.full((2, m), np.nan), np.zeros(m), *np.zeros((2, n)))  # nan: nothing yet

    def take_in(self, state: State, snapshot) -> None:
        """An equilibrium."""
        most, step = self._rows, (state.x - state.x_start)[snapshot.rows]
        np.fmax(most.tension, snapshot.N, out=most.tension)
        np.fmax(most.strain, elastic_strain(snapshot.N, state.EA) + snapshot.eps_p, out=most.strain)
        np.fmax(most.compressed, np.where(state.EA > 0.0, -snapshot.eps, 0.0), out=most.compressed)
        np.maximum(most.displacement, np.sqrt((step * step).sum(1)), out=most.displacement)
        np.maximum(most.sunk, -step[:, 2], out=most.sunk)

    def extremes(self, state: State) -> Extremes:
        """Of all equilibria so far. Collective."""
        return gathered(self._distribution, state, self._rows)
