"""One equilibrium of a scene: how it is found, taken from the state and put back, interrupted."""

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from netfall.equilibrium.find import Solution
from netfall.equilibrium.relaxation import (
    Paused,
    Relaxation,
    largest_force,
    relaxation_record,
    restored_relaxation,
)
from netfall.ground.errors import DivergedError, Interrupted, interrupted
from netfall.ground.stop import StopRequest
from netfall.job.asks import rests_at_loss, rests_in_wind
from netfall.job.job import Job
from netfall.job.schema import defaults
from netfall.mechanics.state import State
from netfall.parallel.subdomain import Distribution
from netfall.record.energy import Snapshot, take_snapshot
from netfall.stages.scene import Desk, Scene
from netfall.write.saver import Record, Saver

ALL_LOADS = "all loads"
RELAXATION = "relaxation"  # in checkpoints
COMMITTED = ("x", "eps_p", "dissipated")


class StaticLoad(NamedTuple):
    """A load whose equilibrium is looked for.

    kind : "permanent", "case", "step", "at once" or "rest", see `equilibria`; or "loss", `stages.rests`
    words : for messages
    load : (n, 3) [N], owned and halo; factor : of the load that is not permanent; name : of a case
    from_permanent : whether it starts from the equilibrium under the permanent loads, not from the last one
    """

    kind: str
    words: str
    load: np.ndarray
    factor: float = 0.0
    name: str = ""
    from_permanent: bool = False


class Equilibrium(NamedTuple):
    """An equilibrium, and the state in it; slack : cables of the net.

    breaking : elements, global numbers, that are beyond their fracture strain, after a loss alone
    """

    snapshot: Snapshot
    slack: int
    solution: Solution
    breaking: tuple[int, ...] = ()

    def numbers(self) -> dict:
        """What is kept of it besides the state."""
        return {"slack": self.slack, **self.solution._asdict()}


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
    return largest_force(
        scene.comm, state.elements_now().N, state.ends, state.free, last.load[: state.n_owned]
    )


def settle(
    scene: Scene, each: StaticLoad, reference: float, stop: StopRequest, resume=None, most=None, guess=None
) -> Equilibrium:
    """Bring the state to one equilibrium, what yields on the way included. Collective.

    reference : [N], which the tolerance refers to; stop, resume : as in `relax`; most : iterations
    guess : positions (n, 3) [m] that may be nearer to it

    Raises DivergedError where there is none. An equilibrium has no fractures: none where one is due either,
    but that after a loss is reported, with what breaks in it.
    """
    comm, state, settings = scene.comm, scene.state, settings_of(scene.job)
    solution = scene.finder.find(
        each.load,
        settings.tolerance,
        reference,
        most or settings.max_iterations,
        each.words,
        stop,
        resume,
        guess,
    )
    snapshot = take_snapshot(state, 0.0, 1.0, 0.0, 0.0)
    breaking = _breaking(scene, snapshot)
    if breaking and each.kind != "loss":
        name = scene.comm.bcast(scene.model and scene.model.id_of(breaking[0]))
        raise DivergedError(f"under {each.words} element {name} breaks{_advice(scene.job, each)}")
    if state.features.plastic:
        state.dissipated[:] = snapshot.heat
        state.eps_p[:] = snapshot.eps_p
    return Equilibrium(snapshot, comm.allreduce(snapshot.slack), solution, breaking)


def settings_of(job: Job) -> SimpleNamespace:
    """The keys of [load] that say how an equilibrium is found; their defaults without [load]."""
    return job.load or defaults("load")


def _breaking(scene: Scene, snapshot: Snapshot) -> tuple[int, ...]:
    """Elements, global numbers, that are beyond their fracture strain, the same on every rank. Collective."""
    if not scene.state.features.fracture:
        return ()
    state = scene.state
    beyond = (snapshot.eps > state.eps_u) & (state.broken == 0)
    over = scene.distribution.subdomain.element_gid[beyond].tolist()
    return tuple(sorted(set().union(*scene.comm.allgather(over))))


def _advice(job: Job, each: StaticLoad) -> str:
    if each.kind in ("rest", "case"):
        under = {"case": "it"}.get(each.kind) or ("them" if each.words == ALL_LOADS else "")
        return f": there is no equilibrium under {under}" if under else ""
    keys = ["[load] steps = 0"] * bool(job.load and job.load.steps)
    keys += ['[wind] onset = "sudden"'] * rests_in_wind(job)
    at_once = job.dynamics and not job.cases and not rests_at_loss(job)
    return (
        f" (load factor {each.factor:.4g}): there is no static equilibrium to start from; lower the load"
        + (f", or set {' and '.join(keys)} to let it act at once in the dynamic stage" if at_once else "")
    )


def committed(state: State) -> dict[str, np.ndarray]:
    """Copies of what an equilibrium leaves in the state, for `put_back`."""
    there = ((name, getattr(state, name)) for name in COMMITTED)
    return {name: array.copy(order="K") for name, array in there if array is not None}


def put_back(state: State, kept: dict[str, np.ndarray]) -> None:
    """The state as it was when `committed` was called."""
    for name, array in kept.items():
        getattr(state, name)[:] = array


def carried_on(state: State, base: dict[str, np.ndarray], times: float) -> np.ndarray:
    """Positions (n, 3) [m] as many times as far from those of `base`, as of `committed`, as now."""
    return base["x"] + times * (state.x - base["x"])


def error_words(moved: float, tension: float) -> str:
    """Estimated errors in words, nan: not known."""
    return (
        f"to {moved:.0e} of displacements, {tension:.0e} of tensions"
        if moved == moved
        else "(error not known)"
    )
