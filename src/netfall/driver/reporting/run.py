"""Lines of `run` and `check`: description of the net, sliding cables, results, warnings and notes."""

from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np

from netfall.core.functions import lengths
from netfall.core.messages import count_of, is_error, is_warning, mm
from netfall.core.progress import Progress
from netfall.driver import messages
from netfall.driver.dynamics import stage as dynamics
from netfall.driver.erection.settings import lost_load_warnings
from netfall.driver.problem import Outcome, Problem, RunContext
from netfall.driver.reporting.unfinished import unfinished_warnings
from netfall.driver.reporting.wind import wind_warnings
from netfall.driver.statics.stage import final_equilibrium_name
from netfall.explicit.history import largest_unlimited_strain_of_ranks, most_strained
from netfall.explicit.sampling import REPORTED_STRAIN
from netfall.geometry.net import Net
from netfall.geometry.slip_points import SlidingCables
from netfall.job.derived import carries_permanent, has_statics, load_steps
from netfall.job.job import Job
from netfall.job.values import format_list
from netfall.model.layout import Layout, damping_branches
from netfall.model.model import Model
from netfall.model.schedule import governing_limit, slip_movers, step_at
from netfall.parallel import partition
from netfall.physics.law.branches import branch_stiffening
from netfall.physics.slip.law import MIN_SEGMENT_SHARE, MOST_ADDED, added_share, slip_inertia
from netfall.physics.stability import Limit
from netfall.results import text, warning_text
from netfall.results.file import provenance_text
from netfall.results.states import described_removals
from netfall.statics.form.find import Form

MAX_EXCESS = 0.01  # share of the tension; no warning of a smaller difference beyond the slip resistance
MAX_SLIP_CHANGE = 0.1  # share of the length of a free segment; netfall warns of a larger change by slip


def inertia_line(model: Model, slides: SlidingCables, dt: float) -> str:
    """Return a line if slips have more inertia, for steps of dt [s], than the cable."""
    movers = slip_movers(model)
    ratio = slip_inertia(movers.own, movers.stiffness, dt) / movers.own
    increased, worst, share = int((ratio > 1.0).sum()), int(np.argmax(ratio)), added_share(movers, dt)
    if not increased:
        return f"slip: {slides.count} slip points, with the inertia of the cable there"
    node = model.net.node_id[slides.node[worst]]
    if share > MOST_ADDED:
        return messages.SLIP_INERTIA(
            count=increased, total=slides.count, ratio=ratio[worst], node=node, share=share, limit=MOST_ADDED
        )
    return (
        f"slip: the step adds inertia at {increased} of {slides.count} slip points, up to {ratio[worst]:.3g} "
        f"times that of the cable (node {node}), in total at most {share:.2%} of the moving mass"
    )


def form_slip_warnings(model: Model, slides: SlidingCables) -> Iterator[str]:
    """Yield a warning of slip points where tensions of the form differ by more than the slip resistance."""
    net, x = model.net, model.x
    u, w = (x[net.elements[e].sum(1) - slides.node] - x[slides.node] for e in (slides.before, slides.after))
    u, w = (vector / lengths(vector)[:, None] for vector in (u, w))
    turn = 2.0 * np.arctan2(lengths(u + w), lengths(u - w))
    N = model.N[np.stack([slides.before, slides.after])]
    slip_resistance = slides.resistance + np.maximum(N.min(0), 0.0) * np.expm1(slides.friction * turn)
    excess = np.abs(N[1] - N[0]) - slip_resistance
    slips, worst = excess > MAX_EXCESS * np.abs(N).max(0), int(np.argmax(excess))
    if slips.any():
        (before, after), node, count = N[:, worst], net.node_id[slides.node[worst]], int(slips.sum())
        yield messages.FORM_SLIPS(count=count, total=slides.count, node=node, before=before, after=after)


