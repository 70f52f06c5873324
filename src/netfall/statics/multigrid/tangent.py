"""Tangent stiffness of a net at its positions, for Newton's method."""

from typing import Any, NamedTuple

import numpy as np

from netfall.core.arrays import BoolArray, FloatArray, IntArray
from netfall.core.kernels import kernel
from netfall.parallel.subdomain import Distribution
from netfall.physics.bending import Joints, JointTangent, add_joint_bounds, joint_tangents
from netfall.physics.elements import element_tangents, nodal_stiffness
from netfall.physics.law.measures import largest_stiffness
from netfall.physics.state import State
from netfall.physics.supports import largest_springs
from netfall.statics.multigrid.rows import BlockRows, Owners, Pattern, blocks_of
from netfall.statics.relaxation import StaticNet

# stiffness over a node's stiffness [-] along a line on which it is held; single precision tolerates it
GUIDE_STIFFNESS = 1e4


class Tangent(NamedTuple):
    """Stiffness of a net at its positions.

    N : (m,) [N]; direction : (m, 3) along the elements; axial, across : (m,) [N/m], negative under
        compression
    support : (n, 3) [N/m] or None; between : (n,) [N/m] of it, coupling x and y, or None
    nodal : (n,) [N/m], the elements' and supports' largest stiffness at each particle
    joints : of bending chains, None: there are none
    slip : reduction by sliding cables (`statics.slip.SlipTangent`), None: none slides
    """

    N: np.ndarray
    direction: np.ndarray
    axial: np.ndarray
    across: np.ndarray
    support: np.ndarray | None
    nodal: np.ndarray
    joints: JointTangent | None = None
    slip: Any = None
    between: np.ndarray | None = None

    @property
    def is_softened(self) -> bool:
        """Return whether this rank has anything that reduces the stiffness: compression, moments."""
        return self.joints is not None or bool(self.across.min(initial=0.0) < 0.0)


def tangent_of(state: State) -> Tangent:
    """Compute the tangent stiffness of a state's elements and supports at its positions."""
    N, axial, across = np.empty((3, state.m))
    direction = np.empty((state.m, 3))
    element_tangents(state.x, *state.elements_and_law, N, direction, axial, across)
    springs = state.features.springs
    nodal = largest_springs(state.spring, state.turned).astype(float) if springs else np.zeros(state.n_local)
    nodal_stiffness(state.ends, largest_stiffness(state.EA, state.L0) + np.abs(across), nodal)
    # a copy, because guides add to it
    support = np.array(state.spring, float, order="C") if springs else None
    between = None
    if state.turned is not None:
        # stiff springs along the lines on which supports hold, where nothing moves, keep matrices positive
        # definite and approximate inverses accurate
        turned, stiff = state.turned[: len(nodal)], GUIDE_STIFFNESS * nodal
        support = np.zeros((len(turned), 3)) if support is None else support
        support[:, :2] += stiff[:, None] * turned[:, :2] ** 2
        between = turned[:, 2] + stiff * (turned[:, 0] * turned[:, 1])
    joints = joint_tangent(state.x, state.joints, nodal) if state.joints is not None else None
    return Tangent(N, direction, axial, across, support, nodal, joints, between=between)


def joint_tangent(x: np.ndarray, joints: Joints, nodal: np.ndarray) -> JointTangent:
    """Compute the stiffness of joints at x (n, 3) [m]; add its bound to nodal (n,) [N/m]."""
    stiffness, positive = np.empty((2, len(joints.stiffness), 6, 6))
    joint_tangents(x, joints, stiffness, positive)
    add_joint_bounds(x, joints, 1.0, nodal)
    return JointTangent(joints.particles, stiffness, positive)


def without_compression(K: Tangent) -> Tangent:
    """Return the tangent without the negative contributions of compression and moments."""
    joints = K.joints and K.joints._replace(stiffness=K.joints.positive)
    return K._replace(across=np.maximum(K.across, 0.0), joints=joints)


def pseudo_random(number: np.ndarray) -> np.ndarray:
    """Compute pseudo-random numbers from -0.5 to 0.5 that depend on the given integers alone (SplitMix64)."""
    bits = number.astype(np.uint64) + np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return (bits ^ (bits >> np.uint64(31))) / 2.0**64 - 0.5


class Incidence(NamedTuple):
    """Elements at each of the first particles, in ascending number of the far end.

    start : (rows + 1,) first entry of each; element, far : (k,) row of the element, and of its far end
    """

    start: np.ndarray
    element: np.ndarray
    far: np.ndarray


