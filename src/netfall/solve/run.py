"""A whole job: form finding, statics, dynamics, one result file. The program in the order in which it runs."""

import os
import platform
from pathlib import Path

import h5py
import mpi4py
import numba
import numpy as np
from mpi4py import MPI

import netfall
from netfall.errors import DivergedError, InputError, Interrupted, OutputError
from netfall.job.read import Job
from netfall.net.net import Net
from netfall.output.h5 import PARALLEL
from netfall.output.place import claim, release
from netfall.output.progress import Progress
from netfall.output.result import Result, net_section
from netfall.parallel import partition
from netfall.parallel.root import on_root
from netfall.solve.dynamics import Probes, Schedule, Simulation, find_probes, make_schedule, probe_remarks
from netfall.solve.energy import take_snapshot, total_energies
from netfall.solve.relax import Paused
from netfall.solve.restart import (
    Saver,
    interrupted,
    restore_relaxation,
    restore_result,
    restore_state,
    restore_wind,
)
from netfall.solve.roof import Phases, Roof, Whole, governing, prepare
from netfall.solve.statics import StaticPath, find_equilibrium
from netfall.solve.stop import NEVER, StopRequest
from netfall.solve.windload import WindLoad

HALF_DIGIT = 2.0**-25  # of a single-precision number just below 1: what is less is lost when added to it
MOST_STEPS = 1e12  # weeks for the smallest net


def how_it_writes() -> str:
    """Which of the two stacks is in use."""
    library = MPI.Get_library_version().split(",")[0].split("\n")[0].strip()
    return f"{library}, " + (
        "parallel HDF5 (MPI-IO)" if PARALLEL else "serial HDF5 (rank 0 gathers and writes)"
    )


def run_job(
    comm: MPI.Comm,
    job: Job,
    path: Path,
    progress: Progress,
    restart: Path | None = None,
    stop: StopRequest = NEVER,
    profile: bool = False,
) -> None:
    """Run the stages that the job has and write the result file. Collective.

    restart : a checkpoint to go on from; stop : a wish to stop early; profile : time the parts of a step too

    Raises InputError before anything is computed or written, DivergedError where a stage has no solution,
    Interrupted after a checkpoint if `stop` asks for it.
    """
    phases = Phases(profile)
    claimed = on_root(comm, lambda: (check_place(path), claim(path))[1])
    try:
        _run_job(comm, job, path, progress, phases, restart, stop)
    finally:
        if claimed:
            release(claimed)


def _run_job(comm, job, path, progress, phases, restart, stop):
    progress.say(
        f"netfall {netfall.__version__}: {job.title or job.name}, {comm.size} rank{'s' if comm.size > 1 else ''}, {how_it_writes()}"
    )
    roof = prepare(
        comm,
        job,
        phases,
        lambda i, r: progress.detail(f"form finding: iteration {i}, largest residual {r:.3g} N"),
        path,
        restart,
        stop,
    )
    schedule = on_root(comm, lambda: schedule_of(job, roof)) if job.dynamics else None
    schedule = comm.bcast(schedule)
    describe(job, roof, schedule, progress)
    saver = Saver(comm, job, roof, restart)
    result = Result(
        comm,
        path,
        roof.distribution,
        roof.distribution.elements(roof.whole.net.group if roof.whole else None),
    )
    try:
        if restart:
            progress.say(f"going on from {restart}")
        record = take_up(comm, roof, result, saver)
        if roof.stage != "dynamics":
            saver.statics = run_statics(comm, job, roof, result, progress, phases, saver, stop)
        probes = run_dynamics(comm, job, roof, result, schedule, progress, phases, stop, saver, record)
        sections = sections_of(job, roof, saver.statics, result, probes)
        result.close(sections, provenance_of(comm, job, roof, schedule), phases.over_ranks(comm))
    except (InputError, DivergedError, Interrupted) as error:  # raised on every rank alike
        result.file.discard_all()
        raise saver.naming_the_last(error) if isinstance(error, DivergedError) else error
    except OutputError as error:
        result.file.discard()
        raise saver.naming_the_last(error)
    except BaseException:
        result.file.discard()
        raise
    progress.end()
    finish(result, path, phases, progress)


def take_up(comm: MPI.Comm, roof: Roof, result: Result, saver: Saver) -> dict | None:
    """State, results and statics of the run that is taken up, and its record; None for one that has no state yet. Collective."""
    if roof.stage not in ("statics", "dynamics"):
        return None
    restore_result(comm, result, roof.checkpoint, roof.digest)
    restore_state(roof.distribution, roof.state, roof.checkpoint)
    record = comm.bcast(roof.checkpoint and roof.checkpoint.record)
    saver.statics = StaticPath(**record["statics"]) if record["statics"] else None
    return record


