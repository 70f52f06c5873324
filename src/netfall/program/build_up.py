"""From the form to where statics begins: targets are reached, stages of erection gone through."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from netfall.equilibrium.find import Finder
from netfall.equilibrium.relaxation import Paused, state_residual
from netfall.erection.deviation import Deviated, deviate
from netfall.erection.erect import Erection, erect, restored
from netfall.erection.settings import Setting, check_stages
from netfall.erection.tension import Reached, of_form, reach_targets
from netfall.form.find import Form
from netfall.form.initial import INITIAL, initial_record, write_before_stages
from netfall.ground.errors import DivergedError, Undecided, interrupted
from netfall.ground.stop import StopRequest
from netfall.job.asks import carries_permanent
from netfall.job.job import Job
from netfall.mechanics.fields import TAKEN_OUT
from netfall.model.layout import features_of
from netfall.model.model import Model, make_model
from netfall.model.state import make_state
from netfall.numerics.functions import lengths
from netfall.parallel.agree import on_root
from netfall.stages.scene import BuildUp, Scene
from netfall.stages.static_outcome import NONE, UNDECIDED, by_ids

TARGETS, DEVIATION, ERECTION = "targets", "errors of length", "erection"  # names in checkpoints
MOST_TURNS = 10  # of targets under the permanent load
BEHIND = 1_000_000  # steps of a form finding: checkpoints of its erection come after all of these


def built_up(scene: Scene, result: Path, restart: Path | None, checkpoint, stop: StopRequest) -> Scene:
    """The scene after its targets and stages, in the equilibrium of the last of them. Collective.

    result, restart, checkpoint, stop : as in `prepare`. Raises InputError, DivergedError, Interrupted.
    """
    kept = lambda name: checkpoint.part(name) if checkpoint else (None, None)
    parts = scene.comm.bcast(checkpoint and set(checkpoint.record["parts"])) or set()
    build_up = BuildUp(base=scene.model)
    if scene.job.targets:
        scene, build_up = _targeted(scene, build_up, kept(TARGETS) if TARGETS in parts else None)
    if build_up.failure:
        return replace(scene, build_up=build_up)
    if scene.comm.bcast(scene.model and bool(scene.model.net.length_error.any())):
        scene, build_up = _deviated(scene, build_up, kept(DEVIATION) if DEVIATION in parts else None)
    if build_up.failure or not scene.job.stages:
        return replace(scene, build_up=build_up)
    on_root(scene.comm, lambda: check_stages(scene.job, scene.model))
    erection = Erection()
    if ERECTION in parts:
        small, arrays = kept(ERECTION)
        erection = restored(scene, scene.comm.bcast(small), arrays)
    try:
        erect(scene, erection, stop)
    except Paused:
        path = _pause(replace(scene, build_up=build_up), erection, result, restart)
        words = f"in stage {scene.job.stages[erection.done].name}, from whose start it goes on"
        raise interrupted(words, path) from None
    return _erected(scene, build_up, erection)


def _targeted(scene: Scene, build_up: BuildUp, kept: tuple | None) -> tuple[Scene, BuildUp]:
    """The scene in the form that has its targets, or in that which came nearest to them. Collective.

    kept : record of an earlier run, None: none
    """
    failed, comm = "", scene.comm
    if kept is None:
        after, reached = _reached(scene)
        failed = comm.bcast(reached and reached.failed)
        kept = ({"lines": reached.lines}, reached.arrays()) if reached else ({}, {})
    else:
        after = _in_form(scene, kept[1])
    small, arrays = kept
    residual = _residual(after)
    form = scene.form or Form(None, None, 0, residual, scene.reference)  # a net as given has one now
    after = replace(after, form=form, residual=residual)
    if scene.model:
        form = {f"target_{name}": arrays[name] for name in ("change", "influence")}
        labels = {"form_finding": {"state": NONE, "reason": failed}} if failed else {}
        build_up = replace(build_up, form_sections=form, lines=small["lines"], labels=labels)
    failure = DivergedError(failed) if failed else None
    records = {TARGETS: (comm.bcast(small), arrays or {})}
    return after, replace(build_up, records=records, failure=failure)


def _reached(scene: Scene) -> tuple[Scene, Reached | None]:
    """The scene with lengths with which the targets are there, and these. Collective.

    The permanent load depends on them, so they are found in turns, until it leaves the form in balance.
    """
    there, reached, asked = scene, None, np.inf
    if carries_permanent(scene.job):
        asked = scene.job.form_finding.tolerance * scene.form.reference
    for _ in range(MOST_TURNS):
        reached = reach_targets(there, scene.model and scene.model.cut_length, reached)
        if scene.comm.bcast(reached and reached.failed):
            there.state.x_start[:] = there.state.x
            return _ended(there, reached), reached
        there = _in_form(scene, reached and reached.arrays())
        left = _residual(there)
        if not left > asked:
            return there, reached
    line = f"targets: the permanent load changes with lengths: {left:.3g} N are left"
    return there, reached and reached._replace(lines=[*reached.lines, line])


def _in_form(scene: Scene, arrays: dict | None) -> Scene:
    """The scene with nodes and lengths of a record of `Reached`, or `Deviated`. Collective."""
    return _rebuilt(scene, lambda: _with_lengths(scene.job, scene.model, arrays["x"], arrays["L0"]))


def _ended(scene: Scene, found: Reached | Deviated | None) -> Scene:
    """The scene where its state is, for the file of the run: nothing is computed with it. Collective."""
    N = scene.distribution.gather_elements(scene.state.elements_now().N, scene.state.owned.astype(bool))
    return replace(scene, model=scene.model and replace(scene.model, x=found.x, N=N, cut_length=found.L0))


def _residual(scene: Scene) -> float:
    """Largest residual [N] of the form under what it carries. Collective."""
    return state_residual(scene.comm, scene.state, of_form(scene, "target", "the targets").load)


def _deviated(scene: Scene, build_up: BuildUp, kept: tuple | None) -> tuple[Scene, BuildUp]:
    """The scene with errors of length; kept : as in `_targeted`. Collective."""
    failed, found = "", None
    if kept is None:
        found = deviate(scene)
        failed = scene.comm.bcast(found and found.failed)
        kept = ({"lines": found.lines}, found.arrays()) if found else ({}, {})
    small, arrays = kept
    after = _ended(scene, found) if failed else _in_form(scene, arrays)
    if failed:
        build_up = replace(build_up, form=scene.model)
    if scene.model:
        scatter = {"tension_deviation": arrays["tension"], "piece_effect": arrays["effect"]}
        lines = [*build_up.lines, *small["lines"]]
        labels = {"deviation": {"state": found.state, "reason": failed}} if failed else {}
        build_up = replace(build_up, sections={"deviation": scatter}, lines=lines, labels=labels)
    records = build_up.records | {DEVIATION: (scene.comm.bcast(small), arrays or {})}
    failure = _failure(failed, scene.comm.bcast(found and found.state)) if failed else None
    return after, replace(build_up, records=records, failure=failure)


def _failure(failed: str, state: str) -> DivergedError:
    """Why the run ends. state : of the equilibrium that was sought"""
    return (Undecided if state == UNDECIDED else DivergedError)(failed)


def _erected(scene: Scene, build_up: BuildUp, erection: Erection) -> Scene:
    """The scene that begins where the last stage ended, or where one had no equilibrium. Collective."""
    setting, x = erection.setting, erection.x
    if erection.failed:
        after = replace(scene, model=scene.model and _as_it_failed(scene.model, x, setting))
        after.state.x_start[:] = after.state.x
    else:
        after = _rebuilt(scene, lambda: _as_erected(scene.job, scene.model, x, setting))
        active = scene.distribution.elements(setting and setting.active)
        after.state.EA[~active], after.state.broken[~active] = 0.0, TAKEN_OUT
    ids = scene.model and scene.model.net.element_id
    build_up = replace(
        build_up,
        form=build_up.form or scene.model,
        sections=build_up.sections | erection.sections,
        labels=scene.model and {group: by_ids(each, ids) for group, each in erection.labels.items()},
        lines=[*build_up.lines, *erection.lines],
        records=build_up.records | {ERECTION: erection.record()},
        failure=_failure(erection.failed, erection.last_state) if erection.failed else None,
    )
    return replace(after, build_up=build_up)


def _rebuilt(scene: Scene, make) -> Scene:
    """The scene with another model, which `make` gives on rank 0. Collective."""
    model = on_root(scene.comm, make)
    features = scene.comm.bcast(model and features_of(scene.job, model.layout.net, model.layout.slides))
    state = make_state(scene.distribution, model, features)
    finder = Finder(scene.comm, scene.halo, scene.distribution, state)
    return replace(scene, model=model, state=state, finder=finder)


def _with_lengths(job: Job, model: Model, x: np.ndarray, L0: np.ndarray, **columns) -> Model:
    """The model with nodes at x (n, 3) [m] and unstressed lengths L0 (m,) [m], cold; columns : of its net.

    What bends has its moments there: it has none in the state before.
    """
    net = replace(model.net, unstressed_length=L0, **columns)
    made = make_model(job, replace(model.layout, net=net), x, None)
    rest = model.spring_rest - (x - model.x)
    return replace(made, area_given=model.area_given, spring_rest=rest, joints=model.joints)


def _as_it_failed(model: Model, x: np.ndarray, setting: Setting) -> Model:
    """The model where a stage had no equilibrium, for the file of the run: nothing is computed with it."""
    layout = replace(model.layout, net=replace(model.net, fixed=setting.held(model.net)))
    return replace(model, layout=layout, x=x, cut_length=setting.L0)


def _as_erected(job: Job, model: Model, x: np.ndarray, setting: Setting) -> Model:
    """The model of the last stage. What is not there has neither force nor weight, and its nodes are held."""
    net, there = model.net, setting.active
    L = lengths(x[net.elements[:, 1]] - x[net.elements[:, 0]])
    held, density = setting.held(net), np.where(there, net.density, 0.0)
    made = _with_lengths(job, model, x, np.where(there, setting.L0, L), fixed=held, density=density)
    return replace(made, cut_length=setting.L0)


def _pause(scene: Scene, erection: Erection, result: Path, given: Path | None) -> Path:
    """Write a checkpoint of an erection between two stages; its path. Collective."""
    initial = initial_record(scene.form, scene.build_up.base)
    parts = scene.build_up.records | {INITIAL: initial, ERECTION: erection.record()}
    step = BEHIND + erection.done
    return write_before_stages(scene.comm, scene.job, result, scene.digest, step, parts, given)
