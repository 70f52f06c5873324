"""The lognormal fragility curve of largest likelihood: p(speed) = Phi(ln(speed / median) / dispersion).

The likelihood is the product of binomial ones over the speeds (Baker 2015, Earthquake Spectra 31(1), eq. 11).
In z = a + b ln(speed) its logarithm is concave; Newton's method finds the one peak, for many samples at once.
There is none where failures and survivals are separated by a speed: that is decided by counting, beforehand.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import log_ndtr, ndtr

FITTED, NONE_FAILED, ALL_FAILED, ONE_SPEED, SEPARATED, FALLING, NOT_FOUND = range(7)
ROOT_TWO_PI = np.sqrt(2.0 * np.pi)
MOST = 100  # iterations; about eight are needed
LONGEST = 2.0  # change of z in an iteration
AT_ONCE = 8000  # counts: what stays in the cache
CLOSE = 1e-7  # change of z after which one more iteration leaves nothing: the error is squared by each


class Fits(NamedTuple):
    """Curves of R samples; of a sample without one, what is known nevertheless.

    median, dispersion : (R,) [m/s], [-]; nan: none
    verdict : (R,)        FITTED, or why there is no curve
    below, above : (R,)   speeds up to which nothing failed (0: none), from which everything did (inf: none)
    mixed, share : (R,)   the speed between these, if it is one alone, with the share that failed; else nan
    """

    median: np.ndarray
    dispersion: np.ndarray
    verdict: np.ndarray
    below: np.ndarray
    above: np.ndarray
    mixed: np.ndarray
    share: np.ndarray


def fit(speed: np.ndarray, runs: np.ndarray, failed: np.ndarray) -> Fits:
    """The curves of samples (R, s): how many ran at each speed (s,), ascending [m/s], and how many failed."""
    runs, failed = np.broadcast_arrays(np.atleast_2d(runs), np.atleast_2d(failed))
    below, above, between = _separation(speed, runs, failed)
    verdict = _verdict(speed, runs, failed, between)
    median, dispersion, mixed, share = np.full((4, len(runs)), np.nan)
    todo = np.flatnonzero(verdict == FITTED)
    if len(todo):
        for some in np.array_split(todo, -(-len(todo) * len(speed) // AT_ONCE)):
            median[some], dispersion[some], found = _peaks(speed, runs[some].T, failed[some].T)
            verdict[some[~found]] = NOT_FOUND
    row, place = np.nonzero(between & (between.sum(1) == 1)[:, None])
    mixed[row], share[row] = speed[place], failed[row, place] / runs[row, place]
    return Fits(median, dispersion, verdict, below, above, mixed, share)


def _separation(speed: np.ndarray, runs: np.ndarray, failed: np.ndarray):
    """The speeds (R,) up to which nothing failed and from which everything did, and which speeds (R, s) with
    runs lie between.
    """
    used = runs > 0
    spared = np.logical_and.accumulate(failed == 0, axis=1)
    lost = np.logical_and.accumulate((failed == runs)[:, ::-1], axis=1)[:, ::-1]
    below = np.max(np.where(spared & used, speed, 0.0), axis=1)
    above = np.min(np.where(lost & used, speed, np.inf), axis=1)
    return below, above, used & ~spared & ~lost


def _verdict(speed: np.ndarray, runs: np.ndarray, failed: np.ndarray, between: np.ndarray) -> np.ndarray:
    """Whether the likelihood has a peak with a curve that rises (R,): it does if some fail at a lower speed
    than some that hold, other than at one speed alone, and failures grow with the speed.
    """
    total, all_runs = failed.sum(1), runs.sum(1)
    u = np.log(speed) - np.log(speed).mean()
    growth = np.sum((failed * all_runs[:, None] - runs * total[:, None]) * u, axis=1)
    nothing = 1e-12 * total * np.sum(runs * np.abs(u), axis=1)  # rounding, where the shares are all the same
    return np.select(
        [total == 0, total == all_runs, (runs > 0).sum(1) == 1, between.sum(1) <= 1, growth <= nothing],
        [NONE_FAILED, ALL_FAILED, ONE_SPEED, SEPARATED, FALLING],
        FITTED,
    )


def median_bounds(fits: Fits) -> tuple[np.ndarray, np.ndarray]:
    """Between which speeds (R,) the median lies: the two are the same where there is a curve."""
    fitted, nothing = fits.verdict == FITTED, np.isin(fits.verdict, (FALLING, NOT_FOUND))
    low = np.select([fitted, nothing, fits.share <= 0.5], [fits.median, 0.0, fits.mixed], fits.below)
    high = np.select([fitted, nothing, fits.share >= 0.5], [fits.median, np.inf, fits.mixed], fits.above)
    return low, high


def dispersion_bounds(fits: Fits) -> tuple[np.ndarray, np.ndarray]:
    """Likewise of the dispersion; 0 where speeds separate failures, infinite where these do not grow."""
    cases = [fits.verdict == FITTED, fits.verdict == SEPARATED, fits.verdict == FALLING]
    values = [fits.dispersion, 0.0, np.inf]
    return np.select(cases, values, 0.0), np.select(cases, values, np.inf)


def _peaks(speed: np.ndarray, runs: np.ndarray, failed: np.ndarray):
    """Median, dispersion and whether Newton's method ended, (R,) each, of counts (s, R) that have a peak."""
    middle = np.log(speed).mean()
    u = np.log(speed) - middle
    scale = max(np.abs(u).max(), 1e-300)
    u = (u / scale)[:, None]
    a, b = np.zeros((2, runs.shape[1]))
    for _ in range(MOST):
        da, db = _newton_step(a, b, u, runs, failed)
        change = np.abs(da) + np.abs(db)
        share = np.minimum(1.0, LONGEST / np.maximum(change, 1e-300))
        a, b = a + share * da, b + share * db
        ready = change < CLOSE * (1.0 + np.abs(a) + np.abs(b))
        if ready.all():
            break
    return np.exp(middle - scale * a / b), scale / b, ready & (b > 0)


