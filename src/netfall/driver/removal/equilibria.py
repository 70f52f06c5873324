"""Static equilibria of a net before and after member removal."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from netfall.core.stop import StopFlag
from netfall.driver import messages
from netfall.driver.equilibrium import (
    paused,
    reference_force,
    resumed_relaxation,
    settle,
)
from netfall.driver.problem import Outcome, Problem, RunContext
from netfall.driver.static_outcome import UNDECIDED
from netfall.job.derived import permanent_weight_factor
from netfall.job.job import Job
from netfall.job.values import format_list
from netfall.loads.removal import Loss, is_unsupported, make_removals
from netfall.model.actions import StaticLoad
from netfall.model.model import Model
from netfall.parallel.subdomain import rows_of
from netfall.physics.fields import FIELDS
from netfall.physics.state import restore_saved, save_state
from netfall.results.warning_text import (
    error_text,
    force_balance_warnings,
    limit_warnings,
    slip_end_warnings,
)
from netfall.statics.newton import STABLE
from netfall.statics.relaxation import Paused, Relaxation

PARTICLE_FIELDS = {each.name for each in FIELDS if each.entity == "particle"}  # the others belong to elements
MAX_REMOVAL_ITERATIONS = 100_000  # after which the damaged net counts as without equilibrium


NAME = "rests"


class RemovalOutcome(NamedTuple):
    """Outcome of the search for the equilibrium after a member removal.

    state : a key of `removal_text.RESTS`; elements : global numbers of those beyond their strength
    """

    state: str
    elements: tuple[int, ...] = ()


class RemovalEquilibria(NamedTuple):
    """Equilibrium after each member removal.

    tension : (losses + 1, m) [N] before any removal and after each, on rank 0; nan: no equilibrium was found
    """

    rests: list[RemovalOutcome]
    tension: np.ndarray | None


@dataclass
class RemovalSearch:
    """Progress of the search for the equilibria after member removal.

    best : the state in the last equilibrium, as of `save_state`; total : iterations so far
    rests : outcome after each removal so far; tension : before any and after each of them, (m,) [N] on rank 0
    """

    best: dict[str, np.ndarray]
    total: int = 0
    rests: list[RemovalOutcome] = field(default_factory=list)
    tension: list[np.ndarray | None] = field(default_factory=list)

    def record(self, problem: Problem) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return the record that `restore` needs; arrays by global numbers on rank 0. Collective."""
        distribution, is_owned = problem.distribution, problem.state.owned.astype(bool)
        gathered = {
            name: (
                distribution.gather_particles(rows)
                if name in PARTICLE_FIELDS
                else distribution.gather_elements(rows, is_owned)
            )
            for name, rows in self.best.items()
        }
        small = {"total": self.total, "rests": self.rests}
        if not problem.model:
            return small, {}
        arrays = {name: values for name, values in gathered.items() if values is not None}
        return small, arrays | {"tension": np.array(self.tension)}

    def restore(self, problem: Problem, small: dict[str, Any], arrays: dict[str, np.ndarray] | None) -> None:
        """Restore the record of an earlier run. arrays : on rank 0. Collective."""
        self.total = small["total"]
        self.rests = [RemovalOutcome(state, tuple(elements)) for state, elements in small["rests"]]
        self.tension = list(arrays["tension"]) if arrays else [None] * (1 + len(self.rests))
        distribution = problem.distribution
        self.best = {
            name: (distribution.particles if name in PARTICLE_FIELDS else distribution.elements)(
                arrays[name] if arrays else None
            )
            for name in self.best
        }


def required(job: Job) -> bool:
    """Return whether members are removed in the dynamic stage."""
    return bool(job.removes and job.dynamics)


