"""One equilibrium of a scene: how it is found, taken from the state and put back, interrupted."""

from functools import partial
from typing import NamedTuple

import numpy as np

from netfall.equilibrium.newton import UNKNOWN, NoConvergence, Solution, Stopped
from netfall.equilibrium.overload import (
    BREAKS,
    NOTHING,
    OF_LOAD,
    SURELY,
    UNSTRAINED,
    GivesWay,
    Strained,
    Trial,
    search_limit,
    strained,
)
from netfall.equilibrium.relaxation import (
    RELAXATION,
    Paused,
    Relaxation,
    RunsAway,
    largest_force,
    not_begun,
    relaxation_record,
    restored_relaxation,
)
from netfall.equilibrium.slip import find_slipping
from netfall.equilibrium.snap import LimitPoint, LoadPath, is_compressible, load_on_path
from netfall.ground.errors import DivergedError, Interrupted, interrupted
from netfall.ground.stop import StopRequest
from netfall.job.asks import settings_of, tears
from netfall.mechanics.slip.law import set_strands
from netfall.mechanics.state import State, committed, put_back
from netfall.model.actions import StaticLoad
from netfall.parallel.agree import all_of
from netfall.parallel.subdomain import Distribution
from netfall.record.balance import Balance, balance_of, unknown
from netfall.record.energy import Snapshot, take_snapshot
from netfall.record.rest import at_limit_in, beyond_euler
from netfall.results.notes import NOT_STABLE
from netfall.stages.scene import Desk, Scene
from netfall.stages.static_outcome import (
    EQUILIBRIUM,
    MOST_NAMED,
    NONE,
    UNDECIDED,
    UNSTABLE,
    Equilibrium,
    StaticOutcome,
)
from netfall.write.saver import Record, Saver

NOT_FOUND = Solution(0, np.nan, np.nan, np.nan, False, UNKNOWN)
BORNE = 1.0, UNSTRAINED, None
ROUGH = 1e-3  # estimated error [-] of trials in the search for what is borne
FEW = 20_000  # iterations of a relaxation in the search for what is borne
SEARCHED = ("permanent", "case", "combination", "step", "at once", "rest")  # how much of them is borne
FOLLOWED = (*SEARCHED, "stage")  # kinds whose path is searched for limit points
APART = ("case", "combination")  # kinds that are beside the run: what follows starts as without them


class Effort(NamedTuple):
    """How hard an equilibrium is sought.

    iterations : of a relaxation, at most; tolerance : of the estimated errors; relaxes : as of `Finder.find`;
    gives_up : whether it ends as soon as it is clear that something breaks
    """

    iterations: float
    tolerance: float
    relaxes: bool = True
    gives_up: bool = False


def _full(scene: Scene, most: int | None = None) -> Effort:
    """Seek as hard as the job allows. most : iterations, None: as many as it says"""
    settings = settings_of(scene.job)
    return Effort(min(most or np.inf, settings.max_iterations), settings.tolerance)


def taken_up(distribution: Distribution, saver: Saver) -> Relaxation | None:
    """The relaxation that an earlier run was interrupted in, None: in none. Collective."""
    kept = saver.taken_up(RELAXATION)
    return kept and restored_relaxation(distribution, *kept)


def paused(
    scene: Scene,
    desk: Desk,
    stage: str,
    words: str,
    before: int,
    pause: Paused,
    kept: dict[str, Record] | None = None,
) -> Interrupted:
    """The end of a run that was asked to stop in an equilibrium, with its checkpoint. Collective.

    before : iterations of the equilibria before it; kept : records of the stage, by name
    """
    step = before + pause.at.total + pause.at.iteration
    more = {RELAXATION: relaxation_record(scene.distribution, pause.at)} | (kept or {})
    return interrupted(f"in statics, {words}", desk.saver.save(stage, step, scene.state, more))


def reference_force(scene: Scene, last: StaticLoad) -> float:
    """Largest of tensions and nodal loads [N] of what can move, which the tolerance refers to. Collective."""
    state = scene.state
    N, load = state.elements_now().N, last.load[: state.n_owned]
    return largest_force(scene.comm, N, state.ends, state.free, load)


