"""Observed shares of runs that failed, and how many runs a narrower band of the fitted curve would take."""

import numpy as np
from scipy.stats import binomtest

MOST_SPEEDS = 8  # in a table or a picture; of more, neighbours are put together
NARROWER = (0.2, 0.15, 0.1, 0.07, 0.05, 0.03, 0.02, 0.01, 0.005)  # half widths that a study may aim at
WIDEST = 0.35  # half width of a band of shares, above which it says nothing of how it would shrink


def binned(speed: np.ndarray, runs: np.ndarray, failed: np.ndarray) -> tuple:
    """Speeds (b,), runs (b,) and failures (b,) of speeds (s,): as they are if there are few, else put
    together in bins of about as many runs, each at the mean of its runs.
    """
    if len(speed) > MOST_SPEEDS:
        place = np.minimum(MOST_SPEEDS * (np.cumsum(runs) - runs) // max(runs.sum(), 1), MOST_SPEEDS - 1)
        total = lambda values: np.bincount(place, values, MOST_SPEEDS)
        counts = total(runs)
        speed, runs, failed = total(runs * speed) / np.maximum(counts, 1), counts, total(failed)
    used = runs > 0
    return speed[used], runs[used].astype(int), failed[used].astype(int)


def wilson(runs: np.ndarray, failed: np.ndarray) -> np.ndarray:
    """Return the intervals (2, b) at 95 % of the shares of independent runs that failed (Wilson 1927)."""
    intervals = [binomtest(int(k), int(n)).proportion_ci(0.95, "wilson") for n, k in zip(runs, failed)]
    return np.reshape([(each.low, each.high) for each in intervals], (-1, 2)).T


def with_interval(value: float, interval: np.ndarray, digits: int) -> str:
    """A value with its interval (2,), in words: "38.2 (37.2..39.3)", "46.6 (> 42)"; "none" of nan."""
    if not np.isfinite(value):
        return "none"
    text = f"{value:.{digits}g}"
    if np.isnan(interval).any():
        return f"{text} (no interval)"
    low, high = (f"{v:.{digits}g}" for v in interval)
    if np.isfinite(interval[1]):
        return f"{text} ({low}..{high})" if interval[0] > 0 else f"{text} (< {high})"
    return f"{text} (> {low})" if interval[0] > 0 else f"{text} (any)"


def half_width(band: np.ndarray) -> float:
    """Half the width of a band (2,)."""
    return 0.5 * (band[1] - band[0])


def narrower(half: float, samples: int) -> tuple[float, int]:
    """The next narrower half width worth aiming at, and the samples, rounded up to two digits, that it takes.

    The width goes with 1 / sqrt(samples), but where it spans most of what there is. nan, 0: nothing to say.
    """
    if not NARROWER[-1] < half < WIDEST:
        return np.nan, 0
    aim = next((a for a in NARROWER if a <= 0.8 * half), NARROWER[-1])
    needed = samples * (half / aim) ** 2
    digit = 10.0 ** max(0, int(np.log10(needed)) - 1)
    return aim, int(digit * np.ceil(needed / digit - 1e-9))
