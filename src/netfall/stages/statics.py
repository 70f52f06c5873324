"""Equilibria under constant loads: load steps, static cases, the rest under the mean wind (paper 4.1.2).

The same particles move under dynamic relaxation. First everything that is permanent acts, whole; from there
each case finds its equilibrium, and then the rest of the load comes on in equal steps. Where the wind has its
static onset, its mean comes on top of all of that.

Within an equilibrium the plastic strains are those of the one before; what has yielded is kept at its end.
"""

import json
import math
from dataclasses import asdict, dataclass, field

import numpy as np

from netfall.equilibrium.newton import STABLE, UNKNOWN
from netfall.equilibrium.relaxation import Paused, Relaxation
from netfall.ground.errors import DivergedError, NoRest, Undecided
from netfall.ground.stop import NEVER
from netfall.job.asks import has_statics, load_steps, rests_at_loss, rests_in_wind, settings_of
from netfall.job.job import Job
from netfall.job.memory import key_of
from netfall.mechanics.slip.law import set_strands
from netfall.model.actions import StaticLoad
from netfall.numerics.functions import lengths
from netfall.record.rest import largest_torsion
from netfall.results import notes
from netfall.stages.scene import Desk, Outcome, Scene
from netfall.stages.settle import (
    APART,
    committed,
    paused,
    put_back,
    reference_force,
    set_net,
    settle,
    taken_up,
)
from netfall.stages.static_outcome import (
    EQUILIBRIUM,
    NONE,
    NOT_A_PROOF,
    UNDECIDED,
    WHAT_TO_DO,
    StaticOutcome,
    by_ids,
    limit_warning,
    no_equilibrium,
)
from netfall.stages.wanted import equilibria, loaded
from netfall.write.result import texts

# Numbers of an equilibrium for what is said of it.
OF_LINES = ("moved", "torsion", "stopped", "rounding", "unexplained")


@dataclass
class StaticPath:
    """What has been found so far.

    reference : [N], which the tolerance refers to; done : equilibria; total : iterations for all of these
    steps : load_factor, `Equilibrium.numbers` and `farthest` of the permanent loads, then of each load step
    cases : the same by name; rest : the same, once found
    labels : attributes of the groups of the file that hold these; failed : why the run cannot go on, or ""
    undecided : whether that is a search that ended without a decision
    limits : a warning of each limit point that was passed
    """

    reference: float | None = None
    done: int = 0
    total: int = 0
    steps: list[dict] = field(default_factory=list)
    cases: dict[str, dict] = field(default_factory=dict)
    rest: dict = field(default_factory=dict)
    labels: dict[str, dict] = field(default_factory=dict)
    failed: str = ""
    undecided: bool = False
    limits: list[str] = field(default_factory=list)

    def record(self) -> tuple[dict, dict]:
        """What a continuation needs, for `restore`."""
        return asdict(self), {}

    def restore(self, small: dict, _: dict | None) -> None:
        """Take up the record of an earlier run."""
        vars(self).update(small)


NAME = "statics"


def required(job: Job) -> bool:
    """Whether equilibria are looked for before the dynamic stage."""
    return has_statics(job)


def run(scene: Scene, desk: Desk, outcomes: dict) -> Outcome:
    """The equilibria that the job asks for, from where an earlier run was interrupted in them. Collective."""
    path, saver, steps = StaticPath(), desk.saver, load_steps(scene.job)
    saver.register(NAME, path.record, path.restore)
    if saver.is_past(NAME):
        return Outcome(path, sections=sections(path), labels=group_labels(path, scene))
    if steps:
        desk.progress.say(f"statics: {steps} load steps")
    with desk.phases.phase(NAME):
        try:
            if saver.stage == NAME:
                find_equilibria(scene, desk, path, taken_up(scene.distribution, saver))
            else:
                find_or_recall(scene, desk, path)
        except Paused as pause:
            words = equilibria(scene)[path.done].each.words
            raise paused(scene, desk, NAME, words, path.total, pause) from None
    more = {} if not path.failed else {"exit_state": failed_as(path)}
    labels = group_labels(path, scene)
    return Outcome(path, lines(path, scene), sections(path), more, labels, failure_of(scene.job, path))


def failure_of(job: Job, path: StaticPath) -> DivergedError | None:
    """Why the run cannot go on, None: it can."""
    if not path.failed:
        return None
    if failed_as(path) == UNDECIDED:
        return Undecided(path.failed)
    no_rest = rests_in_wind(job) and path.labels.get("rest", {}).get("state") == NONE
    return (NoRest if no_rest else DivergedError)(path.failed)


