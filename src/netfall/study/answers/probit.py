"""Lognormal fragility curve by maximum likelihood: p(speed) = Phi(ln(speed / median) / dispersion).

The likelihood is the product of binomial ones over the speeds (Baker 2015, Earthquake Spectra 31(1), eq. 11).
Its logarithm is concave in a and b of z = a + b ln(speed). Newton's method finds the maximum, for many
samples at once. If a speed separates failures and survivals, no maximum exists; counts show this beforehand.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.special import log_ndtr, ndtr

from netfall.core.arrays import BoolArray, FloatArray

FITTED, NONE_FAILED, ALL_FAILED, ONE_SPEED, SEPARATED, FALLING, NOT_FOUND = range(7)
ROOT_TWO_PI = np.sqrt(2.0 * np.pi)
MAX_ITERATIONS = 100  # largest number of iterations; about eight are needed
MAX_CHANGE = 2.0  # largest change of z in an iteration
AT_ONCE = 8000  # counts per block, which fit in the processor's cache
# relative change at which iterations end; convergence is quadratic, so the error is its square
CONVERGED_CHANGE = 1e-7


class FragilityFits(NamedTuple):
    """Curves of R samples; for samples without a curve, bounds.

    median, dispersion : (R,) [m/s], [-]; nan: none
    verdict : (R,)        FITTED, or why there is no curve
    below, above : (R,) speeds up to which nothing failed (0: none), from which everything failed (inf: none)
    mixed, share : (R,)   the speed between these with the share that failed; nan unless there is exactly one
    """

    median: np.ndarray
    dispersion: np.ndarray
    verdict: np.ndarray
    below: np.ndarray
    above: np.ndarray
    mixed: np.ndarray
    share: np.ndarray


def fit(speed: np.ndarray, runs: np.ndarray, failed: np.ndarray) -> FragilityFits:
    """Fit curves to samples (R, s): runs and failures at each speed (s,), ascending [m/s]."""
    runs, failed = np.broadcast_arrays(np.atleast_2d(runs), np.atleast_2d(failed))
    below, above, between = _separation(speed, runs, failed)
    verdict = _verdict(speed, runs, failed, between)
    median, dispersion, mixed, share = np.full((4, len(runs)), np.nan)
    fitted_rows = np.flatnonzero(verdict == FITTED)
    if len(fitted_rows):
        for block in np.array_split(fitted_rows, -(-len(fitted_rows) * len(speed) // AT_ONCE)):
            median[block], dispersion[block], converged = _maximise_likelihood(
                speed, runs[block].T, failed[block].T
            )
            verdict[block[~converged]] = NOT_FOUND
    row, column = np.nonzero(between & (between.sum(1) == 1)[:, None])
    mixed[row], share[row] = speed[column], failed[row, column] / runs[row, column]
    return FragilityFits(median, dispersion, verdict, below, above, mixed, share)


def _separation(
    speed: np.ndarray, runs: np.ndarray, failed: np.ndarray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Find the speeds (R,) up to which nothing failed and from which everything failed.

    Also return which speeds (R, s) with runs lie between them.
    """
    used = runs > 0
    no_failure = np.logical_and.accumulate(failed == 0, axis=1)
    all_failed = np.logical_and.accumulate((failed == runs)[:, ::-1], axis=1)[:, ::-1]
    below = np.max(np.where(no_failure & used, speed, 0.0), axis=1)
    above = np.min(np.where(all_failed & used, speed, np.inf), axis=1)
    return below, above, used & ~no_failure & ~all_failed


def _verdict(speed: np.ndarray, runs: np.ndarray, failed: np.ndarray, between: np.ndarray) -> np.ndarray:
    """Return whether the likelihood has a maximum with a rising curve (R,), or why not.

    It has one if at least two speeds lie between the speeds without failures and those without survivals, and
    if failures grow with the speed.
    """
    total, all_runs = failed.sum(1), runs.sum(1)
    u = np.log(speed) - np.log(speed).mean()
    growth = np.sum((failed * all_runs[:, None] - runs * total[:, None]) * u, axis=1)
    rounding = 1e-12 * total * np.sum(runs * np.abs(u), axis=1)  # rounding error if all shares are equal
    return np.select(
        [total == 0, total == all_runs, (runs > 0).sum(1) == 1, between.sum(1) <= 1, growth <= rounding],
        [NONE_FAILED, ALL_FAILED, ONE_SPEED, SEPARATED, FALLING],
        FITTED,
    )