def settle(
    scene: Scene, each: StaticLoad, reference: float, stop: StopRequest, resume=None, most=None
) -> StaticOutcome:
    """Bring the state to one equilibrium, what yields on the way included. Collective.

    reference : [N], which the tolerance refers to; stop, resume : as in `relax`; most : iterations

    Where there is none the state comes to that of the largest share of the load that is borne, of `SEARCHED`
    and of what breaks, else to where it began. An equilibrium has no fractures, but after a loss it is
    reported with what breaks in it. Raises Paused if asked to stop.
    """
    start = committed(scene.state)
    if resume is not None and resume.start is not None:
        start["x"][:] = resume.start
    limited = each.kind in SEARCHED and scene.finder.has_limit_load()
    effort = _full(scene, most)._replace(relaxes=not limited, gives_up=each.kind in SEARCHED)
    whole, found = _tried(scene, each, reference, stop, effort, resume)
    if not whole.reason:
        return _on_its_path(scene, each, reference, start, found, stop)
    if each.kind in SEARCHED or whole.reason == BREAKS:
        return _largest_share(scene, each, reference, start, whole, limited, stop)
    put_back(scene.state, start)
    reason, elements = _named(scene, whole), whole.elements[:MOST_NAMED]
    return StaticOutcome(_failed(whole), each.reached(0.0), reason, elements, as_it_began(scene))


def _failed(*tried: Strained) -> str:
    """The state of a load without an equilibrium, by what came of it and of parts of it."""
    return NONE if any(each.is_decided for each in tried) else UNDECIDED


def _tried(
    scene: Scene, each: StaticLoad, reference, stop, effort: Effort, resume=None
) -> tuple[Strained, Equilibrium | None]:
    """How near the net is to giving way under a load, and its equilibrium, None: none was found. Collective.

    The state is then where that led. Raises Paused.
    """
    try:
        found = _found(scene, each, reference, stop, effort, resume)
    except GivesWay as way:
        return way.there, None
    except DivergedError as error:
        return _where(scene, each, error), None
    return (UNSTRAINED if each.kind == "loss" else _strained(scene, each)), found


def _borne_whole(scene: Scene, each: StaticLoad, found: Equilibrium) -> StaticOutcome:
    """An equilibrium under the whole load. Collective."""
    _commit(scene.state, found.snapshot)
    state, elements = EQUILIBRIUM, ()
    if found.solution.unstable_at >= 0:
        state, elements = UNSTABLE, _compressed_at(scene, found.solution.unstable_at)
    return StaticOutcome(state, each.factor, NOT_STABLE if elements else "", elements, found)


def _on_its_path(
    scene: Scene, each: StaticLoad, reference: float, start: dict, found: Equilibrium, stop: StopRequest
) -> StaticOutcome:
    """An equilibrium under the whole load, with the limit point on the path to it. Collective.

    start : the state without the load, as of `committed`. Raises Paused.
    """
    limit, found = _limit_point(scene, each, reference, start, found, stop)
    return _borne_whole(scene, each, found)._replace(limit=limit)


def _limit_point(
    scene: Scene,
    each: StaticLoad,
    reference: float,
    start: dict,
    found: Equilibrium,
    stop: StopRequest,
    carried: float = 1.0,
) -> tuple[LimitPoint | None, Equilibrium]:
    """The limit point on the path to an equilibrium under a share of a load, its share as load factor.

    Collective. carried : that share; the others as of `_on_its_path`. If the path leads to another
    equilibrium without a limit point, the state comes to that, which is returned. Raises Paused.
    """
    if (
        each.kind not in FOLLOWED
        or scene.finder.slips is not None
        or not is_compressible(scene.comm, scene.state)
    ):
        return None, found
    unstable = found.solution.unstable_at >= 0
    if unstable and each.kind == "stage":
        return None, found
    state, end, tolerance = scene.state, committed(scene.state), settings_of(scene.job).tolerance
    put_back(state, start)
    part = load_on_path(scene.finder, each.load, each.before or start, start, carried)
    find = lambda share: scene.finder.find(part(share), tolerance, reference, FEW, each.words, stop)
    path = LoadPath(state, lambda share: scene.finder.newton(part(share)), find, each.kind == "stage")
    try:
        limit, x = path.limit_point((each.before or start)["x"], None if unstable else end["x"])
        put_back(state, end)
        if limit is None and not unstable and x is not end["x"]:
            state.x[:] = x
            found = _found(scene, each._replace(load=part(1.0)), reference, stop, _full(scene))
    except Paused:
        put_back(state, start)
        raise Paused(not_begun(start["x"])) from None
    if limit is None:
        return None, found
    share = limit.share * carried
    return limit._replace(share=share if each.kind == "permanent" else each.reached(share)), found


def _strained(scene: Scene, each: StaticLoad) -> Strained:
    """How near the state is to giving way under a load. Collective."""
    return strained(scene.comm, scene.distribution, scene.state, tears(scene.job, each.kind, each.factor))


