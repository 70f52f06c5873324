"""Equilibria under constant loads: load steps, static cases, equilibrium under the mean wind (paper 4.1.2).

The permanent loads act first, in full. Each case starts from their equilibrium. Then the live load is applied
in equal steps. If the wind has a static onset, the mean wind is applied last.

Plastic strains are constant within the search for an equilibrium and are updated at its end.
"""

import json
import math
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from netfall.core.errors import NoEquilibriumError, UndecidedError
from netfall.core.functions import lengths
from netfall.core.timings import NEVER_STOP, StopRequested
from netfall.driver import messages
from netfall.driver.problem import Outcome, Problem, RunContext, equilibria, loaded
from netfall.driver.statics.equilibrium import (
    SEPARATE,
    interrupted,
    reference_force,
    solve_equilibrium,
)
from netfall.driver.statics.outcome import (
    StaticOutcome,
    limit_warning,
    no_equilibrium,
    reached,
    rounding_above_tolerance,
    unstable_warning,
    with_element_ids,
)
from netfall.job import derived
from netfall.job.cache import cache_key
from netfall.job.derived import has_load_cases, load_settings, load_steps, starts_in_mean_wind
from netfall.job.job import Job
from netfall.job.values import format_list
from netfall.model.actions import StaticLoad
from netfall.parallel.agree import largest_of_ranks
from netfall.parallel.mpi import MPI
from netfall.physics.slip.law import set_slipless_lengths
from netfall.physics.state import restore_saved, save_state
from netfall.results import warning_text
from netfall.results.datasets import EQUILIBRIUM, NO_EQUILIBRIUM, UNDECIDED
from netfall.results.states import PERMANENT
from netfall.results.writer import text_dataset
from netfall.statics.at_limit import largest_torsion
from netfall.statics.newton import STABLE

# entries of `Equilibrium.numbers` and `record_outcome` that are only for messages, and not written
MESSAGE_NUMBERS = ("moved", "torsion", "stopped", "rounding", "unexplained")
Result = tuple[StaticOutcome, dict[str, Any]]  # an outcome, and the arrays of its state


@dataclass
class StaticPath:
    """Equilibria found so far.

    reference : [N], of the tolerance, except of cases
    done : number of equilibria; total : iterations for all of these
    steps : load_factor, `Equilibrium.numbers` and `most_displaced_particle` of the permanent loads, then of
        each load step
    cases : the same by name; permanent : the same for the permanent loads, if cases start from them
    initial_state : the same for the final equilibrium, once found
    labels : attributes of the groups of the file; failed : reason why the run cannot continue, or ""
    undecided : whether the reason is an undecided search
    limits : a warning of each limit point on the path
    """

    reference: float | None = None
    done: int = 0
    total: int = 0
    steps: list[dict[str, Any]] = field(default_factory=list)
    cases: dict[str, dict[str, Any]] = field(default_factory=dict)
    permanent: dict[str, Any] = field(default_factory=dict)
    initial_state: dict[str, Any] = field(default_factory=dict)
    labels: dict[str, dict[str, Any]] = field(default_factory=dict)
    failed: str = ""
    undecided: bool = False
    limits: list[str] = field(default_factory=list)


NAME = "statics"


required = derived.has_statics


def run(problem: Problem, context: RunContext, outcomes: dict[str, Any]) -> Outcome:
    """Compute the equilibria that the job needs, or resume an interrupted run. Collective."""
    saver, steps = context.saver, load_steps(problem.job)
    record = saver.resumed_record(NAME)
    path = StaticPath(**record[0]) if record else StaticPath()
    saver.register(NAME, lambda: (asdict(path), {}))
    if saver.is_completed(NAME):
        return Outcome(path, sections=sections(path), labels=group_labels(path, problem))
    if steps:
        context.progress.say(f"statics: {steps} load steps")
    results = None
    with context.phases.phase(NAME):
        try:
            if context.cache.most:
                key = problem.comm.bcast(cache_key(problem.job) if problem.model else None)
                results = context.cache.get_or_compute("statics", key, list)
            find_equilibria(problem, context, path, results)
        except StopRequested:
            name = equilibria(problem)[path.done].load_case.title
            raise interrupted(problem, context, NAME, name, path.total) from None
    outcome = Outcome(path, lines(path, problem), sections(path), labels=group_labels(path, problem))
    if not path.failed:
        return outcome
    error = UndecidedError if path.undecided else NoEquilibriumError
    return outcome._replace(failure=error(path.failed))


