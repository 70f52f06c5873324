"""Records of equilibria: state, forces and reactions."""

import numpy as np

from netfall.driver.problem import Problem
from netfall.driver.static_outcome import Equilibrium, StaticOutcome
from netfall.explicit.energy import Snapshot, take_snapshot
from netfall.job.derived import load_settings
from netfall.statics.at_limit import beyond_euler, elements_at_limits
from netfall.statics.newton import UNKNOWN, Solution
from netfall.statics.reactions import Balance, compute_balance, unknown

NOT_FOUND = Solution(0, np.nan, np.nan, np.nan, False, UNKNOWN)


def equilibrium_record(problem: Problem, solution: Solution, load: np.ndarray) -> Equilibrium:
    """Build the record of the present equilibrium under a load (n, 3) [N]. Collective."""
    slips = problem.finder.slips
    snapshot = take_snapshot(problem.state, 0.0, 1.0, 0.0, 0.0)
    balance = _balance(problem, snapshot, solution, load)
    slack = problem.comm.allreduce(snapshot.slack)
    at_limit = elements_at_limits(problem.comm, problem.distribution, problem.state, snapshot)
    at_limit |= beyond_euler(
        problem.comm, problem.job, problem.distribution, problem.state, problem.model, snapshot.N
    )
    stopped = slips.stopped() if slips is not None else ()
    return Equilibrium(snapshot, slack, solution, balance, at_limit, _slips(problem), stopped)


def with_reactions(problem: Problem, outcome: StaticOutcome, load: np.ndarray) -> StaticOutcome:
    """Return the outcome with reactions under a load (n, 3) [N] that hardly differs. Collective."""
    equilibrium = outcome.equilibrium
    balance = _balance(problem, equilibrium.snapshot, equilibrium.solution, load)
    return outcome._replace(equilibrium=equilibrium._replace(balance=balance))


def _slips(problem: Problem) -> list[float] | None:
    """Return the slips of all slip points, None if no cable slides."""
    return None if problem.finder.slips is None else problem.finder.slips.s.tolist()


def initial_equilibrium_record(problem: Problem) -> Equilibrium:
    """Build the record of a state from which no equilibrium was found. Collective."""
    snapshot = take_snapshot(problem.state, 0.0, 1.0, 0.0, 0.0)
    slack, balance = problem.comm.allreduce(snapshot.slack), unknown(problem.state)
    return Equilibrium(snapshot, slack, NOT_FOUND, balance, {}, _slips(problem))


def _balance(problem: Problem, snapshot: Snapshot, solution: Solution, load: np.ndarray) -> Balance:
    tolerance, slips = load_settings(problem.job).tolerance, problem.finder.slips
    return compute_balance(problem.comm, problem.state, snapshot, load, solution.residual, tolerance, slips)
