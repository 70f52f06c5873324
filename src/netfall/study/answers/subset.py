"""Rare failures by subset simulation (Au and Beck 2001, Probabilistic Engineering Mechanics 16(4)).

The probability that a response exceeds a value is the product of larger ones: that it exceeds a first
threshold, then a second one given the first, and so on; each threshold is such that a share `level` of the
samples passes it. Samples beyond a threshold come from Markov chains that begin at those that passed it: a
candidate is rho x + sqrt(1 - rho^2) xi in standard normal variables (Papaioannou et al. 2015, 41), and stays
if its response passes too. Gusts are normal numbers that follow from a seed: a mixture of seeds with weights
rho w, and a new one with sqrt(1 - rho^2), is such a candidate. All of it follows from the seed and from the
responses, in the order of the samples' numbers: so it may be interrupted, and done by any number of workers.
"""

from typing import NamedTuple

import numpy as np

from netfall.numerics.functions import exp, log1p
from netfall.numerics.normal import quantile

RHO = 0.8  # correlation of a candidate with what it comes from
ALIKE = 0.15  # correlation of the levels' errors, whose chains begin at each other's samples: measured
MOST_LEVELS = 12  # 1e-12 with a level of 0.1
Z_95 = 1.959963984540054
SEEDS_APART = 2**32  # seeds of gusts of studies with neighbouring seeds


class Rare(NamedTuple):
    """What [rare] asks for: the probability that the outcome `of` is above a value."""

    of: str
    above: float
    samples: int
    level: float
    seed: int


class Sample(NamedTuple):
    """A point of the space of what is random.

    z : (k,) standard normal numbers; gusts : pairs of a weight and a seed, whose squared weights add to 1
    """

    z: np.ndarray
    gusts: list[list]


class Level(NamedTuple):
    """What a level has found. threshold : that a share `passed` of the samples reaches; rho : correlation

    accepted : share of the candidates that passed; deviation : of `passed`, over it
    """

    threshold: float
    passed: float
    accepted: float
    deviation: float


class Subset:
    """One estimate, a batch of samples after another.

    count : samples of a level; level : share that passes a threshold; above : the response that is a failure
    """

    def __init__(self, count: int, level: float, above: float, seed: int, variables: int):
        self.count, self.above, self.seed, self.variables = count, above, seed, variables
        self.chains = max(1, round(level * count))
        self.levels: list[Level] = []
        self.ended = ""  # how, once it has
        self.kept: list[int] = list(range(count))  # numbers of the level's samples, chain by chain
        self.samples = [self._drawn(number) for number in range(count)]
        self.responses = np.full(count, np.nan)
        self.batch = list(range(count))
        self._next, self._accepted, self._tried = count, 0, 0
        self._heads: list[int] = []
        self._threshold = -np.inf

    def _drawn(self, number: int) -> Sample:
        """Independent chance of a number."""
        z = np.zeros(0)
        if self.variables:
            raw = np.random.Philox(key=[self.seed, number]).random_raw(self.variables) >> np.uint64(12)
            z = quantile((raw + 0.5) * 2.0**-52)
        return Sample(z, [[1.0, SEEDS_APART * (self.seed + 1) + number]])

    def _candidate(self, of: int, number: int) -> Sample:
        """The sample of a number that is like another."""
        there, new, rest = self.samples[of], self._drawn(number), np.sqrt(1.0 - RHO * RHO)
        gusts = [[RHO * w, s] for w, s in there.gusts] + [[rest, new.gusts[0][1]]]
        return Sample(RHO * there.z + rest * new.z, gusts)

    def take(self, responses: np.ndarray) -> None:
        """The responses (b,) of the batch; the next one is in `batch` then, empty when all is known."""
        self.responses[self.batch] = responses
        if self._heads:
            self._move_on()
        if len(self.kept) < self.count:
            self._extend()
        else:
            self._end_level()

    def _move_on(self) -> None:
        """Each chain goes on from its candidate if that passes, else it stays."""
        passes = self.responses[self.batch] >= self._threshold
        self._heads = [new if ok else old for new, old, ok in zip(self.batch, self._heads, passes)]
        self._accepted += int(passes.sum())
        self._tried += len(passes)
        self.kept += self._heads

    def _extend(self) -> None:
        """A candidate for each chain, of as many as still fit."""
        self._heads = self._heads[: self.count - len(self.kept)]
        self.batch = list(range(self._next, self._next + len(self._heads)))
        self._next += len(self.batch)
        self.samples += [self._candidate(of, number) for of, number in zip(self._heads, self.batch)]
        self.responses = np.append(self.responses, np.full(len(self.batch), np.nan))

    def _end_level(self) -> None:
        values = self.responses[self.kept]
        order = np.argsort(-values, kind="stable")
        threshold = float(values[order[self.chains - 1]])
        last = threshold > self.above or len(self.levels) == MOST_LEVELS - 1
        passes = values > self.above if last else values >= threshold
        accepted = self._accepted / self._tried if self._tried else np.nan
        deviation = self._deviation(passes)
        self.levels.append(Level(self.above if last else threshold, passes.mean(), accepted, deviation))
        self.batch = []
        if last:
            self.ended = "reached" if threshold > self.above else "too rare"
        elif threshold <= self._threshold:
            self.ended = "stuck"
        else:
            self._threshold, self._accepted, self._tried = threshold, 0, 0
            self._heads = [self.kept[k] for k in order[: self.chains]]
            self.kept = list(self._heads)
            self._extend()

    def _deviation(self, passes: np.ndarray) -> float:
        """Deviation of the share that passes over that share, with the correlation along chains (eq. 29)."""
        share, n = passes.mean(), len(passes)
        if share == 0.0:
            return np.inf
        gamma = 0.0
        if self.levels:
            steps = n // self.chains
            rows = passes[: steps * self.chains].reshape(steps, self.chains).astype(float)
            spread = share - share * share
            for k in range(1, steps if spread > 0.0 else 0):
                together = (rows[:-k] * rows[k:]).mean() - share * share
                gamma += 2.0 * (1.0 - k / steps) * together / spread
        return float(np.sqrt((1.0 - share) / (share * n) * max(1.0 + gamma, 1.0)))

    @property
    def probability(self) -> float:
        """The estimate; an upper bound where it did not get there."""
        return float(np.prod([each.passed for each in self.levels]))

    @property
    def interval(self) -> tuple[float, float]:
        """At 95 %, the estimate taken as lognormal; from 0 where it did not get there."""
        deviations = np.array([each.deviation for each in self.levels])
        variance = (1.0 - ALIKE) * np.sum(deviations**2) + ALIKE * np.sum(deviations) ** 2
        if self.ended != "reached":
            before = np.prod([each.passed for each in self.levels[:-1]])
            return 0.0, float(before)
        width = float(exp(np.array(Z_95 * np.sqrt(log1p(variance)))))
        return self.probability / width, min(1.0, self.probability * width)
