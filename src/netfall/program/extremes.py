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


def extremes_of_motion(scene: Scene, simulation) -> Extremes:
    """Of a dynamic stage. The plastic strain of a cable only grows, so its last one counts. Collective."""
    spread, state, n = scene.distribution, simulation.state, simulation.state.n_owned
    mine, (tension, _, least, _) = state.owned.astype(bool), simulation.envelope.tension
    plastic = 0.0 if state.eps_p is None else state.eps_p
    strain = elastic_strain(tension, state.EA) + plastic
    compressed = -np.minimum(0.0, elastic_strain(least, state.EA) + plastic)
    return Extremes(
        spread.gather_elements(tension, mine),
        spread.gather_elements(strain, mine),
        spread.gather_elements(compressed, mine),
        spread.gather_particles(simulation.envelope.displacement[0][:, None]),
        spread.gather_particles((state.x_start[:n, 2] - state.x[:n, 2])[:, None]),
    )


class Watched:
    """What is largest in the equilibria that it has taken in."""

    def __init__(self, distribution: Distribution):
        self._distribution = distribution
        m, n = len(distribution.subdomain.element_gid), distribution.subdomain.n_owned
        self._tension, self._strain = np.full((2, m), np.nan)  # nothing yet
        self._compressed = np.zeros(m)
        self._moved, self._sunk = np.zeros((2, n, 1))

    def take_in(self, state: State, snapshot) -> None:
        """An equilibrium."""
        step = (state.x - state.x_start)[snapshot.rows]
        np.fmax(self._tension, snapshot.N, out=self._tension)
        np.fmax(self._strain, elastic_strain(snapshot.N, state.EA) + snapshot.eps_p, out=self._strain)
        np.fmax(self._compressed, np.where(state.EA > 0.0, -snapshot.eps, 0.0), out=self._compressed)
        np.maximum(self._moved, np.sqrt((step * step).sum(1))[:, None], out=self._moved)
        np.maximum(self._sunk, -step[:, 2:], out=self._sunk)

    def extremes(self, state: State) -> Extremes:
        """Of all equilibria so far. Collective."""
        spread, mine = self._distribution, state.owned.astype(bool)
        rows = self._tension, self._strain, self._compressed
        of_elements = (spread.gather_elements(each, mine) for each in rows)
        return Extremes(*of_elements, *(spread.gather_particles(rows) for rows in (self._moved, self._sunk)))
