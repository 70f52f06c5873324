"""Collective work that raises its errors on every rank, so that no rank waits for a failed one."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from netfall.core.arrays import first_largest
from netfall.core.errors import InputError, note_on_every_rank
from netfall.parallel import messages
from netfall.parallel.mpi import MPI

POLL_SECONDS = 1e-3  # [s] during which a rank polls without sleeping
SLEEP_SHARE = 0.1  # sleep between two polls, relative to the time waited so far, ...
MAX_SLEEP = 0.02  # ... at most [s]


def sleeping_barrier(comm: MPI.Comm) -> None:
    """Wait at a barrier, sleeping between polls: MPI would use a full core next to a rank that compiles."""
    request, begin = comm.Ibarrier(), time.perf_counter()
    while not request.Test():
        waited = time.perf_counter() - begin
        if waited > POLL_SECONDS:
            time.sleep(min(SLEEP_SHARE * waited, MAX_SLEEP))


def union_of_ranks(comm: MPI.Comm, own: list[int]) -> tuple[int, ...]:
    """Return the values of all ranks, each once, in ascending order. Collective."""
    return tuple(sorted(set().union(*comm.allgather(own))))


def largest_of_ranks(comm: MPI.Comm, values: np.ndarray, gid: np.ndarray) -> tuple[float, int]:
    """Return the largest of values (n,) on all ranks and its least global number. Collective."""
    k = first_largest(values, gid) if len(values) else -1
    largest, number = max(comm.allgather((float(values[k]), -int(gid[k])) if k >= 0 else (-np.inf, 0)))
    return largest, -number


def _result_or_error(work: Callable[[], Any]) -> tuple[Any, Exception | None]:
    """Return the result of `work()`, or None and its error."""
    try:
        return work(), None
    except Exception as error:
        return None, error


def on_root(comm: MPI.Comm, work: Callable[[], Any]) -> Any:
    """Return the result of `work()` on rank 0, None on others; an error is raised on all. Collective."""
    result, error = _result_or_error(work) if comm.rank == 0 else (None, None)
    sleeping_barrier(comm)
    error = comm.bcast(error)
    if error is not None:
        note_on_every_rank(error)
        raise error
    return result


def on_all(comm: MPI.Comm, work: Callable[[], Any]) -> Any:
    """Return the result of `work()` on every rank; the lowest rank's error is raised on all. Collective."""
    result, error = _result_or_error(work)
    errors = [e for e in comm.allgather(error) if e is not None]
    if errors:
        note_on_every_rank(errors[0])
        raise errors[0]
    return result


def check_same_options(comm: MPI.Comm, options: dict[str, Any]) -> None:
    """Raise InputError if a rank was started with other options than rank 0."""
    first, *others = comm.allgather(options)
    for rank, given in enumerate(others, 1):
        for name, value in given.items():
            if value != first[name]:
                raise InputError(messages.OTHER_OPTIONS(name=name, first=first[name], rank=rank, value=value))
