"""A complete run: form finding, then one stage after another, one result file.

The functions are in the order of execution.
"""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

import netfall
from netfall.core.errors import DivergedError, InputError, Interrupted, OutputError
from netfall.core.messages import count_of, kN
from netfall.core.progress import Progress
from netfall.core.timings import NEVER_STOP, PhaseTimes, StopFlag
from netfall.driver import modes
from netfall.driver.dynamics import stage as dynamics
from netfall.driver.problem import Outcome, Problem, RunContext
from netfall.driver.provenance import library_text, provenance_values
from netfall.driver.removal import equilibria as removal_equilibria
from netfall.driver.reporting.run import OutcomeReport, form_found_model, report_net, report_problem
from netfall.driver.setup import FORM, prepare_problem
from netfall.driver.statics import stage as statics
from netfall.explicit.energy import Snapshot, take_snapshot
from netfall.explicit.plan import StepPlan
from netfall.gpu.plan import plan_maker
from netfall.job.cache import NO_CACHE, ResultCache
from netfall.job.derived import load_settings
from netfall.job.job import Job
from netfall.loads.loads import load_datasets
from netfall.model.layout import Layout
from netfall.parallel.agree import on_root
from netfall.parallel.mpi import MPI
from netfall.physics.events import EventLog
from netfall.physics.fields import Features
from netfall.physics.state import State
from netfall.results.checkpoint import Checkpoint, CheckpointWriter, restore_state
from netfall.results.h5 import check_one_folder
from netfall.results.locks import check_output_path, h5_in_memory, locked_output, resolve_link
from netfall.results.warning_text import force_balance_warnings
from netfall.results.writer import Result, net_section, slide_section, write_order, write_sections
from netfall.statics.reactions import Balance, compute_form_balance

STAGES = (statics, removal_equilibria, modes, dynamics)
STAGE_NAMES = (FORM, *(stage.NAME for stage in STAGES))


def run_job(
    comm: MPI.Comm,
    job: Job,
    path: Path,
    progress: Progress,
    restart: Path | None = None,
    stop: StopFlag = NEVER_STOP,
    profile: bool = False,
    device: str = "cpu",
) -> None:
    """Run the stages that the job has and write the result file. Collective.

    restart : a checkpoint to resume; stop : requests an early end; profile : whether to time the parts of a
    step
    device : of the dynamic stage, "cpu", "gpu", or "auto": a GPU if possible

    Raises InputError before anything is computed or written, DivergedError if a stage has no solution,
    Interrupted after a checkpoint if `stop` is set.
    """
    phases = PhaseTimes(profile)
    path = comm.bcast(resolve_link(path))
    on_root(comm, lambda: check_output_path(path))
    with ExitStack() as lock:
        on_root(comm, lambda: lock.enter_context(locked_output(path)))
        check_one_folder(comm, path)
        ranks = count_of(comm.size, "rank")
        progress.say(f"netfall {netfall.__version__}: {job.title or job.name}, {ranks}")
        progress.verbose_message(library_text())

        def report(iteration: int, residual: float) -> None:
            progress.verbose_message(f"form finding: iteration {iteration}, largest residual {kN(residual)}")

        make_plan: Callable[..., StepPlan] = StepPlan

        def describe(layout: Layout | None, features: Features) -> None:
            nonlocal make_plan
            if job.dynamics:
                make_plan = plan_maker(device, features, comm.size, progress.say)
                if make_plan is not StepPlan:
                    phases.of_steps = None  # a GPU does not time the parts of a step
            if layout:
                report_net(job, comm.size, progress, layout)

        problem, checkpoint = prepare_problem(
            comm, job, phases, report, path, restart, stop, describe=describe
        )
        report_problem(problem, progress)
        context = make_context(problem, path, progress, phases, stop, given=restart, checkpoint=checkpoint)
        outcomes = run_stages(problem, replace(context, make_plan=make_plan))
        progress.end()
        seconds = phases.seconds.items()
        progress.say("time: " + ", ".join(f"{name} {duration:.2f} s" for name, duration in seconds))
        progress.say(f"written: {path}")
        progress.say_warning_count()
        raise_failure(context, outcomes)


