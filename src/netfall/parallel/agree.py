"""Work whose errors reach every rank before any of them waits for another."""

import time
from collections.abc import Callable
from typing import Any

from netfall.parallel.mpi import MPI

SPIN = 1e-3  # s for which a rank waits awake
SLEEP = 0.1  # of the time waited so far: how long it sleeps between two looks, ...
LONGEST = 0.02  # ... at most [s]


def wait_asleep(comm: MPI.Comm) -> None:
    """A barrier that leaves the core to others: MPI waits awake, beside a rank that compiles or reads."""
    request, begin = comm.Ibarrier(), time.perf_counter()
    while not request.Test():
        waited = time.perf_counter() - begin
        if waited > SPIN:
            time.sleep(min(SLEEP * waited, LONGEST))


def all_of(comm: MPI.Comm, own) -> tuple:
    """What any rank has, each once, in ascending order. Collective."""
    return tuple(sorted(set().union(*comm.allgather(own))))


def on_root(comm: MPI.Comm, work: Callable[[], Any]) -> Any:
    """Result of `work()` on rank 0, None elsewhere. What it raises is raised on every rank. Collective."""
    result = error = None
    if comm.rank == 0:
        try:
            result = work()
        except Exception as raised:
            error = raised
    wait_asleep(comm)
    error = comm.bcast(error)
    if error is not None:
        error.on_every_rank = True
        raise error
    return result


def on_all(comm: MPI.Comm, work: Callable[[], Any]) -> Any:
    """Result of `work()` on every rank; an error is raised on all, the lowest rank's. Collective."""
    result = error = None
    try:
        result = work()
    except Exception as raised:
        error = raised
    errors = [e for e in comm.allgather(error) if e is not None]
    if errors:
        errors[0].on_every_rank = True
        raise errors[0]
    return result
