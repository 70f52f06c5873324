"""Statistics of samples: rank correlations (Spearman), shares of failed runs, number of runs for a band."""

from typing import Any

import numpy as np
from scipy.stats import norm, rankdata, spearmanr

from netfall.study.answers.read import Study
from netfall.study.answers.samples import (
    MOST_CURVES,
    add_factor,
    is_seed,
    pair_codes,
    value_codes,
    varying_inputs,
)

RESPONSES = ("first_fracture", "detached_area", "tension_max", "utilisation_max", "displacement_max")
MIN_CORRELATION_SAMPLES = 8  # number of independent samples below which no correlation is reported
NORMAL_975 = 1.96  # 97.5 % quantile of the normal distribution


def drawn_inputs(study: Study) -> list[str]:
    """Return the numeric inputs that are drawn or have many values, except seeds."""
    samples = study.samples
    numbers = [
        name for name in varying_inputs(samples) if samples[name].dtype.kind in "if" and not is_seed(name)
    ]
    drawn = study.drawn or ()
    return [name for name in numbers if name in drawn or len(np.unique(samples[name])) > MOST_CURVES]


def responses(study: Study) -> dict[str, np.ndarray]:
    """Return outcomes (N,) by name: columns with more than one value; nan for excluded samples.

    Samples without an equilibrium have the worst outcome: a fracture at 0 s, no roof, infinite values. In
    samples without a fracture the time of the first fracture is infinite.
    """
    worst = {"first_fracture": 0.0, "detached_area": 1.0}
    no_equilibrium = study.samples["state"] == "no_equilibrium"
    columns = {}
    for name in RESPONSES:
        values = np.where(study.finished, study.samples[name], np.nan)
        if np.isfinite(values).any():
            values[study.finished & np.isnan(values) & (name == "first_fracture")] = np.inf
            columns[name] = np.where(no_equilibrium, worst.get(name, np.inf), values)
    return {name: v for name, v in columns.items() if len(np.unique(v[~np.isnan(v)])) > 1}


def draw_codes(study: Study) -> np.ndarray:
    """Return codes (N,) that are equal for dependent samples: those with the same random draws.

    Draws repeat at each combination of [vary]. If inputs vary independently, the input with the most values
    determines the codes.
    """
    groups: dict[str, np.ndarray] = {}
    for name in drawn_inputs(study) + [name for name in varying_inputs(study.samples) if is_seed(name)]:
        add_factor(groups, name, value_codes(study.samples[name]))
    return max(groups.values(), key=np.max)


def chosen_inputs(study: Study) -> list[str]:
    """Return the inputs that are not random: those of [vary], or if unknown, those with few values."""
    random = drawn_inputs(study) if study.drawn is None else study.drawn
    return [name for name in varying_inputs(study.samples) if name not in random and not is_seed(name)]


def combination_codes(study: Study, name: str) -> np.ndarray:
    """Return codes (N,) of the combinations of the chosen inputs other than `name`."""
    codes = np.zeros(len(study.samples["state"]), int)
    for other in chosen_inputs(study):
        if other != name:
            codes = pair_codes(codes, value_codes(study.samples[other]))
    return codes


def spearman(
    x: np.ndarray, y: np.ndarray, draws: np.ndarray, combination: np.ndarray
) -> tuple[float, int, bool]:
    """Compute the rank correlation of the known pairs (N,); nan if few are independent.

    draws : (N,) of `draw_codes`; combination : (N,) of `combination_codes`, within which values are ranked

    Returns the correlation, the number of independent pairs, and whether it is significant at 5 %.
    """
    both = ~np.isnan(x) & ~np.isnan(y)
    x, y, draws, combination = x[both], y[both], draws[both], combination[both]
    n = len(np.unique(draws))
    ranks = np.zeros((2, len(x)))
    for code in np.unique(combination):
        rows = np.flatnonzero(combination == code)
        ranks[:, rows] = rankdata([x[rows], y[rows]], axis=1) / (len(rows) + 1)
    if n < MIN_CORRELATION_SAMPLES or (np.ptp(ranks, axis=1) == 0.0).any():
        return np.nan, n, False
    rho = float(spearmanr(*ranks).statistic)
    return rho, n, abs(rho) * np.sqrt(n - 1) > NORMAL_975


MAX_SPEED_BINS = 8  # largest number of speeds in a table or plot; more are binned
HALF_WIDTHS = (0.2, 0.15, 0.1, 0.07, 0.05, 0.03, 0.02, 0.01, 0.005)  # half widths of bands to recommend
# half width of a band above which its width does not scale with 1 / sqrt(samples)
MAX_SCALED_HALF_WIDTH = 0.35


def bin_speeds(speed: np.ndarray, runs: np.ndarray, failed: np.ndarray) -> tuple[Any, ...]:
    """Return speeds (b,), runs (b,) and failures (b,), binned from speeds (s,) if these are many.

    Bins have about equal numbers of runs; the speed of a bin is the mean over its runs.
    """
    if len(speed) > MAX_SPEED_BINS:
        place = MAX_SPEED_BINS * (np.cumsum(runs) - runs) // max(runs.sum(), 1)
        place, columns = np.minimum(place, MAX_SPEED_BINS - 1), (runs, failed, runs * speed)
        counts, failed, weighted = (np.bincount(place, values, MAX_SPEED_BINS) for values in columns)
        speed, runs = weighted / np.maximum(counts, 1), counts
    used = runs > 0
    return speed[used], runs[used].astype(int), failed[used].astype(int)


def wilson(runs: np.ndarray, failed: np.ndarray) -> np.ndarray:
    """Return the 95 % intervals (2, b) of the shares of independent runs that failed (Wilson 1927).

    failed : (b,) need not be integers, if several dependent runs count as one
    """
    share, extra = failed / runs, norm.ppf(0.975) ** 2 / runs
    half = np.sqrt(extra * (share * (1.0 - share) + 0.25 * extra))
    low, high = ((share + 0.5 * extra + sign * half) / (1.0 + extra) for sign in (-1.0, 1.0))
    return np.array([np.clip(low, 0.0, share), np.clip(high, share, 1.0)])  # rounding


def interval_text(value: float, interval: np.ndarray, digits: int) -> str:
    """Return a value with its interval (2,) as text: "38.2 (37.2..39.3)", "46.6 (> 42)"; "none" for nan."""
    if not np.isfinite(value):
        return "none"
    text = f"{value:.{digits}g}"
    if np.isnan(interval).any():
        return f"{text} (no interval)"
    low, high = (f"{v:.{digits}g}" for v in interval)
    if np.isfinite(interval[1]):
        return f"{text} ({low}..{high})" if interval[0] > 0 else f"{text} (< {high})"
    return f"{text} (> {low})" if interval[0] > 0 else f"{text} (any)"


def next_half_width(half: float, samples: int) -> tuple[float, int]:
    """Return the next narrower half width to recommend, and the samples that it needs, to two digits.

    The width is proportional to 1 / sqrt(samples) unless it spans most of the range. (nan, 0): no
    recommendation.
    """
    if not HALF_WIDTHS[-1] < half < MAX_SCALED_HALF_WIDTH:
        return np.nan, 0
    target = next((a for a in HALF_WIDTHS if a <= 0.8 * half), HALF_WIDTHS[-1])
    needed = samples * (half / target) ** 2
    digit = 10.0 ** max(0, int(np.log10(needed)) - 1)
    return target, int(digit * np.ceil(needed / digit - 1e-9))
