"""Exchange of halo particle forces, once per step: pack, send, unpack.

Ranks of one node share memory. Each rank writes the data for its neighbours into shared memory, then the
number of the exchange, which the neighbours poll. Neighbours on other nodes get a message, by persistent
requests created with mpi4py. Compiled code does both and calls the MPI library directly, so that the time
loop does not return to Python between steps.

Each rank has two buffers, used in turn. A rank refills a buffer two exchanges later. By then all its
neighbours have announced the exchange in between, and so have read the buffer. No acknowledgement is needed.
"""

import os
from typing import Any

import numpy as np

from netfall.core.arrays import FloatArray
from netfall.core.errors import InputError
from netfall.core.kernels import copied_kernel, inner_kernel, kernel
from netfall.core.records import Record, f8, i8, is_present, u1_2, u4, u8, whole
from netfall.parallel import messages
from netfall.parallel.mpi import MPI
from netfall.parallel.mpi_calls import (
    announce,
    announced,
    functions,
    handle,
    handles,
    progress_messages,
    start_all,
    wait_all,
    yield_processor,
)
from netfall.parallel.subdomain import Subdomain
from netfall.physics.fields import Particles
from netfall.physics.particle_step import inverse_mass

LINE = 8  # numbers per cache line; no two ranks write to the same line
POLLS_BEFORE_YIELD = 200  # polls before the processor is yielded
PER_NODE = "NETFALL_RANKS_PER_NODE"  # environment variable: number of ranks to treat as a node


class HaloBuffers(Record):
    """Data of the exchange for compiled code; the buffers of all ranks of the node are in one array.

    send_index : local rows of the boundary particles, in the order in which they are sent
    numbers : the buffers; the places below are indices into it
    send_at : place of the first row of this rank
    receive_at : (n_halo,) place of the row of each halo particle
    to_second : distance from the first buffer of a rank to its second
    count : (1,) exchanges so far; own_count : address of this rank's announced count
    counts : (k,) addresses of the counts of neighbours on the node
    requests : (2, bytes) of each buffer, for neighbours on other nodes; comm : communicator of these
    width : numbers sent for each particle
    functions : addresses, see `mpi_calls.functions`
    """

    send_index: u4
    numbers: f8
    send_at: whole
    receive_at: i8
    to_second: whole
    count: i8
    own_count: whole
    counts: u8
    requests: u1_2
    comm: whole
    width: whole
    functions: u8


@inner_kernel
def current_buffer(buffers: HaloBuffers) -> int:
    """Return the place of the buffer of this exchange, to be added to `send_at` and `receive_at`."""
    return buffers.to_second * (buffers.count[0] % 2)


@inner_kernel
def send_buffer(buffers: HaloBuffers) -> int:
    """Publish the buffer to the neighbours; return MPI's error code, 0 for success."""
    buffers.count[0] += 1
    if buffers.counts.shape[0] > 0:
        announce(buffers.own_count, buffers.count[0])
    if buffers.requests.shape[1] > 0:
        return start_all(buffers.functions, buffers.requests[(buffers.count[0] - 1) % 2])
    return 0


@inner_kernel
def wait_for_neighbours(buffers: HaloBuffers) -> int:
    """Wait for the buffers of the neighbours; return MPI's error code, 0 for success."""
    for k in range(buffers.counts.shape[0]):
        polls = 0
        while announced(buffers.counts[k]) < buffers.count[0]:
            polls += 1
            # Another process may need this processor; MPI may progress messages only when called.
            if polls % POLLS_BEFORE_YIELD == 0:
                error = progress_messages(buffers.functions, buffers.comm)
                if error != 0:
                    return error
                yield_processor(buffers.functions)
    if buffers.requests.shape[1] > 0:
        return wait_all(buffers.functions, buffers.requests[(buffers.count[0] - 1) % 2])
    return 0


# --- rows of a step: total force; with fracture also mass and valence, which the halo cannot compute; slips


