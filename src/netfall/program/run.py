"""A whole job: form finding, statics, dynamics, one result file.

The program in the order in which it runs.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

import netfall
from netfall.equilibrium.find import STABLE
from netfall.equilibrium.relaxation import Paused
from netfall.ground.errors import DivergedError, InputError, Interrupted, OutputError, interrupted
from netfall.ground.progress import Progress
from netfall.ground.stop import NEVER, StopRequest
from netfall.ground.timings import Phases
from netfall.job.asks import grows, has_statics, rests_in_wind
from netfall.job.memory import FORGETFUL, Memory
from netfall.job.read import Job
from netfall.mechanics.events import EventLog
from netfall.messages.run import after_run, before_run, rest_words
from netfall.messages.wind import wind_section
from netfall.model.loads import load_section
from netfall.model.schedule import Schedule, schedule_of
from netfall.parallel.agree import on_root
from netfall.program.provenance import how_it_writes, provenance_of
from netfall.program.recall import find_or_recall
from netfall.program.restart import (
    Saver,
    restore_history,
    restore_relaxation,
    restore_result,
    restore_state,
    restore_wind,
)
from netfall.program.setup import Setup, prepare
from netfall.record.energy import take_snapshot, total_energies
from netfall.record.history import History
from netfall.results.loss_lines import loss_lines
from netfall.roof.areas import Areas
from netfall.stages.dynamics import Simulation
from netfall.stages.modes import modes_now, modes_section
from netfall.stages.removal import Removal, losses_now
from netfall.stages.rests import rests_after
from netfall.stages.statics import StaticPath, equilibria, find_equilibria, static_lines
from netfall.stages.varying import GrowingLoad, WindLoad
from netfall.wind.onset import GrowingGusts
from netfall.write.ids import event_ids
from netfall.write.locks import check_place, claim, release
from netfall.write.result import Result, net_section


@dataclass(frozen=True)
class Run:
    """What the stages of a run share, on one rank."""

    comm: MPI.Comm
    job: Job
    setup: Setup
    schedule: Schedule | None
    log: EventLog
    result: Result
    saver: Saver
    progress: Progress
    phases: Phases
    stop: StopRequest = NEVER
    memory: Memory = FORGETFUL


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
        ranks = f"{comm.size} rank{'s' if comm.size > 1 else ''}"
        progress.say(f"netfall {netfall.__version__}: {job.title or job.name}, {ranks}, {how_it_writes()}")
        at_iteration = lambda i, r: progress.detail(
            f"form finding: iteration {i}, largest residual {r:.3g} N"
        )
        setup = prepare(comm, job, phases, at_iteration, path, restart, stop)
        model = setup.model
        schedule = on_root(comm, lambda: schedule_of(job, setup.limits, model)) if job.dynamics else None
        schedule = comm.bcast(schedule)
        before_run(job, setup, schedule, progress)
        log = EventLog(setup.distribution.n)
        result = Result(comm, path, setup.distribution, model.net if model else None, log)
        saver = Saver(job, setup, result, restart)
        run = Run(comm, job, setup, schedule, log, result, saver, progress, phases, stop)
        simulation = run_stages(run)
        progress.end()
        if simulation and simulation.removal and model:
            for line in loss_lines(simulation.removal.columns(), log.columns(), model.net.element_id):
                progress.say(line)
        after_run(setup, log, simulation, path, phases, progress)
    finally:
        if claimed:
            release(claimed)


def run_stages(run: Run) -> Simulation | None:
    """The stages from statics on, and the result file; the dynamic stage if there was one. Collective."""
    try:
        if run.saver.given:
            run.progress.say(f"going on from {run.saver.given}")
        record, losses, after = take_up(run), losses_now(run), None
        if run.setup.stage != "dynamics":
            run.saver.statics = run_statics(run)
            with run.phases.phase("statics"):
                after = rests_after(run, losses)
            write_modes(run)
        removal = Removal(run, losses, after) if run.job.removes and run.job.dynamics else None
        simulation = run_dynamics(run, record if run.setup.stage == "dynamics" else None, removal)
        provenance = provenance_of(run.comm, run.job, run.setup, run.schedule)
        run.result.close(sections_of(run, simulation), provenance, run.phases.over_ranks(run.comm))
    except (InputError, DivergedError, Interrupted) as error:  # raised on every rank alike
        run.result.file.discard_all()
        if isinstance(error, DivergedError):
            error = run.saver.naming_the_last(error)
        raise error from None
    except OutputError as error:
        run.result.discard_after(error, bool(run.saver.kept or run.saver.given))
        raise run.saver.naming_the_last(error) from None
    except BaseException:
        run.result.file.discard()
        raise
    return simulation


def take_up(run: Run) -> dict | None:
    """State, log and statics of the run that is taken up, and its record.

    None if it has no state yet. Collective.
    """
    setup, comm = run.setup, run.comm
    if setup.stage not in ("statics", "dynamics"):
        return None
    restore_result(comm, run.result, setup.checkpoint, setup.digest)
    restore_state(setup.distribution, setup.state, setup.checkpoint)
    record = comm.bcast(setup.checkpoint and setup.checkpoint.record)
    run.saver.statics = StaticPath(**record["statics"]) if record["statics"] else None
    return record


def numbers_of(found: dict) -> dict[str, np.ndarray]:
    """What is kept of equilibria as datasets: whether stable, and not which node says so."""
    arrays = {name: np.array(value) for name, value in found.items()}
    return arrays | {"stable": arrays.pop("falls") == STABLE}


def run_statics(run: Run) -> StaticPath | None:
    """The equilibria that the job asks for, from where an earlier run was interrupted in them. Collective."""
    setup, distribution = run.setup, run.setup.distribution
    if not has_statics(run.job):
        return None
    if run.job.load and run.job.load.steps:
        run.progress.say(f"statics: {run.job.load.steps} load steps")
    resume = restore_relaxation(distribution, setup.checkpoint) if setup.stage == "statics" else None
    with run.phases.phase("statics"):
        try:
            begun = run.saver.statics is not None or resume is not None
            path = find_equilibria(run, run.saver.statics, resume) if begun else find_or_recall(run)
        except Paused as pause:
            where = equilibria(run)[pause.path.done].words
            raise interrupted(f"in statics, {where}", run.saver.pause_statics(pause)) from None
    node_id = setup.model.net.node_id if setup.model else None
    for line in static_lines(path, distribution.m, rest_words(run.job), node_id):
        run.progress.say(line)
    return path


def write_modes(run: Run) -> None:
    """The modes about where the statics ended, /modes, if the job asks for them. Collective."""
    if run.job.output.modes:
        with run.phases.phase("modes"):
            modes = modes_now(run.setup, run.job.output.modes)
            run.result.write_whole("modes", modes and modes_section(run.job, modes))


def run_dynamics(run: Run, record: dict | None, removal: Removal | None) -> Simulation | None:
    """The dynamic stage if the job has it, else one frame of the state that was reached. Collective.

    record : of the run that is taken up in this stage; removal : what is lost in it, None: nothing ever
    """
    state, model, checkpoint = run.setup.state, run.setup.model, run.setup.checkpoint
    if run.job.dynamics is None:
        snapshot = take_snapshot(state, 0.0, 1.0, 0.0, 0.0)
        run.result.write_frame(0.0, state, snapshot)
        run.result.write_final(state, snapshot)
        return None
    with run.phases.phase("wind"):
        loads = varying_loads(run, record) + (list(removal.fades.values()) if removal else [])
    if record:
        start = record["simulation"]["start_strain"], record["simulation"]["start_plastic"]
    else:
        state.count_displacements()
        energies = total_energies(run.comm, state, take_snapshot(state, 0.0, 1.0, 0.0, 0.0))
        start = energies.strain, energies.plastic
    probes = run.comm.bcast(model.probes if model else None)
    run.progress.say(
        f"dynamics: {run.job.dynamics.duration:g} s in {run.schedule.steps} steps of {run.schedule.dt:.4g} s"
    )
    simulation = Simulation(run, loads, History(probes, start[0]), removal, start)
    if record:
        if removal:
            removal.restore(record["simulation"]["removal"], checkpoint, simulation)
        simulation.restore(record["simulation"])
        simulation.envelope.restore(checkpoint)
        restore_history(run.comm, simulation.history, checkpoint)
    with run.phases.phase("dynamics"):
        try:
            simulation.run()
        except DivergedError:  # on every rank
            simulation.halo.free()
            raise
    return simulation


def varying_loads(run: Run, record: dict | None) -> list:
    """The loads that vary in time, as `solve.loads` has them. record : as in `run_dynamics`. Collective."""
    loads, model, distribution = [], run.setup.model, run.setup.distribution
    if run.job.wind:
        field = model.wind_field if model else None
        ramp = run.job.wind.ramp if rests_in_wind(run.job) else 0.0
        gusts = GrowingGusts(model.history, ramp) if model else None
        loads.append(WindLoad(run.comm, distribution, field, gusts))
        if record:
            restore_wind(run.comm, loads[-1], run.setup.checkpoint)
    if grows(run.job):
        force = distribution.particles(model.growing if model else None)
        loads.append(GrowingLoad(force, run.job.load.ramp))
    return loads


def sections_of(run: Run, simulation: Simulation | None) -> dict[str, dict]:
    """The small datasets of the result file, by group, on rank 0."""
    setup, model, statics = run.setup, run.setup.model, run.saver.statics
    if model is None:
        return {}
    areas = Areas(model.area, model.plan_area, model.vector_area)
    sections = {"net": net_section(model.net, areas, model.zones, model.cut_length)}
    sections["load"] = load_section(run.job, model.zones)
    if "temperature" in sections["load"]:
        sections["net"]["unstressed_length_warm"] = model.L0
    if setup.form:
        of_prestress = lambda force: np.float64(force / setup.form.reference if setup.form.reference else 0.0)
        sections["form_finding"] = {
            "iterations": np.int64(setup.form.iterations),
            "residual": of_prestress(setup.form.residual),
            "residual_real_material": of_prestress(setup.residual),
            "position": model.x,
            "tension": model.N,
            "unstressed_length": model.cut_length,
        }
    if statics and statics.steps:
        sections["statics"] = numbers_of(
            {name: [step[name] for step in statics.steps] for name in statics.steps[0]}
        )
    if statics and statics.rest:
        sections["rest"] = numbers_of(statics.rest)
    for name, numbers in statics.cases.items() if statics else ():
        sections[f"cases/{name}"] = numbers_of(numbers)
    if simulation:
        sections["history"] = simulation.history.columns() | simulation.history.probe_columns()
        sections["events"] = run.log.columns()
        sections["events"] |= event_ids(model.net, sections["events"])
    if simulation and simulation.removal:
        sections["removal"] = simulation.removal.columns()
    if simulation and simulation.wind:
        sections["wind"] = wind_section(run.job, model, *simulation.wind.record_until(simulation.time))
    return sections