def run(problem: Problem, context: RunContext, outcomes: dict[str, Any]) -> Outcome:
    """Compute the equilibrium after each member removal. Collective. Raises Interrupted if asked to stop.

    The result is a `RemovalEquilibria`, None if nothing is removed in time. Each search starts from the
    initial state of the dynamic stage, with the removals so far. All constant loads and the mean wind act.
    The state is restored at the end.
    """
    losses = planned_removals(problem)
    if context.saver.is_completed(NAME) or not losses:
        return Outcome()
    with context.phases.phase("statics"):
        return Outcome(find_removal_equilibria(problem, context, losses))


def planned_removals(problem: Problem) -> list[Loss]:
    """List the member removals of the dynamic stage, on every rank. Collective."""
    if not required(problem.job):
        return []
    return problem.comm.bcast(problem.model and make_removals(problem.job, problem.model, problem.schedule))


def find_removal_equilibria(problem: Problem, context: RunContext, losses: list[Loss]) -> RemovalEquilibria:
    """Compute the result of `run`. Collective."""
    state, distribution, model = problem.state, problem.distribution, problem.model
    loads = loads_after_removals(model, losses) if model else None
    start = save_state(state)
    unsupported = problem.comm.bcast(loads and unsupported_after_removals(problem.root_model, losses, loads))
    reference = reference_force(
        problem, StaticLoad("loss", "", distribution.particles(loads[0] if loads else None))
    )

    def gather_owned(tension: np.ndarray) -> np.ndarray | None:
        return distribution.gather_elements(tension, state.owned.astype(bool))

    search = RemovalSearch(start, tension=[gather_owned(state.present_element_state().N)])
    resume = _resume_search(problem, context, search)
    removed = np.zeros(0, np.int64)  # rows of the elements removed so far
    for k, (loss, is_loose) in enumerate(zip(losses, unsupported)):
        rows = rows_of(distribution.subdomain.element_gid, loss.elements)
        removed = np.concatenate([removed, rows[rows >= 0]])
        if k < len(search.rests):
            continue
        restore_saved(state, search.best)
        load = distribution.particles(loads[k + 1] if loads else None)
        words = f"the net without {removed_names(problem.job, loss)}"
        tension, rest = np.full(state.m, np.nan), RemovalOutcome("no_equilibrium")
        lines = [messages.UNSUPPORTED_WITHOUT_MEMBERS(what=words)]
        if not is_loose:
            load_case = StaticLoad("loss", words, load, 1.0, weights=permanent_weight_factor(problem.job))
            try:
                with problem.finder.without_elements(removed):
                    tension, rest, lines, iterations = _removal_equilibrium(
                        problem, load_case, reference, context.stop, resume
                    )
            except Paused as pause:
                restore_saved(state, start)
                records = {NAME: search.record(problem)}
                raise paused(problem, context, NAME, words, search.total, pause, records) from None
            search.total += iterations
            search.best = save_state(state) if rest.state == "equilibrium" else search.best
        resume = None
        context.progress.say(*lines)
        search.rests.append(rest)
        search.tension.append(gather_owned(tension))
    restore_saved(state, start)
    return RemovalEquilibria(search.rests, np.array(search.tension) if model else None)


def _resume_search(problem: Problem, context: RunContext, search: RemovalSearch) -> Relaxation | None:
    """Restore a search that an earlier run was interrupted in; return its relaxation. Collective."""
    record = context.saver.taken_up(NAME)
    if record is None:
        return None
    search.restore(problem, *record)
    return resumed_relaxation(problem.distribution, context.saver)


