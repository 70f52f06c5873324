"""Outcome of the search for an equilibrium under one load: record, numbers, attributes and text."""

from typing import Any, NamedTuple

import numpy as np

from netfall.core.messages import Message
from netfall.driver import messages
from netfall.driver.problem import Problem
from netfall.explicit.energy import Snapshot, take_snapshot
from netfall.job import derived
from netfall.job.job import Job
from netfall.model.actions import StaticLoad
from netfall.results import messages as results_messages
from netfall.results.datasets import NO_EQUILIBRIUM, UNDECIDED
from netfall.results.states import LIMIT_POINT, MOST_MARKED
from netfall.results.warning_text import AT_LIMIT
from netfall.statics import reactions
from netfall.statics.at_limit import beyond_euler, elements_at_limits
from netfall.statics.limit_point import LimitPoint
from netfall.statics.newton import UNKNOWN, Solution

MAX_LISTED_ELEMENTS = 100  # number of elements listed at a limit


class Equilibrium(NamedTuple):
    """Equilibrium and the state in it; slack : number of slack cables.

    balance : its reactions, and their balance with the loads
    at_limit : global numbers of elements at each limit of `AT_LIMIT` that is reached
    slip : datasets (k,) of the slip points, {} without any
    stopped : global numbers of elements of sliding cables whose stop is reached
    """

    snapshot: Snapshot
    slack: int
    solution: Solution
    balance: reactions.Balance
    at_limit: dict[str, tuple[int, ...]]
    slip: dict[str, list[float]]
    stopped: tuple[int, ...] = ()

    def numbers(self) -> dict[str, Any]:
        """Return the numbers that are stored in addition to the state."""
        return {"slack": self.slack, **self.solution._asdict(), **self.balance.numbers(), **self.slip}


class StaticOutcome(NamedTuple):
    """Outcome of the search for an equilibrium under one load. The state is in `equilibrium`.

    state : "equilibrium"; "unstable": compressed bars buckle; "no_equilibrium"; or "undecided"
    load_factor : reached, see `StaticLoad.factor`; nan: not known
    reason : text, ""; elements : global numbers at the limit, at most `MAX_LISTED_ELEMENTS`
    equilibrium : under `load_factor`; if none was found, the state before the search
    limit : the first limit point on the path or None; its share refers to the start of the load
    """

    state: str
    load_factor: float
    reason: str
    elements: tuple[int, ...]
    equilibrium: Equilibrium
    limit: LimitPoint | None = None

    @property
    def carries(self) -> bool:
        """Return whether an equilibrium was found under the whole load."""
        return self.state not in (NO_EQUILIBRIUM, UNDECIDED)

    def labels(self) -> dict[str, Any]:
        """Return the attributes of its group of the file, elements by their global numbers."""
        names = ("state", "load_factor", "reason", "elements")
        at_limit = {name: ids[:MOST_MARKED] for name, ids in self.equilibrium.at_limit.items()}
        limit = {} if self.limit is None else {LIMIT_POINT: self.limit.share}
        return {name: getattr(self, name) for name in names} | at_limit | limit


def equilibrium_record(problem: Problem, solution: Solution, load: np.ndarray) -> Equilibrium:
    """Build the record of the present equilibrium under a load (n, 3) [N]. Collective."""
    comm, state, slips = problem.comm, problem.state, problem.finder.slips
    snapshot = take_snapshot(state)
    balance = _balance(problem, snapshot, solution, load)
    slack = comm.allreduce(snapshot.slack)
    at_limit = elements_at_limits(comm, problem.distribution, state, snapshot)
    at_limit |= beyond_euler(comm, problem.job, problem.distribution, state, problem.model, snapshot.N)
    slip, stopped = ({}, ()) if slips is None else (slips.datasets(), slips.stopped())
    return Equilibrium(snapshot, slack, solution, balance, at_limit, slip, stopped)


def initial_equilibrium_record(problem: Problem) -> Equilibrium:
    """Build the record of an initial state from which no equilibrium was found. Collective."""
    snapshot, slips = take_snapshot(problem.state), problem.finder.slips
    slack, slip = problem.comm.allreduce(snapshot.slack), {} if slips is None else slips.datasets(False)
    solution = Solution(0, np.nan, np.nan, np.nan, False, UNKNOWN)
    return Equilibrium(snapshot, slack, solution, reactions.unknown(problem.state), {}, slip)


def rounding_above_tolerance(problem: Problem, solution: Solution, load: np.ndarray) -> float | None:
    """Return the least error that rounded coordinates allow, None if within the tolerance. Collective."""
    if not solution.error > derived.load_settings(problem.job).tolerance:
        return None
    newton = problem.finder.newton(load)
    return newton.rounding(newton.tangent())


