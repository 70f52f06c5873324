"""Search for one equilibrium of a problem, for its limit load factor, and interruption of the search."""

import numpy as np

from netfall.core.errors import DivergedError, Interrupted, interruption_error
from netfall.core.messages import without_code
from netfall.core.timings import StopFlag, StopRequested
from netfall.driver.problem import Problem, RunContext
from netfall.driver.statics.outcome import (
    MAX_LISTED_ELEMENTS,
    Equilibrium,
    StaticOutcome,
    equilibrium_record,
    initial_equilibrium_record,
)
from netfall.explicit.energy import Snapshot
from netfall.job.derived import breaks_equilibrium, load_settings
from netfall.model.actions import StaticLoad
from netfall.parallel.agree import union_of_ranks
from netfall.physics.state import restore_saved, save_state
from netfall.results.datasets import EQUILIBRIUM, NO_EQUILIBRIUM, UNDECIDED, UNSTABLE
from netfall.results.warning_text import INSTABILITY_TEXT
from netfall.statics import limit_load, relaxation
from netfall.statics.limit_load import NO_UTILISATION, LimitUtilisation, Trial
from netfall.statics.limit_point import LimitPoint, LoadPath, has_compression, load_on_path
from netfall.statics.newton import Newton, Solution
from netfall.statics.slip import Slips, find_with_slip
from netfall.statics.solver import Criterion

ROUGH_TOLERANCE = 1e-3  # estimated error [-] of trials in the search for the limit load factor
MAX_TRIAL_ITERATIONS = 20_000  # iterations of a relaxation in the search for the limit load factor
# kinds whose limit load factor is sought
LIMIT_LOAD_KINDS = ("permanent", "case", "combination", "step", "at once", "initial_state")
# kinds that may be a mechanism on the path, and kinds whose path is searched for limit points
HANGING_KINDS = ("stage", "removal", "target", "deviation")
LIMIT_POINT_KINDS = (*LIMIT_LOAD_KINDS, *HANGING_KINDS)
ALWAYS_FOLLOWED = (*LIMIT_LOAD_KINDS, "stage")
# kinds outside the sequence of the run; later equilibria do not start from them
SEPARATE = ("case", "combination")


def interrupted(problem: Problem, context: RunContext, stage: str, title: str, step: int) -> Interrupted:
    """Save a checkpoint and return the error of a run that was stopped in an equilibrium. Collective.

    The state is that before the equilibrium, which the resumed run repeats. step : number in the file name
    """
    return interruption_error(f"in statics, {title}", context.saver.save(stage, step, problem.state))


def reference_force(problem: Problem, last: StaticLoad) -> float:
    """Return the largest tension and nodal load [N] at free nodes, for the tolerance. Collective."""
    state = problem.state
    N, load = state.present_element_state().N, last.load[: state.n_owned]
    return relaxation.largest_force(problem.comm, N, state.ends, state.free, load)


def solve_equilibrium(
    problem: Problem,
    load_case: StaticLoad,
    reference: float | None,
    stop: StopFlag,
    max_iterations: int | None = None,
) -> StaticOutcome:
    """Bring the state to one equilibrium, and update plastic strains. Collective.

    reference : [N], of the tolerance, None: that of `reference_force`; stop : stop flag
    max_iterations : of a relaxation, None: as the job sets them

    If there is no equilibrium, the state depends on the load. If the load is one of `LIMIT_LOAD_KINDS` or if
    an element breaks, the state is the equilibrium under the limit load factor. Otherwise it is the initial
    state. An equilibrium has no fractures, except after member removal: there the elements beyond their
    strength are reported. If the stop flag is set, the state is restored and StopRequested is raised.
    """
    return Search(problem, load_case, reference, stop, max_iterations).outcome()