def _newton_step(a, b, u, runs, failed):
    """The step to the peak of the quadratic that the logarithm of the likelihood is near (a, b)."""
    z = a + b * u
    up, down = (np.exp(-0.5 * z * z - log_ndtr(side)) / ROOT_TWO_PI for side in (z, -z))
    slope = failed * up - (runs - failed) * down
    bend = failed * up * (up + z) + (runs - failed) * down * (down - z)
    aa, ab, bb = bend.sum(0), (bend * u).sum(0), (bend * u * u).sum(0)
    ra, rb = slope.sum(0), (slope * u).sum(0)
    det = aa * bb - ab * ab
    return (bb * ra - ab * rb) / det, (aa * rb - ab * ra) / det


def share_bounds(speed: np.ndarray, fits: Fits) -> tuple[np.ndarray, np.ndarray]:
    """Bounds (R, g) of the share that fails at speeds (g,): the two are the same where there is a curve, else
    what is left to one that grows from nothing to everything through the share that is known.
    """
    column = {name: values[:, None] for name, values in fits._asdict().items()}
    fitted = column["verdict"] == FITTED
    median, dispersion = (np.where(fitted, column[name], 1.0) for name in ("median", "dispersion"))
    share = ndtr((np.log(speed) - np.log(median)) / dispersion)
    nothing = np.isin(column["verdict"], (FALLING, NOT_FOUND))
    mixed, known = column["mixed"], column["share"]
    least = np.select([nothing, speed >= column["above"], speed >= mixed], [0.0, 1.0, known], 0.0)
    most = np.select([nothing, speed <= column["below"], speed <= mixed], [1.0, 0.0, known], 1.0)
    return np.where(fitted, share, least), np.where(fitted, share, most)
