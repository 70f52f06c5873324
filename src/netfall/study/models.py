"""Sections of a study file: type, unit, range, default and meaning of each key."""

from typing import TYPE_CHECKING, Literal

from netfall.job.keys.fields import Section, Text, key
from netfall.results.outcomes import OUTCOMES

MEASURED_OUTCOMES = tuple(one.name for one in OUTCOMES if one.measured)
if TYPE_CHECKING:
    MeasuredOutcome = str
else:
    MeasuredOutcome = Literal[MEASURED_OUTCOMES]


class RunSettings(Section):
    """Execution of the samples, [run]."""

    ranks: int = key("ranks of each run", 1, ge=1)
    keep_results: Literal["none", "broken", "all"] = key("samples whose result files are kept", "none")
    time_limit: float = key(
        "longest time of a run; after it the run counts as failed", 3600.0, unit="s", gt=0.0
    )


class DrawSettings(Section):
    """Random draws, [sampling]."""

    count: int = key("number of draws", ..., ge=1)
    method: Literal["sobol", "latin_hypercube", "random"] = key("method of sampling", "sobol")
    seed: int = key("seed of the draws", 1, ge=0)


class FailureCriterion(Section):
    """Measure of failure, [[failure]]: an outcome of a run above a limit."""

    name: Text = key("name of the measure of failure", ...)
    outcome: MeasuredOutcome = key("outcome of a run", ...)
    limit: float = key("limit of the outcome, above which the run has failed", ...)
    depth: float | None = key("depth below the form beyond which a node counts as sunk", unit="m", gt=0.0)


class HazardSettings(Section):
    """Annual maxima of the mean wind speed, [hazard]: keys of all distributions."""

    years: int = key("period of the second probability, next to that of a year", 50, ge=1)


class Gumbel(HazardSettings):
    """Gumbel's distribution."""

    mode: float = key("parameter of the annual maximum of the speed", ..., unit="m/s", gt=0.0)
    scale: float = key("scale of the distribution", ..., unit="m/s", gt=0.0)


class Weibull(HazardSettings):
    """Weibull's distribution."""

    shape: float = key("parameter of the annual maximum of the speed", ..., gt=0.0)
    scale: float = key("scale of the distribution", ..., unit="m/s", gt=0.0)


class EN1991(HazardSettings):
    """Distribution of EN 1991-1-4:2005, eq. 4.2."""

    basic_speed: float = key("basic wind velocity, EN 1991-1-4:2005, eq. 4.2", ..., unit="m/s", gt=0.0)
    K: float = key("shape parameter K", 0.2, gt=0.0)
    n: float = key("exponent n", 0.5, gt=0.0)


HAZARDS: dict[str, type[HazardSettings]] = {"gumbel": Gumbel, "weibull": Weibull, "en1991": EN1991}
