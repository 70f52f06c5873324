"""Static equilibria of a net before and after member removal."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from netfall.core.arrays import rows_of
from netfall.core.timings import StopFlag, StopRequested
from netfall.driver import messages
from netfall.driver.problem import Outcome, Problem, RunContext
from netfall.driver.statics.equilibrium import interrupted, reference_force, solve_equilibrium
from netfall.driver.statics.outcome import failure_text, limit_warning, unstable_warning
from netfall.driver.statics.stage import most_displaced_particle
from netfall.job.derived import permanent_weight_factor
from netfall.job.job import Job
from netfall.job.values import format_list
from netfall.loads.removal import RemovalStep, is_unsupported, make_removals
from netfall.model.actions import StaticLoad
from netfall.model.model import Model
from netfall.physics.state import State, restore_saved, save_state
from netfall.results import warning_text
from netfall.results.datasets import BEYOND_LIMIT_POINT, EQUILIBRIUM, NO_EQUILIBRIUM, UNSTABLE
from netfall.statics.newton import STABLE

MAX_REMOVAL_ITERATIONS = 100_000  # after which the damaged net counts as having no equilibrium


NAME = "removal_equilibria"


class RemovalOutcome(NamedTuple):
    """Outcome of the search for the equilibrium after a member removal.

    state : a key of `removals.OUTCOME_TEXT`; elements : global numbers of those beyond their strength
    """

    state: str
    elements: tuple[int, ...] = ()


@dataclass
class RemovalEquilibria:
    """Equilibria before and after member removals.

    outcomes : one after each removal; lines : to print
    tension : (m, 2) on rank 0, before any removal and after each: axial force [N] and the larger
    bending moment [N m] of both ends; nan: no equilibrium was found, or no bending
    displacement : (n, 3) [m] on rank 0, after each removal; nan: no equilibrium, or a removed node
    """

    outcomes: list[RemovalOutcome] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    tension: list[np.ndarray | None] = field(default_factory=list)
    displacement: list[np.ndarray | None] = field(default_factory=list)


def required(job: Job) -> bool:
    """Return whether members are removed in the dynamic stage."""
    return bool(job.removes and job.dynamics)


def run(problem: Problem, context: RunContext, outcomes: dict[str, Any]) -> Outcome:
    """Compute the equilibrium after each member removal. Collective. Raises Interrupted at a stop signal.

    The result is a `RemovalEquilibria`, None if nothing is removed within the duration. Each search starts
    from the initial state of the dynamic stage, with the removals so far. All constant loads and the mean
    wind act. The state is restored at the end. A run that was interrupted repeats all searches.
    """
    removals = planned_removals(problem)
    if context.saver.is_completed(NAME) or not removals:
        return Outcome()
    with context.phases.phase("statics"):
        search = find_removal_equilibria(problem, context, removals)
    return Outcome(search, search.lines)


def planned_removals(problem: Problem) -> list[RemovalStep]:
    """List the member removals of the dynamic stage, on every rank. Collective."""
    if not required(problem.job):
        return []
    return problem.comm.bcast(problem.model and make_removals(problem.job, problem.model, problem.schedule))


def find_removal_equilibria(
    problem: Problem, context: RunContext, removals: list[RemovalStep]
) -> RemovalEquilibria:
    """Compute the result of `run`. Collective."""
    state, distribution, model = problem.state, problem.distribution, problem.model
    loads, unsupported = loads_after_removals(model, removals) if model else ([], [])
    unsupported, start = problem.comm.bcast(unsupported), save_state(state)
    first_load = distribution.particles(loads[0] if loads else None)
    reference = reference_force(problem, StaticLoad("removal", "", first_load))

    N = state.present_element_state().N
    search = RemovalEquilibria(tension=[problem.gather_elements(_forces_and_moments(state, N))])
    best = start  # the state in the last equilibrium
    removed_rows = np.zeros(0, np.int64)  # of the elements removed so far
    for k, (removed, is_loose) in enumerate(zip(removals, unsupported)):
        rows = rows_of(distribution.subdomain.element_gid, removed.elements)
        removed_rows = np.concatenate([removed_rows, rows[rows >= 0]])
        restore_saved(state, best)
        load = distribution.particles(loads[k + 1] if loads else None)
        title = f"the net without {removed_names(problem.job, removed)}"
        tension, outcome = np.full((state.m, 2), np.nan), RemovalOutcome(NO_EQUILIBRIUM)
        lines = [messages.UNSUPPORTED_WITHOUT_MEMBERS(what=title)]
        if not is_loose:
            load_case = StaticLoad("removal", title, load, 1.0, weights=permanent_weight_factor(problem.job))
            try:
                with problem.finder.without_elements(removed_rows):
                    tension, outcome, lines = _removal_equilibrium(
                        problem, load_case, reference, context.stop
                    )
            except StopRequested:
                restore_saved(state, start)
                raise interrupted(problem, context, NAME, title, 0) from None
            best = save_state(state) if outcome.state == EQUILIBRIUM else best
        search.lines += lines
        search.outcomes.append(outcome)
        search.tension.append(problem.gather_elements(tension))
        has_equilibrium = outcome.state in (EQUILIBRIUM, "breaks")
        moved = distribution.gather_particles(
            state.x - state.x_start if has_equilibrium else np.nan * state.x
        )
        if moved is not None:
            moved[np.concatenate([each.particles for each in removals[: k + 1]])] = np.nan
        search.displacement.append(moved)
    restore_saved(state, start)
    return search


def _removal_equilibrium(
    problem: Problem, load_case: StaticLoad, reference: float, stop: StopFlag
) -> tuple[np.ndarray, RemovalOutcome, list[str]]:
    """Find the equilibrium after a member removal. Collective.

    Returns forces and moments (m, 2) of this rank's elements, as of `RemovalEquilibria`, the outcome, and
    lines (all on rank 0).
    """
    outcome = solve_equilibrium(problem, load_case, reference, stop, MAX_REMOVAL_ITERATIONS)
    what, equilibrium, unknown = load_case.title, outcome.equilibrium, np.full((problem.state.m, 2), np.nan)
    if not outcome.carries:
        without = messages.REMOVAL_WITHOUT_EQUILIBRIUM
        line = failure_text(without, what, outcome, messages.UNDECIDED_CASE)
        return unknown, RemovalOutcome(outcome.state), [line]
    solution, model, lines = equilibrium.solution, problem.model, []
    if solution.unstable_at != STABLE and model:
        lines.append(unstable_warning(what, solution.unstable_at, model.net.node_id))
    if solution.unstable_at >= 0:
        return unknown, RemovalOutcome(UNSTABLE), lines
    if outcome.limit is not None:
        node = model and model.net.node_id[outcome.limit.particle]
        lines.append(limit_warning(load_case, outcome.limit, node))
        return unknown, RemovalOutcome(BEYOND_LIMIT_POINT), lines
    errors = warning_text.error_text(solution.displacement_error, solution.tension_error)
    lines.insert(0, f"{what}: {errors}; {equilibrium.slack} of {problem.distribution.m} elements slack")
    lines += warning_text.force_balance_warnings([(what, equilibrium.balance.unexplained)])
    distance, particle = most_displaced_particle(problem)
    if model:
        element_id = model.net.element_id
        lines += warning_text.displacement_warnings([(what, distance, model.net.node_id[particle])], model.x)
        lines += warning_text.slip_end_warnings([(what, equilibrium.stopped)], element_id)
        at_limit = {name: element_id[list(rows)] for name, rows in equilibrium.at_limit.items()}
        lines += warning_text.limit_warnings((what, at_limit))
    exceeded = equilibrium.at_limit.get("over_strength", ())
    removal_outcome = RemovalOutcome("breaks" if exceeded else EQUILIBRIUM, exceeded)
    forces = _forces_and_moments(problem.state, equilibrium.snapshot.N)
    return forces, removal_outcome, lines


def _forces_and_moments(state: State, N: np.ndarray) -> np.ndarray:
    """Return the axial forces N (m,) [N] and the larger bending moments [N m] of both ends (m, 2)."""
    bends = state.features.bending
    moment = state.bending_moments().max(axis=1) if bends else np.full(len(N), np.nan)
    return np.column_stack([N, moment])


def loads_after_removals(model: Model, removals: list[RemovalStep]) -> tuple[list[np.ndarray], list[bool]]:
    """Compute the loads without gusts, (n, 3) [N], before any member removal and after each. Rank 0.

    The second result is whether a part of the net is unsupported after each removal.
    """
    net, constant, wind = model.net, model.load.copy(), None
    if model.loading.growing is not None:
        constant += model.loading.growing
    if model.wind is not None and model.wind_field is not None and model.history is not None:
        wind, square = model.wind.copy(), model.wind_field.mean_square(model.history.mean_gust)

    def total() -> np.ndarray:
        return constant.copy() if wind is None else constant + wind * square[:, None]

    totals, unsupported = [total()], []
    is_present, is_removed = net.is_there, np.zeros(net.n, bool)
    for removed in removals:
        for values in (constant, wind):
            if values is not None:
                removed.redistribution.move(values, np.arange(net.n))
                values[removed.particles] = 0.0
        totals.append(total())
        is_present[removed.elements], is_removed[removed.particles] = False, True
        unsupported.append(is_unsupported(net, is_present, totals[-1], is_removed))
    return totals, unsupported


def removed_names(job: Job, removed: RemovalStep) -> str:
    """Return the name of the removed members in the job."""
    names = []
    for k in removed.entries:
        entry = job.removes[k]
        for key, value in (("element", entry.elements), ("cable", entry.cables)):
            if value is not None:
                value = list(dict.fromkeys(value))
                names.append(f"{key}{'s' * (len(value) > 1)} {format_list(value)}")
        if entry.group is not None:
            names.append(f"group {entry.group}")
    return " and ".join(names)
