"""What chains that bend add to the tangent stiffness, which then couples particles two bars apart."""

import numpy as np

from netfall.mechanics.bending import Joints, JointTangent, add_joint_bounds, joint_tangents
from netfall.multigrid.rows import blocks_of


def joint_tangent(x: np.ndarray, joints: Joints, nodal: np.ndarray) -> JointTangent:
    """The stiffness of joints at x (n, 3) [m]; their sizes are added to nodal (n,) [N/m]."""
    stiffness, positive = np.empty((2, len(joints.stiffness), 6, 6))
    joint_tangents(x, joints, stiffness, positive)
    add_joint_bounds(x, joints, 1.0, nodal)
    return JointTangent(joints.particles, stiffness, positive)


def with_joints(own, K: JointTangent, free: np.ndarray, number: np.ndarray):
    """The rows of a rank, a scipy BSR array, with what joints add, in ascending number.

    free : (n, 3) bool; number : (n,) of a particle's column
    """
    rows, p = len(own.indptr) - 1, K.particles.astype(np.int64)
    of_particles, moves = _by_particles(K.stiffness), free[p].astype(float)
    of_particles *= moves[:, :, None, :, None] * moves[:, None, :, None, :]
    row, column = np.repeat(p, 3, axis=1).ravel(), np.tile(p, (1, 3)).ravel()
    mine = row < rows
    row = np.concatenate([np.repeat(np.arange(rows), np.diff(own.indptr)), row[mine]])
    column = np.concatenate([own.indices, number[column[mine]]])
    parts = np.concatenate([own.data, of_particles.reshape(-1, 3, 3)[mine]])
    width = own.shape[1] // 3
    place, inverse = np.unique(row * width + column, return_inverse=True)
    block = np.zeros((len(place), 3, 3))
    np.add.at(block, inverse, parts)
    start = np.searchsorted(place, np.arange(rows + 1) * width)
    return blocks_of(block, (place % width).astype(np.int32), start, width)


def _by_particles(K: np.ndarray) -> np.ndarray:
    """Blocks (k, 3, 3, 3, 3) of h, i, j against one another, from K (k, 6, 6) by the sides (a, b)."""
    aa, ab, ba, bb = K[:, :3, :3], K[:, :3, 3:], K[:, 3:, :3], K[:, 3:, 3:]
    rows = ((aa, ab - aa, -ab), (ba - aa, (aa - ab) + (bb - ba), ab - bb), (-ba, ba - bb, bb))
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)
