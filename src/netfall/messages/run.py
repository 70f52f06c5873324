"""The sentences of `run` and `check`: what the net is, what was found, what a user should know."""

from pathlib import Path

import numpy as np

from netfall.ground.progress import Progress
from netfall.job.asks import has_statics
from netfall.job.job import Job
from netfall.job.values import listed
from netfall.mechanics.fields import Features
from netfall.mechanics.law.branches import stiffening
from netfall.mechanics.stability import Limit
from netfall.messages.slip import inertia_line, slip_lines, unlike_notes
from netfall.messages.wind import wind_notes
from netfall.model.layout import band_of, features_of
from netfall.model.model import Model
from netfall.model.schedule import step_at
from netfall.net.defaults import default_warnings
from netfall.parallel import partition
from netfall.record.history import MOST_STRAIN, History, most_strained, most_strained_of_all
from netfall.results.file import open_result, overloads_of
from netfall.results.form_lines import form_lines, loose_notes, self_stress_lines
from netfall.results.loss_lines import loss_lines
from netfall.results.notes import balance_notes, balance_words, detached_notes_of, motion_notes_of
from netfall.stages import dynamics
from netfall.stages.scene import Desk, Outcome, Scene
from netfall.stages.statics import rest_words

MUCH_LONGER = 0.01  # of the duration: a last step that ends later is reported
FAR_OFF = 0.01  # of it: a larger one of a net as given is reported where its equilibrium is sought
ROUNDING = 1e-11  # strain: a residual below that times the largest stiffness EA is rounding
AT_REST = 1e-6  # of the largest tension: a larger residual of the start is reported


def before_run(scene: Scene, progress: Progress) -> None:
    """The lines that a user reads before the run, on rank 0."""
    model = scene.model
    if model is None:
        return
    progress.say(f"{net_line(model)}, roof {model.roof.area.sum():.1f} m2")
    progress.say(*job_remarks(model, scene.job))
    if scene.comm.size > 1:
        progress.say(partition_line(model, scene.comm.size))
    if scene.form:
        N = in_form(scene).N
        told = f"{form_line(scene)}; tensions {N.min():.4g} to {N.max():.4g} N"
        progress.say(told, *moved_lines(scene))
    progress.say(*(scene.build_up.lines if scene.build_up else ()), *start_notes(scene))
    if scene.schedule:
        for limit in scene.limits.values():
            progress.detail(limit_line(limit, model))
        progress.say(*remarks_of(scene))


def after_run(scene: Scene, desk: Desk, outcomes: dict[str, Outcome], path: Path) -> None:
    """The last lines of a run, of its result file, on rank 0. Collective."""
    moves = dynamics.NAME in outcomes
    strained = _most_strained(scene, outcomes[dynamics.NAME].result.history if moves else None)
    if scene.model is None:
        return
    if moves:
        with open_result(path) as f:
            desk.progress.say(*_dynamics_lines(scene.model, f), *motion_notes_of(f), *overloads_of(f))
    desk.progress.say(*_strain_notes(scene.model, *strained))
    seconds = desk.phases.seconds.items()
    desk.progress.say("time: " + ", ".join(f"{name} {each:.2f} s" for name, each in seconds))
    desk.progress.say(f"written: {path}")


def _dynamics_lines(model: Model, f) -> list[str]:
    """What the dynamic stage gave: losses, fractures, energies, slip. f : the result file"""
    history, events, lines = f["history"], f["events"], []
    if "removal" in f:
        lines += loss_lines(f["removal"], events, model.net.element_id)
    if len(events["element"]):
        lines.append(
            f"fractures: {len(np.unique(events['element']))} elements, the first at "
            f"t = {events['time'][0]:.4f} s (element {events['element_id'][0]})"
        )
    identity = np.abs(history["identity_error"]).max()
    if np.isfinite(identity):  # not without the audit
        lines.append(f"energy: work identity to {identity:.1e}, balance to {balance_words(history)}")
        lines += balance_notes(history)
    lines += detached_notes_of(f)
    if model.layout.slides:
        lines += slip_lines(model, history["time"][:], f["slide"])
    return lines


def _most_strained(scene: Scene, history: History | None) -> tuple[float, float, int]:
    """Largest strain without a limit, its time [s] and its element, of the run or of its end. Collective."""
    if history is not None:
        here = history.most_strained
    else:
        now = scene.state.elements_now()
        N, eps = now.N, now.eps
        here = most_strained(scene.state, np.nan, eps, N, scene.distribution.subdomain.element_gid)
    return most_strained_of_all(scene.comm, here)


def _strain_notes(model: Model, strain: float, time: float, element: int) -> list[str]:
    """A note on an element that was stretched, or compressed, as no cable bears it. time : [s], nan: none"""
    if element < 0:
        return []
    at = "" if np.isnan(time) else f" at t = {time:.4g} s"
    return [
        f"note: element {model.element_name(element)} has a strain of {strain:.3g}{at}, above the "
        f"{MOST_STRAIN:g} that any cable bears, and no fracture_strain: check loads and units, or give "
        "[cable] yield_stress and fracture_strain"
    ]


