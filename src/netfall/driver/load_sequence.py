"""Equilibria that a job needs, in order, with the loads that act in each."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from netfall.driver.problem import Problem
from netfall.job.derived import (
    load_steps,
    permanent_weight_factor,
    starts_in_mean_wind,
    starts_loaded_for_removal,
)
from netfall.job.job import Job
from netfall.job.keys.cases import action_factor
from netfall.job.keys.entries import Case, Combination
from netfall.model.actions import ALL_LOADS, Actions, StaticLoad, case_actions, combination_actions
from netfall.model.model import Model

UNKNOWN_LOAD = np.zeros((0, 3))  # N, in place of a load that is not computed yet


class EquilibriumRequest(NamedTuple):
    """Equilibrium to be computed.

    each : the load, without arrays; actions_of(model) : returns its arrays, on rank 0
    """

    each: StaticLoad
    actions_of: Callable[[Model], Actions]


def equilibria(problem: Problem) -> list[EquilibriumRequest]:
    """List the equilibria that the job needs, in their order.

    Permanent loads come first, then cases, combinations, load steps, and the final equilibrium.
    """
    job = problem.job
    steps, final_wind = load_steps(job), starts_in_mean_wind(job)
    apart: list[tuple[Any, Callable[[Job, Model, Any], Actions]]] = [
        *((case, case_actions) for case in job.cases),
        *((static_load, combination_actions) for static_load in job.combinations),
    ]
    requests: list[EquilibriumRequest] = []

    weights = permanent_weight_factor(job)

    def want(kind: str, name: str, acts: Callable[[Model], np.ndarray], **options: Any) -> None:
        load = StaticLoad(kind, name, UNKNOWN_LOAD, weights=weights, **options)
        requests.append(EquilibriumRequest(load, lambda model: Actions(acts(model))))

    if apart or steps:
        want("permanent", "the permanent loads", lambda model: model.loading.permanent)
    for entry, acts in apart:
        what = "case" if acts is case_actions else "combination"
        weight = weights * action_factor(entry, "permanent") if acts is combination_actions else weights
        static_load = StaticLoad(
            what, f"{what} {entry.name}", UNKNOWN_LOAD, 1.0, entry.name, True, weights=weight
        )
        requests.append(EquilibriumRequest(static_load, partial(_actions_of, acts, job, entry)))
    has_cases = bool(apart)
    for step in range(1, steps + 1):
        want(
            "step",
            f"static load step {step} of {steps}",
            partial(_step_load, step / steps),
            factor=step / steps,
            from_permanent=has_cases and step == 1,
            start_factor=(step - 1) / steps,
        )
    if final_wind and not steps:
        want("at once", "the constant loads", lambda model: model.load, factor=1.0, from_permanent=has_cases)
    if starts_loaded_for_removal(job):
        want(
            "initial_state",
            ALL_LOADS,
            lambda model: model.load,
            factor=1.0,
            from_permanent=has_cases and not steps,
        )
    if final_wind:
        want("initial_state", "the mean wind", lambda model: model.load + model.mean_wind, factor=1.0)
    return requests


def _actions_of(
    acts: Callable[[Job, Model, Any], Actions], job: Job, entry: Case | Combination, model: Model
) -> Actions:
    """Return the actions of a case or combination."""
    return acts(job, model, entry)


def _step_load(factor: float, model: Model) -> np.ndarray:
    """Compute the load (n, 3) [N] of a load step."""
    return model.loading.permanent + factor * model.loading.live


def loaded(problem: Problem, request: EquilibriumRequest) -> StaticLoad:
    """Return the load of an equilibrium with its arrays on this rank. Collective."""
    distribution = problem.distribution
    actions = request.actions_of(problem.model) if problem.model else None
    names = problem.comm.bcast(
        actions and {name for name, values in vars(actions).items() if values is not None}
    )
    parts: dict[str, Any] = {}
    for name in Actions.__dataclass_fields__:
        if name in names:
            scatter = distribution.elements if name == "L0" else distribution.particles
            parts[name] = scatter(getattr(actions, name) if actions else None)
    return request.each._replace(**parts)
