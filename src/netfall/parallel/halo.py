"""The exchange of halo particle forces, once a step.

Ranks of one node share a piece of memory: each puts there what its neighbours need, then the number of the exchange, for which
these look. Neighbours on other nodes get a message, by persistent requests made by mpi4py. Compiled code does both, the latter
through the MPI library's own symbols, so that the time loop never returns to Python between steps.

Each rank has two boxes, used in turn. A rank fills one again only two exchanges later, when all its neighbours have announced the
exchange between, and so have read it: nobody needs to say that something has been read.
"""

import os
import re
from typing import NamedTuple

import llvmlite.binding
import numpy as np
from llvmlite import ir
from mpi4py import MPI
from numba import types
from numba.extending import intrinsic

from netfall.errors import InputError
from netfall.mechanics.compile import kernel
from netfall.parallel.distribute import Piece

LINE = 8  # numbers in a cache line; what one rank writes shares none with what another does
PATIENCE = 200  # looks, before others get the processor
PER_NODE = "NETFALL_RANKS_PER_NODE"  # environment: take so many ranks for a node


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
_HANDLE = (
    np.uint64 if _OPEN_MPI else np.int32
)  # a request or communicator is a pointer in Open MPI, an integer in MPICH
_IGNORE = 0 if _OPEN_MPI else 1  # MPI_STATUS_IGNORE, MPI_STATUSES_IGNORE
_ANY_SOURCE, _UNUSED_TAG = int(MPI.ANY_SOURCE), 1
_startall = types.ExternalFunction("MPI_Startall", types.intc(types.intc, types.uintp))
_waitall = types.ExternalFunction("MPI_Waitall", types.intc(types.intc, types.uintp, types.uintp))
_iprobe = types.ExternalFunction(
    "MPI_Iprobe",
    types.intc(types.intc, types.intc, types.uintp if _OPEN_MPI else types.intc, types.uintp, types.uintp),
)
_wall_time = types.ExternalFunction("MPI_Wtime", types.float64())
_sched_yield = types.ExternalFunction("sched_yield", types.intc())


@intrinsic
def _announce(typing, address, number):
    """Write a number to an address after all that was written before it."""

    def write(context, builder, signature, values):
        builder.store_atomic(
            values[1], builder.inttoptr(values[0], ir.IntType(64).as_pointer()), "release", 8
        )
        return context.get_dummy_value()

    return types.none(types.uint64, types.int64), write


@intrinsic
def _announced(typing, address):
    """Read the number at an address before all that is read after it."""

    def read(context, builder, signature, values):
        return builder.load_atomic(builder.inttoptr(values[0], ir.IntType(64).as_pointer()), "acquire", 8)

    return types.int64(types.uint64), read


class Mail(NamedTuple):
    """What compiled code needs for the exchange. The boxes of all ranks of the node stand in one array; places in it count in numbers.

    send_at : where this rank puts its first row; receive_at : (n_halo,) where it finds the row of each halo particle; other_box : from the first box to the second
    count : (1,) exchanges so far; own_count : address of this rank's announced count; counts : (k,) addresses of the neighbours' on the node
    requests : (2, r) of each box, for neighbours on other nodes; comm, found : for MPI_Iprobe
    """

    boxes: np.ndarray
    send_at: int
    receive_at: np.ndarray
    other_box: int
    count: np.ndarray
    own_count: int
    counts: np.ndarray
    requests: np.ndarray
    comm: int
    found: np.ndarray


@kernel
def open_box(mail):
    """Place of the box in use, to be added to `send_at` and `receive_at`."""
    return mail.other_box * (mail.count[0] % 2)


@kernel
def send_box(mail):
    """Let the neighbours have the box; MPI's error code, 0 for success."""
    mail.count[0] += 1
    if mail.counts.shape[0] > 0:
        _announce(mail.own_count, mail.count[0])
    if mail.requests.shape[1] > 0:
        return _startall(mail.requests.shape[1], mail.requests[(mail.count[0] - 1) % 2].ctypes.data)
    return 0


@kernel
def wait_for_boxes(mail):
    """Wait until the neighbours' boxes are there; MPI's error code, 0 for success."""
    for k in range(mail.counts.shape[0]):
        looks = 0
        while _announced(mail.counts[k]) < mail.count[0]:
            looks += 1
            if (
                looks % PATIENCE == 0
            ):  # someone may need this processor, or a message that MPI sends on only when called
                error = _iprobe(_ANY_SOURCE, _UNUSED_TAG, mail.comm, mail.found.ctypes.data, _IGNORE)
                if error != 0:
                    return error
                _sched_yield()
    if mail.requests.shape[1] > 0:
        return _waitall(mail.requests.shape[1], mail.requests[(mail.count[0] - 1) % 2].ctypes.data, _IGNORE)
    return 0


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
def exchange_rows(rows, n_owned, send_index, mail):
    """Owners' rows (n, width) to the halo copies; MPI's error code, 0 for success."""
    width, box = rows.shape[1], open_box(mail)
    for i in range(send_index.shape[0]):
        for k in range(width):
            mail.boxes[mail.send_at + box + i * width + k] = rows[send_index[i], k]
    error = send_box(mail)
    if error == 0:
        error = wait_for_boxes(mail)
    for i in range(mail.receive_at.shape[0]):
        for k in range(width):
            rows[n_owned + i, k] = mail.boxes[mail.receive_at[i] + box + k]
    return error


