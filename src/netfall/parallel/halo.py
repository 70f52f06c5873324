"""The exchange of halo particle forces, once a step: pack, send, unpack.

Ranks of one node share memory: each puts there what its neighbours need, then the number of the exchange,
for which these look. Neighbours on other nodes get a message, by persistent requests made by mpi4py. Compiled
code does both, the latter through the MPI library's own functions, so that the time loop never returns to
Python between steps.

Each rank has two buffers, used in turn. A rank fills one again only two exchanges later, when all its
neighbours have announced the exchange between, and so have read it: nobody needs to say that something has
been read.
"""

import os

import numpy as np

from netfall.core.kernels import inner_kernel, kernel
from netfall.core.records import Record, f8, has, i8, u1_2, u4, u8, whole
from netfall.ground.errors import InputError
from netfall.mechanics.motion import inverse_mass
from netfall.parallel.mpi import MPI
from netfall.parallel.mpi_calls import (
    announce,
    announced,
    functions,
    handle,
    handles,
    look_for_messages,
    start_all,
    wait_all,
    yield_processor,
)
from netfall.parallel.subdomain import Subdomain

LINE = 8  # numbers in a cache line; what one rank writes shares none with what another does
PATIENCE = 200  # looks, before others get the processor
PER_NODE = "NETFALL_RANKS_PER_NODE"  # environment: take so many ranks for a node


class HaloBuffers(Record):
    """What compiled code needs for the exchange; the buffers of all ranks of the node stand in one array.

    send_index : local rows of the boundary particles, in the order in which they are sent
    numbers : the buffers; places in it count in numbers
    send_at : where this rank puts its first row
    receive_at : (n_halo,) where it finds that of a halo particle
    to_second : from the first buffer of a rank to its second
    count : (1,) exchanges so far; own_count : address of this rank's announced count
    counts : (k,) addresses of the neighbours' on the node
    requests : (2, bytes) of each buffer, for neighbours on other nodes; comm : that of these
    width : numbers sent for each particle
    functions : addresses of those of `mpi_calls`
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
def buffer_in_use(buffers):
    """Place of the buffer of this exchange, to be added to `send_at` and `receive_at`."""
    return buffers.to_second * (buffers.count[0] % 2)


@inner_kernel
def send_buffer(buffers):
    """Let the neighbours have the buffer; MPI's error code, 0 for success."""
    buffers.count[0] += 1
    if buffers.counts.shape[0] > 0:
        announce(buffers.own_count, buffers.count[0])
    if buffers.requests.shape[1] > 0:
        return start_all(buffers.functions, buffers.requests[(buffers.count[0] - 1) % 2])
    return 0


@inner_kernel
def wait_for_neighbours(buffers):
    """Wait until the neighbours' buffers are there; MPI's error code, 0 for success."""
    for k in range(buffers.counts.shape[0]):
        looks = 0
        while announced(buffers.counts[k]) < buffers.count[0]:
            looks += 1
            # Someone may need this processor, or a message that MPI sends on only when it is called.
            if looks % PATIENCE == 0:
                error = look_for_messages(buffers.functions, buffers.comm)
                if error != 0:
                    return error
                yield_processor(buffers.functions)
    if buffers.requests.shape[1] > 0:
        return wait_all(buffers.functions, buffers.requests[(buffers.count[0] - 1) % 2])
    return 0


# --- the forces of a step: total force; with fracture mass and valence, which the halo cannot know of; slips


@inner_kernel
def fixed_width(particles):
    """Numbers sent for each particle besides the velocities of slips, which stand behind these."""
    if not has(particles.valence):
        return 3
    return 6 if has(particles.air_mass) else 5


@inner_kernel
def pack_forces(particles, place, buffers):
    """Pack the boundary particles' total forces. place : `buffer_in_use`"""
    fixed, width, numbers = fixed_width(particles), buffers.width, buffers.numbers
    for i in range(buffers.send_index.shape[0]):
        p, row = buffers.send_index[i], buffers.send_at + place + i * width
        for k in range(3):
            numbers[row + k] = particles.f[k, p]
        if fixed > 3:
            numbers[row + 3] = particles.mass[p]
            numbers[row + 4] = particles.valence[p]
        if fixed > 5:
            numbers[row + 5] = particles.air_mass[p]
        for k in range(width - fixed):
            numbers[row + fixed + k] = particles.slip_v[k, p]


@inner_kernel
def unpack_forces(n_owned, particles, place, buffers):
    """Unpack the total forces of the halo particles, which have arrived. place : of `pack_forces`"""
    fixed, width, numbers = fixed_width(particles), buffers.width, buffers.numbers
    for i in range(buffers.receive_at.shape[0]):
        p, row = n_owned + i, buffers.receive_at[i] + place
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
def exchange_rows(sent, arrived, buffers):
    """Send rows (k, width) of the boundary particles, take those (h, width) of the halo; MPI's error code."""
    width, place = sent.shape[1], buffer_in_use(buffers)
    for i in range(sent.shape[0]):
        for k in range(width):
            buffers.numbers[buffers.send_at + place + i * width + k] = sent[i, k]
    error = send_buffer(buffers)
    if error != 0:
        return error
    error = wait_for_neighbours(buffers)
    for i in range(arrived.shape[0]):
        for k in range(width):
            arrived[i, k] = buffers.numbers[buffers.receive_at[i] + place + k]
    return error