class Search:
    """Search for the equilibrium under one load; arguments as of `solve_equilibrium`. Methods are collective.

    start : the state without the load, as of `save_state`; missing_load : (n, 3) [N], not applied in it
    seeks_limit : whether to find the limit load factor

    Methods that search raise StopRequested if the stop flag is set.
    """

    def __init__(
        self,
        problem: Problem,
        load_case: StaticLoad,
        reference: float | None,
        stop: StopFlag,
        max_iterations: int | None,
    ):
        self.problem, self.load_case, self.stop = problem, load_case, stop
        self.reference = reference_force(problem, load_case) if reference is None else reference
        self.comm, self.state, self.finder = problem.comm, problem.state, problem.finder
        settings = load_settings(problem.job)
        self.tolerance, most = settings.tolerance, settings.max_iterations
        self.iterations = most if max_iterations is None else min(max_iterations, most)
        self.start = save_state(problem.state)
        self.seeks_limit = load_case.kind in LIMIT_LOAD_KINDS
        self.missing_load = np.zeros((0, 3))

    def outcome(self) -> StaticOutcome:
        """Search for the equilibrium and return the outcome."""
        try:
            full_load, equilibrium = self.try_load(self.load_case.load)
            if equilibrium is not None:
                return self.carried_outcome(equilibrium)
            if self.seeks_limit or full_load.reason == limit_load.BREAKS:
                return self.limit_outcome(full_load)
        except StopRequested:
            restore_saved(self.state, self.start)
            raise
        restore_saved(self.state, self.start)
        return self.failed_outcome(
            0.0, full_load, self.reason(full_load), initial_equilibrium_record(self.problem)
        )

    def failed_outcome(
        self,
        share: float,
        beyond: LimitUtilisation,
        reason: str,
        equilibrium: Equilibrium,
        limit: LimitPoint | None = None,
    ) -> StaticOutcome:
        """Return the outcome of a load that is carried only in part."""
        state = NO_EQUILIBRIUM if beyond.is_decided else UNDECIDED
        elements = beyond.elements[:MAX_LISTED_ELEMENTS]
        return StaticOutcome(state, self.load_case.reached(share), reason, elements, equilibrium, limit)

    def try_load(
        self, load: np.ndarray, roughly: bool = False
    ) -> tuple[LimitUtilisation, Equilibrium | None]:
        """Return the utilisation under a load, and its equilibrium if it exists within the limit.

        The state is then the last state of the search. roughly : see `find`
        """
        try:
            equilibrium = self.find(load, roughly)
        except relaxation.UnboundedDisplacement:
            return self.utilisation(False)._replace(most=np.inf), None
        except DivergedError as error:
            reason = without_code(str(error)).removeprefix(f"{self.load_case.title}: ").rstrip(".")
            return LimitUtilisation(np.inf, (), reason), None
        utilisation = NO_UTILISATION if self.load_case.kind == "removal" else self.utilisation()
        return utilisation, None if utilisation.reason else equilibrium

    def find(self, load: np.ndarray, roughly: bool = False) -> Equilibrium:
        """Find the equilibrium, without an update of plastic strains. Raises DivergedError.

        roughly : whether with the tolerance of a trial
        """
        iterations, tolerance, name = self.iterations, self.tolerance, self.load_case.title
        if roughly:
            iterations, tolerance = min(MAX_TRIAL_ITERATIONS, iterations), max(ROUGH_TOLERANCE, tolerance)
        solution = self.solve(load, Criterion(tolerance, self.reference, iterations, name))
        return equilibrium_record(self.problem, solution, load)

    def solve(self, load: np.ndarray, criterion: Criterion) -> Solution:
        """Bring the state to equilibrium, slips included; arguments as of `EquilibriumFinder.find`."""

        def find() -> Solution:
            return self.finder.find(load, criterion, self.stop)

        if self.finder.slips is None:
            return find()
        self.finder.slips.weights = self.load_case.weights
        return find_with_slip(self.finder, find, criterion.tolerance, criterion.name)

    def utilisation(self, breaks: bool | None = None) -> LimitUtilisation:
        """Return the utilisation of the state; breaks : whether fractures count, None: as for the load"""
        if breaks is None:
            breaks = breaks_equilibrium(self.problem.job, self.load_case.kind, self.load_case.factor)
        return limit_load.limit_utilisation_of(self.comm, self.problem.distribution, self.state, breaks)

    def reason(self, utilisation: LimitUtilisation) -> str:
        """Return the reason why there is no equilibrium, with elements by their ids."""
        if not utilisation.elements:
            return utilisation.reason
        model = self.problem.model
        name = self.comm.bcast(model and model.element_id_of(utilisation.elements[0]))
        return f"element {name} {utilisation.reason}"

    def carried_outcome(self, equilibrium: Equilibrium) -> StaticOutcome:
        """Return the outcome of an equilibrium under the whole load, with the limit point before it."""
        limit, equilibrium = self.find_limit_point(equilibrium)
        self.update_plastic_strains(equilibrium.snapshot)
        factor, buckling = self.load_case.factor, equilibrium.solution.unstable_at
        if buckling < 0:
            return StaticOutcome(EQUILIBRIUM, factor, "", (), equilibrium, limit)
        d, N = self.problem.distribution.subdomain, self.state.present_element_state().N
        # compressed elements at the particle that moves most in buckling
        is_compressed = (d.particle_gid[self.state.ends] == buckling).any(1) & (N < 0.0)
        elements = union_of_ranks(self.comm, d.element_gid[is_compressed].tolist())[:MAX_LISTED_ELEMENTS]
        reason = INSTABILITY_TEXT if elements else ""
        return StaticOutcome(UNSTABLE, factor, reason, elements, equilibrium, limit)

    def update_plastic_strains(self, snapshot: Snapshot) -> None:
        """Set the plastic strains of the state to those of an equilibrium."""
        if self.state.features.plastic:
            self.state.dissipated[:] = snapshot.heat
            self.state.eps_p[:] = snapshot.eps_p

    def find_limit_point(
        self, equilibrium: Equilibrium, carried: float = 1.0
    ) -> tuple[LimitPoint | None, Equilibrium]:
        """Find the limit point on the path to an equilibrium under a share `carried` of the load.

        The share of the limit point is converted to a load factor. If the path leads to another equilibrium
        without a limit point, the state and the result are that equilibrium.
        """
        load_case, state, finder, start = self.load_case, self.state, self.finder, self.start
        is_mechanism, is_unstable = load_case.kind in HANGING_KINDS, equilibrium.solution.unstable_at >= 0
        has_path = load_case.kind in LIMIT_POINT_KINDS
        if not has_path or not has_compression(self.comm, state) or (is_unstable and is_mechanism):
            return None, equilibrium
        before, end, slips = load_case.before or start, save_state(state), finder.slips
        restore_saved(state, start)
        if slips is not None:  # the slips of the equilibrium do not change
            finder.slips = Slips(slips.distribution, state, slips.chains)
            finder.slips.weights = load_case.weights
        load_at = load_on_path(finder, load_case.load, before, start, carried)
        criterion = Criterion(self.tolerance, self.reference, MAX_TRIAL_ITERATIONS, load_case.title)

        def newton_at(share: float) -> Newton:
            load = load_at(share)
            finder.settle_slips()
            return finder.newton(load)

        path = LoadPath(state, newton_at, lambda factor: self.solve(load_at(factor), criterion), is_mechanism)
        try:
            limit, x = None, end["x"]
            # the others mostly change little, and their paths take long to follow
            if load_case.kind in ALWAYS_FOLLOWED or path.may_snap(before["x"], x):
                limit, x = path.limit_point(before["x"], None if is_unstable else x)
        finally:
            finder.slips = slips
        restore_saved(state, end)
        if limit is None and not is_unstable and x is not end["x"]:
            state.x[:] = x
            equilibrium = self.find(load_at(1.0))
        if limit is None:
            return None, equilibrium
        share = limit.share * carried
        factor = share if load_case.kind == "permanent" else load_case.reached(share)
        return limit._replace(share=factor), equilibrium

    def limit_outcome(self, full_load: LimitUtilisation) -> StaticOutcome:
        """Return the outcome of a load that is not carried in full, with the state at its limit load factor.

        full_load : utilisation under the full load
        """
        restore_saved(self.state, self.start)
        self.missing_load = self.finder.residual(self.load_case.load)
        share, beyond, equilibrium = self.limit_by_trials(full_load)
        if share == 1.0:
            trial = save_state(self.state)
            beyond, precise = self.try_load(self.load_case.load)
            if precise is not None:
                return self.carried_outcome(precise)
            restore_saved(self.state, trial)
        limit_point = None
        share *= share > limit_load.MIN_LOAD_FACTOR
        if share > 0.0:
            limit_point, equilibrium = self.find_limit_point(equilibrium, share)
        self.update_plastic_strains(equilibrium.snapshot)
        beyond = beyond if beyond.is_decided else full_load
        reason = self.reason(beyond)
        if self.load_case.kind == "permanent" and beyond.is_decided:
            reason += f" at {share:.4g} of these loads"
        return self.failed_outcome(share, beyond, reason, equilibrium, limit_point)

    def say_bracket(self, low: float, high: float) -> None:
        """Report the bracket of the limit load factor."""
        text = f"{self.load_case.title}: searching the limit load factor"
        self.finder.report(f"{text}, {low:.3g} to {high:.3g}")

    def limit_by_trials(self, full_load: LimitUtilisation) -> tuple[float, LimitUtilisation, Equilibrium]:
        """Find the limit load factor by trials of factors, to a rough tolerance.

        Returns the factor, `LimitUtilisation` beyond it, and `Equilibrium`.

        Each starts from the state of the largest load carried so far. So the load only grows: with bars under
        compression, or friction of cables that slip, the equilibrium depends on the path.
        """
        state, best, equilibrium = self.state, self.start, initial_equilibrium_record(self.problem)

        def load_at(share: float) -> np.ndarray:
            return self.load_case.load - (1.0 - share) * self.missing_load

        def trial(share: float) -> Trial:
            nonlocal best, equilibrium
            restore_saved(state, best)
            utilisation, trial_equilibrium = self.try_load(load_at(share), roughly=True)
            if trial_equilibrium is not None:
                best, equilibrium = save_state(state), trial_equilibrium
            return Trial(share, utilisation)

        low, high = Trial(0.0, self.utilisation()), Trial(1.0, full_load)
        low, high = limit_load.search_limit(trial, low, high, self.say_bracket)
        restore_saved(state, best)
        if 0.0 < low.factor < 1.0:
            try:
                equilibrium = self.find(load_at(low.factor))
            except DivergedError:  # the result keeps the estimated error of the trial
                restore_saved(state, best)
        return low.factor, high.utilisation, equilibrium


def yielded(problem: Problem) -> tuple[int, ...]:
    """List global numbers of the elements that have yielded so far. Collective."""
    if not problem.state.features.plastic:
        return ()
    element_gid = problem.distribution.subdomain.element_gid
    return union_of_ranks(problem.comm, element_gid[problem.state.eps_p != 0.0].tolist())
