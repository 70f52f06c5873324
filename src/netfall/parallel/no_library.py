"""What one process needs of MPI, with the names of mpi4py: for `netfall check` where there is no MPI library.

A run needs the library (`alone.world`).
"""

MAX, MIN, SUM, LOR, LAND, IN_PLACE = "max", "min", "sum", "lor", "land", "in place"
COMM_TYPE_SHARED, ANY_SOURCE = "shared", -1


class Exception(RuntimeError):
    """An error of MPI."""


class Request:
    """A message that is under way; there are none."""

    @staticmethod
    def Waitall(requests) -> None:
        """Wait for no message."""


class Done(Request):
    """A request that has ended."""

    def Test(self) -> bool:
        """Tell that it has ended."""
        return True


class Comm:
    """A communicator of one process: what it is given is what comes of all ranks."""

    rank, size = 0, 1

    def bcast(self, value, root=0):
        """Return the value."""
        return value

    def allreduce(self, value, op=SUM):
        """Return the value."""
        return value

    def allgather(self, value):
        """Return the value of the only rank."""
        return [value]

    def gather(self, value, root=0):
        """Return the value of the only rank."""
        return [value]

    def scatter(self, values, root=0):
        """Return the only value."""
        return values[0]

    def alltoall(self, values):
        """Return the values."""
        return values

    def Allreduce(self, sent, received, op=SUM) -> None:
        """Leave in `received` what the only rank has sent."""
        if sent is not IN_PLACE:
            received[...] = sent

    def Alltoall(self, sent, received) -> None:
        """Leave in `received` what the only rank has sent."""
        received[...] = sent

    def Barrier(self) -> None:
        """Wait for nobody."""

    def Ibarrier(self) -> Done:
        """Wait for nobody."""
        return Done()

    def Split_type(self, kind):
        """Return a communicator of the same process."""
        return Comm()

    def Free(self) -> None:
        """Give nothing back."""


COMM_SELF = COMM_WORLD = Comm()


def Get_library_version() -> str:
    """Say that there is no library."""
    return "no MPI library"


def get_vendor() -> tuple[str, tuple[int, ...]]:
    """Name no maker."""
    return "none", ()


def _handleof(made) -> int:
    """Return a handle that nobody uses."""
    return 0