def _removal_equilibrium(
    problem: Problem, load_case: StaticLoad, reference: float, stop: StopFlag, resume: Relaxation | None
) -> tuple[np.ndarray, RemovalOutcome, list[str], int]:
    """Find the equilibrium after a member removal. Collective.

    Returns the tensions (m,) [N] of this rank's elements, the outcome, lines (all on rank 0), and iterations.
    """
    max_iterations = (
        min(MAX_REMOVAL_ITERATIONS, problem.job.load.max_iterations)
        if problem.job.load
        else MAX_REMOVAL_ITERATIONS
    )
    outcome = settle(problem, load_case, reference, stop, resume, max_iterations)
    equilibrium = outcome.equilibrium
    if not outcome.carries:
        if outcome.state == UNDECIDED:
            line = messages.UNDECIDED_CASE(
                what=load_case.words, reason=outcome.reason, factor=np.fmax(outcome.load_factor, 0.0)
            )
        else:
            line = messages.REMOVAL_WITHOUT_EQUILIBRIUM(what=load_case.words, reason=outcome.reason)
        return (
            np.full_like(equilibrium.snapshot.N, np.nan),
            RemovalOutcome(outcome.state),
            [line],
            MAX_REMOVAL_ITERATIONS,
        )
    solution, N = equilibrium.solution, equilibrium.snapshot.N
    elements = problem.distribution.m
    if solution.unstable_at >= 0:
        node = problem.comm.bcast(problem.model and problem.model.net.node_id[solution.unstable_at])
        line = messages.UNSTABLE(what=load_case.words, node=node)
        return np.full_like(N, np.nan), RemovalOutcome("unstable"), [line], solution.iterations
    errors = error_text(solution.displacement_error, solution.tension_error)
    lines = [f"{load_case.words}: {errors}; {equilibrium.slack} of {elements} elements slack"]
    if solution.unstable_at != STABLE:
        lines.append(messages.STABILITY_UNKNOWN(what=load_case.words))
    lines += force_balance_warnings([(load_case.words, equilibrium.balance.unexplained)])
    if model := problem.model:
        element_id = model.net.element_id
        lines += slip_end_warnings([(load_case.words, equilibrium.stopped)], element_id)
        at_limit = {name: element_id[list(rows)] for name, rows in equilibrium.at_limit.items()}
        lines += limit_warnings(load_case.words, at_limit)
    exceeded = equilibrium.at_limit.get("over_strength", ())
    outcome_name = "breaks" if exceeded else "equilibrium"
    return N, RemovalOutcome(outcome_name, exceeded), lines, solution.iterations


def loads_after_removals(model: Model, losses: list[Loss]) -> list[np.ndarray]:
    """Compute the loads without gusts, (n, 3) [N], before any member removal and after each. Rank 0."""
    constant, wind, gid = model.load.copy(), None, np.arange(model.net.n)
    if model.loading.growing is not None:
        constant += model.loading.growing
    if model.wind is not None and model.wind_field is not None and model.history is not None:
        wind, square = model.wind.copy(), model.wind_field.mean_square(model.history.mean_gust)

    def total() -> np.ndarray:
        return constant.copy() if wind is None else constant + wind * square[:, None]

    totals = [total()]
    for loss in losses:
        for values in (constant, wind):
            if values is not None:
                loss.redistribution.move(values, gid)
                values[loss.particles] = 0.0
        totals.append(total())
    return totals


def unsupported_after_removals(model: Model, losses: list[Loss], loads: list[np.ndarray]) -> list[bool]:
    """Return after each removal whether a part of the net is unsupported; loads : of `loads_after_removals`.

    Rank 0.
    """
    is_present, is_removed = model.net.is_there, np.zeros(model.net.n, bool)
    results = []
    for loss, load in zip(losses, loads[1:]):
        is_present[loss.elements], is_removed[loss.particles] = False, True
        results.append(is_unsupported(model.net, is_present, load, is_removed))
    return results


def removed_names(job: Job, loss: Loss) -> str:
    """Return the name of the removed members as the job gives it."""
    names = []
    for k in loss.entries:
        entry = job.removes[k]
        for key, value in (("element", entry.elements), ("cable", entry.cables)):
            if value is not None:
                value = list(dict.fromkeys(value))
                names.append(f"{key}{'s' * (len(value) > 1)} {format_list(value)}")
        if entry.group is not None:
            names.append(f"group {entry.group}")
    return " and ".join(names)
