"""Forces and heights that are reached by changes of unstressed length: Newton's method on the tangent.

The influence of an amount a on what is wanted follows from one solution: at fixed nodes an element's force
changes by dN/dL0 = -(dN/dL) L / L0, which holds for both measures of strain; the nodes answer the forces that
are then out of balance by K^-1, and change all forces once more.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from netfall.equilibrium.newton import NoConvergence
from netfall.erection.settings import (
    Jack,
    Wanted,
    amounts,
    jack_of,
    missed,
    rows_named,
    unknown_name,
    until_taut,
)
from netfall.ground.errors import refuse
from netfall.ground.stop import NEVER, StopRequest
from netfall.job.asks import carries_permanent
from netfall.job.job import Job
from netfall.job.values import counted, shown
from netfall.mechanics.slip.law import set_strands
from netfall.model.actions import StaticLoad
from netfall.net.net import Net
from netfall.numerics.functions import lengths
from netfall.parallel.agree import on_root
from netfall.stages import settle
from netfall.stages.scene import Scene
from netfall.stages.static_outcome import MOST_NAMED, NONE, StaticOutcome

REACHED = 1e-6  # of the value that is wanted, or of the largest force
MOST_EQUILIBRIA = 40
WORSE = 2.0  # times what was missing before: the step was too long
LONGEST = 0.2  # of a cable's length: what one step changes at most


class Tensioned(NamedTuple):
    """What came of it: L0 (m,) [m], cold, and influence (t, k) of the amounts, on rank 0.

    outcome : of the last equilibrium; no equilibrium, with the reason, where not everything is there
    equilibria : how many were looked for
    """

    L0: np.ndarray | None
    influence: np.ndarray | None
    outcome: StaticOutcome
    equilibria: int


def of_form(scene: Scene, kind: str, words: str) -> StaticLoad:
    """What the form carries: the permanent load, or nothing; words : for messages."""
    model = scene.model
    load = model and (model.loading.permanent if carries_permanent(scene.job) else np.zeros_like(model.x))
    return StaticLoad(kind, words, scene.distribution.particles(load), 1.0)


def tension_to(
    scene: Scene,
    load_case: StaticLoad,
    wanted: list[Wanted],
    jacks: list[Jack],
    L0,
    warm,
    stop: StopRequest = NEVER,
) -> Tensioned:
    """Change unstressed lengths until everything wanted is there; the state is then in that equilibrium.

    wanted, jacks, L0 (m,) [m], cold : on rank 0; warm(L0) : those of the state. Collective.

    Where that is not reached the state is in the last equilibrium on the way. Raises Paused if asked to stop.
    """
    comm, influence, best, before, tried = scene.comm, None, np.inf, None, np.zeros(0)
    reference = settle.reference_force(scene, load_case)
    for count in range(1, MOST_EQUILIBRIA + 1):
        set_strands(scene.state, scene.distribution.elements(warm(L0) if scene.model else None))
        outcome = settle.settle(scene, load_case, reference, stop)
        now = _measure(scene, wanted) if outcome.carries else None
        size = comm.bcast(now.size if now else np.inf)
        if size <= REACHED:
            return Tensioned(L0, influence, outcome, count)
        if (size > WORSE * best or size == np.inf) and before is None:
            reason = outcome.reason or "the forces are no numbers"
            state = NONE if outcome.carries else outcome.state
            return Tensioned(L0, None, outcome._replace(state=state, reason=reason), count)
        if size > WORSE * best or size == np.inf:
            settle.put_back(scene.state, before[0])
            tried = 0.5 * tried
            L0 = scene.model and _changed(jacks, before[1], tried)
            continue
        best, before = min(best, size), (settle.committed(scene.state), L0)
        influence = influences(scene, load_case.load, wanted, jacks, L0)
        if scene.model:
            tried = _step(scene, now, wanted, jacks, L0, influence)
            L0 = _changed(jacks, L0, tried)
        if comm.bcast(scene.model and not tried.any()):
            break
    settle.put_back(scene.state, before[0])
    now = _measure(scene, wanted)
    lines = comm.bcast(now and missed(wanted, now.values))
    reason = f"not reached in {count} equilibria: " + "; ".join(lines)
    nothing = StaticOutcome(NONE, np.nan, reason, (), settle.as_it_began(scene))
    return Tensioned(before[1], influence, nothing, count)


def elastic(scene: Scene, outcome: StaticOutcome) -> StaticOutcome:
    """What came of it; no equilibrium where elements yield in it: what is built is elastic. Collective."""
    over = settle.yielded(scene)
    if not over:
        return outcome
    ids = scene.comm.bcast(scene.model and counted("element", scene.model.net.element_id[list(over)]))
    reason = f"{ids} yield in it; an erection is computed elastically"
    return StaticOutcome(NONE, np.nan, reason, over[:MOST_NAMED], outcome.equilibrium)


class _Now(NamedTuple):
    """Where the net is: x (n, 3); of what is wanted values, misses, scale (t,), the largest miss."""

    x: np.ndarray
    values: np.ndarray
    misses: np.ndarray
    scale: np.ndarray
    size: float


def _measure(scene: Scene, wanted: list[Wanted]) -> _Now | None:
    """The net as it is, on rank 0. Collective."""
    state, spread = scene.state, scene.distribution
    x = spread.gather_particles(state.x)
    N = spread.gather_elements(state.elements_now().N, state.owned.astype(bool))
    if scene.model is None:
        return None
    values = np.array([each.now(x, N) for each in wanted])
    largest, extent = np.abs(N).max(), float(np.ptp(x, axis=0).max())
    scale = np.array([extent if each.node >= 0 else abs(each.value) or largest for each in wanted])
    misses = values - [each.value for each in wanted]
    return _Now(x, values, misses, scale, float(np.abs(misses / scale).max()))


def influences(
    scene: Scene, load: np.ndarray, wanted: list[Wanted], jacks: list[Jack], L0
) -> np.ndarray | None:
    """Influence (t, k) of each amount on each quantity wanted, [N/m] or [m/m], on rank 0. Collective."""
    rows = []
    count = scene.comm.bcast(scene.model and len(jacks))
    respond = responses(scene, load)
    for k in range(count):
        change = np.zeros(scene.distribution.m)
        if scene.model:
            change[jacks[k].rows] = jacks[k].shares(L0)
        x, N = respond(scene.distribution.elements(scene.model and change))
        if scene.model:
            rows.append([each.now(x, N) for each in wanted])
    return np.array(rows).T if scene.model else None


def responses(scene: Scene, load: np.ndarray) -> Callable[[np.ndarray], tuple]:
    """What changes (m,) [m] of unstressed lengths of this rank do, each by a call. Collective.

    load : (n, 3) [N] that acts. Calls are collective too, and give changes of positions (n, 3) [m] and axial
    forces (m,) [N], on rank 0. Where the net is a mechanism nothing is known of the positions, and they count
    as fixed.
    """
    state, spread = scene.state, scene.distribution
    respond = scene.finder.responses(load)

    def gathered(change):
        try:
            u, N = respond(change)
        except NoConvergence:
            u, N = np.zeros_like(state.x), scene.finder.at_fixed_nodes(change)
        return spread.gather_particles(u), spread.gather_elements(N, state.owned.astype(bool))

    return gathered


def _step(scene: Scene, now: _Now, wanted, jacks: list[Jack], L0, influence: np.ndarray) -> np.ndarray:
    """The amounts (k,) [m] of the next step. Rank 0."""
    net = scene.model.net
    L = lengths(now.x[net.elements[:, 1]] - now.x[net.elements[:, 0]])
    tried = amounts(now.misses, influence, now.scale)
    for each in wanted:
        if each.own >= 0 and not influence[:, each.own].any():
            tried[each.own] = until_taut(jacks[each.own], L, L0, net.EA, each.value)
    longest = np.array([LONGEST * L0[jack.rows].sum() / (1 + jack.cable.max()) for jack in jacks])
    return np.clip(tried, -longest, longest)


def _changed(jacks: list[Jack], L0: np.ndarray, tried: np.ndarray) -> np.ndarray:
    for jack, amount in zip(jacks, tried):
        L0 = jack.changed(L0, amount)
    return L0


# --- targets of the form: forces of groups, or heights of nodes


class Reached(NamedTuple):
    """Targets that were reached, on rank 0: x (n, 3) [m], unstressed lengths L0 (m,) [m].

    change : (k,) [m] of each cable; influence : (k, k) of these amounts where the targets are
    equilibria : how many were looked for; lines : to say
    failed : why not all of them are reached, "": they are; x and L0 are then how far it came
    """

    x: np.ndarray
    L0: np.ndarray
    change: np.ndarray
    influence: np.ndarray
    equilibria: int
    lines: list[str]
    failed: str = ""

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays, by name."""
        return {name: getattr(self, name) for name in ("x", "L0", "change", "influence")}


