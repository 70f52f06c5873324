"""Member removal in the dynamic stage, [[remove]]: its time, and its effect on tensions.

At its step the elements leave the net (`physics.removal`). Their tensions remain as fading forces on their
ends (`varying_loads.FadingLoad`), and the extremes of every element's tension over all steps start again. The
loads inside a removed cable are redistributed to its ends (`loads.removal`), both in the dynamic stage and in
the equilibrium after the removal.
"""

import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from netfall.core.arrays import rows_of
from netfall.driver.dynamics.varying_loads import FadingLoad
from netfall.driver.problem import Problem
from netfall.driver.removal.equilibria import RemovalEquilibria, RemovalOutcome
from netfall.loads.removal import Redistribution, RemovalStep, particles_removed_after_breaks
from netfall.parallel.mpi import MPI
from netfall.physics import removal
from netfall.physics.elements import ElementState
from netfall.physics.events import EventLog
from netfall.physics.law.branches import add_branch_forces
from netfall.physics.state import State
from netfall.results.writer import text_dataset

# (removals, m) [N] on rank 0, nan: not known. start: in the equilibrium before the removal. lowest: nan for
# broken elements. moment: of bending in the equilibrium after it [N m].
TENSION_NAMES = ("before", "highest", "lowest", "start", "after", "moment")
MAX_FADING_STEPS = 1e6  # number of steps whose loads are added one by one
MIN_TENSION_CHANGE = 1e-3  # of the largest tension [-]: a smaller change has no dynamic factor


