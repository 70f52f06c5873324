"""Cladding that tears off: where an element breaks, the panels that hang on it leave the roof as a whole.

At the corners of such a panel go, in the step of the fracture, its share of the wind, of the pressure, and of
the mass of dead load and snow with its weight. As much mass stays as the step asks for, sum(k) dt^2 / 2 of
what is left there, as with fragments (`stability.fragment_mass`). What leaves takes its kinetic energy along,
which counts as negative external work, so that both audits hold.
"""

import numpy as np
from mpi4py import MPI

from netfall.mechanics.material import largest_stiffness
from netfall.mechanics.state import State
from netfall.net.net import GRAVITY
from netfall.parallel.subdomain import Distribution


class Tearing:
    """The panels that are still there, and what goes with one; the same on all ranks."""

    def __init__(self, comm: MPI.Comm, distribution: Distribution, model, broken, stable_dt: float):
        """model : on rank 0; broken : elements so far, of a run that is taken up. Collective.

        stable_dt : [s], for which particles are to stay stable
        """
        self.stable_dt = stable_dt
        self.panels = comm.bcast(model.panels if model else None)
        subdomain = distribution.subdomain
        owned = subdomain.particle_gid[: subdomain.n_owned]
        local = np.full(distribution.n, -1)
        local[owned] = np.arange(len(owned))
        self.row = local[self.panels.node]  # of each corner; -1: another rank's
        self.torn = np.zeros(self.panels.count, bool)
        self.torn[self.panels.at(list(broken))] = True

    def tear(self, state: State, elements) -> None:
        """Take the panels at some elements, global numbers, off the particles of this rank."""
        panels = self.panels.at(list(elements))
        panels = panels[~self.torn[panels]]
        self.torn[panels] = True
        corners = np.flatnonzero(np.isin(self.panels.of_corner, panels) & (self.row >= 0))
        own, stiffness = (
            np.bincount(
                state.ends.ravel(), np.repeat(np.where(state.EA > 0.0, values, 0.0), 2), state.n_local
            )
            for values in (state.half_mass, largest_stiffness(state.EA, state.L0))
        )
        least = np.maximum(own, 0.5 * self.stable_dt**2 * stiffness)
        for corner in corners.tolist():
            p = self.row[corner]
            mass = min(self.panels.mass[corner], max(0.0, state.mass[p] - least[p]))
            if state.work is not None:
                state.work[p, 0] -= 0.5 * mass * float(np.sum(state.v[p].astype(float) ** 2))
            state.mass[p] -= mass
            state.load[p] -= self.panels.pressure[corner]
            state.load[p, 2] += GRAVITY * mass
            if state.wind is not None:
                state.wind[p] -= self.panels.wind[corner]
