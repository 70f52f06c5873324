"""Grouping of samples into curves, their dependence, and bootstrap resamples.

samples : the columns of /samples by name, (N,) each
"""

from collections.abc import Collection, Iterator
from typing import Any, NamedTuple

import numpy as np

from netfall.core.arrays import AnyArray

SPEED = "wind.speed"
MOST_CURVES = 6  # largest number of combinations of inputs with separate curves
RESAMPLES = 2000  # number of bootstrap resamples
CONFIDENCE = 0.95  # confidence level of the intervals
SEED = 1  # seed of the resamples
AT_ONCE = 4_000_000  # largest number of weights in memory


class FragilityCurve(NamedTuple):
    """The samples of one curve, and the units for resampling.

    name : the combination of inputs, "" if there is only one curve
    rows : (r,) rows of /samples
    dependent_groups : inputs whose equal values make runs dependent ("wind.seed"), each with its codes (r,).
        Whole groups of equal values are resampled. With several inputs, the weights of a run are multiplied
    strata : (r,) runs are resampled within equal values; has no effect on resampled `dependent_groups`
    """

    name: str
    rows: np.ndarray
    dependent_groups: dict[str, np.ndarray]
    strata: np.ndarray

    @property
    def samples(self) -> int:
        """Number of independent samples."""
        return min((len(np.unique(c)) for c in self.dependent_groups.values()), default=len(self.rows))

    @property
    def resampled(self) -> str:
        """Name of the resampled units."""
        if self.dependent_groups:
            return " and ".join(self.dependent_groups)
        return "runs within speeds" if len(np.unique(self.strata)) > 1 else "runs"


def varying_inputs(samples: dict[str, np.ndarray]) -> list[str]:
    """Return the inputs that differ between samples: keys of the job ("section.key"), and `removed`."""
    names = [name for name in samples if name == "removed" or "." in name]
    return [name for name in names if len(np.unique(samples[name])) > 1]


def input_text(samples: dict[str, np.ndarray], row: int, names: list[str]) -> str:
    """Return the inputs of one sample as text, with their names."""
    values = {name: samples[name][row] for name in names}
    return ", ".join(f"{name} = {v if isinstance(v, str) else f'{v:g}'}" for name, v in values.items())


def is_seed(name: str) -> bool:
    """Return whether an input is a seed of a random generator, of which the value has no meaning."""
    return name.endswith("seed")


def group_curves(
    samples: dict[str, np.ndarray], drawn: Collection[str] | None = None
) -> tuple[list[FragilityCurve], list[str]]:
    """Return the curves of the samples, and the inputs that are pooled in each, without seeds.

    Each combination of values of inputs with few values, not random, has its own curve, up to MOST_CURVES.

    drawn : the inputs with random values; None: not known, so that all pooled inputs count as random
    """
    inputs = [name for name in varying_inputs(samples) if name != SPEED]
    separate: list[str] = []
    combination = np.zeros(len(samples[SPEED]), int)
    for name in sorted(inputs, key=lambda name: (len(np.unique(samples[name])), name)):
        split = pair_codes(combination, value_codes(samples[name]))
        is_random = is_seed(name) or (drawn is not None and name in drawn)
        if not is_random and len(np.unique(split)) <= MOST_CURVES:
            separate, combination = [*separate, name], split
    pooled = [name for name in inputs if name not in separate]
    # The values of a grid are chosen, not random; if no input is random, they are treated as random.
    random = [name for name in pooled if drawn is None or is_seed(name) or name in drawn] or pooled
    curves = [
        _curve(samples, np.flatnonzero(combination == k), separate, random) for k in np.unique(combination)
    ]
    return curves, [name for name in pooled if not is_seed(name)]


def _curve(
    samples: dict[str, AnyArray], rows: np.ndarray, separate: list[str], random: list[str]
) -> FragilityCurve:
    name = input_text(samples, rows[0], separate)
    groups: dict[str, np.ndarray] = {}
    for column in random:
        add_factor(groups, column, value_codes(samples[column][rows]))
    if any(codes.max() + 1 < len(rows) for codes in groups.values()):
        return FragilityCurve(name, rows, groups, np.zeros(len(rows), int))
    speed = value_codes(samples[SPEED][rows])
    repeated = 2 * len(np.unique(speed)) <= len(rows)
    return FragilityCurve(name, rows, {}, speed if repeated else np.zeros(len(rows), int))


def add_factor(groups: dict[str, np.ndarray], name: str, codes: np.ndarray) -> None:
    """Add an input; inputs whose values change together are merged.

    An input with a single value is ignored. Runs of one seed stay dependent even if the other input differs.
    """
    if codes.max() == 0:
        return
    for other in list(groups):
        pairs = pair_codes(groups[other], codes)
        if pairs.max() == max(groups[other].max(), codes.max()):
            of_seeds = [groups[other]] * any(map(is_seed, other.split(", "))) + [codes] * is_seed(name)
            groups[f"{other}, {name}"] = min([pairs, *of_seeds], key=np.max)
            del groups[other]
            return
    groups[name] = codes


def value_codes(values: np.ndarray) -> np.ndarray:
    """Return the rank (N,) of each value among the different values, ascending."""
    return np.unique(values, return_inverse=True)[1]


def pair_codes(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return codes of the pairs of two codes."""
    return value_codes(one * (other.max() + 1) + other)


def bootstrap_weights(curve: FragilityCurve) -> Iterator[np.ndarray]:
    """Yield the weights of the runs in RESAMPLES resamples, by blocks (b, r); reproducible for a curve."""
    generator = np.random.Generator(np.random.PCG64(SEED))
    block = max(1, min(RESAMPLES, AT_ONCE // len(curve.rows)))
    for start in range(0, RESAMPLES, block):
        count = min(block, RESAMPLES - start)
        total = np.ones((count, len(curve.rows)))
        for codes in curve.dependent_groups.values():
            total *= _drawn(generator, codes.max() + 1, count)[:, codes]
        if not curve.dependent_groups:  # each stratum has as many draws as runs
            for k in np.unique(curve.strata):
                rows = np.flatnonzero(curve.strata == k)
                total[:, rows] = _drawn(generator, len(rows), count)
        yield total


def bootstrap_interval(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return percentiles (2,) or (g, 2) over resamples (R,) or (R, g) with bounds `low` and `high`."""
    skipped = round(0.5 * (1.0 - CONFIDENCE) * RESAMPLES)
    return np.stack([np.sort(low, axis=0)[skipped - 1], np.sort(high, axis=0)[-skipped]], axis=-1)


def _drawn(generator: Any, n: int, count: int) -> np.ndarray:
    """Return how often each of n items is drawn in n draws, (count, n)."""
    picks = generator.integers(0, n, (count, n)) + n * np.arange(count)[:, None]
    return np.bincount(picks.ravel(), minlength=count * n).reshape(count, n).astype(float)