def failed_as(path: StaticPath) -> str:
    """The state of what ended the search for equilibria: "no_equilibrium" or "undecided"."""
    return UNDECIDED if path.undecided else NONE


def find_or_recall(scene: Scene, desk: Desk, path: StaticPath) -> None:
    """`find_equilibria` from the start, or what it found in an earlier run of this process. Collective."""
    if not desk.memory.most:
        find_equilibria(scene, desk, path)
        return
    seen = []

    def find() -> list[tuple[StaticOutcome, dict, str]]:
        find_equilibria(scene, desk, path, seen=seen)
        return seen

    key = scene.comm.bcast(key_of(scene.job) if scene.comm.rank == 0 else None)
    known = desk.memory.once("statics", key, find)
    if known is not seen:
        _again(scene, desk, path, known)


def _again(scene: Scene, desk: Desk, path: StaticPath, known: list[tuple[StaticOutcome, dict, str]]) -> None:
    """The outcomes of an earlier run, with all that `find_equilibria` does about them. Collective."""
    for want, (outcome, there, failed) in zip(equilibria(scene), known):
        put_back(scene.state, there)
        note(scene, desk, path, loaded(scene, want), outcome)
        path.failed, path.undecided = failed, bool(failed) and outcome.state == UNDECIDED
    if path.failed:
        _not_begun(scene, desk, path, outcome)
    if want.each.kind in APART:
        to_the_start(scene)


def find_equilibria(
    scene: Scene, desk: Desk, path: StaticPath, resume: Relaxation | None = None, seen: list | None = None
) -> None:
    """Bring the state to the last equilibrium that the job asks for, by way of all the others. Collective.

    path : of what is found, and of how far an earlier run came; resume : where it was within the next one
    seen : takes all that is found, for `recall`

    A case without an equilibrium is noted; anything else without one ends it, see `path.failed`.
    Raises Paused where it is asked to stop.
    """
    state, wanted, base = scene.state, equilibria(scene), None
    if path.reference is None:
        path.reference = reference_force(scene, loaded(scene, wanted[-1]))
    elif path.done > 0 and any(each.from_permanent for each, _ in wanted[path.done :]):
        base = permanent_again(scene, loaded(scene, wanted[0]), path.reference)
    desk.progress.start()
    scene.finder.report = desk.progress.doing
    for want in wanted[path.done :]:
        each = loaded(scene, want)
        if each.from_permanent and base:
            put_back(state, base)
        if each.L0 is not None or each.settlement is not None:
            each = each._replace(before=committed(state))
        set_net(state, each)
        outcome = settle(scene, each, path.reference, desk.stop, resume)
        resume = None
        if not outcome.carries and each.kind not in APART:
            path.failed = no_equilibrium(scene.job, each, outcome)
            path.undecided = outcome.state == UNDECIDED
            if each.kind == "rest" and rests_in_wind(scene.job) and not path.undecided:
                path.failed += f"; {_borne(scene.job, outcome.load_factor)}"
        if each.kind == "permanent":
            base = committed(state)
        if seen is not None:
            seen.append((outcome, committed(state), path.failed))
        note(scene, desk, path, each, outcome)
        if path.failed:
            _not_begun(scene, desk, path, outcome)
            return
        share, slack = path.done / len(wanted), f"slack {outcome.equilibrium.slack}"
        desk.progress.at(share, each.words, path.total, "iterations", slack, even=False)
    if wanted[-1].each.kind in APART:  # cases are beside the run: what follows starts where it would without
        to_the_start(scene)


def _not_begun(scene: Scene, desk: Desk, path: StaticPath, last: StaticOutcome) -> None:
    """Cases that have nowhere to begin, where the permanent loads have no equilibrium: with that as reason.

    last : what was found before the run had to end, whose state stands for theirs. Collective.
    """
    none = "are undecided" if last.state == UNDECIDED else "have no equilibrium"
    reason = f"the permanent loads, with which it begins, {none}: {last.reason}"
    outcome = last._replace(load_factor=math.nan, reason=reason)
    for want in equilibria(scene)[path.done :]:
        if want.each.kind in APART:
            keep(scene, desk, path, loaded(scene, want), outcome)


def note(scene: Scene, desk: Desk, path: StaticPath, each: StaticLoad, outcome: StaticOutcome) -> None:
    """Write what was found, and count it. Collective."""
    keep(scene, desk, path, each, outcome)
    if outcome.limit is not None:
        p = outcome.limit.particle
        node = scene.comm.bcast(scene.model and scene.model.net.node_id[p])
        path.limits.append(limit_warning(each, outcome.limit, node))
    path.done += 1
    path.total += outcome.equilibrium.solution.iterations


