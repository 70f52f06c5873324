"""State at the start of the static analysis: lengths for targets, length errors, stages of erection."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from netfall.core.errors import DivergedError, NoEquilibriumError, UndecidedError
from netfall.core.functions import lengths
from netfall.core.messages import without_code
from netfall.core.timings import NEVER_STOP, StopFlag
from netfall.driver import messages
from netfall.driver.erection.erect import Erection, erect
from netfall.driver.erection.settings import check_stages
from netfall.driver.erection.tension import (
    NewLengths,
    apply_length_errors,
    elastic,
    form_load,
    reach_targets,
)
from netfall.driver.problem import Problem
from netfall.driver.statics.equilibrium import solve_equilibrium
from netfall.driver.statics.outcome import failure_text, with_element_ids
from netfall.job.cache import ResultCache
from netfall.job.derived import carries_permanent
from netfall.job.job import Job
from netfall.model.layout import make_features
from netfall.model.model import Model, make_model, make_state
from netfall.parallel.agree import on_root
from netfall.physics.fields import REMOVED_BY_ERECTION
from netfall.results.datasets import UNDECIDED
from netfall.results.states import LIMIT_POINT
from netfall.statics.form.find import Form
from netfall.statics.relaxation import largest_force, state_residual
from netfall.statics.solver import EquilibriumFinder

MOST_TURNS = 10  # largest number of iterations of targets and permanent load


def solve_initial_state(problem: Problem, stop: StopFlag, cache: ResultCache) -> Problem:
    """Return the problem in equilibrium after targets, length errors and stages of erection. Collective.

    stop, cache : as in `prepare_problem`

    Raises InputError, DivergedError, StopRequested.
    """
    comm, job = problem.comm, problem.job
    if job.targets:
        problem = _solve_targets(problem)
    if problem.failure is None and comm.bcast(problem.model and bool(problem.model.net.length_error.any())):
        problem = _apply_length_errors(problem, cache)
    if problem.failure or not job.stages:
        return problem
    on_root(comm, lambda: check_stages(job, problem.root_model))
    return _after_erection(problem, erect(problem, stop))


def _build_up_step(
    problem: Problem, new_problem: Problem, result: NewLengths | None, group: str, failed: type[DivergedError]
) -> tuple[Problem, dict[str, Any]]:
    """Return the problem with the record of a step of its build-up, and its arrays on rank 0. Collective.

    problem, new_problem : before and after the step; result : on rank 0
    group : of the file, for a failure; failed : class of the error if the step failed and is not undecided
    """
    failure, build_up = None, problem.build_up
    labels: dict[str, dict[str, Any]] = {}
    reason, state = problem.comm.bcast((result.failed, result.state) if result else None)
    if reason:
        failure = (UndecidedError if state == UNDECIDED else failed)(reason)
    if result and (reason or result.limit):
        labels = {group: {"state": state, "reason": without_code(reason)}}
        labels[group] |= {LIMIT_POINT: result.limit.share} if result.limit else {}
    lines = [*build_up.lines, *(result.lines if result else ())]
    build_up = replace(build_up, lines=lines, labels={**build_up.labels, **labels}, failure=failure)
    return replace(new_problem, build_up=build_up), result.arrays() if result else {}


def _solve_targets(problem: Problem) -> Problem:
    """Return the problem in the form that meets its targets, or is closest to them. Collective."""
    step = _iterate_targets(problem)
    new_problem, arrays = _build_up_step(problem, *step, "form_finding", DivergedError)
    residual = _residual(new_problem)
    form = problem.form  # with targets, a given net has a form
    if form is None:
        state = new_problem.state
        reference = largest_force(problem.comm, state.present_element_state().N, state.ends, state.free)
        form = Form(np.zeros((0, 3)), np.zeros(0), 0, residual, reference)
    sections = {f"target_{name}": arrays[name] for name in ("change", "influence") if name in arrays}
    build_up = replace(new_problem.build_up, form_sections=sections)
    return replace(new_problem, form=form, residual=residual, build_up=build_up)


def _iterate_targets(problem: Problem) -> tuple[Problem, NewLengths | None]:
    """Return the problem with unstressed lengths that meet the targets, and these lengths. Collective.

    The permanent load depends on the lengths. Lengths and load are therefore iterated until the form is in
    equilibrium.
    """
    new_problem, reached, tolerance = problem, None, _load_tolerance(problem)
    for _ in range(MOST_TURNS):
        reached = reach_targets(new_problem, problem.model and problem.model.cut_length, reached)
        if problem.comm.bcast(reached and reached.failed):
            new_problem.state.x_start[:] = new_problem.state.x
            return _with_final_state(new_problem, reached), reached
        new_problem = _with_geometry(problem, reached and reached.arrays())
        residual = _residual(new_problem)
        if not residual > tolerance:
            return new_problem, reached
    line = messages.LOAD_CHANGES(what="targets", residual=residual)
    return new_problem, reached and reached._replace(lines=[*reached.lines, line])


def _load_tolerance(problem: Problem) -> float:
    """Return the allowed residual [N] of a change of the permanent load; inf: the form carries no load."""
    if problem.job.form_finding and problem.form and carries_permanent(problem.job):
        return problem.job.form_finding.tolerance * problem.form.reference
    return np.inf


def _with_geometry(problem: Problem, arrays: Any) -> Problem:
    """Return the problem with the geometry of a record of `NewLengths`. Collective."""
    return _with_model(
        problem, lambda: _with_lengths(problem.job, problem.root_model, arrays["x"], arrays["L0"])
    )


def _with_final_state(problem: Problem, outcome: NewLengths | None) -> Problem:
    """Return the problem with the model in the final state, for the result file only. Collective."""
    N = problem.gather_elements(problem.state.present_element_state().N)
    if problem.model is None or outcome is None or N is None:
        return problem
    return replace(problem, model=replace(problem.model, x=outcome.x, N=N, cut_length=outcome.L0))


def _residual(problem: Problem) -> float:
    """Compute the largest residual [N] of the form under its load. Collective."""
    return state_residual(problem.comm, problem.state, form_load(problem, "target", "the targets").load)


def _apply_length_errors(problem: Problem, cache: ResultCache) -> Problem:
    """Return the problem with length errors, in equilibrium under the resulting load. Collective."""

    def compute() -> tuple[Problem, NewLengths | None]:
        deviated, tolerance = apply_length_errors(problem, cache), _load_tolerance(problem)
        if problem.comm.bcast(deviated and deviated.failed):
            return _with_final_state(problem, deviated), deviated
        new_problem = _with_geometry(problem, deviated and deviated.arrays())
        for _ in range(MOST_TURNS):
            if not _residual(new_problem) > tolerance:
                break
            load_case = form_load(new_problem, "deviation", "errors of length")
            outcome = elastic(new_problem, solve_equilibrium(new_problem, load_case, None, NEVER_STOP))
            x = problem.distribution.gather_particles(new_problem.state.x)
            if deviated and x is not None:
                deviated = deviated._replace(x=x)
            if not outcome.carries:
                failed = failure_text(messages.ERRORS_WITHOUT_EQUILIBRIUM, load_case.title, outcome)
                deviated = deviated and deviated._replace(failed=failed, state=outcome.state)
                return _with_final_state(new_problem, deviated), deviated
            new_problem = _with_geometry(problem, deviated and deviated.arrays())
        if (residual := _residual(new_problem)) > tolerance and deviated:
            line = messages.LOAD_CHANGES(what="errors of length", residual=residual)
            deviated = deviated._replace(lines=[*deviated.lines, line])
        return new_problem, deviated

    new_problem, arrays = _build_up_step(problem, *compute(), "deviation", NoEquilibriumError)
    new_problem = replace(new_problem, residual=_residual(new_problem))
    build_up = new_problem.build_up
    if problem.model:
        datasets = {"tension_deviation": arrays["tension"], "piece_effect": arrays["effect"]}
        build_up = replace(build_up, sections={"deviation": datasets})
    return replace(new_problem, build_up=replace(build_up, form=problem.model if build_up.failure else None))


def _after_erection(problem: Problem, erection: Erection) -> Problem:
    """Return the problem after the last stage, or in the stage without an equilibrium. Collective."""
    model, setting, x, build_up = problem.model, erection.setting, erection.x, problem.build_up
    failure, labels = None, {}
    if erection.failed:
        last_state = list(erection.labels.values())[-1]["state"]
        failure = (UndecidedError if last_state == UNDECIDED else NoEquilibriumError)(erection.failed)
        failed_model = None  # for the result file only
        if model and x is not None and setting:
            layout = replace(model.layout, net=replace(model.net, fixed=setting.held(model.net)))
            failed_model = replace(model, layout=layout, x=x, cut_length=setting.L0)
        new_problem = replace(problem, model=failed_model)
        new_problem.state.x_start[:] = new_problem.state.x
    else:
        new_problem = _with_model(problem, lambda: _model_after_erection(problem, x, setting))
        active = problem.distribution.elements(setting and setting.active)
        new_problem.state.EA[~active], new_problem.state.broken[~active] = 0.0, REMOVED_BY_ERECTION
        if new_problem.state.features.slip:
            new_problem.state.stage_slip[:] = problem.distribution.elements(setting and setting.slipped)
    if model:
        ids = model.net.element_id
        labels = {group: with_element_ids(values, ids) for group, values in erection.labels.items()}
    build_up = replace(
        build_up,
        form=build_up.form or model,
        sections={**build_up.sections, **erection.sections},
        labels={**build_up.labels, **labels},
        lines=[*build_up.lines, *erection.lines],
        failure=failure,
    )
    return replace(new_problem, build_up=build_up)


def _with_model(problem: Problem, make: Callable[[], Model]) -> Problem:
    """Return the problem with another model, the result of `make` on rank 0. Collective."""
    model = on_root(problem.comm, make)
    features = problem.comm.bcast(model and make_features(problem.job, model.layout.net, model.layout.slides))
    state = make_state(problem.distribution, problem.job, model, features)
    finder = EquilibriumFinder(problem.comm, problem.halo, problem.distribution, state)
    return replace(problem, model=model, state=state, finder=finder)


def _with_lengths(job: Job, model: Model, x: np.ndarray, L0: np.ndarray, **columns: Any) -> Model:
    """Return the model with nodes at x (n, 3) [m] and unstressed lengths L0 (m,) [m] before heating.

    columns : of its net. Bending chains keep their joints, whose moments refer to the original geometry.
    """
    net = replace(model.net, unstressed_length=L0, **columns)
    new_model = make_model(job, replace(model.layout, net=net), x, None)
    rest = model.spring_rest - (x - model.x)
    new_model = replace(new_model, area_given=model.area_given, spring_rest=rest)
    return replace(new_model, joints=model.joints) if model.joints is not None else new_model


def _model_after_erection(problem: Problem, x: Any, setting: Any) -> Model:
    """Return the model of the last stage; x, setting : as in `Erection`. Rank 0.

    Absent elements have no force or weight, and their nodes are fixed.
    """
    model, net, active = problem.root_model, problem.root_model.net, setting.active
    L = lengths(x[net.elements[:, 1]] - x[net.elements[:, 0]])
    L0, density = np.where(active, setting.L0, L), np.where(active, net.density, 0.0)
    new_model = _with_lengths(problem.job, model, x, L0, fixed=setting.held(net), density=density)
    return replace(new_model, cut_length=setting.L0)
