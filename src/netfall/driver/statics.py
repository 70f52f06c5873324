"""Equilibria under constant loads: load steps, static cases, equilibrium under the mean wind (paper 4.1.2).

The permanent loads act first, in full. Each case starts from their equilibrium. Then the live load is applied
in equal steps. If the wind has a static onset, its mean is applied last.

Plastic strains are constant within the search for an equilibrium and are updated at its end.
"""

import json
import math
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from netfall.core.errors import DivergedError, NoEquilibriumError, UndecidedError
from netfall.core.functions import lengths
from netfall.core.stop import NEVER_STOP
from netfall.driver import messages
from netfall.driver.equilibrium import (
    APART,
    apply_actions,
    paused,
    reference_force,
    resumed_relaxation,
    settle,
)
from netfall.driver.load_sequence import equilibria, loaded
from netfall.driver.problem import Outcome, Problem, RunContext
from netfall.driver.static_outcome import (
    EQUILIBRIUM,
    NO_EQUILIBRIUM,
    UNDECIDED,
    StaticOutcome,
    limit_warning,
    no_equilibrium,
    reached,
    unstable_warning,
    with_element_ids,
)
from netfall.job.cache import cache_key
from netfall.job.derived import (
    has_statics,
    load_settings,
    load_steps,
    starts_in_mean_wind,
    starts_loaded_for_removal,
)
from netfall.job.job import Job
from netfall.model.actions import StaticLoad
from netfall.physics.slip.law import set_slipless_lengths
from netfall.physics.state import restore_saved, save_state
from netfall.results import warning_text
from netfall.results.writer import text_dataset
from netfall.statics.at_limit import largest_torsion
from netfall.statics.newton import STABLE
from netfall.statics.relaxation import Paused, Relaxation

# entries of `Equilibrium.numbers` and `keep` that serve messages and are not written
MESSAGE_NUMBERS = ("moved", "torsion", "stopped", "rounding", "unexplained")


