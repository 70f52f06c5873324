"""Number of ranks that is fastest for a job. The constants are measured (jobs/bench)."""

from netfall.driver import messages
from netfall.driver.problem import Problem

# Time on one core: ns per element and step, and us per step. Long rows of elements need less, fractures more.
STEP_NS, STEP_US = 5.0, 1.0
SMALL_NET_ELEMENTS = 5_000  # elements below which equilibria on several ranks are no faster
FEWEST = 900  # elements below which steps are no faster either
# share of the step time that a second rank saves between these sizes (1.2 to 1.5 times faster)
SECOND_RANK_SAVING = 0.26
RANK_START_S = 0.8  # s to start a second rank (0.5 to 1.2)
ELEMENTS_PER_RANK = 8_000  # per rank: with fewer, network messages take longer than the computation


def steps_time(problem: Problem) -> float:
    """Estimate the time of all steps on one core [s]."""
    if not problem.schedule:
        return 0.0
    steps = problem.schedule.steps // problem.schedule.stride
    return steps * (problem.distribution.m * STEP_NS * 1e-9 + STEP_US * 1e-6)


def saved_by_second(problem: Problem) -> float | None:
    """Estimate the time [s] that a second rank saves in a small net, less its start.

    None for a large net.
    """
    m = problem.distribution.m
    if m >= SMALL_NET_ELEMENTS:
        return None
    return (SECOND_RANK_SAVING * steps_time(problem) if m >= FEWEST else 0.0) - RANK_START_S


def ranks_line(problem: Problem) -> str:
    """Return a line on the fastest number of ranks."""
    saved = saved_by_second(problem)
    if saved is None:
        return (
            f"ranks: two are faster than one; many are, with {ELEMENTS_PER_RANK} elements for each and more"
        )
    if saved < 0.0:
        return f"ranks: one is fastest: a second takes about {RANK_START_S:g} s to start and saves less"
    return f"ranks: two save about {saved:.2g} s of the steps; equilibria of so small a net are no faster"


def ranks_notes(problem: Problem) -> list[str]:
    """Return a note if a run has more ranks than are useful."""
    saved = saved_by_second(problem)
    if problem.comm.size == 1 or saved is None or saved >= 0.0:
        return []
    m, size = problem.distribution.m, problem.comm.size
    return [messages.SLOW_RANKS(ranks=size, elements=m, seconds=steps_time(problem))]
