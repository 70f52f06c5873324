"""The split of a net over ranks: who owns what, who holds whose particles as halo, and moving rows about.

A rank owns the particles of its part and steps them. It holds every element that meets one of them, and, as
halo, the far ends of those that cross the cut. Rows: owned boundary particles (those that neighbours hold),
so that their forces can be sent before the rest is moved; owned interior ones; then halo by owner and number,
so that what a neighbour sends is received in place. Each of the three is in ascending global number where
that suits the step (`order_of_rows`). Positions never travel: owner and holders apply the same force to equal
copies.
"""

from dataclasses import dataclass

import numpy as np

from netfall.numerics.sets import among, distinct
from netfall.parallel.mpi import MPI

FAR = 4.0  # times farther apart in number than in a square net: then the particles get another order


@dataclass(frozen=True)
class Subdomain:
    """What one rank holds of the net. Immutable.

    particle_gid : (n_owned + n_halo,) global numbers of the rows
    element_gid : (m,) ascending
    ends : (m, 2) uint32 local rows (unsigned: compiled code then needs no test for negative ones)
    element_owned : (m,) bool, each element on one rank: the owner of its start
    neighbours, send_counts, receive_counts : one entry for each neighbouring rank
    send_index : local rows of the boundary particles, neighbour by neighbour
    joint_gid : (k,) ascending, the joints of chains at owned particles; joints : (k, 3) uint32 local rows
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


NO_JOINTS, NOBODY = np.zeros((0, 3), np.int64), np.zeros(0, np.int64)


def cut_net(
    n: int, elements: np.ndarray, part: np.ndarray, ranks: int, joints: np.ndarray = NO_JOINTS
) -> list[Subdomain]:
    """The subdomains of all ranks, for a part (n,) of each particle.

    joints : (k, 3) particles in a row, all of which whoever owns one of them holds
    """
    owner = part[elements]  # (m, 2)
    crossing = np.flatnonzero(owner[:, 0] != owner[:, 1])
    holder = np.concatenate([owner[:, 0], owner[crossing, 1]])
    held = np.concatenate([np.arange(len(elements)), crossing])
    order = np.lexsort((held, holder))
    held = np.split(held[order], np.searchsorted(holder[order], np.arange(1, ranks)))
    particles = np.argsort(part, kind="stable")
    owned = np.split(particles, np.searchsorted(part[particles], np.arange(1, ranks)))
    jointed = [np.flatnonzero((part[joints] == rank).any(1)) for rank in range(ranks)]
    halos = []
    for rank in range(ranks):
        ends = distinct(np.concatenate([elements[held[rank]].ravel(), joints[jointed[rank]].ravel()]))
        halo = ends[part[ends] != rank]
        halos.append(halo[np.argsort(part[halo], kind="stable")])
    local = np.full(n, -1, np.int64)  # scratch: local row of a particle on the rank in hand
    subdomains = []
    for rank in range(ranks):
        wanted = {int(k): halos[k][part[halos[k]] == rank] for k in np.unique(part[halos[rank]])}
        inner = held[rank][(owner[held[rank]] == rank).all(1)]
        boundary = among(owned[rank], np.concatenate([NOBODY, *wanted.values()]))
        local[owned[rank]] = np.arange(len(owned[rank]))
        order = order_of_rows(boundary, local[elements[inner]])
        gid = np.concatenate([owned[rank][order], halos[rank]])
        local[gid] = np.arange(len(gid))
        sends = [local[rows] for rows in wanted.values()]
        counts = np.bincount(part[halos[rank]], minlength=ranks)
        subdomains.append(
            Subdomain(
                len(owned[rank]),
                gid,
                held[rank],
                local[elements[held[rank]]].astype(np.uint32),
                owner[held[rank], 0] == rank,
                tuple(wanted),
                tuple(map(len, sends)),
                tuple(int(counts[other]) for other in wanted),
                np.concatenate([NOBODY, *sends]).astype(np.uint32),
                jointed[rank],
                local[joints[jointed[rank]]].astype(np.uint32),
            )
        )
    return subdomains


def order_of_rows(boundary: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """The order (n,) in which a rank steps its own particles, boundary first.

    As given, or by layers (Cuthill and McKee 1969) if neighbours stand far apart.

    boundary : (n,) bool; ends : (m, 2) of the elements between them
    """
    n = len(boundary)
    order = np.argsort(~boundary, kind="stable")
    if apart(order, ends) <= FAR * np.sqrt(n) * len(ends):
        return order
    from scipy.sparse import coo_array  # here: it takes 0.2 s to load
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    beside = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (n, n)).tocsr()
    layers = reverse_cuthill_mckee(beside + beside.T, symmetric_mode=True)
    return layers[np.argsort(~boundary[layers], kind="stable")]


def apart(order: np.ndarray, ends: np.ndarray) -> int:
    """Sum of the distances between the rows of the two ends of each element (m, 2), in an order (n,)."""
    row = np.empty(len(order), np.int64)
    row[order] = np.arange(len(order))
    return int(np.abs(np.diff(row[ends])).sum())


def rows_of(gid: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Rows of the wanted numbers (k,) among gid (n,), which stand in any order; -1: not there."""
    if not len(gid):
        return np.full(len(wanted), -1)
    order = np.argsort(gid, kind="stable")
    row = order[np.minimum(np.searchsorted(gid, wanted, sorter=order), len(gid) - 1)]
    return np.where(gid[row] == wanted, row, -1)


