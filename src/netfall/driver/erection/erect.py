"""Stages of erection: each is an equilibrium found from the last one, even if the net is a mechanism."""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from netfall.core.functions import lengths
from netfall.core.messages import kN, mm
from netfall.core.timings import StopFlag
from netfall.driver import messages
from netfall.driver.erection.settings import StageSetting, first_setting, next_setting, rows_named
from netfall.driver.erection.tension import elastic, tension_to_targets
from netfall.driver.problem import UNKNOWN_LOAD, Problem, set_up_slip
from netfall.driver.statics import equilibrium
from netfall.driver.statics.outcome import (
    StaticOutcome,
    failure_text,
    limit_warning,
    rounding_above_tolerance,
    unstable_warning,
    with_element_ids,
    with_reactions,
)
from netfall.geometry.net import Net
from netfall.geometry.turned import global_held_axes, rotation_column
from netfall.job.derived import load_settings, permanent_weight_factor
from netfall.job.keys.entries import Stage
from netfall.model.actions import StaticLoad
from netfall.model.model import Model
from netfall.physics.fields import REMOVED_BY_ERECTION
from netfall.physics.law.measures import heated_length
from netfall.physics.slip.law import set_slipless_lengths
from netfall.physics.state import save_state
from netfall.results import warning_text
from netfall.results.datasets import NO_EQUILIBRIUM
from netfall.statics.newton import STABLE

MOST_TURNS = 40  # iterations of the loads of a stage; each reduces their change to a fifth in soft nets


@dataclass
class Erection:
    """Progress of an erection.

    x : (n, 3) [m] and setting after the last stage so far, on rank 0, None before the first
    sections : datasets by group of the file, on rank 0; labels : attributes of these, elements by global
        numbers; lines : to print; failed : reason why no further stage follows, "": one may follow
    """

    x: np.ndarray | None = None
    setting: StageSetting | None = None
    sections: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    labels: dict[str, dict[str, Any]] = field(default_factory=dict)
    lines: list[str] = field(default_factory=list)
    failed: str = ""


def erect(problem: Problem, stop: StopFlag) -> Erection:
    """Compute the stages. Collective.

    problem : in its initial state, without limits and schedule; afterwards in the last equilibrium.

    A stage without an equilibrium is the last one. Raises StopRequested if the stop flag is set.
    """
    model, erection = problem.model, Erection()
    set_up_slip(problem)
    setting, x = (first_setting(problem.job, model), model.x) if model else (None, None)
    for stage in problem.job.stages:
        setting = next_setting(setting, stage, model.layout) if model and setting else None
        before = save_state(problem.state)
        load = _prepare_stage(problem, setting, x)
        title, weights = f"stage {stage.name}", permanent_weight_factor(problem.job)
        load_case = StaticLoad("stage", title, load, 1.0, stage.name, weights=weights, before=before)
        outcome, setting = _equilibrium(problem, load_case, setting, stop)
        _record_stage(problem, erection, stage, setting, outcome, load)
        x = erection.x
        if not outcome.carries:
            erection.failed = failure_text(messages.STAGE_WITHOUT_EQUILIBRIUM, title, outcome)
            break
    return erection


def _prepare_stage(problem: Problem, setting: StageSetting | None, x: np.ndarray | None) -> np.ndarray:
    """Set the state for the start of a stage; return its loads (n, 3) [N] of this rank. Collective."""
    state, distribution, model = problem.state, problem.distribution, problem.model
    arrays: dict[str, np.ndarray] = {}  # on rank 0
    if model is not None and setting is not None and x is not None:
        held = setting.held(model.net)
        arrays = {
            "x": (start := x + setting.moved),
            "free": 1 - global_held_axes(model.net, held).astype(np.uint8),
            "EA": np.where(setting.active, model.net.EA, 0.0),
            "broken": np.where(setting.active, 0, REMOVED_BY_ERECTION).astype(np.uint8),
            "L0": _warm_lengths(model, setting, setting.L0),
            "load": setting.forces(model, start),
        }
        if state.turned is not None:
            arrays["turned"] = rotation_column(model.net, held)
    state.x[:] = distribution.particles(arrays.get("x"))
    if state.features.springs:
        state.spring_rest[:] -= state.x - state.x_start
    state.x_start[:] = state.x
    state.free[:] = distribution.particles(arrays.get("free"))
    if state.turned is not None:
        state.turned[:] = distribution.particles(arrays.get("turned"))
    state.EA[:] = distribution.elements(arrays.get("EA"))
    state.broken[:] = distribution.elements(arrays.get("broken"))
    if problem.finder.slips is not None:
        state.slip[:] = 0.0  # lengths include the slip of earlier stages
        state.stage_slip[:] = distribution.elements(setting and setting.slipped)
        problem.finder.slips.open_clamps(problem.comm.bcast(setting and setting.clamps) == "open")
    set_slipless_lengths(state, distribution.elements(arrays.get("L0")))
    problem.finder.reset_structure()
    return distribution.particles(arrays.get("load"))


def _warm_lengths(model: Model, setting: StageSetting, L0: np.ndarray) -> np.ndarray:
    """Return the unstressed lengths (m,) [m] at the temperature of a stage; L0 : cold."""
    return heated_length(L0, model.net.expansion, setting.load.temperature)


