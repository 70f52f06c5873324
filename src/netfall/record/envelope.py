"""The envelope of a dynamic stage: largest and smallest values over all rows of the history, and when.

Each rank keeps those of its own particles and elements, from what the audit of a row computes anyway.
"""

import math

import numpy as np

from netfall.ground.compile import kernel
from netfall.parallel.subdomain import Distribution

TENSION = ("tension_max", "tension_max_time", "tension_min", "slack_time")  # (m,), of elements
DISPLACEMENT = ("displacement_max", "displacement_max_time")  # (n,), of particles of the net


@kernel
def widen(time, since, N, bar, broken, x, x_start, tension, displacement):
    """Take in the axial forces N (m,) [N] and positions x (n, 3) [m] of a row of the history.

    time : [s]; since : [s] from the row before; bar, broken : (m,) of `Elements`; x_start : (n, 3) [m]
    tension : (4, m), rows as TENSION; displacement : (2, n_owned), rows as DISPLACEMENT; both out
    """
    for e in range(N.shape[0]):
        if N[e] > tension[0, e]:
            tension[0, e], tension[1, e] = N[e], time
        tension[2, e] = min(tension[2, e], N[e])
        if N[e] == 0.0 and bar[e] == 0 and broken[e] == 0:
            tension[3, e] += since
    for p in range(displacement.shape[1]):
        dx, dy, dz = x[p, 0] - x_start[p, 0], x[p, 1] - x_start[p, 1], x[p, 2] - x_start[p, 2]
        u = math.sqrt(dx * dx + dy * dy + dz * dz)
        if u > displacement[0, p]:
            displacement[0, p], displacement[1, p] = u, time


class Envelope:
    """Of one rank. tension : (4, m); displacement : (2, n_owned); rows as in TENSION and DISPLACEMENT."""

    def __init__(self, distribution: Distribution):
        self.distribution = distribution
        subdomain = distribution.subdomain
        self.tension = np.zeros((len(TENSION), len(subdomain.element_gid)))
        self.tension[0], self.tension[2] = -np.inf, np.inf
        self.displacement = np.zeros((len(DISPLACEMENT), subdomain.n_owned))
        self.displacement[0] = -1.0

    def add(self, time: float, since: float, state, snapshot) -> None:
        """Take in a row of the history, at a time [s], `since` [s] after the one before."""
        arrays = state.bar, state.broken, state.x, state.x_start, self.tension, self.displacement
        widen(time, since, snapshot.N, *arrays)

    def columns(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Of elements (m,) and of particles (n_owned,), by name."""
        return dict(zip(TENSION, self.tension)), dict(zip(DISPLACEMENT, self.displacement))

    def record(self, state) -> tuple[dict, dict[str, np.ndarray]]:
        """What a continuation needs, by global numbers on rank 0, for `restore`. Collective."""
        mine = state.owned.astype(bool)
        tension = self.distribution.gather_elements(self.tension.T, mine)
        displacement = self.distribution.gather_particles(self.displacement.T)
        return {}, {} if tension is None else {"tension": tension, "displacement": displacement}

    def restore(self, _: dict, arrays: dict[str, np.ndarray] | None) -> None:
        """Take up the record of an earlier run. arrays : on rank 0. Collective."""
        spread, n_owned = self.distribution, self.displacement.shape[1]
        rows = lambda name: arrays and arrays[name]
        self.tension[:] = spread.elements(rows("tension")).T
        self.displacement[:] = spread.particles(rows("displacement"))[:n_owned].T
