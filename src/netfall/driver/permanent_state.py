"""State at the start of the static analysis: lengths for targets, length errors, stages of erection."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from netfall.core.errors import DivergedError, UndecidedError, interruption_error
from netfall.core.functions import lengths
from netfall.core.stop import StopFlag
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
    scene: Problem, result: Path, restart: Path | None, checkpoint, stop: StopFlag
) -> Problem:
    """Return the scene in equilibrium after targets, length errors and stages of erection. Collective.

    result, restart, checkpoint, stop : as in `prepare`. Raises InputError, DivergedError, Interrupted.
    """
    parts = scene.comm.bcast(checkpoint and set(checkpoint.record["parts"])) or set()
    build_up = BuildUp(base=scene.model)
    if scene.job.targets:
        scene, build_up = _solve_targets(scene, build_up, _record(checkpoint, parts, TARGETS))
    if build_up.failure:
        return replace(scene, build_up=build_up)
    if scene.comm.bcast(scene.model and bool(scene.model.net.length_error.any())):
        scene, build_up = _apply_length_errors(scene, build_up, _record(checkpoint, parts, DEVIATION))
    if build_up.failure or not scene.job.stages:
        return replace(scene, build_up=build_up)
    on_root(scene.comm, lambda: check_stages(scene.job, scene.model))
    erection = Erection()
    if record := _record(checkpoint, parts, ERECTION):
        small, arrays = record
        erection = restored_erection(scene, scene.comm.bcast(small), arrays)
    try:
        erect(scene, erection, stop)
    except Paused:
        path = _write_pause_checkpoint(replace(scene, build_up=build_up), erection, result, restart)
        words = f"in stage {scene.job.stages[erection.done].name}, from whose start it goes on"
        raise interruption_error(words, path) from None
    return _after_erection(scene, build_up, erection)


def _record(checkpoint, parts: set[str], name: str) -> tuple | None:
    """Return a record of a checkpoint, None if `parts` lacks it; (None, None) on ranks other than 0."""
    if name not in parts:
        return None
    return checkpoint.part(name) if checkpoint else (None, None)


def _solve_targets(scene: Problem, build_up: BuildUp, record: tuple | None) -> tuple[Problem, BuildUp]:
    """Return the scene in the form that meets its targets, or comes nearest to them. Collective.

    record : of an earlier run, None without one
    """
    reason, comm = "", scene.comm
    if record is None:
        new_scene, reached = _iterate_targets(scene)
        reason = comm.bcast(reached and reached.failed)
        record = ({"lines": reached.lines}, reached.arrays()) if reached else ({}, {})
    else:
        new_scene = _with_geometry(scene, record[1])
    small, arrays = record
    residual = _residual(new_scene)
    form = scene.form or Form(None, None, 0, residual, scene.reference)  # targets give a net as given a form
    new_scene = replace(new_scene, form=form, residual=residual)
    if scene.model:
        form = {f"target_{name}": arrays[name] for name in ("change", "influence")}
        labels = {"form_finding": {"state": NO_EQUILIBRIUM, "reason": reason}} if reason else {}
        build_up = replace(build_up, form_sections=form, lines=small["lines"], labels=labels)
    failure = DivergedError(reason) if reason else None
    records = {TARGETS: (comm.bcast(small), arrays or {})}
    return new_scene, replace(build_up, records=records, failure=failure)


def _iterate_targets(scene: Problem) -> tuple[Problem, TargetResult | None]:
    """Return the scene with unstressed lengths that meet the targets, and these lengths. Collective.

    The permanent load depends on the lengths. Lengths and load are therefore iterated until the form is in
    equilibrium.
    """
    new_scene, reached, tolerance = scene, None, np.inf
    if carries_permanent(scene.job):
        tolerance = scene.job.form_finding.tolerance * scene.form.reference
    for _ in range(MOST_TURNS):
        reached = reach_targets(new_scene, scene.model and scene.model.cut_length, reached)
        if scene.comm.bcast(reached and reached.failed):
            new_scene.state.x_start[:] = new_scene.state.x
            return _with_final_state(new_scene, reached), reached
        new_scene = _with_geometry(scene, reached and reached.arrays())
        residual = _residual(new_scene)
        if not residual > tolerance:
            return new_scene, reached
    line = f"targets: the permanent load changes with lengths: {residual:.3g} N are left"
    return new_scene, reached and reached._replace(lines=[*reached.lines, line])


def _with_geometry(scene: Problem, arrays: dict | None) -> Problem:
    """Return the scene with nodes and lengths of a record of `TargetResult` or `LengthErrors`. Collective."""
    return _with_model(scene, lambda: _with_lengths(scene.job, scene.model, arrays["x"], arrays["L0"]))


def _with_final_state(scene: Problem, outcome: TargetResult | LengthErrors | None) -> Problem:
    """Return the scene with the model in the final state, for the result file only. Collective."""
    N = scene.distribution.gather_elements(
        scene.state.present_element_state().N, scene.state.owned.astype(bool)
    )
    return replace(scene, model=scene.model and replace(scene.model, x=outcome.x, N=N, cut_length=outcome.L0))


def _residual(scene: Problem) -> float:
    """Compute the largest residual [N] of the form under its load. Collective."""
    return state_residual(scene.comm, scene.state, form_load(scene, "target", "the targets").load)


def _apply_length_errors(scene: Problem, build_up: BuildUp, record: tuple | None) -> tuple[Problem, BuildUp]:
    """Return the scene with length errors; record : as in `_solve_targets`. Collective."""
    reason, deviated = "", None
    if record is None:
        deviated = apply_length_errors(scene)
        reason = scene.comm.bcast(deviated and deviated.failed)
        record = ({"lines": deviated.lines}, deviated.arrays()) if deviated else ({}, {})
    small, arrays = record
    new_scene = _with_final_state(scene, deviated) if reason else _with_geometry(scene, arrays)
    if reason:
        build_up = replace(build_up, form=scene.model)
    if scene.model:
        deviations = {"tension_deviation": arrays["tension"], "piece_effect": arrays["effect"]}
        lines = [*build_up.lines, *small["lines"]]
        labels = {"deviation": {"state": deviated.state, "reason": reason}} if reason else {}
        build_up = replace(build_up, sections={"deviation": deviations}, lines=lines, labels=labels)
    records = build_up.records | {DEVIATION: (scene.comm.bcast(small), arrays or {})}
    failure = _search_error(reason, scene.comm.bcast(deviated and deviated.state)) if reason else None
    return new_scene, replace(build_up, records=records, failure=failure)


def _search_error(reason: str, state: str) -> DivergedError:
    """Return the error that ends the run. state : of the equilibrium that was sought"""
    return (UndecidedError if state == UNDECIDED else DivergedError)(reason)


def _after_erection(scene: Problem, build_up: BuildUp, erection: Erection) -> Problem:
    """Return the scene at the end of the last stage, or of the stage that has no equilibrium. Collective."""
    setting, x = erection.setting, erection.x
    if erection.failed:
        new_scene = replace(scene, model=scene.model and _model_at_failure(scene.model, x, setting))
        new_scene.state.x_start[:] = new_scene.state.x
    else:
        new_scene = _with_model(scene, lambda: _model_after_erection(scene.job, scene.model, x, setting))
        active = scene.distribution.elements(setting and setting.active)
        new_scene.state.EA[~active], new_scene.state.broken[~active] = 0.0, REMOVED_BY_ERECTION
    ids = scene.model and scene.model.net.element_id
    build_up = replace(
        build_up,
        form=build_up.form or scene.model,
        sections=build_up.sections | erection.sections,
        labels=scene.model
        and {group: with_element_ids(attributes, ids) for group, attributes in erection.labels.items()},
        lines=[*build_up.lines, *erection.lines],
        records=build_up.records | {ERECTION: erection.record()},
        failure=_search_error(erection.failed, erection.last_state) if erection.failed else None,
    )
    return replace(new_scene, build_up=build_up)


def _with_model(scene: Problem, make) -> Problem:
    """Return the scene with another model, which `make` returns on rank 0. Collective."""
    model = on_root(scene.comm, make)
    features = scene.comm.bcast(model and make_features(scene.job, model.layout.net, model.layout.slides))
    state = make_state(scene.distribution, model, features)
    finder = EquilibriumFinder(scene.comm, scene.halo, scene.distribution, state)
    return replace(scene, model=model, state=state, finder=finder)


def _with_lengths(job: Job, model: Model, x: np.ndarray, L0: np.ndarray, **columns) -> Model:
    """Return the model with nodes at x (n, 3) [m] and unstressed lengths L0 (m,) [m] before heating.

    columns : of its net. Bending chains keep their joints, whose moments refer to the original geometry.
    """
    net = replace(model.net, unstressed_length=L0, **columns)
    new_model = make_model(job, replace(model.layout, net=net), x, None)
    rest = model.spring_rest - (x - model.x)
    return replace(new_model, area_given=model.area_given, spring_rest=rest, joints=model.joints)


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


def _write_pause_checkpoint(scene: Problem, erection: Erection, result: Path, given: Path | None) -> Path:
    """Write a checkpoint of an erection between two stages, and return its path. Collective."""
    initial = initial_record(scene.form, scene.build_up.base)
    parts = scene.build_up.records | {INITIAL: initial, ERECTION: erection.record()}
    step = ERECTION_STEP_OFFSET + erection.done
    return write_before_stages(scene.comm, scene.job, result, scene.digest, step, parts, given)
