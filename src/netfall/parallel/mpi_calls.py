"""What compiled code calls of the MPI library, by the addresses of its functions; ordered memory access.

A request or a communicator is a pointer in Open MPI, and an integer of 32 bits in MPICH. Which of the two
there is, the last number of the addresses tells. All are handed on in 64 bits, as registers are.
"""

import ctypes
import re
from functools import cache

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from netfall.core.kernels import calling, inner_kernel
from netfall.core.records import has
from netfall.parallel.mpi import MISSING, MPI

START_ALL, WAIT_ALL, PROBE, CLOCK, YIELD, MPICH = range(6)  # places in `functions`
ANY_SOURCE, UNUSED_TAG = int(MPI.ANY_SOURCE), 1
WORD = ir.IntType(64)


@cache
def functions() -> np.ndarray:
    """Addresses (6,) of the MPI library that mpi4py has loaded; without one no rank has neighbours."""
    found = np.zeros(6, np.uint64)
    of_system = ctypes.CDLL(None)
    found[YIELD] = _address(of_system.sched_yield)
    if MISSING:
        return found
    with open("/proc/self/maps") as maps:
        paths = (line.split()[-1] for line in maps)
        path = next((path for path in paths if re.search(r"/libmpi(ch)?\.so", path)), None)
    if path is None:
        raise RuntimeError("mpi4py has loaded no libmpi that could be found")
    library = ctypes.CDLL(path)
    for place, name in ((START_ALL, "Startall"), (WAIT_ALL, "Waitall"), (PROBE, "Iprobe"), (CLOCK, "Wtime")):
        found[place] = _address(library[f"MPI_{name}"])
    found[MPICH] = MPI.get_vendor()[0] != "Open MPI"
    return found


def _address(function) -> int:
    return ctypes.cast(function, ctypes.c_void_p).value


def handles(made: list) -> np.ndarray:
    """MPI's own handles of requests or communicators, as bytes."""
    words = np.array([MPI._handleof(one) % 2**64 for one in made], np.uint64)
    return (words.astype(np.int32) if functions()[MPICH] else words).view(np.uint8)


def handle(made) -> int:
    """MPI's own handle of one of these."""
    return MPI._handleof(made)


call, clock = calling(types.int32), calling(types.float64)


@inner_kernel
def count_of(functions, requests):
    """How many requests there are in so many bytes."""
    return requests.shape[0] // (4 if functions[MPICH] else 8)


@inner_kernel
def start_all(functions, requests):
    """MPI_Startall; its error code. requests : (bytes,)"""
    return call(functions[START_ALL], (count_of(functions, requests), requests.ctypes.data))


@inner_kernel
def wait_all(functions, requests):
    """MPI_Waitall without statuses; its error code. requests : (bytes,)"""
    ignore = functions[MPICH]  # MPI_STATUSES_IGNORE: null, 1 in MPICH
    return call(functions[WAIT_ALL], (count_of(functions, requests), requests.ctypes.data, ignore))


@inner_kernel
def look_for_messages(functions, comm):
    """MPI_Iprobe, which moves messages on; its error code."""
    found = np.zeros(1, np.int64)
    return call(functions[PROBE], (ANY_SOURCE, UNUSED_TAG, comm, found.ctypes.data, functions[MPICH]))


@inner_kernel
def yield_processor(functions):
    """Let others have the processor."""
    call(functions[YIELD], (0,))


@intrinsic
def announce(typing, address, number):
    """Write a number to an address after all that was written before it."""

    def write(context, builder, signature, values):
        builder.store_atomic(values[1], builder.inttoptr(values[0], WORD.as_pointer()), "release", 8)
        return context.get_dummy_value()

    return types.none(types.uint64, types.int64), write


@intrinsic
def announced(typing, address):
    """Read the number at an address before all that is read after it."""

    def read(context, builder, signature, values):
        return builder.load_atomic(builder.inttoptr(values[0], WORD.as_pointer()), "acquire", 8)

    return types.int64(types.uint64), read


@inner_kernel
def lap(seconds, k, since, buffers):
    """Add the time since a lap began to seconds[k] [s]; when the next begins. seconds absent: not timed."""
    if not has(seconds):
        return 0.0
    now = clock(buffers.functions[CLOCK], (0,))
    if k >= 0:
        seconds[k] += now - since
    return now
