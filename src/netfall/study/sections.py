"""Sections of a study file: type, unit, range, default and meaning of each key; random values.

`check` collects the errors. Random values are space-filling or independent samples.
"""

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from netfall.core.functions import exp, log, log1p, quantile
from netfall.job import messages as job_messages
from netfall.job.keys.entries import Remove
from netfall.job.keys.fields import Section, Text, is_finite_number, is_whole, key, keys_of
from netfall.job.keys.schema import key_of
from netfall.job.units import UnitError, to_unit
from netfall.job.validate import Validator
from netfall.job.values import format_value, suggest
from netfall.results.datasets import OUTCOME_BY_NAME, OUTCOMES
from netfall.study import messages
from netfall.study.answers.hazard import Hazard

# Parameters of each distribution.
DISTRIBUTIONS = {
    "normal": ("mean", "deviation"),
    "lognormal": ("mean", "deviation"),
    "uniform": ("from", "to"),
    "integer": ("from", "to"),  # both included
}
MIN_PROBABILITY = 2.0**-53  # smallest probability, because the quantile of a distribution at 0 is infinite


def draw(method: str, count: int, seed: int, distributions: list[dict[str, Any]]) -> np.ndarray:
    """Return values (count, k), a column for each distribution.

    method : as in `DrawSettings`; distributions : `distribution` and its two numbers, as in a study file
    """
    probabilities = _probabilities(method, count, seed, len(distributions))
    probabilities = np.clip(probabilities, MIN_PROBABILITY, 1.0 - MIN_PROBABILITY)
    return np.column_stack(
        [quantiles(distribution, probabilities[:, k]) for k, distribution in enumerate(distributions)]
    )


def _probabilities(method: str, count: int, seed: int, columns: int) -> np.ndarray:
    """Return probabilities (count, columns) from 0 to 1."""
    if method == "random":
        return np.random.default_rng(seed).random((count, columns))
    from scipy.stats import qmc

    engine = {"sobol": qmc.Sobol, "latin_hypercube": qmc.LatinHypercube}[method](columns, rng=seed)
    with warnings.catch_warnings():
        # warning that count is not a power of two; the documentation explains it
        warnings.simplefilter("ignore", UserWarning)
        return np.asarray(engine.random(count))


def quantiles(distribution: dict[str, Any], share: np.ndarray) -> np.ndarray:
    """Return the quantiles of a distribution at these probabilities.

    Mean and standard deviation are those of the values, also for the lognormal distribution.
    """
    kind = distribution["distribution"]
    first, second = (float(distribution[name]) for name in DISTRIBUTIONS[kind])
    if kind == "uniform":
        return first + (second - first) * share
    if kind == "integer":
        return first + np.floor((second + 1.0 - first) * share)  # the sum could round up to an integer
    if kind == "normal":
        return first + second * quantile(share)
    ratio = second / first
    log_variance = log1p(ratio * ratio)
    return exp(log(first) - 0.5 * log_variance + np.sqrt(log_variance) * quantile(share))


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
    device: Literal["cpu", "gpu", "auto"] = key("what steps the dynamic stage; auto: a GPU if it can", "cpu")


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

    basic_speed: float = key(
        "basic wind velocity of EN 1991-1-4:2005, times c_r(10 m) of the terrain", ..., unit="m/s", gt=0.0
    )
    K: float = key("shape parameter K", 0.2, gt=0.0)
    n: float = key("exponent n", 0.5, gt=0.0)


HAZARDS: dict[str, type[HazardSettings]] = {"gumbel": Gumbel, "weibull": Weibull, "en1991": EN1991}


MAX_SAMPLES = 10_000_000  # largest number of samples
TOP_KEYS = ("job", "title", "vary", "sampling", "run", "failure", "hazard")
REMOVE_KEYS = ("each", "group", "ids", "time", "duration")
# kind of removed part: key of [[remove]] that names it
PART_KEYS = {"element": "elements", "cable": "cables"}
SUNK_OUTCOME = "sunk_area"  # outcome that needs a depth
LOST = "[[remove]]"  # name of the axis of member removals; no key of a job has this name


@dataclass(frozen=True)
class Axis:
    """One dimension of a study: a key of the job, or LOST, and its values."""

    name: str
    values: list[Any]


