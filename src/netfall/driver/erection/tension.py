"""Changes of unstressed length for target forces and heights, and effects of errors of length.

Newton's method on the tangent finds the lengths.

The influence of an amount a on the targets follows from one linear solution. At fixed nodes an element's
force changes by dN/dL0 = -(dN/dL) L / L0, which holds for both measures of strain. The nodes respond to the
resulting residual forces by K^-1, which changes all forces again.

To first order the tension N_e has the standard deviation sqrt(sum over cables k of (dN_e/da_k s_k)^2). Here
a_k is the unstressed length of cable k and s_k its standard deviation. Errors are independent, and the
influence follows from the tangent.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from netfall.core.errors import raise_errors
from netfall.core.functions import lengths
from netfall.core.linear import least_squares
from netfall.core.messages import kN
from netfall.core.timings import NEVER_STOP, StopFlag
from netfall.driver import messages
from netfall.driver.erection.settings import (
    Jack,
    NetTarget,
    amount_until_taut,
    jack_of,
    rows_named,
    unknown_name,
)
from netfall.driver.problem import Problem
from netfall.driver.statics import equilibrium
from netfall.driver.statics.outcome import (
    MAX_LISTED_ELEMENTS,
    StaticOutcome,
    failure_text,
    initial_equilibrium_record,
    limit_warning,
    unstable_warning,
)
from netfall.geometry.net import Net
from netfall.job.cache import WIND_SPEED_KEYS, ResultCache, cache_key
from netfall.job.job import Job
from netfall.job.keys.entries import Target
from netfall.job.values import counted, format_value
from netfall.model.actions import StaticLoad
from netfall.parallel.agree import on_root
from netfall.physics.slip.law import set_slipless_lengths
from netfall.physics.state import restore_saved, save_state
from netfall.results.datasets import EQUILIBRIUM, NO_EQUILIBRIUM
from netfall.statics.limit_point import LimitPoint
from netfall.statics.newton import STABLE, NoConvergence

# error over the target value, or over the largest force [-], below which a target is reached
TARGET_TOLERANCE = 1e-6
MAX_TARGET_EQUILIBRIA = 40
DIVERGENCE_FACTOR = 100.0  # ratio to the least error [-], above which a step was too long (stiff cables)
MIN_INFLUENCE = 1e-9  # influence over the largest influence on a target [-], below which it counts as zero
MAX_LENGTH_CHANGE = 0.2  # largest change of a cable's length in one step, over its length [-]


class Tensioned(NamedTuple):
    """Result of `tension_to_targets`: L0 (m,) [m], cold, on rank 0.

    outcome : of the last equilibrium; no equilibrium, with the reason, if a target is missed
    equilibria : number of equilibria computed
    """

    L0: np.ndarray | None
    outcome: StaticOutcome
    equilibria: int


def form_load(problem: Problem, kind: str, title: str) -> StaticLoad:
    """Return the load that the form carries: the permanent load, or nothing; title : its name in messages.

    The present state is the state before its changes.
    """
    load = problem.distribution.particles(problem.model and problem.model.form_load)
    return StaticLoad(kind, title, load, 1.0, before=save_state(problem.state))


def tension_to_targets(
    problem: Problem,
    load_case: StaticLoad,
    targets: list[NetTarget],
    jacks: list[Jack],
    L0: np.ndarray | None,
    warm: Callable[[np.ndarray], np.ndarray] | None,
    stop: StopFlag = NEVER_STOP,
) -> Tensioned:
    """Change unstressed lengths until the state is an equilibrium that meets all targets. Collective.

    targets, jacks, L0 (m,) [m], cold : on rank 0; warm(L0) : returns the lengths of the state, None: L0

    If the targets are not reached, the state is the last equilibrium. Raises StopRequested.
    """
    comm, best, step = problem.comm, np.inf, np.zeros(0)
    last_state: tuple[dict[str, np.ndarray], np.ndarray | None] | None = None
    reference = equilibrium.reference_force(problem, load_case)
    for count in range(1, MAX_TARGET_EQUILIBRIA + 1):
        problem.state.reset_history()  # each trial starts from the initial lengths
        heated = L0 if L0 is None or warm is None else warm(L0)
        set_slipless_lengths(problem.state, problem.distribution.elements(heated))
        outcome = equilibrium.solve_equilibrium(problem, load_case, reference, stop)
        measured = _measure(problem, targets) if outcome.carries else None
        size = comm.bcast(measured.size if measured else np.inf)
        if size <= TARGET_TOLERANCE:
            return Tensioned(L0, outcome, count)
        if size > DIVERGENCE_FACTOR * best or size == np.inf:
            if last_state is None:
                reason = outcome.reason or "the forces are not finite"
                state = NO_EQUILIBRIUM if outcome.carries else outcome.state
                return Tensioned(L0, outcome._replace(state=state, reason=reason), count)
            saved, last_L0 = last_state
            restore_saved(problem.state, saved)
            step = 0.5 * step
            L0 = None if last_L0 is None else _changed(jacks, last_L0, step)
            continue
        best, last_state = min(best, size), (save_state(problem.state), L0)
        influence = influences(problem, load_case.load, targets, jacks, L0, fixed_nodes=True)
        if problem.model and measured and influence is not None and L0 is not None and heated is not None:
            step = _step(problem.model.net, measured, targets, jacks, L0, heated / L0, influence)
            L0 = _changed(jacks, L0, step)
        if comm.bcast(problem.model and not step.any()):
            break
    assert last_state is not None  # of the first equilibrium, or of a later one
    restore_saved(problem.state, last_state[0])
    measured = _measure(problem, targets)
    lines = comm.bcast(
        measured
        and [f"{one.text}: {one.format(value)} reached" for one, value in zip(targets, measured.values)]
    )
    reason = f"not reached in {count} equilibria: " + "; ".join(lines)
    failed = StaticOutcome(NO_EQUILIBRIUM, np.nan, reason, (), initial_equilibrium_record(problem))
    return Tensioned(last_state[1], failed, count)


def elastic(problem: Problem, outcome: StaticOutcome) -> StaticOutcome:
    """Return the outcome, "no equilibrium" if elements yield: an erection is elastic. Collective."""
    yielding = equilibrium.yielded(problem)
    if not yielding:
        return outcome
    ids = problem.comm.bcast(
        problem.model and counted("element", problem.model.net.element_id[list(yielding)])
    )
    reason = f"yield in {ids}, but an erection is computed elastically"
    return StaticOutcome(NO_EQUILIBRIUM, np.nan, reason, yielding[:MAX_LISTED_ELEMENTS], outcome.equilibrium)


class _Measured(NamedTuple):
    """Measured state. x : (n, 3) [m]; values, misses, scale : (t,) of targets; size : largest miss [-]"""

    x: np.ndarray
    values: np.ndarray
    misses: np.ndarray
    scale: np.ndarray
    size: float


def _measure(problem: Problem, targets: list[NetTarget]) -> _Measured | None:
    """Measure the targets in the present state, on rank 0. Collective."""
    x = problem.distribution.gather_particles(problem.state.x)
    N = problem.gather_elements(problem.state.present_element_state().N)
    if x is None or N is None:
        return None
    values = np.array([target.value_at(x, N) for target in targets])
    largest, extent = np.abs(N).max(), float(np.ptp(x, axis=0).max())
    scale = np.array([extent if target.node >= 0 else abs(target.value) or largest for target in targets])
    misses = values - [target.value for target in targets]
    return _Measured(x, values, misses, scale, float(np.abs(misses / scale).max()))


def influences(
    problem: Problem,
    load: np.ndarray,
    targets: list[NetTarget],
    jacks: list[Jack],
    L0: np.ndarray | None,
    fixed_nodes: bool = False,
) -> np.ndarray | None:
    """Compute the influence (t, k) of each amount on each target, [N/m] or [m/m], on rank 0. Collective.

    fixed_nodes : see `gathered_responses`
    """
    rows = []
    count = problem.comm.bcast(problem.model and len(jacks))
    respond = gathered_responses(problem, load, fixed_nodes)
    for k in range(count):
        change = np.zeros(problem.distribution.m)
        if L0 is not None:
            change[jacks[k].rows] = jacks[k].shares(L0)
        dx, dN = respond(problem.distribution.elements(change if problem.model else None))
        if problem.model:
            rows.append([target.value_at(dx, dN) for target in targets])
    return np.array(rows).T if problem.model else None


def gathered_responses(
    problem: Problem, load: np.ndarray, fixed_nodes: bool = False
) -> Callable[[np.ndarray], tuple[Any, ...]]:
    """Return a function that computes the linear response to changes of unstressed lengths. Collective.

    load : (n, 3) [N] that acts, of this rank; change : (m,) [m] of this rank, argument of each call
    fixed_nodes : whether nodes count as fixed if the tangent is singular; otherwise changes are nan

    Calls are collective too. They return the changes of positions (n, 3) [m] and of axial forces (m,) [N] of
    all ranks, on rank 0.
    """
    respond = problem.finder.responses(load)

    def gathered(change: np.ndarray) -> tuple[Any, ...]:
        try:
            u, N = respond(change)
        except NoConvergence:
            u, N = np.zeros_like(problem.state.x), problem.finder.fixed_node_response(change)
            if not fixed_nodes:
                u[:], N[:] = np.nan, np.nan
        return problem.distribution.gather_particles(u), problem.gather_elements(N)

    return gathered


def _step(
    net: Net,
    measured: _Measured,
    targets: list[NetTarget],
    jacks: list[Jack],
    L0: np.ndarray,
    heating: np.ndarray,
    influence: np.ndarray,
) -> np.ndarray:
    """Compute the amounts (k,) [m] of the next step. Rank 0.

    heating : (m,) warm over cold lengths
    """
    L = lengths(measured.x[net.elements[:, 1]] - measured.x[net.elements[:, 0]]) / heating
    misses, scaled = measured.misses / measured.scale, influence / measured.scale[:, None]
    step = least_squares(scaled, -misses, MIN_INFLUENCE).x  # of Newton's method, the smallest
    for target in targets:
        if target.jack >= 0 and not influence[:, target.jack].any():
            step[target.jack] = amount_until_taut(jacks[target.jack], L, L0, net.EA, target.value)
    longest = np.array([MAX_LENGTH_CHANGE * L0[jack.rows].sum() / (1 + jack.cable.max()) for jack in jacks])
    return np.clip(step, -longest, longest)


def _changed(jacks: list[Jack], L0: np.ndarray, step: np.ndarray) -> np.ndarray:
    for jack, amount in zip(jacks, step):
        L0 = jack.changed(L0, amount)
    return L0


class NewLengths(NamedTuple):
    """Net with other unstressed lengths, on rank 0: x (n, 3) [m], L0 (m,) [m].

    effects : other arrays by name, see `reach_targets` and `apply_length_errors`; lines : to print
    failed : reason why targets are missed or there is no equilibrium, "": none; x is then the last position
    state : of the equilibrium, as in `StaticOutcome`; equilibria : number of equilibria computed
    limit : limit point on the path to it, None: no limit point
    """

    x: np.ndarray
    L0: np.ndarray
    effects: dict[str, np.ndarray]
    lines: list[str]
    failed: str = ""
    state: str = EQUILIBRIUM
    equilibria: int = 0
    limit: LimitPoint | None = None

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays, by name."""
        return {"x": self.x, "L0": self.L0} | self.effects


