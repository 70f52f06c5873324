"""Annual probability that the wind breaks the roof, from a fragility curve.

With F the lognormal curve and S(v) the probability that the largest mean speed of a year exceeds v,

    P = integral of F(v) (-dS/dv) dv = integral of S(v) dF(v)
      = integral of phi(z) S(median exp(dispersion z)) dz

Years are independent: P over N years is 1 - (1 - P)^N. The reliability index is -Phi^-1(P) (EN 1990:2002,
annex C). For a sample without a curve, the bounds of its share of failures bound P.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import gumbel_r, norm, weibull_min

from netfall.study.answers import probit
from netfall.study.answers.probit import FragilityFits
from netfall.study.answers.samples import bootstrap_interval

Exceedance = Callable[[np.ndarray], np.ndarray]  # of speeds [m/s]
MAX_WIND_SPEED = 1e4  # m/s, upper bound of wind speeds
DEFAULT_YEARS = 50  # default period for the long-term probability
# EN 1990, table B2: 1, 50 years
TARGET_RELIABILITY = {"RC1": (4.2, 3.3), "RC2": (4.7, 3.8), "RC3": (5.2, 4.3)}
Z = np.linspace(-9.0, 9.0, 1801)  # standard normal variable; the trapezoidal rule is exact to rounding
Z_WEIGHT = np.exp(-0.5 * Z * Z) * ((Z[1] - Z[0]) / np.sqrt(2.0 * np.pi))


class Hazard(NamedTuple):
    """Distribution of the annual maximum of the mean wind speed, 10 m above ground.

    parameters : as in `study.sections`; years : period of the long-term probability
    """

    distribution: str
    parameters: dict[str, float]
    years: int = DEFAULT_YEARS

    def __str__(self) -> str:
        values = ", ".join(f"{name} {value:g}" for name, value in self.parameters.items())
        return f"{self.distribution} ({values})"

    def exceedance(self, speed: np.ndarray) -> np.ndarray:
        """Compute the probability that the annual maximum exceeds speeds [m/s]."""
        p = self.parameters
        if self.distribution == "weibull":
            return np.asarray(weibull_min.sf(speed, p["shape"], scale=p["scale"]))
        if self.distribution == "gumbel":
            return np.asarray(gumbel_r.sf(speed, p["mode"], p["scale"]))
        # v(p) = v_b [(1 - K ln(-ln(1 - p))) / (1 - K ln(-ln 0.98))]^n, solved for p
        once_in_fifty = 1.0 - p["K"] * float(np.log(-np.log(0.98)))
        scaled = np.power(speed / p["basic_speed"], 1.0 / p["n"]) * once_in_fifty
        return np.asarray(gumbel_r.sf(scaled, 1.0, p["K"]))


def annual_probability(exceedance: Exceedance, median: np.ndarray, dispersion: np.ndarray) -> np.ndarray:
    """Compute P (R,) of lognormal curves, median (R,) [m/s]. exceedance : S(v), a function of speeds [m/s]"""
    speed = np.exp(np.clip(np.log(median)[:, None] + dispersion[:, None] * Z, -700.0, np.log(MAX_WIND_SPEED)))
    return np.asarray(np.sum(Z_WEIGHT * exceedance(speed), axis=1))


def tail_share(exceedance: Exceedance, median: float, dispersion: float, lowest: float) -> float:
    """Compute the share of P from speeds below `lowest` [m/s], at which no run has failed.

    This share of the probability depends only on the shape of the curve. The integral of F (-dS/dv) below a
    speed u is that of phi(z) (S(v) - S(u)) over v below u.
    """
    speed = np.exp(np.clip(np.log(median) + dispersion * Z, -700.0, np.log(MAX_WIND_SPEED)))
    below = np.maximum(exceedance(speed) - exceedance(np.array([lowest])), 0.0)
    total = float(np.sum(Z_WEIGHT * exceedance(speed)))
    return float(np.sum(Z_WEIGHT * below)) / total if total > 0.0 else np.nan


def annual_bounds(exceedance: Exceedance, fits: FragilityFits) -> tuple[np.ndarray, np.ndarray]:
    """Compute bounds (R,) of P, which are equal if there is a curve; see `probit.share_bounds`."""
    fitted = fits.verdict == probit.FITTED
    low, high = np.zeros(len(fitted)), np.ones(len(fitted))
    if fitted.any():
        probability = annual_probability(exceedance, fits.median[fitted], fits.dispersion[fitted])
        low[fitted] = high[fitted] = probability
    separated = ~fitted & ~np.isin(fits.verdict, (probit.FALLING, probit.NOT_FOUND))
    above = np.where(np.isfinite(fits.above), fits.above, 1e300)
    mixed, share = (np.where(np.isnan(v), w, v) for v, w in ((fits.mixed, above), (fits.share, 1.0)))

    def beyond(speed: np.ndarray) -> np.ndarray:
        return np.where(speed < MAX_WIND_SPEED, exceedance(np.clip(speed, 1e-300, MAX_WIND_SPEED)), 0.0)

    lower = share * (beyond(mixed) - beyond(above)) + beyond(above)
    mixed, share = (np.where(np.isnan(v), w, v) for v, w in ((fits.mixed, fits.below), (fits.share, 0.0)))
    upper = share * (beyond(fits.below) - beyond(mixed)) + beyond(mixed)
    return np.where(separated, lower, low), np.where(separated, upper, high)


def over_years(probability: np.ndarray, years: int) -> np.ndarray:
    """Compute 1 - (1 - P)^N."""
    return np.asarray(-np.expm1(years * np.log1p(-np.minimum(probability, 1.0 - 2.0**-53))))


def reliability_index(probability: np.ndarray) -> np.ndarray:
    """Compute beta = -Phi^-1(P); infinite if P is 0, nan if P is."""
    return np.asarray(norm.isf(np.minimum(probability, 1.0 - 2.0**-53)))


def hazard_row(
    hazard: Hazard,
    speed: Any,
    failed: Any,
    fits: FragilityFits,
    drawn: FragilityFits | None,
    extremes: FragilityFits,
) -> dict[str, Any]:
    """Return the datasets of /hazard for one curve.

    speed, failed : (s,) speeds and numbers of failures; fits : of the curve; drawn : of the resamples
    extremes : if all excluded samples had failed, and if none had
    """
    exceedance, probability, within, tail = hazard.exceedance, np.nan, np.nan, np.nan
    if fits.verdict[0] == probit.FITTED:
        probability = float(annual_probability(exceedance, fits.median, fits.dispersion)[0])
        within = float(over_years(np.array(probability), hazard.years))
        lowest = float(speed[failed > 0].min())
        tail = tail_share(exceedance, fits.median[0], fits.dispersion[0], lowest)
    least, most = annual_bounds(exceedance, extremes)
    no_interval = np.full(2, np.nan)
    return {
        "annual_probability": probability,
        "if_left_out": np.array([most[0], least[1]]),
        "interval": no_interval if drawn is None else bootstrap_interval(*annual_bounds(exceedance, drawn)),
        "beta": float(reliability_index(np.array(probability))),
        "probability": within,
        "beta_of_years": float(reliability_index(np.array(within))),
        "tail_share": tail,
    }
