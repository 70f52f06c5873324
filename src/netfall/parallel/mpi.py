"""MPI through mpi4py; without an MPI library, the single-process replacement that `netfall check` needs.

Importing this module starts MPI (`alone.start_mpi` comes before it).
"""

import warnings

MISSING: str | None = None  # why there is no library

try:
    # mpi4py warns of a launcher of another MPI library, which `alone.world_communicator` refuses.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        from mpi4py import MPI
except (ImportError, RuntimeError) as error:  # mpi4py is installed but finds no library
    from netfall.parallel import no_library as MPI  # type: ignore[no-redef]

    MISSING = str(error).splitlines()[0]

__all__ = ["MISSING", "MPI"]
