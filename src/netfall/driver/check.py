"""Report of `netfall check` on a job before it runs: sizes, step limits, memory, expected run time."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from netfall.core.launch import RANK_BYTES, SETUP_BYTES
from netfall.core.messages import is_note, is_warning, kN, say_counted
from netfall.core.timings import PhaseTimes
from netfall.driver import messages
from netfall.driver.modes import mode_lines
from netfall.driver.problem import Problem, equilibria
from netfall.driver.reporting import run
from netfall.driver.reporting.wind import slender_loads, wind_lines
from netfall.driver.setup import prepare_problem
from netfall.geometry import messages as geometry_messages
from netfall.geometry.areas import areas_are_given, largest_face, outer_side_line
from netfall.job.csv_table import zone_values
from netfall.job.derived import has_statics, load_steps
from netfall.job.job import Job
from netfall.job.keys.entries import apply_settings
from netfall.job.keys.models import Load
from netfall.loads.loads import dead_load, live_load
from netfall.model.actions import pressure_table_forces
from netfall.model.layout import Layout
from netfall.model.schedule import describe_steps
from netfall.parallel.mpi import MPI
from netfall.physics.fields import FIELDS, Features
from netfall.results.h5 import CHUNK_BYTES

# Times on one core; those of large nets are from jobs/bench.
STEP_NS, STEP_US = 5.0, 1.0  # per element and step; per step (long rows of elements less, fractures more)
ROW_S, FRAME_S = 3e-5, 7e-4  # per history row; per snapshot
CHECKPOINT_S, CHECKPOINT_ELEMENT_S = 0.026, 4e-6  # per checkpoint; per element in it
EQUILIBRIUM_S = 1e-4  # per equilibrium and element of a small net; varies with slack and compression
MIN_LARGE_NET = 2000  # number of particles from which a net counts as large
STAGE_S, TARGET_EQUILIBRIA = 2.5e-4, 8  # per stage of erection and element; equilibria until targets are met
LARGE_NET_EQUILIBRIUM_S = 4.5e-6  # the same of a large net whose equilibrium the tangent predicts
RELAXED = "; a stage whose nodes hang far below their taut positions needs relaxation, which takes seconds"
LARGE_NET = "; slack or yielding nets take up to ten times as long"
START_S, NET_S = 0.8, 3e-4  # s to start Python and MPI; s per element for net and form
# Bytes of the result file per particle and per element: of a snapshot; of the connectivity, which a snapshot
# contains only if elements broke since the last one; of an equilibrium; of datasets that are written once.
FRAME_BYTES, CONNECTIVITY_BYTES = (24 + 12 + 12, 4 + 4 + 4 + 1), (8 + 8, 16 + 8 + 1 + 8 + 8 + 4)
STATE_BYTES, STATIC_DATA_BYTES = (24 + 24, 8), (190, 150)
ROW_BYTES, FILE_BYTES = 8 * 15, 2e5  # per history row; HDF5 metadata and small datasets
HISTORY_COPIES = 3.5  # of the history rows in the memory of rank 0, which joins and writes them at the end
OPENING_AREA_RATIO = 4.0  # area relative to the usual face of the roof: a larger face may be an opening
NEGLIGIBLE = 1e-12  # share of the largest component of a sum of forces that counts as none
EQUILIBRIUM_BYTES = 950  # memory per element: tangent and multigrid levels, and output on rank 0


def check_job(job: Job, say: Callable[[str], None], folder: Path | None = None) -> None:
    """Validate a job and describe it, with the number of warnings at the end.

    Raises InputError for errors in the job.

    folder : for a picture of the net, drawn even if no form is found; None: no picture
    """
    say_counted(partial(_check, job, folder), say)


def check_values(job: Job, lines: list[str], folder: Path | None = None) -> dict[str, Any]:
    """Validate a job and return the output of `check_job` as values in SI units, for netfall check --json.

    lines : receives the lines that `check_job` prints, even before an error
    """
    problem = _check(job, folder, lines.append)
    model, net, form = problem.root_model, problem.root_model.net, problem.form
    state_bytes, (least_bytes, _) = _state_bytes(problem), result_bytes(problem)
    values: dict[str, Any] = {
        "job": str(job.path),
        "title": job.title,
        "valid": True,
        "errors": [],
        "warnings": [*filter(is_warning, lines)],
        "notes": [*filter(is_note, lines)],
        "stages": run.stages(job),
        "particles": net.n,
        "elements": net.m,
        "groups": {name: (net.group == g).sum() for g, name in enumerate(net.group_names)},
        "unstressed_length": model.cut_length.sum(),
        "mass": model.mass.sum(),
        "roof_area": model.roof.area.sum(),
        "plan_area": model.roof.plan_area.sum(),
        "tension_min": _start_tension(problem).min(),
        "tension_max": _start_tension(problem).max(),
        "form_finding": form and {"iterations": form.iterations, "residual": form.residual},
        "load_tables": [
            {"place": place, "table": name, "resultant": resultant.tolist()}
            for place, name, resultant in _resultants(problem)
        ],
        "slender_loads": [
            {"load": text, "resultant": resultant.tolist()} for text, resultant in slender_loads(job, model)
        ],
        "expected_seconds": run_time_parts(problem)[0],
        "state_bytes": state_bytes,
        "result_bytes": least_bytes,
    }
    if problem.schedule:
        values["steps"] = {"number": problem.schedule.steps, "time_step": problem.schedule.dt}
        values["step_limits"] = {
            each.name: {"dt": each.dt, "element": net.element_id[each.element] if each.element >= 0 else None}
            for each in problem.limits.values()
        }
    return values


def _check(job: Job, folder: Path | None, say: Callable[[str], None]) -> Problem:
    """Check a job, print the lines of `check_job` as they are computed, and return the problem."""

    def describe(layout: Layout | None, _: Features) -> None:
        assert layout is not None  # one rank
        if folder:
            say(f"picture: {plot_job_net(job, layout, folder)}")
        for line in run.net_remarks(job, layout):
            say(line)

    problem = prepare_problem(MPI.COMM_SELF, job, PhaseTimes(), describe=describe)[0]
    if problem.failure:
        raise problem.failure
    for line in _check_lines(job, problem):
        say(line)
    return problem


def _check_lines(job: Job, problem: Problem) -> Iterator[str]:
    """Yield the lines of `check_job` after the remarks on the net."""
    model = problem.root_model
    yield f"{job.path}: {job.title or job.name}: valid"
    yield from _net_lines(problem)
    if problem.form:
        yield from (run.form_line(problem, problem.form), *run.form_change_lines(problem, problem.form))
    yield from run.start_warnings(problem)
    yield "stages: " + ", ".join(run.stages(job))
    yield from wind_lines(job, model)
    if problem.schedule:
        yield from (run.limit_line(limit, model) for limit in problem.limits.values())
        is_auto = problem.dynamics.time_step == "auto"
        yield f"steps: {describe_steps(problem.schedule)}" + " (auto)" * is_auto
        yield from run.dynamic_remarks(problem)
    parts, remark = run_time_parts(problem)
    listed = ", ".join(f"{name} {seconds:.2g} s" for name, seconds in parts.items())
    yield (
        f"expected run time about {sum(parts.values()):.2g} s on one core ({listed}), plus modes, and "
        f"compilation in the first run{remark}"
    )
    yield memory_line(problem)
    yield from mode_lines(job, problem)


def _net_lines(problem: Problem) -> Iterator[str]:
    """Yield lines on the net, its masses and its roof."""
    model, net = problem.root_model, problem.root_model.net
    groups = (f"{name or '(none)'} {int((net.group == g).sum())}" for g, name in enumerate(net.group_names))
    yield f"{run.net_line(net)} in groups {', '.join(groups)}"
    L0, N = model.cut_length, _start_tension(problem)  # at the temperature of form finding
    yield (
        f"elements: unstressed length {L0.min():.4g} to {L0.max():.4g} m, {L0.sum():.6g} m in all; "
        f"tension {kN(N.min(), N.max())}"
    )
    element_mass = float((net.density * net.section * L0).sum())
    yield f"masses: elements {element_mass:.4g} kg, all particles {model.mass.sum():.4g} kg"
    covered = model.layout.roofing.covered_share
    source = f"closed faces cover {covered:.1%} of the net's outline in plan (its convex hull)"
    yield (
        f"roof: {model.roof.area.sum():.1f} m2 of surface, {model.roof.plan_area.sum():.1f} m2 in plan; "
        + (geometry_messages.GIVEN_AREAS.text if areas_are_given(net) else source)
    )
    parts = model.roof.parts
    shares = zip(parts.zones.names, parts.zones.share.T)  # the last column is outside all zones
    zones = [f"{name} {part @ parts.area:.1f} and {part @ parts.plan_area:.1f} m2" for name, part in shares]
    if zones:
        yield f"zones, of surface and in plan: {', '.join(zones)}"
    if net.roof_axes is not None:
        yield outer_side_line(model.roof.vector)
    roof = problem.job.roof
    face = largest_face(net, model.layout.roofing.faces)
    if face and face[0] > OPENING_AREA_RATIO * face[1] and not (roof and roof.faces):
        area, usual, (x, y) = face
        yield messages.LARGE_FACE(area=area, usual=usual, x=x, y=y)
    sums = [(f"load table {name} of {place}", force) for place, name, force in _resultants(problem)]
    slender = slender_loads(problem.job, model)
    for text, resultant in sums + [(f"{text} on elements with a diameter", force) for text, force in slender]:
        rounded = np.where(np.abs(resultant) > NEGLIGIBLE * np.abs(resultant).max(), 1e-3 * resultant, 0.0)
        components = ", ".join(f"{component:.4g}" for component in rounded)
        yield f"{text}: resultant {components} kN along x, y, z"
    yield from model.start_notes


def _start_tension(problem: Problem) -> np.ndarray:
    """Return the axial forces [N] of the form, or of the elements present in the last stage."""
    stages = [g for name, g in problem.build_up.sections.items() if name.startswith("stages/")]
    return stages[-1]["tension"][stages[-1]["active"] == 1] if stages else problem.root_model.N


def _resultants(problem: Problem) -> Iterator[tuple[str, str, np.ndarray]]:
    """Yield each table of loads: its place in the job, its path, and the sum (3,) [N] of its loads."""
    job, model = problem.job, problem.root_model
    if model.net.load.any():
        yield "[net]", str(job.net.nodes), model.net.load.sum(0)
    for place, name in job.load_tables():
        loads = model.layout.load_tables.get(name)
        if loads is not None:
            force = model.forces_of(loads)
        else:
            load = apply_settings(Load(self_weight=False), "load", zone_values(job.path.parent / name, {}))
            force = live_load(load, model.roof, np.zeros_like(model.x)) + dead_load(load, model.roof)
        yield place, name, force.sum(0)
    for case in job.cases:
        if case.pressure_table is not None:
            yield f"[[case]] {case.name}", case.pressure_table, pressure_table_forces(model, case).sum(0)


def run_time_parts(problem: Problem) -> tuple[dict[str, float], str]:
    """Estimate the run time on one core [s] by its parts, and return a remark on it."""
    job, schedule, m = problem.job, problem.schedule, problem.root_model.net.m
    parts, remark = {"start, net and form": START_S + NET_S * m}, ""
    if job.stages or job.targets:
        parts["erection"] = STAGE_S * m * (len(job.stages) + TARGET_EQUILIBRIA * bool(job.targets))
        remark = RELAXED
    if has_statics(job):
        is_large = problem.distribution.n >= MIN_LARGE_NET
        count = len(equilibria(problem)) + len(job.removes) * bool(job.dynamics)  # one after each removal
        parts["equilibria"] = (LARGE_NET_EQUILIBRIUM_S if is_large else EQUILIBRIUM_S) * m * count
        remark += LARGE_NET if is_large else ""
    if schedule:
        steps = schedule.steps // schedule.stride
        parts["steps"] = steps * (problem.distribution.m * STEP_NS * 1e-9 + STEP_US * 1e-6)
        parts["output"] = ROW_S * len(schedule.history) + FRAME_S * len(schedule.frames)
        if len(schedule.checkpoints):
            parts["checkpoints"] = len(schedule.checkpoints) * (CHECKPOINT_S + CHECKPOINT_ELEMENT_S * m)
    return parts, remark


def _state_bytes(problem: Problem) -> int:
    """Return the memory of the state."""
    arrays = [getattr(problem.state, field.name) for field in FIELDS]
    return sum(array.nbytes for array in arrays if array is not None)


def memory_line(problem: Problem) -> str:
    """Return a line on the memory and disk space of a run."""
    m, size = problem.root_model.net.m, _state_bytes(problem)
    least, extra = result_bytes(problem)
    up_to = f", up to {(least + extra) / 1e6:.3g} MB if elements break until the end" if extra else ""
    more = f"{EQUILIBRIUM_BYTES * m / 1e6:.3g} MB for its equilibria, " if has_statics(problem.job) else ""
    if problem.schedule:
        more += f"{HISTORY_COPIES * history_bytes(problem) / 1e6:.3g} MB on rank 0 for history rows, "
    return (
        f"memory: {size / 1e6:.3g} MB for the state ({size / m:.0f} bytes per element), {more}some "
        f"{SETUP_BYTES * m / 1e6:.3g} MB on rank 0 at set-up, and some {RANK_BYTES / 1e6:.0f} MB for "
        f"Python on each rank; result file about {least / 1e6:.3g} MB{up_to}"
    )


def history_bytes(problem: Problem) -> float:
    """Return the size of /history with slips, whose rows rank 0 keeps until the end of a run."""
    probes, slides = problem.root_model.layout.probes, problem.root_model.layout.slides
    row = ROW_BYTES + 24 * len(probes.particles) + 8 * (len(probes.elements) + len(probes.named))
    row += 16 * len(slides.node) if slides else 0
    return float(row * len(problem.schedule.history)) if problem.schedule else 0.0


def result_bytes(problem: Problem) -> tuple[float, float]:
    """Estimate the size of the result file without fractures, and the increase due to fractures.

    The increase assumes that elements break before every frame.
    """
    job, model, net = problem.job, problem.root_model, problem.root_model.net

    def size(entity_bytes: tuple[int, int]) -> float:
        of_particle, of_element = entity_bytes
        return float(net.n * of_particle + net.m * of_element)

    least = FILE_BYTES + size(STATIC_DATA_BYTES) + len(equilibria(problem)) * size(STATE_BYTES)
    least += CHUNK_BYTES if load_steps(job) else 0
    frames = job.output.frames if problem.schedule else 0
    least += size(CONNECTIVITY_BYTES) + (frames + 1) * size(FRAME_BYTES)
    if problem.schedule:
        field = model.wind_field
        least += history_bytes(problem)
        if job.wind is not None and field is not None and field.model is not None:
            least += 8 * (1 + len(field.control_point)) * problem.dynamics.duration / job.wind.time_step
    features = problem.state.features
    extra = size(CONNECTIVITY_BYTES)
    if features.fragments:  # of each element a particle
        extra += net.m * (FRAME_BYTES[0] + CONNECTIVITY_BYTES[0])
    return least, frames * extra if features.fracture else 0.0


def plot_job_net(job: Job, layout: Layout, folder: Path) -> Path:
    """Write NAME_net.png into a folder, with the net before form finding, and return its path."""
    from netfall.post.plots.job import draw_job

    path = folder / f"{job.path.stem}_net.png"
    draw_job(job, layout, path)
    return path