def removal_section(value: Any, check: Validator) -> dict[str, Any]:
    """Check [vary] remove, the settings of all member removals, and return it."""
    place = f"[vary] remove = {format_value(value)}:"
    if not isinstance(value, dict) or value.get("each") not in [*PART_KEYS]:  # possibly not hashable
        check.wrong(place, messages.EXPECTED_REMOVAL())
        return {}
    for name in set(value) - set(REMOVE_KEYS):
        check.wrong(place, job_messages.UNKNOWN_KEY(name=name, suggestion=suggest(name, REMOVE_KEYS)))
    groups = value.get("group", "")
    are_names = isinstance(groups, str | list) and all(isinstance(name, str) for name in groups)
    if not are_names or groups == []:
        check.wrong(place, messages.NO_GROUPS(value=format_value(groups)))
    ids, id_type = value.get("ids", []), int if value["each"] == "element" else str
    are_ids = isinstance(ids, list) and all(isinstance(piece_id, id_type) for piece_id in ids)
    if not are_ids or value.get("ids") == []:
        check.wrong(place, messages.NO_IDS(value=format_value(ids)))
    elif len(set(ids)) < len(ids):
        check.wrong(place, messages.ID_TWICE())
    times = {name: keys_of(Remove)[name] for name in ("time", "duration")}
    check.values(place, times, {name: value[name] for name in times if name in value})
    if "time" not in value:
        check.wrong(place, messages.NO_TIME(expected=times["time"].expected()))
    return value


def in_units_of_keys(section: str, values: dict[str, Any], check: Validator) -> dict[str, Any]:
    """Return the values of [vary] or [sampling]; "40 km/h" becomes a number in the unit of the key.

    section : its name, for messages
    """
    converted = dict(values)
    for name, value in values.items():
        key = key_of(name)
        try:
            converted[name] = to_unit(value, key.unit) if key is not None and key.takes_units else value
        except UnitError as error:
            check.wrong(f"[{section}] {name} = {format_value(value)}:", str(error))
    return converted


def read_axis(name: str, value: Any, check: Validator) -> Axis:
    """Return the axis of one key with its values."""
    place, given = f"[vary] {name} = {format_value(value)}:", value
    if name == "remove":
        return Axis(LOST, [])
    if isinstance(value, dict):
        step = value.get("step", 1)
        are_integers = all(is_whole(value.get(end)) for end in ("from", "to")) and is_whole(step)
        if not are_integers or step < 1 or set(value) - {"from", "to", "step"} or value["to"] < value["from"]:
            check.wrong(place, messages.NO_RANGE())
            return Axis(name, [0])
        if (value["to"] - value["from"]) // step >= MAX_SAMPLES:
            check.wrong(place, messages.TOO_MANY_VALUES(most=MAX_SAMPLES))
            return Axis(name, [0])
        return Axis(name, list(range(value["from"], value["to"] + 1, step)))
    if not isinstance(value, list) or not value:
        check.wrong(place, messages.NO_VALUES())
        return Axis(name, [0])
    if name == "wind.direction" and all(isinstance(item, (int, float)) for item in value):
        value = [item % 360.0 for item in value]
    repeated = next((item for k, item in enumerate(value) if item in value[:k]), None)
    if repeated is not None:
        check.wrong(place, messages.VALUE_TWICE(value=format_value(repeated)))
    return Axis(name, given)


def check_distributions(distributions: dict[str, Any], vary: dict[str, Any], check: Validator) -> None:
    """Check the keys of the job in [sampling]; vary : those of [vary]."""
    for name, distribution in distributions.items():
        place = f"[sampling] {name} = {format_value(distribution)}:"
        if name in vary:
            check.wrong(place, messages.VARIED_AND_DRAWN())
        kind = distribution.get("distribution") if isinstance(distribution, dict) else None
        if kind not in [*DISTRIBUTIONS]:  # possibly not hashable
            check.wrong(place, messages.NO_DISTRIBUTION(known=", ".join(DISTRIBUTIONS)))
            continue
        names = DISTRIBUTIONS[kind]
        values = [distribution.get(parameter) for parameter in names]
        if not all(map(is_finite_number, values)) or set(distribution) != {"distribution", *names}:
            check.wrong(place, messages.NO_PARAMETERS(names=" and ".join(names)))
        elif kind == "integer" and not all(map(is_whole, values)):
            check.wrong(place, messages.NO_WHOLE_ENDS())
        elif names == ("from", "to") and not values[0] < values[1]:
            check.wrong(place, messages.NO_ORDER())
        elif names == ("mean", "deviation") and not values[1] > 0:
            check.wrong(place, messages.NO_DEVIATION())
        elif kind == "lognormal" and not values[0] > 0:
            check.wrong(place, messages.NO_MEAN())