@inner_kernel
def fixed_width(particles: Particles) -> int:
    """Return how many numbers are sent for each particle before its slip velocities."""
    if not is_present(particles.valence):
        return 3
    return 6 if is_present(particles.air_mass) else 5


@copied_kernel
def pack_forces(particles: Particles, buffer: int, buffers: HaloBuffers) -> None:
    """Pack the rows of the boundary particles. buffer : place of the buffer, from `current_buffer`

    A row contains the total force; with fracture also mass, valence and added mass of the air; slip
    velocities.
    """
    fixed, width, numbers = fixed_width(particles), buffers.width, buffers.numbers
    for i in range(buffers.send_index.shape[0]):
        p, row = buffers.send_index[i], buffers.send_at + buffer + i * width
        for k in range(3):
            numbers[row + k] = particles.f[k, p]
        if fixed > 3:
            numbers[row + 3] = particles.mass[p]
            numbers[row + 4] = particles.valence[p]
        if fixed > 5:
            numbers[row + 5] = particles.air_mass[p]
        for k in range(width - fixed):
            numbers[row + fixed + k] = particles.slip_v[k, p]


@copied_kernel
def unpack_forces(n_owned: int, particles: Particles, buffer: int, buffers: HaloBuffers) -> None:
    """Unpack the received rows of the halo particles. buffer : as in `pack_forces`"""
    fixed, width, numbers = fixed_width(particles), buffers.width, buffers.numbers
    for i in range(buffers.receive_at.shape[0]):
        p, row = n_owned + i, buffers.receive_at[i] + buffer
        for k in range(3):
            particles.f[k, p] = numbers[row + k]
        if fixed > 3:
            particles.mass[p] = numbers[row + 3]
            if particles.per_mass[p] != 0.0:
                particles.per_mass[p] = inverse_mass(particles.mass[p])
            particles.valence[p] = int(numbers[row + 4])
        if fixed > 5:
            particles.air_mass[p] = numbers[row + 5]
        for k in range(width - fixed):
            particles.slip_v[k, p] = numbers[row + fixed + k]


# --- rows of any kind


@kernel
def exchange_rows(sent: FloatArray, arrived: FloatArray, buffers: HaloBuffers) -> int:
    """Send rows (k, width) of boundary particles, receive those (h, width) of the halo; return the error."""
    width, buffer = sent.shape[1], current_buffer(buffers)
    for i in range(sent.shape[0]):
        for k in range(width):
            buffers.numbers[buffers.send_at + buffer + i * width + k] = sent[i, k]
    error = send_buffer(buffers)
    if error != 0:
        return error
    error = wait_for_neighbours(buffers)
    for i in range(arrived.shape[0]):
        for k in range(width):
            arrived[i, k] = buffers.numbers[buffers.receive_at[i] + buffer + k]
    return error