def check_place(path: Path) -> None:
    """Refuse a result file that could not be written at the end. Raises InputError."""
    folder = path.parent
    if not folder.is_dir():
        raise InputError(
            f"{path}: the folder {folder} does not exist; make it, or give another place with -o"
        )
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the name of a file with -o")
    if not os.access(folder, os.W_OK):
        raise InputError(
            f"{path}: the folder {folder.resolve()} cannot be written to; give another place with -o"
        )
    if path.exists():
        _check_replaceable(path)


def _check_replaceable(path: Path) -> None:
    """Refuse to write over what is no result of netfall, or is open elsewhere. (An old result is replaced, once the new one is whole.)"""
    try:
        with h5py.File(path, "r") as file:
            ours = "provenance" in file
    except BlockingIOError:
        raise InputError(
            f"{path}: another program has it open for writing; close it there, or give another name with -o"
        ) from None
    except OSError:
        ours = False
    if not ours:
        raise InputError(
            f"{path}: exists and is no result of netfall; move it away, or give another name with -o"
        )


def schedule_of(job: Job, roof: Roof) -> Schedule:
    """The steps of the dynamic stage. Raises InputError for a fixed step that is not stable. Rank 0."""
    automatic = job.dynamics.time_step == "auto"
    limit = governing(roof.limits, automatic)
    net = roof.whole.net
    if not automatic and job.dynamics.time_step > limit.dt:
        refuse_step(job, limit, roof, net)
    if not automatic and job.dynamics.time_step > job.dynamics.duration:
        raise InputError(
            f"{job.path}: [dynamics] time_step = {job.dynamics.time_step:g}: longer than duration = "
            f"{job.dynamics.duration:g} s; expected at most that"
        )
    if not np.isfinite(limit.dt):
        raise InputError(f"{job.path}: [dynamics]: no particle of the net can move; free a node")
    dt = job.dynamics.safety * limit.dt if automatic else job.dynamics.time_step
    if job.dynamics.duration / dt > MOST_STEPS:
        raise InputError(
            f"{job.path}: [dynamics] duration = {job.dynamics.duration:g}: asks for {job.dynamics.duration / dt:.3g} steps of {dt:.3g} s; "
            f"at most {MOST_STEPS:.0e} are possible"
        )
    return make_schedule(limit.dt, job.dynamics, job.output)


def refuse_step(job: Job, limit, roof: Roof, net: Net) -> None:
    """Raise InputError unless the step is below the sharp limit and nothing can break."""
    if limit.name == "any_shape":
        limit = roof.limits["assembled"]
        if job.dynamics.time_step <= limit.dt:
            return
    ids = "-".join(str(net.node_id[p]) for p in net.elements[limit.element])
    why = {
        "assembled": "of the intact net",
        "any_shape": "of the net in any shape",
        "after_fracture": "of the fragments that a fracture leaves",
    }[limit.name]
    more = " (or a larger [dynamics] fragment_mass)" if limit.name == "after_fracture" else ""
    raise InputError(
        f"{job.path}: [dynamics] time_step = {job.dynamics.time_step:g}: above the stable step {limit.dt:.4g} s {why}, set by element "
        f'{net.element_id[limit.element]} (nodes {ids}, {roof.whole.L0[limit.element]:.3g} m); expected less, or "auto"; '
        f"longer elements there would allow more{more}"
    )


def run_statics(
    comm,
    job: Job,
    roof: Roof,
    result: Result,
    progress: Progress,
    phases: Phases,
    saver: Saver,
    stop: StopRequest,
) -> StaticPath | None:
    """The static stage, if the job has it, from where an earlier run was interrupted in it."""
    if job.load is None or job.load.steps == 0:
        return None
    progress.say(f"statics: {job.load.steps} load steps")
    resume = restore_relaxation(roof.distribution, roof.checkpoint) if roof.stage == "statics" else None
    with phases.phase("statics"):
        try:
            path = find_equilibrium(
                comm, roof.state, job.load, roof.halo, result, progress, stop, saver.statics, resume
            )
        except Paused as pause:
            raise interrupted(
                f"in statics, load step {len(pause.path.load_factor) + 1}", saver.pause_statics(result, pause)
            ) from None
    progress.say(
        f"statics: in equilibrium, largest residual {path.residual[-1]:.3g} N, slack {path.slack[-1]} of {roof.distribution.m}"
    )
    return path


