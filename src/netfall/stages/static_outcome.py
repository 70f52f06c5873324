"""What came of the search for an equilibrium under one load: in numbers, attributes and words."""

from typing import NamedTuple

import numpy as np

from netfall.equilibrium.newton import Solution
from netfall.equilibrium.snap import LimitPoint
from netfall.job.asks import load_steps, rests_at_loss, rests_in_wind
from netfall.job.job import Job
from netfall.model.actions import ALL_LOADS, StaticLoad
from netfall.record.balance import Balance
from netfall.record.energy import Snapshot
from netfall.results.notes import AT_LIMIT, MOST_MARKED, limit_point_warning

EQUILIBRIUM, NONE, UNSTABLE = "equilibrium", "no_equilibrium", "unstable"
UNDECIDED = "undecided"  # the search ended: there may be an equilibrium
MOST_NAMED = 100  # elements where a net gives way


class Equilibrium(NamedTuple):
    """An equilibrium, and the state in it; slack : cables of the net.

    balance : its reactions, and how they balance the loads
    at_limit : elements, global numbers, of each of `AT_LIMIT` that there is: beyond a fracture strain, ...
    slip : (k,) [m] of each place where a cable slips, None: none does
    stopped : elements of such cables that their end stops, global numbers
    """

    snapshot: Snapshot
    slack: int
    solution: Solution
    balance: Balance
    at_limit: dict[str, tuple[int, ...]]
    slip: list[float] | None = None
    stopped: tuple[int, ...] = ()

    def numbers(self) -> dict:
        """What is kept of it besides the state."""
        slip = {} if self.slip is None else {"slip": self.slip}
        return {"slack": self.slack, **self.solution._asdict(), **self.balance.numbers(), **slip}


class StaticOutcome(NamedTuple):
    """What came of the search for an equilibrium under one load. The state stands in `equilibrium`.

    state : "equilibrium"; "unstable": one in which compressed bars buckle; "no_equilibrium"; or "undecided"
    load_factor : reached, see `StaticLoad.factor`; nan: not known
    reason : in words, ""; elements : global numbers, where it gives way, at most `MOST_NAMED`
    equilibrium : that under `load_factor`; where none was found, the state from which it began
    limit : the first limit point on the way, None: there is none; its share counts from where the load began
    """

    state: str
    load_factor: float
    reason: str
    elements: tuple[int, ...]
    equilibrium: Equilibrium
    limit: LimitPoint | None = None

    @property
    def carries(self) -> bool:
        """Whether an equilibrium was found under the whole load."""
        return self.state not in (NONE, UNDECIDED)

    def labels(self) -> dict:
        """Attributes of its group of the file, elements by their global numbers."""
        names = ("state", "load_factor", "reason", "elements")
        at_limit = {name: ids[:MOST_MARKED] for name, ids in self.equilibrium.at_limit.items()}
        limit = {} if self.limit is None else {"limit_load_factor": self.limit.share}
        return {name: getattr(self, name) for name in names} | at_limit | limit


def limit_warning(each: StaticLoad, limit: LimitPoint, node: int | None) -> str:
    """A warning of a limit point on the path to an equilibrium; node : the id of that which jumps."""
    at = {"permanent": f"{limit.share:.4g} of them", "stage": f"{limit.share:.4g} of its changes"}
    at = at.get(each.kind, f"load factor {limit.share:.4g}")
    return limit_point_warning(each.words, at, node if limit.particle >= 0 else None, limit.jump)


def by_ids(labels: dict, element_id: np.ndarray) -> dict:
    """Attributes of a group of the file, as of `StaticOutcome.labels`, with elements by their ids (m,)."""
    names = [name for name in ("elements", *AT_LIMIT) if name in labels]
    return labels | {name: element_id[list(labels[name])] for name in names}


def no_equilibrium(job: Job, each: StaticLoad, outcome: StaticOutcome) -> str:
    """That a load has no equilibrium, or that none was found, how far it was carried, what to do."""
    if outcome.state == UNDECIDED:
        return undecided(each.words, outcome)
    factor = outcome.load_factor
    reached = f" (load factor reached {factor:.4g})" if factor == factor else ""
    what = f"under {each.words} " if outcome.elements else f"{each.words}: "
    return f"{what}{outcome.reason}{reached}{_advice(job, each)}"


def undecided(words: str, outcome: StaticOutcome) -> str:
    """That the search for an equilibrium has ended without one, and what to do. words : what acts"""
    factor = outcome.load_factor
    up_to = f"; an equilibrium was found up to load factor {factor:.4g}" if factor > 0.0 else ""
    return f"{words}: undecided: {outcome.reason}{up_to}. {NOT_A_PROOF} {WHAT_TO_DO}"


NOT_A_PROOF = "This does not show that the load cannot be carried."
WHAT_TO_DO = (
    "Raise [load] max_iterations, apply the load in more steps, or give coordinates nearer to the equilibrium"
)


def _advice(job: Job, each: StaticLoad) -> str:
    if each.kind == "case" or each.kind == "rest":
        return f": there is no equilibrium under {'it' if each.words != ALL_LOADS else 'them'}"
    keys = ["[load] steps = 0"] * bool(load_steps(job))
    keys += ['[wind] onset = "sudden"'] * rests_in_wind(job)
    at_once = job.dynamics and not job.cases and not rests_at_loss(job)
    return ": there is no static equilibrium to start from; lower the load" + (
        f", or set {' and '.join(keys)} to let it act at once in the dynamic stage" if at_once else ""
    )