def slip_lines(model: Model, slides: SlidingCables, time: np.ndarray, slide: h5py.Group) -> Iterator[str]:
    """Yield lines on slip in the dynamic stage, strongly changed free segments and cables that ran out.

    time : (t,) [s]; slide : datasets of /slide
    """
    net = model.net
    slip, stopped = slide["slip"][:] - slide["slip"][0], slide["stopped"][:]
    row, point = np.unravel_index(np.argmax(np.abs(slip)), slip.shape)
    if slip[row, point] == 0.0:
        yield "slip in the dynamic stage: none"
        return
    slipped = int((slip != 0.0).any(0).sum())
    yield (
        f"slip in the dynamic stage: at {slipped} of {slides.count} slip points, at most "
        f"{mm(slip[row, point])}, over node {net.node_id[slides.node[point]]} by t = {time[row]:.4g} s"
    )
    adjoining, inside = np.concatenate([slides.before, slides.after]), slides.segment >= 0
    length = np.bincount(slides.segment[inside], model.L0[inside])
    change = np.zeros((len(length), len(time)))
    np.add.at(change, slides.segment[adjoining], np.concatenate([-slip.T, slip.T]))
    share = np.abs(change).max(1) / length
    worst = int(np.argmax(share))
    if share[worst] > MAX_SLIP_CHANGE:
        name = model.element_name(int(adjoining[slides.segment[adjoining] == worst][0]))
        yield messages.SEGMENT_CHANGED(element=name, share=share[worst], limit=MAX_SLIP_CHANGE)
    if not np.isnan(stopped).all():
        first = int(np.nanargmin(stopped))
        node = net.node_id[slides.node[first]]
        yield messages.CABLE_RAN_OUT(
            time=stopped[first], node=node, count=int((~np.isnan(stopped)).sum()), share=MIN_SEGMENT_SHARE
        )


MAX_OVERRUN = 0.01  # share of the duration by which the last step may end later without a note
# residual / largest tension; netfall warns above it if an equilibrium follows
FAR_OFF = 0.01
MAX_ADDED_INERTIA = 0.1  # share of the moving mass [-], by which the first period grows by up to 5 %
ROUNDING_STRAIN = 1e-11  # strain; residuals below this times the largest EA are rounding
MAX_RESIDUAL_START = 1e-6  # residual / largest tension; netfall warns above it at a start without statics


def report_net(job: Job, ranks: int, progress: Progress, layout: Layout) -> None:
    """Report the net as given, with remarks, before form finding."""
    progress.say(f"{net_line(layout.net)}, roof {layout.roofing.given.surface.sum():.1f} m2")
    progress.say(*net_remarks(job, layout))
    if ranks > 1:
        elements, part = layout.net.elements, layout.part
        progress.verbose_message(
            f"partition: {layout.partition_source}, elements cut: {partition.edge_cut(elements, part)}, "
            f"largest part {partition.imbalance(elements, part, ranks):.2f} times the mean"
        )


def report_problem(problem: Problem, progress: Progress) -> None:
    """Report the problem before the run, after `report_net`, on rank 0."""
    model = problem.model
    if model is None:
        return
    progress.say(*model.start_notes)
    if problem.form:
        form = form_found_model(problem)
        line = f"{form_line(problem, problem.form)}; {text.form_tensions(form.N, form.net.bar)}"
        progress.say(line, *form_change_lines(problem, problem.form))
    progress.say(*problem.build_up.lines, *start_warnings(problem))
    if problem.schedule:
        governing = governing_limit(problem.limits, problem.dynamics.time_step == "auto")
        for limit in problem.limits.values():
            say = progress.say if limit is governing else progress.verbose_message
            say(limit_line(limit, model))
        progress.say(*dynamic_remarks(problem))


class OutcomeReport:
    """The lines on the outcome of a run, on rank 0, from its result file before the file is renamed.

    A run without a result file has its small datasets in memory; see `driver.run.UnsavedResult`.
    """

    def __init__(self, problem: Problem, context: RunContext, outcomes: dict[str, Outcome]):
        """Gather the data that a result file does not contain. Collective."""
        self._has_dynamics, self._model = dynamics.NAME in outcomes, problem.model
        history = outcomes[dynamics.NAME].result.history if self._has_dynamics else None
        if history is None:
            state, gid = problem.state, problem.distribution.subdomain.element_gid
            elements = state.present_element_state()
            local_largest = most_strained(state, np.nan, elements.eps, elements.N, gid)
        else:
            local_largest = history.most_strained
        # strain, time [s], nan: at the end, and element, of those without a limit
        self._most_strained = largest_unlimited_strain_of_ranks(problem.comm, local_largest)
        self._progress = context.progress
        self.lines: list[str] = []

    def warnings(self, f: h5py.File) -> list[str]:
        """Set `lines`, and return all warnings of the run. f : the result file, on rank 0"""
        if self._model is not None:
            if self._has_dynamics:
                self.lines += _dynamics_lines(self._model, f)
                self.lines += warning_text.dynamic_limit_warnings_of(f)
                self.lines += warning_text.overload_warnings_of(f)
            strain, time, element = self._most_strained
            if element >= 0:  # a strain that no real cable reaches
                name, limit = self._model.element_name(element), REPORTED_STRAIN
                at = "" if np.isnan(time) else f" at t = {time:.4g} s"
                self.lines.append(messages.LARGE_STRAIN(element=name, strain=strain, at=at, limit=limit))
        before_start = provenance_text(f, "notes").splitlines()
        lines = [*before_start, *self._progress.warnings, *self.lines]
        return list(dict.fromkeys(filter(is_warning, lines)))