def run_dynamics(
    comm,
    job: Job,
    roof: Roof,
    result: Result,
    schedule: Schedule | None,
    progress: Progress,
    phases: Phases,
    stop: StopRequest,
    saver: Saver,
    record: dict | None,
) -> Probes | None:
    """The dynamic stage if the job has it, else one frame of the state that was reached.

    record : of the run that is taken up
    """
    state = roof.state
    record = record if roof.stage == "dynamics" else None
    if job.dynamics is None:
        snapshot = take_snapshot(state, 0.0, 1.0, 0.0, 0.0)
        result.write_frame(0.0, state, snapshot)
        result.write_final(state, snapshot)
        return None
    with phases.phase("wind"):
        wind = None
        if job.wind:
            wind = WindLoad(
                comm,
                roof.distribution,
                state,
                roof.whole and roof.whole.field,
                roof.whole and roof.whole.history,
            )
            if record:
                restore_wind(comm, wind, state, roof.checkpoint)
    if record:
        begun = record["simulation"]["start_strain"], record["simulation"]["start_plastic"]
    else:
        state.count_displacements()
        start = total_energies(comm, state, take_snapshot(state, 0.0, 1.0, 0.0, 0.0))
        begun = start.strain, start.plastic
    probes = comm.bcast(find_probes(roof.whole.net, job.output.probes) if roof.whole else None)
    progress.say(f"dynamics: {job.dynamics.duration:g} s in {schedule.steps} steps of {schedule.dt:.4g} s")
    simulation = Simulation(
        comm, state, result, schedule, job, wind, probes, *begun, progress, stop, saver, phases
    )
    if record:
        simulation.restore(record["simulation"])
    with phases.phase("dynamics"):
        simulation.run()
    if roof.whole:
        roof.whole.history = simulation.wind_record()
    return probes


def describe(job: Job, roof: Roof, schedule: Schedule | None, progress: Progress) -> None:
    """The lines that a user reads before the run, on rank 0."""
    if roof.whole is None:
        return
    net, part = roof.whole.net, roof.whole.part
    ranks = roof.distribution.comm.size
    progress.say(
        f"net: {net.n} particles ({int(net.fixed.all(1).sum())} fixed), {net.m} elements, roof {roof.whole.area.sum():.1f} m2"
    )
    if roof.whole.remark:
        progress.say(f"note: {roof.whole.remark}")
    if ranks > 1:
        progress.say(
            f"partition: {roof.whole.partition_source}, {partition.edge_cut(net.elements, part)} elements cut, "
            f"fullest part {partition.imbalance(net.elements, part, ranks):.2f} of the mean"
        )
    N = roof.whole.N
    if roof.form:
        progress.say(
            f"form finding: {roof.form.iterations} iterations, largest residual {roof.form.residual / max(roof.form.reference, 1e-300):.2g} "
            f"of the prestress; with the real material {roof.residual / max(roof.form.reference, 1e-300):.2g}; tensions {N.min():.4g} to {N.max():.4g} N"
        )
    elif roof.residual > 1e-6 * max(roof.reference, 1e-300) and roof.residual > 0:
        progress.say(
            f"note: the start is not in equilibrium: largest residual {roof.residual:.3g} N, largest tension {roof.reference:.3g} N"
        )
    if schedule:
        for limit in roof.limits.values():
            progress.detail(limit_line(limit, roof.whole))
        probes = probe_remarks(roof.whole.net, roof.whole.x, job.output.probes)
        for remark in step_remarks(job, roof, schedule.dt) + probes:
            progress.say(remark)


def step_remarks(job: Job, roof: Roof, dt: float) -> list[str]:
    """What a user should know of mass that was added, of the precision at steps of dt [s], and of a fixed step that is stable."""
    remarks = []
    if roof.whole.added is not None:
        added, own = roof.whole.added, roof.whole.mass - roof.whole.added
        most = int(np.argmax(added / np.where(own > 0.0, own, 1.0)))
        remarks.append(
            f"mass scaling: {added.sum():.4g} kg of inertia added at {int((added > 0.0).sum())} of {len(added)} particles, "
            f"{added.sum() / own[~roof.whole.net.fixed.all(1)].sum():.2%} of what moves; at most {added[most] / own[most]:.2g} times a particle's own (node {roof.whole.net.node_id[most]})"
        )
    if job.dynamics.precision != "double":
        stiffness = roof.whole.net.modulus * roof.whole.net.section / roof.whole.L0
        stiffest = int(np.argmax(stiffness))
        remarks.append(
            f"note: {job.dynamics.precision} precision: where displacements are near 1 m, tensions are rounded to {2.0 * HALF_DIGIT * stiffness[stiffest]:.2g} N in element "
            f"{roof.whole.net.element_id[stiffest]} ({roof.whole.L0[stiffest]:.3g} m)"
            + (
                ""
                if job.dynamics.precision == "mixed"
                else f', and what is slower than {HALF_DIGIT / dt:.2g} m/s stands still with this step (precision = "mixed" lets it move)'
            )
        )
    limit = roof.limits["slackening"]
    if job.dynamics.time_step == "auto" or job.dynamics.time_step <= limit.dt:
        return remarks
    return remarks + [
        (
            f"note: time_step = {job.dynamics.time_step:g} is above {limit.dt:.4g} s, from which on cables that go slack and come taut again gain energy "
            f"(first: element {roof.whole.net.element_id[limit.element]}, {roof.whole.L0[limit.element]:.3g} m): it is right as long as short cables stay taut"
        )
    ]


