"""Rank correlations (Spearman) of what a study draws with what its members gave."""

import numpy as np
from scipy.stats import spearmanr

from netfall.study.answers.read import Study
from netfall.study.answers.samples import MOST_CURVES, inputs_of, is_seed

RESPONSES = ("first_fracture", "roof_lost", "tension_max", "utilisation_max", "displacement_max")
FEWEST = 8  # members, below which nothing is told


def drawn_inputs(study: Study) -> list[str]:
    """Return the numeric inputs with many values, except seeds: those that were drawn or varied finely."""
    members = study.members
    numbers = [name for name in inputs_of(members) if members[name].dtype.kind in "if" and not is_seed(name)]
    return [name for name in numbers if len(np.unique(members[name])) > MOST_CURVES]


def responses(study: Study) -> dict[str, np.ndarray]:
    """What members (N,) gave, by name: columns with more than one value; nan where one is not finished."""
    columns = {name: np.where(study.finished, study.members[name], np.nan) for name in RESPONSES}
    return {name: v for name, v in columns.items() if len(np.unique(v[np.isfinite(v)])) > 1}


def rank_correlations(study: Study) -> dict[str, dict[str, tuple[float, int]]]:
    """Correlation, and members that it is of, for each input that was drawn and each response."""
    given = responses(study)
    return {
        name: {what: spearman(study.members[name].astype(float), y) for what, y in given.items()}
        for name in drawn_inputs(study)
    }


def spearman(x: np.ndarray, y: np.ndarray) -> tuple[float, int]:
    """The rank correlation of the pairs (N,) that are finite, and their number; nan if they are few."""
    both = np.isfinite(x) & np.isfinite(y)
    n = int(both.sum())
    if n < FEWEST:
        return np.nan, n
    if np.ptp(x[both]) == 0.0 or np.ptp(y[both]) == 0.0:
        return np.nan, n
    return float(spearmanr(x[both], y[both]).statistic), n