def net_line(model: Model) -> str:
    """How large the net is."""
    return f"net: {model.net.n} particles ({int((~model.net.moves).sum())} fixed), {model.net.m} elements"


def partition_line(model: Model, ranks: int) -> str:
    """How the net is split."""
    elements, part = model.net.elements, model.layout.part
    return (
        f"partition: {model.layout.partition_source}, {partition.edge_cut(elements, part)} elements cut, "
        f"fullest part {partition.imbalance(elements, part, ranks):.2f} of the mean"
    )


def form_line(scene: Scene) -> str:
    """How well the form was found."""
    reference = max(scene.form.reference, 1e-300)
    return (
        f"form finding: {scene.form.iterations} iterations, largest residual "
        f"{scene.form.residual / reference:.2g} of the prestress; with the real material "
        f"{scene.residual / reference:.2g}"
    )


def in_form(scene: Scene) -> Model:
    """The model in its form, before stages of erection change it; on rank 0."""
    return (scene.build_up and scene.build_up.form) or scene.model


def moved_lines(scene: Scene) -> list[str]:
    """What form finding did to the geometry that was given, or which self-stress it has."""
    model = in_form(scene)
    if scene.form.self_stress is not None:
        return self_stress_lines(scene.form.self_stress, model.net.group, model.net.group_names)
    net, area, asked = model.net, float(model.roof.area.sum()), scene.job.form_finding
    constant = bool(asked) and asked.method == "fpm" and asked.modulus_factor == 0.0
    lines = form_lines(net.x, model.x, net.moves, net.node_id, model.area_given, area, constant)
    if constant:
        lines += loose_notes(model.x, net.elements, model.N, net.held, net.angle, net.node_id)
    return lines


def start_notes(scene: Scene) -> list[str]:
    """That a net as given is not in equilibrium, where nothing is done about it before it is loaded; or a net
    that was erected, under other loads than those of its last stage; or a cable over its nodes, in a form.
    """
    slips = scene.form and scene.job.slides and not scene.job.stages and not scene.failure
    return _not_at_rest(scene) + (unlike_notes(scene.model) if slips else [])


def _not_at_rest(scene: Scene) -> list[str]:
    """Of the nodes."""
    there, built = has_statics(scene.job), bool(scene.job.stages)
    warm = scene.job.load is not None and scene.job.load.temperature and not there
    if scene.failure or (there if built else scene.form):
        return []
    residual, force = scene.build_up.left if built else (scene.residual, scene.reference)
    rounding = ROUNDING * float(scene.model.net.EA.max(initial=0.0))
    far = residual > max((FAR_OFF if there or built else AT_REST) * force, rounding)
    if not ((warm and not built) or far):
        return []
    told = f"largest residual {residual:.3g} N, largest tension {force:.3g} N"
    if not there:
        return [f"note: the start is not in equilibrium: {told}"]
    return [
        f"note: the net as given is not in equilibrium with its prestress: {told}; displacements count from "
        "there, and forces change before a load acts; [form_finding] finds an equilibrium"
    ]


def stages(job: Job) -> list[str]:
    """The stages that the job has, in order."""
    found = []
    if job.form_finding:
        found.append(f"form finding ({job.form_finding.method})")
    if job.targets:
        found.append(f"{len(job.targets)} targets")
    if job.stages:
        found.append(f"erection ({len(job.stages)} stages)")
    statics = [f"{job.load.steps} load steps"] if job.load and job.load.steps else []
    statics += [f"{len(job.cases)} cases"] if job.cases else []
    if statics:
        found.append(f"statics ({', '.join(statics)})")
    if words := rest_words(job):
        found.append(words)
    if job.dynamics:
        found.append(f"dynamics ({job.dynamics.duration:g} s)")
    return found or ["none: the net alone"]


def feature_words(job: Job, model: Model) -> str:
    """What the scene has, in words."""
    features, load = features_of(job, model.layout.net, model.layout.slides), job.load
    words = (
        ("yield", features.plastic),
        ("fracture", features.fracture),
        ("wind", features.wind),
        ("damping", bool(job.dynamics and job.dynamics.damping)),
        ("self weight", bool(load and load.self_weight)),
        ("dead load", any(job.loads("dead"))),
        ("snow", any(job.loads("snow"))),
        ("static pressure", any(value is not None for value in job.loads("pressure"))),
        ("temperature", bool(load and load.temperature)),
        ("elastic supports", features.springs),
        ("supports that move", features.motion),
        ("damping over a band", bool(features.band)),
        ("slip over nodes", features.slip),
        ("air damping", features.air),
        ("air that moves along", features.air_mass),
        (f"{features.strain} strain", features.strain != Features.strain),
        ("broken elements taken out", features.fracture and not features.fragments),
    )
    return ", ".join(word for word, there in words if there) or "elastic elements alone"