def _dynamics_lines(model: Model, f: h5py.File) -> Iterator[str]:
    """Summarise the dynamic stage: removals, fractures, energies, slip; f : the result file."""
    history, events = f["history"], f["events"]
    if "removal" in f:
        yield from described_removals(f)
    if len(events["element"]):
        yield (
            f"fractures: {count_of(len(np.unique(events['element_id'])), 'element')}, the first at "
            f"t = {events['time'][0]:.4f} s (element {events['element_id'][0]})"
        )
    work_error = np.abs(history["work_identity_error"]).max()
    if np.isfinite(work_error):  # nan without the energy check
        balance = warning_text.balance_text(history)
        yield f"energy: work identity to {work_error:.1e}, balance to {balance}"
        yield from warning_text.balance_warnings(history)
    yield from warning_text.detached_warnings_of(f)
    if slides := model.layout.slides:
        yield from slip_lines(model, slides, history["time"][:], f["slide"])


def net_line(net: Net) -> str:
    """Return the line on the size of the net."""
    return f"net: {net.n} particles ({int((~net.moves).sum())} fixed), {count_of(net.m, 'element')}"


def form_line(problem: Problem, form: Form) -> str:
    """Return the line on the accuracy of form finding."""
    reference = max(form.reference, 1e-300)
    return (
        f"form finding: largest residual {form.residual / reference:.2g} of the prestress; with the real "
        f"material {problem.residual / reference:.2g}"
    )


def form_found_model(problem: Problem) -> Model:
    """Return the form-found model, before stages of erection change it; on rank 0."""
    return problem.build_up.form or problem.root_model


def form_change_lines(problem: Problem, form: Form) -> Iterator[str]:
    """Yield the lines on how form finding changed the geometry, or on the self-stress of the net."""
    model, settings = form_found_model(problem), problem.job.form_finding
    net, area = model.net, float(model.roof.area.sum())
    base = problem.build_up.base or model  # without errors of length
    if settings and settings.method != "force_density" and not problem.job.targets:
        yield from text.prestress_warnings(net, base.N, form.self_stress is not None)
    if form.self_stress is not None:
        yield text.self_stress_line(form.self_stress, net.group, net.group_names)
        return
    constant_tension = settings is not None and settings.method == "fpm" and settings.modulus_factor == 0.0
    yield from text.form_lines(net, model.x, model.area_given, area, constant_tension)
    yield from text.bar_length_warnings(net, model.x)
    if constant_tension:
        yield from text.undetermined_node_notes(net, model.x, model.N)


def start_warnings(problem: Problem) -> Iterator[str]:
    """Yield warnings of the state before the loads.

    netfall warns if the given net is not in equilibrium, and no computation corrects that before the loads.
    It also warns if an erected net has other loads than in its last stage, if cables slip in the form, and if
    the form of subdivided bars has their loads at their ends.
    """
    model, statics, erected = problem.root_model, has_statics(problem.job), bool(problem.job.stages)
    if problem.failure:
        return
    if problem.form and model.layout.slides and not erected:
        yield from form_slip_warnings(model, model.layout.slides)
    if statics and (erected or problem.form):
        return
    residual, force = problem.build_up.start_residual or (problem.residual, problem.reference)
    if problem.form and not erected:
        carries = problem.job.dynamics and carries_permanent(problem.job)
        moved_load = (model.loading.permanent - model.form_load)[model.net.moves]
        residual = float(lengths(moved_load).max(initial=0.0)) if carries else 0.0
    rounding = ROUNDING_STRAIN * float(model.net.EA.max(initial=0.0))
    if residual > max((FAR_OFF if statics or erected else MAX_RESIDUAL_START) * force, rounding):
        unbalanced_message = messages.NET_UNBALANCED if statics else messages.START_UNBALANCED
        yield unbalanced_message(residual=residual, force=force)


def stages(job: Job) -> list[str]:
    """Return the stages of the job in order, as text."""
    names = []
    if job.form_finding:
        names.append(f"form finding ({job.form_finding.method})")
    if job.targets:
        names.append(count_of(len(job.targets), "target"))
    if job.stages:
        names.append(f"erection ({count_of(len(job.stages), 'stage')})")
    counts = {"case": len(job.cases), "combination": len(job.combinations), "load step": load_steps(job)}
    if statics := [count_of(count, what) for what, count in counts.items() if count]:
        names.append(f"statics ({', '.join(statics)})")
    if name := final_equilibrium_name(job):
        names.append(name)
    if job.dynamics:
        names.append(f"dynamics ({job.dynamics.duration:g} s)")
    return names or ["none: only the net"]


