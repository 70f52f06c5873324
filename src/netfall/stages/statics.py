"""Equilibria under constant loads: load steps, static cases, the rest under the mean wind (paper 4.1.2).

The same particles move under dynamic relaxation. First everything that is permanent acts, whole; from there
each case finds its equilibrium, and then the rest of the load comes on in equal steps. Where the wind has its
static onset, its mean comes on top of all of that.

Within an equilibrium the plastic strains are those of the one before; what has yielded is kept at its end.
"""

from dataclasses import dataclass, field
from functools import partial
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from netfall.equilibrium.find import STABLE, UNKNOWN, Finder, Found
from netfall.equilibrium.newton import is_large
from netfall.equilibrium.relaxation import Paused, Relaxation, largest_force
from netfall.ground.errors import DivergedError, NoRest
from netfall.ground.stop import NEVER, StopRequest
from netfall.job.asks import rests_at_loss, rests_in_wind
from netfall.job.read import Job
from netfall.job.schema import defaults
from netfall.mechanics.state import State
from netfall.model.loads import live_load, of_case
from netfall.record.energy import Snapshot, take_snapshot

HALVINGS = 6  # of the mean wind, where all of it has no equilibrium: what it bears is told to 2 %
FEWER = 20_000  # iterations for each of them
ALL_LOADS = "all loads"


COMMITTED = ("x", "eps_p", "dissipated")