def find_equilibria(
    problem: Problem,
    context: RunContext,
    path: StaticPath,
    results: list[Result] | None = None,
) -> None:
    """Bring the state through all equilibria that the job needs. Collective.

    path : receives the results, and contains those of an earlier run
    results : of the same equilibria in an earlier run, which are repeated; receives the later ones

    A case without an equilibrium is recorded and the search continues. Any other load without one ends the
    search, see `path.failed`. Raises StopRequested if the stop flag is set.
    """
    state, requests, base = problem.state, equilibria(problem), None
    if path.reference is None:
        last = [request for request in requests if request.load_case.kind not in SEPARATE][-1]
        path.reference = reference_force(problem, loaded(problem, last))
    elif path.done > 0 and any(load_case.from_permanent for load_case, _ in requests[path.done :]):
        base = recompute_permanent(problem, loaded(problem, requests[0]), path.reference)
    context.progress.start()
    problem.finder.report = context.progress.show_task
    for request in requests[path.done :]:
        load_case = loaded(problem, request)
        if results and path.done < len(results):
            outcome, arrays = results[path.done]
            restore_saved(state, arrays)
        else:
            if load_case.from_permanent and base:
                restore_saved(state, base)
            is_apart = load_case.kind in SEPARATE  # so that its tolerance does not depend on other cases
            reference = reference_force(problem, load_case) if is_apart else path.reference
            load_case = apply_actions(problem, load_case)
            outcome = solve_equilibrium(problem, load_case, reference, context.stop)
        if not outcome.carries and load_case.kind not in SEPARATE:
            path.failed = no_equilibrium(problem.job, load_case, outcome)
            path.undecided = outcome.state == UNDECIDED
        if load_case.kind == "permanent":
            base = save_state(state)
        if results is not None and path.done == len(results):
            results.append((outcome, save_state(state)))
        record_outcome(problem, context, path, load_case, outcome)
        if load_case.kind == "permanent" and not has_load_cases(problem.job) and not has_history(problem):
            restore_initial_state(problem)
        if outcome.limit is not None:
            node = problem.comm.bcast(problem.model and problem.model.net.node_id[outcome.limit.particle])
            path.limits.append(limit_warning(load_case, outcome.limit, node))
        path.done += 1
        path.total += outcome.equilibrium.solution.iterations
        if path.failed:
            break
        share, slack = path.done / len(requests), f"slack {outcome.equilibrium.slack}"
        context.progress.at(share, load_case.title, path.total, "iterations", slack, even=False)
    if not path.failed and load_case.kind in SEPARATE:  # later equilibria start as if there were no cases
        restore_initial_state(problem)
    # cases that cannot start, because the permanent loads have no equilibrium; the last state replaces theirs
    verb = "are undecided" if path.undecided else "have no equilibrium"
    unstarted = outcome._replace(load_factor=math.nan, reason=f"the permanent loads {verb}: {outcome.reason}")
    for request in requests[path.done :]:
        if request.load_case.kind in SEPARATE:
            record_outcome(problem, context, path, loaded(problem, request), unstarted)


def apply_actions(problem: Problem, load_case: StaticLoad) -> StaticLoad:
    """Set the unstressed lengths, springs and support positions of a load; return the completed load."""
    state = problem.state
    if load_case.L0 is not None or load_case.settlement is not None:
        load_case = load_case._replace(before=save_state(state))
    if load_case.L0 is not None:
        set_slipless_lengths(state, load_case.L0)
    if load_case.spring_rest is not None:
        state.spring_rest[:] = load_case.spring_rest
    if load_case.settlement is not None:
        held = state.free == 0
        state.x[held] = (state.x_start + load_case.settlement)[held]
    return load_case