def limit_line(limit: Limit, model: Model) -> str:
    """Return the line on a limit of the time step."""
    meaning = {
        "any_shape": "stable step, intact, in any shape",
        "slackening": "step for cables that become slack and taut again",
        "after_fracture": "stable step after any fracture",
        "slip": "step at which slip needs no more than 2 % of added inertia",
    }[limit.name]
    if limit.element < 0:
        return f"{meaning}: no limit"
    return f"{meaning}: {limit.dt:.4g} s, set by element {model.element_name(limit.element)}"


def net_remarks(job: Job, layout: Layout) -> list[str]:
    """Return the warnings on stages, and the remarks on the net as given."""
    return [*lost_load_warnings(job), *layout.notes]


def run_notes(problem: Problem) -> list[str]:
    """Return the warnings and notes that precede a run, for its result file; on rank 0."""
    model = problem.root_model
    remarks = [*start_warnings(problem), *(dynamic_remarks(problem) if problem.schedule else ())]
    marked = [line for line in remarks if not is_error(line)]
    return [*net_remarks(problem.job, model.layout), *model.start_notes, *marked]


def dynamic_remarks(problem: Problem) -> Iterator[str]:
    """Yield the warnings and notes on the wind, events beyond the end, the time step and the probes."""
    job, model = problem.job, problem.root_model
    yield from wind_warnings(job, model)
    yield from unfinished_warnings(job, model)
    yield from step_remarks(problem)
    yield from probe_remarks(model, job.output.probes)


def probe_remarks(model: Model, probes: list[Any]) -> Iterator[str]:
    """Yield remarks on probes far from all nodes, or at a point in plan with several nodes.

    A probe is far if its distance exceeds the length of the longest element. Probes given by ids have no
    remarks.
    probes : of the job
    """
    net = model.net
    ends = model.x[net.elements]
    longest = np.sqrt(np.sum((ends[:, 1] - ends[:, 0]) ** 2, axis=1)).max(initial=0.0)
    for probe, p in zip(probes, model.layout.probes.particles):
        if isinstance(probe, int):
            continue
        axes, name = len(probe), ", ".join(f"{value:g}" for value in probe)
        distance = np.linalg.norm(net.x[:, :axes] - np.array(probe), axis=1)
        offset = float(distance[p])
        equal = np.flatnonzero(distance <= offset + net.tolerance)
        if axes == 2 and len(equal) > 1 and np.ptp(net.x[equal, :2], axis=0).max() <= net.tolerance:
            nodes = format_list(net.node_id[equal])
            yield messages.AMBIGUOUS_PROBE(probe=name, nodes=nodes, node=net.node_id[p])
        if offset > longest:
            at = ", ".join(f"{value:.6g}" for value in net.x[p, :axes])
            yield messages.FAR_PROBE(probe=name, distance=offset, longest=longest, node=net.node_id[p], at=at)


def step_remarks(problem: Problem) -> Iterator[str]:
    """Yield remarks on added mass, slip inertia, damping in a band and a fixed time step."""
    job, model, settings = problem.job, problem.root_model, problem.dynamics
    dt = problem.dynamic_schedule.long_dt
    if (added := model.added) is not None:
        mass = model.mass_unscaled
        worst = int(np.argmax(added / np.where(mass > 0.0, mass, 1.0)))
        if (share := added.sum() / mass[model.net.moves].sum()) > MAX_ADDED_INERTIA:
            yield messages.MUCH_ADDED_INERTIA(share=share, limit=MAX_ADDED_INERTIA)
        yield (
            f"mass scaling: {added.sum():.4g} kg of inertia added at {int((added > 0.0).sum())} of "
            f"{len(added)} particles, {share:.2%} of the moving mass"
            f"; at most {added[worst] / mass[worst]:.2g} times a particle's own "
            f"(node {model.net.node_id[worst]})"
        )
    if slides := model.layout.slides:
        yield inertia_line(model, slides, dt)
    if settings.axial_damping_ratio:
        added_stiffness = branch_stiffening(damping_branches(job)) - 1.0
        ratio = settings.axial_damping_ratio
        yield messages.BAND_STIFFNESS(ratio=ratio, share=added_stiffness)
    end = step_at(settings.duration, dt) * dt
    if end > (1.0 + MAX_OVERRUN) * settings.duration:
        yield messages.DURATION_EXTENDED(dt=dt, duration=settings.duration, end=end)
    limit = problem.limits["slackening"]
    if settings.time_step != "auto" and settings.time_step > limit.dt:
        element, length = model.net.element_id[limit.element], model.L0[limit.element]
        yield messages.STEP_ABOVE_SLACK_LIMIT(
            time_step=settings.time_step, limit=limit.dt, element=element, length=length
        )
