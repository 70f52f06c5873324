"""Arguments of every stage of a run: problem, run context, ordered equilibria; the outcome of a stage."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple, final

import numpy as np

from netfall.core.errors import DivergedError
from netfall.core.progress import Progress
from netfall.core.timings import NEVER_STOP, PhaseTimes, StopFlag
from netfall.explicit.plan import StepPlan
from netfall.job.cache import NO_CACHE, ResultCache
from netfall.job.derived import (
    has_load_cases,
    load_steps,
    permanent_weight_factor,
    starts_in_mean_wind,
    starts_loaded_for_removal,
)
from netfall.job.job import Job
from netfall.job.keys.entries import action_factor
from netfall.job.keys.models import Dynamics
from netfall.model.actions import ALL_LOADS, Actions, StaticLoad, case_actions, combination_actions
from netfall.model.model import Model
from netfall.model.schedule import Schedule
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.parallel.subdomain import Distribution
from netfall.physics.events import EventLog
from netfall.physics.stability import Limit
from netfall.physics.state import State
from netfall.results.checkpoint import CheckpointWriter
from netfall.results.writer import Result
from netfall.statics.form.find import Form
from netfall.statics.free_segments import build_slip_chains
from netfall.statics.slip import Slips
from netfall.statics.solver import EquilibriumFinder


@final
@dataclass(frozen=True)
class BuildUp:
    """Record of the steps from the form-found geometry to the initial state, with arrays on rank 0.

    base : the model in the form-found geometry; form : geometry in which the erection began, None: no
    erection
    form_sections : datasets of /form_finding; sections : of other groups of the file; labels : attributes
    lines : to print; failure : error that ends the build-up, or None
    start_residual : largest residual and tension [N], if stages or another temperature precede it
    """

    base: Model | None = None
    form: Model | None = None
    form_sections: Mapping[str, np.ndarray] = field(default_factory=dict)
    sections: Mapping[str, dict[str, np.ndarray]] = field(default_factory=dict)
    labels: Mapping[str, dict[str, Any]] = field(default_factory=dict)
    lines: Sequence[str] = ()
    failure: DivergedError | None = None
    start_residual: tuple[float, float] | None = None


@dataclass(frozen=True)
class Problem:
    """Problem definition of a run on one rank: the job and all data for time steps.

    model : on rank 0, None elsewhere; finder : of equilibria of the state; digest : of job and net
    residual : [N], of the prestressed net with the real material
    reference : [N], largest tension of elements that can move, in the initial state
    build_up : steps from the form to the initial state
    limits : of the step, by name; schedule : of the dynamic stage, None without one
    """

    comm: MPI.Comm
    job: Job
    model: Model | None
    distribution: Distribution
    halo: Halo
    state: State
    finder: EquilibriumFinder
    form: Form | None
    residual: float
    reference: float
    digest: str
    limits: dict[str, Limit] = field(default_factory=dict)
    schedule: Schedule | None = None
    build_up: BuildUp = BuildUp()

    @property
    def root_model(self) -> Model:
        """Return the model, in code that rank 0 alone runs."""
        assert self.model is not None
        return self.model

    @property
    def dynamics(self) -> Dynamics:
        """Return the section [dynamics], in code that needs a dynamic stage."""
        assert self.job.dynamics is not None
        return self.job.dynamics

    @property
    def dynamic_schedule(self) -> Schedule:
        """Return the schedule, in code that needs a dynamic stage."""
        assert self.schedule is not None
        return self.schedule

    @property
    def failure(self) -> DivergedError | None:
        """Return the error that prevents the run from continuing after its initial state, or None."""
        return self.build_up.failure

    def gather_elements(self, rows: np.ndarray) -> np.ndarray | None:
        """Gather rows (m, ...) of the elements on rank 0, from their present owners. Collective."""
        return self.distribution.gather_elements(rows, self.state.owned.astype(bool))


def set_up_slip(problem: Problem) -> None:
    """Set up sliding cables for the equilibria of the problem, if there are any. Collective."""
    if problem.state.features.slip:
        layout = problem.model.layout if problem.model else None
        chains = problem.comm.bcast(layout and build_slip_chains(layout.slides, layout.net.own_weight))
        problem.finder.slips = Slips(problem.distribution, problem.state, chains)


@dataclass(frozen=True)
class RunContext:
    """Run context of a stage on one rank: output, progress, checkpoints.

    stop : stop flag; cache : cache of results for the runs in this process
    on_equilibrium : called on all ranks with the state, snapshot, group and load factor of each equilibrium
    make_plan : makes the step plan of the dynamic stage, on the CPU or on a GPU
    """

    log: EventLog
    result: Result
    saver: CheckpointWriter
    progress: Progress
    phases: PhaseTimes
    stop: StopFlag = NEVER_STOP
    cache: ResultCache = NO_CACHE
    on_equilibrium: Callable[[State, Any, str, float], None] = lambda *_: None
    make_plan: Callable[..., StepPlan] = StepPlan


class Outcome(NamedTuple):
    """Outcome of a stage.

    result : for later stages and a study; lines : printed at the end of the stage
    sections : its small datasets by group of the file, on rank 0; attributes : of /provenance, likewise
    labels : attributes of groups of the file, likewise; failure : error that ends the run, None: it continues
    """

    result: Any = None
    lines: Sequence[str] = ()
    sections: Mapping[str, dict[str, np.ndarray]] = {}
    attributes: Mapping[str, Any] = {}
    labels: Mapping[str, dict[str, Any]] = {}
    failure: DivergedError | None = None


UNKNOWN_LOAD = np.zeros((0, 3))  # N, placeholder of a load that is not computed yet


class EquilibriumRequest(NamedTuple):
    """Equilibrium to compute. load_case : without arrays; actions_of(model) : returns these, on rank 0"""

    load_case: StaticLoad
    actions_of: Callable[[Model], Actions]


def equilibria(problem: Problem) -> list[EquilibriumRequest]:
    """List the equilibria that the job needs, in their order.

    Permanent loads come first, then cases, combinations, load steps, and the final equilibrium.
    """
    job = problem.job
    steps, final_wind, weights = load_steps(job), starts_in_mean_wind(job), permanent_weight_factor(job)
    has_cases = bool(job.cases or job.combinations)
    requests: list[EquilibriumRequest] = []

    def add(kind: str, name: str, load_of: Callable[[Model], np.ndarray], **options: Any) -> None:
        load = StaticLoad(kind, name, UNKNOWN_LOAD, weights=weights, **options)
        requests.append(EquilibriumRequest(load, lambda model: Actions(load_of(model))))

    def add_separate(kind: str, name: str, actions_of: Callable[[Model], Actions], weights: float) -> None:
        load = StaticLoad(kind, f"{kind} {name}", UNKNOWN_LOAD, 1.0, name, True, weights=weights)
        requests.append(EquilibriumRequest(load, actions_of))

    features = problem.state.features
    starts_loaded = final_wind or starts_loaded_for_removal(job)
    if has_load_cases(job) or (starts_loaded and (features.plastic or features.slip)):
        add("permanent", "the permanent loads", lambda model: model.loading.permanent)
    for case in job.cases:
        add_separate("case", case.name, partial(case_actions, job, case), weights)
    for entry in job.combinations:
        weight = weights * action_factor(entry, "permanent")
        add_separate("combination", entry.name, partial(combination_actions, job, entry), weight)
    for step in range(1, steps + 1):
        add(
            "step",
            f"static load step {step} of {steps}",
            partial(_step_load, step / steps),
            factor=step / steps,
            from_permanent=has_cases and step == 1,
            start_factor=(step - 1) / steps,
        )
    if final_wind and not steps:
        add("at once", "the constant loads", lambda model: model.load, factor=1.0, from_permanent=has_cases)
    if starts_loaded_for_removal(job):
        add(
            "initial_state",
            ALL_LOADS,
            lambda model: model.load,
            factor=1.0,
            from_permanent=has_cases and not steps,
        )
    if final_wind:
        add("initial_state", "the mean wind", lambda model: model.load + model.mean_wind, factor=1.0)
    return requests


def _step_load(factor: float, model: Model) -> np.ndarray:
    """Compute the load (n, 3) [N] of a load step."""
    return model.loading.permanent + factor * model.loading.live


def loaded(problem: Problem, request: EquilibriumRequest) -> StaticLoad:
    """Return the load of an equilibrium with its arrays on this rank. Collective."""
    distribution = problem.distribution
    actions = request.actions_of(problem.model) if problem.model else None
    if problem.model and actions:  # no load acts at nodes whose elements a stage of erection removed
        is_there = problem.model.net.valence[:, None] > 0
        actions = replace(actions, load=np.where(is_there, actions.load, 0.0))
    given = actions and [name for name, values in vars(actions).items() if values is not None]
    parts: dict[str, Any] = {}
    for name in problem.comm.bcast(given):
        scatter = distribution.elements if name == "L0" else distribution.particles
        parts[name] = scatter(getattr(actions, name) if actions else None)
    return request.load_case._replace(**parts)
