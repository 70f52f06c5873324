"""Largest values of a run for a study: over the dynamic stage, or over the equilibria without one."""

from typing import NamedTuple

import numpy as np

from netfall.driver.dynamics import Simulation
from netfall.driver.problem import Problem
from netfall.explicit.energy import Snapshot
from netfall.parallel.subdomain import Distribution
from netfall.physics.state import State


class Extremes(NamedTuple):
    """Largest values of a run, on rank 0: over the history rows and at the end, or over all equilibria.

    tension : (m,) [N]; strain : (m,) the largest strain in tension, force over EA plus plastic strain
    compressed : (m,) the largest shortening, positive; in the dynamic stage at most that at the Euler load
    displacement : (n, 1) [m]; sunk : (n, 1) [m] downwards, at the end of the dynamic stage
    """

    tension: np.ndarray
    strain: np.ndarray
    compressed: np.ndarray
    displacement: np.ndarray
    sunk: np.ndarray


def elastic_strain(N: np.ndarray, EA: np.ndarray) -> np.ndarray:
    """Compute the elastic strain of forces N (m,) [N]; 0 for removed elements."""
    return np.divide(N, EA, out=np.zeros(len(N)), where=EA > 0.0)


def gather_extremes(distribution: Distribution, state: State, rows: Extremes) -> Extremes | None:
    """Gather the extremes of all ranks on rank 0; rows : of this rank, (m,) and (n_owned,). Collective."""
    owned = state.owned.astype(bool)
    of_elements = [distribution.gather_elements(values, owned) for values in rows[:3]]
    of_particles = [distribution.gather_particles(values[:, None]) for values in rows[3:]]
    gathered = [values for values in of_elements + of_particles if values is not None]
    return Extremes(*gathered) if gathered else None


def extremes_of_motion(problem: Problem, simulation: Simulation) -> Extremes | None:
    """Return the extremes of a dynamic stage. Collective.

    The plastic strain of a cable never decreases, so that the last value is the largest.
    """
    state, n, (tension, _, least, _) = simulation.state, simulation.state.n_owned, simulation.envelope.tension
    plastic = 0.0 if state.eps_p is None else state.eps_p
    strain = elastic_strain(tension, state.EA) + plastic
    compressed = -np.minimum(0.0, elastic_strain(least, state.EA) + plastic)
    displacement, sunk = simulation.envelope.displacement[0], state.x_start[:n, 2] - state.x[:n, 2]
    return gather_extremes(
        problem.distribution, state, Extremes(tension, strain, compressed, displacement, sunk)
    )


class EquilibriumExtremes:
    """Accumulates the largest values over equilibria."""

    def __init__(self, distribution: Distribution):
        self._distribution = distribution
        m, n = len(distribution.subdomain.element_gid), distribution.subdomain.n_owned
        self._rows = Extremes(
            tension=np.full(m, np.nan),  # nan: no equilibrium yet
            strain=np.full(m, np.nan),
            compressed=np.zeros(m),
            displacement=np.zeros(n),
            sunk=np.zeros(n),
        )

    def take_in(self, state: State, snapshot: Snapshot) -> None:
        """Include an equilibrium."""
        largest, displacement = self._rows, (state.x - state.x_start)[snapshot.rows]
        np.fmax(largest.tension, snapshot.N, out=largest.tension)
        np.fmax(largest.strain, elastic_strain(snapshot.N, state.EA) + snapshot.eps_p, out=largest.strain)
        np.fmax(largest.compressed, np.where(state.EA > 0.0, -snapshot.eps, 0.0), out=largest.compressed)
        np.maximum(
            largest.displacement, np.sqrt((displacement * displacement).sum(1)), out=largest.displacement
        )
        np.maximum(largest.sunk, -displacement[:, 2], out=largest.sunk)

    def extremes(self, state: State) -> Extremes | None:
        """Return the extremes over all equilibria so far. Collective."""
        return gather_extremes(self._distribution, state, self._rows)
