"""Bending of chains of bars without rotations: joints of three particles h, i, j in a row.

With a = x_i - x_h and b = x_j - x_i, at an angle phi (curvature of a discrete rod: Bergou and others 2008):

    kb = 2 (a x b) / (|a||b| + a.b)                  its size is 2 tan(phi / 2)
    U = k |kb - kb0|^2 / 2,   r = k (kb - kb0)       k = EI / l, l the mean of both unstressed lengths

kb0 is fixed in space, of the state without moment. That is exact for motion in the plane of a ring; out of
it the sum of moments k (kb x kb0) is that of a section that something not modelled keeps from tilting. A
straight chain, kb0 = 0, is free of it. |r| is the bending moment at i. The section has one second moment.
"""

import math
from typing import NamedTuple

import numpy as np

from netfall.ground.compile import allocating_kernel, kernel, part_of_kernel
from netfall.numerics.functions import lengths


class Joints(NamedTuple):
    """Joints (k,), in ascending number: particles (k, 3) h, i, j; stiffness (k,) [N m]; rest (k, 3) kb0.

    owned : (k,) uint8, 1 on the one rank that counts its energy: the owner of i
    """

    particles: np.ndarray
    stiffness: np.ndarray
    rest: np.ndarray
    owned: np.ndarray | None = None


class Bends(NamedTuple):
    """Chains that bend in a step: x (n, 3) [m]; their joints; force (n, 3) [N] on particles, out."""

    x: np.ndarray
    joints: Joints
    force: np.ndarray


class JointTangent(NamedTuple):
    """Stiffness (k, 6, 6) [N/m] of joints against changes of (a, b); positive : without what moments take."""

    particles: np.ndarray
    stiffness: np.ndarray
    positive: np.ndarray


@part_of_kernel
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@part_of_kernel
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@part_of_kernel
def _sides(x, joints, k):
    """a, b [m] of joint k at x (n, 3) [m], their lengths, and d = |a||b| + a.b."""
    h, i, j = joints.particles[k, 0], joints.particles[k, 1], joints.particles[k, 2]
    a = (x[i, 0] - x[h, 0], x[i, 1] - x[h, 1], x[i, 2] - x[h, 2])
    b = (x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2])
    A, B = math.sqrt(_dot(a, a)), math.sqrt(_dot(b, b))
    return a, b, A, B, A * B + _dot(a, b)


@part_of_kernel
def _moment(joints, k, c, d):
    """r [N m] of joint k; c : a x b."""
    s, rest, twice = joints.stiffness[k], joints.rest, 2.0 / d
    return s * (twice * c[0] - rest[k, 0]), s * (twice * c[1] - rest[k, 1]), s * (twice * c[2] - rest[k, 2])


@kernel
def add_bending_forces(x, joints, f):
    """Add the forces of joints at x (n, 3) [m] to the f (n, 3) [N] of their particles."""
    for k in range(joints.stiffness.shape[0]):
        h, i, j = joints.particles[k, 0], joints.particles[k, 1], joints.particles[k, 2]
        a, b, A, B, d = _sides(x, joints, k)
        c = _cross(a, b)
        r = _moment(joints, k, c, d)
        u, v, s = _cross(b, r), _cross(r, a), 2.0 * _dot(c, r) / (d * d)
        for axis in range(3):
            on_a = 2.0 / d * u[axis] - s * (B / A * a[axis] + b[axis])  # dU/da
            on_b = 2.0 / d * v[axis] - s * (A / B * b[axis] + a[axis])
            f[h, axis] += on_a
            f[i, axis] += on_b - on_a
            f[j, axis] -= on_b


@kernel
def find_bending_forces(bends):
    """Write the forces of joints at the present positions. bends : `Bends`"""
    for k in range(bends.joints.stiffness.shape[0]):
        for side in range(3):
            for axis in range(3):
                bends.force[bends.joints.particles[k, side], axis] = 0.0
    add_bending_forces(bends.x, bends.joints, bends.force)


@kernel
def joint_moments(x, joints, moment, hold):
    """Sizes (k,) [N m] of the moments r of joints, and of what holds their sections, k (kb x kb0)."""
    for k in range(moment.shape[0]):
        a, b, _, _, d = _sides(x, joints, k)
        c, rest = _cross(a, b), (joints.rest[k, 0], joints.rest[k, 1], joints.rest[k, 2])
        r = _moment(joints, k, c, d)
        moment[k] = math.sqrt(_dot(r, r))
        t = _cross((2.0 / d * c[0], 2.0 / d * c[1], 2.0 / d * c[2]), rest)
        hold[k] = joints.stiffness[k] * math.sqrt(_dot(t, t))


@part_of_kernel
def joint_moment(x, joints, k):
    """The moment |r| [N m] of joint k at x (n, 3) [m]."""
    a, b, _, _, d = _sides(x, joints, k)
    r = _moment(joints, k, _cross(a, b), d)
    return math.sqrt(_dot(r, r))


@part_of_kernel
def joint_energy(x, joints, k):
    """Energy [J] stored in joint k at x (n, 3) [m]."""
    a, b, _, _, d = _sides(x, joints, k)
    r = _moment(joints, k, _cross(a, b), d)
    return 0.5 * _dot(r, r) / joints.stiffness[k]


