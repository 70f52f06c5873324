"""Which members of a study belong to one curve, which of them share their chance, and samples drawn of these.

members : the columns of /members by name, (N,) each
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

SPEED = "wind.speed"
MOST_CURVES = 6  # combinations of inputs that have a curve of their own
RESAMPLES = 2000
SEED = 1  # of the resamples
AT_ONCE = 4_000_000  # weights in memory


class Curve(NamedTuple):
    """The members of one curve, and how they are resampled.

    name : the combination of inputs, "" if there is one curve alone
    rows : (r,) rows of /members
    sharing : names of the inputs whose equal values share their chance ("wind.seed"), each with its codes
        (r,): resampled as wholes; several: each is resampled, and a run counts as often as the product says
    strata : (r,) runs are resampled within equal values; None where `sharing` is resampled
    """

    name: str
    rows: np.ndarray
    sharing: dict[str, np.ndarray]
    strata: np.ndarray | None

    @property
    def samples(self) -> int:
        """How many independent samples there are."""
        return min((len(np.unique(c)) for c in self.sharing.values()), default=len(self.rows))

    @property
    def resampled(self) -> str:
        """What is resampled, in words."""
        if self.sharing:
            return " and ".join(self.sharing)
        return "runs within speeds" if len(np.unique(self.strata)) > 1 else "runs"


def inputs_of(members: dict[str, np.ndarray]) -> list[str]:
    """The inputs that differ between members, by name: keys of the job ("section.key"), and `removed`."""
    names = [name for name in members if name == "removed" or "." in name]
    return [name for name in names if len(np.unique(members[name])) > 1]


def values_of(members: dict[str, np.ndarray], row: int, names: list[str]) -> str:
    """The inputs of one member in words, by their names."""
    text = lambda v: v if isinstance(v, str) else f"{v:g}"
    return ", ".join(f"{name} = {text(members[name][row])}" for name in names)


def is_seed(name: str) -> bool:
    """Whether an input is the seed of a generator: its value says nothing."""
    return name.endswith("seed")


def curves_of(members: dict[str, np.ndarray]) -> tuple[list[Curve], list[str]]:
    """The curves of the members, and the inputs that are pooled in each, seeds left out.

    Inputs of few values make a curve for each combination, as long as there are no more than MOST_CURVES.
    """
    inputs = [name for name in inputs_of(members) if name != SPEED]
    apart, kind = [], np.zeros(len(members[SPEED]), int)
    for name in sorted(inputs, key=lambda name: (len(np.unique(members[name])), name)):
        finer = _codes(kind, codes_of(members[name]))
        if not is_seed(name) and len(np.unique(finer)) <= MOST_CURVES:
            apart, kind = [*apart, name], finer
    pooled = [name for name in inputs if name not in apart]
    curves = [_curve(members, np.flatnonzero(kind == k), apart, pooled) for k in np.unique(kind)]
    return curves, [name for name in pooled if not is_seed(name)]


def _curve(members, rows: np.ndarray, apart: list[str], pooled: list[str]) -> Curve:
    name = values_of(members, rows[0], apart)
    groups: dict[str, np.ndarray] = {}
    for column in pooled:
        _add_factor(groups, column, codes_of(members[column][rows]))
    together = np.zeros(len(rows), int)
    for codes in groups.values():
        together = _codes(together, codes)
    if groups and len(np.unique(together)) < len(rows):
        return Curve(name, rows, groups, None)
    speed = codes_of(members[SPEED][rows])
    repeated = 2 * len(np.unique(speed)) <= len(rows)
    return Curve(name, rows, {}, speed if repeated else np.zeros(len(rows), int))


def _add_factor(groups: dict[str, np.ndarray], name: str, codes: np.ndarray) -> None:
    """Add an input: to those that change with it, as all that is drawn together does; else on its own.

    An input of one value, or that is another name of one that is there, adds nothing.
    """
    if codes.max() == 0:
        return
    for other in list(groups):
        both = _codes(groups[other], codes)
        if both.max() == max(groups[other].max(), codes.max()):
            groups[f"{other}, {name}"] = both
            del groups[other]
            return
    groups[name] = codes


def codes_of(values: np.ndarray) -> np.ndarray:
    """The place (N,) of each value among the values that there are, ascending."""
    return np.unique(values, return_inverse=True)[1]


def _codes(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Codes of the pairs of two codes."""
    return codes_of(one * (other.max() + 1) + other)


def weights(curve: Curve) -> Iterator[np.ndarray]:
    """How often each run counts in RESAMPLES samples (b, r), by blocks; the same for the same curve."""
    generator = np.random.Generator(np.random.PCG64(SEED))
    block = max(1, min(RESAMPLES, AT_ONCE // len(curve.rows)))
    for start in range(0, RESAMPLES, block):
        count = min(block, RESAMPLES - start)
        if not curve.sharing:
            yield _drawn_within(generator, curve.strata, count)
            continue
        total = np.ones((count, len(curve.rows)))
        for codes in curve.sharing.values():
            total *= _drawn(generator, codes.max() + 1, count)[:, codes]
        yield total


def _drawn(generator, n: int, count: int) -> np.ndarray:
    """How often each of n is drawn in n draws, (count, n)."""
    picks = generator.integers(0, n, (count, n)) + n * np.arange(count)[:, None]
    return np.bincount(picks.ravel(), minlength=count * n).reshape(count, n).astype(float)


def _drawn_within(generator, strata: np.ndarray, count: int) -> np.ndarray:
    """How often each run is drawn, (count, r), if as many are drawn of each stratum as there are."""
    drawn = np.zeros((count, len(strata)))
    for k in np.unique(strata):
        mine = np.flatnonzero(strata == k)
        drawn[:, mine] = _drawn(generator, len(mine), count)
    return drawn