def reach_targets(
    problem: Problem, planned: np.ndarray | None, before: NewLengths | None
) -> NewLengths | None:
    """Change lengths until all targets are reached, under the loads that the form carries. Collective.

    planned : (m,) [m] reference of the changes, on rank 0; before : result of the last iteration, None: first
    iteration

    Returns the result on rank 0, None elsewhere; the state is in that equilibrium. Its effects are the
    `change` (k,) [m] of each cable and the `influence` (k, k) of these amounts on the targets. Raises
    InputError for wrong names.
    """
    job, model, comm = problem.job, problem.model, problem.comm
    targets, jacks = on_root(comm, lambda: named_targets(job, problem.root_model.net)) or ([], [])
    load_case = form_load(problem, "target", "the targets")
    tensioned = tension_to_targets(problem, load_case, targets, jacks, model and model.cut_length, None)
    tensioned = tensioned._replace(outcome=elastic(problem, tensioned.outcome))
    influence = influences(problem, load_case.load, targets, jacks, tensioned.L0)
    x = problem.distribution.gather_particles(problem.state.x)
    if x is None or tensioned.L0 is None or planned is None or influence is None:
        return None
    added = tensioned.L0 - planned
    change = np.array([float(added[jack.rows].sum()) / (1 + int(jack.cable.max())) for jack in jacks])
    equilibria = tensioned.equilibria + (before.equilibria if before else 0)
    effects = {"change": change, "influence": influence}
    if not tensioned.outcome.carries:
        failed = messages.TARGETS_MISSED(what=load_case.title, reason=tensioned.outcome.reason)
        return NewLengths(x, tensioned.L0, effects, [], failed, NO_EQUILIBRIUM)
    lines = [
        f"target: {target.text}: unstressed length of each cable of {jack.name} changed by "
        f"{1e3 * amount:+.6g} mm"
        for target, jack, amount in zip(targets, jacks, change)
    ]
    lines.append(f"targets: reached in {equilibria} equilibria")
    if np.isnan(influence).any():
        lines.append(messages.NO_INFLUENCE(what="targets"))
    limit = tensioned.outcome.limit or (before.limit if before else None)
    lines += _limit_lines(problem.root_model.net, load_case, limit)
    return NewLengths(x, tensioned.L0, effects, lines, equilibria=equilibria, limit=limit)


