"""Detached parts of the net in motion, the velocity of their centres of mass, and cladding that tears off.

A part is detached if no path of unbroken elements leads from it to a vertical support. A horizontal guide
does not count: in a plane net, or on a plane of symmetry, each part has one. If the net has no vertical
support, any support counts. The connectivity is evaluated at fixed simulated times, `EVALUATION_INTERVAL`
seconds apart, if an element has broken or was removed since the last evaluation. The result therefore does
not depend on ranks, rows, snapshots or restarts. With [wind] after_fracture = "detached" the wind pressure on
such a part then ends, and the drag of the relative wind acts on it (`physics.air`).

When an element breaks, its panels leave the roof as a whole. At the step of the fracture the corners of such
a panel lose its share of the wind and of the pressure. They also lose its share of the mass of dead load and
snow, with its weight. At least the mass that the time step needs remains: sum(k) dt^2 / 2 of the remaining
elements, as for fragments (`stability.fragment_mass`). The kinetic energy of the lost mass counts as negative
external work, so both energy checks hold.
"""

from typing import Any, NamedTuple

import numpy as np

from netfall.core.arrays import rows_of
from netfall.driver.dynamics.varying_loads import WindLoad
from netfall.driver.problem import Problem
from netfall.geometry.net import GRAVITY, connected_parts, part_is_supported
from netfall.loads.removal import Redistribution
from netfall.loads.wind.field import particle_speeds
from netfall.model.model import Model
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.parallel.sums import exact_sums
from netfall.physics.air import remove_wind, subtract_air
from netfall.physics.law.measures import largest_stiffness
from netfall.physics.state import State

EVALUATION_INTERVAL = 0.01  # s between evaluations
MIN_MASS = 0.01  # share of the mass that can move [-]: larger parts are followed
ATTACHED = -1  # value in place of a part; 0: a detached part that is not followed; k: the k-th one that is


