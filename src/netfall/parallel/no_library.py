"""What one process needs of MPI, with the names of mpi4py: for `netfall check` where there is no MPI library.

A run needs the library (`alone.world`).
"""

MAX, MIN, SUM, LOR, LAND, IN_PLACE = "max", "min", "sum", "lor", "land", "in place"
COMM_TYPE_SHARED, ANY_SOURCE = "shared", -1


class Exception(RuntimeError):
    """An error of MPI."""


class Request:
    """A request that has ended: there are no messages."""

    @staticmethod
    def Waitall(requests) -> None:
        """Wait for no message."""

    def Test(self) -> bool:
        """Tell that it has ended."""
        return True


class Comm:
    """A communicator of one process: what it is given is what comes of all ranks."""

    rank, size = 0, 1

    def allreduce(self, value, *_):
        """Return the value."""
        return value

    def allgather(self, value, *_):
        """Return the value of the only rank."""
        return [value]

    def scatter(self, values, *_):
        """Return the only value."""
        return values[0]

    def Allreduce(self, sent, received, *_) -> None:
        """Leave in `received` what the only rank has sent."""
        if sent is not IN_PLACE:
            received[...] = sent

    def Barrier(self) -> Request:
        """Wait for nobody."""
        return Request()

    def Split_type(self, *_) -> "Comm":
        """Return a communicator of the same process."""
        return Comm()

    bcast = alltoall = allreduce
    gather = allgather
    Ibarrier = Free = Barrier


COMM_SELF = COMM_WORLD = Comm()


def Get_library_version() -> str:
    """Say that there is no library."""
    return "no MPI library"


def get_vendor() -> tuple[str, tuple[int, ...]]:
    """Name no maker."""
    return "none", ()


def _handleof(_) -> int:
    """Return a handle that nobody uses."""
    return 0
