"""Observed shares of failed runs, and the number of runs for a narrower band of the fitted curve."""

from typing import Any

import numpy as np
from scipy.stats import binomtest

MAX_SPEED_BINS = 8  # largest number of speeds in a table or plot; more are binned
NARROWER = (0.2, 0.15, 0.1, 0.07, 0.05, 0.03, 0.02, 0.01, 0.005)  # half widths of bands to recommend
WIDEST = 0.35  # half width of a band above which its width does not scale with 1 / sqrt(samples)


def bin_speeds(speed: np.ndarray, runs: np.ndarray, failed: np.ndarray) -> tuple[Any, ...]:
    """Return speeds (b,), runs (b,) and failures (b,), binned from speeds (s,) if there are many.

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
    """Return the 95 % intervals (2, b) of the shares of independent runs that failed (Wilson 1927)."""
    intervals = [binomtest(int(k), int(n)).proportion_ci(0.95, "wilson") for n, k in zip(runs, failed)]
    return np.reshape([(interval.low, interval.high) for interval in intervals], (-1, 2)).T


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
    if not NARROWER[-1] < half < WIDEST:
        return np.nan, 0
    target = next((a for a in NARROWER if a <= 0.8 * half), NARROWER[-1])
    needed = samples * (half / target) ** 2
    digit = 10.0 ** max(0, int(np.log10(needed)) - 1)
    return target, int(digit * np.ceil(needed / digit - 1e-9))