def limit_line(limit: Limit, model: Model) -> str:
    """A step limit in words."""
    meaning = {
        "any_shape": "stable step, intact, in any shape",
        "slackening": "step for cables that go slack and come taut again",
        "after_fracture": "stable step after any fracture",
        "assembled": "stable step of the net as it starts, all cables taut",
        "slip": "step at which slips need no more than a fiftieth of the mass that moves with them",
    }[limit.name]
    if limit.element < 0:
        return f"{meaning}: no limit"
    return f"{meaning}: {limit.dt:.4g} s, set by element {model.element_name(limit.element)}"


def job_remarks(model: Model, job: Job) -> list[str]:
    """Return the warnings on changed defaults, and the notes on what is plausible but odd in a job."""
    return default_warnings(job, model.net) + [f"note: {note}" for note in model.notes]


def notes_of(scene: Scene) -> list[str]:
    """Return the warnings and notes that a run says before it begins, for its result; on rank 0."""
    remarks = start_notes(scene) + (remarks_of(scene) if scene.schedule else [])
    marked = [line for line in remarks if line.startswith(("note:", "warning:"))]
    return job_remarks(scene.model, scene.job) + marked


def remarks_of(scene: Scene) -> list[str]:
    """What a user should know of the wind, of the step, and of the probes."""
    job, model = scene.job, scene.model
    return wind_notes(job, model) + step_remarks(scene) + probe_remarks(model, job.output.probes)


def probe_remarks(model: Model, probes) -> list[str]:
    """Notes on probes far from any node, by more than the longest element, or where several lie in plan.

    probes : of the job; those that are ids of nodes have none
    """
    net, remarks = model.net, []
    ends = model.x[net.elements]
    longest = np.sqrt(np.sum((ends[:, 1] - ends[:, 0]) ** 2, axis=1)).max(initial=0.0)
    for place, p in zip(probes, model.layout.probes.particles):
        if isinstance(place, int):
            continue
        axes, name = len(place), ", ".join(f"{value:g}" for value in place)
        distance = np.linalg.norm(net.x[:, :axes] - np.array(place), axis=1)
        away = float(distance[p])
        level = np.flatnonzero(distance <= away + net.tolerance)
        if axes == 2 and len(level) > 1 and np.ptp(net.x[level, :2], axis=0).max() <= net.tolerance:
            remarks.append(
                f"note: [output] probes: [{name}]: nodes {listed(net.node_id[level])} lie above one another "
                f"there; its histories are those of node {net.node_id[p]} ([x, y, z] or an id tell)"
            )
        if away > longest:
            at = ", ".join(f"{value:.6g}" for value in net.x[p, :axes])
            remarks.append(
                f"note: [output] probes: [{name}] is {away:.4g} m away from every node, the longest element "
                f"{longest:.4g} m long; its histories are those of node {net.node_id[p]}, at [{at}]"
            )
    return remarks


def step_remarks(scene: Scene) -> list[str]:
    """What a user should know of mass that was added, of a fixed step, and of damping over a band."""
    job, dt, remarks = scene.job, scene.schedule.long_dt, []
    if scene.model.added is not None:
        remarks.append(_added_mass(scene.model))
    if job.slides:
        remarks.append(inertia_line(scene.model, dt))
    if job.dynamics.damping_ratio:
        more = stiffening(band_of(job)) - 1.0
        remarks.append(
            f"note: damping_ratio = {job.dynamics.damping_ratio:g} holds what vibrates in its band and above "
            f"by up to {more:.1%} more stiffness of elements; tensions, also beside a strength, are those "
            "without it, so by up to that share of their swing less than elements carry"
        )
    end = step_at(job.dynamics.duration, dt) * dt
    if end > (1.0 + MUCH_LONGER) * job.dynamics.duration:
        remarks.append(
            f"note: time_step = {dt:g} does not divide duration = {job.dynamics.duration:g}: the run ends at "
            f"t = {end:.6g} s"
        )
    limit = scene.limits["slackening"]
    if job.dynamics.time_step != "auto" and job.dynamics.time_step > limit.dt:
        element, length = scene.model.net.element_id[limit.element], scene.model.L0[limit.element]
        remarks.append(
            f"note: time_step = {job.dynamics.time_step:g} is above {limit.dt:.4g} s, from which on cables "
            f"that go slack and come taut again gain energy (first: element {element}, {length:.3g} m): "
            "it is right as long as short cables stay taut"
        )
    return remarks


def _added_mass(model: Model) -> str:
    added, own = model.added, model.mass - model.added
    most = int(np.argmax(added / np.where(own > 0.0, own, 1.0)))
    return (
        f"mass scaling: {added.sum():.4g} kg of inertia added at {int((added > 0.0).sum())} of {len(added)} "
        f"particles, {added.sum() / own[model.net.moves].sum():.2%} of what moves; at most "
        f"{added[most] / own[most]:.2g} times a particle's own (node {model.net.node_id[most]})"
    )
