"""The sections of a study file, checked; `wrong` takes a line for each thing that is not as it should be."""

import json
import math
from dataclasses import dataclass

from netfall.job.values import nearest, shown
from netfall.study.draws import DISTRIBUTIONS, METHODS

MOST = 10_000_000  # members
RUN = {"ranks": 1, "keep": "none", "time_limit": 3600.0}
SAMPLE = ("count", "method", "seed")
KEEP = ("none", "broken", "all")
REMOVE = ("each", "group", "time", "duration")
EACH = {"element": "elements", "cable": "cables"}  # what is lost, and the key of [[remove]] that names it
LOST = "[[remove]]"  # the name of the axis of losses: no key of a job can have it


@dataclass(frozen=True)
class Axis:
    """One thing that varies: the key of the job, or LOST, and its values."""

    name: str
    values: list


def run_section(table: dict, wrong) -> dict:
    """The keys of [run], given or by default."""
    for name in set(table) - set(RUN):
        wrong(f"[run] {name}: unknown key; {nearest(name, RUN)}")
    run = RUN | {name: value for name, value in table.items() if name in RUN}
    if not _whole(run["ranks"], 1):
        wrong(f"[run] ranks = {shown(run['ranks'])}: expected a whole number >= 1")
    if run["keep"] not in KEEP:
        wrong(f"[run] keep = {shown(run['keep'])}: expected {', '.join(KEEP)}")
    if not _number(run["time_limit"]) or run["time_limit"] <= 0:
        wrong(f"[run] time_limit = {shown(run['time_limit'])}: expected seconds for a run, > 0")
    return run


def _number(value) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _whole(value, least: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= least


def loss_section(value, wrong) -> dict:
    """What all losses of [vary] remove have in common, as it is given."""
    place = f"[vary] remove = {shown(value)}"
    if not isinstance(value, dict) or value.get("each") not in EACH:
        wrong(f'{place}: expected {{each = "element", ...}} or {{each = "cable", ...}}')
        return {}
    for name in set(value) - set(REMOVE):
        wrong(f"{place}: {name}: unknown key; {nearest(name, REMOVE)}")
    groups = value.get("group", [])
    if not isinstance(groups, str | list) or not all(isinstance(name, str) for name in groups):
        wrong(
            f"{place}: group = {shown(groups)}: expected the name of a group of elements, or a list of them"
        )
    if not _number(value.get("time")) or value["time"] < 0:
        given = f"time = {shown(value['time'])}" if "time" in value else "time: missing"
        wrong(f"{place}: {given}; expected the time of the loss, s >= 0")
    if not _number(value.get("duration", 0.0)) or value.get("duration", 0.0) < 0:
        wrong(f"{place}: duration = {shown(value['duration'])}: expected s >= 0")
    return value


def axis_of(name: str, value, wrong) -> Axis:
    """The values of one key."""
    place = f"[vary] {name} = {shown(value)}"
    if name == "remove":
        return Axis(LOST, [])
    if isinstance(value, dict):
        step = value.get("step", 1)
        whole = all(_whole(value.get(end), -(10**15)) for end in ("from", "to")) and _whole(step, 1)
        if not whole or set(value) - {"from", "to", "step"} or value["to"] < value["from"]:
            wrong(f"{place}: expected {{from = 1, to = 50}}, whole numbers, both included, or a list")
            return Axis(name, [0])
        if (value["to"] - value["from"]) // step >= MOST:
            wrong(f"{place}: more than {MOST} values")
            return Axis(name, [0])
        return Axis(name, list(range(value["from"], value["to"] + 1, step)))
    if not isinstance(value, list) or not value:
        wrong(f"{place}: expected a list of values, or {{from = 1, to = 50}}")
        return Axis(name, [0])
    keys = [json.dumps(each, default=str) for each in value]
    twice = next((each for k, each in enumerate(value) if keys[k] in keys[:k]), None)
    if twice is not None:
        wrong(f"{place}: {shown(twice)} stands in it twice")
    return Axis(name, value)


def check_sample(sample: dict, distributions: dict, vary: dict, wrong) -> None:
    """Check [sample]; distributions : its keys of the job; vary : those of [vary]."""
    if sample and not _whole(sample.get("count"), 1):
        given = f"count = {shown(sample['count'])}" if "count" in sample else "count: missing"
        wrong(f"[sample] {given}; expected the number of draws, >= 1")
    if sample.get("method", "sobol") not in METHODS:
        wrong(f"[sample] method = {shown(sample['method'])}: expected {', '.join(METHODS)}")
    if not _whole(sample.get("seed", 1), 0):
        wrong(f"[sample] seed = {shown(sample['seed'])}: expected a whole number >= 0")
    if sample and not distributions:
        wrong("[sample] names no key of the job to draw")
    for name, each in distributions.items():
        place = f"[sample] {name} = {shown(each)}"
        if name in vary:
            wrong(f"{place}: stands in [vary] too")
        kind = each.get("distribution") if isinstance(each, dict) else None
        if kind not in DISTRIBUTIONS:
            wrong(
                f'{place}: expected {{distribution = "normal", mean = 1.0, deviation = 0.1}}; known: '
                f"{', '.join(DISTRIBUTIONS)}"
            )
            continue
        names = DISTRIBUTIONS[kind]
        values = [each.get(called) for called in names]
        if not all(map(_number, values)) or set(each) != {"distribution", *names}:
            wrong(f"{place}: expected numbers {' and '.join(names)}, and nothing else")
        elif kind == "integer" and not all(isinstance(value, int) for value in values):
            wrong(f"{place}: expected whole numbers from and to")
        elif names == ("from", "to") and not values[0] < values[1]:
            wrong(f"{place}: expected from < to")
        elif names == ("mean", "deviation") and not values[1] > 0:
            wrong(f"{place}: expected deviation > 0")
        elif kind == "lognormal" and not values[0] > 0:
            wrong(f"{place}: expected mean > 0")
