"""Preparation of a job for its stages: model, form, state and step limits, distributed over the ranks."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from netfall.core.errors import InputError, interruption_error
from netfall.core.messages import is_warning
from netfall.core.timings import NEVER_STOP, PhaseTimes, StopFlag, StopRequested
from netfall.driver import messages
from netfall.driver.erection.permanent_state import solve_initial_state
from netfall.driver.problem import BuildUp, Problem, set_up_slip
from netfall.job.cache import NO_CACHE, WIND_SPEED_KEYS, ResultCache, cache_key
from netfall.job.derived import has_statics
from netfall.job.job import Job
from netfall.model.layout import Layout, layout_digest, make_features, make_layout
from netfall.model.model import Model, make_model, make_state
from netfall.model.schedule import schedule_job, step_limits
from netfall.parallel.agree import on_root
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution, split_net
from netfall.physics.fields import Features
from netfall.physics.law.measures import heated_length
from netfall.physics.slip.law import set_slipless_lengths
from netfall.physics.slip.motion import SLIP_STEP_SHARE
from netfall.physics.stability import Limit
from netfall.physics.state import State
from netfall.results.checkpoint import Checkpoint, checkpoint_path, write_checkpoint
from netfall.results.text import bar_length_warnings, form_lines
from netfall.statics.form.find import Form
from netfall.statics.form.initial import find_initial_form
from netfall.statics.relaxation import state_residual
from netfall.statics.solver import EquilibriumFinder

FORM = "form finding"  # name of all that precedes the first stage in checkpoints


def prepare_problem(
    comm: MPI.Comm,
    job: Job,
    phases: PhaseTimes,
    report: Callable[..., Any] = lambda iteration, residual: None,
    result: Path | None = None,
    restart: Path | None = None,
    stop: StopFlag = NEVER_STOP,
    cache: ResultCache = NO_CACHE,
    describe: Callable[[Layout | None, Features], None] = lambda layout, features: None,
) -> tuple[Problem, Checkpoint | None]:
    """Return the job in its initial state (form, prestress, load), and on rank 0 the checkpoint. Collective.

    If targets are not met or a stage of erection has no equilibrium, `Problem.failure` is set. The problem
    then has no limits and no schedule.
    result : path of the result file, next to which an interrupted preparation leaves a checkpoint
    restart : the checkpoint to resume, which does not replace the preparation; cache : cache of earlier runs
    describe : receives the given net, on rank 0, and its features, before form finding

    Raises InputError for errors in the job, DivergedError if form finding does not converge, Interrupted if
    `stop` is set.
    """
    with phases.phase("net and partition"):
        layout, features, distribution, halo = _distribute(comm, job, cache)
    describe(layout, features)
    net = layout and layout.net
    digest = comm.bcast(layout_digest(job, net) if layout else None)
    checkpoint = on_root(comm, lambda: Checkpoint(restart, digest)) if restart else None

    def find_form() -> Any:
        if job.form_finding is None:
            return None, layout and net.x, None
        key = comm.bcast(cache_key(job, without=WIND_SPEED_KEYS) if layout else None)
        find = partial(find_initial_form, job, layout, distribution, halo, report, stop)
        return cache.get_or_compute("form", key, find)

    try:
        with phases.phase("form finding"):
            form, x, N = find_form()
            model = on_root(comm, lambda: _make_model(job, layout, x, N, cache))
        with phases.phase("state"):
            state = make_state(distribution, job, model, features)
            checked = _check_form(comm, job, form, model, distribution, state)
        finder = EquilibriumFinder(comm, halo, distribution, state)
        problem = Problem(comm, job, model, distribution, halo, state, finder, form, *checked, digest)
        problem = replace(problem, build_up=BuildUp(base=model))
        if job.targets or job.stages or comm.bcast(net is not None and bool(net.length_error.any())):
            with phases.phase("erection"):
                problem = solve_initial_state(problem, stop, cache)
    except StopRequested:
        path = restart or _empty_checkpoint(comm, job, result or Path(), digest)
        when = "in form finding or erection, which the resumed run repeats: give it more time than they take"
        raise interruption_error(when, path) from None
    if problem.failure:
        return problem, checkpoint
    with phases.phase("state"):
        problem = _at_start(problem)
        limits = _step_limits(problem)
        schedule = job.dynamics and on_root(comm, lambda: schedule_job(job, limits, problem.root_model))
        return replace(problem, limits=limits, schedule=comm.bcast(schedule)), checkpoint


def _empty_checkpoint(comm: MPI.Comm, job: Job, result: Path, digest: str) -> Path:
    """Write a checkpoint from which a run begins again; return its path. Collective."""
    path = checkpoint_path(result, 1, 0)
    record = {"job": digest, "name": job.title or job.name, "stage": FORM}
    write_checkpoint(comm, path, None, None, record, {})
    return path


def _check_form(
    comm: MPI.Comm, job: Job, form: Form | None, model: Model | None, distribution: Distribution, state: State
) -> tuple[float, float]:
    """Return the largest residual and tension [N] of the prestressed net with the real material. Collective.

    Raises InputError if the residual exceeds the tolerance of form finding.
    """
    residual = state_residual(comm, state, distribution.particles(model and model.form_load))
    if form is None:  # the tables may be those of a form that carries its permanent load
        permanent = distribution.particles(model and model.loading.permanent)
        residual = min(residual, state_residual(comm, state, permanent))
    can_move = model and model.net.moves[model.net.elements].any(1)
    reference = comm.bcast(model and float(np.abs(model.N[can_move]).max(initial=0.0)))
    if form is not None and job.form_finding:
        tolerance, largest = job.form_finding.tolerance, max(form.reference, reference)
        if not residual <= 1.001 * tolerance * largest:
            raise InputError(
                messages.TOLERANCE_BELOW_ROUNDING(
                    path=job.path, tolerance=tolerance, residual=residual, reference=largest
                )
            )
    return residual, reference


def _at_start(problem: Problem) -> Problem:
    """Return the problem with its slip points, at the temperature of [load]. Collective.

    `build_up.start_residual` is set after stages, under [load]. It is also set at another temperature without
    stages and statics; then no load acts.
    """
    comm, job, distribution = problem.comm, problem.job, problem.distribution
    set_up_slip(problem)
    is_heated = bool(job.load and job.load.temperature)
    if job.load and is_heated:
        if model := problem.model:
            L0 = heated_length(model.cut_length, model.net.expansion, job.load.temperature)
            problem = replace(problem, model=replace(model, L0=L0))
        set_slipless_lengths(problem.state, distribution.elements(problem.model and problem.model.L0))
    if job.stages or (is_heated and not has_statics(job)):
        largest = float(np.abs(problem.state.present_element_state().N).max(initial=0.0))
        load = distribution.particles(problem.model and problem.model.load)
        load = load if job.stages else np.zeros_like(load)
        largest_values = state_residual(comm, problem.state, load), comm.allreduce(largest, MPI.MAX)
        problem = replace(problem, build_up=replace(problem.build_up, start_residual=largest_values))
    return problem


def _make_model(job: Job, layout: Layout, x: Any, N: Any, cache: ResultCache) -> Model:
    """Build the model; an InputError also contains the warnings of nodes that form finding moved far."""
    try:
        return make_model(job, layout, x, N, cache, before_stages=bool(job.stages))
    except InputError as error:
        net = layout.net
        changes = [*form_lines(net, x), *bar_length_warnings(net, x)]
        raise InputError([*filter(is_warning, changes), *error.lines]) from None


def _distribute(comm: MPI.Comm, job: Job, cache: ResultCache) -> tuple[Any, ...]:
    """Return the layout of the net, on rank 0, its features, and its parts on the ranks. Collective."""
    layout = on_root(comm, lambda: make_layout(job, comm.size, cache))
    net = layout and layout.net
    n, m, features = comm.bcast(layout and (net.n, net.m, make_features(job, net, layout.slides)))
    joints = [layout.chains.particles] if layout and layout.chains else []
    cut = on_root(comm, lambda: split_net(n, net.elements, layout.part, comm.size, *joints))
    distribution = Distribution(comm, n, m, cut)
    return layout, features, distribution, Halo(comm, distribution.subdomain, 3)


def _step_limits(problem: Problem) -> dict[str, Limit]:
    """Compute the time step limits by name. Collective."""
    comm, job, model = problem.comm, problem.job, problem.model
    share = job.dynamics.fragment_mass if job.dynamics else 0.0
    limits = comm.bcast(step_limits(model, problem.state.features, share) if model else None)
    if not problem.state.features.sliding:
        return limits
    return {  # the limit for slack cables has room for slips
        name: limit if name in ("slackening", "slip") else replace(limit, dt=SLIP_STEP_SHARE * limit.dt)
        for name, limit in limits.items()
    }
