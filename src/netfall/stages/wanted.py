"""Which equilibria a job asks for, in order, and what acts in each."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from netfall.job.asks import load_steps, own_weight, rests_at_loss, rests_in_wind
from netfall.job.cases import factor_of
from netfall.model.actions import ALL_LOADS, Actions, StaticLoad, of_case_alone, of_combination
from netfall.model.model import Model
from netfall.stages.scene import Scene


class Wanted(NamedTuple):
    """An equilibrium that is looked for.

    each : the load, without what acts; acts(model) : what does, on rank 0
    """

    each: StaticLoad
    acts: Callable[[Model], Actions]


def equilibria(scene: Scene) -> list[Wanted]:
    """What the job asks for, in order: permanent loads, cases, combinations, load steps, rest."""
    job = scene.job
    steps, rests = load_steps(job), rests_in_wind(job)
    apart = [
        *((case, of_case_alone) for case in job.cases),
        *((each, of_combination) for each in job.combinations),
    ]
    wanted = []

    weights = own_weight(job)

    def want(kind: str, words: str, acts: Callable[[Model], np.ndarray], **more) -> None:
        load = StaticLoad(kind, words, None, weights=weights, **more)
        wanted.append(Wanted(load, lambda model: Actions(acts(model))))

    if apart or steps:
        want("permanent", "the permanent loads", lambda model: model.loading.permanent)
    for entry, acts in apart:
        what = "case" if acts is of_case_alone else "combination"
        share = weights * factor_of(entry, "permanent") if acts is of_combination else weights
        each = StaticLoad(what, f"{what} {entry.name}", None, 1.0, entry.name, True, weights=share)
        wanted.append(Wanted(each, lambda model, entry=entry, acts=acts: acts(job, model, entry)))
    again = bool(apart)
    for step in range(1, steps + 1):
        part = lambda model, factor=step / steps: model.loading.permanent + factor * model.loading.live
        first = again and step == 1
        more = {"factor": step / steps, "from_permanent": first, "begins": (step - 1) / steps}
        want("step", f"static load step {step} of {steps}", part, **more)
    if rests and not steps:
        want("at once", "the constant loads", lambda model: model.load, factor=1.0, from_permanent=again)
    if rests_at_loss(job):
        want("rest", ALL_LOADS, lambda model: model.load, factor=1.0, from_permanent=again and not steps)
    if rests:
        want("rest", "the mean wind", lambda model: model.load + model.mean_wind, factor=1.0)
    return wanted


def loaded(scene: Scene, wanted: Wanted) -> StaticLoad:
    """The load of an equilibrium, with what acts on this rank. Collective."""
    distribution = scene.distribution
    acts = wanted.acts(scene.model) if scene.model else None
    there = scene.comm.bcast(acts and {name for name, values in vars(acts).items() if values is not None})
    parts = {}
    for name in Actions.__dataclass_fields__:
        if name in there:
            scatter = distribution.elements if name == "L0" else distribution.particles
            parts[name] = scatter(acts and getattr(acts, name))
    return wanted.each._replace(**parts)
