"""The tangent stiffness of a net at its positions, for Newton's method."""

from typing import NamedTuple

import numpy as np

from netfall.compile import kernel
from netfall.mechanics.material import largest_stiffness, tangent_stiffness
from netfall.mechanics.state import State
from netfall.parallel.agree import on_root
from netfall.parallel.subdomain import Distribution
from netfall.solve.relaxation import nodal_stiffness


class Tangent(NamedTuple):
    """Stiffness of a net at its positions.

    N : (m,) [N]; direction : (m, 3) along the elements; axial, across : (m,) [N/m], of compression negative
    support : (n, 3) [N/m] or None
    nodal : (n,) [N/m], the elements' and supports' largest stiffness at each particle
    """

    N: np.ndarray
    direction: np.ndarray
    axial: np.ndarray
    across: np.ndarray
    support: np.ndarray | None
    nodal: np.ndarray


def tangent_of(state: State) -> Tangent:
    """The tangent stiffness of a state's elements and supports at its positions."""
    now = state.elements_now()
    direction = (state.x[state.ends[:, 1]] - state.x[state.ends[:, 0]]) / np.maximum(now.L, 1e-300)[:, None]
    eps_p = 0.0 if state.eps_p is None else state.eps_p
    axial = tangent_stiffness(
        now.N,
        now.eps,
        eps_p,
        now.L,
        state.L0,
        state.EA,
        state.yield_force,
        state.bar,
        state.scene.logarithmic,
    )
    across = now.N / np.maximum(now.L, 1e-300)
    nodal = state.spring.max(1).astype(float) if state.scene.springs else np.zeros(state.n_local)
    nodal_stiffness(state.ends, largest_stiffness(state.EA, state.L0) + np.abs(across), nodal)
    support = np.ascontiguousarray(state.spring, float) if state.scene.springs else None
    return Tangent(now.N, np.ascontiguousarray(direction), axial, across, support, nodal)


def without_compression(K: Tangent) -> Tangent:
    """The tangent without what compression takes from it."""
    return K._replace(across=np.maximum(K.across, 0.0))


def whole_matrix(distribution: Distribution, net, K: Tangent, inertia: float):
    """The matrix of `block_matrix` on rank 0, compression left out. net : `relaxation.Net`. Collective."""
    d = distribution
    K = without_compression(K)
    elements = [d.gather_elements(each) for each in (K.direction, K.axial, K.across)]
    support = None if K.support is None else d.gather_particles(K.support)
    free, nodal = d.gather_particles(net.free), d.gather_particles(K.nodal)
    ends = d.gather_elements(d.subdomain.particle_gid[d.subdomain.ends])
    return on_root(d.comm, lambda: block_matrix(ends, *elements, free != 0, support, inertia * nodal))


@kernel
def element_blocks(direction, axial, across, block):
    """The stiffness (m, 3, 3) [N/m] of one end of each element against the other."""
    for e in range(block.shape[0]):
        for i in range(3):
            along = (axial[e] - across[e]) * direction[e, i]
            for j in range(3):
                block[e, i, j] = along * direction[e, j] + (across[e] if i == j else 0.0)


@kernel
def add_blocks(place, block, out):
    """Add blocks (m, 3, 3) to out (n, 3, 3) at their places (m,), in their order."""
    for e in range(block.shape[0]):
        for i in range(3):
            for j in range(3):
                out[place[e], i, j] += block[e, i, j]


def block_matrix(ends, direction, axial, across, free, support, inertia):
    """The tangent stiffness as a scipy BSR matrix of 3 x 3 blocks, without held axes. Rank 0.

    ends : (m, 2); direction : (m, 3); axial, across : (m,) [N/m]; free : (n, 3) bool; support : (n, 3) or
    None; inertia : (n,) [N/m]
    """
    from scipy.sparse import bsr_array

    n = len(free)
    block, diagonal = np.empty((len(ends), 3, 3)), np.zeros((n, 3, 3))
    element_blocks(direction, axial, across, block)
    for k in range(2):
        add_blocks(ends[:, k], block, diagonal)
    axis = np.arange(3)
    diagonal[:, axis, axis] += inertia[:, None] + (0.0 if support is None else support)
    diagonal *= free[:, :, None] & free[:, None, :]
    diagonal[:, axis, axis] += ~free
    both = free.any(1)[ends].all(1)
    a, b = ends[both].T
    beside = -block[both] * (free[a][:, :, None] & free[b][:, None, :])
    row = np.concatenate([np.arange(n), a, b])
    column = np.concatenate([np.arange(n), b, a])
    blocks = np.concatenate([diagonal, beside, beside.transpose(0, 2, 1)])
    order = np.lexsort((column, row))
    row, column = row[order], column[order]
    first = np.flatnonzero(np.concatenate([[True], (np.diff(row) != 0) | (np.diff(column) != 0)]))
    start = np.searchsorted(row[first], np.arange(n + 1))
    blocks = blocks[order] if len(first) == len(row) else np.add.reduceat(blocks[order], first)
    return bsr_array((blocks, column[first], start), shape=(3 * n, 3 * n))


def scattered(number: np.ndarray) -> np.ndarray:
    """Numbers from -0.5 to 0.5, as if by chance, that depend on the given integers alone (SplitMix64)."""
    bits = number.astype(np.uint64) + np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (bits ^ (bits >> np.uint64(31))) / 2.0**64 - 0.5
