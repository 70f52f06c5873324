"""Random draws of a job's values, filling their range evenly or by chance.

They have the same bits on any processor, for the parts of a study that are run on several. Points of Sobol's
sequence and of Latin hypercubes are whole numbers, permuted and scrambled as such, over powers of two or the
count, and numpy's generator gives the same on all; logarithms, exponentials and quantiles are our own.
"""

import warnings

import numpy as np

from netfall.numerics.functions import exp, log, log1p
from netfall.numerics.normal import quantile

METHODS = ("sobol", "latin_hypercube", "random")
# What each distribution is given by.
DISTRIBUTIONS = {
    "normal": ("mean", "deviation"),
    "lognormal": ("mean", "deviation"),
    "uniform": ("from", "to"),
    "integer": ("from", "to"),  # both included
}
LEAST = 2.0**-53  # of a share: the inverse of a distribution at 0 is infinite


def draw(method: str, count: int, seed: int, distributions: list[dict]) -> np.ndarray:
    """Values (count, k), a column for each distribution.

    method : one of METHODS; distributions : `distribution` and its two numbers, as in a study file
    """
    shares = np.clip(_shares(method, count, seed, len(distributions)), LEAST, 1.0 - LEAST)
    return np.column_stack([values_at(each, shares[:, k]) for k, each in enumerate(distributions)])


def _shares(method: str, count: int, seed: int, columns: int) -> np.ndarray:
    """Shares (count, columns) from 0 to 1."""
    if method == "random":
        return np.random.default_rng(seed).random((count, columns))
    from scipy.stats import qmc

    engine = {"sobol": qmc.Sobol, "latin_hypercube": qmc.LatinHypercube}[method](columns, rng=seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of a count that is no power of two: `plan` notes it
        return engine.random(count)


def values_at(distribution: dict, share: np.ndarray) -> np.ndarray:
    """Values at which a distribution reaches these shares; mean and deviation are those of the values."""
    kind = distribution["distribution"]
    first, second = (float(distribution[name]) for name in DISTRIBUTIONS[kind])
    if kind == "uniform":
        return first + (second - first) * share
    if kind == "integer":
        return np.floor(first + (second + 1.0 - first) * share)
    if kind == "normal":
        return first + second * quantile(share)
    ratio = second / first
    spread = log1p(ratio * ratio)  # the variance of the logarithm
    return exp(log(first) - 0.5 * spread + np.sqrt(spread) * quantile(share))