def _node_of(comm: MPI.Comm) -> MPI.Comm:
    """The ranks that share memory with this one. Collective."""
    asked = os.environ.get(PER_NODE)
    if asked is None:
        return comm.Split_type(MPI.COMM_TYPE_SHARED)
    if not asked.isdigit() or int(asked) < 1:
        raise InputError(
            f"environment variable {PER_NODE}: {asked!r}; allowed is a number of ranks from 1; unset it to share memory where the ranks can"
        )
    node = comm.Split_type(MPI.COMM_TYPE_SHARED)
    part = node.Split(comm.rank // int(asked))
    node.Free()
    return part


class Halo:
    """Boxes and persistent requests for one row of `width` numbers per boundary particle."""

    def __init__(self, comm: MPI.Comm, piece: Piece, width: int):
        """Collective."""
        self.n_owned = piece.n_owned
        self.send_index = piece.send_index
        self._made, self._window = [], None
        node = _node_of(comm)
        sends, receives = (
            np.concatenate([[0], np.cumsum(counts)]).astype(int)
            for counts in (piece.send_counts, piece.receive_counts)
        )
        lines = -(-(sends[-1] + receives[-1]) * width // LINE)
        box = LINE * node.allreduce(int(lines), MPI.MAX)
        whole = LINE + 2 * box  # a rank's: its count, and its boxes
        boxes = self._share(node, whole)
        mine = node.rank * whole
        boxes[mine : mine + whole] = 0.0
        others = dict(
            node.allgather((comm.rank, (node.rank * whole, dict(zip(piece.neighbours, sends.tolist())))))
        )  # also: all are zero
        near = [neighbour in others for neighbour in piece.neighbours]
        receive_at, requests = np.zeros(piece.n_halo, np.int64), [[], []]
        for k, neighbour in enumerate(piece.neighbours):
            if near[k]:
                start = others[neighbour][0] + LINE + others[neighbour][1][comm.rank] * width
            else:
                start = mine + LINE + (sends[-1] + receives[k]) * width
                for turn in range(2):
                    part = lambda first, last: boxes[
                        mine + LINE + turn * box + first * width : mine + LINE + turn * box + last * width
                    ]
                    requests[turn].append(
                        comm.Recv_init(part(sends[-1] + receives[k], sends[-1] + receives[k + 1]), neighbour)
                    )
                    requests[turn].append(comm.Send_init(part(sends[k], sends[k + 1]), neighbour))
            receive_at[receives[k] : receives[k + 1]] = (
                start + np.arange(receives[k + 1] - receives[k]) * width
            )
        node.Free()
        self._made = requests[0] + requests[1]
        address = boxes.ctypes.data
        handles = lambda made: np.array([MPI._handleof(one) % 2**64 for one in made], np.uint64).astype(
            _HANDLE
        )
        self.mail = Mail(
            boxes,
            mine + LINE,
            receive_at,
            box,
            np.zeros(1, np.int64),
            np.uint64(address + 8 * mine),
            np.array(
                [
                    address + 8 * others[neighbour][0]
                    for neighbour, is_near in zip(piece.neighbours, near)
                    if is_near
                ],
                np.uint64,
            ),
            np.stack([handles(of_box) for of_box in requests]),
            handles([comm])[0],
            np.zeros(1, np.int32),
        )

    def _share(self, node: MPI.Comm, whole: int) -> np.ndarray:
        """The boxes of all ranks of the node, `whole` numbers each."""
        if node.size == 1:
            return np.zeros(whole)
        self._window = MPI.Win.Allocate_shared(8 * whole * node.size if node.rank == 0 else 0, 8, comm=node)
        self._window.Lock_all(MPI.MODE_NOCHECK)
        return np.frombuffer(self._window.Shared_query(0)[0], np.float64)

    def update(self, rows: np.ndarray) -> None:
        """Give the owners' rows (n, width) to the halo copies. Collective among neighbours."""
        error = exchange_rows(rows, self.n_owned, self.send_index, self.mail)
        if error:
            raise MPI.Exception(error)

    def free(self) -> None:
        """Give the requests and the shared memory back to MPI. Collective."""
        for request in self._made:
            request.Free()
        if self._window is not None:
            self._window.Unlock_all()
            self._window.Free()
        self._made, self._window = [], None