def _equilibrium(
    problem: Problem, load_case: StaticLoad, setting: StageSetting | None, stop: StopFlag
) -> tuple[Any, ...]:
    """Find the equilibrium of a stage, with forces at jacks; return it and the new setting. Collective.

    Loads depend on the geometry and on the lengths that jacks change, so the search is repeated until they
    change by less than the tolerance.
    """
    force_targets, jacks = (list(setting.force_targets), list(setting.jacks)) if setting else ([], [])
    warm = partial(_warm_lengths, problem.model, setting) if problem.model and setting else None
    tolerance, has_jacks = load_settings(problem.job).tolerance, problem.comm.bcast(len(force_targets) > 0)
    for _ in range(MOST_TURNS):
        if has_jacks:
            L0 = setting and setting.L0
            L0, outcome, _ = tension_to_targets(problem, load_case, force_targets, jacks, L0, warm, stop)
            if setting and L0 is not None:
                setting = replace(setting, L0=L0, force_targets=(), jacks=())
        else:
            outcome = equilibrium.solve_equilibrium(problem, load_case, None, stop)
        x = problem.distribution.gather_particles(problem.state.x)
        forces = setting.forces(problem.root_model, x) if setting and x is not None else None
        load = problem.distribution.particles(forces)
        change = max(problem.comm.allgather(np.abs(load - load_case.load).max(initial=0.0)))
        if not outcome.carries:
            break
        if change <= tolerance * equilibrium.reference_force(problem, load_case):
            outcome = with_reactions(problem, outcome, load, change)
            break
        load_case = load_case._replace(load=load)
    else:
        reason = f"{MOST_TURNS} iterations were not enough: the loads still change by {kN(change)}"
        outcome = outcome._replace(state=NO_EQUILIBRIUM, reason=reason)
    return elastic(problem, outcome), _with_slipped_lengths(problem, setting)


def _with_slipped_lengths(problem: Problem, setting: StageSetting | None) -> StageSetting | None:
    """Return the setting with the lengths after slip. Collective."""
    if not problem.finder.slips:
        return setting
    slipped = problem.gather_elements(problem.state.L0 - problem.state.strand)
    if problem.model is None or setting is None:
        return None
    L0 = setting.L0 + slipped / _warm_lengths(problem.model, setting, np.ones(1))
    return replace(setting, L0=L0, slipped=1.0 - (1.0 - setting.slipped) * setting.L0 / L0)


def _record_stage(
    problem: Problem,
    erection: Erection,
    stage: Stage,
    setting: StageSetting | None,
    outcome: StaticOutcome,
    load: np.ndarray,
) -> None:
    """Record the result of a stage and its messages; load : (n, 3) [N] of it. Collective."""
    state, equilibrium, model, before = problem.state, outcome.equilibrium, problem.model, erection.x
    x = problem.distribution.gather_particles(state.x)
    erection.x, erection.setting = x, setting
    N = problem.gather_elements(equilibrium.snapshot.N)
    moments = None
    if state.joints is not None:
        moments = problem.gather_elements(state.bending_moments())
    moment_datasets = {} if moments is None else {"bending_moment": moments}
    reaction = problem.distribution.gather_particles(equilibrium.balance.reaction)
    numbers = {name: np.array(value) for name, value in equilibrium.numbers().items()}
    numbers["stable"] = numbers.pop("unstable_at") == STABLE
    rounding = rounding_above_tolerance(problem, equilibrium.solution, load)
    group = f"stages/{stage.name}"
    erection.labels[group] = outcome.labels()
    if model is None or setting is None or x is None or N is None:
        return
    if "slip" in numbers:
        last_sections = list(erection.sections.values())[-1:]
        numbers["slip"] = numbers["slip"] + (last_sections[0]["slip"] if last_sections else 0.0)
        erection.labels[group]["clamps"] = setting.clamps
    held = setting.fixed & setting.has_elements(model.net)[:, None]
    datasets = {
        "displacement": x - model.x,
        "tension": N,
        "unstressed_length": setting.L0,
        "active": setting.active.astype(np.uint8),
        "held": held.astype(np.uint8),
        "reaction": reaction if outcome.carries else np.full_like(x, np.nan),
    }
    erection.sections[group] = numbers | moment_datasets | datasets
    moved = lengths(x - (model.x if before is None else before))
    erection.lines += _lines(model.net, stage, setting, moved, N, outcome)
    if rounding is not None and outcome.carries:
        error = (f"stage {stage.name}", max(equilibrium.solution[2:4]), rounding)
        erection.lines += warning_text.rounding_warnings([error], load_settings(problem.job).tolerance)


def _lines(
    net: Net, stage: Stage, setting: StageSetting, moved: np.ndarray, N: np.ndarray, outcome: StaticOutcome
) -> list[str]:
    """Return the messages of a stage: its equilibrium, displacements `moved` [m], forces at the jacks."""
    what = f"stage {stage.name}"
    if not outcome.carries:  # the error that ends the run gives the reason
        return []
    solution, slack = outcome.equilibrium.solution, outcome.equilibrium.slack
    p = int(np.argmax(moved))
    lines = [
        f"{what}: {warning_text.error_text(*solution[2:4])}; {slack} of {int(setting.active.sum())} elements "
        f"slack; nodes moved by up to {mm(moved[p])} (node {net.node_id[p]})"
    ]
    if solution.unstable_at != STABLE:
        lines.append(unstable_warning(what, solution.unstable_at, net.node_id))
    for name in stage.lengths or {}:
        rows = rows_named(net, name)
        lines.append(
            f"  {name}: {kN(N[rows].min(), N[rows].max(), digits=5)}, unstressed length "
            f"{setting.L0[rows].sum():.6g} m in all"
        )
    if outcome.limit is not None:
        load_case = StaticLoad("stage", what, UNKNOWN_LOAD)
        lines.append(limit_warning(load_case, outcome.limit, net.node_id[outcome.limit.particle]))
    lines += warning_text.force_balance_warnings([(what, outcome.equilibrium.balance.unexplained)])
    lines += warning_text.slip_end_warnings([(what, outcome.equilibrium.stopped)], net.element_id)
    return [*lines, *warning_text.limit_warnings((what, with_element_ids(outcome.labels(), net.element_id)))]