class MemberRemoval:
    """Member removals of a run, with the tensions before and after them on rank 0."""

    def __init__(
        self, problem: Problem, removals: list[RemovalStep], after: RemovalEquilibria | None, log: EventLog
    ):
        """after : result of `removal.equilibria.run`, None: in a resumed run"""
        self.distribution, self.removals, self.job = problem.distribution, removals, problem.job
        self.model, self.log, self.dt, self.done = problem.model, log, problem.dynamic_schedule.dt, 0
        self.outcomes, self.bends = after.outcomes if after else [], problem.state.features.bending
        # m2, (n,) on rank 0, with areas redistributed so far
        self.area = self.model.roof.area.copy() if self.model else None
        gid = self.distribution.subdomain.particle_gid
        durations = [entry.duration for entry in self.job.removes]
        entries = sorted({k for removed in removals for k in removed.entry.tolist()})
        self.fades = {k: FadingLoad(gid, durations[k]) for k in entries if durations[k]}
        self.tensions: dict[str, np.ndarray] = {}
        self.displacement = np.zeros(0)  # m, (removals, n, 3) on rank 0, in the equilibrium after each
        if self.model:
            self.tensions = {
                name: np.full((len(removals), self.model.net.m), np.nan) for name in TENSION_NAMES
            }
            if after:
                forces, moments = np.moveaxis(np.array(after.tension), 2, 0)
                self.tensions["start"][:], self.tensions["after"][:] = forces[:-1], forces[1:]
                self.tensions["moment"][:] = moments[1:]
                self.displacement = np.array(after.displacement)

    @property
    def next_step(self) -> int:
        """Return the step of the next removal; after the last: larger than every step."""
        return self.removals[self.done].step if self.done < len(self.removals) else sys.maxsize

    def remove_from(
        self, state: State, elements: ElementState, time: float, before_dt: float, dt: float
    ) -> Redistribution:
        """Remove the due members from the state; return the redistribution of their loads.

        elements : at the present step; time : [s] of it; before_dt, dt : [s], the steps before and after it

        The log must contain all fractures so far. Collective.
        """
        removed = self.removals[self.done]
        self.close(state, elements.N)
        self._record_tension("before", self.done, state, elements.N)
        gid, rows = self.distribution.subdomain.particle_gid, self._rows(removed.elements)
        N = add_branch_forces(state, elements.N, before_dt, dt)
        force = self._forces(state, removed, rows[rows >= 0], elements.L, N)
        particles, redistribution = self._leaving_particles(self.done)
        entries = [self.job.removes[k] for k in removed.entry.tolist()]
        since, missing = impulse_times(entries, time, before_dt, dt)
        removal.remove_elements(state, rows[rows >= 0], since[rows >= 0])
        end_rows = rows_of(gid, removed.ends.T.ravel())
        for kind, time_missing in (removal.INTERNAL, missing[:, :1]), (removal.EXTERNAL, missing[:, 1:]):
            impulse = time_missing * force  # on the start nodes
            impulses = np.concatenate([impulse, -impulse])[end_rows >= 0]
            removal.apply_impulses(state, end_rows[end_rows >= 0], impulses, kind)
        self._transfer_carried(state, redistribution)
        removal.remove_particles(state, np.flatnonzero(np.isin(gid, particles)))
        self._begin_fades(removed, {k: force[removed.entry == k] for k in self.fades if k in removed.entry})
        self._move_area(redistribution)
        self.done += 1
        return redistribution

    def _rows(self, elements: np.ndarray) -> np.ndarray:
        """Return the local rows of elements; -1: not on this rank."""
        return rows_of(self.distribution.subdomain.element_gid, elements)

    def _forces(
        self, state: State, removed: RemovalStep, rows: np.ndarray, L: np.ndarray, N: np.ndarray
    ) -> np.ndarray:
        """Compute the forces (k, 3) [N] of the removed elements on their start nodes, the same on every rank.

        Elements that had broken before exert no force. L, N : (m,) lengths [m], axial forces [N]. Collective.
        """
        force = np.zeros((len(removed.elements), 3))
        for e in rows[state.owned[rows].astype(bool) & (state.broken[rows] == 0)].tolist():
            a, b = state.ends[e]
            k = np.searchsorted(removed.elements, self.distribution.subdomain.element_gid[e])
            force[k] = N[e] / L[e] * (state.x[b] - state.x[a])
        self.distribution.comm.Allreduce(MPI.IN_PLACE, force, MPI.SUM)  # other ranks add zeros
        return force

    def _leaving_particles(self, k: int) -> tuple[np.ndarray, Redistribution]:
        """Return the particles removed at removal k and the redistribution of their loads. Collective.

        The log shows which elements had broken before.
        """
        removed = self.removals[k]
        broken = set(self.log.element[self.log.step < removed.step].tolist()) & set(removed.elements.tolist())
        if not broken:
            return removed.particles, removed.redistribution
        result = particles_removed_after_breaks(self.model, self.removals, k, broken) if self.model else None
        return self.distribution.comm.bcast(result)

    def _transfer_carried(self, state: State, redistribution: Redistribution) -> None:
        """Move the loads of particles inside removed cables to other particles. Collective."""
        fields = {name: getattr(state, name) for name in removal.CARRIED}
        given = partial(self.distribution.broadcast_rows, redistribution.particles)
        carried = {name: given(field) for name, field in fields.items() if field is not None}
        row = rows_of(self.distribution.subdomain.particle_gid, redistribution.receiver)
        is_local = row >= 0
        source, share = redistribution.source[is_local], redistribution.share[is_local]
        removal.transfer_carried(state, row[is_local], source, share, carried)

    def _begin_fades(self, removed: RemovalStep, force: dict[int, np.ndarray]) -> None:
        """Start the fading tensions of a removal; force : (k, 3) [N] of the elements of each entry."""
        for entry, forces in force.items():
            in_entry = removed.entry == entry
            start = self.job.removes[entry].time
            self.fades[entry].begin(
                start, removed.ends[in_entry], forces, self._rows(removed.elements[in_entry])
            )

    def _move_area(self, redistribution: Redistribution) -> None:
        """Move the areas of removed particles to others."""
        if self.area is not None:
            redistribution.move(self.area, np.arange(len(self.area)))

    def close(self, state: State, N: np.ndarray) -> None:
        """Record the extremes since the last removal. N : (m,) [N], at the end. Collective."""
        if self.done:
            is_broken = state.broken != 0  # fragments do not count
            highest = np.where(is_broken, state.highest, np.maximum(state.highest, N))
            self._record_tension("highest", self.done - 1, state, highest)
            lowest = np.where(is_broken, np.nan, np.minimum(state.lowest, N))
            self._record_tension("lowest", self.done - 1, state, lowest)

    def _record_tension(self, name: str, k: int, state: State, rows: np.ndarray) -> None:
        values = self.distribution.gather_elements(rows, state.owned.astype(bool))
        if values is not None:
            self.tensions[name][k] = values

    def record(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return the record that `restore` needs; the tensions and the fading forces on rank 0."""
        forces = {str(k): fade.element_force for k, fade in self.fades.items() if fade.end_time < np.inf}
        small = {"done": self.done, "outcomes": self.outcomes}
        return small, self.tensions | forces | {"displacement": self.displacement} if self.tensions else {}

    def restore(
        self,
        redistribute: Callable[[Redistribution], None],
        small: dict[str, Any],
        arrays: dict[str, np.ndarray] | None,
    ) -> None:
        """Restore the record of an earlier run, whose removals are repeated one after another. Collective.

        redistribute : called for each removal after its tensions have started to fade; arrays : on rank 0
        """
        self.done = small["done"]
        self.outcomes = [RemovalOutcome(state, tuple(elements)) for state, elements in small["outcomes"]]
        if arrays:
            self.tensions = {name: arrays[name] for name in TENSION_NAMES}
            self.displacement = arrays["displacement"]
        for k, removed in enumerate(self.removals[: self.done]):
            force = {e: arrays[str(e)] for e in self.fades if e in removed.entry} if arrays else None
            self._begin_fades(removed, self.distribution.comm.bcast(force))
            redistribution = self._leaving_particles(k)[1]
            self._move_area(redistribution)
            redistribute(redistribution)

    def columns(self) -> dict[str, np.ndarray]:
        """Return the datasets of /removal, a row for each entry of the job. Rank 0."""
        if self.model is None:
            return {}
        n, m, entries = self.model.net.n, self.model.net.m, self.job.removes
        names = [f"tension_{k}" for k in ("before", "highest", "lowest", "peak", "after")]
        names += ["dynamic_factor"] + ["bending_moment_after"] * self.bends
        datasets = {
            "time": np.array([entry.time for entry in entries]),
            "state": text_dataset([""] * len(entries)),
        }
        datasets |= {name: np.full((len(entries), m), np.nan) for name in names}
        datasets["displacement_after"] = np.full((len(entries), n, 3), np.nan)
        is_removed, breaks = np.zeros(m, bool), []
        for k, removed in enumerate(self.removals):
            is_removed[removed.elements] = True
            before, highest, lowest, start, after, moment = (self.tensions[name][k] for name in TENSION_NAMES)
            highest, lowest = np.where(is_removed, np.nan, highest), np.where(is_removed, np.nan, lowest)
            peak = farthest(before, highest, lowest, after)
            factor = np.where(np.isnan(lowest), np.nan, dynamic_factors(before, peak, start, after))
            for entry in removed.entries:
                datasets["time"][entry] = removed.step * self.dt
                datasets["state"][entry] = self.outcomes[k].state
                datasets["displacement_after"][entry] = self.displacement[k]
                breaks += [(e, entry) for e in self.outcomes[k].elements]
                for name, row in zip(names, (before, highest, lowest, peak, after, factor, moment)):
                    datasets[name][entry] = row
        empty = np.zeros(0, np.int64)
        datasets["element"] = np.concatenate([empty, *(removed.elements for removed in self.removals)])
        datasets["entry"] = np.concatenate([empty, *(removed.entry for removed in self.removals)])
        pairs = np.array(breaks, np.int64).reshape(-1, 2)
        return datasets | {"breaking_element": pairs[:, 0], "breaking_entry": pairs[:, 1]}


def impulse_times(entries: list[Any], time: float, before: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the times for which removed elements act outside the velocity updates: (k,), (k, 2) [s].

    The elements are removed at a time [s]. The first result is the time since they ceased to act as elements.
    The second result is missing in the velocities, which contain the forces up to half a step ago. If an
    entry has no duration, its elements act until its time. If it has one, the integral of the fading load
    must act, but the velocity updates use its values at the steps. The correction makes the motion
    second-order accurate in the step.

    entries : of each element; before, dt : [s] the steps before and after
    """
    since, missing = np.full(len(entries), 0.5 * before), np.zeros((len(entries), 2))
    for k, entry in enumerate(entries):
        d, acts = entry.duration, entry.time + 0.5 * entry.duration - time + 0.5 * before
        if d:
            steps = min(np.ceil(d / dt), MAX_FADING_STEPS)
            remaining = np.clip((entry.time + d - time - dt * np.arange(steps + 1.0)) / d, 0.0, 1.0)
            later = 0.5 * remaining[-1] * (d * remaining[-1] / dt - 1.0)  # sum over the following steps
            missing[k, 1] = acts - dt * (remaining.sum() + later) + 0.5 * (dt - before) * remaining[0]
        else:
            since[k], missing[k, 0] = time - entry.time, acts
    return since, missing


def farthest(before: np.ndarray, highest: np.ndarray, lowest: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return the extremes (m,) most distant from `before` in the direction of `after`, or in both if nan.

    For broken elements, whose lowest is nan, the highest counts.
    """
    rises = np.where(np.isnan(after), highest - before >= before - lowest, after >= before)
    return np.where(rises | np.isnan(lowest), highest, lowest)


def dynamic_factors(before: np.ndarray, peak: np.ndarray, start: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Compute the dynamic factor (peak - before) / (after - before) (m,).

    nan if a removal changes nothing, or if no equilibrium is known.
    start : (m,) [N] in the equilibrium before the removal, the reference of its change; before : in motion,
        with gusts
    """
    change, is_known = after - before, ~np.isnan(after)
    largest = max(np.abs(before).max(initial=0.0), np.abs(after[is_known]).max(initial=0.0))
    difference = np.minimum(np.abs(change), np.abs(after - np.where(np.isnan(start), before, start)))
    changes = is_known & (difference > MIN_TENSION_CHANGE * largest)
    return np.divide(peak - before, change, out=np.full(len(before), np.nan), where=changes)
