"""Arguments of every stage of a run, problem definition and run context, and the outcome of a stage."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, final

import numpy as np

from netfall.core.errors import DivergedError
from netfall.core.progress import Progress
from netfall.core.timings import NEVER_STOP, PhaseTimes, StopFlag
from netfall.job.cache import NO_CACHE, ResultCache
from netfall.job.job import Job
from netfall.job.keys.models import Dynamics
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
    """Record of how the initial state follows from the form-found geometry.

    Arrays on rank 0.

    base : the model in the form-found geometry; form : in which the erection began, None: no erection
    form_sections : datasets of /form_finding; sections : of other groups of the file; labels : attributes
    lines : to print; records : of checkpoints, by name; failure : error that ends the build-up, None: none
    left : largest residual and tension [N] under [load] at the end of the last stage of erection
    """

    base: Model | None = None
    form: Model | None = None
    form_sections: Mapping[str, np.ndarray] = field(default_factory=dict)
    sections: Mapping[str, dict[str, np.ndarray]] = field(default_factory=dict)
    labels: Mapping[str, dict[str, Any]] = field(default_factory=dict)
    lines: Sequence[str] = ()
    records: Mapping[str, tuple[dict[str, Any], dict[str, np.ndarray]]] = field(default_factory=dict)
    failure: DivergedError | None = None
    left: tuple[float, float] | None = None


@dataclass(frozen=True)
class Problem:
    """Problem definition of a run on one rank: the job with all that is needed to step.

    model : on rank 0, None elsewhere; finder : of equilibria of the state; digest : of job and net
    residual : [N], of the prestressed net with the real material
    reference : [N], largest tension of what can move, in the initial state
    build_up : how it follows from the form
    limits : of the step, by name; schedule : of the dynamic stage, None: the job has none
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
        """Return the error for which the run cannot continue from its initial state, None: it can."""
        return self.build_up.failure


def set_up_slip(problem: Problem) -> None:
    """Set up sliding cables for the equilibria of the problem, if there are any. Collective."""
    if problem.state.features.slip:
        layout = problem.model.layout if problem.model else None
        chains = problem.comm.bcast(layout and build_slip_chains(layout.slides, layout.net.own_weight))
        problem.finder.slips = Slips(problem.distribution, problem.state, chains)


@dataclass(frozen=True)
class RunContext:
    """Run context of a stage on one rank: output, progress, checkpoints.

    stop : stop flag; memory : cache of results that runs in this process share
    watch : is called with the state and snapshot of each equilibrium
    """

    log: EventLog
    result: Result
    saver: CheckpointWriter
    progress: Progress
    phases: PhaseTimes
    stop: StopFlag = NEVER_STOP
    memory: ResultCache = NO_CACHE
    watch: Callable[[State, Any], None] = lambda *_: None


class Outcome(NamedTuple):
    """Outcome of a stage.

    result : for stages after it, and for a study; lines : printed at its end
    sections : its small datasets by group of the file, on rank 0; attributes : of /provenance, likewise
    labels : attributes of groups of the file, likewise; failure : error that ends the run, None: it continues
    """

    result: Any = None
    lines: Sequence[str] = ()
    sections: Mapping[str, dict[str, np.ndarray]] = {}
    attributes: Mapping[str, Any] = {}
    labels: Mapping[str, dict[str, Any]] = {}
    failure: DivergedError | None = None
