"""What `netfall check` tells of a job before it is run: sizes, step limits, memory, expected run time."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from netfall.ground.room import RANK_BYTES, SETUP_BYTES
from netfall.ground.timings import Phases
from netfall.job.asks import along_normals, has_statics, load_steps
from netfall.job.job import Job
from netfall.job.memory import Memory
from netfall.mechanics.fields import FIELDS
from netfall.messages import run
from netfall.messages.wind import wind_lines
from netfall.model.layout import Layout, make_layout
from netfall.model.schedule import steps_line
from netfall.net.build import build_net
from netfall.parallel.mpi import MPI
from netfall.program.ranks import ranks_line, steps_time
from netfall.program.setup import prepare
from netfall.roof.areas import GIVEN_AREAS, areas_are_given, largest_face, normals
from netfall.stages.modes import mode_lines
from netfall.stages.scene import Scene
from netfall.stages.wanted import equilibria, loaded
from netfall.wind.sectors import bearing
from netfall.write.h5 import CHUNK_BYTES
from netfall.write.locks import writing

ROW_S, FRAME_S = 3e-5, 7e-4  # of a row of the history, of a frame
CHECKPOINT_S, SAVED_S = 0.026, 4e-6  # of a checkpoint, and of each element in it
EQUILIBRIUM_S = 1e-4  # for each element of a small net: slack and compression take more or less
FEWEST = 2000  # particles of a larger net, whose equilibria take other times
STAGE_S, TRIALS = 2.5e-4, 8  # the same of a stage of erection; equilibria until targets are reached, about
NEAR_S, FAR_S = 4.5e-6, 4e-5  # the same of a larger net, whose tangent foresees it, or does not (jobs/bench)
RELAXED = "; a stage whose nodes hang far from where they are held taut is relaxed, for seconds"
UNFORESEEN = "; what the tangent does not foresee takes from a third to five times as long, more if relaxed"
NOT_BORNE = 5  # times as long, until it is told how much of a load is borne
START_S, NET_S = 0.8, 3e-4  # until Python, MPI and what they load stand; of net and form, for each element
LARGEST_FORM = 400_000  # elements up to which check also finds the form, in some ten seconds
# Bytes of the result file for each particle and element: of a state in motion, of how they are joined, which
# is written anew where some broke since the state before, of an equilibrium, of what stands there once.
FRAME_BYTES, JOINED_BYTES = (24 + 12 + 12, 4 + 4 + 4 + 1), (8 + 8, 16 + 8 + 1 + 8 + 8 + 4)
STATE_BYTES, ONCE_BYTES = (24 + 24, 8), (190, 150)
ROW_BYTES, FILE_BYTES = 8 * 15, 2e5  # of a row of the history; of names and what is small
MUCH_LARGER = 4.0  # times the usual face of the roof: it may be an opening
EQUILIBRIUM_BYTES = 950  # per element: the tangent and its levels on its own rank, what is written on rank 0


def check_job(job: Job, say: Callable[[str], None], folder: Path | None = None) -> None:
    """Validate a job and describe it. Raises InputError for what is wrong in it.

    folder : for a picture of the net, which is there even where no form is found; None: no picture
    """
    for line in _lines(job, folder):
        say(line)


def _lines(job: Job, folder: Path | None) -> Iterator[str]:
    """What `check_job` says, as it is found."""
    short = job
    if job.form_finding and build_net(job).m > LARGEST_FORM:
        yield (
            f"note: more than {LARGEST_FORM} elements: the form is not found here; "
            "figures are those of the start geometry"
        )
        short = replace(job, form_finding=None)
    memory = Memory(1)
    if folder:
        yield f"picture: {draw_check(job, make_layout(short, 1, memory), folder)}"
    scene = prepare(MPI.COMM_SELF, short, Phases(), memory=memory)[0]
    if scene.failure:
        raise scene.failure
    model = scene.model
    yield f"{job.path}: {job.title or job.name}: valid"
    yield from _of_net(scene)
    if scene.form:
        yield from (run.form_line(scene), *run.moved_lines(scene))
    yield from run.start_notes(scene)
    yield "stages: " + ", ".join(run.stages(job))
    yield f"the scene has: {run.feature_words(job, model)}"
    yield from wind_lines(job, model)
    if scene.schedule:
        yield from (run.limit_line(limit, model) for limit in scene.limits.values())
        yield f"steps: {steps_line(scene.schedule)}" + " (auto)" * (job.dynamics.time_step == "auto")
        yield from run.remarks_of(scene)
    yield from (time_line(scene), ranks_line(scene), memory_line(scene))
    yield from mode_lines(short, scene)


def _of_net(scene: Scene) -> Iterator[str]:
    """What the net is."""
    model, net = scene.model, scene.model.net
    groups = (f"{name or '(none)'} {int((net.group == g).sum())}" for g, name in enumerate(net.group_names))
    yield f"{run.net_line(model)} in groups {', '.join(groups)}"
    L0, N = model.L0, model.N
    yield (
        f"elements: unstressed length {L0.min():.4g} to {L0.max():.4g} m, {L0.sum():.6g} m in all; "
        f"tension {N.min():.4g} to {N.max():.4g} N"
    )
    own = float((net.density * net.section * L0).sum())
    yield f"masses: elements {own:.4g} kg, all particles {model.mass.sum():.4g} kg"
    covered = model.layout.roofing.covered
    source = f"closed faces cover {covered:.1%} of the net's outline in plan (its convex hull)"
    yield (
        f"roof: {model.roof.area.sum():.1f} m2 of surface, {model.roof.plan_area.sum():.1f} m2 in plan; "
        + (GIVEN_AREAS if areas_are_given(net) else source)
    )
    found = largest_face(model.x, net, model.layout.roofing.faces)
    if found and found[0] > MUCH_LARGER * found[1]:
        area, usual, (x, y) = found
        yield (
            f"largest face: {area:.4g} m2 in plan around [{x:.4g}, {y:.4g}], the usual one has {usual:.4g} "
            f"m2; if it is an opening, leave it out with [roof] openings = [[{x:.4g}, {y:.4g}]]"
        )
    yield from run.job_remarks(model, scene.job)


def time_line(scene: Scene) -> str:
    """What a run takes on one core, by its parts."""
    job, schedule, m = scene.job, scene.schedule, scene.model.net.m
    parts, more = {"start, net and form": START_S + NET_S * m}, ""
    if job.stages or job.targets:
        parts["erection"] = STAGE_S * m * (len(job.stages) + TRIALS * bool(job.targets))
        more = RELAXED
    if has_statics(job):
        parts["equilibria"], unknown = equilibria_time(scene)
        more += unknown
    if schedule:
        parts["steps"] = steps_time(scene)
        parts["output"] = ROW_S * len(schedule.history) + FRAME_S * len(schedule.frames)
        if len(schedule.checkpoints):
            parts["checkpoints"] = len(schedule.checkpoints) * (CHECKPOINT_S + SAVED_S * m)
    total, of_parts = sum(parts.values()), ", ".join(f"{name} {each:.2g} s" for name, each in parts.items())
    return (
        f"expected run time about {total:.2g} s on one core ({of_parts}); modes, and compiling at the first "
        f"run of its kind, come on top{more}"
    )


def equilibria_time(scene: Scene) -> tuple[float, str]:
    """What equilibria take on one core [s], and what of that is not known. Collective.

    Of a larger net by whether the tangent foresees the last of them, from where the net is, and the first.
    """
    job, m, wanted = scene.job, scene.distribution.m, equilibria(scene)
    count = len(wanted) + len(job.removes) * bool(job.dynamics)  # with the rest after each loss
    if scene.distribution.n < FEWEST:
        return EQUILIBRIUM_S * m * count, ""
    if job.form_finding and scene.form is None:
        return NEAR_S * m * count, "; what goes slack or yields takes up to ten times as long at rest"
    foreseen = lambda want: scene.finder.foresees(loaded(scene, want).load)
    if foreseen(wanted[-1]):
        return NEAR_S * m * count, ""
    near = sum(each.kind == "permanent" for each, _ in wanted) if foreseen(wanted[0]) else 0
    limits = scene.state.features.plastic or scene.state.features.fracture
    more = f"; where a load is not borne, up to {NOT_BORNE} times its equilibrium" if limits else ""
    return m * (NEAR_S * near + FAR_S * (count - near)), UNFORESEEN + more


def memory_line(scene: Scene) -> str:
    """What a run takes of memory and disk."""
    m, state = scene.model.net.m, scene.state
    held = sum(getattr(state, f.name).nbytes for f in FIELDS if getattr(state, f.name) is not None)
    least, anew = result_bytes(scene)
    up_to = f", up to {(least + anew) / 1e6:.3g} MB where elements break until the end" if anew else ""
    more = f"{EQUILIBRIUM_BYTES * m / 1e6:.3g} MB for its equilibria, " if has_statics(scene.job) else ""
    return (
        f"memory: {held / 1e6:.3g} MB for the state ({held / m:.0f} bytes an element), {more}and some "
        f"{SETUP_BYTES * m / 1e6:.3g} MB on rank 0 at set-up, beside some {RANK_BYTES / 1e6:.0f} MB for "
        f"Python on each rank; result file about {least / 1e6:.3g} MB{up_to}"
    )


def result_bytes(scene: Scene) -> tuple[float, float]:
    """Size of the result file where nothing breaks, and what it has more where some break in every frame."""
    job, model, net = scene.job, scene.model, scene.model.net
    size = lambda each: float(net.n * each[0] + net.m * each[1])
    least = FILE_BYTES + size(ONCE_BYTES) + len(equilibria(scene)) * size(STATE_BYTES)
    least += CHUNK_BYTES if load_steps(job) else 0
    frames = job.output.frames if scene.schedule else 0
    least += size(JOINED_BYTES) + (frames + 1) * size(FRAME_BYTES)
    if scene.schedule:
        probes, field = model.layout.probes, model.wind_field
        row = ROW_BYTES + 24 * len(probes.particles) + 8 * (len(probes.elements) + len(probes.named))
        least += row * len(scene.schedule.history)
        if field is not None and field.model is not None:
            least += 8 * (1 + len(field.control_point)) * job.dynamics.duration / job.wind.time_step
    return least, frames * size(JOINED_BYTES) if scene.state.features.fracture else 0.0


def draw_check(job: Job, layout: Layout, folder: Path) -> Path:
    """Write NAME_net.png into a folder, from the net before its form is found; the path of it."""
    from netfall.plots.job import JobNet, draw_job

    net, zones, given, probes = layout.net, layout.zones, layout.roofing.given, layout.probes
    areas = [(given.plan * share).sum() for share in zones.share.T]
    polygons = [zone.polygon for zone in job.zones if zone.polygon is not None]
    normal = normals(net, given.vector) if along_normals(job) else None
    lost = np.unique(np.concatenate([np.zeros(0, np.int64), *layout.lost]))
    of_net = job.title or job.name, net, layout.roofing.faces, given.plan
    of_zones = zones.names, zones.of_node, np.array(areas), polygons
    followed = np.unique(probes.named), np.unique(probes.particles)
    shown = JobNet(*of_net, *of_zones, normal, lost, *followed, _wind_of(job))
    path = folder / f"{job.path.stem}_net.png"
    with writing(path):
        folder.mkdir(parents=True, exist_ok=True)
        draw_job(shown, path)
    return path


def _wind_of(job: Job) -> tuple[float, str] | None:
    """Where the wind of a job blows to [degrees], and what it is; None: there is none, or taps say all."""
    wind = job.wind
    if wind is None or wind.pressures is not None:
        return None
    what = f"wind of {wind.speed:g} m/s" if wind.speed else f"wind of {wind.file}"
    return wind.direction, f"{what} {bearing(wind.direction)}"
