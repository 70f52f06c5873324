"""What compiled code needs of the MPI library, by the library's own symbols; ordered memory access."""

import re

import llvmlite.binding
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from netfall.ground.compile import inner_kernel
from netfall.parallel.mpi import MISSING, MPI
from netfall.parallel.no_library import NEVER_CALLED

FUNCTIONS = ("MPI_Startall", "MPI_Waitall", "MPI_Iprobe", "MPI_Wtime")


def _load_mpi_symbols() -> None:
    """Make the MPI library that mpi4py has loaded visible to compiled code."""
    if MISSING:
        for name in FUNCTIONS:
            llvmlite.binding.add_symbol(name, NEVER_CALLED)
        return
    with open("/proc/self/maps") as maps:
        for line in maps:
            path = line.split()[-1]
            if re.search(r"/libmpi(ch)?\.so", path):
                llvmlite.binding.load_library_permanently(path)
                return
    raise RuntimeError("mpi4py has loaded no libmpi that could be found")


_load_mpi_symbols()
_OPEN_MPI = MPI.get_vendor()[0] == "Open MPI"
# A request or communicator is a pointer in Open MPI, an integer in MPICH.
HANDLE = np.uint64 if _OPEN_MPI else np.int32
IGNORE = 0 if _OPEN_MPI else 1  # MPI_STATUS_IGNORE, MPI_STATUSES_IGNORE
ANY_SOURCE, UNUSED_TAG = int(MPI.ANY_SOURCE), 1
start_all = types.ExternalFunction(FUNCTIONS[0], types.intc(types.intc, types.uintp))
wait_all = types.ExternalFunction(FUNCTIONS[1], types.intc(types.intc, types.uintp, types.uintp))
probe = types.ExternalFunction(
    FUNCTIONS[2],
    types.intc(types.intc, types.intc, types.uintp if _OPEN_MPI else types.intc, types.uintp, types.uintp),
)
wall_time = types.ExternalFunction(FUNCTIONS[3], types.float64())
yield_processor = types.ExternalFunction("sched_yield", types.intc())


@intrinsic
def announce(typing, address, number):
    """Write a number to an address after all that was written before it."""

    def write(context, builder, signature, values):
        builder.store_atomic(
            values[1], builder.inttoptr(values[0], ir.IntType(64).as_pointer()), "release", 8
        )
        return context.get_dummy_value()

    return types.none(types.uint64, types.int64), write


@intrinsic
def announced(typing, address):
    """Read the number at an address before all that is read after it."""

    def read(context, builder, signature, values):
        return builder.load_atomic(builder.inttoptr(values[0], ir.IntType(64).as_pointer()), "acquire", 8)

    return types.int64(types.uint64), read


@inner_kernel
def lap(seconds, k, since):
    """Add the time since a lap began to seconds[k] [s]; when the next begins. None: nothing is timed."""
    if seconds is None:
        return 0.0
    now = wall_time()
    if k >= 0:
        seconds[k] += now - since
    return now