def recompute_permanent(problem: Problem, permanent: StaticLoad, reference: float) -> dict[str, np.ndarray]:
    """Recompute the state under the permanent loads, in a resumed run. Collective."""
    state = problem.state
    present = save_state(state)
    restore_initial_state(problem)
    solve_equilibrium(problem, permanent, reference, NEVER_STOP)
    base = save_state(state)
    restore_saved(state, present)
    return base


def restore_initial_state(problem: Problem) -> None:
    """Restore the initial state, without displacements or plastic strains. Collective."""
    state, model = problem.state, problem.model
    state.x[:] = problem.distribution.particles(model.x if model else None)
    state.reset_history()
    set_slipless_lengths(state, problem.distribution.elements(model.L0 if model else None))
    if state.features.springs:
        state.spring_rest[:] = problem.distribution.particles(model.spring_rest if model else None)


def has_history(problem: Problem) -> bool:
    """Return whether elements have yielded or cables have slipped, so that the order of loads matters."""
    changes = [array for array in (problem.state.eps_p, problem.state.slip) if array is not None]
    return bool(problem.comm.allreduce(any(array.any() for array in changes), MPI.LOR))


def record_outcome(
    problem: Problem, context: RunContext, path: StaticPath, load_case: StaticLoad, outcome: StaticOutcome
) -> None:
    """Record an outcome and write it. Collective."""
    kind, state, result = load_case.kind, problem.state, context.result
    equilibrium, is_apart = outcome.equilibrium, kind in SEPARATE
    solution, balance, snapshot = equilibrium.solution, equilibrium.balance, equilibrium.snapshot
    has_cases, has_steps = problem.job.cases or problem.job.combinations, load_steps(problem.job)
    starts_cases = kind == "permanent" and outcome.carries and has_cases
    if kind == "at once" or (kind == "permanent" and not (starts_cases or has_steps)):
        return
    numbers = equilibrium.numbers() | {"moved": most_displaced_particle(problem)}
    numbers["unexplained"] = balance.unexplained if outcome.carries else 0.0
    if state.joints is not None:
        chains = problem.model and problem.model.layout.chains
        numbers["torsion"] = largest_torsion(problem.distribution, state, chains)
    if (rounding := rounding_above_tolerance(problem, solution, load_case.load)) is not None:
        numbers["rounding"] = rounding
    if state.slip is not None:
        numbers["stopped"] = equilibrium.stopped
    # without an equilibrium, the state balances only a part of the load
    reaction, load = balance.reaction, balance.load
    if not outcome.carries:
        reaction, load = np.full_like(reaction, np.nan), load_case.load[snapshot.rows]
    group = f"cases/{load_case.name}" if is_apart else PERMANENT if kind == "permanent" else "statics"
    context.on_equilibrium(state, snapshot, group, outcome.load_factor if group == "statics" else 1.0)
    forces = {"reaction": reaction, "load": load}
    if starts_cases:
        result.write_equilibrium(PERMANENT, state, snapshot, "displacement", forces)
        path.permanent, path.labels[PERMANENT] = numbers, outcome.labels()
        if not has_steps:
            return
    if is_apart:
        result.write_equilibrium(group, state, snapshot, "displacement", forces)
        path.cases[load_case.name] = numbers
    elif kind == "initial_state":
        group = kind
        result.write_equilibrium(group, state, snapshot, "position", {"reaction": reaction})
        path.initial_state = numbers
    else:
        group = "statics"  # also under the permanent loads
        path.steps.append({"load_factor": outcome.load_factor, **numbers})
        result.write_static_step(state, snapshot, reaction)
    if group not in path.labels or outcome.state != EQUILIBRIUM or path.labels[group]["state"] == EQUILIBRIUM:
        path.labels[group] = path.labels.get(group, {}) | outcome.labels()


def most_displaced_particle(problem: Problem) -> tuple[float, int]:
    """Return the largest displacement [m] from the initial state and its particle. Collective."""
    state, gid = problem.state, problem.distribution.subdomain.particle_gid
    displacements = lengths(state.x[: state.n_owned] - state.x_start[: state.n_owned])
    return largest_of_ranks(problem.comm, displacements, gid[: state.n_owned])


