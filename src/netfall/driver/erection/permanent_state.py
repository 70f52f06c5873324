"""State at the start of the static analysis: lengths for targets, length errors, stages of erection."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from netfall.core.errors import DivergedError, NoEquilibriumError, UndecidedError, interruption_error
from netfall.core.functions import lengths
from netfall.core.messages import without_code
from netfall.core.timings import NEVER_STOP, StopFlag, StopRequested
from netfall.driver import messages
from netfall.driver.erection.erect import Erection, erect, restored_erection
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
from netfall.results.checkpoint import Checkpoint
from netfall.results.datasets import UNDECIDED
from netfall.results.states import LIMIT_POINT
from netfall.statics.form.find import Form
from netfall.statics.form.initial import INITIAL, initial_record
from netfall.statics.relaxation import largest_force, state_residual
from netfall.statics.solver import EquilibriumFinder

TARGETS, DEVIATION, ERECTION = "targets", "errors of length", "erection"  # names in checkpoints
MOST_TURNS = 10  # largest number of iterations of targets and permanent load
# offset of erection steps in names of checkpoints, above any step of form finding
ERECTION_STEP_OFFSET = 1_000_000


def solve_initial_state(
    problem: Problem,
    save: Callable[[int, dict[str, Any]], Path],
    checkpoint: Checkpoint | None,
    stop: StopFlag,
    cache: ResultCache,
) -> Problem:
    """Return the problem in equilibrium after targets, length errors and stages of erection. Collective.

    save : see `find_initial_form`; checkpoint, stop, cache : as in `prepare_problem`

    Raises InputError, DivergedError, Interrupted.
    """
    comm, job = problem.comm, problem.job
    parts = comm.bcast(checkpoint and set(checkpoint.record["parts"])) or set()

    def record_of(name: str) -> tuple[Any, ...] | None:
        if name not in parts:
            return None
        return checkpoint.part(name) if checkpoint else (None, None)

    if job.targets:
        problem = _solve_targets(problem, record_of(TARGETS))
    if problem.failure is None and comm.bcast(problem.model and bool(problem.model.net.length_error.any())):
        problem = _apply_length_errors(problem, record_of(DEVIATION), cache)
    if problem.failure or not job.stages:
        return problem
    on_root(comm, lambda: check_stages(job, problem.root_model))
    erection = Erection()
    if record := record_of(ERECTION):
        erection = restored_erection(problem, comm.bcast(record[0]), record[1])
    try:
        erect(problem, erection, stop)
    except StopRequested:
        initial = initial_record(problem.form, problem.build_up.base)
        records = {**problem.build_up.records, INITIAL: initial, ERECTION: erection.record()}
        path = save(ERECTION_STEP_OFFSET + erection.done, records)
        text = f"in stage {job.stages[erection.done].name}, which the resumed run repeats"
        raise interruption_error(text, path) from None
    return _after_erection(problem, erection)


def _build_up_step(
    problem: Problem,
    name: str,
    group: str,
    record: tuple[Any, ...] | None,
    compute: Callable[[Problem], tuple[Problem, NewLengths | None]],
) -> tuple[Problem, dict[str, Any]]:
    """Return the problem after a step of its build-up, and the arrays of its record on rank 0. Collective.

    name, record : of the step in checkpoints, None: to compute; group : of the file, for a failure
    compute : returns the problem after the step, and the result on rank 0
    """
    comm, failure = problem.comm, None
    labels: dict[str, dict[str, Any]] = {}
    if record is None:
        new_problem, result = compute(problem)
        reason, state = comm.bcast((result.failed, result.state) if result else None)
        if result and (reason or result.limit):
            labels = {group: {"state": state, "reason": without_code(reason)}}
            labels[group] |= {LIMIT_POINT: result.limit.share} if result.limit else {}
        record = ({"lines": result.lines, "labels": labels}, result.arrays()) if result else ({}, {})
        if reason:
            failure = DivergedError(reason) if name == TARGETS else _search_error(reason, state)
    else:
        new_problem = _with_geometry(problem, record[1])
    small, arrays, build_up = comm.bcast(record[0]), record[1] or {}, problem.build_up
    lines, records = [*build_up.lines, *small["lines"]], {**build_up.records, name: (small, arrays)}
    labels = {**build_up.labels, **small["labels"]}
    build_up = replace(build_up, lines=lines, labels=labels, records=records, failure=failure)
    return replace(new_problem, build_up=build_up), arrays


def _solve_targets(problem: Problem, record: tuple[Any, ...] | None) -> Problem:
    """Return the problem in the form that meets its targets, or is closest to them. Collective."""
    new_problem, arrays = _build_up_step(problem, TARGETS, "form_finding", record, _iterate_targets)
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


def _apply_length_errors(problem: Problem, record: tuple[Any, ...] | None, cache: ResultCache) -> Problem:
    """Return the problem with length errors, in equilibrium under the resulting load. Collective."""

    def compute(problem: Problem) -> tuple[Problem, NewLengths | None]:
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

    new_problem, arrays = _build_up_step(problem, DEVIATION, "deviation", record, compute)
    new_problem = replace(new_problem, residual=_residual(new_problem))
    build_up = new_problem.build_up
    if problem.model:
        datasets = {"tension_deviation": arrays["tension"], "piece_effect": arrays["effect"]}
        build_up = replace(build_up, sections={"deviation": datasets})
    return replace(new_problem, build_up=replace(build_up, form=problem.model if build_up.failure else None))


def _search_error(reason: str, state: str) -> DivergedError:
    """Return the error that ends the run. state : outcome of the equilibrium search"""
    return (UndecidedError if state == UNDECIDED else NoEquilibriumError)(reason)


def _after_erection(problem: Problem, erection: Erection) -> Problem:
    """Return the problem after the last stage, or in the stage without an equilibrium. Collective."""
    model, setting, x, build_up = problem.model, erection.setting, erection.x, problem.build_up
    failure, labels = None, {}
    if erection.failed:
        last_state = list(erection.labels.values())[-1]["state"]
        failure = _search_error(erection.failed, last_state)
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
        records={**build_up.records, ERECTION: erection.record()},
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
