"""Single-process replacement of mpi4py, for `netfall check` without an MPI library.

A run needs the library (`alone.world_communicator`).
"""

from typing import Any

MAX, MIN, SUM, LOR, LAND, IN_PLACE = "max", "min", "sum", "lor", "land", "in place"
COMM_TYPE_SHARED, ANY_SOURCE = "shared", -1


class Exception(RuntimeError):
    """MPI error."""


class Request:
    """Completed request, since there are no messages."""

    @staticmethod
    def Waitall(requests: Any) -> None:
        """Return at once."""

    def Test(self) -> bool:
        """Return True: the request is complete."""
        return True


class Comm:
    """Communicator of one process."""

    rank, size = 0, 1

    def allreduce(self, value: Any, *_: Any) -> Any:
        """Return the value."""
        return value

    def allgather(self, value: Any, *_: Any) -> Any:
        """Return the value as a list of one rank."""
        return [value]

    def scatter(self, values: Any, *_: Any) -> Any:
        """Return the only value."""
        return values[0]

    def Allreduce(self, sent: Any, received: Any, *_: Any) -> None:
        """Copy the sent values to `received`."""
        if sent is not IN_PLACE:
            received[...] = sent

    def Barrier(self) -> Request:
        """Return at once."""
        return Request()

    def Split_type(self, *_: Any) -> "Comm":
        """Return a communicator of the same process."""
        return Comm()

    bcast = alltoall = allreduce
    gather = allgather
    Ibarrier = Free = Barrier


COMM_SELF = COMM_WORLD = Comm()


def Get_library_version() -> str:
    """Return a text in place of the version."""
    return "no MPI library"


def get_vendor() -> tuple[str, tuple[int, ...]]:
    """Return an empty vendor."""
    return "none", ()


def _handleof(_: Any) -> int:
    """Return a handle that is never used."""
    return 0