def lines(path: StaticPath, problem: Problem) -> list[str]:
    """Return the messages of the static stage."""
    combined = {entry.name for entry in problem.job.combinations}
    final = [
        (f"cases/{name}", f"{'combination' if name in combined else 'case'} {name}", numbers)
        for name, numbers in path.cases.items()
    ]
    if path.steps:
        final.append(("statics", "statics", path.steps[-1]))
    if path.initial_state:
        final.append(("initial_state", final_equilibrium_name(problem.job), path.initial_state))
    elements = problem.distribution.m
    apart = _apart(final, path.labels)
    lines = [_result_line(group, title, entry, path.labels[group], elements) for group, title, entry in apart]
    if problem.model is None:
        return lines
    node_id, element_id = problem.model.net.node_id, problem.model.net.element_id
    start = [("the permanent loads", path.permanent)] if path.permanent and not path.steps else []
    steps = [(f"statics, load factor {step['load_factor']:.4g}", step) for step in path.steps[:-1]]
    titled = start + steps + [(title, entry) for _, title, entry in final]
    entries = [(title, entry) for title, entry in titled if not math.isnan(entry["residual"])]

    def listed(name: str) -> list[tuple[str, Any]]:
        return [(title, entry[name]) for title, entry in entries if name in entry]

    lines += [
        unstable_warning(title, particle, node_id)
        for title, particle in listed("unstable_at")
        if particle != STABLE
    ]
    lines += [*path.limits, *warning_text.torsion_warnings(listed("torsion"), node_id)]
    errors = [
        (title, max(entry["displacement_error"], entry["tension_error"]), entry["rounding"])
        for title, entry in entries
        if "rounding" in entry
    ]
    lines += warning_text.rounding_warnings(errors, load_settings(problem.job).tolerance)
    lines += warning_text.slip_end_warnings(listed("stopped"), element_id)
    titles = [(PERMANENT, "permanent loads")] * (PERMANENT in path.labels)
    titles += [(group, title) for group, title, _ in apart]
    labels = [(title, with_element_ids(path.labels[group], element_id)) for group, title in titles]
    lines += warning_text.limit_warnings(*labels)
    lines += warning_text.force_balance_warnings(listed("unexplained"))
    moved = [(title, distance, node_id[particle]) for title, (distance, particle) in listed("moved")]
    return [*lines, *warning_text.displacement_warnings(moved, problem.model.x)]


def _apart(final: list[tuple[str, str, Any]], labels: dict[str, Any]) -> list[tuple[str, str, Any]]:
    """Join the titles of cases that could not start, because they have the same reason and state.

    final : group, title and numbers of each equilibrium
    """
    joined: dict[str, list[tuple[str, str, Any]]] = {}
    for each in final:
        label = labels[each[0]]
        key = (math.isnan(label["load_factor"]) and label["reason"]) or each[1]
        joined.setdefault(key, []).append(each)
    return [
        (same[0][0], format_list([title for _, title, _ in same]), same[0][2]) for same in joined.values()
    ]


def final_equilibrium_name(job: Job) -> str:
    """Return the name of the final equilibrium, from which the dynamic stage starts; "" without one."""
    if starts_in_mean_wind(job):
        return "equilibrium under the mean wind"
    return "equilibrium under all loads" if derived.starts_loaded_for_removal(job) else ""


def sections(path: StaticPath) -> dict[str, dict[str, np.ndarray]]:
    """Return the numbers of all equilibria as datasets; their states are written as they are found."""
    datasets = {PERMANENT: numbers_of(path.permanent)} if path.permanent else {}
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


def _result_line(
    group: str, title: str, numbers: dict[str, Any], label: dict[str, Any], elements: int
) -> str:
    """Return the line on an equilibrium, or the warning that none exists."""
    if label["state"] == UNDECIDED:
        return messages.UNDECIDED_CASE(
            what=title, reason=label["reason"], factor=np.fmax(label["load_factor"], 0.0)
        )
    if label["state"] == NO_EQUILIBRIUM:
        factor = reached(label["load_factor"], messages.FROM_PERMANENT * group.startswith("cases/"))
        return messages.CASE_WITHOUT_EQUILIBRIUM(what=title, reason=label["reason"], reached=factor)
    errors = warning_text.error_text(numbers["displacement_error"], numbers["tension_error"])
    return f"{title}: {errors}; {numbers['slack']} of {elements} elements slack"
