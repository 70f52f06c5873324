"""The wind's two samples around the present time, kept in the state of every rank."""

import sys
from collections.abc import Callable

import numpy as np
from mpi4py import MPI

from netfall.mechanics.state import State
from netfall.parallel.subdomain import Distribution
from netfall.wind.field import WindField, particle_speeds

CHUNK = 64  # samples that rank 0 sends at once


class WindLoad:
    """Advances the wind in time: rank 0 generates, every rank interpolates to its particles."""

    def __init__(
        self, comm: MPI.Comm, distribution: Distribution, state: State, field: WindField | None, history
    ):
        """Collective. field, history : on rank 0. Sets the first two samples."""
        self.comm = comm
        self.history = history
        column = lambda name: distribution.particles(None if field is None else getattr(field, name))
        self.mean, self.corner, self.weight = column("mean"), column("corner"), column("weight")
        self.samples: list[tuple[float, np.ndarray]] = []  # all so far, for the result file
        self.k = 0
        self._set(state, self._sample(0), self._sample(1))

    def record(self) -> dict:
        """What a continuation needs, for `restore`; the history's state on rank 0."""
        return {
            "k": self.k,
            "time": np.array([t for t, _ in self.samples]),
            "gust": np.array([g for _, g in self.samples]),
            "history": self.history.record() if self.history else {},
        }

    def restore(self, state: State, record: dict) -> None:
        """Take up the record of an earlier run."""
        self.k = int(record["k"])
        self.samples = [(float(t), g) for t, g in zip(record["time"], record["gust"])]
        if self.history:
            self.history.restore(record["history"])
        self._set(state, self._sample(self.k), self._sample(self.k + 1))

    def _sample(self, k: int) -> tuple[float, np.ndarray]:
        while len(self.samples) <= k:
            chunk = None
            if self.comm.rank == 0:
                chunk = [self.history.sample(len(self.samples) + i) for i in range(CHUNK)]
            self.samples += self.comm.bcast(chunk)
        return self.samples[k]

    def _set(self, state: State, before, after) -> None:
        self.time, self.dt = before[0], max(after[0] - before[0], 1e-300)
        rows = len(self.mean)
        for (_, gust), speed in ((before, state.speed_before), (after, state.speed_after)):
            particle_speeds(self.mean, self.corner, self.weight, gust, speed[:rows])

    def record_until(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Times (t,) [s] and gusts (t, c) [m/s] of the samples up to the first at or after a time [s]."""
        times = np.array([sample for sample, _ in self.samples])
        last = min(int(np.searchsorted(times, time)), len(times) - 1)
        return times[: last + 1], np.array([gust for _, gust in self.samples[: last + 1]])

    def due(self, step_at: Callable[[float], int]) -> int:
        """Number of the step at which the sample after the present is due; beyond every step after the last.

        step_at(time) : number of the first step at or after a time [s]
        """
        moves = self.samples[self.k + 1][0] > self.time
        return step_at(self.time + self.dt) if moves else sys.maxsize

    def advance(self, state: State, step: int, step_at: Callable[[float], int]) -> None:
        """Move on to the samples around a step: `due` is later than it. step_at : as in `due`. Collective."""
        moved = False
        while self.due(step_at) <= step:
            self.k += 1
            moved = True
            before, after = self._sample(self.k), self._sample(self.k + 1)
            self.time, self.dt = before[0], max(after[0] - before[0], 1e-300)
        if moved:
            self._set(state, before, after)
