"""Fragility: share of failed runs as a function of the mean wind speed, with its uncertainty.

The [[failure]] entries of a study file add criteria of failure to the default ones.

Each failure criterion has a lognormal curve by maximum likelihood (`probit.py`). Intervals come from the
bootstrap. If runs at several speeds share their gusts (the same wind.seed), seeds are resampled instead of
runs. A run without an equilibrium counts as failure of the whole roof. Runs that diverged or ended for a
technical reason are excluded, and counted.
"""

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from netfall.core.arrays import AnyArray, BoolArray, FloatArray, IntArray
from netfall.results.removals import REMOVAL_FAILED
from netfall.study.answers import probit
from netfall.study.answers.hazard import Hazard, hazard_row
from netfall.study.answers.probit import FragilityFits
from netfall.study.answers.samples import (
    CONFIDENCE,
    RESAMPLES,
    SPEED,
    FragilityCurve,
    bootstrap_interval,
    bootstrap_weights,
    group_curves,
    value_codes,
)
from netfall.study.sections import FIRST_FRACTURE, LOST_ROOF, FailureCriterion

JUDGED_STATES = ("finished", "no_equilibrium")  # states of runs that show whether the roof failed


def is_judged(samples: dict[str, np.ndarray]) -> np.ndarray:
    """Return the samples (N,) bool that count in shares and curves; the others are excluded."""
    return np.isin(samples["state"], JUDGED_STATES)


class Judgement(NamedTuple):
    """Whether samples (N,) have failed by a criterion; judged : whether they have the outcome."""

    failed: np.ndarray
    judged: np.ndarray


def failures(samples: dict[str, np.ndarray], own: tuple[FailureCriterion, ...] = ()) -> dict[str, Judgement]:
    """Apply each failure criterion to the samples.

    samples : the columns of /samples by name, text as str; own : criteria of the study file

    A run without an equilibrium has failed by all criteria. A run without the outcome of a criterion, such as
    the utilisation if nothing has a strength, is not judged; if no finished run has it, no run is judged.
    Exceptions: a run without a fracture time has not broken, if anything can break. A run without a dynamic
    factor, because more elements broke or because there is no equilibrium after the removal, has failed.
    Nothing breaks in equilibria: one in which an element exceeds the strain at which it breaks counts as a
    first fracture, and the lost roof is unknown. Nets without a roof have no criteria of a lost roof.
    """
    moves = np.isfinite(samples["duration"]).any()
    used = samples["utilisation_before_break"]  # nan: nothing can break
    breaks = np.isfinite(samples["first_fracture"]) if moves else used > 1.0
    no_equilibrium, all_judged = samples["state"] == "no_equilibrium", np.ones(len(samples["state"]), bool)
    lost_share = np.where(no_equilibrium, 1.0, samples["detached_area"])
    breaks |= no_equilibrium
    measures = {FIRST_FRACTURE: Judgement(breaks, breaks | np.isfinite(used))}
    for name, share in LOST_ROOF.items() if moves else ():
        measures[name] = Judgement(lost_share > share, np.isfinite(lost_share))
    for criterion in own:
        value, failed = samples[criterion.outcome].astype(float), no_equilibrium
        if criterion.outcome == "dynamic_factor_max":
            failed_after = np.isin(samples["equilibrium_after_removal"], REMOVAL_FAILED)
            failed = failed | (samples["broken"] > 0) | failed_after
        failed = failed | (value > criterion.limit)
        judged = failed | np.isfinite(used if criterion.outcome == "first_fracture" else value)
        measures[criterion.name] = Judgement(failed, judged)
    finished = samples["state"] == "finished"
    for name, measure in list(measures.items()):
        if finished.any() and not measure.judged[finished].any():
            measures[name] = Judgement(~all_judged, ~all_judged)
            if name in LOST_ROOF:  # no roof
                del measures[name]
    return measures


def failure_section(
    samples: dict[str, np.ndarray], own: tuple[FailureCriterion, ...]
) -> dict[str, np.ndarray]:
    """Return the datasets of /failures: criteria of the study file, numbers of judged and failed runs."""
    counted = is_judged(samples)
    by_name = failures(samples, own)
    verdicts = [by_name[item.name] for item in own]
    return {
        "measure": np.array([item.name for item in own]),
        "outcome": np.array([item.outcome for item in own]),
        "limit": np.array([item.limit for item in own], float),
        "runs": np.array([(counted & item.judged).sum() for item in verdicts]),
        "failed": np.array([(counted & item.failed).sum() for item in verdicts]),
    }


