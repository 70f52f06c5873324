"""Distribution of a net over ranks: owned and halo particles, transfer of rows, contiguous blocks of rows.

A rank owns the particles of its part and advances them. It has every element that meets one of them. Its halo
contains the far ends of the elements that cross the cut. The first rows are owned boundary particles (in the
halo of a neighbour), so that their forces can be sent before the others are advanced. Owned interior
particles follow, then the halo by owner and number, so that messages are received in place. Within each of
the three groups, global numbers ascend if that suits the step (`order_of_rows`). Positions are never sent:
owner and neighbours apply the same force to equal copies.
"""

from dataclasses import dataclass

import numpy as np

from netfall.core.arrays import BoolArray, distinct, is_one_of, rows_of
from netfall.parallel.mpi import MPI

# distance of neighbours in number, relative to a square net, above which particles are reordered
MAX_RELATIVE_DISTANCE = 4.0


@dataclass(frozen=True)
class Subdomain:
    """Part of the net on one rank. Immutable.

    particle_gid : (n_owned + n_halo,) global numbers of the rows
    element_gid : (m,) ascending
    ends : (m, 2) uint32 local rows (unsigned: compiled code then needs no test for negative ones)
    element_owned : (m,) bool; one rank owns each element: the owner of its start
    neighbours, send_counts, receive_counts : one entry for each neighbouring rank
    send_index : local rows of the boundary particles, neighbour by neighbour
    joint_gid : (k,) ascending, the joints of bending chains at owned particles; joints : (k, 3) uint32 local
        rows
    """

    n_owned: int
    particle_gid: np.ndarray
    element_gid: np.ndarray
    ends: np.ndarray
    element_owned: np.ndarray
    neighbours: tuple[int, ...]
    send_counts: tuple[int, ...]
    receive_counts: tuple[int, ...]
    send_index: np.ndarray
    joint_gid: np.ndarray
    joints: np.ndarray

    @property
    def n_halo(self) -> int:
        """Number of halo particles."""
        return len(self.particle_gid) - self.n_owned


NO_JOINTS, NO_PARTICLES = np.zeros((0, 3), np.int64), np.zeros(0, np.int64)


def split_net(
    n: int, elements: np.ndarray, part: np.ndarray, ranks: int, joints: np.ndarray = NO_JOINTS
) -> list[Subdomain]:
    """Return the subdomains of all ranks, for a part (n,) of each particle.

    joints : (k, 3) consecutive particles; a rank that owns one of them has all three
    """
    owner = part[elements]  # (m, 2)
    crossing = np.flatnonzero(owner[:, 0] != owner[:, 1])
    holder = np.concatenate([owner[:, 0], owner[crossing, 1]])
    elements_held = np.concatenate([np.arange(len(elements)), crossing])
    order = np.lexsort((elements_held, holder))
    elements_held = np.split(elements_held[order], np.searchsorted(holder[order], np.arange(1, ranks)))
    particles = np.argsort(part, kind="stable")
    owned = np.split(particles, np.searchsorted(part[particles], np.arange(1, ranks)))
    jointed = [np.flatnonzero((part[joints] == rank).any(1)) for rank in range(ranks)]
    halos = []
    for rank in range(ranks):
        ends = distinct(
            np.concatenate([elements[elements_held[rank]].ravel(), joints[jointed[rank]].ravel()])
        )
        halo = ends[part[ends] != rank]
        halos.append(halo[np.argsort(part[halo], kind="stable")])
    local = np.full(n, -1, np.int64)  # local row of each particle on the current rank
    subdomains = []
    for rank in range(ranks):
        needed = {int(k): halos[k][part[halos[k]] == rank] for k in np.unique(part[halos[rank]])}
        inner = elements_held[rank][(owner[elements_held[rank]] == rank).all(1)]
        boundary = is_one_of(owned[rank], np.concatenate([NO_PARTICLES, *needed.values()]))
        local[owned[rank]] = np.arange(len(owned[rank]))
        order = order_of_rows(boundary, local[elements[inner]])
        gid = np.concatenate([owned[rank][order], halos[rank]])
        local[gid] = np.arange(len(gid))
        sends = [local[rows] for rows in needed.values()]
        counts = np.bincount(part[halos[rank]], minlength=ranks)
        subdomains.append(
            Subdomain(
                len(owned[rank]),
                gid,
                elements_held[rank],
                local[elements[elements_held[rank]]].astype(np.uint32),
                owner[elements_held[rank], 0] == rank,
                tuple(needed),
                tuple(map(len, sends)),
                tuple(int(counts[other]) for other in needed),
                np.concatenate([NO_PARTICLES, *sends]).astype(np.uint32),
                jointed[rank],
                local[joints[jointed[rank]]].astype(np.uint32),
            )
        )
    return subdomains


