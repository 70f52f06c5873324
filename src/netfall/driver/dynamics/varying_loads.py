"""Loads that vary in time, kept in the state of every rank as two samples around the present step.

A new load is a class with the methods of `VaryingLoad`. It is created in `varying_loads`, and counts in
`job.derived.has_varying_forces`. A force times a function of time is a `TimedLoad`. Loads that are linear
between samples add to `load_before` and `load_after`; the wind has separate fields.
"""

import math
import sys
from collections.abc import Callable, Sequence

import numpy as np

from netfall.core.arrays import rows_of
from netfall.core.functions import lengths
from netfall.driver.problem import Problem
from netfall.job.derived import gust_ramp, has_growing_pressure
from netfall.loads.removal import Redistribution
from netfall.loads.wind.field import GrowingGusts, WindField, particle_speeds
from netfall.model.model import Model
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.physics.state import State
from netfall.physics.supports import Ground

SAMPLES_PER_BROADCAST = 64  # samples of the history that rank 0 sends at once


class VaryingLoad:
    """Load that varies in time.

    times : [s] of its samples, from 0, inf after the last; k : index of the present sample
    """

    def __init__(self, times: Sequence[float]):
        self.times, self.k = list(times), 0

    @property
    def before(self) -> float:
        """Return the time [s] of the present sample."""
        return self.times[self.k]

    @property
    def after(self) -> float:
        """Return the time [s] of the next sample, inf if none follows."""
        return self.times[self.k + 1]

    def advance(self, step: int, step_at: Callable[[float], int]) -> None:
        """Advance to the samples around a step. Collective."""
        while self.after < math.inf and step >= step_at(self.after):
            self.k += 1

    def write(self, state: State, start: float, end: float) -> None:
        """Write the values at two times between these samples to the state."""
        raise NotImplementedError

    def redistribute(self, redistribution: Redistribution, distribution: Distribution) -> None:
        """Move what acts on leaving particles to others. Collective."""
        raise NotImplementedError


def varying_loads(problem: Problem) -> list[VaryingLoad]:
    """Create the varying loads, except fading loads of member removals. Collective."""
    loads: list[VaryingLoad] = []
    job, model, distribution = problem.job, problem.model, problem.distribution
    if job.wind:
        field = model.wind_field if model else None
        gusts = GrowingGusts(model.history, gust_ramp(job)) if model and model.history else None
        loads.append(WindLoad(distribution, field, gusts))
    if job.load and has_growing_pressure(job):
        force, ramp = distribution.particles(model and model.loading.growing), job.load.ramp
        loads.append(TimedLoad(force, [0.0, ramp], lambda time: min(1.0, time / ramp)))
    return loads


def ground_of(comm: MPI.Comm, model: Model | None, state: State) -> Ground | None:
    """Return the moving ground of the particles of this rank; None: it does not move. Collective."""
    if not state.features.motion:
        return None
    names = list(Ground.kind.fields)
    names = names[: names.index("held")]
    shared = comm.bcast(model and [getattr(model.motion, name) for name in names])
    held = (state.free[: state.first_split] == 0).any(1) & (state.course[: state.first_split] >= 0)
    scratch = np.zeros((5, len(shared[-1]), 3))
    return Ground(*shared, np.flatnonzero(held), *scratch)


class VaryingLoads:
    """All varying loads, between two times common to all."""

    def __init__(self, state: State, loads: list[VaryingLoad], step_at: Callable[[float], int]):
        """step_at(time) : returns the number of the first step at or after a time [s]"""
        self.loads, self.step_at = loads, step_at
        self.update_samples(state)

    def update_samples(self, state: State) -> None:
        """Recompute both load samples, at the start and after a change of one load."""
        self.time = max((load.before for load in self.loads), default=0.0)
        end = min((load.after for load in self.loads), default=math.inf)
        self.dt = end - self.time
        if state.load_before is not None:
            state.load_before[:] = state.load_after[:] = 0.0
        if state.fading_before is not None:
            state.fading_before[:] = state.fading_after[:] = 0.0
        for load in self.loads:
            load.write(state, self.time, end)

    def next_sample_step(self) -> int:
        """Return the number of the step at which the next samples are due; after the last: a large number."""
        return self.step_at(self.time + self.dt) if self.dt < math.inf else sys.maxsize

    def advance(self, state: State, step: int) -> None:
        """Advance to the samples around a step, so that `next_sample_step` is later. Collective."""
        while self.next_sample_step() <= step:
            for load in self.loads:
                load.advance(step, self.step_at)
            self.update_samples(state)

    def redistribute(self, redistribution: Redistribution, distribution: Distribution) -> None:
        """Move what acts on leaving particles to others; call `update_samples` afterwards. Collective."""
        for load in self.loads:
            load.redistribute(redistribution, distribution)


class TimedLoad(VaryingLoad):
    """Force times a factor that depends on time; linear between its samples, constant after the last."""

    def __init__(self, force: np.ndarray, times: Sequence[float], factor: Callable[[float], float]):
        """force : (owned and halo, 3) [N]; times : [s] of samples, from 0; factor : at a time [s]"""
        super().__init__([*times, math.inf])
        self.force, self.factor = force, factor

    def redistribute(self, redistribution: Redistribution, distribution: Distribution) -> None:
        """Move the force on leaving particles to others. Collective."""
        given = distribution.broadcast_rows(redistribution.particles, self.force)
        redistribution.move(self.force, distribution.subdomain.particle_gid, given)

    def write(self, state: State, start: float, end: float) -> None:
        """Add its values at two times to the state."""
        rows = len(self.force)
        state.load_before[:rows] += self.factor(start) * self.force
        state.load_after[:rows] += self.factor(end) * self.force