def _limit_lines(net: Net, load_case: StaticLoad, limit: LimitPoint | None) -> list[str]:
    return [] if limit is None else [limit_warning(load_case, limit, net.node_id[limit.particle])]


def named_targets(job: Job, net: Net) -> tuple[list[NetTarget], list[Jack]]:
    """Return the targets and the jacks that reach them. Raises InputError for unknown names."""
    errors: list[str] = []
    for number, target in enumerate(job.targets, 1):
        place = f"{job.path}: [[target]] {number}"
        names = [unknown_name(net, place, name) for name in (target.group, target.adjust) if name]
        errors += filter(None, names)
        if target.node is not None and target.node not in net.node_id:
            errors.append(messages.TARGET_NODE(place=place, node=target.node))
        if target.adjust in [other.adjust for other in job.targets[: number - 1]]:
            errors.append(messages.REPEATED_TARGET(place=place, name=format_value(target.adjust)))
    raise_errors(errors)
    return [_net_target(net, target) for target in job.targets], [
        jack_of(net, entry.adjust) for entry in job.targets
    ]


def _net_target(net: Net, target: Target) -> NetTarget:
    if target.group and target.force is not None:
        return NetTarget(f"force of {target.group}", target.force, rows_named(net, target.group))
    node = int(np.flatnonzero(net.node_id == target.node)[0])
    return NetTarget(f"height of node {target.node}", target.height or 0.0, np.zeros(0, int), node)