def with_reactions(
    problem: Problem, outcome: StaticOutcome, load: np.ndarray, change: float
) -> StaticOutcome:
    """Return the outcome with reactions under a load (n, 3) [N] that differs by at most `change` [N].

    Collective. Each residual force may be larger by that change.
    """
    equilibrium = outcome.equilibrium
    solution = equilibrium.solution._replace(residual=equilibrium.solution.residual + change)
    balance = _balance(problem, equilibrium.snapshot, solution, load)
    return outcome._replace(equilibrium=equilibrium._replace(balance=balance))


def _balance(problem: Problem, snapshot: Snapshot, solution: Solution, load: np.ndarray) -> reactions.Balance:
    comm, state, slips = problem.comm, problem.state, problem.finder.slips
    tolerance = derived.load_settings(problem.job).tolerance
    return reactions.compute_balance(comm, state, snapshot, load, solution.residual, tolerance, slips)


def limit_warning(load_case: StaticLoad, limit: LimitPoint, node: int | None) -> str:
    """Return the warning of a limit point on the path to an equilibrium; node : id of the node that jumps."""
    parts = {"permanent": "these loads", "removal": "the lost forces"}
    parts |= dict.fromkeys(("stage", "target", "deviation"), "its changes")
    what, part = load_case.title, parts.get(load_case.kind)
    at = f"{limit.share:.4g} of {part}" if part else f"load factor {limit.share:.4g}"
    if limit.particle < 0:
        return results_messages.LIMIT_POINT(what=what, at=at)
    return results_messages.SNAP_THROUGH(what=what, at=at, node=node, jump=limit.jump)


def unstable_warning(what: str, p: int, node_id: np.ndarray) -> str:
    """Return the warning of an equilibrium that is, or may be (UNKNOWN), unstable at a particle."""
    if p == UNKNOWN:
        return messages.STABILITY_UNKNOWN(what=what)
    return messages.UNSTABLE(what=what, node=node_id[p])


def with_element_ids(labels: dict[str, Any], element_id: np.ndarray) -> dict[str, Any]:
    """Replace global numbers of elements by their ids (m,) in attributes of `StaticOutcome.labels`."""
    names = [name for name in ("elements", *AT_LIMIT) if name in labels]
    return labels | {name: element_id[list(labels[name])] for name in names}


def no_equilibrium(job: Job, load_case: StaticLoad, outcome: StaticOutcome) -> str:
    """Return the error for a load without an equilibrium, with the load factor reached and a remedy."""
    if outcome.state == UNDECIDED:
        return failure_text(messages.NO_EQUILIBRIUM, load_case.title, outcome)
    what, reason, factor = load_case.title, outcome.reason, outcome.load_factor
    if load_case.kind == "initial_state" and derived.starts_in_mean_wind(job):
        pressure, speed = _rounded_down(factor), _rounded_down(np.sqrt(factor))
        if job.wind and job.wind.pressures:
            return messages.NO_EQUILIBRIUM_UNDER_PRESSURES(what=what, reason=reason, pressure=pressure)
        return messages.NO_EQUILIBRIUM_IN_MEAN_WIND(what=what, reason=reason, pressure=pressure, speed=speed)
    keys = ["[load] steps = 0"] * bool(derived.load_steps(job))
    keys += ['[wind] onset = "sudden"'] * derived.starts_in_mean_wind(job)
    if keys and job.dynamics and not job.cases and not derived.starts_loaded_for_removal(job):
        changes = " and ".join(keys)
        return messages.NO_EQUILIBRIUM_AT_START(
            what=what, reason=reason, reached=reached(factor), keys=changes
        )
    return messages.NO_EQUILIBRIUM(what=what, reason=reason, reached=reached(factor))


def reached(factor: float, start: str = "") -> str:
    """Return the load factor reached as text; nan: none. start : text on the state of load factor 0"""
    return messages.LOAD_FACTOR_REACHED.format(factor=factor, start=start) if factor == factor else ""


def failure_text(
    message: Message, what: str, outcome: StaticOutcome, undecided: Message = messages.UNDECIDED
) -> str:
    """Return the message for a load without an equilibrium, or for an undecided search.

    message, undecided : the two messages; what : the load
    """
    if outcome.state == UNDECIDED:
        return undecided(what=what, reason=outcome.reason, factor=np.fmax(outcome.load_factor, 0.0))
    return message(what=what, reason=outcome.reason)


def _rounded_down(share: float) -> str:
    """Format a share so that a value below 1 does not read as 1."""
    return f"{np.floor(100.0 * share + 1e-9) / 100.0:.2f}"
