"""Random draws of a job's values, filling their range evenly or by chance."""

import math
import warnings

import numpy as np

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
    return np.column_stack([_values(each, shares[:, k]) for k, each in enumerate(distributions)])


def _shares(method: str, count: int, seed: int, columns: int) -> np.ndarray:
    """Shares (count, columns) from 0 to 1."""
    if method == "random":
        return np.random.default_rng(seed).random((count, columns))
    from scipy.stats import qmc

    engine = {"sobol": qmc.Sobol, "latin_hypercube": qmc.LatinHypercube}[method](columns, rng=seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of a count that is no power of two: `plan` notes it
        return engine.random(count)


def _values(distribution: dict, share: np.ndarray) -> np.ndarray:
    """Values at which a distribution reaches these shares; mean and deviation are those of the values."""
    kind = distribution["distribution"]
    first, second = (float(distribution[name]) for name in DISTRIBUTIONS[kind])
    if kind == "uniform":
        return first + (second - first) * share
    if kind == "integer":
        return np.floor(first + (second + 1.0 - first) * share)
    from scipy.special import ndtri

    if kind == "normal":
        return first + second * ndtri(share)
    width = math.sqrt(math.log1p((second / first) ** 2))
    return np.exp(math.log(first) - 0.5 * width**2 + width * ndtri(share))