def make_context(
    problem: Problem,
    path: Path | None,
    progress: Progress,
    phases: PhaseTimes,
    stop: StopFlag = NEVER_STOP,
    cache: ResultCache = NO_CACHE,
    given: Path | None = None,
    checkpoint: Checkpoint | None = None,
) -> RunContext:
    """Return the run context, with the parts of a resumed run. Collective.

    path : of the result file, None: no file
    given : the checkpoint to resume; checkpoint : its contents, on rank 0
    """
    log, net, job = EventLog(problem.distribution.n), problem.model and problem.model.net, problem.job
    result: Any = Result(path, problem.distribution, net, log) if path else UnsavedResult(problem)
    saver = CheckpointWriter(result, job.title or job.name, problem.digest, STAGE_NAMES, given, checkpoint)
    return RunContext(log, result, saver, progress, phases, stop, cache)


class UnsavedResult:
    """A result with the interface of `writer.Result` without a file; its warnings need the small datasets."""

    is_stored = False

    def __init__(self, problem: Problem):
        self.problem, self.comm, self.removals = problem, problem.comm, 0
        self.sections: dict[str, dict[str, Any]] = {}

    @property
    def file(self) -> "UnsavedResult":
        """Its interface includes that of the file."""
        return self

    def _nothing(self, *_: object) -> None:
        pass

    write_frame = write_static_step = write_equilibrium = write_whole = _nothing
    discard = discard_all = discard_after = _nothing

    def write_envelope(self, state: State, tension: dict[str, Any], displacement: dict[str, Any]) -> None:
        """Gather the datasets of the elements in /envelope."""
        gather = self.problem.gather_elements
        self.sections["envelope"] = {name: gather(values) for name, values in tension.items()}

    def write_final(self, state: State, snapshot: Snapshot) -> None:
        """Gather the plastic strains of the last state."""
        self.sections["final"] = {"plastic_strain": self.problem.gather_elements(snapshot.eps_p)}

    def close(
        self,
        sections: dict[str, Any],
        provenance: dict[str, Any],
        phases: dict[str, Any],
        labels: dict[str, Any],
        warnings: Callable[[h5py.File], list[str]],
    ) -> None:
        """Compose the warnings of the run on rank 0; see `writer.Result.close`."""
        if self.comm.rank == 0:
            with h5_in_memory() as file:
                write_sections(file, sections | self.sections)
                write_order(file, sections)
                file.create_group("provenance").attrs["notes"] = ""
                warnings(file)


def run_stages(problem: Problem, context: RunContext) -> dict[str, Outcome]:
    """Run the stages after form finding and write the result file. Return the outcomes by name. Collective.

    The last outcome may have a `failure`: the file then contains the results up to it.
    """
    outcomes = {FORM: form_outcome(problem)}
    try:
        context.progress.say(*outcomes[FORM].lines)
        register_state(problem, context)
        for stage in STAGES:
            if stage.required(problem.job) and not problem.failure:
                outcomes[stage.NAME] = stage.run(problem, context, outcomes)
                context.progress.say(*outcomes[stage.NAME].lines)
                if outcomes[stage.NAME].failure:
                    break
        if dynamics.NAME not in outcomes:
            snapshot = take_snapshot(problem.state)
            context.result.write_frame(0.0, problem.state, snapshot)
            context.result.write_final(problem.state, snapshot)
        provenance = provenance_values(problem) if context.result.is_stored else {}
        if failure := [*outcomes.values()][-1].failure:
            provenance["exit_state"] = failure.state
        sections, attributes, labels = (
            {name: value for outcome in outcomes.values() for name, value in getattr(outcome, kind).items()}
            for kind in ("sections", "attributes", "labels")
        )
        times = context.phases.over_ranks(problem.comm)
        report = OutcomeReport(problem, context, outcomes)
        context.result.close(sections, provenance | attributes, times, labels, report.warnings)
        context.progress.say(*report.lines)
    except (InputError, DivergedError, Interrupted) as error:  # every rank raises the same error
        context.result.file.discard_all()
        if isinstance(error, DivergedError):
            error.checkpoint = context.saver.last
        raise
    except OutputError as error:
        context.result.discard_after(error, context.saver.last is not None)
        error.checkpoint = context.saver.last
        raise
    except BaseException:
        context.result.file.discard()
        raise
    finally:
        context.saver.parts.clear()  # functions of the stages, which refer to the writer and to all arrays
    return outcomes