class FadingLoad(VaryingLoad):
    """Tension of removed elements that fades linearly to zero, along their lines at the removal.

    Forces on particles inside a removed cable act on the particles that receive their loads. At the start of
    the fading, the two ends of the removed member are therefore pulled together as strongly as before.
    """

    def __init__(self, particle_gid: np.ndarray, duration: float):
        """particle_gid : (n,) global numbers of the rank's particles; duration : [s]"""
        super().__init__([0.0, math.inf])
        self.particle_gid, self.duration, self.end_time = particle_gid, duration, math.inf
        self.elements, self.tension = np.zeros(0, np.int64), np.zeros(0)

    def begin(self, time: float, ends: np.ndarray, force: np.ndarray, elements: np.ndarray) -> None:
        """Start the fading of forces at a time [s].

        ends : (k, 2) particles; force : (k, 3) [N] on the start of each, against its end
        elements : (k,) local rows, -1: not on this rank; needed by the slip points next to them
        """
        self.elements, self.tension = elements[elements >= 0], lengths(force[elements >= 0])
        self.end_time = time + self.duration
        self.times, self.element_force = [time, self.end_time, math.inf], force
        self._place(ends.T.ravel(), np.concatenate([force, -force]))

    def _place(self, particles: np.ndarray, force: np.ndarray) -> None:
        """Apply the forces (k, 3) [N] at the start of the fading to these particles (k,)."""
        self.particles, self.particle_force = particles, force
        row = rows_of(self.particle_gid, particles)
        self.rows, self.force = row[row >= 0], force[row >= 0]

    def redistribute(self, redistribution: Redistribution, distribution: Distribution) -> None:
        """Move the forces on leaving particles to others."""
        if self.end_time == math.inf:
            return
        given = np.zeros((len(redistribution.particles), 3))
        leaving = rows_of(redistribution.particles, self.particles)
        np.add.at(given, leaving[leaving >= 0], self.particle_force[leaving >= 0])
        stays, share = leaving < 0, redistribution.share[:, None]
        self._place(
            np.concatenate([self.particles[stays], redistribution.receiver]),
            np.concatenate([self.particle_force[stays], share * given[redistribution.source]]),
        )

    def write(self, state: State, start: float, end: float) -> None:
        """Add its values at two times to the state."""
        if self.end_time == math.inf:
            return
        for time, load in ((start, state.load_before), (end, state.load_after)):
            force = (self._remaining_share(time) * self.force).astype(load.dtype)
            np.add.at(load, self.rows, force)
        if state.fading_before is not None:
            for time, fading in ((start, state.fading_before), (end, state.fading_after)):
                fading[self.elements] = self._remaining_share(time) * self.tension

    def _remaining_share(self, time: float) -> float:
        """Return the share that remains at a time [s]."""
        return min(1.0, max(0.0, (self.end_time - time) / self.duration))


class WindLoad(VaryingLoad):
    """Wind: rank 0 generates the speed at control points, every rank interpolates to its particles."""

    def __init__(self, distribution: Distribution, field: WindField | None, history: GrowingGusts | None):
        """Collective. field, history : on rank 0"""
        super().__init__([])
        self.comm, self.history = distribution.comm, history
        self.mean = distribution.particles(field and field.mean)
        self.corner = distribution.particles(field and field.corner)
        self.weight = distribution.particles(field and field.weight)
        self.samples: list[tuple[float, np.ndarray]] = []  # all samples so far, for the result file
        self._sample(1)

    @property
    def before(self) -> float:
        """Return the time [s] of the present sample."""
        return self.samples[self.k][0]

    @property
    def after(self) -> float:
        """Return the time [s] of the sample after it."""
        time = self.samples[self.k + 1][0]
        return time if time > self.before else math.inf

    def record_until(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Return times (t,) [s] and gusts (t, c) [m/s] of the samples to the first at or after a time [s]."""
        times = np.array([sample for sample, _ in self.samples])
        last = min(int(np.searchsorted(times, time)), len(times) - 1)
        return times[: last + 1], np.array([gust for _, gust in self.samples[: last + 1]])

    def _sample(self, k: int) -> None:
        while len(self.samples) <= k:
            chunk = None
            if self.history is not None:
                chunk = [sample for _ in range(SAMPLES_PER_BROADCAST) for sample in self.history.next()]
            self.samples += self.comm.bcast(chunk)

    def redistribute(self, redistribution: Redistribution, distribution: Distribution) -> None:
        """Do nothing: the exposed areas are in the state, which is redistributed separately."""

    def advance(self, step: int, step_at: Callable[[float], int]) -> None:
        """Advance to the samples around a step."""
        while self.after < math.inf and step_at(self.before + (self.after - self.before)) <= step:
            self.k += 1
            self._sample(self.k + 1)

    def write(self, state: State, start: float, end: float) -> None:
        """Write the speeds at the particles at two times."""
        for time, speed in ((start, state.speed_before), (end, state.speed_after)):
            particle_speeds(self.mean, self.corner, self.weight, self._gust(time), speed[: len(self.mean)])

    def _gust(self, time: float) -> np.ndarray:
        """Return the gusts (c,) [m/s] at a time, by linear interpolation between the samples.

        At the time of a sample they are exactly its gusts.
        """
        (begin, first), (end, last) = self.samples[self.k], self.samples[self.k + 1]
        if time == begin or self.after == math.inf:
            return first
        return last if time == end else first + (time - begin) / (end - begin) * (last - first)
