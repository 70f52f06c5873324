"""Random values for the keys of a job, as space-filling or independent samples.

They are bitwise the same on any processor, so that shards of a study can run on different machines. Points
of Sobol sequences and Latin hypercubes are permuted and scrambled integers, divided by powers of two or by
the count. numpy's generator returns the same numbers everywhere. Logarithms, exponentials and quantiles come
from netfall.core.
"""

import warnings
from typing import Any

import numpy as np

from netfall.core.functions import exp, log, log1p, quantile

METHODS = ("sobol", "latin_hypercube", "random")
# Parameters of each distribution.
DISTRIBUTIONS = {
    "normal": ("mean", "deviation"),
    "lognormal": ("mean", "deviation"),
    "uniform": ("from", "to"),
    "integer": ("from", "to"),  # both included
}
LEAST = 2.0**-53  # smallest probability: the quantile of a distribution at 0 is infinite


def draw(method: str, count: int, seed: int, distributions: list[dict[str, Any]]) -> np.ndarray:
    """Return values (count, k), a column for each distribution.

    method : one of METHODS; distributions : `distribution` and its two numbers, as in a study file
    """
    probabilities = np.clip(_probabilities(method, count, seed, len(distributions)), LEAST, 1.0 - LEAST)
    return np.column_stack(
        [quantiles(distribution, probabilities[:, k]) for k, distribution in enumerate(distributions)]
    )


def _probabilities(method: str, count: int, seed: int, columns: int) -> np.ndarray:
    """Return probabilities (count, columns) from 0 to 1."""
    if method == "random":
        return np.random.default_rng(seed).random((count, columns))
    from scipy.stats import qmc

    engine = {"sobol": qmc.Sobol, "latin_hypercube": qmc.LatinHypercube}[method](columns, rng=seed)
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", UserWarning
        )  # count is no power of two: `read_study_plan` has its own note
        return np.asarray(engine.random(count))


def quantiles(distribution: dict[str, Any], share: np.ndarray) -> np.ndarray:
    """Return the quantiles of a distribution at these probabilities.

    Mean and deviation are those of the values, also for the lognormal distribution.
    """
    kind = distribution["distribution"]
    first, second = (float(distribution[name]) for name in DISTRIBUTIONS[kind])
    if kind == "uniform":
        return first + (second - first) * share
    if kind == "integer":
        return np.floor(first + (second + 1.0 - first) * share)
    if kind == "normal":
        return first + second * quantile(share)
    ratio = second / first
    log_variance = log1p(ratio * ratio)
    return exp(log(first) - 0.5 * log_variance + np.sqrt(log_variance) * quantile(share))