def permanent_again(scene: Scene, permanent: StaticLoad, reference: float) -> dict[str, np.ndarray]:
    """What the permanent loads leave, found once more, in a run that is taken up. Collective."""
    state = scene.state
    now = committed(state)
    to_the_start(scene)
    settle(scene, permanent, reference, NEVER)
    base = committed(state)
    put_back(state, now)
    return base


def to_the_start(scene: Scene) -> None:
    """Put the state back to the initial one, from which nothing has moved or yielded. Collective."""
    state, model = scene.state, scene.model
    state.x[:] = scene.distribution.particles(model.x if model else None)
    if state.slip is not None:
        state.slip[:] = 0.0
    set_strands(state, scene.distribution.elements(model.L0 if model else None))
    if state.features.springs:
        state.spring_rest[:] = scene.distribution.particles(model.spring_rest if model else None)
    if state.features.plastic:
        state.eps_p[:] = state.dissipated[:] = 0.0


def keep(scene: Scene, desk: Desk, path: StaticPath, each: StaticLoad, outcome: StaticOutcome) -> None:
    """Note what was found, and write it. Collective."""
    state, snapshot = scene.state, outcome.equilibrium.snapshot
    unexplained = outcome.equilibrium.balance.unexplained if outcome.carries else 0.0
    numbers = outcome.equilibrium.numbers() | {"moved": farthest(scene), "unexplained": unexplained}
    if state.joints is not None:
        chains = scene.model and scene.model.layout.chains
        numbers |= {"torsion": largest_torsion(scene.distribution, state, chains)}
    tolerance, errors = settings_of(scene.job).tolerance, outcome.equilibrium.solution[2:4]
    if max(errors) > tolerance:
        newton = scene.finder.newton(each.load)
        numbers |= {"rounding": newton.rounding(newton.tangent())}
    numbers |= {"stopped": outcome.equilibrium.stopped} if state.slip is not None else {}
    group = f"cases/{each.name}" if each.kind in APART else "rest" if each.kind == "rest" else "statics"
    if group == "statics" and (each.kind == "at once" or not load_steps(scene.job)):
        return
    reaction = outcome.equilibrium.balance.reaction
    if not outcome.carries:  # what the load reached is in balance with less than the load
        reaction = np.full_like(reaction, np.nan)
    desk.watch(state, snapshot)
    if each.kind in APART:
        path.cases[each.name] = numbers
        desk.result.write_equilibrium(group, state, snapshot, "displacement", reaction)
    elif each.kind == "rest":
        path.rest = numbers
        desk.result.write_equilibrium(group, state, snapshot, "position", reaction)
    else:
        path.steps.append({"load_factor": outcome.load_factor, **numbers})
        desk.result.write_static_step(state, snapshot, reaction)
    if group not in path.labels or outcome.state != EQUILIBRIUM or path.labels[group]["state"] == EQUILIBRIUM:
        path.labels[group] = path.labels.get(group, {}) | outcome.labels()


def farthest(scene: Scene) -> tuple[float, int]:
    """Largest displacement [m] from the initial state, and the particle that has it. Collective."""
    state, gid = scene.state, scene.distribution.subdomain.particle_gid
    moved = lengths(state.x[: state.n_owned] - state.x_start[: state.n_owned])
    p = int(np.argmax(moved)) if len(moved) else -1
    here = (float(moved[p]), int(gid[p])) if p >= 0 else (0.0, 0)
    return max(scene.comm.allgather(here), key=lambda one: (one[0], -one[1]))


def _borne(job: Job, share: float) -> str:
    """What share of the mean wind is borne, and what to do; pressures at taps have no speed."""
    down = lambda part: f"{np.floor(100.0 * part + 1e-9) / 100.0:.2f}"  # 0.997 is not all of it
    found, what = f"an equilibrium was found up to {down(share)} of its pressure", "pressures"
    if not job.wind.pressures:
        found, what = f"{found}, that is {down(np.sqrt(share))} of its speed", "speed"
    return f'{found}; lower the {what}, or set [wind] onset = "sudden" to let it act at once'


