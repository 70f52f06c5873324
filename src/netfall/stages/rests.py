"""The rests of a net before and after the loss of members: where it stands with what is left of it."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from netfall.equilibrium.newton import STABLE
from netfall.equilibrium.relaxation import Paused, Relaxation
from netfall.job.asks import own_weight
from netfall.job.job import Job
from netfall.job.values import counted, listed
from netfall.mechanics.fields import FIELDS
from netfall.model.actions import StaticLoad
from netfall.model.losses import Loss, comes_loose, losses_of
from netfall.parallel.subdomain import rows_of
from netfall.results.loss_lines import SOMETHING_BREAKS
from netfall.results.notes import error_words, force_balance_warnings
from netfall.stages.scene import Desk, Outcome, Scene
from netfall.stages.settle import (
    committed,
    paused,
    put_back,
    reference_force,
    settle,
    taken_up,
)
from netfall.stages.static_outcome import UNDECIDED, undecided

OF_PARTICLES = {each.name for each in FIELDS if each.entity == "particle"}  # other ones are of elements
MOST_ITERATIONS = 100_000  # in which the damaged net comes to rest, or is taken to have none


NAME = "rests"


class Rest(NamedTuple):
    """What came of the rest after a loss.

    state : a key of `loss_lines.RESTS`; elements : global numbers, that break there
    """

    state: str
    elements: tuple[int, ...] = ()


class RestsAfter(NamedTuple):
    """The rest after each loss; tension : (losses + 1, m) [N] before any and after each, on rank 0.

    nan: no rest was found
    """

    rests: list[Rest]
    tension: np.ndarray | None


@dataclass
class Search:
    """How far the search for the rests has come.

    best : the state in the last rest that was found, as of `committed`; total : iterations so far
    rests : after each loss so far; tension : before any and after each of them, (m,) [N] on rank 0
    """

    best: dict[str, np.ndarray]
    total: int = 0
    rests: list[Rest] = field(default_factory=list)
    tension: list[np.ndarray | None] = field(default_factory=list)

    def record(self, scene: Scene) -> tuple[dict, dict[str, np.ndarray]]:
        """What a continuation needs, for `restore`; arrays by global numbers on rank 0. Collective."""
        spread, mine = scene.distribution, scene.state.owned.astype(bool)
        gathered = {
            name: (
                spread.gather_particles(rows) if name in OF_PARTICLES else spread.gather_elements(rows, mine)
            )
            for name, rows in self.best.items()
        }
        small = {"total": self.total, "rests": self.rests}
        return small, gathered | {"tension": np.array(self.tension)} if scene.model else {}

    def restore(self, scene: Scene, small: dict, arrays: dict[str, np.ndarray] | None) -> None:
        """Take up the record of an earlier run. arrays : on rank 0. Collective."""
        self.total = small["total"]
        self.rests = [Rest(state, tuple(elements)) for state, elements in small["rests"]]
        self.tension = list(arrays["tension"]) if scene.model else [None] * (1 + len(self.rests))
        spread = scene.distribution
        self.best = {
            name: (spread.particles if name in OF_PARTICLES else spread.elements)(arrays and arrays[name])
            for name in self.best
        }


def required(job: Job) -> bool:
    """Whether members are lost in the dynamic stage."""
    return bool(job.removes and job.dynamics)


def run(scene: Scene, desk: Desk, outcomes: dict) -> Outcome:
    """The rests after the losses; result : `RestsAfter`, None where nothing is lost in time. Collective.

    From where the dynamic stage begins, with the losses so far, under all constant loads and the mean wind.
    Leaves the state as it was. Raises Interrupted where it is asked to stop.
    """
    losses = losses_now(scene)
    if desk.saver.is_past(NAME) or not losses:
        return Outcome()
    with desk.phases.phase("statics"):
        return Outcome(rests_after(scene, desk, losses))


def losses_now(scene: Scene) -> list[Loss]:
    """What is lost in the dynamic stage, on every rank. Collective."""
    if not required(scene.job):
        return []
    return scene.comm.bcast(scene.model and losses_of(scene.job, scene.model, scene.schedule))


def rests_after(scene: Scene, desk: Desk, losses: list[Loss]) -> RestsAfter:
    """What `run` finds. Collective."""
    state, distribution, model = scene.state, scene.distribution, scene.model
    loads = loads_after(model, losses) if model else [None] * (len(losses) + 1)
    start, EA, broken = committed(state), state.EA.copy(), state.broken.copy()
    loose = scene.comm.bcast(loose_after(model, losses, loads) if model else None)
    reference = reference_force(scene, StaticLoad("loss", "", distribution.particles(loads[0])))
    mine = lambda tension: distribution.gather_elements(tension, state.owned.astype(bool))
    search = Search(start, tension=[mine(state.elements_now().N)])
    resume = _taken_up(scene, desk, search)
    for k, (loss, no_rest, whole) in enumerate(zip(losses, loose, loads[1:])):
        rows = rows_of(distribution.subdomain.element_gid, loss.elements)
        rows = rows[rows >= 0]
        state.EA[rows], state.broken[rows] = 0.0, 1  # not slack: gone
        if k < len(search.rests):
            continue
        scene.finder.forget()
        put_back(state, search.best)
        load = distribution.particles(whole)
        words = f"the net without {words_of(scene.job, loss)}"
        tension, rest = np.full(state.m, np.nan), Rest("no_equilibrium")
        lines = [f"no rest: a part of {words} is connected to no support"]
        if not no_rest:
            try:
                each = StaticLoad("loss", words, load, 1.0, weights=own_weight(scene.job))
                tension, rest, lines, iterations = _rest_under(scene, each, reference, desk.stop, resume)
                search.total += iterations
                search.best = committed(state) if rest.state == "equilibrium" else search.best
            except Paused as pause:
                pause.at.x = pause.at.x.copy(order="K")  # it may be the state's own
                put_back(state, start)
                state.EA[:], state.broken[:] = EA, broken
                kept = {NAME: search.record(scene)}
                raise paused(scene, desk, NAME, words, search.total, pause, kept) from None
        resume = None
        desk.progress.say(*lines)
        search.rests.append(rest)
        search.tension.append(mine(tension))
    put_back(state, start)
    state.EA[:], state.broken[:] = EA, broken
    scene.finder.forget()
    return RestsAfter(search.rests, np.array(search.tension) if model else None)


def _taken_up(scene: Scene, desk: Desk, search: Search) -> Relaxation | None:
    """Bring a search to where an earlier run was interrupted in it; its relaxation then. Collective."""
    kept = desk.saver.taken_up(NAME)
    if kept is None:
        return None
    search.restore(scene, *kept)
    return taken_up(scene.distribution, desk.saver)


def _rest_under(
    scene: Scene, each: StaticLoad, reference: float, stop, resume: Relaxation | None
) -> tuple[np.ndarray, Rest, list[str], int]:
    """Tensions (m,) [N] of this rank's elements at rest, what is known of it, lines on it, iterations.

    Collective.
    """
    most = min(MOST_ITERATIONS, scene.job.load.max_iterations) if scene.job.load else MOST_ITERATIONS
    outcome = settle(scene, each, reference, stop, resume, most)
    settled = outcome.equilibrium
    if not outcome.carries:
        line = f"no rest: {each.words}: {outcome.reason}"
        if outcome.state == UNDECIDED:
            line = f"warning: {undecided(each.words, outcome)}"
        return np.full_like(settled.snapshot.N, np.nan), Rest(outcome.state), [line], MOST_ITERATIONS
    rest, N = settled.solution, settled.snapshot.N
    if rest.unstable_at >= 0:
        node = scene.comm.bcast(scene.model and scene.model.net.node_id[rest.unstable_at])
        line = f"no rest of {each.words}: not stable at node {node}"
        return np.full_like(N, np.nan), Rest("unstable"), [line], rest.iterations
    line = f"rest of {each.words}: {error_words(rest.displacement_error, rest.tension_error)}"
    known = "" if rest.unstable_at == STABLE else ", whether it is stable could not be told"
    line += f", residual {rest.residual:.3g} N, slack {settled.slack}{known}"
    named = lambda rows: scene.comm.bcast(
        scene.model and counted("element", scene.model.net.element_id[list(rows)])
    )
    if settled.stopped:
        line += f"; ends of cables stop in {named(settled.stopped)}"
    for limit in ("buckled", "yielding"):
        if limit in settled.at_limit:
            line += f"; {limit}: {named(settled.at_limit[limit])}"
    over = settled.at_limit.get("over_strength", ())
    warnings = force_balance_warnings([(f"rest of {each.words}", settled.balance.unexplained)])
    if not over:
        return N, Rest("equilibrium"), [line, *warnings], rest.iterations
    line += f"; {SOMETHING_BREAKS}: {named(over)}"
    return N, Rest("breaks", over), [line, *warnings], rest.iterations


def loads_after(model, losses: list[Loss]) -> list[np.ndarray]:
    """What acts on the net without wind gusts, (n, 3) [N], before any loss and after each. Rank 0."""
    still, wind, gid = model.load.copy(), None, np.arange(model.net.n)
    if model.loading.growing is not None:
        still += model.loading.growing
    if model.mean_wind is not None:
        wind, square = model.wind.copy(), model.wind_field.mean_square(model.history.mean_gust)
    total = lambda: still.copy() if wind is None else still + wind * square[:, None]
    found = [total()]
    for loss in losses:
        for values in (still, wind):
            if values is not None:
                loss.handed.move(values, gid)
                values[loss.particles] = 0.0
        found.append(total())
    return found


def loose_after(model, losses: list[Loss], loads: list[np.ndarray]) -> list[bool]:
    """After each loss, whether a part of the net hangs on no support; loads : of `loads_after`. Rank 0."""
    there, gone = model.net.is_there, np.zeros(model.net.n, bool)
    found = []
    for loss, load in zip(losses, loads[1:]):
        there[loss.elements], gone[loss.particles] = False, True
        found.append(comes_loose(model.net, there, load, gone))
    return found


def words_of(job, loss: Loss) -> str:
    """What a loss takes, as the job names it."""
    names = []
    for k in loss.entries:
        entry = job.removes[k]
        for key, given in (("element", entry.elements), ("cable", entry.cables)):
            if given is not None:
                given = list(dict.fromkeys(given))
                names.append(f"{key}{'s' * (len(given) > 1)} {listed(given)}")
        if entry.group is not None:
            names.append(f"group {entry.group}")
    return " and ".join(names)