def raise_failure(context: RunContext, outcomes: dict[str, Outcome]) -> None:
    """Raise the failure of the stage at which a run ended, if there is one. The result file is complete."""
    if failure := [*outcomes.values()][-1].failure:
        failure.checkpoint = context.saver.last
        raise failure


def register_state(problem: Problem, context: RunContext) -> None:
    """Register the states outside the stages, and restore those of a resumed run. Collective."""
    if context.saver.given:
        context.progress.say(f"resumed from {context.saver.given}")
    context.saver.register_result()
    context.saver.register(
        "warnings",
        lambda: ({"warnings": context.progress.warnings}, {}),
        lambda record, _: context.progress.restore_warnings(record["warnings"]),
    )
    if context.saver.stage not in (None, FORM):
        restore_state(problem.distribution, problem.state, context.saver.checkpoint)


def form_outcome(problem: Problem) -> Outcome:
    """Return the outcome of form finding, targets and stages of erection."""
    warnings, balance = [], None
    if problem.model and problem.form:
        model, tolerance = form_found_model(problem), load_settings(problem.job).tolerance
        if problem.job.form_finding:
            tolerance = max(tolerance, problem.job.form_finding.tolerance)
        balance = compute_form_balance(model, problem.residual, tolerance)
    labels = problem.build_up.labels if problem.model else {}
    if balance and "form_finding" not in labels:
        warnings = [*force_balance_warnings([("form", balance.unexplained)])]
    sections = initial_sections(problem, balance)
    return Outcome(lines=warnings, sections=sections, labels=labels, failure=problem.failure)


def initial_sections(problem: Problem, balance: Balance | None) -> dict[str, dict[str, Any]]:
    """Return the small datasets of the net, its loads and its form, on rank 0. balance : of the form"""
    model, form, build_up = problem.model, problem.form, problem.build_up
    if model is None or build_up.base is None:
        return {}
    net = replace(model.net, density=build_up.base.net.density)  # erection sets 0 for removed elements
    sections: dict[str, dict[str, Any]] = {"net": net_section(net, model.roof, model.cut_length)}
    sections["load"] = load_datasets(problem.job, model.roof.zones)
    if "temperature" in sections["load"]:
        sections["net"]["unstressed_length_warm"] = model.L0
    if model.layout.slides:
        sections["slide"] = slide_section(model.net, model.layout.slides)
    if form and balance:
        model = build_up.form or model
        sections["form_finding"] = {
            "iterations": np.int64(form.iterations),
            "residual": _relative(form.residual, form.reference),
            "residual_real_material": _relative(problem.residual, form.reference),
            "position": model.x,
            "tension": model.N,
            "unstressed_length": model.cut_length,
            "held": model.net.fixed.astype(np.uint8),
            "reaction": balance.reaction,
            **{name: np.array(value) for name, value in balance.numbers().items()},
        }
        if form.self_stress is not None:
            sections["form_finding"]["self_stress"] = form.self_stress
        sections["form_finding"] |= build_up.form_sections
    return {**sections, **build_up.sections}


def _relative(residual: float, reference: float) -> np.float64:
    """Return a residual [N] relative to the prestress [N], 0 without prestress."""
    return np.float64(residual / reference if reference else 0.0)
