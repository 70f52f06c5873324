"""The members of a study of rare failures: each follows from what earlier ones gave (`answers/subset.py`)."""

import numpy as np
from scipy.special import ndtr

from netfall.job.job import Job
from netfall.job.schema import SECTIONS
from netfall.study.answers.hazard import Hazard
from netfall.study.answers.samples import SPEED
from netfall.study.answers.subset import MOST_LEVELS, Rare, Sample, Subset
from netfall.study.draws import LEAST, values_at

GUSTS, STRENGTH = "wind.seed", "cable.strength_seed"
STRENGTH_APART = 2**31  # seeds of strengths from those of gusts
DIGITS = 12  # of the weights of seeds
# Years whose wind is slower or faster than any that a job takes have the least or the most of these.
SLOWEST, FASTEST = next((key.low, key.high) for key in SECTIONS["wind"] if f"wind.{key.name}" == SPEED)
FAILED = ("no_rest", "diverged", "failed")  # states whose response is beyond any value


class Chains:
    """The runs of a subset simulation, by their numbers.

    distributions : of the keys that are sampled, by name; hazard : of the speed, None: the job's own
    """

    def __init__(self, rare: Rare, distributions: dict[str, dict], hazard: Hazard | None, job: Job):
        self.rare, self.distributions, self.hazard = rare, distributions, hazard
        of_groups = [group.get("strength_deviation") for group in job.groups.values()]
        scatters = any([job.cable.strength_deviation, *of_groups])
        self.seeds = [GUSTS] * (job.wind is not None) + [STRENGTH] * scatters
        self.speeds = [SPEED] * (hazard is not None)
        numbers = len(self.names) - len(self.seeds)
        self.subset = Subset(rare.samples, rare.level, rare.above, rare.seed, numbers)

    @property
    def names(self) -> list[str]:
        """The keys of the job that differ between members."""
        return [*self.speeds, *self.distributions, *self.seeds]

    @property
    def most(self) -> int:
        """How many members there can be."""
        return self.rare.samples * MOST_LEVELS

    def values(self, number: int) -> dict:
        """Of the keys, for a member that is known."""
        sample: Sample = self.subset.samples[number]
        share = np.clip(ndtr(sample.z), LEAST, 1.0 - LEAST)
        values = {}
        if self.speeds:
            exceeded = np.clip(ndtr(-sample.z[:1]), LEAST, 1.0 - LEAST)
            values[SPEED] = float(np.clip(self.hazard.speed_at(exceeded)[0], SLOWEST, FASTEST))
        for (name, each), one in zip(self.distributions.items(), share[len(self.speeds) :]):
            value = float(values_at(each, np.array([one]))[0])
            values[name] = int(value) if each["distribution"] == "integer" else value
        for name in self.seeds:
            values[name] = _mixture(sample, 0 if name == GUSTS else STRENGTH_APART)
        return values

    def advance(self, table) -> list[int]:
        """The members that are to be run next, empty when all is known. table : the runs that there are"""
        while self.subset.batch:
            missing = [number for number in self.subset.batch if not table.there[number]]
            if missing:
                return missing
            self.subset.take(self._responses(table, np.array(self.subset.batch)))
        return []

    def _responses(self, table, numbers: np.ndarray) -> np.ndarray:
        """Outcomes; beyond any value where a run has none because it failed, below where there is none."""
        value = np.nan_to_num(table.columns[self.rare.of][numbers].astype(float), nan=-np.inf)
        return np.where(np.isin(table.columns["state"][numbers], FAILED), np.inf, value)

    def section(self, table) -> dict[str, np.ndarray]:
        """What stands in /rare."""
        s = self.subset
        low, high = s.interval
        columns = {name: np.array([getattr(level, name) for level in s.levels]) for name in LEVEL_COLUMNS}
        state = table.columns["state"][: len(s.samples)]
        return {
            "probability": s.probability,
            "interval": np.array([low, high]),
            "levels": len(s.levels),
            "ended": s.ended,
            "of": self.rare.of,
            "above": self.rare.above,
            "runs": int(table.there.sum()),
            "without_outcome": int(np.isin(state, FAILED[1:]).sum()),
        } | columns


LEVEL_COLUMNS = ("threshold", "passed", "accepted", "deviation")


def _mixture(sample: Sample, apart: int) -> int | list:
    """The seed of a sample; of the first level one alone."""
    if len(sample.gusts) == 1:
        return sample.gusts[0][1] + apart
    weights = np.array([w for w, _ in sample.gusts])
    return [[float(w), s + apart] for w, (_, s) in zip(np.round(weights, DIGITS), sample.gusts)]