class DetachedParts:
    """Detached parts of a run; the data of followed parts are the same on all ranks.

    part : (owned and halo,) of each particle, see `ATTACHED`
    evaluated : step of the last evaluation; broken : fractures and removals by then, -1: not known
    """

    def __init__(self, problem: Problem):
        """Collective."""
        job, model = problem.job, problem.model
        self.comm, self.distribution, self.model = problem.comm, problem.distribution, model
        self.dt, self.step_at = problem.dynamic_schedule.dt, problem.dynamic_schedule.step_at
        self.ends_wind = job.wind is not None and job.wind.after_fracture == "detached"
        self.least_mass = problem.comm.bcast(
            model and MIN_MASS * float(model.own_mass[model.net.moves].sum())
        )
        self.part = np.full(problem.state.first_split, ATTACHED)
        self.followed = np.zeros(0, np.int64)  # the lowest particle of each followed part
        self.evaluated, self.broken = -1, 0
        # time, lowest particle, mass, velocity of each, at each evaluation
        self.rows: list[tuple[Any, ...]] = []

    def next_evaluation_step(self, step: int) -> int:
        """Return the first step, from this step on, at which the parts are evaluated again."""
        k = max(0, int(step * self.dt / EVALUATION_INTERVAL) - 1)
        while (next_step := self.step_at(k * EVALUATION_INTERVAL)) < step or next_step <= self.evaluated:
            k += 1
        return next_step

    def has_changed(self, count: int) -> bool:
        """Return whether the number of fractures and removals differs from that of the last evaluation."""
        before, self.broken = self.broken, count
        return count != before

    @property
    def follows_any(self) -> bool:
        """Whether any part is followed."""
        return len(self.followed) > 0

    def arrays_read(self, state: State) -> list[np.ndarray]:
        """Return the arrays of a state that `find_parts` and `record_parts` read."""
        particles = state.particles
        arrays = particles.mass, particles.air_mass, particles.v, particles.detached
        return [*arrays, state.slots.other, state.elements.broken]

    def find_parts(self, state: State) -> bool:
        """Find the detached parts; return whether the state does not mark them yet. Collective."""
        parts = self._parts(state)
        self.part = self.distribution.particles(parts and parts[0])
        self.followed = self.comm.bcast(parts and parts[1])
        differs = bool((self._marks(state) != state.detached[: state.n_local]).any())
        return self.comm.allreduce(differs, MPI.LOR)

    def _marks(self, state: State) -> np.ndarray:
        """Return whether each particle (n_local,) is in a detached part."""
        return np.concatenate([self.part, self._part_of_splits(state)]) != ATTACHED

    def update_state(self, state: State) -> bool:
        """Mark the detached parts in the state; return whether the wind on new parts ended. Collective."""
        marks, first = self._marks(state), state.first_split
        new = np.flatnonzero(marks[:first] & (state.detached[:first] == 0))
        state.detached[: state.n_local] = marks
        if self.ends_wind and len(new):
            remove_wind(state, new)
        return self.ends_wind and len(new) > 0

    def _parts(self, state: State) -> tuple[np.ndarray, np.ndarray] | None:
        """Return each particle's part, and the lowest particle of followed parts, on rank 0. Collective."""
        distribution = self.distribution
        broken = distribution.gather_elements(state.broken, state.owned.astype(bool))
        mass = distribution.gather_particles(state.mass - (0.0 if state.air_mass is None else state.air_mass))
        if self.model is None or mass is None:
            return None
        net = self.model.net
        label = connected_parts(net.elements[broken == 0], net.n)
        supported = part_is_supported(net, label)
        part_mass = np.bincount(label, mass, net.n)
        large = np.flatnonzero(~supported & (part_mass > self.least_mass))
        number = np.zeros(net.n, np.int64)
        number[large] = 1 + np.arange(len(large))
        return np.where(supported, ATTACHED, number[label]), large

    def _part_of_splits(self, state: State) -> np.ndarray:
        """Return the part of each split-off particle, which is the part of its element's far end."""
        far_end = state.other[0, state.first_split : state.n_local].astype(np.int64)
        in_net = far_end < state.first_split  # otherwise the element has broken at both ends
        return np.where(in_net, self.part[np.where(in_net, far_end, 0)], 0)

    def record_parts(self, state: State, step: int) -> None:
        """Record mass and velocity of the followed parts at a step, the last evaluation. Collective."""
        self.evaluated = step
        if not self.follows_any:
            return
        rows = state.owned_rows()
        part = np.concatenate([self.part[: state.n_owned], self._part_of_splits(state)])
        for k, lowest in enumerate(self.followed.tolist(), 1):
            part_rows = rows[part == k]
            mass = state.mass[part_rows]
            total, *momentum = exact_sums(self.comm, mass, *(mass * state.v[part_rows].T))
            self.rows.append((step * self.dt, lowest, total, *(component / total for component in momentum)))

    def record(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return the record that `restore` needs."""
        return {"evaluated": self.evaluated, "broken": self.broken}, {"rows": np.reshape(self.rows, (-1, 6))}

    def restore(self, small: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        """Restore the record of an earlier run; the parts are evaluated again when due."""
        self.evaluated = small["evaluated"]
        self.broken = -1 if small["broken"] else 0
        self.rows = [tuple(row) for row in arrays["rows"].tolist()]

    def columns(self, wind: WindLoad | None) -> dict[str, np.ndarray]:
        """Return the datasets of /detached on rank 0, {} if no part was followed; wind : or None"""
        if not self.rows or self.model is None:
            return {}
        rows = np.array(self.rows)
        time, mass, velocity = rows[:, 0], rows[:, 2], rows[:, 3:]
        node_id = self.model.net.node_id[rows[:, 1].astype(np.int64)]
        gust = np.array(largest_gust(self.model, wind, time[-1]) if wind else np.nan)
        return {"time": time, "node_id": node_id, "mass": mass, "velocity": velocity, "largest_gust": gust}


def largest_gust(model: Model, wind: WindLoad, time: float) -> float:
    """Return the largest wind speed [m/s] at any node up to a time [s]; nan: only pressures are known."""
    field = model.wind_field
    if field is None or field.tapped:
        return float(model.drag.speed.max()) if model.drag else np.nan
    speed, largest = np.empty(len(field.mean)), 0.0
    for gust in wind.record_until(time)[1]:
        particle_speeds(field.mean, field.corner, field.weight, gust, speed)
        largest = max(largest, float(np.abs(speed).max()))
    return largest


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

    def moved_to(self, receiver: int, share: float) -> "Corners":
        """Return a share of the corners, moved to another node."""
        node = np.full(len(self.node), receiver)
        return Corners(self.panel, node, *(share * carried for carried in self[2:]))


class PanelTearing:
    """Panels still on the roof, with the loads and masses of their corners; the same on all ranks."""

    def __init__(self, distribution: Distribution, model: Model | None, broken: np.ndarray, stable_dt: float):
        """model : on rank 0; broken : elements broken so far, in a resumed run. Collective.

        stable_dt : [s], step for which particles must stay stable
        """
        self.stable_dt = stable_dt
        self.panels = distribution.comm.bcast(model.panels if model else None)
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
        # all corners of a node are on one rank, in fixed order
        order = np.argsort(all_leaving.node, kind="stable")
        kept_corners = [self.corners.at(~leaving)]
        for source, receiver, share in zip(
            redistribution.source, redistribution.receiver, redistribution.share
        ):
            corners = all_leaving.at(order[all_leaving.node[order] == redistribution.particles[source]])
            if receiver in self.owned:
                kept_corners.append(corners.moved_to(receiver, share))
        self.corners = Corners(*(np.concatenate(columns) for columns in zip(*kept_corners)))
        self.row = rows_of(self.owned, self.corners.node)
