"""Contribution of bending chains to the tangent stiffness, which couples particles two bars apart."""

from typing import Any

import numpy as np

from netfall.core.arrays import BoolArray
from netfall.physics.bending import Joints, JointTangent, add_joint_bounds, joint_tangents
from netfall.statics.multigrid.rows import blocks_of


def joint_tangent(x: np.ndarray, joints: Joints, nodal: np.ndarray) -> JointTangent:
    """Compute the stiffness of joints at x (n, 3) [m]; add its bound to nodal (n,) [N/m]."""
    stiffness, positive = np.empty((2, len(joints.stiffness), 6, 6))
    joint_tangents(x, joints, stiffness, positive)
    add_joint_bounds(x, joints, 1.0, nodal)
    return JointTangent(joints.particles, stiffness, positive)


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