@allocating_kernel
def joint_tangents(x, joints, stiffness, positive):
    """Fill the (k, 6, 6) of `JointTangent`: the second derivatives of U by (a, b).

    J^T k J, J = dkb/d(a, b): positive. To it comes the second derivative of 2 (c.r) / d at a fixed r.
    """
    J, S, D = np.empty((3, 6)), np.empty(6), np.empty(6)
    for k in range(joints.stiffness.shape[0]):
        a, b, A, B, d = _sides(x, joints, k)
        c = _cross(a, b)
        r = _moment(joints, k, c, d)
        s, of_a, of_b = _dot(c, r), _cross(b, r), _cross(r, a)
        for m in range(3):
            S[m], S[3 + m] = of_a[m], of_b[m]  # ds
            D[m], D[3 + m] = B / A * a[m] + b[m], A / B * b[m] + a[m]  # dd
        for m in range(3):
            p, q = (m + 1) % 3, (m + 2) % 3
            for n in range(6):
                J[m, n] = -2.0 * c[m] / (d * d) * D[n]
            J[m, p] += 2.0 / d * b[q]  # of the change of a x b with a, and with b
            J[m, q] -= 2.0 / d * b[p]
            J[m, 3 + q] += 2.0 / d * a[p]
            J[m, 3 + p] -= 2.0 / d * a[q]
        for m in range(6):
            for n in range(6):
                jj = J[0, m] * J[0, n] + J[1, m] * J[1, n] + J[2, m] * J[2, n]
                positive[k, m, n] = joints.stiffness[k] * jj
                more = 4.0 * s / (d * d * d) * D[m] * D[n] - 2.0 / (d * d) * (S[m] * D[n] + D[m] * S[n])
                stiffness[k, m, n] = positive[k, m, n] + more
        w = -2.0 * s / (d * d)  # times the second derivatives of d
        for m in range(3):
            for n in range(3):
                one = 1.0 if m == n else 0.0
                cross = a[m] * b[n] / (A * B) + one
                stiffness[k, m, n] += w * B / A * (one - a[m] * a[n] / (A * A))
                stiffness[k, 3 + m, 3 + n] += w * A / B * (one - b[m] * b[n] / (B * B))
                stiffness[k, m, 3 + n] += w * cross
                stiffness[k, 3 + n, m] += w * cross
            p, q = (m + 1) % 3, (m + 2) % 3  # of s: -r x, of a change of b, in what a change of a does
            stiffness[k, m, 3 + p] += 2.0 / d * r[q]
            stiffness[k, m, 3 + q] -= 2.0 / d * r[p]
            stiffness[k, 3 + p, m] += 2.0 / d * r[q]
            stiffness[k, 3 + q, m] -= 2.0 / d * r[p]


@allocating_kernel
def add_joint_stiffness(u, particles, stiffness, force):
    """Add to force (n, 3) what joints answer to displacements u (n, 3) with; stiffness : (k, 6, 6) [N/m]"""
    w = np.empty(6)
    for k in range(particles.shape[0]):
        h, i, j = particles[k, 0], particles[k, 1], particles[k, 2]
        for m in range(3):
            w[m], w[3 + m] = u[i, m] - u[h, m], u[j, m] - u[i, m]
        for m in range(3):
            on_a = on_b = 0.0
            for n in range(6):
                on_a += stiffness[k, m, n] * w[n]
                on_b += stiffness[k, 3 + m, n] * w[n]
            force[h, m] -= on_a
            force[i, m] += on_a - on_b
            force[j, m] += on_b


@kernel
def add_joint_bounds(x, joints, times, out):
    """Add to out (n,) [N/m] at each particle, so many times, k |dkb/dx|^2 of its joints at x (n, 3) [m].

    |dkb/da| is at most 2 |b| / d + 2 |c| |dd| / d^2; with what the moment adds, 4 |r| / d, a joint's
    stiffness is at most three times these sizes.
    """
    for k in range(joints.stiffness.shape[0]):
        h, i, j = joints.particles[k, 0], joints.particles[k, 1], joints.particles[k, 2]
        a, b, A, B, d = _sides(x, joints, k)
        c = _cross(a, b)
        bend = 2.0 * math.sqrt(_dot(c, c)) / (d * d)
        turned = math.sqrt(2.0 * d / (A * B))  # size of dd/da over that of b, and of dd/db over that of a
        by_a, by_b = B * (2.0 / d + bend * turned), A * (2.0 / d + bend * turned)
        r, s = _moment(joints, k, c, d), times * joints.stiffness[k]
        more = 4.0 * times * math.sqrt(_dot(r, r)) / d
        out[h] += s * by_a * by_a + more
        out[i] += s * (by_a + by_b) * (by_a + by_b) + more
        out[j] += s * by_b * by_b + more


def curvatures(x: np.ndarray, particles: np.ndarray) -> np.ndarray:
    """kb (k, 3) of joints of particles (k, 3) at x (n, 3) [m]."""
    a, b = (x[particles[:, k + 1]] - x[particles[:, k]] for k in (0, 1))
    d = lengths(a) * lengths(b) + a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]
    return 2.0 / d[:, None] * np.cross(a, b)
