"""Search for one equilibrium of a problem, for its limit load factor, and interruption of the search."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from netfall.core.errors import DivergedError, Interrupted, interruption_error
from netfall.core.message import without_code
from netfall.core.stop import StopFlag
from netfall.driver.equilibrium_record import equilibrium_record, initial_equilibrium_record
from netfall.driver.problem import Problem, RunContext
from netfall.driver.static_outcome import (
    EQUILIBRIUM,
    MAX_LISTED_ELEMENTS,
    NO_EQUILIBRIUM,
    UNDECIDED,
    UNSTABLE,
    Equilibrium,
    StaticOutcome,
)
from netfall.explicit.energy import Snapshot
from netfall.job.derived import breaks_equilibrium, load_settings
from netfall.model.actions import StaticLoad
from netfall.parallel.agree import union_of_ranks
from netfall.parallel.subdomain import Distribution
from netfall.physics.slip.law import set_slipless_lengths
from netfall.physics.state import State, restore_saved, save_state
from netfall.results.saver import CheckpointWriter, Record
from netfall.results.warning_text import INSTABILITY_TEXT
from netfall.statics.limit_load import (
    BREAKS,
    LOAD_POWER,
    NO_UTILISATION,
    UNLOADED,
    LimitUtilisation,
    Trial,
    limit_utilisation_of,
    search_limit,
)
from netfall.statics.limit_point import LimitPoint, LoadPath, has_compression, load_on_path
from netfall.statics.newton import NoConvergence, Solution, StopRequested
from netfall.statics.relaxation import (
    RELAXATION,
    Paused,
    Relaxation,
    UnboundedDisplacement,
    initial_relaxation,
    largest_force,
    relaxation_record,
    restored_relaxation,
)
from netfall.statics.slip import find_with_slip

ROUGH_TOLERANCE = 1e-3  # estimated error [-] of trials in the search for the limit load factor
FEW = 20_000  # iterations of a relaxation in the search for the limit load factor
# kinds whose limit load factor is sought
LIMIT_LOAD_KINDS = ("permanent", "case", "combination", "step", "at once", "initial_state")
LIMIT_POINT_KINDS = (*LIMIT_LOAD_KINDS, "stage")  # kinds whose path is searched for limit points
# kinds outside the sequence of the run: what follows them starts as if they were absent
APART = ("case", "combination")


class Effort(NamedTuple):
    """Limits of the effort in the search for an equilibrium.

    iterations : of a relaxation, at most; tolerance : of the estimated errors
    """

    iterations: int
    tolerance: float


def _full_effort(problem: Problem, max_iterations: int | None = None) -> Effort:
    """Return the full effort that the job allows. max_iterations : None: as the job sets them"""
    settings = load_settings(problem.job)
    most = settings.max_iterations if max_iterations is None else min(max_iterations, settings.max_iterations)
    return Effort(most, settings.tolerance)


def resumed_relaxation(distribution: Distribution, saver: CheckpointWriter) -> Relaxation | None:
    """Restore the relaxation in which an earlier run was interrupted, None: in none. Collective."""
    record = saver.taken_up(RELAXATION)
    return record and restored_relaxation(distribution, *record)


def paused(
    problem: Problem,
    context: RunContext,
    stage: str,
    words: str,
    before: int,
    pause: Paused,
    stage_records: dict[str, Record] | None = None,
) -> Interrupted:
    """Save a checkpoint and return the error of a run that was stopped in an equilibrium. Collective.

    before : iterations of the equilibria before it; stage_records : records of the stage, by name
    """
    step = before + pause.at.total + pause.at.iteration
    records = {RELAXATION: relaxation_record(problem.distribution, pause.at)} | (stage_records or {})
    return interruption_error(f"in statics, {words}", context.saver.save(stage, step, problem.state, records))


def reference_force(problem: Problem, last: StaticLoad) -> float:
    """Return the largest tension and nodal load [N] of what can move, the reference of the tolerance.

    Collective.
    """
    state = problem.state
    N, load = state.present_element_state().N, last.load[: state.n_owned]
    return largest_force(problem.comm, N, state.ends, state.free, load)


def settle(
    problem: Problem,
    load_case: StaticLoad,
    reference: float,
    stop: StopFlag,
    resume: Relaxation | None = None,
    max_iterations: int | None = None,
) -> StaticOutcome:
    """Bring the state to one equilibrium, and update plastic strains. Collective.

    reference : [N], of the tolerance; stop, resume : see `relax`

    If there is no equilibrium, the state depends on the load. If the load is one of `LIMIT_LOAD_KINDS` or if
    an element breaks, the state is the equilibrium under the limit load factor. Otherwise it is the initial
    state. An equilibrium has no fractures, except after member removal: there the elements beyond their
    strength are reported. Raises Paused if asked to stop.
    """
    start = save_state(problem.state)
    if resume is not None and resume.start is not None:
        start["x"][:] = resume.start
    has_limit_load = load_case.kind in LIMIT_LOAD_KINDS and problem.finder.has_limit_load()
    effort = _full_effort(problem, max_iterations)
    full_load, equilibrium = _try_load(problem, load_case, reference, stop, effort, resume)
    if equilibrium is not None and not full_load.reason:
        return _outcome_with_limit_point(problem, load_case, reference, start, equilibrium, stop)
    if load_case.kind in LIMIT_LOAD_KINDS or full_load.reason == BREAKS:
        return _limit_load_outcome(problem, load_case, reference, start, full_load, has_limit_load, stop)
    restore_saved(problem.state, start)
    reason, elements = _reason_text(problem, full_load), full_load.elements[:MAX_LISTED_ELEMENTS]
    state, record = _state_without_equilibrium(full_load), initial_equilibrium_record(problem)
    return StaticOutcome(state, load_case.reached(0.0), reason, elements, record)


def _state_without_equilibrium(*tried: LimitUtilisation) -> str:
    """Return the state of a load without an equilibrium from the results for all and parts of it."""
    return NO_EQUILIBRIUM if any(result.is_decided for result in tried) else UNDECIDED


def _try_load(
    problem: Problem,
    load_case: StaticLoad,
    reference: float,
    stop: StopFlag,
    effort: Effort,
    resume: Relaxation | None = None,
) -> tuple[LimitUtilisation, Equilibrium | None]:
    """Return the utilisation under a load and its equilibrium, None if none was found. Collective.

    The state is then the last one of the search. Raises Paused.
    """
    try:
        equilibrium = _find(problem, load_case, reference, stop, effort, resume)
    except DivergedError as error:
        return _utilisation_at_failure(problem, load_case, error), None
    return (
        NO_UTILISATION if load_case.kind == "loss" else _limit_utilisation(problem, load_case)
    ), equilibrium


def _carried_outcome(problem: Problem, load_case: StaticLoad, equilibrium: Equilibrium) -> StaticOutcome:
    """Return the outcome of an equilibrium under the whole load; update plastic strains. Collective."""
    _update_plastic_strains(problem.state, equilibrium.snapshot)
    state: str = EQUILIBRIUM
    elements: tuple[int, ...] = ()
    if equilibrium.solution.unstable_at >= 0:
        state, elements = UNSTABLE, _compressed_elements(problem, equilibrium.solution.unstable_at)
    return StaticOutcome(state, load_case.factor, INSTABILITY_TEXT if elements else "", elements, equilibrium)


def _outcome_with_limit_point(
    problem: Problem,
    load_case: StaticLoad,
    reference: float,
    start: dict[str, Any],
    equilibrium: Equilibrium,
    stop: StopFlag,
) -> StaticOutcome:
    """Return the outcome of an equilibrium under the whole load, with the limit point before it. Collective.

    start : the state without the load, as of `save_state`. Raises Paused.
    """
    limit, equilibrium = _find_limit_point(problem, load_case, reference, start, equilibrium, stop)
    return _carried_outcome(problem, load_case, equilibrium)._replace(limit=limit)


def _find_limit_point(
    problem: Problem,
    load_case: StaticLoad,
    reference: float,
    start: dict[str, Any],
    equilibrium: Equilibrium,
    stop: StopFlag,
    carried: float = 1.0,
) -> tuple[LimitPoint | None, Equilibrium]:
    """Find the limit point on the path to an equilibrium under a share of a load. Collective.

    carried : that share; see `_outcome_with_limit_point` for the other arguments

    The share of the limit point is converted to a load factor. If the path leads to another equilibrium
    without a limit point, the state and the result are that equilibrium. Raises Paused.
    """
    if (
        load_case.kind not in LIMIT_POINT_KINDS
        or problem.finder.slips is not None
        or not has_compression(problem.comm, problem.state)
    ):
        return None, equilibrium
    is_unstable = equilibrium.solution.unstable_at >= 0
    if is_unstable and load_case.kind == "stage":
        return None, equilibrium
    state, end, tolerance = problem.state, save_state(problem.state), load_settings(problem.job).tolerance
    restore_saved(state, start)
    load_at = load_on_path(problem.finder, load_case.load, load_case.before or start, start, carried)

    def find(factor: float) -> Solution:
        return problem.finder.find(load_at(factor), tolerance, reference, FEW, load_case.words, stop)

    path = LoadPath(
        state, lambda factor: problem.finder.newton(load_at(factor)), find, load_case.kind == "stage"
    )
    try:
        limit, x = path.limit_point((load_case.before or start)["x"], None if is_unstable else end["x"])
        restore_saved(state, end)
        if limit is None and not is_unstable and x is not end["x"]:
            state.x[:] = x
            equilibrium = _find(
                problem, load_case._replace(load=load_at(1.0)), reference, stop, _full_effort(problem)
            )
    except Paused:
        restore_saved(state, start)
        raise Paused(initial_relaxation(start["x"])) from None
    if limit is None:
        return None, equilibrium
    share = limit.share * carried
    return limit._replace(
        share=share if load_case.kind == "permanent" else load_case.reached(share)
    ), equilibrium


def _limit_utilisation(problem: Problem, load_case: StaticLoad) -> LimitUtilisation:
    """Return the utilisation of the state under a load. Collective."""
    return limit_utilisation_of(
        problem.comm,
        problem.distribution,
        problem.state,
        breaks_equilibrium(problem.job, load_case.kind, load_case.factor),
    )


def _utilisation_at_failure(
    problem: Problem, load_case: StaticLoad, error: DivergedError
) -> LimitUtilisation:
    """Return the utilisation of a net without an equilibrium; known only if displacements are unbounded."""
    if isinstance(error, UnboundedDisplacement):
        return limit_utilisation_of(problem.comm, problem.distribution, problem.state, False)._replace(
            most=np.inf
        )
    reason = without_code(str(error)).removeprefix(f"{load_case.words}: ").rstrip(".")
    return LimitUtilisation(np.inf, (), reason)


def _reason_text(problem: Problem, utilisation: LimitUtilisation) -> str:
    """Return the reason why there is no equilibrium, with elements by their ids. Collective."""
    if not utilisation.elements:
        return utilisation.reason
    name = problem.comm.bcast(problem.model and problem.model.element_id_of(utilisation.elements[0]))
    return f"element {name} {utilisation.reason}"


def _find(
    problem: Problem,
    load_case: StaticLoad,
    reference: float,
    stop: StopFlag,
    effort: Effort,
    resume: Relaxation | None = None,
) -> Equilibrium:
    """Find the equilibrium, without an update of plastic strains.

    Collective. Raises DivergedError, Paused.
    """
    iterations, tolerance = effort
    finder, name = problem.finder, load_case.words

    def find() -> Solution:
        return finder.find(load_case.load, tolerance, reference, iterations, name, stop, resume)

    if finder.slips is None:
        solution = find()
    else:
        finder.slips.weights = load_case.weights
        solution = find_with_slip(finder, find, tolerance, name)
    return equilibrium_record(problem, solution, load_case.load)


def _update_plastic_strains(state: State, snapshot: Snapshot) -> None:
    if state.features.plastic:
        state.dissipated[:] = snapshot.heat
        state.eps_p[:] = snapshot.eps_p


def _limit_load_outcome(
    problem: Problem,
    load_case: StaticLoad,
    reference: float,
    start: dict[str, Any],
    full_load: LimitUtilisation,
    has_limit_load: bool,
    stop: StopFlag,
) -> StaticOutcome:
    """Return the outcome of a load that is not carried in full: its limit load factor and the state there.

    start : the state without the load, as of `save_state`; full_load : utilisation under the full load
    has_limit_load : whether work control applies. Collective. Raises Paused.
    """
    restore_saved(problem.state, start)
    missing_load = problem.finder.residual(load_case.load)

    def say(low: float, high: float) -> None:
        problem.finder.report(f"{load_case.words}: searching the limit load factor, {low:.3g} to {high:.3g}")

    try:
        limit = _limit(problem, load_case, missing_load, stop, say) if has_limit_load else None
        limit = limit or _by_trials(problem, load_case, missing_load, reference, start, full_load, stop, say)
    except Paused:
        restore_saved(problem.state, start)
        raise Paused(initial_relaxation(start["x"])) from None
    share, beyond, equilibrium = limit
    if share == 1.0:
        return _outcome_with_limit_point(problem, load_case, reference, start, equilibrium, stop)
    limit_point = None
    if share > 0.0:
        limit_point, equilibrium = _find_limit_point(
            problem, load_case, reference, start, equilibrium, stop, share
        )
    _update_plastic_strains(problem.state, equilibrium.snapshot)
    state = _state_without_equilibrium(beyond, full_load)
    beyond = beyond if beyond.is_decided else full_load
    reason = _reason_text(problem, beyond) + f" at {share:.4g} of these loads" * (
        load_case.kind == "permanent" and state == NO_EQUILIBRIUM
    )
    return StaticOutcome(
        state,
        load_case.reached(share),
        reason,
        beyond.elements[:MAX_LISTED_ELEMENTS],
        equilibrium,
        limit_point,
    )


def _limit(
    problem: Problem,
    load_case: StaticLoad,
    missing_load: np.ndarray,
    stop: StopFlag,
    say: Callable[[float, float], None],
) -> tuple[Any, ...] | None:
    """Find the limit load factor by work control. Collective. Raises Paused.

    missing_load : (n, 3) [N], not yet applied; say(low, high) : receives the bracket of the factor

    Returns the factor, `LimitUtilisation` beyond it, and `Equilibrium`; None: not found.
    """
    tolerance = load_settings(problem.job).tolerance
    tolerances = max(tolerance, ROUGH_TOLERANCE), tolerance
    strained_now = partial(_limit_utilisation, problem, load_case)
    try:
        factor, beyond, solution = problem.finder.limit_load(
            load_case.load - missing_load, missing_load, strained_now, tolerances, stop, say
        )
    except NoConvergence:
        return None
    except StopRequested:
        raise Paused(initial_relaxation(problem.state.x.copy(order="K"))) from None
    if not beyond.reason:
        return None
    carried_load = load_case.load - (1.0 - factor) * missing_load
    return factor, beyond, equilibrium_record(problem, solution, carried_load)


def _by_trials(
    problem: Problem,
    load_case: StaticLoad,
    missing_load: np.ndarray,
    reference: float,
    start: dict[str, Any],
    full_load: LimitUtilisation,
    stop: StopFlag,
    say: Callable[[float, float], None],
) -> tuple[float, LimitUtilisation, Equilibrium]:
    """Find the limit load factor by trials of factors, to a rough tolerance. Collective. Raises Paused.

    Returns what `_limit` does. Cables have one equilibrium under a load, so a trial may start from the closer
    end of the bracket. If bars carry compression or cables slip with friction, the equilibrium depends on the
    path, so the load only grows.
    """
    state, full = problem.state, _full_effort(problem)
    from_above = problem.finder.slips is None and not has_compression(problem.comm, state)
    effort = Effort(min(FEW, full.iterations), max(ROUGH_TOLERANCE, full.tolerance))
    best, equilibrium = (0.0, start), initial_equilibrium_record(problem)
    above: tuple[float, dict[str, np.ndarray]] | None = None

    def under(share: float) -> StaticLoad:
        return load_case._replace(load=load_case.load - (1.0 - share) * missing_load)

    def trial(share: float) -> Trial:
        nonlocal best, above, equilibrium
        is_nearer = above is not None and above[0] - share < share - best[0]
        restore_saved(state, above[1] if above is not None and is_nearer else best[1])
        utilisation, trial_equilibrium = _try_load(problem, under(share), reference, stop, effort)
        if trial_equilibrium is not None and not utilisation.reason:
            best, equilibrium = (share, save_state(state)), trial_equilibrium
        elif from_above and utilisation.reason == BREAKS:
            above = share, save_state(state)
        return Trial(share, share, utilisation)

    low, high = search_limit(trial, UNLOADED, Trial(1.0, 1.0, full_load), LOAD_POWER, say)
    restore_saved(state, best[1])
    if low.factor > 0.0:
        try:
            equilibrium = _find(problem, under(low.factor), reference, stop, full)
        except DivergedError:  # the estimated error of the trial stays in the result
            restore_saved(state, best[1])
    return low.factor, high.there, equilibrium


def _compressed_elements(problem: Problem, particle: int) -> tuple[int, ...]:
    """List global numbers of compressed elements at the particle that moves most in buckling. Collective."""
    d, state = problem.distribution.subdomain, problem.state
    is_compressed = (d.particle_gid[state.ends] == particle).any(1) & (state.present_element_state().N < 0.0)
    return union_of_ranks(problem.comm, d.element_gid[is_compressed].tolist())[:MAX_LISTED_ELEMENTS]


def yielded(problem: Problem) -> tuple[int, ...]:
    """List global numbers of the elements that have yielded so far. Collective."""
    if not problem.state.features.plastic:
        return ()
    return union_of_ranks(
        problem.comm, problem.distribution.subdomain.element_gid[problem.state.eps_p != 0.0].tolist()
    )


def apply_actions(state: State, load_case: StaticLoad) -> None:
    """Give the net the unstressed lengths, springs and support positions of a load."""
    if load_case.L0 is not None:
        set_slipless_lengths(state, load_case.L0)
    if load_case.spring_rest is not None:
        state.spring_rest[:] = load_case.spring_rest
    if load_case.settlement is not None:
        held = state.free == 0
        state.x[held] = (state.x_start + load_case.settlement)[held]
