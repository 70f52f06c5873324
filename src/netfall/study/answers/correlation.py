"""Rank correlations (Spearman) between drawn inputs and outcomes of the samples of a study."""

import numpy as np
from scipy.stats import spearmanr

from netfall.study.answers.read import Study
from netfall.study.answers.samples import MOST_CURVES, is_seed, varying_inputs

RESPONSES = ("first_fracture", "detached_area", "tension_max", "utilisation_max", "displacement_max")
FEWEST = 8  # samples, below which no correlation is reported


def drawn_inputs(study: Study) -> list[str]:
    """Return the numeric inputs with many values, except seeds: drawn or finely varied inputs."""
    samples = study.samples
    numbers = [
        name for name in varying_inputs(samples) if samples[name].dtype.kind in "if" and not is_seed(name)
    ]
    return [name for name in numbers if len(np.unique(samples[name])) > MOST_CURVES]


def responses(study: Study) -> dict[str, np.ndarray]:
    """Return outcomes (N,) by name: columns with more than one value; nan for unfinished samples."""
    columns = {name: np.where(study.finished, study.samples[name], np.nan) for name in RESPONSES}
    return {name: v for name, v in columns.items() if len(np.unique(v[np.isfinite(v)])) > 1}


def spearman(x: np.ndarray, y: np.ndarray) -> tuple[float, int]:
    """Compute the rank correlation of the finite pairs (N,), and their number; nan if they are few."""
    both = np.isfinite(x) & np.isfinite(y)
    n = int(both.sum())
    if n < FEWEST or np.ptp(x[both]) == 0.0 or np.ptp(y[both]) == 0.0:
        return np.nan, n
    return float(spearmanr(x[both], y[both]).statistic), n