MIN_SAMPLES = 8  # number of independent samples below which the bootstrap is meaningless
FEW_SAMPLES = 30  # number of independent samples below which its intervals are rough, and mostly too narrow
BAND_SPEEDS = 81  # number of speeds of the band
HAZARD_SPEEDS = 121  # number of speeds at which /hazard has the exceedance, for plots


def curve_sections(
    samples: dict[str, np.ndarray],
    own: tuple[FailureCriterion, ...] = (),
    hazard: Hazard | None = None,
    drawn: Collection[str] | None = None,
) -> dict[str, dict[str, np.ndarray]]:
    """Return the datasets of /fragility and /hazard, by name; {} if the speed is the same in all samples.

    samples : the columns of /samples by name, (N,) each, text as str; own : failure criteria of the study
        file, in addition to the default ones; drawn : of `group_curves`
    """
    if SPEED not in samples or len(np.unique(samples[SPEED])) < 2:
        return {}
    counted = is_judged(samples)
    speed = np.unique(samples[SPEED]).astype(float)
    grid = np.linspace(0.9 * speed[0], 1.05 * speed[-1], BAND_SPEEDS)
    curves, pooled = group_curves(samples, drawn)
    measures = failures(samples, own)
    rows = [
        row for curve in curves for row in _curve_rows(samples, curve, counted, measures, speed, grid, hazard)
    ]
    yearly = [row.pop("of_year") for row in rows]
    shared: dict[str, Any] = {"speed": speed, "band_speed": grid, "level": CONFIDENCE, "resamples": RESAMPLES}
    sections = {"fragility": shared | _columns(rows) | {"pooled": np.array(pooled, str)}}
    if hazard:
        names = {name: np.array([row[name] for row in rows]) for name in ("measure", "curve")}
        speeds = np.linspace(0.3 * grid[0], grid[-1], HAZARD_SPEEDS)
        shared = {"distribution": str(hazard), "years": hazard.years, "speed": speeds}
        shared |= {"exceedance": hazard.exceedance(speeds)}
        sections["hazard"] = shared | names | _columns(yearly)
    return sections