def median_bounds(fits: FragilityFits) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper bounds (R,) of the median [m/s], which are equal if there is a curve."""
    fitted, unbounded = fits.verdict == FITTED, np.isin(fits.verdict, (FALLING, NOT_FOUND))
    low = np.select([fitted, unbounded, fits.share <= 0.5], [fits.median, 0.0, fits.mixed], fits.below)
    high = np.select([fitted, unbounded, fits.share >= 0.5], [fits.median, np.inf, fits.mixed], fits.above)
    return low, high


def dispersion_bounds(fits: FragilityFits) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper bounds (R,) of the dispersion.

    They are 0 if a speed separates failures, infinite if failures do not grow with the speed.
    """
    cases = [fits.verdict == FITTED, fits.verdict == SEPARATED, fits.verdict == FALLING]
    values: list[Any] = [fits.dispersion, 0.0, np.inf]
    return np.select(cases, values, 0.0), np.select(cases, values, np.inf)


def _maximise_likelihood(speed: np.ndarray, runs: np.ndarray, failed: np.ndarray) -> Any:
    """Maximise the likelihood of counts (s, R) by Newton's method.

    Returns median, dispersion and convergence, (R,) each.
    """
    mean_log = np.log(speed).mean()
    u = np.log(speed) - mean_log
    scale = max(np.abs(u).max(), 1e-300)
    u = (u / scale)[:, None]
    a, b = np.zeros((2, runs.shape[1]))
    for _ in range(MAX_ITERATIONS):
        da, db = _newton_step(a, b, u, runs, failed)
        change = np.abs(da) + np.abs(db)
        share = np.minimum(1.0, MAX_CHANGE / np.maximum(change, 1e-300))
        a, b = a + share * da, b + share * db
        converged = change < CONVERGED_CHANGE * (1.0 + np.abs(a) + np.abs(b))
        if converged.all():
            break
    return np.exp(mean_log - scale * a / b), scale / b, converged & (b > 0)


def _newton_step(a: Any, b: Any, u: Any, runs: Any, failed: Any) -> Any:
    """Return the Newton step of the log-likelihood at (a, b)."""
    z = a + b * u
    failed_ratio, survived_ratio = (np.exp(-0.5 * z * z - log_ndtr(side)) / ROOT_TWO_PI for side in (z, -z))
    slope = failed * failed_ratio - (runs - failed) * survived_ratio
    curvature = failed * failed_ratio * (failed_ratio + z) + (runs - failed) * survived_ratio * (
        survived_ratio - z
    )
    aa, ab, bb = curvature.sum(0), (curvature * u).sum(0), (curvature * u * u).sum(0)
    ra, rb = slope.sum(0), (slope * u).sum(0)
    det = aa * bb - ab * ab
    return (bb * ra - ab * rb) / det, (aa * rb - ab * ra) / det


def share_bounds(speed: np.ndarray, fits: FragilityFits) -> tuple[np.ndarray, np.ndarray]:
    """Return bounds (R, g) of the share that fails at speeds (g,), which are equal if there is a curve.

    Without a curve they bound any non-decreasing function that agrees with the known shares.
    """
    column = {name: values[:, None] for name, values in fits._asdict().items()}
    fitted = column["verdict"] == FITTED
    median, dispersion = (np.where(fitted, column[name], 1.0) for name in ("median", "dispersion"))
    share = ndtr((np.log(speed) - np.log(median)) / dispersion)
    unbounded = np.isin(column["verdict"], (FALLING, NOT_FOUND))
    mixed, known = column["mixed"], column["share"]
    smallest = np.select([unbounded, speed >= column["above"], speed >= mixed], [0.0, 1.0, known], 0.0)
    largest = np.select([unbounded, speed <= column["below"], speed <= mixed], [1.0, 0.0, known], 1.0)
    return np.where(fitted, share, smallest), np.where(fitted, share, largest)