def limit_line(limit, whole: Whole) -> str:
    """A step limit in words."""
    meaning = {
        "any_shape": "stable step, intact, in any shape",
        "slackening": "step for cables that go slack and come taut again",
        "after_fracture": "stable step after any fracture",
        "assembled": "stable step of the net as it starts",
    }[limit.name]
    if limit.element < 0:
        return f"{meaning}: no limit"
    net = whole.net
    ids = "-".join(str(net.node_id[p]) for p in net.elements[limit.element])
    return f"{meaning}: {limit.dt:.4g} s, set by element {net.element_id[limit.element]} (nodes {ids}, {whole.L0[limit.element]:.4g} m)"


def sections_of(
    job: Job, roof: Roof, statics: StaticPath | None, result: Result, probes: Probes | None
) -> dict[str, dict]:
    """The small datasets of the result file, by group, on rank 0."""
    if roof.whole is None:
        return {}
    whole = roof.whole
    sections = {"net": net_section(whole.net, whole.area)}
    if roof.form:
        sections["form_finding"] = {
            "iterations": np.int64(roof.form.iterations),
            "residual": np.float64(roof.form.residual / roof.form.reference if roof.form.reference else 0.0),
            "residual_real_material": np.float64(
                roof.residual / roof.form.reference if roof.form.reference else 0.0
            ),
            "position": whole.x,
            "tension": whole.N,
            "unstressed_length": whole.L0,
        }
    if statics:
        sections["statics"] = {
            "load_factor": np.array(statics.load_factor),
            "residual": np.array(statics.residual),
            "slack": np.array(statics.slack),
            "iterations": np.array(statics.iterations),
        }
    if probes is not None and len(probes.particles):
        rows = np.array(result.probes)
        count = 3 * len(probes.particles)
        sections["history"] = {
            "probe_displacement": rows[:, :count].reshape(len(rows), -1, 3),
            "probe_tension": rows[:, count:],
            "probe_particle": probes.particles,
            "probe_element": probes.elements,
        }
    elif probes is not None:
        sections["history"] = {"probe_displacement": np.zeros((len(result.history), 0, 3))}
    if job.wind:
        time, gust = whole.history
        sections["wind"] = {
            "control_point": whole.field.control_point,
            "time": time,
            "speed": whole.field.control_mean + gust,
            "mean_speed": whole.field.control_mean
            if not job.wind.file
            else np.atleast_1d(np.trapezoid(gust[:, 0], time) / np.ptp(time)),
        }
    return sections


def provenance_of(comm: MPI.Comm, job: Job, roof: Roof, schedule: Schedule | None) -> dict:
    """Where the numbers come from: job, versions, ranks, partition, limits."""
    values = {
        "job": job.text,
        "job_name": job.name,
        "overrides": "\n".join(job.overrides),
        "job_digest": roof.digest,
        "title": job.title,
        "netfall": netfall.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
        "mpi4py": mpi4py.__version__,
        "h5py": h5py.__version__,
        "hdf5": h5py.version.hdf5_version,
        "mpi": MPI.Get_library_version().split("\n")[0].strip("\x00 "),
        "writing": how_it_writes(),
        "ranks": comm.size,
        "exit_state": "finished",
    }
    if roof.whole:
        net = roof.whole.net
        values |= {
            "partition": roof.whole.partition_source,
            "metis_seed": partition.SEED,
            "edge_cut": partition.edge_cut(net.elements, roof.whole.part),
        }
        if roof.whole.added is not None:
            values["added_mass"] = float(roof.whole.added.sum())
        if schedule:
            values |= {"time_step": schedule.dt, "steps": schedule.steps}
            for name, limit in roof.limits.items():
                values |= {f"limit_{name}": limit.dt, f"limit_{name}_element": limit.element}
    return values


def finish(result: Result, path: Path, phases: Phases, progress: Progress) -> None:
    """The last lines of a run."""
    if result.events:
        time, first = result.events[0]
        progress.say(
            f"fractures: {len(result.broken)} elements, the first at t = {time:.4f} s (element {first.element})"
        )
    if result.history:
        identity, balance = (max(abs(row[k]) for row in result.history) for k in (7, 8))
        if np.isfinite(identity):  # not without the audit
            progress.say(
                f"energy: work identity to {identity:.1e}, physical balance to {balance:.1e} of the largest external work"
            )
    progress.say("time: " + ", ".join(f"{name} {seconds:.2f} s" for name, seconds in phases.seconds.items()))
    progress.say(f"written: {path}")