def reach_targets(scene: Scene, planned: np.ndarray | None, before: Reached | None) -> Reached | None:
    """Change lengths until all targets are there, under the loads that the form carries. Collective.

    planned : (m,) [m] from which changes count, on rank 0; before : the turn before it, None: it is the first

    On rank 0 what came of it, None elsewhere; the state is left in that equilibrium. Raises InputError for
    names that are wrong.
    """
    job, model, comm = scene.job, scene.model, scene.comm
    wanted, jacks = on_root(comm, lambda: named_targets(job, model.net)) or ([], [])
    each = of_form(scene, "target", "the targets")
    found = tension_to(scene, each, wanted, jacks, model and model.cut_length, lambda L0: L0)
    found = found._replace(outcome=elastic(scene, found.outcome))
    influence = influences(scene, each.load, wanted, jacks, found.L0)
    x = scene.distribution.gather_particles(scene.state.x)
    if model is None:
        return None
    change_of = lambda jack: float((found.L0 - planned)[jack.rows].sum()) / (1 + int(jack.cable.max()))
    change = np.array([change_of(jack) for jack in jacks])  # [m] of each cable
    equilibria = found.equilibria + (before.equilibria if before else 0)
    if not found.outcome.carries:
        more = "what `by` names may not bear on it, or not so far"
        failed = f"{each.words}: {found.outcome.reason}; {more}"
        return Reached(x, found.L0, change, influence, equilibria, [], failed)
    lines = [
        f"target: {want.words} = {want.value:.6g} {'m' if want.node >= 0 else 'N'}: each cable of "
        f"{jack.name} {amount:+.6g} m"
        for want, jack, amount in zip(wanted, jacks, change)
    ]
    lines.append(f"targets: reached in {equilibria} equilibria")
    return Reached(x, found.L0, change, influence, equilibria, lines)


def named_targets(job: Job, net: Net) -> tuple[list[Wanted], list[Jack]]:
    """What is wanted and by which lengths. Raises InputError for names that the net does not have."""
    errors = []
    for number, target in enumerate(job.targets, 1):
        wrong = [line for name in (target.group, target.by) if name and (line := unknown_name(net, name))]
        if target.node is not None and target.node not in net.node_id:
            wrong.append(f"node = {target.node}: no such node")
        if target.by in [other.by for other in job.targets[: number - 1]]:
            own = "stands in an earlier target; each needs lengths of its own"
            wrong.append(f"by = {shown(target.by)}: {own}")
        errors += [f"{job.path}: [[target]] {number}: {line}" for line in wrong]
    refuse(errors)
    return [_wanted(net, target) for target in job.targets], [jack_of(net, each.by) for each in job.targets]


def _wanted(net: Net, target) -> Wanted:
    if target.group:
        return Wanted(f"force of {target.group}", target.force, rows_named(net, target.group))
    node = int(np.flatnonzero(net.node_id == target.node)[0])
    return Wanted(f"height of node {target.node}", target.height, np.zeros(0, int), node)
