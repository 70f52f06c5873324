"""The sections of a study file, checked; `wrong` takes a line for each thing that is not as it should be."""

import json
import math
from dataclasses import dataclass

from netfall.job.values import nearest, shown
from netfall.results.outcomes import OUTCOMES
from netfall.study.answers import hazard
from netfall.study.answers.hazard import Hazard
from netfall.study.answers.measures import Failure
from netfall.study.answers.subset import Rare
from netfall.study.draws import DISTRIBUTIONS, METHODS

MOST = 10_000_000  # members
TOP = ("job", "title", "vary", "sample", "run", "failure", "hazard", "rare")
RUN = {"ranks": 1, "keep": "none", "time_limit": 3600.0}
RARE = {"of": "utilisation_before_break", "above": 1.0, "samples": 1000, "level": 0.1, "seed": 1}
SAMPLE = ("count", "method", "seed")
KEEP = ("none", "broken", "all")
REMOVE = ("each", "group", "ids", "time", "duration")
EACH = {"element": "elements", "cable": "cables"}  # what is lost, and the key of [[remove]] that names it
FAILURE = ("name", "of", "above", "by")
SUNK = "sunk_area"  # the outcome that has a depth, `by`
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
    ids, kind = value.get("ids", []), int if value["each"] == "element" else str
    if not isinstance(ids, list) or not all(isinstance(one, kind) for one in ids) or value.get("ids") == []:
        wrong(f"{place}: ids = {shown(ids)}: expected a list of ids of elements, or of names of cables")
    elif len(set(ids)) < len(ids):
        wrong(f"{place}: ids: one stands in it twice")
    if not _number(value.get("time")) or value["time"] < 0:
        wrong(f"{place}: {_given(value, 'time')}; expected the time of the loss, s >= 0")
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


def check_sample(sample: dict, distributions: dict, vary: dict, rare: bool, wrong) -> None:
    """Check [sample]; distributions : its keys of the job; vary : those of [vary].

    rare : whether [rare] says how many are drawn, and how
    """
    for name in SAMPLE if rare else ():
        if name in sample:
            wrong(
                f"[sample] {name}: no effect beside [rare], which has samples and seed of its own; remove it"
            )
    if sample and not rare and not _whole(sample.get("count"), 1):
        wrong(f"[sample] {_given(sample, 'count')}; expected the number of draws, >= 1")
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


def _given(table: dict, name: str) -> str:
    return f"{name} = {shown(table[name])}" if name in table else f"{name}: missing"


def failure_sections(entries, losses: bool, wrong) -> tuple[Failure, ...]:
    """The measures of failure of [[failure]], in their order. losses : whether members are lost"""
    if not isinstance(entries, list) or not all(isinstance(each, dict) for each in entries):
        wrong(f"failure = {shown(entries)}: expected entries, [[failure]]")
        return ()
    names = [each.get("name") for each in entries]
    for number, each in enumerate(entries, 1):
        place = f"[[failure]] {number}"
        for name in set(each) - set(FAILURE):
            wrong(f"{place}: {name}: unknown key; {nearest(name, FAILURE)}")
        if not isinstance(each.get("name"), str) or not each["name"].strip():
            wrong(f"{place}: {_given(each, 'name')}; expected how the measure is called")
        elif names.index(each["name"]) < number - 1:
            wrong(f"{place}: name = {shown(each['name'])}: stands twice")
        measured = [one.name for one in OUTCOMES if one.measured and (losses or not one.of_losses)]
        if each.get("of") not in measured:
            known = ", ".join(measured)
            wrong(f"{place}: {_given(each, 'of')}; expected an outcome of a run: {known}")
        if not _number(each.get("above")):
            wrong(f"{place}: {_given(each, 'above')}; expected a number; more than it is a failure")
        if each.get("of") == SUNK and not (_number(each.get("by")) and each["by"] > 0.0):
            wrong(f"{place}: {_given(each, 'by')}; expected the depth from which a node has sunk, m > 0")
        if each.get("of") != SUNK and "by" in each:
            wrong(f"{place}: by: no effect but of {SUNK}; remove it")
    depths = {each["by"] for each in entries if _number(each.get("by"))}
    if len(depths) > 1:
        wrong(
            f"[[failure]] by: {', '.join(f'{by:g}' for by in sorted(depths))}: expected one depth in a study"
        )
    return tuple(Failure(*(each.get(name) for name in FAILURE)) for each in entries)


def rare_section(table: dict, vary: dict, sunk: bool, wrong) -> Rare | None:
    """What [rare] asks for; None without it. vary : the keys of [vary]; sunk : whether a depth is given"""
    if not table:
        return None
    for name in set(table) - set(RARE):
        wrong(f"[rare] {name}: unknown key; {nearest(name, RARE)}")
    given = RARE | {name: value for name, value in table.items() if name in RARE}
    measured = [one.name for one in OUTCOMES if one.measured and not one.of_losses]
    if given["of"] not in measured:
        wrong(f"[rare] of = {shown(given['of'])}: expected an outcome of a run: {', '.join(measured)}")
    if given["of"] == SUNK and not sunk:
        wrong(f"[rare] of = {shown(SUNK)}: expected its depth, `by`, in a [[failure]]")
    if not _number(given["above"]):
        wrong(f"[rare] above = {shown(given['above'])}: expected a number; more than it is a failure")
    if not _whole(given["samples"], 100) or given["samples"] > 100_000:
        wrong(
            f"[rare] samples = {shown(given['samples'])}: expected runs of a level, a whole number from 100 "
            "to 100000"
        )
    if not _number(given["level"]) or not 0.01 <= given["level"] <= 0.5:
        wrong(f"[rare] level = {shown(given['level'])}: expected the share that passes a level, 0.01 to 0.5")
    if not _whole(given["seed"], 0) or given["seed"] >= 2**30:
        wrong(f"[rare] seed = {shown(given['seed'])}: expected a whole number from 0 to 2^30 - 1")
    for name, value in vary.items():
        if name == "remove" or not isinstance(value, list) or len(value) != 1:
            wrong(f"[vary] {name}: beside [rare] a key of [vary] has one value, as [50.0]")
    return Rare(**given)


def hazard_section(table: dict, varies: bool, wrong) -> Hazard | None:
    """The distribution of the annual maxima of the wind; None without the section.

    varies : whether the speed of the wind does
    """
    if not table:
        return None
    if not varies:
        wrong(
            "[hazard] is of the mean wind speed, and that is one; expected wind.speed in [vary] or [sample]"
        )
    kind, years = table.get("distribution"), table.get("years", hazard.YEARS)
    if kind not in hazard.DISTRIBUTIONS:
        wrong(f"[hazard] {_given(table, 'distribution')}; expected {', '.join(hazard.DISTRIBUTIONS)}")
        return None
    given = hazard.DISTRIBUTIONS[kind]
    for name in set(table) - {"distribution", "years", *given}:
        wrong(f"[hazard] {name}: unknown key of {kind}; {nearest(name, ('years', *given))}")
    values = {name: table.get(name, default) for name, default in given.items()}
    for name, value in values.items():
        if not _number(value) or value <= 0:
            wrong(f"[hazard] {_given(table, name)}; expected a number > 0")
    if not _whole(years, 1):
        wrong(f"[hazard] years = {shown(years)}: expected a whole number >= 1")
    return Hazard(kind, values, years)
