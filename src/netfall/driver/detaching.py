"""Parts of the net that are detached in motion: which they are, and the velocity of their centres of mass.

A part is detached if no path of unbroken elements leads from it to a support. The connectivity is evaluated
at fixed simulated times, `EVALUATION_INTERVAL` seconds apart, if an element has broken or was removed since.
So the result does not depend on ranks, rows, snapshots or restarts. With [wind] after_fracture = "detached"
the wind pressure on such a part ends then, and the drag of the relative wind acts on it (`physics.air`).
"""

from typing import Any

import numpy as np

from netfall.driver.problem import Problem
from netfall.driver.varying_loads import WindLoad
from netfall.geometry.net import connected_parts, part_contains
from netfall.loads.wind.field import particle_speeds
from netfall.model.model import Model
from netfall.parallel.sums import exact_sums
from netfall.physics.air import remove_wind
from netfall.physics.state import State

EVALUATION_INTERVAL = 0.01  # s between evaluations
LARGE = 0.01  # share of the mass that can move [-]: parts above it are followed
ATTACHED = -1  # value in place of a part; 0: a detached part that is not followed; k: the k-th one that is


class DetachedParts:
    """Detached parts of a run; the data of followed parts are the same on all ranks.

    part : (owned and halo,) of each particle, see `ATTACHED`
    evaluated : step of the last evaluation; broken : elements broken or removed by then, -1: not known
    """

    def __init__(self, problem: Problem):
        """Collective."""
        job, model = problem.job, problem.model
        self.comm, self.distribution, self.model = problem.comm, problem.distribution, model
        self.dt, self.step_at = problem.dynamic_schedule.dt, problem.dynamic_schedule.step_at
        self.ends_wind = job.wind is not None and job.wind.after_fracture == "detached"
        self.least = problem.comm.bcast(model and LARGE * float(model.own_mass[model.net.moves].sum()))
        self.part = np.full(problem.state.first_split, ATTACHED)
        self.large = np.zeros(0, np.int64)  # the lowest particle of each part that is followed
        self.evaluated, self.broken = -1, 0
        # time, lowest particle, mass, velocity of each, at each evaluation
        self.rows: list[tuple[Any, ...]] = []

    def due(self, step: int) -> int:
        """Return the number of the first step from this one on at which the next evaluation is due."""
        k = max(0, int(step * self.dt / EVALUATION_INTERVAL) - 1)
        while (
            self.step_at(k * EVALUATION_INTERVAL) < step
            or self.step_at(k * EVALUATION_INTERVAL) <= self.evaluated
        ):
            k += 1
        return self.step_at(k * EVALUATION_INTERVAL)

    def has_new_breaks(self, state: State) -> bool:
        """Return whether an element has broken or was removed since the last evaluation. Collective."""
        local_count = int(np.count_nonzero((state.broken == 1) & (state.owned == 1)))
        before, self.broken = self.broken, self.comm.allreduce(local_count)
        return self.broken != before

    def update_state(self, state: State) -> bool:
        """Mark the detached parts in the state and end the wind on new ones. Collective.

        Return whether the wind ended on any.
        """
        parts = self._parts(state)
        self.part = self.distribution.particles(parts and parts[0])
        self.large = self.comm.bcast(parts and parts[1])
        first, is_detached = state.first_split, (self.part != ATTACHED).astype(np.uint8)
        new = np.flatnonzero(is_detached & (state.detached[:first] == 0))
        state.detached[:first] = is_detached
        state.detached[first : state.n_local] = self._part_of_splits(state) != ATTACHED
        if self.ends_wind and len(new):
            remove_wind(state, new)
        return self.ends_wind and len(new) > 0

    def _parts(self, state: State) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the part of each particle (n,) and the lowest particle of each followed part.

        On rank 0. Collective.
        """
        distribution = self.distribution
        broken = distribution.gather_elements(state.broken, state.owned.astype(bool))
        held = distribution.gather_particles(state.is_held())
        own_mass = state.mass if state.air_mass is None else state.mass - state.air_mass
        mass = distribution.gather_particles(own_mass)
        if self.model is None or held is None:
            return None
        net = self.model.net
        label = connected_parts(net.elements[broken == 0], net.n)
        supported = part_contains(label, held)
        part_mass = np.bincount(label, mass, net.n)
        large = np.flatnonzero(~supported & (part_mass > self.least))
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
        if not len(self.large):
            return
        rows = state.owned_rows()
        part = np.concatenate([self.part[: state.n_owned], self._part_of_splits(state)])
        for k, lowest in enumerate(self.large.tolist(), 1):
            part_rows = rows[part == k]
            mass = state.mass[part_rows]
            total, *momentum = exact_sums(self.comm, mass, *(mass * state.v[part_rows].T))
            self.rows.append((step * self.dt, lowest, total, *(component / total for component in momentum)))

    def record(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return the record that `restore` needs."""
        return {"evaluated": self.evaluated, "broken": self.broken}, {"rows": np.reshape(self.rows, (-1, 6))}

    def restore(self, small: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        """Restore the record of an earlier run; the parts are found again when they are due."""
        self.evaluated = small["evaluated"]
        self.broken = -1 if small["broken"] else 0
        self.rows = [tuple(row) for row in arrays["rows"].tolist()]

    def columns(self, wind: WindLoad | None) -> dict[str, np.ndarray]:
        """Return the datasets of /detached, none if no part was followed; on rank 0.

        wind : None: there is none
        """
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