def incidence_of(ends: np.ndarray, number: np.ndarray, rows: int) -> Incidence:
    """Find the elements at the first `rows` particles. ends : (m, 2); number : (n,) of the particles."""
    node, far = ends.ravel(), ends[:, ::-1].ravel()
    order = np.lexsort((number[far], node))
    order = order[: np.count_nonzero(node < rows)]
    start = np.concatenate([[0], np.cumsum(np.bincount(node[order], minlength=rows))])
    return Incidence(start, (order // 2).astype(np.int32), far[order].astype(np.int32))


@kernel
def fill_blocks(
    at: Incidence,
    ends: IntArray,
    number: IntArray,
    free: BoolArray,
    direction: FloatArray,
    axial: FloatArray,
    across: FloatArray,
    diagonal: FloatArray,
    start: IntArray,
    column: IntArray,
    block: FloatArray,
) -> None:
    """Fill the rows of a matrix: start (rows + 1,), column (k,), block (k, 3, 3) of zeros; k is a bound.

    at : `Incidence`; the others are of `block_matrix`; diagonal : (n, 3, 3)
    """
    k = 0
    for p in range(start.shape[0] - 1):
        start[p] = k
        moves = free[p, 0] or free[p, 1] or free[p, 2]
        needs_diagonal = True  # the diagonal block is still to be added
        for entry in range(at.start[p], at.start[p + 1] + 1):
            is_end = entry == at.start[p + 1]
            if needs_diagonal and (is_end or number[at.far[entry]] > number[p]):
                column[k] = number[p]
                for i in range(3):
                    for j in range(3):
                        block[k, i, j] = diagonal[p, i, j]
                k, needs_diagonal = k + 1, False
            if is_end:
                break
            e, q = at.element[entry], at.far[entry]
            if not (moves and (free[q, 0] or free[q, 1] or free[q, 2])):
                continue
            if k == start[p] or column[k - 1] != number[q]:
                column[k] = number[q]
                k += 1
            first = ends[e, 0] == p
            for i in range(3):
                for j in range(3):
                    if free[p, i] and free[q, j]:
                        a, b = (i, j) if first else (j, i)
                        along = (axial[e] - across[e]) * direction[e, a]
                        block[k - 1, i, j] -= along * direction[e, b] + (across[e] if i == j else 0.0)
    start[-1] = k


def block_matrix(
    ends: IntArray,
    K: Tangent,
    free: BoolArray,
    inertia: FloatArray,
    number: IntArray,
    at: Incidence,
    columns: int,
) -> Any:
    """Build a tangent stiffness as a scipy BSR matrix of 3 x 3 blocks, without held axes.

    ends : (m, 2); free : (n, 3) bool; inertia : (n,) [N/m], added to the diagonal
    number : (n,) of a particle's column; columns : their number; at : the rows to build, of the first
        particles
    """
    direction, axial, across, support, between = K.direction, K.axial, K.across, K.support, K.between
    rows, ends = len(at.start) - 1, ends.astype(np.uint32, copy=False)
    diagonal, free = np.empty((rows, 3, 3)), np.ascontiguousarray(free)
    along, both_ends = (axial - across)[:, None] * direction, ends.T.ravel().astype(np.int64)
    for i, j in np.ndindex(3, 3):
        entry = along[:, i] * direction[:, j] + (across if i == j else 0.0)
        diagonal[:, i, j] = np.bincount(both_ends, np.tile(entry, 2), len(free))[:rows]
        if i == j:
            diagonal[:, i, i] += inertia[:rows] + (0.0 if support is None else support[:rows, i])
    if between is not None:
        diagonal[:, [0, 1], [1, 0]] += between[:rows, None]
    held_pairs = ~(free[:rows, :, None] & free[:rows, None, :])
    diagonal[held_pairs] = np.broadcast_to(np.eye(3), diagonal.shape)[held_pairs]
    start, capacity = np.empty(rows + 1, np.int64), rows + len(at.far)
    column, block = np.empty(capacity, np.int32), np.zeros((capacity, 3, 3))
    fill_blocks(at, ends, number, free, direction, axial, across, diagonal, start, column, block)
    matrix = blocks_of(block[: start[-1]], column[: start[-1]], start, columns)
    return matrix if K.joints is None else with_joints(matrix, K.joints, free, number)


def with_joints(matrix: Any, K: JointTangent, free: BoolArray, number: np.ndarray) -> Any:
    """Add the stiffness of joints to the rows of a rank, a scipy BSR array with ascending columns.

    free : (n, 3) bool; number : (n,) of a particle's column
    """
    rows, p = len(matrix.indptr) - 1, K.particles.astype(np.int64)
    stiffness, moves = K.stiffness, free[p].astype(float)
    aa, ab, ba, bb = (stiffness[:, i : i + 3, j : j + 3] for i in (0, 3) for j in (0, 3))
    # by the particles h, i, j of each joint, from the sides a and b
    by_particles = ((aa, ab - aa, -ab), (ba - aa, (aa - ab) + (bb - ba), ab - bb), (-ba, ba - bb, bb))
    joint_blocks = np.stack([np.stack(blocks, axis=1) for blocks in by_particles], axis=1)
    joint_blocks *= moves[:, :, None, :, None] * moves[:, None, :, None, :]
    row, column = np.repeat(p, 3, axis=1).ravel(), np.tile(p, (1, 3)).ravel()
    is_own = row < rows
    row = np.concatenate([np.repeat(np.arange(rows), np.diff(matrix.indptr)), row[is_own]])
    column = np.concatenate([matrix.indices, number[column[is_own]]])
    blocks = np.concatenate([matrix.data, joint_blocks.reshape(-1, 3, 3)[is_own]])
    width = matrix.shape[1] // 3
    place, inverse = np.unique(row * width + column, return_inverse=True)
    block = np.zeros((len(place), 3, 3))
    np.add.at(block, inverse, blocks)
    start = np.searchsorted(place, np.arange(rows + 1) * width)
    return blocks_of(block, (place % width).astype(np.int32), start, width)


def tangent_rows(
    distribution: Distribution,
    net: StaticNet,
    K: Tangent,
    at: Incidence,
    inertia: float,
    pattern: Pattern | None = None,
) -> BlockRows:
    """Build the tangent as a distributed matrix, without compression. Collective.

    at : of the particles that this rank owns; inertia : share of the nodal stiffness
        that is added; pattern : of an earlier one of the same net
    """
    d, K, inertia_rows = distribution.subdomain, without_compression(K), inertia * K.nodal
    matrix = block_matrix(net.ends, K, net.free != 0, inertia_rows, d.particle_gid, at, distribution.n)
    if pattern is None:
        owners = Owners(distribution.comm, d.particle_gid[: d.n_owned])
        pattern = Pattern(distribution.comm, matrix.indptr, matrix.indices, owners, owners)
    return BlockRows(pattern, matrix.data)
