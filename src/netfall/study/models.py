"""Sections of a study file: type, unit, range, default and meaning of each key."""

from typing import TYPE_CHECKING, Literal

from netfall.job.fields import Section, Text, key
from netfall.results.outcomes import OUTCOMES

MEASURED_OUTCOMES = tuple(one.name for one in OUTCOMES if one.measured)
if TYPE_CHECKING:
    MeasuredOutcome = str
else:
    MeasuredOutcome = Literal[MEASURED_OUTCOMES]


class RunSettings(Section):
    """Execution of the samples, [run]."""

    ranks: int = key("of each run", 1, ge=1)
    keep_results: Literal["none", "broken", "all"] = key("whose result files are kept", "none")
    time_limit: float = key("of a run, after which it counts as failed", 3600.0, unit="s", gt=0.0)


class DrawSettings(Section):
    """Random draws, [sampling]."""

    count: int = key("how many are drawn", ..., ge=1)
    method: Literal["sobol", "latin_hypercube", "random"] = key("how they are drawn", "sobol")
    seed: int = key("of the draws", 1, ge=0)


class FailureCriterion(Section):
    """Measure of failure, [[failure]]: an outcome of a run above a limit."""

    name: Text = key("how the measure is called", ...)
    outcome: MeasuredOutcome = key("outcome of a run", ...)
    limit: float = key("more than it is a failure", ...)
    depth: float | None = key("depth from which a node has sunk", unit="m", gt=0.0)


class HazardSettings(Section):
    """Annual maxima of the mean wind speed, [hazard]: keys of all distributions."""

    years: int = key("over which the probability is told beside that of a year", 50, ge=1)


class Gumbel(HazardSettings):
    """Gumbel's distribution."""

    mode: float = key("of the largest speed of a year", ..., unit="m/s", gt=0.0)
    scale: float = key("of it", ..., unit="m/s", gt=0.0)


class Weibull(HazardSettings):
    """Weibull's distribution."""

    shape: float = key("of the largest speed of a year", ..., gt=0.0)
    scale: float = key("of it", ..., unit="m/s", gt=0.0)


class EN1991(HazardSettings):
    """Distribution of EN 1991-1-4:2005, eq. 4.2."""

    basic_speed: float = key("EN 1991-1-4:2005, eq. 4.2", ..., unit="m/s", gt=0.0)
    K: float = key("shape parameter there", 0.2, gt=0.0)
    n: float = key("exponent there", 0.5, gt=0.0)


HAZARDS: dict[str, type[HazardSettings]] = {"gumbel": Gumbel, "weibull": Weibull, "en1991": EN1991}