class Equilibrium(NamedTuple):
    """One equilibrium that is looked for.

    kind : "permanent", "case", "step", "at once" or "rest", see `equilibria`; or "loss", `solve.removal`
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


@dataclass
class StaticPath:
    """What has been found so far.

    reference : [N], which the tolerance refers to; done : equilibria; total : iterations for all of these
    steps : load_factor and `Settled.numbers` of the permanent loads, then of each load step
    cases : the same by name; rest : the same, once found
    """

    reference: float = 0.0
    done: int = 0
    total: int = 0
    steps: list[dict] = field(default_factory=list)
    cases: dict[str, dict] = field(default_factory=dict)
    rest: dict = field(default_factory=dict)


class Settled(NamedTuple):
    """An equilibrium that was found, and the state in it; slack : cables of the net.

    breaking : elements, global numbers, that are beyond their fracture strain, after a loss alone
    """

    snapshot: Snapshot
    slack: int
    found: Found
    breaking: tuple[int, ...] = ()

    def numbers(self) -> dict:
        """What is kept of it besides the state."""
        return {"slack": self.slack, **self.found._asdict()}


def equilibria(run) -> list[Equilibrium]:
    """What the job asks for, in order: permanent loads, cases, load steps, rest. Collective."""
    job, model, distribution = run.job, run.setup.model, run.setup.distribution
    steps, rests = job.load.steps if job.load else 0, rests_in_wind(job)
    spread = lambda values: distribution.particles(None if model is None else values())
    permanent, live = spread(lambda: model.permanent), spread(lambda: model.live)
    found = []
    if job.cases or steps:
        found.append(Equilibrium("permanent", "the permanent loads", permanent))
    for case in job.cases:
        load = permanent + spread(partial(live_of_case, settings_of(job), model, case))
        found.append(Equilibrium("case", f"case {case.name}", load, 1.0, case.name, True))
    again = bool(job.cases)
    for step in range(1, steps + 1):
        factor = step / steps
        words = f"static load step {step} of {steps}"
        found.append(Equilibrium("step", words, permanent + factor * live, factor, "", again and step == 1))
    if rests and not steps:
        found.append(Equilibrium("at once", "the constant loads", permanent + live, 1.0, "", again))
    if rests_at_loss(job):
        found.append(Equilibrium("rest", ALL_LOADS, permanent + live, 1.0, "", again and not steps))
    if rests:
        wind = spread(lambda: model.mean_wind)
        found.append(Equilibrium("rest", "the mean wind", permanent + live + wind, 1.0))
    return found


def live_of_case(load: SimpleNamespace, model, case) -> np.ndarray:
    """What a case puts on top of the permanent loads, (n, 3) [N]. Rank 0."""
    return live_load(of_case(load, case), model.roof, model.net.load)


def find_equilibria(run, path: StaticPath | None, resume: Relaxation | None, seen=None) -> StaticPath:
    """Bring the state to the last equilibrium that the job asks for, by way of all the others. Collective.

    run : `run.Run`; path, resume : how far an earlier run came, and where within the equilibrium after that;
        None: from the start; seen : list for all that is found, for `recall`

    Raises Paused where it is asked to stop, NoRest where there is no equilibrium.
    """
    state, wanted, base = run.setup.state, equilibria(run), None
    large = is_large(run.setup.distribution)
    if path is None:
        path = StaticPath(reference_force(run, wanted[-1]))
    elif path.done > 0 and any(
        each.from_permanent or (large and each.kind == "step") for each in wanted[path.done :]
    ):
        base = permanent_again(run, wanted[0], path.reference)
    run.progress.start()
    for each in wanted[path.done :]:
        if each.from_permanent and base:
            put_back(state, base)
        before = committed(state) if each.kind == "rest" and rests_in_wind(run.job) else None
        guess = None
        if large and each.kind == "step" and path.steps[-1]["load_factor"] > 0.0:
            guess = carried_on(state, base, each.factor / path.steps[-1]["load_factor"])
        try:
            found = settle(run, each, path.reference, run.stop, resume, guess=guess)
        except Paused as pause:
            pause.path = path
            raise
        except DivergedError as error:
            if before is None:
                raise
            raise NoRest(f"{error}; {bearable(run, wanted, before, path.reference)}") from None
        resume = None
        if each.kind == "permanent":
            base = committed(state)
        if seen is not None:
            seen.append((found, committed(state)))
        note(run, path, each, found)
        share, slack = path.done / len(wanted), f"slack {found.slack}"
        run.progress.at(share, each.words, path.total, "iterations", slack)
    if wanted[-1].kind == "case":  # cases are beside the run: what follows starts where it would without
        to_the_start(run)
    return path


def note(run, path: StaticPath, each: Equilibrium, found: Settled) -> None:
    """Write what was found, and count it. Collective."""
    keep(run, path, each, found)
    path.done += 1
    path.total += found.found.iterations


def reference_force(run, last: Equilibrium) -> float:
    """Largest of tensions and nodal loads [N] of what can move, which the tolerance refers to. Collective."""
    state = run.setup.state
    return largest_force(run.comm, state.elements_now().N, state.ends, state.free, last.load[: state.n_owned])


def settle(run, each: Equilibrium, reference: float, stop: StopRequest, resume=None, most=None, guess=None):
    """Bring the state to one equilibrium, what yields on the way included; `Settled`. Collective.

    reference : [N], which the tolerance refers to; stop, resume : as in `relax`; most : iterations
    guess : positions (n, 3) [m] that may be nearer to it

    Raises DivergedError where there is none. An equilibrium has no fractures: none where one is due either,
    but that after a loss is told, with what breaks in it.
    """
    comm, setup, state, settings = run.comm, run.setup, run.setup.state, settings_of(run.job)
    if setup.finder is None:
        setup.finder = Finder(comm, setup.halo, setup.distribution, state)
    found = setup.finder.find(
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
    breaking = _breaking(run, snapshot)
    if breaking and each.kind != "loss":
        name = run.comm.bcast(setup.model and setup.model.id_of(breaking[0]))
        raise DivergedError(f"under {each.words} element {name} breaks{_advice(each)}")
    if state.features.plastic:
        state.dissipated[:] = snapshot.heat
        state.eps_p[:] = snapshot.eps_p
    return Settled(snapshot, comm.allreduce(snapshot.slack), found, breaking)


def settings_of(job: Job) -> SimpleNamespace:
    """The keys of [load] that say how an equilibrium is found; their defaults without [load]."""
    return job.load or defaults("load")


def permanent_again(run, permanent: Equilibrium, reference: float) -> dict[str, np.ndarray]:
    """What the permanent loads leave, found once more, in a run that is taken up. Collective."""
    state = run.setup.state
    now = committed(state)
    to_the_start(run)
    settle(run, permanent, reference, NEVER)
    base = committed(state)
    put_back(state, now)
    return base


def to_the_start(run) -> None:
    """Put the state back to the initial one, from which nothing has moved or yielded. Collective."""
    state, model = run.setup.state, run.setup.model
    state.x[:] = run.setup.distribution.particles(model.x if model else None)
    if state.features.plastic:
        state.eps_p[:] = state.dissipated[:] = 0.0


def keep(run, path: StaticPath, each: Equilibrium, found: Settled) -> None:
    """Note what was found, and write it. Collective."""
    state, snapshot = run.setup.state, found.snapshot
    numbers = found.numbers()
    if each.kind == "case":
        path.cases[each.name] = numbers
        run.result.write_equilibrium(f"cases/{each.name}", state, snapshot, "displacement")
    elif each.kind == "rest":
        path.rest = numbers
        run.result.write_equilibrium("rest", state, snapshot, "position")
    elif each.kind != "at once" and settings_of(run.job).steps:
        path.steps.append({"load_factor": each.factor, **numbers})
        run.result.write_static_step(state, snapshot)


def bearable(run, wanted: list[Equilibrium], before: dict, reference: float) -> str:
    """How much of the mean wind has an equilibrium, in words, by halving. Collective.

    before : the state without the wind, as of `committed`
    """
    rest, still = wanted[-1], wanted[-2].load
    low, high, most = 0.0, 1.0, min(FEWER, settings_of(run.job).max_iterations)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        put_back(run.setup.state, before)
        share = rest._replace(load=still + middle * (rest.load - still), factor=middle)
        try:
            stays = settle(run, share, reference, NEVER, most=most).found.falls == STABLE
            low, high = (middle, high) if stays else (low, middle)
        except DivergedError:
            high = middle
    return (
        f"an equilibrium was found up to {low:.2f} of its pressure, that is {np.sqrt(low):.2f} of its speed; "
        'lower the speed, or set [wind] onset = "sudden" to let it act at once'
    )


def _breaking(run, snapshot: Snapshot) -> tuple[int, ...]:
    """Elements, global numbers, that are beyond their fracture strain, the same on every rank. Collective."""
    state, subdomain = run.setup.state, run.setup.distribution.subdomain
    if not state.features.fracture:
        return ()
    over = subdomain.element_gid[snapshot.eps > state.eps_u].tolist()
    return tuple(sorted(set().union(*run.comm.allgather(over))))


def _advice(each: Equilibrium) -> str:
    if each.kind in ("rest", "case"):
        under = {"case": "it"}.get(each.kind) or ("them" if each.words == ALL_LOADS else "")
        return f": there is no equilibrium under {under}" if under else ""
    return (
        f" (load factor {each.factor:.4g}): there is no static equilibrium to start from; lower the load, or "
        "set steps = 0 to let it act at once in the dynamic stage"
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


def static_lines(path: StaticPath, elements: int, words: str, node_id: np.ndarray | None) -> list[str]:
    """What the static stage found.

    words : for the rest that dynamics begins in; node_id : (n,) on rank 0, which alone prints
    """
    found = [(f"case {name}", numbers) for name, numbers in path.cases.items()]
    if path.steps:
        found.append(("statics", path.steps[-1]))
    if path.rest:
        found.append((words, path.rest))
    lines = [f"{what}: {_settled(numbers, elements)}" for what, numbers in found]
    if node_id is None:
        return lines
    falls = [(f"statics, load factor {step['load_factor']:.4g}", step["falls"]) for step in path.steps[:-1]]
    falls += [(what, numbers["falls"]) for what, numbers in found]
    return lines + [_unstable(what, p, node_id) for what, p in falls if p != STABLE]


def _unstable(what: str, p: int, node_id: np.ndarray) -> str:
    if p == UNKNOWN:
        return f"note: {what}: whether compressed bars stay there could not be told"
    node = node_id[p]
    return (
        f"note: {what}: NOT STABLE: compressed bars have no hold, the slightest push moves node {node} most; "
        "the net does not stay where this was found: hold the bars, or tension the net more"
    )


def _settled(numbers: dict, elements: int) -> str:
    return (
        f"in equilibrium {error_words(numbers['displacement_error'], numbers['tension_error'])}"
        f"{', by relaxation' if numbers['relaxed'] else ''}, residual {numbers['residual']:.3g} N, "
        f"slack {numbers['slack']} of {elements}"
    )


def error_words(moved: float, tension: float) -> str:
    """Estimated errors in words, nan: not known."""
    return (
        f"to {moved:.0e} of displacements, {tension:.0e} of tensions"
        if moved == moved
        else "(error not known)"
    )
