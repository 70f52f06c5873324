"""The static stage of a run whose job asks for the same equilibria as an earlier one of this process."""

from netfall.job.memory import key_of
from netfall.stages.statics import (
    Settled,
    StaticPath,
    equilibria,
    find_equilibria,
    note,
    put_back,
    to_the_start,
)


def find_or_recall(run) -> StaticPath:
    """`find_equilibria` from the start, or what it found in an earlier run of this process. Collective."""
    if not run.memory.most:
        return find_equilibria(run, None, None)
    fresh, seen = [], []

    def find() -> list[tuple[Settled, dict]]:
        fresh.append(find_equilibria(run, None, None, seen))
        return seen

    key = run.comm.bcast(key_of(run.job) if run.comm.rank == 0 else None)
    known = run.memory.once("statics", key, find)
    return fresh[0] if fresh else _again(run, known)


def _again(run, known: list[tuple[Settled, dict]]) -> StaticPath:
    """The equilibria of an earlier run, with all that `find_equilibria` does about them. Collective."""
    path = StaticPath()
    for each, (found, there) in zip(equilibria(run), known):
        put_back(run.setup.state, there)
        note(run, path, each, found)
    if each.kind == "case":
        to_the_start(run)
    return path
