"""The MPI library, as mpi4py has it; without a library the one process that `netfall check` needs.

Importing this module starts MPI (`alone.start_alone` comes before it).
"""

import warnings

try:
    with warnings.catch_warnings():  # mpi4py's of the launcher of another MPI, which `alone.world` refuses
        warnings.simplefilter("ignore", RuntimeWarning)
        from mpi4py import MPI
except (ImportError, RuntimeError) as error:  # mpi4py is there, and finds no library
    from netfall.parallel import no_library as MPI

    MISSING = str(error).splitlines()[0]
else:
    MISSING = None

__all__ = ["MISSING", "MPI"]
