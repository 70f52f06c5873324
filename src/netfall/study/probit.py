"""The lognormal fragility curve of largest likelihood: p(speed) = Phi(ln(speed / median) / dispersion).

The likelihood is the product of binomial ones over the speeds (Baker 2015, Earthquake Spectra 31(1), eq. 11).
In z = a + b ln(speed) its logarithm is concave; Newton's method finds the one peak, for many samples at once.
There is none where failures and survivals are separated by a speed: that is decided by counting, beforehand.
"""

from typing import NamedTuple

import numpy as np

from netfall.study.normal import cdf, exp, inverse_mills, log

FITTED, NONE_FAILED, ALL_FAILED, ONE_SPEED, SEPARATED, FALLING, NOT_FOUND = range(7)
MOST = 100  # iterations; about eight are needed
LONGEST = 2.0  # change of z in an iteration
CLOSE = 1e-7  # change of z after which one more iteration leaves nothing: the error is squared by each


class Fits(NamedTuple):
    """Curves of R samples. Where a sample has none, its median is known to lie between two bounds.

    median, dispersion : (R,) [m/s], [-]; nan: none
    low, high : (R,) [m/s]           bounds of the median; the median itself where there is a fit
    least, most : (R,)               bounds of the dispersion, likewise
    verdict : (R,)                   FITTED, or why there is no fit
    """

    median: np.ndarray
    dispersion: np.ndarray
    low: np.ndarray
    high: np.ndarray
    least: np.ndarray
    most: np.ndarray
    verdict: np.ndarray


def fit(speed: np.ndarray, runs: np.ndarray, failed: np.ndarray) -> Fits:
    """The curves of samples (R, s): how many ran at each speed (s,), ascending [m/s], and how many failed."""
    runs, failed = np.broadcast_arrays(np.atleast_2d(runs), np.atleast_2d(failed))
    below, above, verdict = _separation(speed, runs, failed)
    median, dispersion = np.full((2, len(runs)), np.nan)
    todo = np.flatnonzero(verdict == FITTED)
    if len(todo):
        median[todo], dispersion[todo], found = _peaks(speed, runs[todo].T, failed[todo].T)
        verdict[todo[~found]] = NOT_FOUND
    bounds = np.select(
        [verdict == NONE_FAILED, verdict == ALL_FAILED, verdict == SEPARATED, verdict == FITTED],
        [
            (below, np.full_like(below, np.inf)),
            (np.zeros_like(above), above),
            (below, above),
            (median, median),
        ],
        np.array([[0.0], [np.inf]]),
    )
    fitted, sharp, flat = verdict == FITTED, verdict == SEPARATED, verdict == FALLING
    least = np.select([fitted, sharp, flat], [dispersion, 0.0, np.inf], 0.0)
    most = np.select([fitted, sharp, flat], [dispersion, 0.0, np.inf], np.inf)
    return Fits(median, dispersion, *bounds, least, most, verdict)


def _separation(speed: np.ndarray, runs: np.ndarray, failed: np.ndarray):
    """The speeds (R,) up to which nothing failed (0: none) and from which everything did (inf: none), and the
    verdict (R,) that follows from the counts (R, s).
    """
    used = runs > 0
    spared = np.logical_and.accumulate(failed == 0, axis=1)
    lost = np.logical_and.accumulate((failed == runs)[:, ::-1], axis=1)[:, ::-1]
    below = np.max(np.where(spared & used, speed, 0.0), axis=1)
    above = np.min(np.where(lost & used, speed, np.inf), axis=1)
    between = (used & ~spared & ~lost).sum(1)
    total, all_runs = failed.sum(1), runs.sum(1)
    u = log(speed) - log(speed).mean()
    growth = np.sum((failed * all_runs[:, None] - runs * total[:, None]) * u, axis=1)
    nothing = 1e-12 * total * np.sum(runs * np.abs(u), axis=1)  # rounding, where the shares are all the same
    verdict = np.select(
        [total == 0, total == all_runs, used.sum(1) == 1, between <= 1, growth <= nothing],
        [NONE_FAILED, ALL_FAILED, ONE_SPEED, SEPARATED, FALLING],
        FITTED,
    )
    return below, above, verdict


def _peaks(speed: np.ndarray, runs: np.ndarray, failed: np.ndarray):
    """Median, dispersion and whether Newton's method ended, (R,) each, of counts (s, R) that have a peak."""
    middle = log(speed).mean()
    u = log(speed) - middle
    scale = max(np.abs(u).max(), 1e-300)
    u = (u / scale)[:, None]
    a, b = np.zeros((2, runs.shape[1]))
    active, ready = np.arange(len(a)), np.zeros(len(a), bool)
    for _ in range(MOST):
        da, db = _newton_step(a[active], b[active], u, runs[:, active], failed[:, active])
        change = np.abs(da) + np.abs(db)
        share = np.minimum(1.0, LONGEST / np.maximum(change, 1e-300))
        a[active] += share * da
        b[active] += share * db
        ready[active] = change < CLOSE * (1.0 + np.abs(a[active]) + np.abs(b[active]))
        active = active[~ready[active]]
        if not len(active):
            break
    return exp(middle - scale * a / b), scale / b, ready & (b > 0)


def _newton_step(a, b, u, runs, failed):
    """The step to the peak of the quadratic that the logarithm of the likelihood is near (a, b)."""
    z = a + b * u
    up, down = inverse_mills(z), inverse_mills(-z)
    slope = failed * up - (runs - failed) * down
    bend = failed * up * (up + z) + (runs - failed) * down * (down - z)
    aa, ab, bb = bend.sum(0), (bend * u).sum(0), (bend * u * u).sum(0)
    ra, rb = slope.sum(0), (slope * u).sum(0)
    det = aa * bb - ab * ab
    return (bb * ra - ab * rb) / det, (aa * rb - ab * ra) / det


def curve(speed: np.ndarray, fits: Fits) -> tuple[np.ndarray, np.ndarray]:
    """Bounds (R, g) of the share that fails at speeds (g,): the two are the same where there is a fit, else
    0 and 1 at the speeds between the bounds of the median (at all speeds where it has none).
    """
    fitted = (fits.verdict == FITTED)[:, None]
    median, dispersion = (np.where(fitted, c[:, None], 1.0) for c in (fits.median, fits.dispersion))
    share = cdf((log(speed) - log(median)) / dispersion)
    return (
        np.where(fitted, share, speed > fits.high[:, None]),
        np.where(fitted, share, speed >= fits.low[:, None]),
    )