def _node_of(comm: MPI.Comm) -> MPI.Comm:
    """Return the communicator of the ranks that share memory with this one. Collective."""
    setting = os.environ.get(PER_NODE)
    if setting is None:
        return comm.Split_type(MPI.COMM_TYPE_SHARED)
    if not setting.isdigit() or int(setting) < 1:
        raise InputError(messages.WRONG_RANKS_PER_NODE(variable=PER_NODE, value=setting))
    node = comm.Split_type(MPI.COMM_TYPE_SHARED)
    smaller = node.Split(comm.rank // int(setting))
    node.Free()
    return smaller


def _first_places(counts: tuple[int, ...], width: int) -> np.ndarray:
    """Return the place in a buffer of each neighbour's first row, and the end (neighbours + 1,)."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(int) * width


class Halo:
    """Buffers and persistent requests for one row of `width` numbers per boundary particle."""

    def __init__(self, comm: MPI.Comm, subdomain: Subdomain, width: int):
        """Allocate the buffers and create the requests. Collective."""
        index = subdomain.send_index
        self.boundary = int(index.max()) + 1 if len(index) else 0  # leading rows with all boundary particles
        self.comm, self.n_owned, self.width = comm, subdomain.n_owned, width
        self._window: Any = None
        node = _node_of(comm)
        sends = _first_places(subdomain.send_counts, width)
        receives = _first_places(subdomain.receive_counts, width)
        size = LINE * node.allreduce(int(-(-(sends[-1] + receives[-1]) // LINE)), MPI.MAX)
        stride = LINE + 2 * size  # of a rank: its count, and its buffers
        numbers, own_place = self._share(node, stride), node.rank * stride
        numbers[own_place : own_place + stride] = 0.0
        send_places = dict(zip(subdomain.neighbours, sends.tolist()))
        # The allgather is also a barrier: afterwards all buffers are zero.
        others = dict(node.allgather((comm.rank, (node.rank * stride, send_places))))
        shares_memory = [neighbour in others for neighbour in subdomain.neighbours]
        receive_at = [np.zeros(0, np.int64)]
        requests: tuple[list[Any], list[Any]] = ([], [])
        for k, neighbour in enumerate(subdomain.neighbours):
            if shares_memory[k]:
                start = others[neighbour][0] + LINE + others[neighbour][1][comm.rank]
            else:
                start = own_place + LINE + sends[-1] + receives[k]
                for turn in range(2):
                    own_buffer = numbers[own_place + LINE + turn * size :]
                    inbox = own_buffer[sends[-1] + receives[k] : sends[-1] + receives[k + 1]]
                    requests[turn].append(comm.Recv_init(inbox, neighbour))
                    requests[turn].append(comm.Send_init(own_buffer[sends[k] : sends[k + 1]], neighbour))
            receive_at.append(start + np.arange(0, receives[k + 1] - receives[k], width))
        node.Free()
        self._made: list[Any] = requests[0] + requests[1]
        address = numbers.ctypes.data
        on_node = [
            others[neighbour][0] for neighbour, shares in zip(subdomain.neighbours, shares_memory) if shares
        ]
        self.buffers = HaloBuffers(
            send_index=subdomain.send_index,
            numbers=numbers,
            send_at=own_place + LINE,
            receive_at=np.concatenate(receive_at).astype(np.int64),
            to_second=size,
            count=np.zeros(1, np.int64),
            own_count=address + 8 * own_place,
            counts=np.array([address + 8 * place for place in on_node], np.uint64),
            requests=np.stack([handles(buffer_requests) for buffer_requests in requests]),
            comm=handle(comm),
            width=width,
            functions=functions(),
        )

    def _share(self, node: Any, stride: int) -> np.ndarray:
        """Allocate the buffers of all ranks of the node, `stride` numbers each."""
        if node.size == 1:
            return np.zeros(stride)
        self._window = MPI.Win.Allocate_shared(8 * stride * node.size if node.rank == 0 else 0, 8, comm=node)
        self._window.Lock_all(MPI.MODE_NOCHECK)
        return np.frombuffer(self._window.Shared_query(0)[0], np.float64)

    def update(self, rows: np.ndarray) -> None:
        """Copy the owners' rows (n, width) to the halo copies. Collective among neighbours."""
        index, n_halo = self.buffers.send_index, len(self.buffers.receive_at)
        if len(index) or n_halo:
            sent, arrived = np.ascontiguousarray(rows[index], np.float64), np.empty((n_halo, self.width))
            check(exchange_rows(sent, arrived, self.buffers))
            rows[self.n_owned : self.n_owned + n_halo] = arrived

    def free(self) -> None:
        """Free the requests and the shared memory. Collective."""
        for request in self._made:
            request.Free()
        if self._window is not None:
            self._window.Unlock_all()
            self._window.Free()
        self._made, self._window = [], None


def buffers_without_neighbours() -> HaloBuffers:
    """Return buffers, without MPI, for a rank without neighbours."""
    return HaloBuffers.absent().with_values(
        numbers=np.zeros(LINE), send_at=LINE, count=np.zeros(1, np.int64), functions=functions()
    )


def check(error: int) -> None:
    """Raise the MPI exception of an error code, if there is one."""
    if error:
        raise MPI.Exception(error)