MAX_LISTED_CABLES = 3  # number of most important cables in a message


def cable_shares(net: Net, L0: np.ndarray) -> np.ndarray:
    """Compute the share of each element (m,) in its cable, at unstressed lengths L0 (m,) [m]."""
    return L0 / np.bincount(net.cable, L0)[net.cable]


def apply_length_errors(problem: Problem, cache: ResultCache) -> NewLengths | None:
    """Draw random errors of length and find the equilibrium with them. Collective.

    cache : cache of earlier runs; the influence of errors does not depend on the random draws

    Without form finding, the given geometry is not in equilibrium without load, so nodes are not moved.
    Returns the result on rank 0, None elsewhere. Its effects are the standard deviations `tension` (m,) [N]
    by linear influence, and the `effect` (k,) [N] of each cable, the largest change of a tension by one
    standard deviation of its length.
    """
    model, distribution, failed, state = problem.model, problem.distribution, "", EQUILIBRIUM
    unstable_at, limit = STABLE, None
    load_case = form_load(problem, "deviation", "errors of length")
    key = problem.comm.bcast(model and cache_key(problem.job, (*WIND_SPEED_KEYS, "cable.length_seed")))
    tension, effect = cache.get_or_compute("influence", key, lambda: _influence(problem, load_case.load))
    L0 = None
    if model:
        L0 = model.cut_length + model.net.length_error * cable_shares(model.net, model.cut_length)
    set_slipless_lengths(problem.state, distribution.elements(L0))
    if problem.form is not None:
        outcome = elastic(problem, equilibrium.solve_equilibrium(problem, load_case, None, NEVER_STOP))
        state = outcome.state
        if outcome.carries:
            unstable_at, limit = outcome.equilibrium.solution.unstable_at, outcome.limit
        else:
            failed = failure_text(messages.ERRORS_WITHOUT_EQUILIBRIUM, load_case.title, outcome)
    x = distribution.gather_particles(problem.state.x)
    if model is None or x is None or L0 is None:
        return None
    what = load_case.title
    largest = np.argsort(-effect, kind="stable")[:MAX_LISTED_CABLES]
    names = ", ".join(
        f"{format_value(model.net.cable_names[k])} {kN(effect[k])}" for k in largest if effect[k] > 0.0
    )
    lines = [
        f"{what}: tensions have a standard deviation of up to {kN(tension.max())} (linear); "
        f"largest effect of one standard deviation of a cable: {names}"
    ]
    if np.isnan(tension).any():
        lines = [messages.NO_INFLUENCE(what=what)]
    if unstable_at != STABLE:
        lines.append(unstable_warning(what, unstable_at, model.net.node_id))
    lines += _limit_lines(model.net, load_case, limit)
    return NewLengths(x, L0, {"tension": tension, "effect": effect}, lines, failed, state, limit=limit)


def _influence(problem: Problem, load: np.ndarray) -> tuple[Any, ...]:
    """Compute standard deviations of tensions (m,) and effects of cables (k,) [N], on rank 0. Collective."""
    model = problem.model
    net = model and model.net
    deviation = problem.comm.bcast(net and _cable_deviations(net))
    square, effect = np.zeros(problem.distribution.m), np.zeros(len(deviation))
    drawn = np.flatnonzero(deviation)
    respond = gathered_responses(problem, load)
    for k in drawn:
        change = None
        if model:
            change = np.where(model.net.cable == k, cable_shares(model.net, model.cut_length), 0.0)
        _, N = respond(problem.distribution.elements(change))
        if net:
            square += (deviation[k] * N) ** 2
            effect[k] = deviation[k] * np.abs(N).max()
    return np.sqrt(square), effect


def _cable_deviations(net: Net) -> np.ndarray:
    """Return the standard deviation (k,) [m] of the length of each cable."""
    deviation = np.zeros(len(net.cable_names))
    deviation[net.cable] = net.length_std
    return deviation
