"""Onset of the gusts: they grow from zero, starting from the equilibrium under the mean wind."""

import math
from typing import Any

import numpy as np

from netfall.core.functions import cos
from netfall.loads.wind.field import GeneratedHistory
from netfall.loads.wind.measured import TableHistory

MIN_RAMP_SAMPLES = 16  # smallest number of samples of the ramp: the linear interpolation error is 0.3 %


def gust_growth(time: float, ramp: float) -> float:
    """Return the share of the gusts at a time [s]: (1 - cos(pi t / ramp)) / 2 over the ramp [s], then 1."""
    if time >= ramp:
        return 1.0
    return 0.5 * (1.0 - float(cos(math.pi * max(time, 0.0) / ramp)))


class GrowingGusts:
    """Samples of a history whose difference from its mean grows over the ramp; on rank 0.

    If the samples are too far apart to resolve the ramp, linear samples are inserted.
    """

    def __init__(self, history: GeneratedHistory | TableHistory, ramp: float):
        """history : `GeneratedHistory`, `TableHistory`; ramp : [s], 0: everything acts from the start"""
        self.history = history
        self.ramp = ramp if ramp > 0.0 else -math.inf  # a table may have times before 0
        self.count = 0  # samples taken from the history
        self.last = (0.0, history.mean_gust)  # latest of these

    def next(self) -> list[tuple[float, np.ndarray]]:
        """Return the next sample, time [s] and gusts (c,) [m/s], after the samples inserted before it."""
        (start, first), sample = self.last, self.history.sample(self.count)
        time, gust = sample
        parts = 1
        if self.count and start < self.ramp:
            parts = max(1, math.ceil((min(time, self.ramp) - start) * MIN_RAMP_SAMPLES / self.ramp))
        shares = [k / parts for k in range(1, parts)] if time > start else []
        end = min(time, self.ramp)
        times = [start + share * (end - start) for share in shares]
        if shares and time > self.ramp:
            times.append(self.ramp)
        samples = [(t, first + (t - start) / (time - start) * (gust - first)) for t in times] + [sample]
        self.count, self.last = self.count + 1, sample
        return [(t, self._grown(t, g)) for t, g in samples]

    def _grown(self, time: float, gust: np.ndarray) -> np.ndarray:
        """Scale the gusts at a time [s] by `gust_growth`."""
        if time >= self.ramp:
            return gust
        mean = self.history.mean_gust
        return mean + gust_growth(time, self.ramp) * (gust - mean)

    def record(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the state for `restore`: numbers and arrays."""
        numbers, arrays = self.history.record()
        own = {"count": self.count, "last_time": self.last[0]}
        return numbers | own, arrays | {"last_gust": self.last[1]}

    def restore(self, numbers: dict[str, Any], arrays: dict[str, Any]) -> None:
        """Restore the state of an earlier run."""
        self.count, self.last = int(numbers["count"]), (float(numbers["last_time"]), arrays["last_gust"])
        self.history.restore(numbers, arrays)
