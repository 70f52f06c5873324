"""Highest frequency of the assembled net; 2 / omega_max is the sharp stability limit of the first step.

Lanczos iteration on M^-1/2 K M^-1/2, with material and geometric stiffness K and without held axes. Slack
cables count as taut, because they may become so at any time. Compression, which reduces the stiffness across
an element, is left out. The sums are exact and each particle's force is summed as in the time loop. So the
limit has the same bits on any number of ranks.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from netfall.core.linear import largest_tridiagonal_eigenpair
from netfall.parallel.halo import Halo
from netfall.parallel.mpi import MPI
from netfall.parallel.sums import exact_sums
from netfall.physics.bending import add_joint_bounds, add_joint_stiffness
from netfall.physics.elements import add_stiffness, geometric_stiffness
from netfall.physics.law.branches import branch_stiffening
from netfall.physics.law.measures import largest_stiffness
from netfall.physics.stability import Limit
from netfall.physics.state import State
from netfall.physics.supports import add_coupling, largest_springs, project_on_guides
from netfall.statics.multigrid.joints import joint_tangent

# relative error bound of omega_max^2 [-] at which the iteration ends; the bound is added, so the limit is
# conservative
CLOSE = 1e-4
MOST = 300  # iterations; the bound is added whatever its value
BOUND_CHECK_EVERY = 5  # iterations between checks of the bound


def assembled_limit(comm: MPI.Comm, state: State, element_gid: np.ndarray, halo: Halo) -> Limit:
    """Compute 2 / omega_max of the net in its present state, with slack cables taut and without held axes.

    Compression and the added mass of the air are left out; damping branches count.
    element_gid : (m,); halo : of width 3. Collective.
    """
    s, owned = state, slice(state.n_owned)
    elements = s.present_element_state()
    N, L = elements.N, elements.L
    direction = (s.x[s.ends[:, 1]] - s.x[s.ends[:, 0]]) / np.maximum(L, 1e-300)[:, None]
    axial, transverse = largest_stiffness(s.EA, s.L0), geometric_stiffness(np.maximum(N, 0.0), L)
    joints = None if s.joints is None else joint_tangent(s.x, s.joints, np.zeros(len(s.x)))
    mass = s.mass if s.air_mass is None else s.mass - s.air_mass  # the added mass of the air may be lost
    moves = (s.free != 0) & (mass > 0.0)[:, None]
    root = np.where(moves, 1.0 / np.sqrt(np.where(mass > 0.0, mass, 1.0))[:, None], 0.0)
    shape, force = np.empty((s.n_local, 3)), np.empty((s.n_local, 3))

    def apply(v: np.ndarray) -> np.ndarray:
        shape[owned] = v * root[owned]
        halo.update(shape)
        force[:] = 0.0
        add_stiffness(shape, s.ends, direction, axial, transverse, force)
        if joints is not None:
            add_joint_stiffness(shape, joints.particles, joints.positive, force)
        if s.features.springs:
            force[:] += s.spring * shape
        if s.turned is not None:
            add_coupling(s.turned, shape, force)
            project_on_guides(s.turned, force)
        return force[owned] * root[owned]

    number = 3 * s.gid[owned, None] + np.arange(3)
    any_vector = ((number * 2654435761) % 2**32) / 2.0**32 - 0.5  # depends on the number alone
    start = np.where(moves[owned], any_vector, 0.0)
    if s.turned is not None:
        project_on_guides(s.turned, start)
    top, mode = _largest_eigenvalue(comm, apply, start)
    if not top > 0.0:
        return Limit("assembled", np.inf, -1)
    shape[owned] = mode * root[owned]
    halo.update(shape)
    energy = axial * np.sum((shape[s.ends[:, 1]] - shape[s.ends[:, 0]]) * direction, axis=1) ** 2
    largest = (float(energy.max()), -int(element_gid[np.argmax(energy)])) if len(energy) else (-1.0, 1)
    omega2 = top * branch_stiffening(s.features.band)
    return Limit("assembled", 2.0 / float(np.sqrt(omega2)), -max(comm.allgather(largest))[1])


def _largest_eigenvalue(
    comm: MPI.Comm, apply: Callable[..., Any], start: np.ndarray
) -> tuple[float, np.ndarray]:
    """Return an upper bound of the largest eigenvalue of a symmetric map, and its vector. Collective.

    apply : the map of rows (n_owned, 3). The bound is 0 if the map or the start vector is zero.
    """
    (size,) = exact_sums(comm, start * start)
    if not size > 0.0:
        return 0.0, start
    diagonal: list[float] = []
    off_diagonal = [np.sqrt(size)]
    previous, v = np.zeros_like(start), start / off_diagonal[0]
    while True:
        w = apply(v) - (off_diagonal[-1] if len(diagonal) else 0.0) * previous
        (alpha,) = exact_sums(comm, w * v)
        w -= alpha * v
        (beta_squared,) = exact_sums(comm, w * w)
        diagonal.append(alpha)
        off_diagonal.append(np.sqrt(beta_squared))
        j = len(diagonal)
        ended = off_diagonal[-1] <= 1e-9 * max(np.abs(diagonal))  # the vectors span an invariant subspace
        if j % BOUND_CHECK_EVERY == 0 or ended or j == MOST:
            largest, vector = largest_tridiagonal_eigenpair(diagonal, [*off_diagonal[1:j], 0.0])
            error_bound = 0.0 if ended else off_diagonal[-1] * abs(vector[-1])
            if ended or error_bound <= CLOSE * largest or j == MOST:
                break
        previous, v = v, w / off_diagonal[-1]
    if not largest > 0.0:
        return 0.0, start
    mode = np.zeros_like(start)  # the vectors are recomputed, so they need not be stored
    previous, v = np.zeros_like(start), start / off_diagonal[0]
    for k in range(j):
        mode += vector[k] * v
        if k < j - 1:
            w = apply(v) - (off_diagonal[k] if k else 0.0) * previous - diagonal[k] * v
            previous, v = v, w / off_diagonal[k + 1]
    return largest + error_bound, mode


def is_long_step_stable(comm: MPI.Comm, state: State, halo: Halo, dt: float, margin: float) -> bool:
    """Return whether the present net, with split-off particles, is stable with the step dt [s]. Collective.

    The criterion is that of `stability.any_shape_limits` for the intact net. It limits omega dt to 1 at a
    cable, which may change between slack and taut, and to 2 at a bar, both times `margin`.
    halo : of any width
    """
    s, k = state, np.where(state.EA > 0.0, largest_stiffness(state.EA, state.L0), 0.0)
    k = k * branch_stiffening(s.features.band) if s.features.band else k
    stiffness = np.bincount(s.ends.ravel(), np.repeat(k, 2), s.n_local)
    if s.features.springs:
        stiffness += largest_springs(s.spring, s.turned)[: s.n_local]
    if s.joints is not None:
        add_joint_bounds(s.x, s.joints, 1.0, stiffness)
    moves = s.per_mass[: s.n_local] > 0.0
    square = np.zeros((s.n_local, halo.width))
    square[:, 0] = np.where(moves, stiffness * s.per_mass[: s.n_local], 0.0)
    halo.update(square)
    largest = np.where(s.bar != 0, 2.0, 1.0) * margin
    omega2 = np.where(k > 0.0, square[s.ends, 0].sum(1), 0.0)
    allowed = bool((omega2 * dt * dt <= largest * largest).all())
    if s.joints is not None:
        of_joints = square[s.joints.particles, 0].sum(1)
        allowed &= bool((of_joints * dt * dt <= (2.0 * margin) ** 2).all())
    return comm.allreduce(allowed, MPI.LAND)