FIRST_FRACTURE = "first fracture"  # from here on: measures of failure in each study
LOST_ROOF = {"any of the roof lost": 0.0}  # lost shares of the roof above which a run counts as failed
LOST_ROOF |= {f"more than {share:.0%} of the roof lost": share for share in (0.05, 0.1, 0.25, 0.5)}


def failure_sections(entries: list[Any], losses: bool, check: Validator) -> tuple[FailureCriterion, ...]:
    """Return the failure criteria of [[failure]] in their order. losses : whether members are removed"""
    if isinstance(entries, list):
        entries = [_with_limit_in_si(entry, check) for entry in entries]
    criteria = check.entries("failure", FailureCriterion, entries)
    for criterion in criteria:
        place = f"[[failure]] {criterion.name}:"
        outcome, depth = criterion.outcome, criterion.depth
        if outcome in OUTCOME_BY_NAME and OUTCOME_BY_NAME[outcome].needs_removal and not losses:
            check.wrong(place, messages.OUTCOME_OF_REMOVALS(value=format_value(outcome)))
        if criterion.name in (FIRST_FRACTURE, *LOST_ROOF):
            check.wrong(place, messages.RESERVED_MEASURE())
        if outcome == "first_fracture" and criterion.limit:
            check.wrong(place, messages.LATE_FRACTURE(value=format_value(criterion.limit)))
        if outcome == SUNK_OUTCOME and depth is None:
            check.wrong(place, messages.NO_DEPTH())
        if outcome != SUNK_OUTCOME and depth is not None:
            check.wrong(place, messages.DEPTH_WITHOUT_EFFECT(value=format_value(SUNK_OUTCOME)))
    depths = {criterion.depth for criterion in criteria if criterion.depth is not None}
    if len(depths) > 1:
        several = ", ".join(f"{depth:g}" for depth in sorted(depths))
        check.wrong("[[failure]]", messages.SEVERAL_DEPTHS(depths=several))
    return tuple(criteria)


def _with_limit_in_si(entry: Any, check: Validator) -> Any:
    """Return an entry of [[failure]] with its limit in the unit of its outcome; "80 kN" becomes 80e3."""
    name = entry.get("outcome") if isinstance(entry, dict) else None
    unit = OUTCOME_BY_NAME[name].unit if isinstance(name, str) and name in OUTCOME_BY_NAME else ""
    if not unit or "limit" not in entry:
        return entry
    try:
        return entry | {"limit": to_unit(entry["limit"], unit)}
    except UnitError as error:
        place = f"[[failure]] {entry.get('name')}: limit = {format_value(entry['limit'])}:"
        check.wrong(place, str(error))
        return entry | {"limit": 0.0}


def hazard_section(table: dict[str, Any], varies: bool, check: Validator) -> Hazard | None:
    """Return the distribution of the annual maxima of the wind speed; None without the section.

    varies : whether the wind speed varies
    """
    if not table:
        return None
    if not varies:
        check.wrong("hazard", messages.HAZARD_WITHOUT_SPEED())
    kind = table.get("distribution")
    if kind not in [*HAZARDS]:  # possibly not hashable
        known = ", ".join(HAZARDS)
        missing = messages.MISSING_HAZARD(known=known)
        check.wrong(
            "hazard", messages.UNKNOWN_HAZARD(value=format_value(kind), known=known) if kind else missing
        )
        return None
    given = {name: value for name, value in table.items() if name != "distribution"}
    values = dict(check.table("hazard", HAZARDS[kind], given))
    return Hazard(kind, values, values.pop("years"))
