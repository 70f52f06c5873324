"""Cladding that tears off: where an element breaks, the panels that hang on it leave the roof as a whole.

At the corners of such a panel go, in the step of the fracture, its share of the wind, of the pressure, and of
the mass of dead load and snow with its weight. As much mass stays as the step asks for, sum(k) dt^2 / 2 of
what is left there, as with fragments (`stability.fragment_mass`). What leaves takes its kinetic energy along,
which counts as negative external work, so that both audits hold.
"""

from typing import NamedTuple

import numpy as np

from netfall.mechanics.air import take_air
from netfall.mechanics.law.measures import largest_stiffness
from netfall.mechanics.state import State
from netfall.model.redistribution import Redistribution
from netfall.net.net import GRAVITY
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution, rows_of


class Corners(NamedTuple):
    """What corners of panels carry, as in `roof.panels.Panels`: panel, node (c,), then a row for each."""

    panel: np.ndarray
    node: np.ndarray
    mass: np.ndarray
    pressure: np.ndarray
    wind: np.ndarray
    air: np.ndarray
    air_mass: np.ndarray

    def at(self, rows) -> "Corners":
        """Some of them."""
        return Corners(*(column[rows] for column in self))

    def passed(self, taker: int, share: float) -> "Corners":
        """A share of them, at another node."""
        node = np.full(len(self.node), taker)
        return Corners(self.panel, node, *(share * carried for carried in self[2:]))


class Tearing:
    """The panels that are still there, and what goes with one; the same on all ranks."""

    def __init__(self, comm: MPI.Comm, distribution: Distribution, model, broken, stable_dt: float):
        """model : on rank 0; broken : elements so far, of a run that is taken up. Collective.

        stable_dt : [s], for which particles are to stay stable
        """
        self.stable_dt = stable_dt
        self.panels = comm.bcast(model.panels if model else None)
        self.distribution = distribution
        self.owned = distribution.subdomain.particle_gid[: distribution.subdomain.n_owned]
        panels, row = self.panels, rows_of(self.owned, self.panels.node)
        here = row >= 0
        columns = (panels.of_corner, *(getattr(panels, name) for name in Corners._fields[1:]))
        self.corners, self.row = Corners(*(column[here] for column in columns)), row[here]
        self.torn = np.zeros(self.panels.count, bool)
        self.torn[self.panels.at(broken)] = True

    def tear(self, state: State, elements) -> None:
        """Take the panels at some elements, global numbers, off the particles of this rank."""
        panels = self.panels.at(elements)
        panels = panels[~self.torn[panels]]
        self.torn[panels] = True
        corners = np.flatnonzero(np.isin(self.corners.panel, panels))
        there, ends = state.EA > 0.0, state.ends.ravel()
        at_nodes = lambda of: np.bincount(ends, np.repeat(np.where(there, of, 0.0), 2), state.n_local)
        own, stiffness = at_nodes(state.half_mass), at_nodes(largest_stiffness(state.EA, state.L0))
        least = np.maximum(own, 0.5 * self.stable_dt**2 * stiffness)
        for corner in corners.tolist():
            p, of = self.row[corner], self.corners.at(corner)
            take_air(state, p, of.air, of.air_mass)
            mass = min(of.mass, max(0.0, state.mass[p] - least[p]))
            if state.work is not None:
                state.work[p, 0] -= 0.5 * mass * float(np.sum(state.v[p] ** 2))
            state.mass[p] -= mass
            state.load[p] -= of.pressure
            state.load[p, 2] += GRAVITY * mass
            if state.wind is not None:
                state.wind[p] -= of.wind

    def hand_over(self, handed: Redistribution) -> None:
        """What corners that leave carry of each panel goes to others. Collective."""
        leaving = np.isin(self.corners.node, handed.particles)
        parts = self.distribution.comm.allgather(self.corners.at(leaving))
        every = Corners(*(np.concatenate(columns) for columns in zip(*parts)))
        order = np.argsort(every.node, kind="stable")  # those of one node are on one rank, in one order
        found = [self.corners.at(~leaving)]
        for source, taker, share in zip(handed.source, handed.taker, handed.share):
            corners = every.at(order[every.node[order] == handed.particles[source]])
            if taker in self.owned:
                found.append(corners.passed(taker, share))
        self.corners = Corners(*(np.concatenate(columns) for columns in zip(*found)))
        self.row = rows_of(self.owned, self.corners.node)
