"""The exchange of halo particle forces, one message to each neighbour and step.

The requests are persistent ones made by mpi4py; compiled code starts and completes them through the MPI
library's own symbols, so that the time loop never returns to Python between steps.
"""

import re

import llvmlite.binding
import numpy as np
from mpi4py import MPI
from numba import types

from netfall.mechanics.compile import kernel
from netfall.parallel.distribute import Piece


def _load_mpi_symbols() -> None:
    """Make the MPI library that mpi4py has loaded visible to compiled code."""
    with open("/proc/self/maps") as maps:
        for line in maps:
            path = line.split()[-1]
            if re.search(r"/libmpi(ch)?\.so", path):
                llvmlite.binding.load_library_permanently(path)
                return
    raise RuntimeError("mpi4py has loaded no libmpi that could be found")


_load_mpi_symbols()
_OPEN_MPI = MPI.get_vendor()[0] == "Open MPI"
HANDLE = np.uint64 if _OPEN_MPI else np.int32  # a request is a pointer in Open MPI, an integer in MPICH
IGNORE_STATUSES = 0 if _OPEN_MPI else 1  # MPI_STATUSES_IGNORE
_startall = types.ExternalFunction("MPI_Startall", types.intc(types.intc, types.uintp))
_wall_time = types.ExternalFunction("MPI_Wtime", types.float64())
_waitall = types.ExternalFunction("MPI_Waitall", types.intc(types.intc, types.uintp, types.uintp))


@kernel
def start_all(requests):
    """Start the requests; MPI's error code, 0 for success."""
    if requests.shape[0] == 0:
        return 0
    return _startall(requests.shape[0], requests.ctypes.data)


@kernel
def wait_all(requests, ignore_statuses):
    """Wait for the requests; MPI's error code, 0 for success."""
    if requests.shape[0] == 0:
        return 0
    return _waitall(requests.shape[0], requests.ctypes.data, ignore_statuses)


@kernel
def lap(seconds, k, since):
    """Add the time since a lap began to seconds[k] [s]; when the next begins. None for seconds: nothing is timed."""
    if seconds is None:
        return 0.0
    now = _wall_time()
    if k >= 0:
        seconds[k] += now - since
    return now


@kernel
def exchange_rows(rows, n_owned, send_index, send, receive, requests, ignore_statuses):
    """Owners' rows (n, width) to the halo copies; MPI's error code, 0 for success."""
    for i in range(send_index.shape[0]):
        for k in range(send.shape[1]):
            send[i, k] = rows[send_index[i], k]
    error = start_all(requests)
    if error == 0:
        error = wait_all(requests, ignore_statuses)
    for i in range(receive.shape[0]):
        for k in range(send.shape[1]):
            rows[n_owned + i, k] = receive[i, k]
    return error


class Halo:
    """Buffers and persistent requests for one row of `width` numbers per boundary particle."""

    def __init__(self, comm: MPI.Comm, piece: Piece, width: int):
        self.n_owned = piece.n_owned
        self.send_index = piece.send_index
        self.send = np.zeros((len(piece.send_index), width))
        self.receive = np.zeros((piece.n_halo, width))
        self._made = []
        sent = received = 0
        for neighbour, sends, receives in zip(piece.neighbours, piece.send_counts, piece.receive_counts):
            self._made.append(comm.Recv_init(self.receive[received:received + receives], neighbour))
            self._made.append(comm.Send_init(self.send[sent:sent + sends], neighbour))
            sent, received = sent + sends, received + receives
        self.requests = np.array([MPI._handleof(request) % 2**64 for request in self._made], np.uint64).astype(HANDLE)

    def update(self, rows: np.ndarray) -> None:
        """Give the owners' rows (n, width) to the halo copies. Collective among neighbours."""
        error = exchange_rows(rows, self.n_owned, self.send_index, self.send, self.receive, self.requests, IGNORE_STATUSES)
        if error:
            raise MPI.Exception(error)

    def free(self) -> None:
        """Give the requests back to MPI."""
        for request in self._made:
            request.Free()
        self._made = []
