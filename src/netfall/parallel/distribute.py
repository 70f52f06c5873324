"""The split of a net over ranks: who owns what, who holds whose particles as halo, and moving rows about.

A rank owns the particles of its part and steps them. It holds every element that meets one of them, and, as
halo, the far ends of those that cross the cut. Rows: owned boundary particles (those that neighbours hold), so that
their forces can be sent before the rest is moved; owned interior ones; then halo by owner and number, so that what a
neighbour sends is received in place. Each of the three is in ascending global number. Positions never travel: owner and
holders apply the same force to equal copies.
"""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI


@dataclass(frozen=True)
class Piece:
    """What one rank holds of the net. Immutable.

    particle_gid : (n_owned + n_halo,); element_gid : (m,) ascending; ends : (m, 2) uint32 local rows (unsigned: compiled code then needs no test for negative ones)
    element_owned : (m,) bool, each element on one rank: the owner of its start
    neighbours, send_counts, receive_counts : one entry for each neighbouring rank
    send_index : local rows of the boundary particles, neighbour by neighbour
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

    @property
    def n_halo(self) -> int:
        """Number of halo particles."""
        return len(self.particle_gid) - self.n_owned


def cut_net(n: int, elements: np.ndarray, part: np.ndarray, ranks: int) -> list[Piece]:
    """The pieces of all ranks, for a part (n,) of each particle."""
    owner = part[elements]  # (m, 2)
    crossing = np.flatnonzero(owner[:, 0] != owner[:, 1])
    holder = np.concatenate([owner[:, 0], owner[crossing, 1]])
    held = np.concatenate([np.arange(len(elements)), crossing])
    order = np.lexsort((held, holder))
    held = np.split(held[order], np.searchsorted(holder[order], np.arange(1, ranks)))
    particles = np.argsort(part, kind="stable")
    owned = np.split(particles, np.searchsorted(part[particles], np.arange(1, ranks)))
    local = np.full(n, -1, np.int64)  # scratch: local row of a particle on the rank in hand
    halos = []
    for rank in range(ranks):
        ends = np.unique(elements[held[rank]])
        halo = ends[part[ends] != rank]
        halos.append(halo[np.argsort(part[halo], kind="stable")])
    wanted = [[(other, halos[other][part[halos[other]] == rank]) for other in np.unique(part[halos[rank]])] for rank in range(ranks)]
    pieces = []
    for rank in range(ranks):
        boundary = np.isin(owned[rank], np.concatenate([rows for _, rows in wanted[rank]])) if wanted[rank] else np.zeros(len(owned[rank]), bool)
        gid = np.concatenate([owned[rank][boundary], owned[rank][~boundary], halos[rank]])
        local[gid] = np.arange(len(gid))
        sends = [local[rows] for _, rows in wanted[rank]]
        counts = np.bincount(part[halos[rank]], minlength=ranks)
        neighbours = tuple(int(other) for other, _ in wanted[rank])
        pieces.append(Piece(
            len(owned[rank]), gid, held[rank], local[elements[held[rank]]].astype(np.uint32), owner[held[rank], 0] == rank,
            neighbours, tuple(len(s) for s in sends), tuple(int(counts[other]) for other in neighbours),
            np.concatenate(sends + [np.zeros(0, np.int64)]).astype(np.uint32)))
    return pieces


class Distribution:
    """The pieces of a net on the ranks of a communicator. Rank 0 knows all of them, the others their own."""

    def __init__(self, comm: MPI.Comm, n: int, m: int, pieces: list[Piece] | None):
        """Collective. pieces : on rank 0, of all ranks."""
        self.comm = comm
        self.n, self.m = n, m
        self._pieces = pieces
        self.piece: Piece = comm.scatter(pieces)

    def particles(self, rows: np.ndarray | None) -> np.ndarray:
        """Owned and halo rows of a global array (n, ...) that rank 0 gives. Collective."""
        return self.comm.scatter(None if self._pieces is None else [rows[p.particle_gid] for p in self._pieces])

    def elements(self, rows: np.ndarray | None) -> np.ndarray:
        """Rows of a global array (m, ...) that rank 0 gives, for the elements of each rank. Collective."""
        return self.comm.scatter(None if self._pieces is None else [rows[p.element_gid] for p in self._pieces])

    def gather_particles(self, rows: np.ndarray) -> np.ndarray | None:
        """Global array (n, ...) on rank 0 of the ranks' owned rows. Collective."""
        parts = self.comm.gather(np.ascontiguousarray(rows[: self.piece.n_owned]))
        if parts is None:
            return None
        whole = np.empty((self.n,) + rows.shape[1:], rows.dtype)
        for piece, part in zip(self._pieces, parts):
            whole[piece.particle_gid[: piece.n_owned]] = part
        return whole

    def gather_elements(self, rows: np.ndarray) -> np.ndarray | None:
        """Global array (m, ...) on rank 0 of the elements' rows, which are equal on all that hold them. Collective."""
        parts = self.comm.gather(np.ascontiguousarray(rows))
        if parts is None:
            return None
        whole = np.empty((self.m,) + rows.shape[1:], rows.dtype)
        for piece, part in zip(self._pieces, parts):
            whole[piece.element_gid] = part
        return whole
