"""The probes of a rank: histories of particles and elements that all ranks get to know."""

import numpy as np
from mpi4py import MPI

from netfall.mechanics.state import State


class LocalProbes:
    """Local rows of the probes that this rank has, each with its place among all."""

    def __init__(self, subdomain, probes):
        """probes : `history.Probes`"""
        rows = lambda numbers, sought: [
            (k, int(row)) for k, gid in enumerate(sought) for row in np.flatnonzero(numbers == gid)
        ]
        self.count = len(probes.particles), len(probes.elements)
        self.particles = rows(subdomain.particle_gid[: subdomain.n_owned], probes.particles)
        self.elements = rows(subdomain.element_gid, probes.elements)

    def values(self, comm: MPI.Comm, state: State, snapshot) -> np.ndarray:
        """Displacements (p, 3) [m] and tensions (k,) [N] in one row, the same on every rank. Collective."""
        particles, elements = self.count
        values = np.zeros(3 * particles + elements)
        for k, row in self.particles:
            values[3 * k : 3 * k + 3] = state.x[row] - state.x_start[row]
        for k, row in self.elements:
            if state.owned[row]:
                values[3 * particles + k] = snapshot.N[row]
        values += 0.0  # no negative zeros
        comm.Allreduce(MPI.IN_PLACE, values, MPI.SUM)  # one term each but for zeros, so exact
        return values
