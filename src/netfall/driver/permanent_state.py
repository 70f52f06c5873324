"""State at the start of the static analysis: lengths for targets, length errors, stages of erection."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from netfall.core.errors import DivergedError, UndecidedError, interruption_error
from netfall.core.functions import lengths
from netfall.core.message import without_code
from netfall.core.stop import StopFlag
from netfall.driver import messages
from netfall.driver.erection.deviation import LengthErrors, apply_length_errors
from netfall.driver.erection.erect import Erection, erect, restored_erection
from netfall.driver.erection.settings import StageSetting, check_stages
from netfall.driver.erection.tension import TargetResult, form_load, reach_targets
from netfall.driver.problem import BuildUp, Problem
from netfall.driver.static_outcome import NO_EQUILIBRIUM, UNDECIDED, with_element_ids
from netfall.job.derived import carries_permanent
from netfall.job.job import Job
from netfall.model.distribution import make_state
from netfall.model.layout import make_features
from netfall.model.model import Model, make_model
from netfall.parallel.agree import on_root
from netfall.physics.fields import REMOVED_BY_ERECTION
from netfall.results.checkpoint import Checkpoint
from netfall.statics.form.find import Form
from netfall.statics.form.initial import INITIAL, initial_record, write_before_stages
from netfall.statics.relaxation import Paused, state_residual
from netfall.statics.solver import EquilibriumFinder

TARGETS, DEVIATION, ERECTION = "targets", "errors of length", "erection"  # names in checkpoints
MOST_TURNS = 10  # largest number of iterations of targets and permanent load
ERECTION_STEP_OFFSET = (
    1_000_000  # offset of erection steps in names of checkpoints, above any step of form finding
)


def solve_initial_state(
    problem: Problem,
    result: Path | None,
    restart: Path | None,
    checkpoint: Checkpoint | None,
    stop: StopFlag,
) -> Problem:
    """Return the problem in equilibrium after targets, length errors and stages of erection. Collective.

    result, restart, checkpoint, stop : as in `prepare`. Raises InputError, DivergedError, Interrupted.
    """
    parts = problem.comm.bcast(checkpoint and set(checkpoint.record["parts"])) or set()
    build_up = BuildUp(base=problem.model)
    if problem.job.targets:
        problem, build_up = _solve_targets(problem, build_up, _record(checkpoint, parts, TARGETS))
    if build_up.failure:
        return replace(problem, build_up=build_up)
    if problem.comm.bcast(problem.model and bool(problem.model.net.length_error.any())):
        problem, build_up = _apply_length_errors(problem, build_up, _record(checkpoint, parts, DEVIATION))
    if build_up.failure or not problem.job.stages:
        return replace(problem, build_up=build_up)
    on_root(problem.comm, lambda: check_stages(problem.job, problem.root_model))
    erection = Erection()
    if record := _record(checkpoint, parts, ERECTION):
        small, arrays = record
        erection = restored_erection(problem, problem.comm.bcast(small), arrays)
    try:
        erect(problem, erection, stop)
    except Paused:
        if result is None:
            raise
        path = _write_pause_checkpoint(problem, build_up, erection, result, restart)
        words = f"in stage {problem.job.stages[erection.done].name}, which the resumed run repeats"
        raise interruption_error(words, path) from None
    return _after_erection(problem, build_up, erection)


def _record(checkpoint: Checkpoint | None, parts: set[str], name: str) -> tuple[Any, ...] | None:
    """Return a record of a checkpoint, None if `parts` lacks it; (None, None) on ranks other than 0."""
    if name not in parts:
        return None
    return checkpoint.part(name) if checkpoint else (None, None)


def _solve_targets(
    problem: Problem, build_up: BuildUp, record: tuple[Any, ...] | None
) -> tuple[Problem, BuildUp]:
    """Return the problem in the form that meets its targets, or comes nearest to them. Collective.

    record : of an earlier run, None without one
    """
    reason, comm = "", problem.comm
    if record is None:
        new_problem, reached = _iterate_targets(problem)
        reason = comm.bcast(reached and reached.failed)
        record = ({"lines": reached.lines}, reached.arrays()) if reached else ({}, {})
    else:
        new_problem = _with_geometry(problem, record[1])
    small, arrays = record
    residual = _residual(new_problem)
    form = problem.form  # targets give a net as given a form
    if form is None:
        form = Form(np.zeros((0, 3)), np.zeros(0), 0, residual, problem.reference)
    new_problem = replace(new_problem, form=form, residual=residual)
    if problem.model:
        sections = {f"target_{name}": arrays[name] for name in ("change", "influence")}
        labels = {}
        if reason:
            labels["form_finding"] = {"state": NO_EQUILIBRIUM, "reason": without_code(reason)}
        build_up = replace(build_up, form_sections=sections, lines=small["lines"], labels=labels)
    failure = DivergedError(reason) if reason else None
    records = {TARGETS: (comm.bcast(small), arrays or {})}
    return new_problem, replace(build_up, records=records, failure=failure)


def _iterate_targets(problem: Problem) -> tuple[Problem, TargetResult | None]:
    """Return the problem with unstressed lengths that meet the targets, and these lengths. Collective.

    The permanent load depends on the lengths. Lengths and load are therefore iterated until the form is in
    equilibrium.
    """
    new_problem, reached, tolerance = problem, None, np.inf
    if problem.job.form_finding and problem.form and carries_permanent(problem.job):
        tolerance = problem.job.form_finding.tolerance * problem.form.reference
    for _ in range(MOST_TURNS):
        reached = reach_targets(new_problem, problem.model and problem.model.cut_length, reached)
        if problem.comm.bcast(reached and reached.failed):
            new_problem.state.x_start[:] = new_problem.state.x
            return _with_final_state(new_problem, reached), reached
        new_problem = _with_geometry(problem, reached and reached.arrays())
        residual = _residual(new_problem)
        if not residual > tolerance:
            return new_problem, reached
    line = messages.TARGET_LOAD_CHANGES(residual=residual)
    return new_problem, reached and reached._replace(lines=[*reached.lines, line])


def _with_geometry(problem: Problem, arrays: dict[str, Any] | None) -> Problem:
    """Return the problem with the geometry of a record of `TargetResult` or `LengthErrors`. Collective."""

    def make() -> Model:
        assert arrays is not None  # on rank 0
        return _with_lengths(problem.job, problem.root_model, arrays["x"], arrays["L0"])

    return _with_model(problem, make)


def _with_final_state(problem: Problem, outcome: TargetResult | LengthErrors | None) -> Problem:
    """Return the problem with the model in the final state, for the result file only. Collective."""
    N = problem.distribution.gather_elements(
        problem.state.present_element_state().N, problem.state.owned.astype(bool)
    )
    if problem.model is None or outcome is None or N is None:
        return problem
    return replace(problem, model=replace(problem.model, x=outcome.x, N=N, cut_length=outcome.L0))


def _residual(problem: Problem) -> float:
    """Compute the largest residual [N] of the form under its load. Collective."""
    return state_residual(problem.comm, problem.state, form_load(problem, "target", "the targets").load)


def _apply_length_errors(
    problem: Problem, build_up: BuildUp, record: tuple[Any, ...] | None
) -> tuple[Problem, BuildUp]:
    """Return the problem with length errors; record : as in `_solve_targets`. Collective."""
    reason, deviated = "", None
    if record is None:
        deviated = apply_length_errors(problem)
        reason = problem.comm.bcast(deviated and deviated.failed)
        record = ({"lines": deviated.lines}, deviated.arrays()) if deviated else ({}, {})
    small, arrays = record
    new_problem = _with_final_state(problem, deviated) if reason else _with_geometry(problem, arrays)
    if reason:
        build_up = replace(build_up, form=problem.model)
    if problem.model:
        deviations = {"tension_deviation": arrays["tension"], "piece_effect": arrays["effect"]}
        lines = [*build_up.lines, *small["lines"]]
        labels = {}
        if deviated and reason:
            labels["deviation"] = {"state": deviated.state, "reason": without_code(reason)}
        build_up = replace(build_up, sections={"deviation": deviations}, lines=lines, labels=labels)
    records = {**build_up.records, DEVIATION: (problem.comm.bcast(small), arrays or {})}
    failure = _search_error(reason, problem.comm.bcast(deviated and deviated.state)) if reason else None
    return new_problem, replace(build_up, records=records, failure=failure)


def _search_error(reason: str, state: str) -> DivergedError:
    """Return the error that ends the run. state : of the equilibrium that was sought"""
    return (UndecidedError if state == UNDECIDED else DivergedError)(reason)


def _after_erection(problem: Problem, build_up: BuildUp, erection: Erection) -> Problem:
    """Return the problem after the last stage, or in the stage that has no equilibrium. Collective."""
    setting, x = erection.setting, erection.x
    if erection.failed:
        model = None
        if problem.model and x is not None and setting:
            model = _model_at_failure(problem.model, x, setting)
        new_problem = replace(problem, model=model)
        new_problem.state.x_start[:] = new_problem.state.x
    else:

        def make() -> Model:
            assert x is not None and setting is not None  # on rank 0
            return _model_after_erection(problem.job, problem.root_model, x, setting)

        new_problem = _with_model(problem, make)
        active = problem.distribution.elements(setting and setting.active)
        new_problem.state.EA[~active], new_problem.state.broken[~active] = 0.0, REMOVED_BY_ERECTION
    labels = {}
    if problem.model:
        ids = problem.model.net.element_id
        labels = {group: with_element_ids(values, ids) for group, values in erection.labels.items()}
    build_up = replace(
        build_up,
        form=build_up.form or problem.model,
        sections={**build_up.sections, **erection.sections},
        labels=labels,
        lines=[*build_up.lines, *erection.lines],
        records={**build_up.records, ERECTION: erection.record()},
        failure=_search_error(erection.failed, erection.last_state) if erection.failed else None,
    )
    return replace(new_problem, build_up=build_up)


def _with_model(problem: Problem, make: Callable[[], Model]) -> Problem:
    """Return the problem with another model, which `make` returns on rank 0. Collective."""
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


def _model_at_failure(model: Model, x: np.ndarray, setting: StageSetting) -> Model:
    """Return the model at a stage without equilibrium, for the result file only."""
    layout = replace(model.layout, net=replace(model.net, fixed=setting.held(model.net)))
    return replace(model, layout=layout, x=x, cut_length=setting.L0)


def _model_after_erection(job: Job, model: Model, x: np.ndarray, setting: StageSetting) -> Model:
    """Return the model of the last stage.

    Absent elements have no force or weight, and their nodes are fixed.
    """
    net, active = model.net, setting.active
    L = lengths(x[net.elements[:, 1]] - x[net.elements[:, 0]])
    fixed, density = setting.held(net), np.where(active, net.density, 0.0)
    new_model = _with_lengths(job, model, x, np.where(active, setting.L0, L), fixed=fixed, density=density)
    return replace(new_model, cut_length=setting.L0)


def _write_pause_checkpoint(
    problem: Problem, build_up: BuildUp, erection: Erection, result: Path, given: Path | None
) -> Path:
    """Write a checkpoint of an erection between two stages, and return its path. Collective."""
    initial = initial_record(problem.form, build_up.base)
    parts = {**build_up.records, INITIAL: initial, ERECTION: erection.record()}
    step = ERECTION_STEP_OFFSET + erection.done
    return write_before_stages(problem.comm, problem.job, result, problem.digest, step, parts, given)