def _give_up(scene: Scene, each: StaticLoad) -> None:
    """Raise GivesWay where an element will surely break. Collective."""
    there = _strained(scene, each)
    if there.reason == BREAKS and there.most > SURELY:
        raise GivesWay(there)


def _where(scene: Scene, each: StaticLoad, error: DivergedError) -> Strained:
    """Where a net that came to no equilibrium gives way; of what does not run away that is not known."""
    if isinstance(error, RunsAway):
        return strained(scene.comm, scene.distribution, scene.state, False)._replace(most=np.inf)
    return Strained(np.inf, (), str(error).removeprefix(f"{each.words}: "))


def _named(scene: Scene, there: Strained) -> str:
    """Why there is no equilibrium, elements by their names. Collective."""
    if not there.elements:
        return there.reason
    name = scene.comm.bcast(scene.model and scene.model.id_of(there.elements[0]))
    return f"element {name} {there.reason}"


def _found(scene: Scene, each: StaticLoad, reference, stop, effort: Effort, resume=None) -> Equilibrium:
    """The equilibrium, its plastic strains not kept yet. Collective. Raises DivergedError, Paused."""
    iterations, tolerance, relaxes, gives_up = effort
    watch = partial(_give_up, scene, each) if gives_up else None
    arguments = each.load, tolerance, reference, iterations, each.words, stop, resume, relaxes, watch
    slips = scene.finder.slips
    if slips is None:
        solution = scene.finder.find(*arguments)
    else:
        slips.weights = each.weights
        solution = find_slipping(scene.finder, *arguments)
    return _equilibrium(scene, solution, each.load)


def _equilibrium(scene: Scene, solution: Solution, load: np.ndarray) -> Equilibrium:
    """Build the record of the equilibrium under a load (n, 3) [N] in which the state is. Collective."""
    slips = scene.finder.slips
    snapshot = take_snapshot(scene.state, 0.0, 1.0, 0.0, 0.0)
    balance = _balance(scene, snapshot, solution, load)
    slack = scene.comm.allreduce(snapshot.slack)
    at_limit = at_limit_in(scene.comm, scene.distribution, scene.state, snapshot)
    at_limit |= beyond_euler(scene.comm, scene.job, scene.distribution, scene.state, scene.model, snapshot.N)
    stopped = slips.stopped() if slips is not None else ()
    return Equilibrium(snapshot, slack, solution, balance, at_limit, _slips(scene), stopped)


def balanced_under(scene: Scene, outcome: StaticOutcome, load: np.ndarray) -> StaticOutcome:
    """Return the outcome with reactions under a load (n, 3) [N] that hardly differs. Collective."""
    found = outcome.equilibrium
    balance = _balance(scene, found.snapshot, found.solution, load)
    return outcome._replace(equilibrium=found._replace(balance=balance))


def _slips(scene: Scene) -> list[float] | None:
    """Slips of all places, None: nothing slips."""
    return scene.finder.slips and scene.finder.slips.s.tolist()


def as_it_began(scene: Scene) -> Equilibrium:
    """Build the record of a state from which no equilibrium was found. Collective."""
    snapshot = take_snapshot(scene.state, 0.0, 1.0, 0.0, 0.0)
    slack, balance = scene.comm.allreduce(snapshot.slack), unknown(scene.state)
    return Equilibrium(snapshot, slack, NOT_FOUND, balance, {}, _slips(scene))


def _balance(scene: Scene, snapshot: Snapshot, solution: Solution, load: np.ndarray) -> Balance:
    asked, slips = settings_of(scene.job).tolerance, scene.finder.slips
    return balance_of(scene.comm, scene.state, snapshot, load, solution.residual, asked, slips)


def _commit(state: State, snapshot: Snapshot) -> None:
    if state.features.plastic:
        state.dissipated[:] = snapshot.heat
        state.eps_p[:] = snapshot.eps_p