@dataclass
class StaticPath:
    """Equilibria found so far.

    reference : [N], of the tolerance; done : number of equilibria; total : iterations for all of these
    steps : load_factor, `Equilibrium.numbers` and `most_displaced_particle` of the permanent loads, then of
        each load step
    cases : the same by name; initial_state : the same for the final equilibrium, once found
    labels : attributes of the groups of the file; failed : why the run cannot continue, or ""
    undecided : whether that is a search that ended without a decision
    limits : a warning of each limit point on the way
    """

    reference: float | None = None
    done: int = 0
    total: int = 0
    steps: list[dict[str, Any]] = field(default_factory=list)
    cases: dict[str, dict[str, Any]] = field(default_factory=dict)
    initial_state: dict[str, Any] = field(default_factory=dict)
    labels: dict[str, dict[str, Any]] = field(default_factory=dict)
    failed: str = ""
    undecided: bool = False
    limits: list[str] = field(default_factory=list)

    def record(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the record of a checkpoint: the values by name."""
        return asdict(self), {}


NAME = "statics"


def required(job: Job) -> bool:
    """Return whether equilibria are computed before the dynamic stage."""
    return has_statics(job)


def run(problem: Problem, context: RunContext, outcomes: dict[str, Any]) -> Outcome:
    """Compute the equilibria that the job needs, or resume an interrupted run. Collective."""
    saver, steps = context.saver, load_steps(problem.job)
    record = saver.taken_up(NAME)
    path = StaticPath(**record[0]) if record else StaticPath()
    saver.register(NAME, path.record)
    if saver.is_completed(NAME):
        return Outcome(path, sections=sections(path), labels=group_labels(path, problem))
    if steps:
        context.progress.say(f"statics: {steps} load steps")
    with context.phases.phase(NAME):
        try:
            if saver.stage == NAME:
                find_equilibria(problem, context, path, resumed_relaxation(problem.distribution, saver))
            else:
                find_or_reuse_equilibria(problem, context, path)
        except Paused as pause:
            name = equilibria(problem)[path.done].each.words
            raise paused(problem, context, NAME, name, path.total, pause) from None
    attributes = {} if not path.failed else {"exit_state": failure_state(path)}
    labels = group_labels(path, problem)
    return Outcome(
        path, lines(path, problem), sections(path), attributes, labels, static_failure(problem.job, path)
    )


def static_failure(job: Job, path: StaticPath) -> DivergedError | None:
    """Return the error for which the run cannot continue, None: it can."""
    if not path.failed:
        return None
    if failure_state(path) == UNDECIDED:
        return UndecidedError(path.failed)
    lacks_equilibrium = (
        starts_in_mean_wind(job) and path.labels.get("initial_state", {}).get("state") == NO_EQUILIBRIUM
    )
    return (NoEquilibriumError if lacks_equilibrium else DivergedError)(path.failed)


def failure_state(path: StaticPath) -> str:
    """Return the state that ended the search for equilibria: "no_equilibrium" or "undecided"."""
    return UNDECIDED if path.undecided else NO_EQUILIBRIUM


def find_or_reuse_equilibria(problem: Problem, context: RunContext, path: StaticPath) -> None:
    """Call `find_equilibria`, or recall its results from an earlier run of this process. Collective."""
    if not context.memory.most:
        find_equilibria(problem, context, path)
        return
    seen: list[tuple[StaticOutcome, dict[str, Any], str]] = []

    def find() -> list[tuple[StaticOutcome, dict[str, Any], str]]:
        find_equilibria(problem, context, path, seen=seen)
        return seen

    key = problem.comm.bcast(cache_key(problem.job) if problem.comm.rank == 0 else None)
    results = context.memory.get_or_compute("statics", key, find)
    if results is not seen:
        _replay(problem, context, path, results)


def _replay(
    problem: Problem,
    context: RunContext,
    path: StaticPath,
    results: list[tuple[StaticOutcome, dict[str, Any], str]],
) -> None:
    """Repeat the output of `find_equilibria` for results of an earlier run. Collective."""
    for request, (outcome, arrays, failed) in zip(equilibria(problem), results):
        restore_saved(problem.state, arrays)
        note(problem, context, path, loaded(problem, request), outcome)
        path.failed, path.undecided = failed, bool(failed) and outcome.state == UNDECIDED
    if path.failed:
        _record_unstarted_cases(problem, context, path, outcome)
    if request.each.kind in APART:
        restore_initial_state(problem)


def find_equilibria(
    problem: Problem,
    context: RunContext,
    path: StaticPath,
    resume: Relaxation | None = None,
    seen: list[Any] | None = None,
) -> None:
    """Bring the state through all equilibria that the job needs. Collective.

    path : receives the results, and says how far an earlier run came; resume : relaxation within the next
        equilibrium
    seen : receives all results, for `find_or_reuse_equilibria`

    A case without an equilibrium is recorded and the search continues. Any other load without one ends it,
    see `path.failed`. Raises Paused if asked to stop.
    """
    state, requests, base = problem.state, equilibria(problem), None
    if path.reference is None:
        path.reference = reference_force(problem, loaded(problem, requests[-1]))
    elif path.done > 0 and any(load_case.from_permanent for load_case, _ in requests[path.done :]):
        base = recompute_permanent(problem, loaded(problem, requests[0]), path.reference)
    context.progress.start()
    problem.finder.report = context.progress.show_task
    for request in requests[path.done :]:
        load_case = loaded(problem, request)
        if load_case.from_permanent and base:
            restore_saved(state, base)
        if load_case.L0 is not None or load_case.settlement is not None:
            load_case = load_case._replace(before=save_state(state))
        apply_actions(state, load_case)
        outcome = settle(problem, load_case, path.reference, context.stop, resume)
        resume = None
        if not outcome.carries and load_case.kind not in APART:
            path.failed = no_equilibrium(problem.job, load_case, outcome)
            path.undecided = outcome.state == UNDECIDED
        if load_case.kind == "permanent":
            base = save_state(state)
        if seen is not None:
            seen.append((outcome, save_state(state), path.failed))
        note(problem, context, path, load_case, outcome)
        if path.failed:
            _record_unstarted_cases(problem, context, path, outcome)
            return
        share, slack = path.done / len(requests), f"slack {outcome.equilibrium.slack}"
        context.progress.at(share, load_case.words, path.total, "iterations", slack, even=False)
    if requests[-1].each.kind in APART:  # what follows starts as if there were no cases
        restore_initial_state(problem)


def _record_unstarted_cases(
    problem: Problem, context: RunContext, path: StaticPath, last: StaticOutcome
) -> None:
    """Record the cases that cannot start because the permanent loads have no equilibrium. Collective.

    last : the last outcome, whose state stands for theirs
    """
    verb = "are undecided" if last.state == UNDECIDED else "have no equilibrium"
    reason = f"the permanent loads {verb}: {last.reason}"
    outcome = last._replace(load_factor=math.nan, reason=reason)
    for request in equilibria(problem)[path.done :]:
        if request.each.kind in APART:
            keep(problem, context, path, loaded(problem, request), outcome)


def note(
    problem: Problem, context: RunContext, path: StaticPath, load_case: StaticLoad, outcome: StaticOutcome
) -> None:
    """Write and count an outcome. Collective."""
    keep(problem, context, path, load_case, outcome)
    if outcome.limit is not None:
        p = outcome.limit.particle
        node = problem.comm.bcast(problem.model and problem.model.net.node_id[p])
        path.limits.append(limit_warning(load_case, outcome.limit, node))
    path.done += 1
    path.total += outcome.equilibrium.solution.iterations


def recompute_permanent(problem: Problem, permanent: StaticLoad, reference: float) -> dict[str, np.ndarray]:
    """Recompute the state under the permanent loads, in a resumed run. Collective."""
    state = problem.state
    present = save_state(state)
    restore_initial_state(problem)
    settle(problem, permanent, reference, NEVER_STOP)
    base = save_state(state)
    restore_saved(state, present)
    return base


def restore_initial_state(problem: Problem) -> None:
    """Restore the initial state, without displacements or plastic strains. Collective."""
    state, model = problem.state, problem.model
    state.x[:] = problem.distribution.particles(model.x if model else None)
    if state.slip is not None:
        state.slip[:] = 0.0
    set_slipless_lengths(state, problem.distribution.elements(model.L0 if model else None))
    if state.features.springs:
        state.spring_rest[:] = problem.distribution.particles(model.spring_rest if model else None)
    if state.features.plastic:
        state.eps_p[:] = state.dissipated[:] = 0.0


def keep(
    problem: Problem, context: RunContext, path: StaticPath, load_case: StaticLoad, outcome: StaticOutcome
) -> None:
    """Record an outcome and write it. Collective."""
    state, snapshot = problem.state, outcome.equilibrium.snapshot
    unexplained = outcome.equilibrium.balance.unexplained if outcome.carries else 0.0
    numbers = outcome.equilibrium.numbers() | {
        "moved": most_displaced_particle(problem),
        "unexplained": unexplained,
    }
    if state.joints is not None:
        chains = problem.model and problem.model.layout.chains
        numbers |= {"torsion": largest_torsion(problem.distribution, state, chains)}
    tolerance, errors = load_settings(problem.job).tolerance, outcome.equilibrium.solution[2:4]
    if max(errors) > tolerance:
        newton = problem.finder.newton(load_case.load)
        numbers |= {"rounding": newton.rounding(newton.tangent())}
    numbers |= {"stopped": outcome.equilibrium.stopped} if state.slip is not None else {}
    group = (
        f"cases/{load_case.name}"
        if load_case.kind in APART
        else "initial_state"
        if load_case.kind == "initial_state"
        else "statics"
    )
    if group == "statics" and (load_case.kind == "at once" or not load_steps(problem.job)):
        return
    reaction = outcome.equilibrium.balance.reaction
    if not outcome.carries:  # the state balances less than the whole load
        reaction = np.full_like(reaction, np.nan)
    context.watch(state, snapshot)
    if load_case.kind in APART:
        path.cases[load_case.name] = numbers
        context.result.write_equilibrium(group, state, snapshot, "displacement", reaction)
    elif load_case.kind == "initial_state":
        path.initial_state = numbers
        context.result.write_equilibrium(group, state, snapshot, "position", reaction)
    else:
        path.steps.append({"load_factor": outcome.load_factor, **numbers})
        context.result.write_static_step(state, snapshot, reaction)
    if group not in path.labels or outcome.state != EQUILIBRIUM or path.labels[group]["state"] == EQUILIBRIUM:
        path.labels[group] = path.labels.get(group, {}) | outcome.labels()


def most_displaced_particle(problem: Problem) -> tuple[float, int]:
    """Return the largest displacement [m] from the initial state and the particle that has it. Collective."""
    state, gid = problem.state, problem.distribution.subdomain.particle_gid
    displacements = lengths(state.x[: state.n_owned] - state.x_start[: state.n_owned])
    p = int(np.argmax(displacements)) if len(displacements) else -1
    candidate = (float(displacements[p]), int(gid[p])) if p >= 0 else (0.0, 0)
    return max(problem.comm.allgather(candidate), key=lambda entry: (entry[0], -entry[1]))


def lines(path: StaticPath, problem: Problem) -> list[str]:
    """Return the messages of the static stage."""
    combined = {entry.name for entry in problem.job.combinations}
    called = {name: f"{'combination' if name in combined else 'case'} {name}" for name in path.cases}
    final = [(f"cases/{name}", called[name], numbers) for name, numbers in path.cases.items()]
    if path.steps:
        final.append(("statics", "statics", path.steps[-1]))
    if path.initial_state:
        final.append(("initial_state", final_equilibrium_name(problem.job), path.initial_state))
    elements = problem.distribution.m
    lines = [_result_line(title, entry, path.labels[group], elements) for group, title, entry in final]
    if problem.model is None:
        return lines
    steps = [("statics", f"statics, load factor {step['load_factor']:.4g}", step) for step in path.steps[:-1]]
    entries = [entry for entry in steps + final if not math.isnan(entry[2]["residual"])]
    node_id, element_id = problem.model.net.node_id, problem.model.net.element_id
    lines += [
        unstable_warning(title, entry["unstable_at"], node_id)
        for _, title, entry in entries
        if entry["unstable_at"] != STABLE
    ]
    lines += path.limits
    lines += warning_text.torsion_warnings(
        [(title, entry["torsion"]) for _, title, entry in entries if "torsion" in entry], node_id
    )
    lines += warning_text.rounding_warnings(
        [
            (title, max(entry["displacement_error"], entry["tension_error"]), entry["rounding"])
            for _, title, entry in entries
            if "rounding" in entry
        ],
        load_settings(problem.job).tolerance,
    )
    stopped = [(title, entry["stopped"]) for _, title, entry in entries if "stopped" in entry]
    lines += warning_text.slip_end_warnings(stopped, element_id)
    for group, title, _ in final:
        lines += warning_text.limit_warnings(title, with_element_ids(path.labels[group], element_id))
    lines += warning_text.force_balance_warnings(
        [(title, entry["unexplained"]) for _, title, entry in entries]
    )
    moved = [(title, entry["moved"][0], node_id[entry["moved"][1]]) for _, title, entry in entries]
    return lines + warning_text.displacement_warnings(moved, problem.model.x)


def final_equilibrium_name(job: Job) -> str:
    """Return the name of the final equilibrium, from which the dynamic stage starts; "": it has none."""
    if starts_in_mean_wind(job):
        return "equilibrium under the mean wind"
    return "equilibrium under all loads" if starts_loaded_for_removal(job) else ""


def sections(path: StaticPath) -> dict[str, dict[str, np.ndarray]]:
    """Return the numbers of all equilibria as datasets; their states are written as they are found."""
    datasets = {}
    if path.steps:
        names = [name for name in path.steps[0] if name not in MESSAGE_NUMBERS]
        columns = {name: [step[name] for step in path.steps] for name in names}
        datasets["statics"] = numbers_of(columns)
    datasets |= {f"cases/{name}": numbers_of(numbers) for name, numbers in path.cases.items()}
    if path.initial_state:
        datasets["initial_state"] = numbers_of(path.initial_state)
    return datasets


def group_labels(path: StaticPath, problem: Problem) -> dict[str, dict[str, Any]]:
    """Return the attributes of the groups of the file, on rank 0: elements by their ids."""
    if problem.model is None:
        return {}
    labels = {
        group: with_element_ids(entry, problem.model.net.element_id) for group, entry in path.labels.items()
    }
    for entry in problem.job.combinations:
        if f"cases/{entry.name}" in labels:
            labels[f"cases/{entry.name}"] |= {"kind": entry.kind, "factors": json.dumps(entry.factors)}
    return labels | ({"cases": {"order": text_dataset(list(path.cases))}} if path.cases else {})


def numbers_of(numbers: dict[str, Any]) -> dict[str, np.ndarray]:
    """Convert the numbers of equilibria to datasets, with a flag `stable` and without `MESSAGE_NUMBERS`."""
    arrays = {name: np.array(value) for name, value in numbers.items() if name not in MESSAGE_NUMBERS}
    return arrays | {"stable": arrays.pop("unstable_at") == STABLE}


def _result_line(title: str, numbers: dict[str, Any], label: dict[str, Any], elements: int) -> str:
    """Return the line on an equilibrium, or the warning that there is none."""
    if label["state"] == UNDECIDED:
        return messages.UNDECIDED_CASE(
            what=title, reason=label["reason"], factor=np.fmax(label["load_factor"], 0.0)
        )
    if label["state"] == NO_EQUILIBRIUM:
        return messages.CASE_WITHOUT_EQUILIBRIUM(
            what=title, reason=label["reason"], reached=reached(label["load_factor"])
        )
    errors = warning_text.error_text(numbers["displacement_error"], numbers["tension_error"])
    return f"{title}: {errors}; {numbers['slack']} of {elements} elements slack"
