"""How the gusts begin: from the rest under the mean wind they grow in."""

import math

import numpy as np

from netfall.numerics.functions import cos

FINEST = 16  # samples of the ramp, at least: linear between them, gusts are right to 0.3 %


def growth(time: float, ramp: float) -> float:
    """Share of the gusts at a time [s]: (1 - cos(pi t / ramp)) / 2 over the ramp [s], then 1."""
    if time >= ramp:
        return 1.0
    return 0.5 * (1.0 - float(cos(math.pi * max(time, 0.0) / ramp)))


class GrowingGusts:
    """The samples of a history with what differs from its mean growing in; on rank 0.

    A history whose samples are too far apart to show the ramp gets more of them in it, linear in between.
    """

    def __init__(self, history, ramp: float):
        """history : `GeneratedHistory`, `TableHistory`; ramp : [s], 0: everything acts from the start"""
        self.history = history
        self.ramp = ramp if ramp > 0.0 else -math.inf  # times of a table may be before 0
        self.count = 0  # samples of the history so far
        self.last = (0.0, history.mean_gust)  # the one of them

    def next(self) -> list[tuple[float, np.ndarray]]:
        """The next sample, time [s] and gusts (c,) [m/s], and those put in before it."""
        (begin, first), sample = self.last, self.history.sample(self.count)
        time, gust = sample
        parts = 1
        if self.count and begin < self.ramp:
            parts = max(1, math.ceil((min(time, self.ramp) - begin) * FINEST / self.ramp))
        shares = [k / parts for k in range(1, parts)] if time > begin else []
        stop = min(time, self.ramp)
        between = [begin + share * (stop - begin) for share in shares]
        if shares and time > self.ramp:
            between.append(self.ramp)
        found = [(t, first + (t - begin) / (time - begin) * (gust - first)) for t in between] + [sample]
        self.count, self.last = self.count + 1, sample
        return [(t, self._grown(t, g)) for t, g in found]

    def _grown(self, time: float, gust: np.ndarray) -> np.ndarray:
        if time >= self.ramp:
            return gust
        mean = self.history.mean_gust
        return mean + growth(time, self.ramp) * (gust - mean)

    def record(self) -> tuple[dict, dict]:
        """What a continuation needs, for `restore`: numbers and arrays."""
        numbers, arrays = self.history.record()
        own = {"count": self.count, "last_time": self.last[0]}
        return numbers | own, arrays | {"last_gust": self.last[1]}

    def restore(self, numbers: dict, arrays: dict) -> None:
        """Take up the record of an earlier run."""
        self.count, self.last = int(numbers["count"]), (float(numbers["last_time"]), arrays["last_gust"])
        self.history.restore(numbers, arrays)