def order_of_rows(boundary: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return the order (n,) in which a rank advances its particles, boundary first.

    It is the given order, or that of Cuthill and McKee (1969) if neighbours are far apart.

    boundary : (n,) bool; ends : (m, 2) of the elements between them
    """
    n = len(boundary)
    order = np.argsort(~boundary, kind="stable")
    if apart(order, ends) <= MAX_RELATIVE_DISTANCE * np.sqrt(n) * len(ends):
        return order
    from scipy.sparse import coo_array  # imported here, because it takes 0.2 s
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    adjacency = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (n, n)).tocsr()
    layers = reverse_cuthill_mckee(adjacency + adjacency.T, symmetric_mode=True)
    return layers[np.argsort(~boundary[layers], kind="stable")]


def apart(order: np.ndarray, ends: np.ndarray) -> int:
    """Return the sum of row distances between the two ends of the elements (m, 2), in an order (n,)."""
    row = np.empty(len(order), np.int64)
    row[order] = np.arange(len(order))
    return int(np.abs(np.diff(row[ends])).sum())


class Distribution:
    """Subdomains of a net on the ranks of a communicator. Rank 0 has all of them, others their own."""

    def __init__(self, comm: MPI.Comm, n: int, m: int, subdomains: list[Subdomain] | None):
        """Scatter the subdomains. Collective. subdomains : on rank 0, of all ranks."""
        self.comm = comm
        self.n, self.m = n, m
        self._subdomains = subdomains
        self.subdomain: Subdomain = comm.scatter(subdomains)

    def particles(self, rows: np.ndarray | None) -> np.ndarray:
        """Return the owned and halo rows of a global array (n, ...) of rank 0. Collective."""
        return self._scatter(rows, "particle_gid")

    def elements(self, rows: np.ndarray | None) -> np.ndarray:
        """Return the rows of a rank's elements from a global array (m, ...) of rank 0. Collective."""
        return self._scatter(rows, "element_gid")

    def joints(self, rows: np.ndarray | None) -> np.ndarray:
        """Return the rows of a rank's joints from a global array (k, ...) of rank 0. Collective."""
        return self._scatter(rows, "joint_gid")

    def _scatter(self, rows: np.ndarray | None, gid: str) -> np.ndarray:
        parts = None
        if self._subdomains is not None and rows is not None:
            parts = [rows[getattr(part, gid)] for part in self._subdomains]
        return self.comm.scatter(parts)

    def broadcast_rows(self, gid: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Return rows (k, ...) of a few particles gid (k,), on every rank, from their owners. Collective.

        rows : (n_owned or more, ...) of this rank
        """
        row = rows_of(self.subdomain.particle_gid[: self.subdomain.n_owned], gid)
        result = np.zeros((len(gid), *rows.shape[1:]))
        result[row >= 0] = rows[row[row >= 0]]
        result += 0.0  # no negative zeros: the sum with zeros of other ranks would lose the sign
        self.comm.Allreduce(MPI.IN_PLACE, result, MPI.SUM)
        return result

    def gather_particles(self, rows: np.ndarray) -> np.ndarray | None:
        """Gather the owned rows of all ranks as a global array (n, ...) on rank 0. Collective."""
        parts = self.comm.gather(np.ascontiguousarray(rows[: self.subdomain.n_owned]))
        if parts is None or self._subdomains is None:
            return None
        result = np.empty((self.n,) + rows.shape[1:], rows.dtype)
        for subdomain, part in zip(self._subdomains, parts):
            result[subdomain.particle_gid[: subdomain.n_owned]] = part
        return result

    def gather_elements(
        self, rows: np.ndarray, reported: BoolArray | slice = slice(None)
    ) -> np.ndarray | None:
        """Gather a global array (m, ...) on rank 0 from rows that are equal where shared. Collective.

        reported : (m,) bool, the elements that this rank reports, if rows differ between ranks
        """
        return self._gather(self.subdomain.element_gid[reported], rows[reported], self.m)

    def gather_joints(self, rows: np.ndarray, reported: np.ndarray, count: int) -> np.ndarray | None:
        """Gather a global array (count, ...) of joints on rank 0. Collective."""
        return self._gather(self.subdomain.joint_gid[reported], rows[reported], count)

    def _gather(self, gid: np.ndarray, rows: np.ndarray, count: int) -> np.ndarray | None:
        parts = self.comm.gather((gid, np.ascontiguousarray(rows)))
        if parts is None:
            return None
        result = np.empty((count,) + rows.shape[1:], rows.dtype)
        for gid, part in parts:
            result[gid] = part
        return result


class BlockWriter:
    """Division of the global rows 0 to total into one block per writing rank: all ranks, or rank 0 alone."""

    def __init__(self, comm: MPI.Comm, all_write: bool):
        self.comm = comm
        self.all_write = all_write

    def bounds(self, total: int) -> np.ndarray:
        """Return the first row of each rank's block, and the end (ranks + 1,)."""
        ranks = self.comm.size
        if self.all_write:
            return np.arange(ranks + 1) * total // ranks
        return np.array([0] + [total] * ranks)

    def collect(self, row: np.ndarray, values: np.ndarray, total: int) -> np.ndarray:
        """Return this rank's block (rows, k) of a global array (total, k). Collective.

        row : (r,) global rows of this rank; values : (r, k). Each global row is on one rank.
        """
        if self.comm.size == 1:
            block = np.empty((total, values.shape[1]))
            block[row] = values
            return block
        bounds = self.bounds(total)
        target = np.searchsorted(bounds, row, side="right") - 1 if self.all_write else np.zeros(len(row), int)
        of_target = [target == rank for rank in range(self.comm.size)]
        low, high = bounds[self.comm.rank], bounds[self.comm.rank + 1]
        block = np.empty((high - low, values.shape[1]))
        for rows, received in self.comm.alltoall([(row[to_rank], values[to_rank]) for to_rank in of_target]):
            block[rows - low] = received
        return block