def _columns(rows: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _curve_rows(
    samples: dict[str, AnyArray],
    curve: FragilityCurve,
    counted: BoolArray,
    measures: dict[str, Judgement],
    speed: FloatArray,
    grid: FloatArray,
    hazard: Hazard | None,
) -> list[dict[str, Any]]:
    """Return the rows of one curve, one per failure criterion."""
    is_counted = counted[curve.rows]
    left_out, rows_of_curve = curve.rows[~is_counted], curve.rows[is_counted]
    groups = {name: value_codes(codes[is_counted]) for name, codes in curve.dependent_groups.items()}
    curve = FragilityCurve(curve.name, rows_of_curve, groups, curve.strata[is_counted])
    is_at_speed = samples[SPEED][rows_of_curve][:, None] == speed
    failed, judged = (np.array([v[part][rows_of_curve] for v in measures.values()], bool) for part in (0, 1))
    run_counts, counts = (which.astype(int) @ is_at_speed.astype(int) for which in (judged, failed))
    has_enough = curve.samples >= MIN_SAMPLES
    exposure = np.unique(samples["duration"][rows_of_curve])
    missing = (samples[SPEED][left_out][:, None] == speed).sum(0)
    rows = []
    for k, name in enumerate(measures):
        runs, fit = run_counts[k], probit.fit(speed, run_counts[k], counts[k])
        resampled = None
        if has_enough:
            resampled = probit.fit(speed, *_bootstrap_counts(curve, is_at_speed, failed[k], judged[k]))
        extremes = probit.fit(speed, runs + missing, np.array([counts[k] + missing, counts[k]]))
        of_year = hazard and hazard_row(hazard, speed, counts[k], fit, resampled, extremes)
        rows.append(
            {"measure": name, "curve": curve.name, "runs": runs, "failed": counts[k]}
            | {"samples": curve.samples, "resampled": curve.resampled, "left_out": len(left_out)}
            | {"exposure": exposure[0] if len(exposure) == 1 else np.nan}
            | _fit_row(speed, grid, runs, fit, resampled, extremes, curve.samples)
            | {"of_year": of_year}
        )
    return rows


def _bootstrap_counts(
    curve: FragilityCurve, at: np.ndarray, failed: np.ndarray, judged: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Count runs and failures (RESAMPLES, s) at each speed in each resample, by one criterion.

    at : (r, s) the speed of each run; failed, judged : (r,)
    """
    # Sparse, because each run may have a speed of its own. Sums of integers are exact in any order.
    columns = [csr_array(at * which[:, None], dtype=float) for which in (judged, failed)]
    counts = [[block @ column for column in columns] for block in bootstrap_weights(curve)]
    runs, failures = (np.concatenate(blocks) for blocks in zip(*counts))
    return runs, failures


def _fit_row(
    speed: FloatArray,
    grid: FloatArray,
    runs: IntArray,
    fit: FragilityFits,
    drawn: FragilityFits | None,
    extremes: FragilityFits,
    samples: int,
) -> dict[str, Any]:
    """Return the fit to runs (s,) and their failures, its intervals from the resamples `drawn`, and notes.

    extremes : the fits if all excluded samples had failed, and if none had
    """
    is_fitted = fit.verdict[0] == probit.FITTED
    no_interval = np.full(2, np.nan)
    row = {"median": fit.median[0], "dispersion": fit.dispersion[0]}
    row |= {"median_interval": no_interval, "dispersion_interval": no_interval, "band_at_median": no_interval}
    row |= {"band": np.full((len(grid), 2), np.nan), "without_curve": 0}
    row["median_bounds"] = np.ravel(probit.median_bounds(fit))
    if drawn is not None:
        row["without_curve"] = int((drawn.verdict != probit.FITTED).sum())
        row["band"] = bootstrap_interval(*probit.share_bounds(grid, drawn))
    if drawn is not None and is_fitted:
        row["median_interval"] = bootstrap_interval(*probit.median_bounds(drawn))
        row["dispersion_interval"] = bootstrap_interval(*probit.dispersion_bounds(drawn))
        row["band_at_median"] = bootstrap_interval(*probit.share_bounds(fit.median, drawn))[0]
    row["median_if_left_out"] = extremes.median
    notes = [_reason(fit, speed, runs)] if not is_fitted else []
    row["note"] = "; ".join(notes + _doubts(row, speed, runs, samples))
    return row


def _reason(fit: FragilityFits, speed: np.ndarray, runs: np.ndarray) -> str:
    """Return the reason why there is no curve, and bounds of the median."""
    low, high = np.ravel(probit.median_bounds(fit))
    if not runs.any():
        return "no finished run has its outcome"
    between = f"at {low:g} m/s, where half failed" if low == high else f"between {low:g} and {high:g} m/s"
    if np.isinf(high):
        between = f"above {low:g} m/s"
    elif not low:
        between = f"below {high:g} m/s"
    return {
        probit.NONE_FAILED: f"none failed up to {low:g} m/s, the highest speed; add higher speeds",
        probit.ALL_FAILED: f"all failed, even at {high:g} m/s, the lowest speed; add lower speeds",
        probit.ONE_SPEED: f"some failed, but all ran at {speed[runs > 0][0]:g} m/s; add other speeds",
        probit.SEPARATED: "fewer than two speeds at which some runs failed and others survived: the median "
        f"is {between}, and the dispersion is not known; add speeds there",
        probit.FALLING: "failures do not increase with the speed; add runs or other speeds",
        probit.NOT_FOUND: "the likelihood iteration did not converge",
    }[int(fit.verdict[0])]


def _doubts(row: dict[str, Any], speed: FloatArray, runs: IntArray, samples: int) -> list[str]:
    """Return notes on the uncertainty of a curve."""
    notes, median, used = [], row["median"], speed[runs > 0]
    if np.isfinite(median) and not used[0] <= median <= used[-1]:
        notes.append(f"the median is outside the range of speeds, {used[0]:g} to {used[-1]:g} m/s")
    if samples < MIN_SAMPLES:
        notes.append(f"no intervals: {samples} independent samples, at least {MIN_SAMPLES} are needed")
    elif samples < FEW_SAMPLES:
        notes.append(f"{samples} independent samples are few: the intervals are rough")
    if np.isfinite(median) and row["without_curve"]:
        notes.append(
            f"{row['without_curve']} of {RESAMPLES} resamples have no curve; the intervals reach as far as "
            "these allow"
        )
    return notes