def lines(path: StaticPath, scene: Scene) -> list[str]:
    """What the static stage found."""
    combined = {each.name for each in scene.job.combinations}
    called = {name: f"{'combination' if name in combined else 'case'} {name}" for name in path.cases}
    last = [(f"cases/{name}", called[name], numbers) for name, numbers in path.cases.items()]
    if path.steps:
        last.append(("statics", "statics", path.steps[-1]))
    if path.rest:
        last.append(("rest", rest_words(scene.job), path.rest))
    words = lambda group, each: _in_words(each, path.labels[group], scene.distribution.m)
    lines = [f"{what}: {words(group, each)}" for group, what, each in last]
    for state, told in ((NONE, "have no equilibrium"), (UNDECIDED, "are undecided")):
        count = sum(path.labels[f"cases/{name}"]["state"] == state for name in path.cases)
        if count:
            lines.append(f"warning: {count} of {len(path.cases)} cases {told}")
    if scene.model is None:
        return lines
    steps = [("statics", f"statics, load factor {step['load_factor']:.4g}", step) for step in path.steps[:-1]]
    every = [each for each in steps + last if not math.isnan(each[2]["residual"])]
    node_id, element_id = scene.model.net.node_id, scene.model.net.element_id
    lines += [
        _unstable(what, each["unstable_at"], node_id)
        for _, what, each in every
        if each["unstable_at"] != STABLE
    ]
    lines += path.limits
    lines += notes.torsion_warnings(
        [(what, each["torsion"]) for _, what, each in every if "torsion" in each], node_id
    )
    lines += notes.rounding_warnings(
        [
            (what, max(each["displacement_error"], each["tension_error"]), each["rounding"])
            for _, what, each in every
            if "rounding" in each
        ],
        settings_of(scene.job).tolerance,
    )
    stopped = [(what, each["stopped"]) for _, what, each in every if "stopped" in each]
    lines += notes.stop_notes(stopped, element_id)
    for group, what, _ in last:
        lines += notes.limit_notes(what, by_ids(path.labels[group], element_id))
    lines += notes.force_balance_warnings([(what, each["unexplained"]) for _, what, each in every])
    moved = [(what, each["moved"][0], node_id[each["moved"][1]]) for _, what, each in every]
    return lines + notes.displacement_notes(moved, scene.model.x)


def rest_words(job: Job) -> str:
    """In which rest the dynamic stage begins; "": in none of its own."""
    if rests_in_wind(job):
        return "rest under the mean wind"
    return "rest under all loads" if rests_at_loss(job) else ""


def sections(path: StaticPath) -> dict[str, dict[str, np.ndarray]]:
    """The numbers of all equilibria; their states are written as they are found."""
    datasets = {}
    if path.steps:
        kept = [name for name in path.steps[0] if name not in OF_LINES]
        columns = {name: [step[name] for step in path.steps] for name in kept}
        datasets["statics"] = numbers_of(columns)
    datasets |= {f"cases/{name}": numbers_of(numbers) for name, numbers in path.cases.items()}
    if path.rest:
        datasets["rest"] = numbers_of(path.rest)
    return datasets


def group_labels(path: StaticPath, scene: Scene) -> dict[str, dict]:
    """Attributes of the groups of the file, on rank 0: elements by their ids."""
    if scene.model is None:
        return {}
    labels = {group: by_ids(each, scene.model.net.element_id) for group, each in path.labels.items()}
    for each in scene.job.combinations:
        if f"cases/{each.name}" in labels:
            labels[f"cases/{each.name}"] |= {"kind": each.kind, "factors": json.dumps(each.factors)}
    return labels | ({"cases": {"order": texts(list(path.cases))}} if path.cases else {})


def numbers_of(numbers: dict) -> dict[str, np.ndarray]:
    """What is kept of equilibria as datasets: whether stable, and not which node says so, nor `OF_LINES`."""
    arrays = {name: np.array(value) for name, value in numbers.items() if name not in OF_LINES}
    return arrays | {"stable": arrays.pop("unstable_at") == STABLE}


def _unstable(what: str, p: int, node_id: np.ndarray) -> str:
    if p == UNKNOWN:
        return f"note: {what}: whether compressed bars buckle there could not be decided"
    node = node_id[p]
    return (
        f"note: {what}: NOT STABLE: {notes.NOT_STABLE}, node {node} moves most; the net does not stay in "
        "this equilibrium: support the bars across, or tension the net more"
    )


def _in_words(numbers: dict, label: dict, elements: int) -> str:
    if label["state"] == UNDECIDED:
        return f"UNDECIDED: {label['reason']}. {NOT_A_PROOF} {WHAT_TO_DO}"
    if label["state"] == NONE:
        return f"NO EQUILIBRIUM: {label['reason']}; load factor reached {label['load_factor']:.4g}"
    return (
        f"in equilibrium {notes.error_words(numbers['displacement_error'], numbers['tension_error'])}"
        f"{', by relaxation' if numbers['relaxed'] else ''}, residual {numbers['residual']:.3g} N, "
        f"slack {numbers['slack']} of {elements}"
    )
