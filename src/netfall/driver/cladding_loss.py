"""Cladding that tears off: when an element breaks, its panels leave the roof as a whole.

At the step of the fracture the corners of such a panel lose its share of the wind and of the pressure. They
also lose its share of the mass of dead load and snow, with its weight. At least the mass that the step needs
remains: sum(k) dt^2 / 2 of the remaining elements, as for fragments (`stability.fragment_mass`). The kinetic
energy of the lost mass counts as negative external work, so both energy checks hold.
"""

from typing import NamedTuple

import numpy as np

from netfall.geometry.net import GRAVITY
from netfall.loads.removal import Redistribution
from netfall.model.model import Model
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution, rows_of
from netfall.physics.air import subtract_air
from netfall.physics.law.measures import largest_stiffness
from netfall.physics.state import State


class Corners(NamedTuple):
    """Loads and masses of corners of panels, with the columns of `geometry.shares.Panels`.

    panel, node : (c,); the others: a row for each corner
    """

    panel: np.ndarray
    node: np.ndarray
    mass: np.ndarray
    pressure: np.ndarray
    wind: np.ndarray
    air: np.ndarray
    air_mass: np.ndarray

    def at(self, rows: np.ndarray | int) -> "Corners":
        """Return the corners of some rows."""
        return Corners(*(column[rows] for column in self))

    def passed(self, taker: int, share: float) -> "Corners":
        """Return a share of the corners, moved to another node."""
        node = np.full(len(self.node), taker)
        return Corners(self.panel, node, *(share * carried for carried in self[2:]))


class PanelTearing:
    """Panels that are still on the roof, and what leaves with one; the same on all ranks."""

    def __init__(
        self,
        comm: MPI.Comm,
        distribution: Distribution,
        model: Model | None,
        broken: np.ndarray,
        stable_dt: float,
    ):
        """model : on rank 0; broken : elements so far, in a resumed run. Collective.

        stable_dt : [s], for which particles must stay stable
        """
        self.stable_dt = stable_dt
        self.panels = comm.bcast(model.panels if model else None)
        self.distribution = distribution
        self.owned = distribution.subdomain.particle_gid[: distribution.subdomain.n_owned]
        panels, row = self.panels, rows_of(self.owned, self.panels.node)
        is_local = row >= 0
        columns = (panels.of_corner, *(getattr(panels, name) for name in Corners._fields[1:]))
        self.corners, self.row = Corners(*(column[is_local] for column in columns)), row[is_local]
        self.torn = np.zeros(self.panels.count, bool)
        self.torn[self.panels.at(broken)] = True

    def remove_from(self, state: State, elements: np.ndarray) -> None:
        """Remove the panels at some elements, global numbers, from the particles of this rank."""
        panels = self.panels.at(elements)
        panels = panels[~self.torn[panels]]
        self.torn[panels] = True
        corners = np.flatnonzero(np.isin(self.corners.panel, panels))
        carries, ends = state.EA > 0.0, state.ends.ravel()

        def at_nodes(values: np.ndarray) -> np.ndarray:
            return np.bincount(ends, np.repeat(np.where(carries, values, 0.0), 2), state.n_local)

        own_mass, stiffness = at_nodes(state.half_mass), at_nodes(largest_stiffness(state.EA, state.L0))
        least_mass = np.maximum(own_mass, 0.5 * self.stable_dt**2 * stiffness)
        for index in corners.tolist():
            p, corner_loads = self.row[index], self.corners.at(index)
            subtract_air(state, p, corner_loads.air, float(corner_loads.air_mass))
            mass = min(corner_loads.mass, max(0.0, state.mass[p] - least_mass[p]))
            if state.work is not None:
                state.work[p, 0] -= 0.5 * mass * float(np.sum(state.v[p] ** 2))
            state.mass[p] -= mass
            state.load[p] -= corner_loads.pressure
            state.load[p, 2] += GRAVITY * mass
            if state.wind is not None:
                state.wind[p] -= corner_loads.wind

    def redistribute(self, redistribution: Redistribution) -> None:
        """Move the loads of leaving corners to other nodes. Collective."""
        leaving = np.isin(self.corners.node, redistribution.particles)
        gathered = self.distribution.comm.allgather(self.corners.at(leaving))
        all_leaving = Corners(*(np.concatenate(columns) for columns in zip(*gathered)))
        # corners of one node are on one rank, in fixed order
        order = np.argsort(all_leaving.node, kind="stable")
        kept_corners = [self.corners.at(~leaving)]
        for source, taker, share in zip(redistribution.source, redistribution.taker, redistribution.share):
            corners = all_leaving.at(order[all_leaving.node[order] == redistribution.particles[source]])
            if taker in self.owned:
                kept_corners.append(corners.passed(taker, share))
        self.corners = Corners(*(np.concatenate(columns) for columns in zip(*kept_corners)))
        self.row = rows_of(self.owned, self.corners.node)
