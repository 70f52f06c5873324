"""MPI functions that compiled code calls by address, and ordered memory access.

A request or a communicator is a pointer in Open MPI, and a 32-bit integer in MPICH. The last entry of
`functions` identifies the library. All are passed in 64-bit registers.
"""

import ctypes
import re
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types

from netfall.core.arrays import FloatArray, IntArray, Integer
from netfall.core.kernels import address_caller, inner_kernel, intrinsic
from netfall.core.records import is_present
from netfall.parallel.mpi import MISSING, MPI

START_ALL, WAIT_ALL, PROBE, CLOCK, YIELD, MPICH = range(6)  # places in `functions`
ANY_SOURCE, UNUSED_TAG = int(MPI.ANY_SOURCE), 1
WORD = ir.IntType(64)


@cache
def functions() -> np.ndarray:
    """Return addresses (6,) of functions of the loaded MPI library; without one, only of sched_yield."""
    addresses = np.zeros(6, np.uint64)
    system = ctypes.CDLL(None)
    addresses[YIELD] = _address(system.sched_yield)
    if MISSING:
        return addresses
    with open("/proc/self/maps") as maps:
        paths = (line.split()[-1] for line in maps)
        path = next((path for path in paths if re.search(r"/libmpi(ch)?\.so", path)), None)
    if path is None:
        raise RuntimeError("mpi4py has loaded no libmpi that could be found")
    library = ctypes.CDLL(path)
    for index, name in ((START_ALL, "Startall"), (WAIT_ALL, "Waitall"), (PROBE, "Iprobe"), (CLOCK, "Wtime")):
        addresses[index] = _address(library[f"MPI_{name}"])
    addresses[MPICH] = MPI.get_vendor()[0] != "Open MPI"
    return addresses


def _address(function: Any) -> int:
    return ctypes.cast(function, ctypes.c_void_p).value or 0


def handles(made: list[Any]) -> np.ndarray:
    """Return the MPI handles of requests or communicators, as bytes."""
    numbers = np.array([MPI._handleof(item) % 2**64 for item in made], np.uint64)
    return (numbers.astype(np.int32) if functions()[MPICH] else numbers).view(np.uint8)


def handle(made: MPI.Comm) -> int:
    """Return the MPI handle of a request or communicator."""
    return MPI._handleof(made)


call, clock = address_caller(types.int32), address_caller(types.float64)


@inner_kernel
def count_of(functions: IntArray, requests: IntArray) -> int:
    """Return the number of requests in an array of bytes."""
    return requests.shape[0] // (4 if functions[MPICH] else 8)


@inner_kernel
def start_all(functions: IntArray, requests: IntArray) -> int:
    """Call MPI_Startall; return its error code. requests : (bytes,)"""
    return call(functions[START_ALL], (count_of(functions, requests), requests.ctypes.data))


@inner_kernel
def wait_all(functions: IntArray, requests: IntArray) -> int:
    """Call MPI_Waitall without statuses; return its error code. requests : (bytes,)"""
    ignore = functions[MPICH]  # MPI_STATUSES_IGNORE: null, 1 in MPICH
    return call(functions[WAIT_ALL], (count_of(functions, requests), requests.ctypes.data, ignore))


@inner_kernel
def progress_messages(functions: IntArray, comm: int) -> int:
    """Call MPI_Iprobe, which progresses messages; return its error code."""
    flag = np.zeros(1, np.int64)
    return call(functions[PROBE], (ANY_SOURCE, UNUSED_TAG, comm, flag.ctypes.data, functions[MPICH]))


@inner_kernel
def yield_processor(functions: IntArray) -> None:
    """Yield the processor to other processes."""
    call(functions[YIELD], (0,))


@intrinsic
def announce(typing: Any, address: Any, number: Any) -> tuple[Any, Callable[..., Any]]:
    """Write a number to an address, after all earlier writes (release)."""

    def write(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        builder.store_atomic(values[1], builder.inttoptr(values[0], WORD.as_pointer()), "release", 8)
        return context.get_dummy_value()

    return types.none(types.uint64, types.int64), write


@intrinsic
def announced(typing: Any, address: Any) -> tuple[Any, Callable[..., Any]]:
    """Read the number at an address, before all later reads (acquire)."""

    def read(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.load_atomic(builder.inttoptr(values[0], WORD.as_pointer()), "acquire", 8)

    return types.int64(types.uint64), read


@inner_kernel
def add_lap(seconds: FloatArray, k: Integer, lap_start: float, buffers: Any) -> float:
    """Add the time since the start of a lap to seconds[k] [s]; return the start of the next lap.

    k : below 0 the clock is only read; seconds : absent if nothing is timed
    """
    if not is_present(seconds):
        return 0.0
    now = clock(buffers.functions[CLOCK], (0,))
    if k >= 0:
        seconds[k] += now - lap_start
    return now