class Distribution:
    """The subdomains of a net on the ranks of a communicator. Rank 0 knows all, the others their own."""

    def __init__(self, comm: MPI.Comm, n: int, m: int, subdomains: list[Subdomain] | None):
        """Collective. subdomains : on rank 0, of all ranks."""
        self.comm = comm
        self.n, self.m = n, m
        self._subdomains = subdomains
        self.subdomain: Subdomain = comm.scatter(subdomains)

    def particles(self, rows: np.ndarray | None) -> np.ndarray:
        """Owned and halo rows of a global array (n, ...) that rank 0 gives. Collective."""
        return self._scatter(rows, "particle_gid")

    def elements(self, rows: np.ndarray | None) -> np.ndarray:
        """Rows of a global array (m, ...) that rank 0 gives, for the elements of each rank. Collective."""
        return self._scatter(rows, "element_gid")

    def joints(self, rows: np.ndarray | None) -> np.ndarray:
        """Rows of a global array (k, ...) that rank 0 gives, for the joints of each rank. Collective."""
        return self._scatter(rows, "joint_gid")

    def _scatter(self, rows: np.ndarray | None, gid: str) -> np.ndarray:
        return self.comm.scatter(self._subdomains and [rows[getattr(p, gid)] for p in self._subdomains])

    def from_owners(self, gid: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Rows (k, ...) of a few particles gid (k,), on every rank, from the rank that owns each. Collective.

        rows : (n_owned or more, ...) of this rank
        """
        row = rows_of(self.subdomain.particle_gid[: self.subdomain.n_owned], gid)
        found = np.zeros((len(gid), *rows.shape[1:]))
        found[row >= 0] = rows[row[row >= 0]]
        found += 0.0  # no negative zeros, which the sum with other ranks' zeros would not keep
        self.comm.Allreduce(MPI.IN_PLACE, found, MPI.SUM)
        return found

    def gather_particles(self, rows: np.ndarray) -> np.ndarray | None:
        """Global array (n, ...) on rank 0 of the ranks' owned rows. Collective."""
        parts = self.comm.gather(np.ascontiguousarray(rows[: self.subdomain.n_owned]))
        if parts is None:
            return None
        whole = np.empty((self.n,) + rows.shape[1:], rows.dtype)
        for subdomain, part in zip(self._subdomains, parts):
            whole[subdomain.particle_gid[: subdomain.n_owned]] = part
        return whole

    def gather_elements(self, rows: np.ndarray, mine=slice(None)) -> np.ndarray | None:
        """Global array (m, ...) on rank 0 of rows that are equal on all ranks that hold them. Collective.

        mine : (m,) bool, the elements that this rank reports, where rows are not equal on all
        """
        return self._gather(self.subdomain.element_gid[mine], rows[mine], self.m)

    def gather_joints(self, rows: np.ndarray, mine: np.ndarray, count: int) -> np.ndarray | None:
        """Global array (count, ...) on rank 0 of rows of joints; mine : those to report. Collective."""
        return self._gather(self.subdomain.joint_gid[mine], rows[mine], count)

    def _gather(self, gid: np.ndarray, rows: np.ndarray, count: int) -> np.ndarray | None:
        parts = self.comm.gather((gid, np.ascontiguousarray(rows)))
        if parts is None:
            return None
        whole = np.empty((count,) + rows.shape[1:], rows.dtype)
        for gid, part in parts:
            whole[gid] = part
        return whole