def _largest_share(
    scene: Scene, each: StaticLoad, reference: float, start: dict, whole: Strained, limited: bool, stop
) -> StaticOutcome:
    """The outcome of a load that is not borne whole: how much of it is, and the state there. Collective.

    start : the state without the load, as of `committed`; whole : what came of all of it; limited : whether
    work control serves. Raises Paused.
    """
    put_back(scene.state, start)
    left = scene.finder.residual(each.load)
    words = f"{each.words}: not borne whole, searching"
    say = lambda low, high: scene.finder.report(f"{words} {low:.3g} to {high:.3g} of it")
    try:
        limit = _limit(scene, each, left, stop, say) if limited else None
        if limit is BORNE or (limited and limit is None and not whole.is_decided):
            put_back(scene.state, start)
            whole, found = _tried(scene, each, reference, stop, _full(scene))
            if not whole.reason:
                return _on_its_path(scene, each, reference, start, found, stop)
            limit = None
        limit = limit or _by_trials(scene, each, left, reference, start, whole, stop, say)
    except Paused:
        put_back(scene.state, start)
        raise Paused(not_begun(start["x"])) from None
    share, there, found = limit
    if share == 1.0:
        return _on_its_path(scene, each, reference, start, found, stop)
    passed = None
    if share > 0.0:
        passed, found = _limit_point(scene, each, reference, start, found, stop, share)
    _commit(scene.state, found.snapshot)
    state = _failed(there, whole)
    there = there if there.is_decided else whole
    reason = _named(scene, there) + f" at {share:.4g} of them" * (each.kind == "permanent" and state == NONE)
    return StaticOutcome(state, each.reached(share), reason, there.elements[:MOST_NAMED], found, passed)


def _limit(scene: Scene, each: StaticLoad, left: np.ndarray, stop, say) -> tuple | None:
    """Share that is borne, `Strained` beyond it, `Equilibrium`, by work control; None: not found. Collective.

    left : (n, 3) [N], the load that is missing; say(low, high) : of shares. `BORNE`: all of it is. Raises
    Paused.
    """
    tolerance = settings_of(scene.job).tolerance
    tolerances, strained_now = (max(tolerance, ROUGH), tolerance), lambda: _strained(scene, each)
    try:
        limit, solution = scene.finder.limit_load(each.load - left, left, strained_now, tolerances, stop, say)
    except NoConvergence:
        return None
    except Stopped:
        raise Paused(not_begun(scene.state.x)) from None
    borne = each.load - (1.0 - limit.factor) * left
    return (
        (limit.factor, limit.beyond, _equilibrium(scene, solution, borne)) if limit.beyond.reason else BORNE
    )


def _by_trials(
    scene: Scene, each: StaticLoad, left: np.ndarray, reference, start: dict, whole: Strained, stop, say
) -> tuple[float, Strained, Equilibrium]:
    """As `_limit`, by trials of shares, to a rough tolerance, from the nearer end. Collective. Raises Paused.

    Cables have one equilibrium under a load, wherever a trial begins. Where bars carry compression, or cables
    slip with friction, it depends on the path, so the load only grows.
    """
    state, full = scene.state, _full(scene)
    from_above = scene.finder.slips is None and not is_compressible(scene.comm, state)
    effort = Effort(min(FEW, full.iterations), max(ROUGH, full.tolerance))
    best, above, found = (0.0, start), None, as_it_began(scene)
    under = lambda share: each._replace(load=each.load - (1.0 - share) * left)

    def trial(share: float) -> Trial:
        nonlocal best, above, found
        is_nearer = above is not None and above[0] - share < share - best[0]
        put_back(state, above[1] if is_nearer else best[1])
        now, there = _tried(scene, under(share), reference, stop, effort)
        if not now.reason:
            best, found = (share, committed(state)), there
        elif from_above and now.reason == BREAKS:
            above = share, committed(state)
        return Trial(share, share, now)

    low, high = search_limit(trial, NOTHING, Trial(1.0, 1.0, whole), OF_LOAD, say)
    put_back(state, best[1])
    if low.factor > 0.0:
        try:
            found = _found(scene, under(low.factor), reference, stop, full)
        except DivergedError:  # its error tells
            put_back(state, best[1])
    return low.factor, high.there, found


def _compressed_at(scene: Scene, particle: int) -> tuple[int, ...]:
    """Compressed elements, global numbers, at the particle that moves most as they buckle. Collective."""
    d, state = scene.distribution.subdomain, scene.state
    there = (d.particle_gid[state.ends] == particle).any(1) & (state.elements_now().N < 0.0)
    return all_of(scene.comm, d.element_gid[there].tolist())[:MOST_NAMED]


def yielded(scene: Scene) -> tuple[int, ...]:
    """Elements, global numbers, that have yielded so far. Collective."""
    if not scene.state.features.plastic:
        return ()
    return all_of(scene.comm, scene.distribution.subdomain.element_gid[scene.state.eps_p != 0.0].tolist())


def set_net(state: State, each: StaticLoad) -> None:
    """Give the net the unstressed lengths, springs and supports that a load has of its own."""
    if each.L0 is not None:
        set_strands(state, each.L0)
    if each.spring_rest is not None:
        state.spring_rest[:] = each.spring_rest
    if each.settlement is not None:
        held = state.free == 0
        state.x[held] = (state.x_start + each.settlement)[held]