def _node_of(comm: MPI.Comm) -> MPI.Comm:
    """The ranks that share memory with this one. Collective."""
    asked = os.environ.get(PER_NODE)
    if asked is None:
        return comm.Split_type(MPI.COMM_TYPE_SHARED)
    if not asked.isdigit() or int(asked) < 1:
        raise InputError(
            f"environment variable {PER_NODE}: {asked!r}; allowed is a number of ranks from 1; "
            "unset it to share memory where the ranks can"
        )
    node = comm.Split_type(MPI.COMM_TYPE_SHARED)
    smaller = node.Split(comm.rank // int(asked))
    node.Free()
    return smaller


class Halo:
    """Buffers and persistent requests for one row of `width` numbers for each boundary particle."""

    def __init__(self, comm: MPI.Comm, subdomain: Subdomain, width: int):
        """Collective."""
        index = subdomain.send_index
        self.boundary = int(index.max()) + 1 if len(index) else 0  # first rows, which hold boundary particles
        self.n_owned, self.width, self._made, self._window = subdomain.n_owned, width, [], None
        node = _node_of(comm)
        first = lambda counts: np.concatenate([[0], np.cumsum(counts)]).astype(int) * width
        sends, receives = first(subdomain.send_counts), first(subdomain.receive_counts)  # places in a buffer
        size = LINE * node.allreduce(int(-(-(sends[-1] + receives[-1]) // LINE)), MPI.MAX)
        stride = LINE + 2 * size  # of a rank: its count, and its buffers
        numbers, mine = self._share(node, stride), node.rank * stride
        numbers[mine : mine + stride] = 0.0
        send_places = dict(zip(subdomain.neighbours, sends.tolist()))
        others = dict(node.allgather((comm.rank, (node.rank * stride, send_places))))  # also: all are zero
        near = [neighbour in others for neighbour in subdomain.neighbours]
        receive_at, requests = [np.zeros(0, np.int64)], [[], []]
        for k, neighbour in enumerate(subdomain.neighbours):
            if near[k]:
                start = others[neighbour][0] + LINE + others[neighbour][1][comm.rank]
            else:
                start = mine + LINE + sends[-1] + receives[k]
                for turn in range(2):
                    own = numbers[mine + LINE + turn * size :]
                    inbox = own[sends[-1] + receives[k] : sends[-1] + receives[k + 1]]
                    requests[turn].append(comm.Recv_init(inbox, neighbour))
                    requests[turn].append(comm.Send_init(own[sends[k] : sends[k + 1]], neighbour))
            receive_at.append(start + np.arange(0, receives[k + 1] - receives[k], width))
        node.Free()
        self._made = requests[0] + requests[1]
        address = numbers.ctypes.data
        on_node = [others[neighbour][0] for neighbour, is_near in zip(subdomain.neighbours, near) if is_near]
        self.buffers = HaloBuffers(
            send_index=subdomain.send_index,
            numbers=numbers,
            send_at=mine + LINE,
            receive_at=np.concatenate(receive_at).astype(np.int64),
            to_second=size,
            count=np.zeros(1, np.int64),
            own_count=address + 8 * mine,
            counts=np.array([address + 8 * place for place in on_node], np.uint64),
            requests=np.stack([handles(of_buffer) for of_buffer in requests]),
            comm=handle(comm),
            width=width,
            functions=functions(),
        )

    def _share(self, node: MPI.Comm, stride: int) -> np.ndarray:
        """The buffers of all ranks of the node, `stride` numbers each."""
        if node.size == 1:
            return np.zeros(stride)
        self._window = MPI.Win.Allocate_shared(8 * stride * node.size if node.rank == 0 else 0, 8, comm=node)
        self._window.Lock_all(MPI.MODE_NOCHECK)
        return np.frombuffer(self._window.Shared_query(0)[0], np.float64)

    def update(self, rows: np.ndarray) -> None:
        """Give the owners' rows (n, width) to the halo copies. Collective among neighbours."""
        index, n_halo = self.buffers.send_index, len(self.buffers.receive_at)
        if len(index) or n_halo:
            sent, arrived = np.ascontiguousarray(rows[index], np.float64), np.empty((n_halo, self.width))
            check(exchange_rows(sent, arrived, self.buffers))
            rows[self.n_owned : self.n_owned + n_halo] = arrived

    def free(self) -> None:
        """Give the requests and the shared memory back to MPI. Collective."""
        for request in self._made:
            request.Free()
        if self._window is not None:
            self._window.Unlock_all()
            self._window.Free()
        self._made, self._window = [], None


def buffers_alone() -> HaloBuffers:
    """Buffers, without MPI, of a rank that has no neighbours."""
    return HaloBuffers.absent().replaced(
        numbers=np.zeros(LINE), send_at=LINE, count=np.zeros(1, np.int64), functions=functions()
    )


def check(error: int) -> None:
    """Raise what MPI's error code stands for."""
    if error:
        raise MPI.Exception(error)
